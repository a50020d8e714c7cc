"""The truck's models, from the published bicycle to one with a map of the road's bank, and what is believed of them.

ISO 8855 signs. All stand on the house's lateral model with Pacejka's formula; but for the published bicycle, C = 1 and
E = 0 are held: B and D say all that these recordings tell of a tyre's curve. Effects that the house has are taken from
there; what only a benchmark wants is below.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import pi

import casadi as cs
import numpy as np

from greybox_id.base.shorthands import Array
from greybox_id.datasets.recording import Recording
from greybox_id.models.effect import Effect
from greybox_id.models.effects import EFFECTS
from greybox_id.models.effects.elements import lag
from greybox_id.models.effects.stating import effect, reading
from greybox_id.models.model import Combination, Namespace, Symbol
from greybox_id.models.motion_model import MotionModel, Quantities, State
from greybox_id.models.parameter import Parameter, Prior
from greybox_id.models.single_track import G, lateral

from .truck_inputs import HELD_FOR

GROUP = "truck"

HELD = {"m": 18781.0, "C_f": 1.0, "C_r": 1.0, "E_f": 0.0, "E_r": 0.0}
"""Weighed [kg], and the curve's shape."""

Belief = Mapping[str, tuple[float, float, float, float]]
"""Start and mean of the belief, its standard deviation, and limits, in the parameter's unit."""

BICYCLE: Belief = {
    "l_f": (3.5, 0.5, 1.0, 6.0),
    "l_r": (1.3, 0.3, 0.5, 6.0),
    "I_z": (7e4, 2e4, 1e4, 5e5),
    "B_f": (13.0, 4.0, 1.0, 60.0),
    "D_f": (0.6, 0.2, 0.1, 3.0),
    "B_r": (16.0, 5.0, 1.0, 60.0),
    "D_r": (0.5, 0.15, 0.1, 3.0),
}
"""Rough, from trials on the training trajectories."""

PUBLISHED: Belief = {
    "l_f": (5.0, 1.0, 0.5, 8.0),
    "l_r": (5.0, 1.0, 0.5, 8.0),
    "I_z": (1.5e5, 5e4, 1e4, 5e5),
    **{f"B_{axle}": (7.1, 2.0, 1.0, 60.0) for axle in "fr"},
    **{f"C_{axle}": (1.3, 0.3, 0.5, 2.5) for axle in "fr"},
    **{f"D_{axle}": (0.8, 0.3, 0.1, 3.0) for axle in "fr"},
    **{f"E_{axle}": (-0.5, 1.0, -5.0, 1.0) for axle in "fr"},
}
"""The publication's Table I; C, D and E are of a tyre force in other units there and are what such tyres have."""

OF_EFFECTS: Belief = {
    "velocity_lever_arm": (4.6, 0.5, -2.0, 8.0),
    "v_y_lead": (0.0, 0.02, -0.3, 0.3),
    "v_y_bias": (-0.02, 0.02, -0.3, 0.3),
    "yaw_rate_bias": (0.0, 0.002, -0.05, 0.05),
    "lasting_v_y": (0.1, 0.2, -1.5, 1.5),
    "tyre_relaxation": (0.6, 0.3, 0.0, 4.0),
    "stiffness_transfer": (0.05, 0.02, -0.3, 0.3),
    "roll_steer": (0.0, 0.005, -0.1, 0.1),
    "roll_arm": (0.0, 0.002, -0.1, 0.1),
    "roll_frequency": (0.6, 0.2, 0.2, 2.5),
    "roll_damping": (0.5, 0.2, 0.05, 1.5),
    "steering_offset": (0.0, 0.002, -0.05, 0.05),
    "alpha2_share": (0.3, 0.1, -1.0, 2.0),
    "alpha2_lag": (0.05, 0.03, 0.0, 0.5),
    "rest_share": (0.8, 0.1, -1.0, 3.0),
    "rest_offset": (0.0015, 0.0005, -0.01, 0.01),
    **{f"share_{name}": (0.0, 0.3, -3.0, 3.0) for name in (*HELD_FOR, "sliding")},
    "share_turning": (0.0, 0.05, -1.0, 1.0),
    "bank": (0.0, 0.015, -0.3, 0.3),
}
"""Rough, from trials on the training trajectories."""

BUMPS, WIDTH = 40, 35.0
"""Bumps of the bank's map, and their standard deviation, m."""


def truck(*effects: Effect, believed: Belief = BICYCLE) -> MotionModel:
    """The lateral model of the truck with effects; what is believed of is free, all else is held."""
    model = replace(lateral(), outputs=("v_y", "yaw_rate"))
    for item in effects:
        model = model + item
    beliefs = {**OF_EFFECTS, **believed}
    model = model.with_parameters(*(_stated(parameter, beliefs) for parameter in model.parameters))
    if "velocity_lever_arm" not in model:
        return model
    reach = Combination("l_r + x_s", "m", lambda p: p.l_r + p.velocity_lever_arm, "rear axle to the sensor of v_y")
    return replace(model, combinations=(*model.combinations, reach))


