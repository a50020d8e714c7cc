"""Model errors of the equations of a stated vehicle, each with one parameter and a prior.

A vehicle file states tolerances for a model that is simpler than the vehicle; these parameters are added to them. They
are not in the vocabulary of effects: that a car has four wheels is not a gap.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf
from typing import Any

import casadi as cs

from .effect import AnyModel, Effect
from .effects.stating import speed
from .effects.tyres import COMBINED_BALANCE, COMBINED_POWER, FRONT_SHARE
from .model import Symbol
from .motion_model import MotionModel, Quantities
from .parameter import Parameter, Prior
from .single_track import G
from .vehicle import Vehicle

GROUP = "roughness"
FORM_SD = 0.01
"""Prior sd of a force's relative error in one regime: residual of single-track fits to vehicles with four wheels."""
TRACK_SD = 0.5
"""Prior sd of the share of the steered wheels' moment that acts: none on a single track; all of it if the wheels of the
axle share its lateral force as they share its load."""
HARD = 3.0
"""Drive in units of the usual one at which an error that grows with its square equals one that grows linearly."""
POWER_SD, BALANCE_SD = 0.5, 0.3
"""Prior sd of the exponent of combined slip, between ellipses, 2, and Burckhardt's tyres, 1; and of the axles' balance
of the friction used: curves that end at .8 of their D, and loads that shift by .2."""
DRAG_SD = 0.1
"""Prior sd of the additional exponent of speed in resistance: air drag goes with v^1.8 to v^2 (rolling resistance with
v^0 to v^0.2)."""


def with_roughness(model: AnyModel, vehicle: Vehicle, usual: Mapping[str, float]) -> AnyModel:
    """The model with its model errors, for those parameters that are stated with tolerances which the errors would
    affect.

    Parameters
    ----------
    model : with the vehicle's tolerances.
    vehicle : what is stated.
    usual : of a recording: "speed" at which resistance has its stated value, m/s, and root mean squares of "steer",
        rad, and "drive", in its own unit.
    """
    stated = {name for name, value in vehicle.values.items() if value.sd is not None}
    for rough, by in ((steered_wheels(), {"B_f", "C_f"}), (_bent("c_0", usual["speed"]), {"c_0"}),
                      (_bent("c_2", usual["speed"]), {"c_2"})):  # fmt: skip
        if by <= stated and rough.name not in model and rough.concerns(model):
            model = model + rough
    for rough in (*combined_slip(), *_regimes(usual)) if stated else ():
        if rough.concerns(model):
            model = model + rough
    return model


def _regimes(usual: Mapping[str, float]) -> list[Effect]:
    """Relative errors of a force in proportion to steering, lateral acceleration, speed, drive or braking."""
    sizes: dict[str, tuple[Callable[[Quantities], Symbol], tuple[str, ...]]] = {
        "steer": (lambda q: cs.fabs(q.u.steer) / q.p.usual_steer, ("steer",)),
        "turning": (lambda q: cs.fabs(speed(q) * q.x.yaw_rate) / G, ("v_x", "yaw_rate")),
        "speed": (lambda q: cs.fabs(speed(q)) / q.p.usual_speed - 1, ("v_x",)),
        "drive": (lambda q: q.u.drive / q.p.usual_drive, ("drive",)),
        "braking": (lambda q: cs.fmax(-q.u.drive / q.p.usual_drive, 0), ("drive",)),
        "hard_braking": (lambda q: cs.fmin(q.u.drive / q.p.usual_drive, 0) ** 2 / HARD, ("drive",)),
    }
    over = {"steer": ("steer", "rad"), "speed": ("speed", "m/s"),
            **dict.fromkeys(("drive", "braking", "hard_braking"), ("drive", "1"))}  # fmt: skip
    result = []
    for force in ("F_yf", "F_yr", "F_drag"):
        for regime, (size, needs) in sizes.items():
            if force == "F_drag" and "drive" in needs:
                continue
            name = f"form_{force}_{regime}"

            def shaped(value: Symbol, q: Quantities, name: str = name, size: Any = size) -> Symbol:
                return value * (1 + getattr(q.p, name) * size(q))

            one = Parameter(
                name,
                "1",
                0.0,
                (-0.5, 0.5),
                prior=Prior(FORM_SD),
                about=f"relative error of {force}, in proportion to {regime}",
            )
            others = tuple(
                Parameter(f"usual_{base}", unit, usual[base], (0.0, inf), fixed=True, about=f"usual {base}")
                for base, unit in ([over[regime]] if regime in over else [])
            )
            apply = _altering({force: shaped})
            result.append(Effect(name, one, (force,), apply, group=GROUP, needs=needs, others=others))
    return result


