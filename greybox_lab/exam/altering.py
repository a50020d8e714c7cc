"""Real recordings, altered exactly as an effect would have altered them, and scatter between unaltered ones.

The motion is real, and yet the fault is known: a late command was given earlier, a sensor with a scale error has scaled
readings.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from greybox_id.base.shorthands import Array
from greybox_id.datasets.recording import Recording

Alter = Callable[[Recording, float], Mapping[str, Array]]


def _later(recording: Recording, name: str, seconds: float) -> Array:
    """A signal delayed by a time in s; advanced if negative. The ends are repeated."""
    at = recording.time - seconds
    return np.asarray(np.interp(at, recording.time, recording[name]))


def _late(*names: str) -> Alter:
    return lambda r, x: {name: _later(r, name, x) for name in names if name in r}


def _scaled(name: str) -> Alter:
    return lambda r, x: {name: r[name] * x}


def _raised(name: str) -> Alter:
    return lambda r, x: {name: r[name] + x}


def _turned(r: Recording, x: float) -> Mapping[str, Array]:
    c, s = np.cos(x), np.sin(x)
    return {"a_x": c * r["a_x"] + s * r["a_y"], "a_y": c * r["a_y"] - s * r["a_x"]}


@dataclass(frozen=True)
class Injection:
    """An alteration of a recording.

    Attributes
    ----------
    alter : recording, magnitude -> altered signals.
    null, most : magnitude without alteration, and largest distance from it.
    sides : whether magnitudes below the null are possible.
    needs : required signals.
    outputs : whether the required signals must be outputs of the model; commands are always inputs.
    """

    alter: Alter
    null: float
    most: float
    sides: bool
    needs: tuple[str, ...]
    outputs: bool = True


INJECTIONS: Mapping[str, Injection] = {
    "steering_delay": Injection(lambda r, x: {"steer": _later(r, "steer", -x)}, 0.0, 0.3, False, ("steer",), False),
    "steering_ratio": Injection(lambda r, x: {"steer": r["steer"] / x}, 1.0, 0.5, True, ("steer",), False),
    "steering_offset": Injection(lambda r, x: {"steer": r["steer"] - x}, 0.0, 0.1, True, ("steer",), False),
    "yaw_rate_scale": Injection(_scaled("yaw_rate"), 1.0, 0.5, True, ("yaw_rate",)),
    "yaw_rate_bias": Injection(_raised("yaw_rate"), 0.0, 0.15, True, ("yaw_rate",)),
    "sensor_latency_yaw": Injection(_late("yaw_rate"), 0.0, 0.15, False, ("yaw_rate",)),
    "sensor_latency_imu": Injection(_late("yaw_rate", "a_x", "a_y"), 0.0, 0.15, False, ("a_x", "a_y")),
    "accel_bias_y": Injection(_raised("a_y"), 0.0, 3.0, True, ("a_y",)),
    "imu_mount_yaw": Injection(_turned, 0.0, 0.8, True, ("a_x", "a_y")),
    "velocity_lever_arm": Injection(lambda r, x: {"v_y": r["v_y"] + x * r["yaw_rate"]}, 0.0, 4.0, True,
                                    ("v_y", "yaw_rate")),
}  # fmt: skip
"""Alterations by effect. The largest are well within the bounds of the effects, where magnitudes are estimable."""


def altered(recording: Recording, name: str, magnitude: float) -> Recording:
    """A recording as an effect would have altered it, run by run."""
    return _by_run(recording, lambda run: INJECTIONS[name].alter(run, magnitude))


def _by_run(recording: Recording, alter: Callable[[Recording], Mapping[str, Array]]) -> Recording:
    parts: dict[str, list[Array]] = {}
    for start, stop in recording.runs:
        for signal, values in alter(recording.rows(start, stop)).items():
            parts.setdefault(signal, []).append(values)
    return recording.with_signals(**{signal: np.concatenate(values) for signal, values in parts.items()})


LAGS = np.arange(-0.1, 0.4, 0.01)
"""Lags of the yaw rate behind the steering that are tried, s."""
UNDERSTEER = np.concatenate([[0.0], np.geomspace(1e-5, 1.0, 41)])
"""Understeer coefficients that are tried, s^2/m^2."""


def scatter_between(windows: Sequence[Recording]) -> dict[str, float]:
    """Injection -> standard deviation of its magnitude between unaltered recordings of one vehicle.

    By plain regressions that no diagnosis uses: of yaw rate on steering angle and speed, of a_y on yaw rate and speed,
    of v_y on yaw rate. Understeer, as a property of the vehicle, is common to all recordings.
    """
    result: dict[str, Array] = {}
    if all("steer" in window for window in windows):
        result |= _of_steering(windows)
    if all("a_y" in window for window in windows):
        rest = [_there(window["a_y"] - window["v_x"] * window["yaw_rate"], window["a_x"]) for window in windows]
        result["accel_bias_y"] = np.array([np.mean(off) for off, _ in rest])
        result["imu_mount_yaw"] = np.array([np.polyfit(along, off, 1)[0] for off, along in rest])
    if all("v_y" in window for window in windows):
        result["velocity_lever_arm"] = _of_arm(windows)
    return {name: float(np.std(item, ddof=1)) for name, item in result.items()}


def _there(*signals: Array) -> tuple[Array, ...]:
    """Rows in which all signals are finite."""
    whole = np.all(np.isfinite(signals), axis=0)
    return tuple(signal[whole] for signal in signals)


def _of_steering(windows: Sequence[Recording]) -> dict[str, Array]:
    """Lag, logarithm of gain, and offset of the yaw rate's response to steering, and mean residual, per window."""

    def steered(recording: Recording, lag: float) -> Array:
        return _by_run(recording, lambda run: {"steer": _later(run, "steer", lag)})["steer"]

    def regressed(recording: Recording, lag: float, understeer: float) -> tuple[float, Array]:
        v, s, r = _there(recording["v_x"], steered(recording, lag), recording["yaw_rate"])
        gain = v / (1.0 + understeer * v**2)
        result, *_ = np.linalg.lstsq(np.stack([gain * s, gain], axis=1), r, rcond=None)
        return float(np.mean((r - gain * (result[0] * s + result[1])) ** 2)), np.asarray(result)

    def best(recording: Recording, understeer: float) -> tuple[float, float, Array]:
        tried = [(lag, *regressed(recording, lag, understeer)) for lag in LAGS]
        lag, error, result = min(tried, key=lambda each: each[1])
        return error, float(lag), result

    middle = float(np.median([best(window, 0.0)[1] for window in windows]))
    errors = [sum(regressed(window, middle, k)[0] for window in windows) for k in UNDERSTEER]
    understeer = float(UNDERSTEER[int(np.argmin(errors))])
    each = [best(window, understeer) for window in windows]
    lags, slopes = np.array([item[1] for item in each]), np.array([item[2] for item in each])
    gain, offset = np.median(slopes, axis=0)
    left = []
    for window, lag in zip(windows, lags, strict=True):
        v, s, r = _there(window["v_x"], steered(window, lag), window["yaw_rate"])
        left.append(float(np.mean(r - v / (1.0 + understeer * v**2) * (gain * s + offset))))
    gains = np.log(np.abs(slopes[:, 0]))
    return {
        "steering_delay": lags, "sensor_latency_yaw": lags, "sensor_latency_imu": lags, "steering_ratio": gains,
        "yaw_rate_scale": gains, "steering_offset": slopes[:, 1] / slopes[:, 0], "yaw_rate_bias": np.array(left),
    }  # fmt: skip


def _of_arm(windows: Sequence[Recording]) -> Array:
    """Slope of v_y over yaw rate at zero speed, per window; its dependence on speed squared is common to all."""
    parts = [_there(window["v_y"], window["yaw_rate"], window["v_x"]) for window in windows]
    k = len(parts)
    rows = [np.zeros((len(part[0]), k + 1)) for part in parts]
    for place, (block, (_, r, v)) in enumerate(zip(rows, parts, strict=True)):
        block[:, place], block[:, k] = r, r * v**2
    result, *_ = np.linalg.lstsq(np.concatenate(rows), np.concatenate([part[0] for part in parts]), rcond=None)
    return np.asarray(result[:k])
