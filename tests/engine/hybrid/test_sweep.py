"""Windows swept forward and back are what CasADi makes of the whole sample, network and all."""

import casadi as cs
import numpy as np
import pytest
from driven import driven

from greybox_id.engine.hybrid.cell import Cell
from greybox_id.engine.hybrid.problem import HybridProblem, RateErrors, WindowErrors, drawn
from greybox_id.engine.hybrid.stretches import stretches, windows
from greybox_id.models.registry import prepared

NOISE = {"v_y": 0.05, "yaw_rate": 0.01, "a_y": 0.2, "sideslip": 0.004, "yaw_acceleration": 0.7}
EVERY = (
    *(("mlp_lateral", {"hidden": [5, 4], "integrator": how}) for how in ("euler", "ab2", "rk4")),
    ("mlp_lateral", {"hidden": [5], "symmetric": False, "activation": "relu"}),
    ("bicycle_mlp", {"hidden": [5, 4], "free_physics": True}),
    ("hybrid_stiffness", {"hidden": [5, 4], "window": 40, "warm_up": 15}),
    ("hybrid_force", {"hidden": [5, 4], "window": 40, "warm_up": 15}),
)


@pytest.fixture(scope="module")
def lap():
    return driven("lateral", runs=2, seconds=3.0)


def squares(model, found, noise):
    """p -> (mean square over windows, gradient), by CasADi alone."""
    laid, cell = windows(model, found), Cell(model)
    rows, _, columns = laid.inputs.shape
    p = cs.MX.sym("p", model.size)
    steps = cell.sample(columns, model.outputs).mapaccum("windows", rows)
    _, told = steps(cell.start(laid.starts), np.concatenate(list(laid.inputs), axis=1), cs.repmat(p, 1, rows))
    read = np.concatenate(list(laid.outputs), axis=1)
    counts = np.isfinite(read)
    value = cs.sumsqr((told - np.nan_to_num(read)) * np.where(counts, 1.0 / noise[:, None], 0.0)) / np.sum(counts)
    return cs.Function("squares", [p], [value, cs.gradient(value, p)])


@pytest.mark.parametrize(("name", "settings"), EVERY)
def test_errors_and_gradients_are_casadi_s(lap, name, settings):
    model = prepared(name, lap, settings)
    found, noise = stretches(model, lap), np.array([NOISE[output] for output in model.outputs])
    found[0].outputs[0, 40:47] = np.nan
    p = drawn(model, 3)
    value, slope = (np.array(own).ravel() for own in squares(model, found, noise)(p))
    errors = WindowErrors(model, found, noise)
    own, by_p = errors.with_gradient(p)
    assert own == pytest.approx(value[0], rel=1e-10)
    assert errors(p) == pytest.approx(own, rel=1e-12)
    assert by_p == pytest.approx(slope, rel=1e-8, abs=1e-10 * np.max(np.abs(slope)))


def test_blocks_that_are_not_full_count_what_is_in_them(lap, monkeypatch):
    model = prepared("mlp_lateral", lap, {"hidden": [5]})
    found, noise, p = stretches(model, lap), np.array([0.05, 0.01]), drawn(model, 3)
    whole = WindowErrors(model, found, noise).with_gradient(p)
    monkeypatch.setattr("greybox_id.engine.hybrid.problem._ABREAST", 1)
    monkeypatch.setattr("greybox_id.engine.hybrid.problem._FEWEST", 4)
    pieces = WindowErrors(model, found, noise).with_gradient(p)
    assert pieces[0] == pytest.approx(whole[0], rel=1e-12)
    assert pieces[1] == pytest.approx(whole[1], rel=1e-9)


@pytest.mark.parametrize("name", ["mlp_lateral", "bicycle_mlp"])
def test_errors_of_rates_are_casadi_s(lap, name):
    model = prepared(name, lap, {"hidden": [5, 4]})
    rng, p = np.random.default_rng(0), drawn(model, 3)
    x, u = rng.normal(0.0, 0.1, (2, 31)), np.array([rng.uniform(10.0, 20.0, 31), rng.normal(0.0, 0.03, 31)])
    wanted, scale = rng.normal(0.0, 1.0, (2, 31)), rng.uniform(0.5, 2.0, (2, 31))
    own, slope = RateErrors(model, x, u, wanted, scale).with_gradient(p)
    rates = np.array(Cell(model).rates(cs.DM(x), cs.DM(u), cs.DM(p)))
    assert own == pytest.approx(np.mean(((rates - wanted) / scale) ** 2), rel=1e-12)
    along = rng.standard_normal(len(p)) * (slope != 0.0)
    errors = RateErrors(model, x, u, wanted, scale)
    ahead, behind = (errors(p + h * along) for h in (1e-6, -1e-6))
    assert slope @ along == pytest.approx((ahead - behind) / 2e-6, rel=1e-5)


def test_training_is_interrupted_at_once(lap, monkeypatch):
    """Ctrl-C within a sweep is Python's own, which keeps the best weights so far."""
    model = prepared("mlp_lateral", lap, {"hidden": [5]})
    problem = HybridProblem(model, stretches(model, lap), np.array([0.05, 0.01]))

    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("greybox_id.engine.hybrid.sweep.NetworkLayers.backward", stop)
    with pytest.raises(KeyboardInterrupt):
        problem(problem.unknowns(drawn(model, 0)))
