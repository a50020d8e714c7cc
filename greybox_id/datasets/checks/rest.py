"""What the sensors read while the vehicle stands: offsets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...base.numbers import short_with_sd, with_unit
from ...base.statistics import moving_mean
from ..recording import Recording
from .finding import Finding, FoundAt, Severity

REST_SHARE = 0.003
"""At rest means slower than 0.3 % of the top speed ..."""
REST_SECONDS = 1.0
"""... for at least a second, a quarter of it cut off at each end where the vehicle settles."""
STANDS, STANDING_MEAN = 0.01, 0.5
"""Under the brake it stands where its mean speed over half a second is 1 % of the top speed."""
DRIVES = ("drive_force", "ax_cmd", "motor_current", "throttle")
"""What is negative while it brakes."""
CHANNELS = {"yaw_rate": 0.002, "a_x": 0.02, "a_y": 0.02}
"""Channels that read zero at rest on flat ground, and the offset below which nobody minds (rad/s, m/s^2)."""


def check_rest(recording: Recording) -> list[Finding]:
    """Offsets of gyro and accelerometers at rest, one finding for each that is significant."""
    if "v_x" not in recording:
        return []
    stretches = [np.arange(a, b) for a, b in _rests(recording)]
    findings = []
    for name, negligible in CHANNELS.items():
        means = [float(np.mean(recording[name][rows])) for rows in stretches] if name in recording else []
        if not means or not np.isfinite(means).all():
            continue
        weights = np.array([len(rows) for rows in stretches], dtype=float)
        offset = float(np.average(means, weights=weights))
        error = _uncertainty(recording, name, stretches, np.array(means), weights)
        if abs(offset) < max(negligible, 3 * error):
            continue
        unit, seconds = recording.unit(name), weights.sum() * recording.sample_time
        shown = f"{'+' if offset > 0.0 else ''}{short_with_sd(offset, error)}"
        cause = "the sensor's offset" if name == "yaw_rate" else "offset, or slope of the ground"
        sentence = (
            f"{name} reads {with_unit(shown, unit)} at rest ({seconds:.1f} s in {len(stretches)} "
            f"stand{'s' if len(stretches) > 1 else ''}): {cause}."
        )
        findings.append(Finding("offset", Severity.WARNING, FoundAt(name), sentence, offset, error, unit))
    return findings


def standing(recording: Recording) -> NDArray[np.bool_]:
    """(n,) whether the vehicle stands under its brake, for a second at least; False where that cannot be told."""
    result = np.zeros(len(recording), dtype=bool)
    braked = np.zeros(len(recording), dtype=bool)
    for name in DRIVES:
        braked |= recording[name] < 0 if recording.has(name) else False
    braked |= recording["brake"] > 0 if recording.has("brake") else False
    if not recording.has("v_x") or not braked.any():
        return result
    least = STANDS * float(np.nanquantile(np.abs(recording["v_x"]), 0.99))
    width = 2 * int(round(0.5 * STANDING_MEAN / recording.sample_time)) + 1
    shortest = int(round(REST_SECONDS / recording.sample_time))
    for start, stop in recording.runs:
        if stop - start <= max(width, shortest):
            continue
        pace = np.abs(moving_mean(recording["v_x"][start:stop], width))
        still = (pace <= least) & braked[start:stop]
        edges = np.flatnonzero(np.diff(still.astype(int), prepend=0, append=0)) + start
        for a, b in zip(edges[::2], edges[1::2], strict=True):
            result[a:b] = b - a >= shortest
    return result


def _rests(recording: Recording) -> list[tuple[int, int]]:
    speed = np.abs(recording["v_x"])
    top = float(np.nanquantile(speed, 0.99)) if np.isfinite(speed).any() else 0.0
    still: NDArray[np.bool_] = speed <= REST_SHARE * top
    if top == 0.0:
        return []
    shortest = max(6, int(round(REST_SECONDS / recording.sample_time)))
    rests = []
    for start, stop in recording.runs:
        edges = np.flatnonzero(np.diff(still[start:stop].astype(int), prepend=0, append=0)) + start
        for a, b in zip(edges[::2], edges[1::2], strict=True):
            if b - a >= shortest:
                settle = (b - a) // 4
                rests.append((int(a) + settle, int(b) - settle))
    return rests


def _uncertainty(
    recording: Recording,
    name: str,
    stretches: list[NDArray[np.int_]],
    means: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> float:
    """Standard error of the mean: scatter between stands, or within one where samples hang together for 5."""
    within = np.concatenate([recording[name][rows] - m for rows, m in zip(stretches, means, strict=True)])
    inside = float(np.std(within)) * np.sqrt(5.0 / len(within))
    if len(means) < 2:
        return float(inside)
    share = weights / weights.sum()
    centre = float(share @ means)
    between = np.sqrt(np.sum(share**2 * (means - centre) ** 2) * len(means) / (len(means) - 1))
    return float(max(inside, between))
