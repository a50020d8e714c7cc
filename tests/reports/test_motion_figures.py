"""Figures of equations of motion hold what the model and its covariance say."""

from dataclasses import replace

import numpy as np
import pytest

from greybox_id.datasets.recording import Recording
from greybox_id.fitting.fit import reach
from greybox_id.fitting.provenance import Stage
from greybox_id.fitting.scores.metrics import simulate
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle
from greybox_id.reports.figures.characteristics import handling, share_with_band, tyres
from greybox_id.reports.figures.estimates import convergence, correlation, correlations
from greybox_id.reports.report import prepared
from greybox_id.reports.settled import OverSlip, steady_turns

pytestmark = pytest.mark.usefixtures("_uncompiled")


@pytest.fixture
def car():
    def car(name="lateral", settings=None, effects=None):
        return build(name, settings, effects or {}, vehicle("full_size_car"))

    return car


def test_there_is_every_figure_that_the_model_gives_a_meaning(motion_made):
    assert [one.name for one in motion_made] == [
        *("correlation", "horizons", "traces", "traces_training", "residuals", "spectrum"),
        *("tyres", "handling", "excitation", "convergence", "starts"),
    ]


def test_a_model_without_tyres_or_steering_goes_without_their_figures(motion_fit, motion_found, car):
    longitudinal = replace(motion_fit, model=car("longitudinal"))
    assert tyres(longitudinal.model, longitudinal, motion_found) is None
    assert handling(longitudinal.model, motion_found) is None
    kinematic = replace(motion_fit, model=car("kinematic"))
    assert tyres(kinematic.model, kinematic, motion_found) is None
    assert handling(kinematic.model, motion_found) is not None


def test_correlations_are_those_of_the_covariance(motion_fit):
    names, matrix = correlations(motion_fit)
    assert names == [p.name for p in motion_fit.model.parameters if not p.fixed]
    np.testing.assert_allclose(np.diag(matrix), 1.0)
    sd = np.array([float(motion_fit.sd[name]) for name in names])
    places = [k for k, p in enumerate(motion_fit.model.parameters) if not p.fixed]
    np.testing.assert_allclose(matrix * np.outer(sd, sd), motion_fit.covariance[np.ix_(places, places)], rtol=1e-9)


def test_there_is_no_picture_of_no_covariance(motion_fit):
    assert correlation(replace(motion_fit, covariance=None)) is None


@pytest.mark.parametrize("name", ["lateral", "single_track"])
def test_tyre_curves_are_the_tyre_s_and_lags_do_not_count(car, name):
    model = car(name, None, {"tyre_relaxation": 0.4, "steering_delay": 0.05})
    B, C, D, E = (float(model[f"{letter}_r"].array) for letter in "BCDE")
    slip = np.linspace(-0.2, 0.2, 9)
    x = B * slip
    expected = D * np.sin(C * np.arctan(x - E * (x - np.arctan(x))))
    np.testing.assert_allclose(OverSlip(model, "r", 20.0)(slip, model.values), expected, atol=1e-12)


def test_effects_on_grip_are_in_the_tyre_curve(car):
    plain, slippery = car(), car("lateral", None, {"grip_scale": 0.8})
    at = np.array([0.3])
    share = [float(OverSlip(model, "f", 20.0)(at, model.values)[0]) for model in (plain, slippery)]
    assert share[1] < 0.9 * share[0]


def test_the_band_of_a_linear_tyre_is_its_stiffness_s_interval(motion_fit, car):
    model = car("lateral", {"tyre": "linear"})
    sd, place = 2000.0, [p.name for p in model.parameters].index("C_alpha_f")
    covariance = np.zeros((model.size, model.size))
    covariance[place, place] = sd**2
    fit = replace(motion_fit, model=model, covariance=covariance, dof={"C_alpha_f": np.array(5.0)})
    share, low, high = share_with_band(fit, OverSlip(model, "f", 20.0), np.array([-0.02, 0.04]))
    stiffness = float(model["C_alpha_f"].array)
    np.testing.assert_allclose((high - low) / 2, np.abs(share) * reach(5.0) * sd / stiffness, rtol=1e-6)


@pytest.mark.parametrize("name", ["lateral", "single_track", "kinematic"])
def test_steady_turns_are_what_a_long_constant_drive_ends_in(car, name):
    model, v_x = car(name), 15.0
    (rate,) = steady_turns(model, np.array([0.03]), v_x)
    time = 0.02 * np.arange(500)
    held = {"steer": np.full(500, 0.03), "v_x": np.full(500, v_x)}
    if name == "single_track":
        drag = sum(float(model[f"c_{k}"].array) * v_x**k for k in range(3))
        drive = drag / float(model["force_per_unit"].array)
        held = {"steer": held["steer"], "ax_cmd": np.full(500, drive)}
    start = {"v_x": v_x} if name == "single_track" else {}
    end = simulate(model, Recording("held", time, held), start)
    rates = end.predicted[:, model.outputs.index("yaw_rate")]
    # The three-degree model loses some speed to its tyres in the turn, which the steady turn makes up for.
    assert rate == pytest.approx(rates[-1], rel=0.1 if name == "single_track" else 1e-4)


def test_turns_end_where_there_is_none_that_is_steady(car):
    model = car("lateral", None, {"grip_scale": 0.12})
    rates = steady_turns(model, np.linspace(0.0, 0.3, 31), 30.0)
    assert np.isfinite(rates[0])
    assert not np.any(np.diff(np.isfinite(rates).astype(int)) > 0)


def test_starts_that_end_alike_do_not_look_different(motion_fit):
    stage = replace(motion_fit.stages[-1], starts=(100.0, 100.00001))
    assert convergence(stage).grid[0, 1].get_ylim()[1] > 0.1


def test_a_solve_of_no_steps_and_one_start_has_no_picture(motion_fit):
    stage = motion_fit.stages[-1]
    assert isinstance(stage, Stage)
    assert convergence(replace(stage, history=(5.0,), starts=(5.0,), certificate=None)) is None


def test_a_drive_of_half_a_second_is_drawn_all_the_same(motion_fit, laps):
    record = replace(motion_fit.data[2], samples=12, runs=1, duration=0.44)
    one = replace(motion_fit, data=(*motion_fit.data[:2], record))
    for drawing in prepared(one, [*laps[:2], laps[2].rows(0, 12)]).drawings:
        assert drawing.svg.startswith("<svg")
