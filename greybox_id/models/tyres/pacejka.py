"""Pacejka's magic formula for pure lateral slip.

    F_y = F_z D sin(C atan(B a - E (B a - atan(B a)))),   a = alpha + S_h;   plus F_z S_v

B, C, D, E per axle; D is the friction coefficient; S_h [rad] and S_v [1] shift the curve and are held at zero unless
freed. Source: Pacejka, Tire and Vehicle Dynamics, 3rd ed., Sec. 4.3.1.
"""

from __future__ import annotations

import casadi as cs

from ...model import Namespace, Symbol
from ...parameter import Parameter
from .tyre import Tyre


def _parameters(suffix: str) -> tuple[Parameter, ...]:
    where = {"f": "front", "r": "rear"}[suffix]
    return (
        Parameter(f"B_{suffix}", "1/rad", 9.0, (0.5, 60.0), about=f"stiffness factor, {where}"),
        Parameter(f"C_{suffix}", "1", 1.4, (0.5, 2.5), about=f"shape factor, {where}"),
        Parameter(f"D_{suffix}", "1", 1.0, (0.05, 3.0), about=f"friction coefficient, {where}"),
        Parameter(f"E_{suffix}", "1", 0.0, (-5.0, 1.0), fixed=True, about=f"curvature factor, {where}"),
        Parameter(f"S_h_{suffix}", "rad", 0.0, (-0.1, 0.1), fixed=True, about=f"horizontal shift, {where}"),
        Parameter(f"S_v_{suffix}", "1", 0.0, (-0.1, 0.1), fixed=True, about=f"vertical shift, {where}"),
    )


def _force(alpha: Symbol, F_z: Symbol, p: Namespace, grip: Symbol, stiffness: Symbol) -> Symbol:
    slip = p.B * stiffness * (alpha + p.S_h)
    return F_z * (grip * p.D * cs.sin(p.C * cs.atan(slip - p.E * (slip - cs.atan(slip)))) + p.S_v)


def _peak(F_z: Symbol, p: Namespace, grip: Symbol) -> Symbol:
    return grip * p.D * F_z


def _slope(F_z: Symbol, p: Namespace) -> Symbol:
    return p.B * p.C * p.D * F_z


pacejka = Tyre("pacejka", _parameters, _force, _peak, _slope, "Pacejka, Tire and Vehicle Dynamics, 3rd ed., Sec. 4.3.1")
