"""What every tyre model is: parameters per axle, and the lateral force they give."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace

import casadi as cs

from ...model import Namespace, Symbol
from ...parameter import Parameter

STEEPEST = 1.5
"""Slip angle, rad, beyond which its tangent no longer grows; every tyre slides there."""
LEAST_FORCE = 1e-6
"""Least friction force, N, that is divided by; a wheel may be off the ground."""


@dataclass(frozen=True)
class Tyre:
    """A tyre model for one axle.

    Attributes
    ----------
    name : the word it is called by.
    parameters : axle suffix ("f" or "r") -> its parameters, each named with that suffix: B_f.
    force : (alpha, F_z, p, grip, stiffness) -> F_y [N]; p are the axle's parameters without suffix, grip scales the
        friction and stiffness the slope at zero slip, the peak unchanged; both are 1 nominally.
    peak : (F_z, p, grip) -> the largest lateral force [N]; infinite where there is none.
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


def cornering_stiffness(suffix: str) -> Parameter:
    """C_alpha of an axle as a parameter."""
    where, value = {"f": ("front", 90e3), "r": ("rear", 100e3)}[suffix]
    return Parameter(f"C_alpha_{suffix}", "N/rad", value, (1.0, 5e6), about=f"cornering stiffness, {where} axle")


def friction(suffix: str) -> Parameter:
    """Friction coefficient of an axle as a parameter."""
    where = {"f": "front", "r": "rear"}[suffix]
    return Parameter(f"mu_{suffix}", "1", 1.0, (0.05, 3.0), about=f"friction coefficient, {where}")


def tan_of_slip(alpha: Symbol) -> Symbol:
    """Tangent of a slip angle, with its sign however far the vehicle has spun."""
    return cs.tan(cs.fmin(cs.fmax(alpha, -STEEPEST), STEEPEST))
