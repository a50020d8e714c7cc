"""The truck's models, from the published bicycle to one with a map of the road's bank, and what they are believed to be.

ISO 8855 signs. All stand on the house's lateral model with Pacejka's formula at C = 1, E = 0, where B and D say all that
these recordings tell of a curve. Effects that the house has are taken from there; the others are below.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import pi

import casadi as cs
import numpy as np

from greybox_id.effect import Effect
from greybox_id.model import Combination, Namespace, Symbol
from greybox_id.models.effects import EFFECTS
from greybox_id.models.effects.elements import lag
from greybox_id.models.effects.stating import alteration, effect, reading
from greybox_id.models.lateral import lateral
from greybox_id.models.single_track import G
from greybox_id.motion_model import MotionModel, Quantities, State
from greybox_id.parameter import Array, Parameter, Prior
from greybox_id.recording import Recording

MASS = 18781.0
"""Weighed, kg (the publication, Sec. IV-D)."""

BELIEVED = {
    "l_f": (3.5, 0.5, 1.0, 5.0),
    "l_r": (1.3, 0.3, 0.5, 4.0),
    "I_z": (7e4, 2e4, 3e4, 3e5),
    "B_f": (13.0, 4.0, 2.0, 60.0),
    "D_f": (0.6, 0.2, 0.1, 3.0),
    "B_r": (16.0, 5.0, 2.0, 60.0),
    "D_r": (0.5, 0.15, 0.1, 3.0),
    "velocity_lever_arm": (4.6, 0.5, -2.0, 8.0),
    "yaw_rate_bias": (0.0, 0.002, -0.05, 0.05),
    "v_y_bias": (-0.02, 0.02, -0.3, 0.3),
    "v_y_lead": (0.0, 0.02, -0.3, 0.3),
    "steering_lag": (0.03, 0.03, 0.0, 0.5),
    "tyre_relaxation": (0.6, 0.3, 0.0, 4.0),
    "stiffness_transfer": (0.05, 0.02, -0.3, 0.3),
    "lasting_v_y": (0.1, 0.2, -1.5, 1.5),
    "roll_frequency": (0.6, 0.2, 0.2, 2.5),
    "roll_damping": (0.5, 0.2, 0.05, 1.5),
    "roll_steer": (0.0, 0.005, -0.1, 0.1),
    "roll_arm": (0.0, 0.002, -0.1, 0.1),
    "alpha2_share": (0.3, 0.1, -1.0, 2.0),
    "alpha2_lag": (0.05, 0.03, 0.0, 0.5),
    "at_rest_share": (0.8, 0.1, -1.0, 3.0),
    "at_rest_offset": (0.0015, 0.0005, -0.01, 0.01),
    "bank": (0.0, 0.015, -0.3, 0.3),
}
"""Start and mean of the belief, its standard deviation, and limits, in the parameters' SI units."""

BUMPS, WIDTH = 40, 35.0
"""Radial functions of the bank's map, and their standard deviation, m."""


def reading_of_both(name: str, unit: str, about: str) -> Parameter:
    return Parameter(name, unit, 0.0, about=about)


v_y_bias = reading(
    "truck", "v_y_bias", "m/s", 0.0, (-1.0, 1.0), "added to the lateral velocity",
    typical=0.02, v_y=lambda read, q: read.v_y + q.p.v_y_bias,
)  # fmt: skip

v_y_lead = reading(
    "truck", "v_y_lead", "s", 0.0, (-1.0, 1.0), "how early v_y is read beside yaw rate and steering, to first order",
    typical=0.05, needs=("velocity_lever_arm",),
    v_y=lambda read, q: read.v_y + q.p.v_y_lead * (q.rates.v_y + q.p.velocity_lever_arm * q.rates.yaw_rate),
)  # fmt: skip


def _with_inputs(model: MotionModel, *inputs: str) -> MotionModel:
    new = tuple(name for name in inputs if name not in model.inputs)
    return replace(model, inputs=(*model.inputs, *new))


