"""Linear tyre: lateral force in proportion to the slip angle.

    F_y = C_alpha alpha

C_alpha [N/rad] per axle. Without a limit of friction there is no peak for grip to scale; good to about 4 m/s^2 on a dry
road. Source: Rajamani, Vehicle Dynamics and Control, 2nd ed., Sec. 2.3.
"""

from __future__ import annotations

from math import inf

from ...model import Namespace, Symbol
from ...parameter import Parameter
from .tyre import Tyre, cornering_stiffness


def _parameters(suffix: str) -> tuple[Parameter, ...]:
    return (cornering_stiffness(suffix),)


def _force(alpha: Symbol, F_z: Symbol, p: Namespace, grip: Symbol, stiffness: Symbol) -> Symbol:
    del F_z, grip
    return p.C_alpha * stiffness * alpha


def _peak(F_z: Symbol, p: Namespace, grip: Symbol) -> Symbol:
    del F_z, p, grip
    return inf


def _slope(F_z: Symbol, p: Namespace) -> Symbol:
    del F_z
    return p.C_alpha


linear = Tyre("linear", _parameters, _force, _peak, _slope, "Rajamani, Vehicle Dynamics and Control, 2nd ed., Sec. 2.3")
