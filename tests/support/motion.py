"""Recordings of the reference vehicle with noise, the models of it, and problems of fitting them."""

from dataclasses import replace
from functools import cache

import numpy as np
from driving import on_vehicle
from reference_manoeuvres import manoeuvre
from reference_vehicle import FULL_SIZE_CAR, simulate, simulate_lateral
from scipy.signal import lfilter

from greybox_id.datasets.recording import Recording
from greybox_id.engine.motion.shooting import MotionProblem
from greybox_id.engine.motion.simulator import Simulator
from greybox_id.models.effects import EFFECTS
from greybox_id.models.single_track import lateral, single_track

NOISE = {"v_x": 0.02, "v_y": 0.02, "yaw_rate": 0.005, "a_x": 0.1, "a_y": 0.1}
MODELS = {"single_track": single_track(), "lateral": lateral()}
SHAPE = ("C_f", "C_r")
"""Held where tyres are to be well told: shape, stiffness and friction factors stand for one another."""


@cache
def commands(seconds=4.0, rate=50.0, seed=0, name="mixed"):
    """Commands and the speed they keep."""
    return manoeuvre(name, FULL_SIZE_CAR, seed=seed, duration=seconds, rate=rate)


def recorded(name="lateral", effects=None, *, noise=1.0, rho=0.0, hold="zero", seed=0, given=None, **driving):
    """What the sensors of the reference vehicle read while it is driven: the signals a model needs, and its outputs.

    noise: over `NOISE`; rho: correlation of neighbouring rows' noise; given: commands, else those of `driving`.
    """
    given = given or commands(seed=seed, **driving)
    if name == "lateral":
        read = simulate_lateral(FULL_SIZE_CAR, {k: v for k, v in given.items() if k != "drive"}, effects, hold=hold)
        inputs = {"steer": given["steer"], "v_x": read["v_x"]}
    else:
        read = simulate(FULL_SIZE_CAR, given, effects, hold=hold, start=(given["v_x"][0], 0.0, 0.0))
        inputs = {"steer": given["steer"], "ax_cmd": given["drive"]}
    rng = np.random.default_rng(1000 + seed)
    outputs = {n: read[n] + noise * NOISE[n] * coloured(rng, len(read["time"]), rho) for n in MODELS[name].outputs}
    return Recording(f"drive {seed}", given["time"], {**inputs, **outputs}, hold=hold)


def coloured(rng, rows, rho):
    """Noise of variance one."""
    return lfilter([1.0], [1.0, -rho], np.sqrt(1 - rho**2) * rng.standard_normal(rows + 200))[200:]


def car(name="lateral", effects=None, *, held=(), per_run=(), priors=None, wrong=None):
    """The model of the reference vehicle; effects are free, starting at what is given; wrong: factors on parameters."""
    model = on_vehicle(MODELS[name], FULL_SIZE_CAR)
    for effect, value in (effects or {}).items():
        model = model + EFFECTS[effect].starting_at(value)
    changed = [replace(model[n], fixed=True) for n in held]
    model = model.with_parameters(*changed)
    model = model.with_parameters(*(replace(model[n], scope="run") for n in per_run))
    model = model.with_parameters(*(replace(model[n], prior=prior) for n, prior in (priors or {}).items()))
    return model.with_parameters(*(model[n].with_value(model[n].array * by) for n, by in (wrong or {}).items()))


def problem(model, recordings, compiled=False, **options):
    """With the noise there is."""
    recordings = [recordings] if isinstance(recordings, Recording) else recordings
    noise = np.array([NOISE[name] for name in model.outputs])
    return MotionProblem(Simulator(model, compiled=compiled), recordings, noise=noise, **options)


def slope(function, x, k, step=1e-5):
    """Derivative of a function by x[k], from five points."""
    h = step * max(abs(x[k]), 1e-2)

    def at(steps):
        moved = x.copy()
        moved[k] += steps * h
        return function(moved)

    return (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * h)
