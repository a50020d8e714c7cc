"""Tyre models: lateral force of an axle over slip angle and load, selected by name.

Each is F_y(alpha, F_z) for pure lateral slip with parameters per axle; C_alpha is in N/rad, D and mu are friction
coefficients.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, pi
from types import SimpleNamespace

import casadi as cs

from ..base.errors import BadInput, near
from .model import Namespace, Symbol
from .parameter import Parameter

STEEPEST = 1.5
"""Slip angle, rad, at which its tangent is clipped; every tyre slides there."""
LEAST_FORCE = 1e-6
"""Least friction force, N, in a denominator; a lifted wheel has none."""
AXLES = {"f": "front", "r": "rear"}


@dataclass(frozen=True)
class Tyre:
    """A tyre model for one axle.

    Attributes
    ----------
    name : of the tyre model.
    parameters : axle suffix ("f" or "r") -> its parameters, each named with that suffix: B_f.
    force : (alpha, F_z, p, grip, stiffness) -> F_y [N]; p are the axle's parameters without suffix, grip scales the
        friction, stiffness the slope at zero slip with the peak unchanged; both are nominally 1.
    peak : (F_z, p, grip) -> largest lateral force [N]; infinite if there is none.
    slope : (F_z, p) -> cornering stiffness C_alpha at zero slip [N/rad].
    source : of the equations.
    """

    name: str
    parameters: Callable[[str], tuple[Parameter, ...]]
    force: Callable[[Symbol, Symbol, Namespace, Symbol, Symbol], Symbol]
    peak: Callable[[Symbol, Namespace, Symbol], Symbol]
    slope: Callable[[Symbol, Namespace], Symbol]
    source: str = ""


def axle(p: Namespace, suffix: str) -> Namespace:
    """The parameters of one axle without their suffix: p.B_f -> B."""
    ending = f"_{suffix}"
    return SimpleNamespace(**{n.removesuffix(ending): v for n, v in vars(p).items() if n.endswith(ending)})


def _tan_of_slip(alpha: Symbol) -> Symbol:
    """Tangent of a slip angle, clipped so that it keeps its sign for any angle."""
    return cs.tan(cs.fmin(cs.fmax(alpha, -STEEPEST), STEEPEST))


def _pacejka_parameters(suffix: str) -> tuple[Parameter, ...]:
    where = AXLES[suffix]
    return (
        Parameter(f"B_{suffix}", "1/rad", 9.0, (0.5, 60.0), about=f"stiffness factor, {where}"),
        Parameter(f"C_{suffix}", "1", 1.4, (0.5, 2.5), about=f"shape factor, {where}"),
        Parameter(f"D_{suffix}", "1", 1.0, (0.05, 3.0), about=f"friction coefficient, {where}"),
        Parameter(f"E_{suffix}", "1", 0.0, (-5.0, 1.0), fixed=True, about=f"curvature factor, {where}"),
        Parameter(f"S_h_{suffix}", "rad", 0.0, (-0.1, 0.1), fixed=True, about=f"horizontal shift, {where}"),
        Parameter(f"S_v_{suffix}", "1", 0.0, (-0.1, 0.1), fixed=True, about=f"vertical shift, {where}"),
    )


def _pacejka_force(alpha: Symbol, F_z: Symbol, p: Namespace, grip: Symbol, stiffness: Symbol) -> Symbol:
    """F_z D sin(C atan(B a - E (B a - atan(B a)))) + F_z S_v with a = alpha + S_h; the shifts are zero unless freed."""
    slip = p.B * stiffness * (alpha + p.S_h)
    return F_z * (grip * p.D * cs.sin(p.C * cs.atan(slip - p.E * (slip - cs.atan(slip)))) + p.S_v)


def _pacejka_peak(F_z: Symbol, p: Namespace, grip: Symbol) -> Symbol:
    """D F_z; for C < 1, where the curve has no maximum, its limit at large slip."""
    return grip * p.D * F_z * cs.sin(cs.fmin(p.C, 1) * (pi / 2))


pacejka = Tyre(
    name="pacejka",
    parameters=_pacejka_parameters,
    force=_pacejka_force,
    peak=_pacejka_peak,
    slope=lambda F_z, p: p.B * p.C * p.D * F_z,
    source="Pacejka, Tire and Vehicle Dynamics, 3rd ed., Sec. 4.3.1",
)
"""Pacejka's magic formula."""


def _stiffness(suffix: str) -> tuple[Parameter, ...]:
    value = {"f": 90e3, "r": 100e3}[suffix]
    about = f"cornering stiffness, {AXLES[suffix]} axle"
    return (Parameter(f"C_alpha_{suffix}", "N/rad", value, (1.0, 5e6), about=about),)


