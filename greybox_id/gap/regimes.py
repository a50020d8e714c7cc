"""Where a gap lies: channel, regime of driving, equation, time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..base.shorthands import Array, Mask
from ..engine.simulation import FreeRuns
from ..models.effect import Effect
from .estimation.calibration import CAL
from .estimation.strip import running
from .gap import Where
from .selection import ExpectedGain

EQUATIONS = {
    "steering": "steering", "drive": "F_x", "tyres": "F_y", "body": "inertia and loads", "road": "road and air",
    "sensors": "sensors", "timing": "timing",
}  # fmt: skip
"""Group of effects -> the part of the equations they act on."""

DEFINED_BY = {
    "straight": {"a_y"}, "lateral": {"a_y"}, "high_lateral": {"a_y"}, "transient": {"steer"}, "acceleration": {"a_x"},
    "braking": {"a_x"}, "combined": {"a_x", "a_y"}, "high_speed": {"v_x"},
}  # fmt: skip
"""Signals without which a regime is not known."""


def signals(bench: FreeRuns, y: Array) -> dict[str, Array]:
    """Signals that define regimes, per row: as simulated, for readings share their noise with residuals."""
    outputs = np.where(bench.counted, y, np.nan_to_num(bench.measured))
    read = np.any(np.isfinite(bench.measured), axis=0)  # some channels are in no recording
    result = {name: values for name, values, there in zip(bench.channels, outputs.T, read, strict=True) if there}
    result |= dict(zip(bench.model.inputs, bench.inputs.T, strict=True))
    if "a_y" not in result and {"v_x", "yaw_rate"} <= result.keys():  # lateral acceleration without its sensor
        result["a_y"] = result["v_x"] * result["yaw_rate"]
    return {name: _smooth(values, bench) for name, values in result.items()}


def regimes(bench: FreeRuns, seen: Mapping[str, Array]) -> dict[str, Mask]:
    """Rows of each regime that these signals define."""
    count = len(bench.measured)
    nothing = np.zeros(count)
    v, a_y, a_x = (seen.get(name, nothing) for name in ("v_x", "a_y", "a_x"))
    steer = seen.get("steer", nothing)
    across, along = np.abs(a_y) / _top(a_y), a_x / _top(a_x)
    rate = np.abs(np.concatenate([np.gradient(steer[rows]) for rows in bench.rows]))
    place = np.arange(count) / max(count, 1)
    result = {
        "straight": across < 0.15,
        "lateral": across > 0.3,
        "high_lateral": across > 0.7,
        "transient": rate > np.quantile(rate, 0.75),
        "acceleration": along > 0.3,
        "braking": along < -0.3,
        "combined": (across > 0.3) & (np.abs(along) > 0.3),
        "high_speed": v > np.quantile(v, 0.75),
        "time_drift": place > 2 / 3,
    }
    return {name: rows for name, rows in result.items() if seen.keys() >= DEFINED_BY.get(name, set())}


def where(
    bench: FreeRuns,
    excess: Array,
    ratio: Array,
    seen: Mapping[str, Array],
    expected_gains: Sequence[ExpectedGain],
    effects: Mapping[str, Effect],
) -> Where:
    """Where the gap lies.

    Parameters
    ----------
    excess : (N,) squared errors over the noise's, less those that noise and the explanation leave.
    ratio : (channels,) root mean square of errors over that of noise; NaN where nothing was read.
    expected_gains : expected gains of single effects.
    """
    total = float(np.sum(excess))
    there = total > CAL.no_gap * len(excess)
    shares = {
        name: (float(np.mean(regime)), float(np.clip(np.sum(excess[regime]) / total, 0.0, 1.0)) if there else 0.0)
        for name, regime in regimes(bench, seen).items()
    }
    lifted = {
        name: lift
        for name, (time, share) in shares.items()
        if share > CAL.regime_share and time > CAL.regime_time and (lift := share / max(time, 1e-3)) > CAL.lift
    }
    channels = {c: float(r) for c, r in zip(bench.channels, ratio, strict=True) if np.isfinite(r)}
    gains: dict[str, float] = {}
    for entry in expected_gains:
        group = effects[entry.candidate.effect].group
        part = EQUATIONS.get(group, group)
        gains[part] = max(gains.get(part, 0.0), entry.gain)
    everything = sum(gains.values()) or 1.0
    return Where(
        channel=max(channels, key=lambda name: channels[name], default=""),
        regime=max(lifted, key=lambda name: lifted[name], default="any"),
        equations={k: v / everything for k, v in sorted(gains.items(), key=lambda item: -item[1])},
        time=_stretch(bench, excess),
        channels=channels,
        regimes=shares,
    )


def _stretch(bench: FreeRuns, excess: Array) -> dict[str, float]:
    """The shortest stretch of time that holds half of the gap."""
    held = np.concatenate(([0.0], np.cumsum(np.maximum(excess, 0.0))))
    if held[-1] <= 0:
        return {}
    ends = np.searchsorted(held, held[:-1] + held[-1] / 2)
    starts = np.flatnonzero(ends < len(held))
    time = running(bench.time)
    first = int(starts[np.argmin(ends[starts] - starts)])
    last = min(int(ends[first]), len(bench.time) - 1)
    return {"from": float(time[first]), "to": float(time[last]), "share": (last - first + 1) / len(bench.time)}


def _smooth(values: Array, bench: FreeRuns) -> Array:
    """Moving mean, so that noise does not define regimes."""
    length, result = max(1, round(CAL.smooth / bench.sample_time)), []
    for rows in bench.rows:
        window = min(length, rows.stop - rows.start)
        result.append(np.convolve(values[rows], np.ones(window) / window, mode="same"))
    return np.concatenate(result)


def _top(values: Array) -> float:
    return float(max(np.quantile(np.abs(values), 0.99), 1e-9))
