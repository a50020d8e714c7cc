"""Readings of sensors from the motion: their instants, mounting, errors and failures.

The motion is known at the beginning and the end of every simulation step and interpolated linearly between, so that
readings can be taken at any instant, and accelerations may jump from one step to the next.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from .layout import READABLE, Row
from .loop import STEP
from .scale import G

Reading = Mapping[str, Row]
_CHANNELS = ("v_x", "v_y", "yaw_rate", "a_x", "a_y")
_TINY = 1e-9


@dataclass(frozen=True)
class Motion:
    """The motion that sensors read.

    Attributes
    ----------
    readable : (steps, 2, k) `layout.READABLE` at the beginning and the end of every step.
    first : step of the first row.
    """

    readable: NDArray[np.float64]
    first: int

    def at(self, name: str, instants: Row) -> Row:
        """A quantity at instants, s since the first row, just after any jump there."""
        k = READABLE.index(name)
        place = np.clip(self.first + instants / STEP, 0.0, len(self.readable) - _TINY)
        step = np.minimum((place + 1e-6).astype(int), len(self.readable) - 1)
        share = np.clip(place - step, 0.0, 1.0)
        return np.asarray(self.readable[step, 0, k] * (1.0 - share) + self.readable[step, 1, k] * share)


def instants(time: Row, effects: Mapping[str, float], scatters: bool, rng: np.random.Generator) -> dict[str, Row]:
    """True instants of each channel's readings at every row, s.

    Parameters
    ----------
    time : (n,) stamps, s.
    effects : magnitudes.
    scatters : whether latencies vary around their mean.
    rng : random generator of jitter and scatter.
    """
    n, moment = len(time), time + effects["timestamp_jitter"] * rng.standard_normal(len(time))
    imu, yaw, speed = (np.full(n, effects[f"sensor_latency_{name}"]) for name in ("imu", "yaw", "vx"))
    if scatters:
        imu, yaw, speed = (item * rng.gamma(25.0, 1 / 25.0, n) for item in (imu, yaw, speed))
    late: dict[str, float | Row] = {"v_x": speed, "v_y": 0.0, "yaw_rate": yaw + imu, "a_x": imu, "a_y": imu}
    return {name: moment - item for name, item in late.items()}


def read(
    motion: Motion, when: Mapping[str, Row], effects: Mapping[str, float], car: Mapping[str, float],
    rng: np.random.Generator,
) -> dict[str, Row]:  # fmt: skip
    """All channels without noise.

    Parameters
    ----------
    motion : of the vehicle.
    when : instants by channel, (n,) s.
    effects : magnitudes.
    car : h_cg, wheel_radius [m] and top_speed [m/s].
    rng : random generator of drifts.
    """
    at, x, n = when["a_x"], effects["imu_lever_arm"], len(when["a_x"])
    a_x = motion.at("a_x", at) - x * motion.at("yaw_rate", at) ** 2
    a_y = motion.at("a_y", at) + x * motion.at("yaw_acceleration", at)
    a_y = a_y + G * motion.at("roll", at) - car["h_cg"] * motion.at("roll_acceleration", at)
    c, s = np.cos(effects["imu_mount_yaw"]), np.sin(effects["imu_mount_yaw"])  # the sensor is turned to the left
    a_x, a_y = c * a_x + s * a_y, c * a_y - s * a_x
    a_x = a_x + effects["accel_cross_axis"] * a_y

    v_x = motion.at("v_x", when["v_x"])
    v_x = v_x * (1.0 + effects["slip_speed_error"] * motion.at("a_x", when["v_x"]) / G)
    r = motion.at("yaw_rate", when["yaw_rate"])
    if effects["gyro_compression"] > 0.0:
        r = np.tanh(effects["gyro_compression"] * r) / effects["gyro_compression"]
    r = r + effects["gyro_g_sensitivity"] * motion.at("a_x", when["yaw_rate"])

    pace = motion.at("v_x", at)
    turned = np.concatenate(([0.0], np.cumsum(pace[1:] * np.diff(at)))) / car["wheel_radius"]
    shakes = effects["wheel_imbalance"] * (pace / car["top_speed"]) ** 2
    drift = {name: _drift(at, rng) for name in ("yaw_rate", "a_x", "a_y")}
    seen = {
        "v_x": _pulsed(effects["wheel_speed_scale"] * v_x, effects["wheel_pulses"]),
        "v_y": motion.at("v_y", when["v_y"]) + effects["velocity_lever_arm"] * motion.at("yaw_rate", when["v_y"]),
        "yaw_rate": effects["yaw_rate_scale"] * r
        + effects["yaw_rate_bias"]
        + effects["gyro_drift"] * drift["yaw_rate"],
        "a_x": a_x
        - G * np.sin(effects["imu_mount_pitch"])
        + effects["accel_bias_x"]
        + effects["accel_drift"] * drift["a_x"]
        + 0.6 * shakes * np.sin(turned),
        "a_y": a_y
        + G * np.sin(effects["imu_mount_roll"])
        + effects["accel_bias_y"]
        + effects["accel_drift"] * drift["a_y"]
        + shakes * np.cos(turned),
    }
    assert all(len(values) == n for values in seen.values())
    return seen


def hung(seen: Reading, time: Row, effects: Mapping[str, float], rng: np.random.Generator) -> dict[str, Row]:
    """Readings with rows at which sensors repeat their last reading."""
    n = len(time)
    dropped = rng.random(n) < effects["dropped_samples"]
    dead = np.zeros(n, bool)
    if effects["dead_stretches"] > 0.0:
        rows = max(int(round(0.5 / float(np.median(np.diff(time))))), 1)
        for start in rng.integers(0, n, max(int(round(effects["dead_stretches"] * n / rows)), 1)):
            dead[start : start + rows] = True
    held = {}
    for name, values in seen.items():
        stale = dropped | dead if name in ("yaw_rate", "a_x", "a_y") else dropped.copy()
        stale[0] = False
        held[name] = values[np.maximum.accumulate(np.where(stale, 0, np.arange(n)))]
    return held


def noisy(
    seen: Reading, sd: Mapping[str, float], period: float, colour: float, outliers: float, quantisation: float,
    rng: np.random.Generator,
) -> dict[str, Row]:  # fmt: skip
    """Readings with noise.

    Parameters
    ----------
    seen : readings without noise.
    sd : of each channel's noise; channels without one are omitted.
    period : between rows, s.
    colour : share of the variance that is correlated, over 0.08 s.
    outliers : share of readings with errors of 5 to 10 sd.
    quantisation : step of readings relative to their sd.
    rng : random generator.
    """
    result, keeps = {}, np.exp(-period / 0.08)
    for name in _CHANNELS:
        n = len(seen[name])
        white, slow = rng.standard_normal(n), _autoregressive(keeps, rng.standard_normal(n))
        far = (rng.random(n) < outliers) * rng.uniform(5.0, 10.0, n) * rng.choice([-1.0, 1.0], n)
        if name in sd:
            values = seen[name] + sd[name] * (np.sqrt(1.0 - colour) * white + np.sqrt(colour) * slow + far)
            step = quantisation * sd[name]
            result[name] = step * np.round(values / step) if step > 0.0 else values
    return result


def _autoregressive(keeps: float, shocks: Row) -> Row:
    """AR(1) process of variance one."""
    first = np.array([shocks[0] * (1.0 - np.sqrt(1.0 - keeps**2))])  # stationary from the beginning
    return np.asarray(lfilter([np.sqrt(1.0 - keeps**2)], [1.0, -keeps], shocks, zi=first)[0], float)


def _drift(at: Row, rng: np.random.Generator) -> Row:
    """A random walk with an sd of one after a minute."""
    steps = np.sqrt(np.abs(np.diff(at, prepend=at[0])) / 60.0)
    return np.asarray(np.cumsum(steps * rng.standard_normal(len(at))))


def _pulsed(v: Row, step: float) -> Row:
    """A speed counted in pulses, zero below ten steps."""
    if step == 0.0:
        return v
    counted = step * np.round(v / step)
    return np.asarray(np.where(np.abs(v) < 10.0 * step, 0.0, counted))
