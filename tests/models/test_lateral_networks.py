"""Feed-forward lateral networks: odd where they are to be, a bicycle where their weights are zero."""

from types import SimpleNamespace

import casadi as cs
import numpy as np
import pytest
from driven import driven

from greybox_id.api.linear import linearised
from greybox_id.base.errors import BadInput
from greybox_id.engine.hybrid.cell import Cell, free_run, network_outputs
from greybox_id.engine.hybrid.motion import as_motion
from greybox_id.engine.hybrid.problem import drawn
from greybox_id.fitting.scores.metrics import simulate
from greybox_id.models.registry import build, prepared


@pytest.fixture(scope="module")
def lap():
    return driven("lateral", runs=2, seconds=3.0)


def test_a_symmetric_network_is_odd_and_another_is_not():
    for symmetric in (True, False):
        model = build("mlp_lateral", {"hidden": [6, 5], "symmetric": symmetric})
        p = drawn(model, 3)
        rates = Cell(model)
        x, u = np.array([[0.4], [0.1]]), np.array([[17.0], [0.03]])
        left = np.array(rates.rates(cs.DM(x), cs.DM(u), cs.DM(p)))
        right = np.array(rates.rates(cs.DM(-x), cs.DM(u * [[1.0], [-1.0]]), cs.DM(p)))
        assert np.allclose(left, -right) == symmetric


def test_weights_of_zero_leave_the_bicycle(lap):
    """Against the lateral model, which has the same equations but for its care at standstill."""
    network, plain = build("bicycle_mlp"), build("lateral")
    of_network = {parameter.name: parameter for parameter in network.parameters}
    plain = plain.with_parameters(
        *(p.with_value(of_network[p.name].array) for p in plain.parameters if p.name in of_network)
    )
    start = {"v_y": 0.1, "yaw_rate": 0.05}
    found, known = (simulate(own, lap, start).predicted[:, :2] for own in (as_motion(network), plain))
    assert found == pytest.approx(known, abs=1e-9)


@pytest.mark.parametrize("name", ["mlp_lateral", "bicycle_mlp"])
@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_equations_of_motion_run_as_the_hybrid_does(lap, name, hold):
    from dataclasses import replace

    lap = replace(lap, hold=hold)
    model = prepared(name, lap, {"hidden": [6]})
    model = model.with_values(drawn(model, 1))
    simulated, other = free_run(model, lap), simulate(as_motion(model), lap)
    for k, output in enumerate(model.outputs):
        assert simulated[output][other.rows] == pytest.approx(other.predicted[:, k], abs=1e-12)


def test_a_network_is_linearised_as_the_motion_that_it_amounts_to(lap):
    """Beside differences of its rates, about straight driving, where an odd network stands still."""
    model = prepared("bicycle_mlp", lap, {"hidden": [6], "symmetric": True})
    model = model.with_values(drawn(model, 1))
    system = linearised(model, 18.0)
    names, h = [*system.state_labels, *system.input_labels], 1e-6
    assert names == ["v_y", "yaw_rate", *model.inputs]
    at = {"v_y": 0.0, "yaw_rate": 0.0, "v_x": 18.0, "steer": 0.0}

    def rates(**more):
        now = {**at, **more}
        x, u = ([[now[name]] for name in own] for own in (("v_y", "yaw_rate"), model.inputs))
        return np.array(Cell(model).rates(cs.DM(x), cs.DM(u), cs.DM(model.values))).ravel()

    slopes = [(rates(**{n: at[n] + h}) - rates(**{n: at[n] - h})) / (2 * h) for n in names]
    assert np.hstack([system.A, system.B]) == pytest.approx(np.array(slopes).T, rel=1e-6, abs=1e-6)
    with pytest.raises(BadInput, match="recurrent network, and equations of motion have no place for its memory"):
        linearised(build("hybrid_force"), 18.0)


def test_unscaled_networks_say_increments(lap):
    model = prepared("mlp_lateral", lap, {"hidden": [4], "scaled": False, "symmetric": False, "integrator": "euler"})
    model = model.with_values(drawn(model, 2))
    weights = {name: cs.DM(model[name].array) for name in model.network.shapes}
    first = {name: lap[name][0] for name in ("v_y", "yaw_rate", "v_x", "steer")}
    step = np.array(network_outputs(model.network, cs.DM(list(first.values())), weights)).ravel()
    found = free_run(model, lap)
    assert found["v_y"][1] == pytest.approx(first["v_y"] + step[0])
    assert found["yaw_rate"][1] == pytest.approx(first["yaw_rate"] + step[1])


def test_what_has_no_equations_of_motion_is_refused():
    with pytest.raises(BadInput, match="recurrent"):
        as_motion(build("hybrid_force"))
    with pytest.raises(BadInput, match="integrator=rk4"):
        as_motion(build("mlp_lateral", {"integrator": "euler"}))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"hidden": [0]}, "hidden"),
        ({"activation": "sine"}, "activation"),
        ({"integrator": "heun"}, "integrator"),
        ({"warm_up": 30}, "warm_up"),
        ({"scales": [1, 2]}, "seven numbers"),
    ],
)
def test_settings_that_cannot_be_built_are_sentences(settings, words):
    with pytest.raises(BadInput, match=words):
        build("mlp_lateral", settings)


def test_a_recording_without_the_motion_is_refused(lap):
    signals = {name: own for name, own in lap.signals.items() if name != "v_y"}
    from dataclasses import replace

    with pytest.raises(BadInput, match="neither v_y nor sideslip"):
        prepared("mlp_lateral", replace(lap, signals=signals))
    assert SimpleNamespace(**signals).yaw_rate is not None
