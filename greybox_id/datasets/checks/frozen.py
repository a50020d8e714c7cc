"""Channels that stand still for a while though others move."""

from __future__ import annotations

import numpy as np

from ...base.numbers import number, quantity
from ...base.shorthands import Array
from ...base.signals import COMMANDS
from ..recording import Recording
from .finding import Finding, FoundAt, Severity
from .pairs import smooth
from .relations import SMOOTHING

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
SETTLED = 1.0
"""s after which a vehicle whose steering is held turns as that and its speed say."""
WEAVES, BOTH_WAYS = 0.5, 0.25
"""Shares of yaw_rate's usual scatter: what speed leaves of it while steer stands still, and what it reaches to the left
and to the right. Model cars that slide or ramp up at held steering leave up to .47 (the public recordings of DART), and
turn one way."""


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
        lengths = ends - begins
        elsewhere = np.where(values[begins] == 0.0, 0, lengths)  # at zero a command rests
        if not np.any(elsewhere):
            continue
        longest = int(np.argmax(elsewhere))
        a, b = int(begins[longest]), int(ends[longest])
        usual = float(np.median(np.delete(lengths, longest))) if len(lengths) > 1 else 1.0
        next_longest = float(np.max(np.delete(lengths, longest))) if len(lengths) > 1 else 1.0
        moving = _moves(r, name, a, b)
        seconds = lengths[longest] * r.sample_time
        long = lengths[longest] > TIMES * max(usual, 1.0)
        longer = lengths[longest] > HOLDS * max(next_longest, 1.0) and moving > AS_EVER
        alone = name == "steer" and lengths[longest] > HOLDS * max(np.max(np.delete(elsewhere, longest), initial=1), 1)
        at_stop = name in COMMANDS and np.count_nonzero(values[begins] == values[a]) > 1
        if (
            seconds < FROZEN
            or at_stop
            or any(b - a > STEADY * (end - start) for start, end in r.runs if start <= a < end)
            or not (((long or longer) and moving >= MOVES) or (alone and _weaves(r, a, b)))
        ):
            continue
        sentence = (
            f"{name} is stuck at {quantity(float(values[a]), r.unit(name))} from t = {number(float(r.time[a]), 4)} to "
            f"{number(float(r.time[b - 1]), 4)} s while other channels move. Leave these rows out."
        )
        place = FoundAt(name, rows=tuple(range(a, b)))
        findings.append(Finding("stuck", Severity.DISTRUST, place, sentence, seconds, None, "s"))
    return findings


def _weaves(r: Recording, a: int, b: int) -> bool:
    """Whether a vehicle turns, while its steering stands still, as no held steering makes it: this way and that."""
    settled = slice(a + int(np.ceil(SETTLED / r.sample_time)), b)
    if not r.has("yaw_rate"):
        return False
    turning: Array = smooth(r, r["yaw_rate"], SMOOTHING)
    usual, part = float(np.nanstd(turning)), turning[settled]
    known = np.isfinite(part)
    if np.count_nonzero(known) < SETTLED / r.sample_time or not usual > 0.0:
        return False
    pace = r["v_x"][settled] if r.has("v_x") else np.ones(len(part))
    known &= np.isfinite(pace)
    table = np.column_stack([np.ones(len(part)), pace])[known]
    left = part[known] - table @ np.linalg.lstsq(table, part[known], rcond=None)[0]
    right_most, left_most = np.quantile(part[known], [0.05, 0.95]) if np.any(known) else (0.0, 0.0)
    return bool(np.std(left) > WEAVES * usual or min(left_most, -right_most) > BOTH_WAYS * usual)


def _moves(r: Recording, name: str, a: int, b: int) -> float:
    """Scatter between two rows of what a channel goes with, over its usual size."""
    for other in BESIDE[name]:
        if r.has(other) and np.any(np.isfinite(r[other][a:b])):
            part, whole = r[other][a:b], r[other]
            usual = float(np.hypot(np.nanstd(whole), np.nanmean(part)))  # a circle that is driven moves nothing
            return float(np.nanstd(part)) / max(usual, 1e-300)
    return 0.0
