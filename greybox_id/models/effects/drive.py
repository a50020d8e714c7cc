"""Effects between the drive command and the force at the wheels, and on the resistance to motion.

The chain is lag, then gain, then saturation of the driving force.
"""

from __future__ import annotations

from math import inf

import casadi as cs

from ..model import Symbol
from ..motion_model import Quantities
from ..parameter import Parameter
from ..smooth import within_limit
from .elements import lag
from .memory import scale_motor
from .stating import alteration, effect, speed

GROUP = "drive"


def _saturated(force: Symbol, q: Quantities) -> Symbol:
    """Driving force up to m a_sat min(1, v_b / v), with corners rounded by `within_limit`.

    The mass is the stated one: a payload does not change the motor's force.
    """
    fades = within_limit(cs.fabs(speed(q)) / q.p.motor_saturation_v_b)
    return force * within_limit(force / q.stated.m / q.p.motor_saturation / fades)


motor_lag = effect(
    GROUP, "motor_lag", "s", 0.0, (0.0, 1.0), "first-order time constant of drive and brake force",
    touches=("drive",), typical=0.1, gradual=False,
    apply=lambda model: model.actuated(lag("drive", "motor_lag_state", lambda p: p.motor_lag)),
)  # fmt: skip

motor_gain = alteration(
    GROUP, "motor_gain", "1", 1.0, (0.2, 5.0), "gain on the drive command",
    typical=0.9, apply_to_memory=scale_motor, in_memory="motor_current",
    drive=lambda drive, q: drive * q.p.motor_gain,
)  # fmt: skip

motor_saturation = alteration(
    GROUP, "motor_saturation", "m/s^2", inf, (0.1, inf), "largest acceleration that the drive gives at low speed",
    typical=2.0, gradual=False, drive_force=_saturated,
    others=(Parameter(
        "motor_saturation_v_b", "m/s", 10.0, (0.1, 1e3), fixed=True,
        about="speed above which the drive's largest force falls as 1/v; 1 000 m/s: at no speed",
    ),),
)  # fmt: skip

brake_bias = alteration(
    GROUP, "brake_bias", "1", 0.0, (-0.6, 0.6), "change of the front axle's share of the braking force",
    typical=0.1, brake_split_front=lambda share, q: share + q.p.brake_bias,
)  # fmt: skip

aero_drag = alteration(
    GROUP, "aero_drag", "N s^2/m^2", 0.0, (-5.0, 30.0), "change of the aerodynamic drag c_2",
    typical=0.2, c_2=lambda c_2, q: c_2 + q.p.aero_drag,
)  # fmt: skip

rolling_resistance = alteration(
    GROUP, "rolling_resistance", "N", 0.0, (-1e4, 1e4), "change of the rolling resistance c_0",
    typical=100.0, c_0=lambda c_0, q: c_0 + q.p.rolling_resistance,
)  # fmt: skip

ALL = (motor_lag, motor_gain, motor_saturation, brake_bias, aero_drag, rolling_resistance)
