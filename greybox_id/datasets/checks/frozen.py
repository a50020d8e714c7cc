"""Channels that stand still for a while though others move."""

from __future__ import annotations

import numpy as np

from ...base.numbers import number, quantity
from ..recording import Recording
from .finding import Finding, FoundAt, Severity

STEADY = 0.9
"""Share of an unbroken run beyond which a channel that stands still was meant to: a speed that a controller keeps."""
FROZEN, TIMES = 1.5, 20.0
"""Shortest time in s, and over the channel's usual hold, for which a channel that stands still is stuck."""
BESIDE = {
    "yaw_rate": ("a_y", "steer"), "v_x": ("a_x", "yaw_rate"), "a_x": ("a_y", "yaw_rate"), "a_y": ("yaw_rate", "steer"),
    "v_y": ("yaw_rate",), "steer": ("yaw_rate", "a_y"), "yaw": ("yaw_rate",),
}  # fmt: skip
"""Channel -> what goes with it."""
MOVES = 0.2
"""Least scatter of what goes with it while a channel is stuck, over its usual size."""
HOLDS, AS_EVER = 3.0, 0.7
"""Times the next longest hold from which a channel is stuck as well, where what goes with it moves on by so much of its
usual scatter: a command may be held for long, but then the vehicle does not go on weaving."""


def check_frozen(r: Recording) -> list[Finding]:
    """Channels that stand still for a while though others move."""
    findings = []
    for name in BESIDE:
        if not r.has(name):
            continue
        values = r[name]
        same = np.concatenate([[False], np.diff(values) == 0.0]) & np.isfinite(values)
        same[[start for start, _ in r.runs]] = False
        edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(int), [0]])))
        begins, ends = edges[::2] - 1, edges[1::2]
        if not len(begins):
            continue
        lengths = ends - begins
        longest = int(np.argmax(lengths))
        a, b = int(begins[longest]), int(ends[longest])
        usual = float(np.median(np.delete(lengths, longest))) if len(lengths) > 1 else 1.0
        next_longest = float(np.max(np.delete(lengths, longest))) if len(lengths) > 1 else 1.0
        moving = _moves(r, name, a, b)
        seconds = lengths[longest] * r.sample_time
        long = lengths[longest] > TIMES * max(usual, 1.0)
        longer = lengths[longest] > HOLDS * max(next_longest, 1.0) and moving > AS_EVER
        if (
            seconds < FROZEN
            or not (long or longer)
            or values[a] == 0.0
            or any(b - a > STEADY * (end - start) for start, end in r.runs if start <= a < end)
            or moving < MOVES
        ):
            continue
        sentence = (
            f"{name} is stuck at {quantity(float(values[a]), r.unit(name))} from t = {number(float(r.time[a]), 4)} to "
            f"{number(float(r.time[b - 1]), 4)} s while other channels move. Leave these rows out."
        )
        place = FoundAt(name, rows=tuple(range(a, b)))
        findings.append(Finding("stuck", Severity.DISTRUST, place, sentence, seconds, None, "s"))
    return findings


def _moves(r: Recording, name: str, a: int, b: int) -> float:
    """Scatter between two rows of what a channel goes with, over its usual size."""
    for other in BESIDE[name]:
        if r.has(other) and np.any(np.isfinite(r[other][a:b])):
            part, whole = r[other][a:b], r[other]
            usual = float(np.hypot(np.nanstd(whole), np.nanmean(part)))  # a circle that is driven moves nothing
            return float(np.nanstd(part)) / max(usual, 1e-300)
    return 0.0
