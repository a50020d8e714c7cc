"""Channels that are constant for a while although others change."""

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
"""Share of a run beyond which a constant channel is intended, such as a speed that a controller keeps."""
FROZEN, TIMES = 1.5, 20.0
"""A channel is stuck if it is constant for at least the first, in s, and the second times its usual hold."""
BESIDE = {
    "yaw_rate": ("a_y", "steer"), "v_x": ("a_x", "yaw_rate"), "a_x": ("a_y", "yaw_rate"), "a_y": ("yaw_rate", "steer"),
    "v_y": ("yaw_rate",), "steer": ("yaw_rate", "a_y"), "yaw": ("yaw_rate",),
}  # fmt: skip
"""Channel -> channels that change with it."""
MOVES = 0.2
"""Least scatter of a related channel during the stretch, relative to its usual size."""
HOLDS, AS_EVER = 3.0, 0.7
"""A channel is also stuck if it is constant for `HOLDS` times the next longest hold, while a related channel scatters
by `AS_EVER` of its usual size: a command may be held for long, but then the vehicle does not continue weaving."""
SETTLED = 1.0
"""s after which the yaw rate at held steering has settled to the value that steering and speed determine."""
WEAVES, BOTH_WAYS = 0.5, 0.25
"""Shares of yaw_rate's usual scatter while steer is constant: the part that speed does not explain, and the yaw rate
reached in both directions. Model cars that slide or accelerate at held steering have a residual of up to .47 (the
public recordings of DART), and turn in one direction only."""


def check_frozen(r: Recording) -> list[Finding]:
    """Findings about channels that are constant for a while although others change."""
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
        elsewhere = np.where(values[begins] == 0.0, 0, lengths)  # a command may rest at zero
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
    """Whether the vehicle weaves while its steering is constant, which held steering cannot cause."""
    settled = slice(a + int(np.ceil(SETTLED / r.sample_time)), b)
    if not r.has("yaw_rate"):
        return False
    turning: Array = smooth(r, r["yaw_rate"], SMOOTHING)
    usual, part = float(np.nanstd(turning)), turning[settled]
    finite = np.isfinite(part)
    if np.count_nonzero(finite) < SETTLED / r.sample_time or not usual > 0.0:
        return False
    pace = r["v_x"][settled] if r.has("v_x") else np.ones(len(part))
    finite &= np.isfinite(pace)
    table = np.column_stack([np.ones(len(part)), pace])[finite]
    residual = part[finite] - table @ np.linalg.lstsq(table, part[finite], rcond=None)[0]
    right_most, left_most = np.quantile(part[finite], [0.05, 0.95]) if np.any(finite) else (0.0, 0.0)
    return bool(np.std(residual) > WEAVES * usual or min(left_most, -right_most) > BOTH_WAYS * usual)


def _moves(r: Recording, name: str, a: int, b: int) -> float:
    """Scatter of a related channel between two rows, relative to its usual size."""
    for other in BESIDE[name]:
        if r.has(other) and np.any(np.isfinite(r[other][a:b])):
            part, whole = r[other][a:b], r[other]
            usual = float(np.hypot(np.nanstd(whole), np.nanmean(part)))  # the mean: on a steady circle nothing changes
            return float(np.nanstd(part)) / max(usual, 1e-300)
    return 0.0
