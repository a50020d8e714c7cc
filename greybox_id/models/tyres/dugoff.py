"""Dugoff's tyre for pure lateral slip.

    F_y = C_alpha tan(alpha) f(lambda),   lambda = mu F_z / (2 C_alpha |tan(alpha)|)
    f(lambda) = (2 - lambda) lambda where lambda < 1, else 1

Linear up to half the friction force, then bending towards mu F_z, which it comes near and never reaches. The slope is
continuous at lambda = 1. C_alpha [N/rad] and mu per axle.
Source: Dugoff, Fancher & Segel, SAE paper 700377 (1970); Rajamani, Vehicle Dynamics and Control, 2nd ed., Sec. 13.10.
"""

from __future__ import annotations

import casadi as cs

from ...model import Namespace, Symbol
from ...parameter import Parameter
from .tyre import LEAST_FORCE, Tyre, cornering_stiffness, friction, tan_of_slip


def _parameters(suffix: str) -> tuple[Parameter, ...]:
    return (cornering_stiffness(suffix), friction(suffix))


def _force(alpha: Symbol, F_z: Symbol, p: Namespace, grip: Symbol, stiffness: Symbol) -> Symbol:
    unlimited = p.C_alpha * stiffness * tan_of_slip(alpha)
    half = _peak(F_z, p, grip) / 2
    lambda_ = half / cs.fmax(cs.fabs(unlimited), cs.fmax(half, LEAST_FORCE))  # 1 where it is more than 1
    return unlimited * (2 - lambda_) * lambda_


def _peak(F_z: Symbol, p: Namespace, grip: Symbol) -> Symbol:
    return grip * p.mu * F_z


def _slope(F_z: Symbol, p: Namespace) -> Symbol:
    del F_z
    return p.C_alpha


dugoff = Tyre(
    "dugoff", _parameters, _force, _peak, _slope,
    "Dugoff, Fancher & Segel, SAE paper 700377 (1970); Rajamani, 2nd ed., Sec. 13.10",
)  # fmt: skip
