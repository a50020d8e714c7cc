"""Effects of road and air: slopes, and wind."""

from __future__ import annotations

from math import pi

import casadi as cs

from ..model import Symbol
from ..motion_model import MotionModel, Quantities, State
from ..parameter import Parameter
from ..single_track import G
from .stating import alteration, effect

GROUP = "road"

STILL_AIR = 1e-6
"""Speed, m/s, over which the magnitude of the air speed is rounded at zero."""


def _wind(q: Quantities) -> tuple[Symbol, Symbol]:
    """Wind along and across the vehicle, m/s, blowing towards `wind_direction`, relative to the initial heading."""
    towards = q.p.wind_direction - (q.x.yaw if hasattr(q.x, "yaw") else 0.0)
    return q.p.wind_gust * cs.cos(towards), q.p.wind_gust * cs.sin(towards)


def _air_speed(along: Symbol, across: Symbol) -> Symbol:
    return cs.sqrt(along**2 + across**2 + STILL_AIR**2)


def _drag(F_drag: Symbol, q: Quantities) -> Symbol:
    """Change of drag along the vehicle by the wind: c_2 |v_air| v_air replaces c_2 |v_x| v_x."""
    v_x, (along, across) = q.x.v_x, _wind(q)
    with_wind = _air_speed(v_x - along, across) * (v_x - along)
    return F_drag + q.p.c_2 * (with_wind - _air_speed(v_x, 0.0) * v_x)


def _side_wind(a_y: Symbol, q: Quantities) -> Symbol:
    """Lateral acceleration by the wind; the vehicle's v_y is neglected, as it is without wind."""
    along, across = _wind(q)
    return a_y + q.p.c_2 * _air_speed(q.x.v_x - along, across) * across / q.p.m


def _blowing(model: MotionModel) -> MotionModel:
    blown = model.altered(F_drag=_drag, a_y=_side_wind)
    if "yaw_rate" in model.names and "yaw" not in model.names:
        return blown.with_states(lambda q: {"yaw": q.x.yaw_rate}, State("yaw", "rad", 1.0))
    return blown


road_slope = alteration(
    GROUP, "road_slope", "rad", 0.0, (-0.3, 0.3), "slope of the road, uphill positive",
    typical=0.03, gravity_x=lambda g_x, q: g_x + G * cs.sin(q.p.road_slope),
)  # fmt: skip

road_bank = alteration(
    GROUP, "road_bank", "rad", 0.0, (-0.3, 0.3), "bank of the road, left side up positive",
    typical=0.03, gravity_y=lambda g_y, q: g_y + G * cs.sin(q.p.road_bank),
)  # fmt: skip

wind_gust = effect(
    GROUP, "wind_gust", "m/s", 0.0, (-40.0, 40.0), "mean wind, towards wind_direction",
    touches=("F_drag",), needs=("v_x", "c_2"), apply=_blowing, typical=8.0,
    others=(Parameter(
        "wind_direction", "rad", 0.0, (-2 * pi, 2 * pi), fixed=True,
        about="direction the wind blows to, relative to the heading at the start of a run, positive to the left",
    ),),
)  # fmt: skip

ALL = (road_slope, road_bank, wind_gust)
