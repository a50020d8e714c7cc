"""Standstill, walking pace and reverse: every motion model stays finite, and what rests keeps resting."""

import numpy as np
import pytest
from linearised import everything_and_its_derivatives, outputs, rates, run, segment, vector

from greybox_id.models.registry import build
from greybox_id.models.tyres import TYRES

MODELS = [(name, {"tyre": tyre}) for name in ("single_track", "lateral") for tyre in TYRES]
MODELS += [("longitudinal", {}), ("kinematic", {}), ("kinematic", {"understeer": False})]
SPEEDS = [0.0, 1e-300, 1e-12, 1e-3, 0.05, 0.3, 3.0]


def at_speed(model, v_x, others):
    """All of z at a speed, the other states at `others`, and the inputs that speed is part of."""
    z = [v_x if state.name == "v_x" else others for state in model.states]
    z += [0.0] * len(model.actuators)
    return np.array(z), ({"v_x": v_x} if "v_x" in model.inputs else {})


def commands(model, steer, drive):
    return {name: value for name, value in {"steer": steer, "drive": drive}.items() if name in model.inputs}


@pytest.mark.parametrize("drive", [0.0, 2.0, -3.0])
@pytest.mark.parametrize("others", [0.0, 1e-9, -0.4])
@pytest.mark.parametrize(("name", "settings"), MODELS)
def test_everything_and_its_derivatives_are_finite(name, settings, others, drive):
    model = build(name, settings)
    function = everything_and_its_derivatives(model)
    for v_x in [*SPEEDS, *np.negative(SPEEDS)]:
        for steer in (0.0, 0.4):
            z, speed = at_speed(model, v_x, others)
            s = segment(model, 0.01, **speed, **commands(model, steer, drive))
            assert np.all(np.isfinite(np.array(function(z, s, model.values))))


@pytest.mark.parametrize("steer", [0.0, 0.3])
@pytest.mark.parametrize(("name", "settings"), MODELS)
def test_a_vehicle_at_rest_stays_at_rest(name, settings, steer):
    model = build(name, settings)
    z, speed = at_speed(model, 0.0, 0.0)
    given = {**speed, **commands(model, steer, 0.0)}
    assert all(rate == 0 for rate in rates(model, z, **given).values())
    assert all(reading == 0 for reading in outputs(model, z, **given).values())
    assert np.all(run(model, z, 5, 0.002, **given) == 0)


@pytest.mark.parametrize(("name", "settings"), MODELS)
def test_a_vehicle_that_creeps_comes_to_rest(name, settings):
    model = build(name, settings)
    z, speed = at_speed(model, 0.0, 0.02)
    z[: len(model.states)] = 0.02
    found = run(model, z, 5000, 0.002, **speed, **commands(model, 0.2, 0.0))
    assert np.all(np.abs(found[-1]) < 1e-3)


@pytest.mark.parametrize("v_x", [1.0, -1.0])
@pytest.mark.parametrize(("name", "settings"), [entry for entry in MODELS if entry[0] in ("lateral", "kinematic")])
def test_slow_driving_follows_the_steered_wheels_forwards_and_in_reverse(name, settings, v_x):
    model = build(name, settings)
    p = vector(model, l_f=1.2, l_r=1.4)
    z, _ = at_speed(model, v_x, 0.0)
    found = run(model, z, 1000, 0.002, p=p, v_x=v_x, steer=0.2)
    at = [state.name for state in model.states].index("yaw_rate")
    assert found[-1, at] == pytest.approx(v_x * np.tan(0.2) / 2.6, rel=0.02)


def test_in_reverse_the_front_axle_swings_out_to_the_side_away_from_its_steer():
    model = build("single_track")
    assert rates(model, [-2.0, 0.0, 0.0], steer=0.1, drive=0.0)["yaw_rate"] < 0
    assert rates(model, [2.0, 0.0, 0.0], steer=0.1, drive=0.0)["yaw_rate"] > 0
