"""Brush tyre with parabolic pressure (Fiala) for pure lateral slip.

    F_y = mu F_z (3 z - 3 z |z| + z^3),   z = C_alpha tan(alpha) / (3 mu F_z)

until at |z| = 1 the whole contact patch slides and F_y = mu F_z. The slope is continuous there. C_alpha [N/rad] and mu
per axle. Source: Pacejka, Tire and Vehicle Dynamics, 3rd ed., Sec. 3.2.1.
"""

from __future__ import annotations

import casadi as cs

from ...model import Namespace, Symbol
from ...parameter import Parameter
from .tyre import LEAST_FORCE, Tyre, cornering_stiffness, friction, tan_of_slip


def _parameters(suffix: str) -> tuple[Parameter, ...]:
    return (cornering_stiffness(suffix), friction(suffix))


def _force(alpha: Symbol, F_z: Symbol, p: Namespace, grip: Symbol, stiffness: Symbol) -> Symbol:
    most = _peak(F_z, p, grip)
    z = p.C_alpha * stiffness * tan_of_slip(alpha) / (3 * cs.fmax(most, LEAST_FORCE))
    z = cs.fmin(cs.fmax(z, -1), 1)
    return most * (3 * z - 3 * z * cs.fabs(z) + z**3)


def _peak(F_z: Symbol, p: Namespace, grip: Symbol) -> Symbol:
    return grip * p.mu * F_z


def _slope(F_z: Symbol, p: Namespace) -> Symbol:
    del F_z
    return p.C_alpha


brush = Tyre("brush", _parameters, _force, _peak, _slope, "Pacejka, Tire and Vehicle Dynamics, 3rd ed., Sec. 3.2.1")