def _stiffness_transfer(model: MotionModel) -> MotionModel:
    return _with_inputs(model, "v_x_rate").altered(
        stiffness_f=lambda s, q: s * (1 - q.p.stiffness_transfer * q.u.v_x_rate),
        stiffness_r=lambda s, q: s * (1 + q.p.stiffness_transfer * q.u.v_x_rate),
    )


stiffness_transfer = effect(
    "truck", "stiffness_transfer", "s^2/m", 0.0, (-1.0, 1.0), "cornering stiffness that moves to the rear with dv_x/dt",
    touches=("stiffness_f", "stiffness_r"), apply=_stiffness_transfer, typical=0.05,
)  # fmt: skip


def _beyond_steady(x: Namespace, u: Namespace, p: Namespace) -> Symbol:
    """Share of the lateral velocity at the start that steady cornering does not explain."""
    L = p.l_f + p.l_r
    C_r = p.B_r * p.C_r * p.D_r * p.m * G * p.l_f / L
    return p.lasting_v_y * (x.v_y - x.yaw_rate * (p.l_r - p.l_f * p.m * u.v_x**2 / (L * C_r)))


def _lasting_v_y(model: MotionModel) -> MotionModel:
    lasting = State("lasting_v_y_state", "m/s", 0.1, start=_beyond_steady)
    return model.with_states(lambda q: {"lasting_v_y_state": 0.0}, lasting).sensed(
        lambda read, q: {"v_y": read.v_y + q.x.lasting_v_y_state}
    )


lasting_v_y = effect(
    "truck", "lasting_v_y", "1", 0.0, (-3.0, 3.0),
    "v_y read at the start beyond that of steady cornering: of so much of it the sensor is to blame, and it stays",
    touches=("v_y",), needs=("B_r", "D_r"), apply=_lasting_v_y, typical=0.2,
)  # fmt: skip


def _roll_rate_of_change(a_y: Symbol, q: Quantities) -> Symbol:
    w = 2 * pi * q.p.roll_frequency
    return w**2 * (a_y - q.x.roll_state) - 2 * q.p.roll_damping * w * q.x.roll_rate_state


def _tyres_alone(q: Quantities) -> Symbol:
    return (q.F_yf + q.F_yr) / q.p.m


def _rolling(model: MotionModel) -> MotionModel:
    states = (
        State("roll_state", "m/s^2", 1.0, start=lambda x, u, p: x.yaw_rate * u.v_x),
        State("roll_rate_state", "m/s^3", 1.0),
    )

    def rates(q: Quantities) -> Mapping[str, Symbol]:
        return {"roll_state": q.x.roll_rate_state, "roll_rate_state": _roll_rate_of_change(_tyres_alone(q), q)}

    return model.with_states(rates, *states).altered(
        alpha_f=lambda alpha, q: alpha + q.p.roll_steer * q.x.roll_state,
        a_y=lambda a_y, q: a_y + q.p.roll_arm * _roll_rate_of_change(_tyres_alone(q), q),
    )


roll = effect(
    "truck", "roll_steer", "rad s^2/m", 0.0, (-0.1, 0.1), "front slip angle per roll, roll as the a_y that it has followed",
    touches=("alpha_f",), apply=_rolling, typical=0.01,
    others=(
        Parameter("roll_arm", "s^2", 0.0, (-0.1, 0.1), about="lateral acceleration that the second derivative of roll adds"),
        Parameter("roll_frequency", "Hz", 0.6, (0.1, 5.0), about="natural frequency of roll"),
        Parameter("roll_damping", "1", 0.5, (0.02, 2.0), about="damping ratio of roll"),
    ),
)  # fmt: skip


def _second_angle(model: MotionModel) -> MotionModel:
    with_it = _with_inputs(model, "alpha2", "dead_zone", "alpha2_at_rest")

    def blended(steer: Symbol, q: Quantities) -> Symbol:
        first = steer + q.p.at_rest_share * q.u.alpha2_at_rest + q.p.at_rest_offset * q.u.dead_zone
        return (1 - q.p.alpha2_share) * first + q.p.alpha2_share * q.u.alpha2

    return with_it.actuated(lag("alpha2", "alpha2_lag_state", lambda p: p.alpha2_lag)).altered(steer=blended)