def _stated(parameter: Parameter, beliefs: Belief) -> Parameter:
    if parameter.name not in beliefs:
        return replace(parameter, value=HELD.get(parameter.name, parameter.value), fixed=True)
    mean, sd, low, high = beliefs[parameter.name]
    value = np.full(parameter.shape, mean)
    return replace(parameter, value=value, bounds=(low, high), prior=Prior(sd, mean=value), fixed=False)


def _reading(model: MotionModel, *inputs: str) -> MotionModel:
    """The model with further inputs."""
    return replace(model, inputs=tuple(dict.fromkeys((*model.inputs, *inputs))))


v_y_bias = reading(
    GROUP, "v_y_bias", "m/s", 0.0, (-1.0, 1.0), "added to the lateral velocity",
    typical=0.02, v_y=lambda read, q: read.v_y + q.p.v_y_bias,
)  # fmt: skip

v_y_lead = reading(
    GROUP, "v_y_lead", "s", 0.0, (-1.0, 1.0), "time by which v_y leads yaw rate and steering, as a first-order "
                                              "approximation",
    typical=0.05, needs=("velocity_lever_arm",),
    v_y=lambda read, q: read.v_y + q.p.v_y_lead * (q.rates.v_y + q.p.velocity_lever_arm * q.rates.yaw_rate),
)  # fmt: skip


def _beyond_steady(x: Namespace, u: Namespace, p: Namespace) -> Symbol:
    """A share of the lateral velocity that steady cornering at this yaw rate does not explain, m/s."""
    C_alpha_r = p.B_r * p.C_r * p.D_r * p.m * G * p.l_f / (p.l_f + p.l_r)
    steady = x.yaw_rate * (p.l_r - p.l_f * p.m * u.v_x**2 / ((p.l_f + p.l_r) * C_alpha_r))
    return p.lasting_v_y * (x.v_y - steady)


def _lasting(model: MotionModel) -> MotionModel:
    state = State("lasting_v_y_state", "m/s", 0.1, start=_beyond_steady)
    with_it = model.with_states(lambda q: {"lasting_v_y_state": 0.0}, state)
    return with_it.sensed(lambda read, q: {"v_y": read.v_y + q.x.lasting_v_y_state})


lasting_v_y = effect(
    GROUP, "lasting_v_y", "1", 0.0, (-3.0, 3.0),
    "share of the initial difference between v_y and its steady value that remains in its readings",
    touches=("v_y",), needs=("yaw_rate", "B_r"), apply=_lasting, typical=0.2,
)  # fmt: skip


def _transferring(model: MotionModel) -> MotionModel:
    return _reading(model, "v_x_rate").altered(
        stiffness_f=lambda stiffness, q: stiffness * (1 - q.p.stiffness_transfer * q.u.v_x_rate),
        stiffness_r=lambda stiffness, q: stiffness * (1 + q.p.stiffness_transfer * q.u.v_x_rate),
    )


stiffness_transfer = effect(
    GROUP, "stiffness_transfer", "s^2/m", 0.0, (-1.0, 1.0), "share of the cornering stiffness that moves from the "
                                                            "front to the rear axle, per unit of dv_x/dt",
    touches=("stiffness_f", "stiffness_r"), apply=_transferring, typical=0.05,
)  # fmt: skip


def _back(q: Quantities) -> Symbol:
    """Second derivative of the lateral acceleration that roll has followed."""
    w = 2 * pi * q.p.roll_frequency
    return w**2 * ((q.F_yf + q.F_yr) / q.p.m - q.x.roll_state) - 2 * q.p.roll_damping * w * q.x.roll_rate_state


def _rolling(model: MotionModel) -> MotionModel:
    followed = State("roll_state", "m/s^2", 1.0, start=lambda x, u, p: x.yaw_rate * u.v_x)
    with_it = model.with_states(
        lambda q: {"roll_state": q.x.roll_rate_state, "roll_rate_state": _back(q)},
        followed, State("roll_rate_state", "m/s^3", 1.0),
    )  # fmt: skip
    return with_it.altered(
        alpha_f=lambda alpha, q: alpha + q.p.roll_steer * q.x.roll_state,
        a_y=lambda a_y, q: a_y + q.p.roll_arm * _back(q),
    )


roll = effect(
    GROUP, "roll_steer", "rad s^2/m", 0.0, (-0.1, 0.1), "front slip angle per unit of filtered a_y, which represents "
    "the roll",
    touches=("alpha_f",), needs=("F_yf", "F_yr"), apply=_rolling, typical=0.01,
    others=(
        Parameter("roll_arm", "s^2", 0.0, (-0.1, 0.1), about="lateral acceleration per second derivative of roll"),
        Parameter("roll_frequency", "Hz", 0.6, (0.1, 5.0), about="natural frequency of roll"),
        Parameter("roll_damping", "1", 0.5, (0.02, 2.0), about="damping ratio of roll"),
    ),
)  # fmt: skip


