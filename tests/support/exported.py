"""What the tests of exports share: models to export, random states and inputs for them, exports loaded as modules."""

import importlib.util
import sys

import numpy as np
from toys import scattered, tiny

from greybox_id.export.subject import Subject
from greybox_id.export.verb import export
from greybox_id.models.registry import build
from greybox_id.models.tyres import TYRES

MOTION = {
    **{f"single_track on {tyre}": ("single_track", {"tyre": tyre}) for tyre in TYRES},
    **{f"lateral on {tyre}": ("lateral", {"tyre": tyre}) for tyre in TYRES},
    "longitudinal": ("longitudinal", {}),
    "kinematic": ("kinematic", {}),
}
"""Every model of motion on every tyre."""

MEMORY = ("msnn_lat", "msnn_long", "msnn_full", "msnn_full_plus")

EFFECTS = {
    "steering_delay": 0.03, "steering_lag": 0.05, "steering_backlash": 0.01, "motor_saturation": 2.0,
    "tyre_relaxation": 0.3, "combined_slip": 1.0, "load_sensitivity": 0.5, "longitudinal_load_transfer": 1.0,
    "tyre_temperature": 0.2, "roll_dynamics": 0.01, "sensor_latency_imu": 0.02, "wind_gust": 5.0,
}  # fmt: skip
"""Effects whose equations use operations that bare models do not."""


def motion(name, effects=()):
    """A model of motion by its name in `MOTION`."""
    model, settings = MOTION[name]
    return build(model, settings, {own: EFFECTS[own] for own in effects})


def memory(name):
    """A small map with memory, at weights that do something."""
    return scattered(tiny(name), 1)


def subject(model, name="car", moving=None):
    """A model to export."""
    return Subject(model, name, moving, source="a test")


def points(equations, count, seed=0):
    """(count, entries) states and inputs, about standstill and far from it; a tenth of all numbers is zero."""
    rng = np.random.default_rng(seed)
    speed = rng.choice([0.0, 1e-9, 0.3, 3.0, 30.0], (count, 1)) * rng.standard_normal((count, 1))
    sizes = {"v_x": 1.0, "v_y": 0.3, "yaw_rate": 0.3, "steer": 0.2}
    x = np.hstack([_column(own.name, sizes, speed, rng) for own in equations.states])
    u = np.hstack([_column(own.name, sizes, speed, rng) for own in equations.inputs])
    return x, u


def _column(name, sizes, speed, rng):
    if name == "v_x":
        return speed
    return sizes.get(name, 0.3) * rng.standard_normal(speed.shape) * (rng.random(speed.shape) > 0.1)


def values(function, *arguments):
    """(rows, results) a CasADi function row by row; an argument of one dimension holds for all."""
    rows = len(arguments[0])
    given = [np.asarray(own, dtype=float) for own in arguments]
    columns = [own.T if len(own) == rows else np.tile(own.reshape(-1, 1), rows) for own in given]
    return np.array(function.map(rows)(*columns)).T


def write(model, target, folder, name="car", moving=None):
    """Export a model; the folder."""
    export(subject(model, name, moving), target, folder)
    return folder


def loaded(folder, name="car"):
    """An exported Python module."""
    spec = importlib.util.spec_from_file_location(f"exported_{name}", folder / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module