def _altering(changes: Mapping[str, Callable[[Symbol, Quantities], Symbol]]) -> Callable[[MotionModel], MotionModel]:
    return lambda model: model.altered(**changes)


def steered_wheels() -> Effect:
    """The steered outer front wheel carries more load, drags on its side and turns the car back.

    Wheels at -/+ track / 2 with lateral forces F_yf / 2 (1 +/- 2 transfer / F_zf), rotated by the steering angle: their
    longitudinal components differ, and M_z = -track sin(steer) F_yf transfer / F_zf, in which the transfer
    s m a_y h_cg / track cancels the track (s: the front axle's share). Rajamani, Vehicle Dynamics and Control, 2nd ed.,
    Sec. 8.2: in the yaw moment, the difference of the front wheels' longitudinal components.
    """

    def turned_back(M_z: Symbol, q: Quantities) -> Symbol:
        across = q.F_yf + q.F_yr
        return M_z - q.p.steered_wheels * cs.sin(q.u.steer) * FRONT_SHARE * q.p.h_cg * across * q.F_yf / q.F_zf

    parameter = Parameter(
        "steered_wheels",
        "1",
        0.0,
        (0.0, 2.0),
        prior=Prior(TRACK_SD),
        about="share of the yaw moment of the loaded, steered outer front wheel that acts",
    )
    return Effect(
        parameter.name, parameter, ("M_z",), lambda model: model.altered(M_z=turned_back), group=GROUP,
        needs=("steer", "F_yf", "F_yr", "F_zf", "h_cg"),
    )  # fmt: skip


def combined_slip() -> list[Effect]:
    """Exponent and balance of combined slip, read by the effect combined_slip."""
    power = Parameter(
        COMBINED_POWER, "1", 0.0, (-0.5, 1.0), prior=Prior(POWER_SD), about="two minus the exponent of combined slip"
    )
    balance = Parameter(
        COMBINED_BALANCE,
        "1",
        0.0,
        (-0.8, 0.8),
        prior=Prior(BALANCE_SD),
        about="balance of combined slip: more of it at the front axle if positive",
    )
    needs = ("F_xf", "F_xr", "peak_f", "peak_r")
    return [
        Effect(one.name, one, ("F_yf", "F_yr"), lambda model: model, group=GROUP, needs=needs)
        for one in (power, balance)
    ]


def _bent(coefficient: str, usual_speed: float) -> Effect:
    """Resistance with a slightly different exponent of speed, linearised about the usual speed."""
    name = f"power_of_{coefficient}"

    def bent(value: Symbol, q: Quantities) -> Symbol:
        return value * (1 + getattr(q.p, name) * (cs.fabs(speed(q)) / q.p.usual_speed - 1))

    entry = Parameter(
        name,
        "1",
        0.0,
        (-0.5, 0.5),
        prior=Prior(DRAG_SD),
        about=f"exponent of the speed, in addition to the exponent that {coefficient} has",
    )
    usual = Parameter(
        "usual_speed", "m/s", usual_speed, (0.0, inf), fixed=True, about="speed at which resistance is as stated"
    )
    return Effect(
        name, entry, (coefficient,), lambda model: model.altered(**{coefficient: bent}), group=GROUP, needs=("v_x",),
        others=(usual,),  # as a constant it would force a compilation for every recording
    )  # fmt: skip