def _stiffness_and_friction(suffix: str) -> tuple[Parameter, ...]:
    about = f"friction coefficient, {AXLES[suffix]}"
    return (*_stiffness(suffix), Parameter(f"mu_{suffix}", "1", 1.0, (0.05, 3.0), about=about))


def _friction_force(F_z: Symbol, p: Namespace, grip: Symbol) -> Symbol:
    return grip * p.mu * F_z


linear = Tyre(
    name="linear",
    parameters=_stiffness,
    force=lambda alpha, F_z, p, grip, stiffness: p.C_alpha * stiffness * alpha,
    peak=lambda F_z, p, grip: inf,
    slope=lambda F_z, p: p.C_alpha,
    source="Rajamani, Vehicle Dynamics and Control, 2nd ed., Sec. 2.3",
)
"""F_y = C_alpha alpha. It has no friction limit that grip could scale; valid to about 4 m/s^2 on a dry road."""


def _dugoff_force(alpha: Symbol, F_z: Symbol, p: Namespace, grip: Symbol, stiffness: Symbol) -> Symbol:
    """C_alpha tan(alpha) f(lambda), lambda = mu F_z / (2 C_alpha |tan(alpha)|).

    f is (2 - lambda) lambda below one, else 1. Linear up to half the friction force, then approaching mu F_z
    asymptotically. The slope is continuous at lambda = 1.
    """
    unlimited = p.C_alpha * stiffness * _tan_of_slip(alpha)
    half = _friction_force(F_z, p, grip) / 2
    lambda_ = half / cs.fmax(cs.fabs(unlimited), cs.fmax(half, LEAST_FORCE))  # clipped at 1
    return unlimited * (2 - lambda_) * lambda_


dugoff = Tyre(
    name="dugoff",
    parameters=_stiffness_and_friction,
    force=_dugoff_force,
    peak=_friction_force,
    slope=lambda F_z, p: p.C_alpha,
    source="Dugoff, Fancher & Segel, SAE paper 700377 (1970); Rajamani, 2nd ed., Sec. 13.10",
)
"""Dugoff's tyre."""


def _brush_force(alpha: Symbol, F_z: Symbol, p: Namespace, grip: Symbol, stiffness: Symbol) -> Symbol:
    """mu F_z (3 z - 3 z |z| + z^3), z = C_alpha tan(alpha) / (3 mu F_z); for |z| >= 1 the whole contact patch slides.

    The slope is continuous at |z| = 1.
    """
    most = _friction_force(F_z, p, grip)
    z = p.C_alpha * stiffness * _tan_of_slip(alpha) / (3 * cs.fmax(most, LEAST_FORCE))
    z = cs.fmin(cs.fmax(z, -1), 1)
    return most * (3 * z - 3 * z * cs.fabs(z) + z**3)


brush = Tyre(
    name="brush",
    parameters=_stiffness_and_friction,
    force=_brush_force,
    peak=_friction_force,
    slope=lambda F_z, p: p.C_alpha,
    source="Pacejka, Tire and Vehicle Dynamics, 3rd ed., Sec. 3.2.1",
)
"""Brush tyre with parabolic pressure (Fiala)."""

TYRES: dict[str, Tyre] = {tyre.name: tyre for tyre in (pacejka, linear, dugoff, brush)}
"""Tyre models by name."""
FORMS = ("exact", "uncertain")
BODIES = ("stiff", "rolling")


@dataclass(frozen=True)
class TyreSettings:
    """Hyperparameters of models whose only choice is the tyre.

    Attributes
    ----------
    tyre : one of `TYRES`.
    form : "exact", or "uncertain": a fit also estimates the model error of the equations' form (`models.form`).
    body : "stiff", or "rolling": the roll rate is an additional output (`models.single_track`).
    """

    tyre: str = "pacejka"
    form: str = "exact"
    body: str = "stiff"

    def __post_init__(self) -> None:
        if self.tyre not in TYRES:
            raise BadInput(f"There is no tyre {self.tyre!r}; choose one of {', '.join(TYRES)}.{near(self.tyre, TYRES)}")
        if self.form not in FORMS:
            raise BadInput(f"The form is {' or '.join(FORMS)}, not {self.form!r}.{near(self.form, FORMS)}")
        if self.body not in BODIES:
            raise BadInput(f"The body is {' or '.join(BODIES)}, not {self.body!r}.{near(self.body, BODIES)}")
        if self.form == "uncertain" and self.tyre == "linear":
            raise BadInput("A linear tyre has no curve whose form could be uncertain; choose another tyre.")

    @property
    def model(self) -> Tyre:
        """The tyre model of that name."""
        return TYRES[self.tyre]