second_angle = effect(
    "truck", "alpha2_share", "1", 0.0, (-1.0, 2.0), "how much of the road-wheel angle alpha2 tells",
    touches=("steer",), apply=_second_angle, typical=0.3,
    others=(
        Parameter("alpha2_lag", "s", 0.0, (0.0, 0.5), about="time constant between alpha2 and the road wheels"),
        Parameter("at_rest_share", "1", 0.0, (-1.0, 3.0), about="of alpha2, what stands for alpha1 in its dead zone"),
        Parameter("at_rest_offset", "rad", 0.0, (-0.01, 0.01), about="road-wheel angle in alpha1's dead zone besides"),
    ),
)  # fmt: skip


def bank_map(centres: Array) -> Effect:
    """Bank of the road as a map over position: a sum of bumps, right side up for who drives along the straights' direction."""

    def apply(model: MotionModel) -> MotionModel:
        def tilted(gravity_y: Symbol, q: Quantities) -> Symbol:
            bumps = (
                weight * cs.exp(-((q.u.x - x) ** 2 + (q.u.y - y) ** 2) / (2 * WIDTH**2))
                for weight, (x, y) in zip(q.p.bank, centres.tolist(), strict=True)
            )
            return gravity_y + G * q.u.along_road * sum(bumps)

        return _with_inputs(model, "x", "y", "along_road").altered(gravity_y=tilted)

    values = np.zeros(len(centres))
    return Effect("bank", Parameter("bank", "rad", values, about="bank of the road"), ("gravity_y",), apply, group="truck")


def bumps_over(recording: Recording) -> Array:
    """(BUMPS, 2) places of the recording, m, each the farthest from all before it."""
    places = np.column_stack([recording["x"], recording["y"]])
    chosen = [places[np.argmin(np.sum(places**2, axis=1))]]
    away = np.full(len(places), np.inf)
    while len(chosen) < BUMPS:
        away = np.minimum(away, np.sum((places - chosen[-1]) ** 2, axis=1))
        chosen.append(places[np.argmax(away)])
    return np.array(chosen)


BICYCLE = ("l_f", "l_r", "I_z", "B_f", "D_f", "B_r", "D_r")
SENSORS = (EFFECTS["velocity_lever_arm"],)
FIRST = (
    EFFECTS["velocity_lever_arm"], v_y_lead, EFFECTS["yaw_rate_bias"], v_y_bias, EFFECTS["steering_lag"], stiffness_transfer, lasting_v_y, roll,
)  # fmt: skip


def truck(*effects: Effect, shape: Mapping[str, float] | None = None) -> MotionModel:
    """The lateral model of the truck with effects, free with what is believed of them; all else is held."""
    model = replace(lateral(), outputs=("v_y", "yaw_rate"))
    for each in effects:
        model = model + each
    held = {"m": MASS, "C_f": 1.0, "C_r": 1.0, "E_f": 0.0, "E_r": 0.0, **(shape or {})}
    free = {parameter.name for one in effects for parameter in (one.parameter, *one.others)} | set(BICYCLE)
    changed = [_held(model[name], value) for name, value in held.items()]
    changed += [_believed(parameter) for parameter in model.parameters if parameter.name in free]
    combinations = model.combinations
    if "velocity_lever_arm" in model:
        reach = Combination("l_r + x_s", "m", lambda p: p.l_r + p.velocity_lever_arm, "rear axle to the sensor of v_y")
        combinations = (*combinations, reach)
    rest = [replace(p, fixed=True) for p in model.parameters if p.name not in free | held.keys()]
    return replace(model.with_parameters(*changed, *rest), combinations=combinations)


def _held(parameter: Parameter, value: float) -> Parameter:
    return replace(parameter, value=value, fixed=True, prior=None)


def _believed(parameter: Parameter) -> Parameter:
    mean, sd, low, high = BELIEVED[parameter.name]
    value = np.full(parameter.shape, mean)
    return replace(parameter, value=value, bounds=(low, high), prior=Prior(sd, mean=value), fixed=False)
