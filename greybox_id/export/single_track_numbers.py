"""Parameters of a single track for parameter files, including the model's effects, at rest on a level road."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite, pi, sin

import casadi as cs
import numpy as np

from ..base.errors import BadInput
from ..engine.motion.trace import MotionTrace
from ..models.model import Model, Namespace, Symbol, must_be
from ..models.motion_model import MotionModel, Quantities
from .subject import Subject

G = 9.81
"""Gravity, m/s^2, as in f1tenth_gym and the ForzaETH race stack."""
HELD = (
    "mass_change",
    "yaw_inertia",
    "cog_shift",
    "front_stiffness",
    "rear_stiffness",
    "grip_scale",
    "load_sensitivity",
)
"""Effects that mass, inertia, lengths and tyres at rest include."""
_ALTERED = ("m", "I_z", "l_f", "l_r")
_TOLD = ("peak_f", "peak_r", "stiffness_f", "stiffness_r", *(f"altered_{name}" for name in _ALTERED))
_SLOPED = ("F_yf", "F_yr", "alpha_f", "alpha_r")


def without_form_error(subject: Subject) -> list[str]:
    """Sentence that parameter files contain the nearest formula if a curve's form error was estimated."""
    if subject.model.settings.get("form", "exact") == "exact":
        return []
    return [
        "Tyre curves and front wheels were fitted with form=uncertain: the files hold the nearest formula, without "
        "the uncertainty of its form."
    ]


@dataclass(frozen=True)
class Axle:
    """An axle's tyre.

    Attributes
    ----------
    load : m g times the other axle's share of the wheelbase, N.
    C_alpha : cornering stiffness, N/rad.
    peak : largest lateral force, N; infinite on linear tyres.
    B, C, E : Pacejka's stiffness factor [1/rad], shape and curvature; None for other tyres.
    """

    load: float
    C_alpha: float
    peak: float
    B: float | None
    C: float | None
    E: float | None

    @property
    def pacejka(self) -> list[float] | None:
        """B [1/rad], C, D and E of F_y = D load sin(C atan(B a - E (B a - atan(B a)))); None for other tyres."""
        if self.B is None or self.C is None or self.E is None:
            return None
        rises = sin(min(self.C, 1.0) * pi / 2)  # for C < 1 the force stays below D
        return [self.B, self.C, self.peak / (self.load * rises), self.E]


@dataclass(frozen=True)
class SingleTrack:
    """A vehicle's single-track parameters.

    Attributes
    ----------
    m, I_z : inertial mass, kg, and yaw inertia, kg m^2.
    l_f, l_r : axles to centre of gravity, m.
    h_cg : height of the centre of gravity, m; None if the model has none.
    front, rear : the axles.
    """

    m: float
    I_z: float
    l_f: float
    l_r: float
    h_cg: float | None
    front: Axle
    rear: Axle

    @property
    def mu(self) -> float | None:
        """Largest lateral force of both axles over the weight; None for linear tyres."""
        both = self.front.peak + self.rear.peak
        return both / (self.m * G) if isfinite(both) else None


def single_track_of(subject: Subject) -> SingleTrack:
    """The parameters of a model with two axles and tyres. Raises `BadInput` for other models."""
    no_tyres = f"{subject.model.name} has no tyres; this target takes single_track and lateral only."
    model = must_be(MotionModel, subject.model, no_tyres)
    if "peak_f" not in model.quantities:
        raise BadInput(no_tyres)
    (peak_f, peak_r, stiffer_f, stiffer_r, m, I_z, l_f, l_r), (C_f, C_r) = _at_rest(model)
    load, height = m * G / (l_f + l_r), value_of(model, "h_cg")
    if height is not None and "longitudinal_load_transfer" in model.effects:
        height *= float(model["longitudinal_load_transfer"].array)
    front = _axle(model, "f", load * l_r, C_f, peak_f, stiffer_f)
    rear = _axle(model, "r", load * l_f, C_r, peak_r, stiffer_r)
    return SingleTrack(m, I_z, l_f, l_r, height, front, rear)


def _axle(model: MotionModel, suffix: str, load: float, C_alpha: float, peak: float, stiffer: float) -> Axle:
    B, C, E = (value_of(model, f"{letter}_{suffix}") for letter in "BCE")
    return Axle(load, C_alpha, peak, None if B is None else B * stiffer, C, E)


def value_of(model: Model, name: str) -> float | None:
    """A parameter's value; None if the model does not have it."""
    return float(model[name].array) if name in model else None


def _at_rest(model: MotionModel) -> tuple[list[float], list[float]]:
    """The quantities `_TOLD`, and the slopes of the axles' forces over their slip angles, N/rad."""

    def dynamics(x: Namespace, u: Namespace, p: Namespace, q: Quantities) -> Mapping[str, Symbol]:
        for name in _ALTERED:
            setattr(q, f"altered_{name}", getattr(p, name))
        return model.dynamics(x, u, p, q)

    altered = tuple(f"altered_{name}" for name in _ALTERED)
    telling = replace(model, dynamics=dynamics, quantities=(*model.quantities, *altered), relaxations=())
    trace = MotionTrace(telling)
    z, rest, p = cs.SX.sym("z", trace.size), np.zeros(trace.segment_size), model.values
    aside = [state.name for state in model.states].index("v_y")
    by_v_y = cs.jacobian(trace.named_values(_SLOPED)(z, rest, p), z[aside])
    at = np.zeros(trace.size)
    F_f, F_r, a_f, a_r = np.array(cs.Function("by_v_y", [z], [by_v_y])(at)).ravel()
    return np.array(trace.named_values(_TOLD)(at, rest, p)).ravel().tolist(), [float(F_f / a_f), float(F_r / a_r)]
