"""Magnitudes that vary all the time: told by how they move the vehicle, and not where nothing varies."""

from dataclasses import replace

import casadi as cs
import gap_cases
import numpy as np
import pytest
from driven import commands, without
from gap_cases import lap, nominal

import greybox_id as gb
from greybox_id.fitting.scores.metrics import simulate
from greybox_id.gap.estimation.axes import candidates, shifting
from greybox_id.gap.estimation.model_error import ForceSizes, amplitude_prior, estimated, linearised
from greybox_id.gap.estimation.preparing import prepare
from greybox_id.gap.estimation.wandering import wandering
from greybox_id.models.effects import EFFECTS
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle

G = 9.81
NOISE = {"v_x": 0.02, "yaw_rate": 0.01, "a_x": 0.15, "a_y": 0.15}
VARIES = {
    "road_bank": {"gravity_y": lambda g_y, q: g_y + G * cs.sin(q.u.varies)},
    "steering_offset": {"steer": lambda steer, q: steer + q.u.varies},
    "grip_scale": {"D_f": lambda D, q: D * (1 + q.u.varies), "D_r": lambda D, q: D * (1 + q.u.varies)},
}


def process(time, sd, correlation_time, rng):
    """A first-order Gauss-Markov process, sampled exactly."""
    fade = np.exp(-(time[1] - time[0]) / correlation_time)
    values = [sd * rng.standard_normal()]
    for _ in time[1:]:
        values.append(fade * values[-1] + sd * np.sqrt(1 - fade**2) * rng.standard_normal())
    return np.array(values)


def drive(effect, sd, correlation_time, seed, seconds=60.0):
    """A single track with a magnitude that varies, or none, read with noise."""
    model, rng = build("single_track", None, {}, vehicle("full_size_car")), np.random.default_rng(1000 + seed)
    given = commands(seconds, seed, dt=0.02)
    if effect:
        given = given.with_signals(varies=process(given.time, sd, correlation_time, rng))
        model = replace(model, inputs=(*model.inputs, "varies")).altered(**VARIES[effect])
    found = simulate(model, without(given, "v_x"), {"v_x": 18.0})
    read = {
        name: found.predicted[:, k] + NOISE[name] * rng.standard_normal(len(given.time))
        for k, name in enumerate(model.outputs)
        if name in NOISE
    }
    return without(given, "v_x", "varies").with_signals(**read)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [11, 12])
@pytest.mark.parametrize(
    ("effect", "sd", "correlation_time"),
    [("road_bank", 0.03, 3.0), ("steering_offset", 0.004, 3.0), ("grip_scale", 0.1, 5.0)],
)
def test_what_varies_is_what_the_unknown_looks_like(effect, sd, correlation_time, seed):
    driven = drive(effect, sd, correlation_time, seed)
    found = gb.diagnose("single_track", driven, vehicle="full_size_car").to_json()
    assert found["gap_detected"]
    assert found["unknown_probability"] > 0.5
    first = found["resembles"][0]
    assert first["effect"] == effect
    # twenty correlation times tell it to a fifth; tolerances take up a part, more where curves are found to be rough
    assert 0.4 < first["sd"] / sd < 2.0
    assert 0.2 < first["correlation_time"] / correlation_time < 5.0
    assert f"like {effect} that varies by ± " in found["unknown"]
    # its mean may be elsewhere than stated, and a grip that varies with the tyres' temperature is one that varies
    assert set(found["applied"]) <= {effect} | ({"tyre_temperature"} if effect == "grip_scale" else set())


@pytest.mark.slow
def test_where_nothing_varies_nothing_is_said():
    found = gb.diagnose("single_track", drive("", 0.0, 1.0, 11, seconds=20.0), vehicle="full_size_car").to_json()
    assert not found["resembles"]
    assert not found["gap_detected"]


@pytest.mark.parametrize("name", ["tyre_relaxation", "steering_offset", "steering_ratio", "roll_dynamics"])
def test_another_size_that_stays_is_none_that_varies(name):
    """Equations at their nulls, an independent simulator at another size all the time."""
    known = {each: EFFECTS[each] for each in (name, "road_bank", "tyre_relaxation")}
    driven = [lap({name: EFFECTS[name].typical})]
    bench = prepare(nominal(), driven, known, gap_cases.CAR).bench(driven)
    sd = np.array([gap_cases.NOISE[channel] for channel in bench.channels])
    p, prior = bench.model.values, amplitude_prior(sd, True, False, {})
    residuals = bench.simulate(p[None])[0] - bench.measured
    about = linearised(bench, p, sd, ForceSizes(bench))
    amplitudes = estimated(about, residuals, bench.counted, prior)
    asked = [(one.effect, one.axes[0]) for one in candidates(bench.model, known, shifting(bench.model))]
    assert wandering(bench, p, residuals, bench.counted, amplitudes, prior, sd, asked) == ()