def _blended(model: MotionModel) -> MotionModel:
    def steer(alpha1: Symbol, q: Quantities) -> Symbol:
        filled = alpha1 + q.p.rest_share * q.u.alpha2_at_rest + q.p.rest_offset * q.u.at_rest
        return (1 - q.p.alpha2_share) * filled + q.p.alpha2_share * q.u.alpha2

    with_it = _reading(model, "alpha2", "alpha2_at_rest", "at_rest")
    return with_it.actuated(lag("alpha2", "alpha2_lag_state", lambda p: p.alpha2_lag)).altered(steer=steer)


second_angle = effect(
    GROUP, "alpha2_share", "1", 0.0, (-1.0, 2.0), "share of alpha2 in the road-wheel angle",
    touches=("steer",), apply=_blended, typical=0.3,
    others=(
        Parameter("alpha2_lag", "s", 0.0, (0.0, 0.5), about="time constant between alpha2 and the road wheels"),
        Parameter("rest_share", "1", 0.0, (-1.0, 3.0), about=(
            "share of alpha2 that replaces alpha1 while alpha1 is constant"
        )),
        Parameter("rest_offset", "rad", 0.0, (-0.01, 0.01), about="offset of alpha1 while it is constant"),
    ),
)  # fmt: skip


SHARES = {f"share_{name}": name for name in (*HELD_FOR, "sliding", "turning")}
"""Parameter -> what it is a share of."""


def _held(model: MotionModel) -> MotionModel:
    def steer(alpha1: Symbol, q: Quantities) -> Symbol:
        return alpha1 + sum(getattr(q.p, share) * getattr(q.u, name) for share, name in SHARES.items())

    return _reading(model, *SHARES.values()).altered(steer=steer)


def with_held_angle(recording: Recording, model: MotionModel) -> Recording:
    """A recording whose angle is what a model with `held_angle` makes of it."""
    held = sum(float(model[share].array) * recording[name] for share, name in SHARES.items())
    return recording.with_signals(steer=recording["steer"] + held)


held_angle = effect(
    GROUP, "share_held", "1", 0.0, (-3.0, 3.0), (
        "share of the last change of alpha1 that persists for 1 s while alpha1 is constant"
    ),
    touches=("steer",), apply=_held, typical=0.3,
    others=(
        Parameter("share_held_short", "1", 0.0, (-3.0, 3.0), about="share of the last change of alpha1 that persists "
                                                                   "for 0.2 s while alpha1 is constant"),
        Parameter("share_held_long", "1", 0.0, (-3.0, 3.0), about="share of the last change of alpha1 that persists "
                                                                  "for 5 s while alpha1 is constant"),
        Parameter("share_sliding", "1", 0.0, (-3.0, 3.0), about=(
            "share by which alpha1 continues at its last slope while it is constant"
        )),
        Parameter("share_turning", "s", 0.0, (-1.0, 1.0), about="effect of the slope of alpha1 while it is not "
        "constant"),
    ),
)  # fmt: skip


def bank_map(centres: Array) -> Effect:
    """Bank of the road over position: bumps about (n, 2) centres, left side up for who drives along the straights."""

    def banked(gravity_y: Symbol, q: Quantities) -> Symbol:
        bumps = (
            height * cs.exp(-((q.u.x - x) ** 2 + (q.u.y - y) ** 2) / (2 * WIDTH**2))
            for height, (x, y) in zip(q.p.bank, centres.tolist(), strict=True)
        )
        return gravity_y + G * q.u.along_road * sum(bumps)

    def apply(model: MotionModel) -> MotionModel:
        return _reading(model, "x", "y", "along_road").altered(gravity_y=banked)

    heights = Parameter(
        "bank", "rad", np.zeros(len(centres)), about="bank angles of the road at the centres of the map"
    )
    return Effect("bank", heights, ("gravity_y",), apply, typical=0.01, group=GROUP)


def spread_over(recording: Recording) -> Array:
    """(BUMPS, 2) places on the recorded road, m, each the farthest from those before it."""
    places = np.column_stack([recording["x"], recording["y"]])
    chosen, away = places[:1], np.full(len(places), np.inf)
    while len(chosen) < BUMPS:
        away = np.minimum(away, np.sum((places - chosen[-1]) ** 2, axis=1))
        chosen = np.vstack([chosen, places[np.argmax(away)]])
    return chosen


LEVER_ARM = EFFECTS["velocity_lever_arm"]
ONE_ANGLE = (
    LEVER_ARM, EFFECTS["yaw_rate_bias"], v_y_bias, v_y_lead, lasting_v_y,
    EFFECTS["tyre_relaxation"], stiffness_transfer, roll,
)  # fmt: skip
CAUSAL_ANGLE = (*ONE_ANGLE, held_angle)
BOTH_ANGLES = (*ONE_ANGLE, EFFECTS["steering_offset"], second_angle)
