"""Tyres, one wheel at a time: curves of lateral force over slip, and factors on friction.

All curves are relative to the peak. Other curves than the magic formula are functions of t, slope times tan(alpha) over
peak, and are fitted to the magic formula of the same vehicle (`fitted`). They describe the same tyre: its cornering
stiffness and friction are the stated ones within a few percent.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import atan, copysign, exp, sin, sqrt, tan, tanh
from typing import Any, cast

import numpy as np
from scipy.optimize import least_squares

from greybox_id.base.machine_code import compiled

from .layout import Car, Row

MAGIC, TMEASY, BRUSH, DUGOFF, TANH = 0, 1, 2, 3, 4
SLOPE_OFF, PEAK_OFF = 0.03, 0.02
"""Largest relative differences of a form's slope and peak from those of the magic formula of the tyre: twice the
tolerances in vehicle files. Larger ones would be another stiffness or grip, which are effects."""
LEAST_PEAK_T = 2.0
"""For TMeasy: with a nearer peak, its curve would have an upward bend."""
LOWER_PEAK = 1
POWER = 1
HEAT_BALANCE = 1
_DEGRESSIVE = 2.6
"""Ratio of load to static load at which stiffness is largest, in the form in which it does not grow further."""


@compiled
def shape(form: float, t: float, peak_t: float, slide_t: float, slide: float) -> float:
    """Share of the peak, with slope one at zero.

    TMeasy reaches one at `peak_t` (at least 2) and `slide` from `slide_t` on; other forms have no such parameters.
    """
    size = abs(t)
    if form == BRUSH:
        p = size / 3.0
        return copysign(1.0, t) if p >= 1.0 else t * (1.0 - p + p * p / 3.0)
    if form == DUGOFF:
        return t if size < 0.5 else copysign(1.0 - 0.25 / size, t)
    if form == TANH:
        return tanh(t)
    if size < peak_t:
        s = size / peak_t
        return t / (1.0 + s * (s + peak_t - 2.0))
    # two parabolas from the peak down to sliding
    middle = peak_t + 0.5 * (slide_t - peak_t)
    if size >= slide_t:
        return copysign(slide, t)
    if size <= middle:
        return copysign(1.0 - 0.5 * (1.0 - slide) * ((size - peak_t) / (middle - peak_t)) ** 2, t)
    return copysign(slide + 0.5 * (1.0 - slide) * ((slide_t - size) / (slide_t - middle)) ** 2, t)


@compiled
def curve(car: Car, front: bool, alpha: float, stiffness: float) -> float:
    """Share of the peak lateral force at a slip angle, rad; `stiffness` multiplies only the slope."""
    B, C, E = (car.B_f, car.C_f, car.E_f) if front else (car.B_r, car.C_r, car.E_r)
    if car.form_tyre == MAGIC:
        slip = stiffness * B * alpha
        return sin(C * atan(slip - E * (slip - atan(slip))))
    t = stiffness * B * C * tan(min(max(alpha, -1.5), 1.5))
    if front:
        share = shape(car.form_tyre, car.slope_fit_f * t, car.peak_t_f, car.slide_t_f, car.slide_f)
        return float(car.peak_fit_f * share)
    share = shape(car.form_tyre, car.slope_fit_r * t, car.peak_t_r, car.slide_t_r, car.slide_r)
    return float(car.peak_fit_r * share)


@cache
def fitted(
    form: float, B: float, C: float, E: float, peak_t: float, slide_t: float, slide: float
) -> tuple[float, float, float]:
    """Factors on t and on the peak, and position of TMeasy's peak, that fit a form to the magic formula.

    The fit extends slightly beyond the peak; slope and peak stay within `SLOPE_OFF` and `PEAK_OFF` of the stated ones.
    """
    if form == MAGIC:
        return 1.0, 1.0, peak_t
    alphas = np.linspace(0.0, 1.2, 60)[1:] * min(peak_t / (B * C), 0.5)
    slips = B * alphas
    aim = np.sin(C * np.arctan(slips - E * (slips - np.arctan(slips))))
    plain = cast(Callable[..., float], cast(Any, shape).py_func)

    def off(factors: Row) -> Row:
        slope, peak, breadth = factors
        t, at = slope / peak * B * C * np.tan(alphas), max(breadth * peak_t, LEAST_PEAK_T)
        return np.asarray(peak * np.array([plain(form, each, at, slide_t, slide) for each in t]) - aim)

    low, high = np.array([1 - SLOPE_OFF, 1 - PEAK_OFF, 0.6]), np.array([1 + SLOPE_OFF, 1 + PEAK_OFF, 1.4])
    slope, peak, breadth = least_squares(off, [1.0, 1.0, 1.0], bounds=(low, high)).x
    return float(slope / peak), float(peak), max(float(breadth) * peak_t, LEAST_PEAK_T)


@compiled
def stiffness_factor(form: float, F_z: float, F_z0: float) -> float:
    """Slope per load relative to that at static load: one, or falling with load (Pacejka's sin(2 atan))."""
    if form == 0.0 or F_z <= 0.0:
        return 1.0
    x, x_0 = F_z / (F_z0 * _DEGRESSIVE), 1.0 / _DEGRESSIVE
    return (1.0 + x_0 * x_0) / (1.0 + x * x)


@compiled
def load_factor(form: float, k: float, F_z: float, F_z0: float) -> float:
    """Friction at a wheel load relative to that at static load; -k is its slope there."""
    if k == 0.0:
        return 1.0
    if form == POWER:
        return float(max(F_z / F_z0, 0.02) ** -k)
    return 1.0 - k * (F_z - F_z0) / F_z0


@compiled
def warmth_factor(form: float, A: float, E_0: float, own_heat: float, other_heat: float) -> float:
    """Friction of an axle's warm tyres relative to cold ones.

    Heats are the friction work of both axles, J, or, for `HEAT_BALANCE`, their relative temperatures.
    """
    if A == 0.0:
        return 1.0
    if form == HEAT_BALANCE:
        return 1.0 - A * own_heat
    return 1.0 - A * (1.0 - exp(-(own_heat + other_heat) / E_0))


@compiled
def left_beside(strength: float, F_x: float, peak: float) -> float:
    """Share of the peak lateral force that a longitudinal force leaves, by the friction ellipse."""
    if strength == 0.0:
        return 1.0
    if peak <= 0.0:
        return 0.0
    return sqrt(max(1.0 - (strength * F_x / peak) ** 2, 0.0))
