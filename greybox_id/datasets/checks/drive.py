"""Checks that a recording contains a drive: enough rows, in order, with motion that its steering explains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...base.numbers import number, percent, quantity
from ...base.shorthands import Array
from ...base.signals import SD
from ...base.statistics import white_noise_sd
from ..recording import Recording
from ..spins import span, spins, without_spins
from .finding import Finding, FoundAt, Severity, file_row, listed
from .frozen import check_frozen
from .pairs import smooth
from .relations import SMOOTHING, thinned

FEWEST_ROWS, SHORTEST = 80, 2.0
"""Fewest rows and s of a recording: intervals of a fit rest on the scatter between eight blocks of ten rows (`fitting/
uncertainty/sandwich.py`), and prediction errors are evaluated up to two seconds ahead."""
MOVES = 1.5
"""Ratio of a channel's scatter to its high-frequency noise below which it is noise only: for white noise it is one."""
UNORDERED, TOGETHER, SLOWEST = 0.85, 0.7, 0.15
"""Row-to-row steps relative to white noise above which rows are uncorrelated; correlation between channels that noise
of two sensors does not reach; and the longest sample time in s at which a vehicle's rows are still correlated: a 1 Hz
oscillation then has a ratio of 0.6."""
CANNOT_JUMP = ("v_x", "v_y", "yaw_rate")
"""Channels with inertia; accelerations and commands may jump."""
ASLEEP, TIMES, JUMP, RANGE = 5, 3.0, 4.0, 0.2
"""A sensor is off for at least `ASLEEP` rows and `TIMES` the usual hold of readings. The jump at the end exceeds `JUMP`
times the largest of 200 usual steps and `RANGE` of the channel's range; a wheel that begins to turn jumps by 1 or 2 %
of its range."""
ON_ICE, USUAL, LAGS, LONG_ENOUGH = 0.5, 0.8, 1.0, 30.0
"""Share of yaw_rate that v_x · steer explains at the best delay up to `LAGS` s: vehicles have at least `ON_ICE` on ice
and `USUAL` elsewhere (0.93 in recordings inspected); two unrelated drives of `LONG_ENOUGH` s have less by chance.
Unrelated drives at the same few frequencies can have as much at one delay, but each frequency at another."""
SHIFTS, STANDS_OUT, AT_LEAST = 60, 6.0, 0.15
"""Number of time shifts of steer against yaw_rate; by how many standard deviations of the share explained at these
shifts the share at the true delay must exceed their mean if both are of one drive; and the least such share. Vehicles
that slide have 5 to 60 and .16 to .64; steer of another drive had at most 4.8, or a share of .06, in 70 drives."""
PUSHED = 0.5
"""Scatter of v_x · yaw_rate in m/s^2 above which steering turns the vehicle, not wind or camber."""


def check_drive(r: Recording) -> list[Finding]:
    """Findings about recordings that are too short, whose rows are out of order, or in which nothing moves."""
    measured = [name for name in ("v_x", "v_y", "yaw_rate", "a_x", "a_y") if r.has(name)]
    if not measured:
        return []
    if len(r) < FEWEST_ROWS or r.duration < SHORTEST:
        sentence = (
            f"{len(r)} rows ({number(r.duration, 2)} s) are too few to be checked, or to be fitted alone; at least "
            f"{FEWEST_ROWS} rows and {SHORTEST:g} s are needed. Record more."
        )
        return [Finding("short", Severity.WARNING, FoundAt("time"), sentence, r.duration, None, "s")]
    if together := _unordered(r):
        sentence = (
            f"{listed(together)} scatter from each row to the next as much as over the whole drive: the rows are out "
            "of order. Sort them by their time, or export the file again."
        )
        return [Finding("unordered", Severity.DISTRUST, FoundAt(", ".join(together)), sentence)]
    turning = [name for name in ("v_y", "yaw_rate", "a_y") if name in measured]
    still = [name for name in measured if not moves([r[name][start:stop] for start, stop in r.runs])]
    if len(still) == len(measured) or (turning and set(turning) <= set(still)):
        what = "moves" if len(still) == len(measured) else "turns"
        names = still if what == "moves" else turning
        sentence = (
            f"nothing {what}: {listed(names)} contain{'s' if len(names) == 1 else ''} only noise. No model of "
            f"{'this' if what == 'moves' else 'lateral'} motion can be fitted to this recording."
        )
        return [Finding("still", Severity.WARNING, FoundAt(", ".join(names)), sentence)]
    return _nothing_in_common(without_spins(r))  # tyres that slide do not follow the steering


def moves(parts: Sequence[Array]) -> bool:
    """Whether readings, one (n,) array per contiguous part, scatter by more than their high-frequency noise."""
    readings = np.concatenate([part[np.isfinite(part)] for part in parts])
    spread = float(np.std(readings)) if len(readings) else 0.0
    return spread > 0 and not spread < MOVES * white_noise_sd(parts, held=True)


def _unordered(r: Recording) -> list[str]:
    """Channels without correlation between consecutive rows, although they agree with each other in each row."""
    turns = {name: r[name] for name in ("yaw_rate", "a_y", "v_y") if r.has(name)}
    if r.has("v_x", "yaw_rate"):
        turns["yaw_rate"] = r["v_x"] * r["yaw_rate"]
    white = [name for name, values in turns.items() if _steps(r, values) > UNORDERED]
    if r.sample_time > SLOWEST or len(white) < 2:
        return []
    table = np.array([turns[name] for name in white])
    table = table[:, np.all(np.isfinite(table), axis=0)]
    if table.shape[1] < FEWEST_ROWS or not np.all(np.std(table, axis=1) > 0):
        return []
    agree = np.abs(np.corrcoef(table)) - np.eye(len(white))
    together = [name for name, most in zip(white, np.max(agree, axis=1), strict=True) if most > TOGETHER]
    return together + (["v_x"] if together and r.has("v_x") and _steps(r, r["v_x"]) > UNORDERED else [])


def _steps(r: Recording, values: Array) -> float:
    """Root mean square step between rows over that of white noise of the same scatter (root of von Neumann's ratio)."""
    steps = np.concatenate([np.diff(values[start:stop]) for start, stop in r.runs])
    steps, good = steps[np.isfinite(steps)], values[np.isfinite(values)]
    spread = float(np.std(good)) if len(good) else 0.0
    return float(np.sqrt(np.mean(steps**2) / 2.0)) / spread if len(steps) and spread > 0 else 0.0


def _nothing_in_common(r: Recording) -> list[Finding]:
    """A finding if steering does not explain the yaw rate, as if it were of another drive."""
    if not r.has("v_x", "yaw_rate", "steer"):
        return []
    short = thinned(r)
    if not len(short) or not short.sample_time > 0:
        return []
    apart = np.full(int(LAGS / short.sample_time) + 1, np.nan)  # so that no lag pairs rows of different runs
    if len(short) * short.sample_time < LONG_ENOUGH:
        return []

    def run_by_run(values: Array) -> Array:
        smoothed = smooth(short, values, SMOOTHING)
        return np.concatenate([part for a, b in short.runs for part in (smoothed[a:b], apart)])

    v, turn = short["v_x"], short["yaw_rate"]
    pace, steered, pushed, turn = (run_by_run(side) for side in (v, v * short["steer"], v * turn, turn))
    finite = np.isfinite(turn) & np.isfinite(steered)
    if np.mean(finite) < 0.5 or not np.std(pushed[finite]) > PUSHED or not np.std(steered[finite]) > 0:
        return []
    most = _explained(turn, [steered, pace**2 * steered], LAGS, short.sample_time)
    if most > USUAL or any({"steer", "yaw_rate"} & {item.where.channel} for item in check_frozen(r)):
        return []
    a_y = run_by_run(short["a_y"]) if short.has("a_y") else pushed
    both = finite & np.isfinite(a_y)
    agreed = np.count_nonzero(both) > FEWEST_ROWS and abs(np.corrcoef(a_y[both], pushed[both])[0, 1]) > TOGETHER
    blamed = "steer" if short.has("a_y") and agreed else "steer or yaw_rate"
    shares = f"v_x · steer explains at most {percent(max(most, 0.0))} of yaw_rate, at delays of up to {LAGS:g} s"
    if _stands_out(turn[finite], steered[finite], pace[finite], short.sample_time):
        sentence = (
            f"{shares}, though more than at other time shifts. The tyres slide for much of the drive, or steer is "
            "disturbed. Models of tyres that grip do not fit such a recording."
        )
        return [Finding("slides", Severity.WARNING, FoundAt("steer, yaw_rate"), sentence, most)]
    other = f"{blamed} was recorded on another drive, or its column holds something else"
    sentence = f"{shares}: " + (
        f"{other}, or the vehicle spins." if most < ON_ICE else f"the tyres slide throughout, or {other}."
    )
    severity = Severity.DISTRUST if most < ON_ICE else Severity.WARNING
    return [Finding("unrelated", severity, FoundAt("steer, yaw_rate"), sentence, most)]


def _stands_out(turn: Array, steered: Array, pace: Array, dt: float) -> bool:
    """Whether steering explains more of the yaw rate at its true delay than at shifts by seconds, as for a vehicle that
    slides at times. Sums of absolute errors give weight to the rows without sliding.
    """
    reach = int(LAGS / dt)
    if len(turn) < 10 * reach or not np.std(turn) > 0:
        return False

    def explained(shift: int) -> float:
        shifted = np.roll(steered, shift)
        table, weights = np.column_stack([shifted, pace**2 * shifted, np.ones(len(turn))]), np.ones((len(turn), 1))
        table /= np.maximum(np.sqrt(np.mean(table**2, axis=0)), 1e-300)
        residual = turn
        for _ in range(8):  # iteratively reweighted least squares converge to the least sum of absolute errors
            residual = np.abs(turn - table @ np.linalg.lstsq(table * weights, turn * weights[:, 0], rcond=1e-6)[0])
            weights = np.sqrt(1.0 / np.maximum(residual, 1e-3 * np.std(turn)))[:, None]
        return 1.0 - float(np.sum(residual) / np.sum(np.abs(turn - np.median(turn))))

    at_delay = max(explained(shift) for shift in range(0, reach // 2 + 1, max(1, reach // 10)))
    others = [explained(int(shift)) for shift in np.linspace(3 * reach, len(turn) - 3 * reach, SHIFTS)]
    return at_delay > AT_LEAST and bool(at_delay - np.mean(others) > STANDS_OUT * np.std(others))


def _explained(u: Array, columns: Sequence[Array], longest: float, dt: float) -> float:
    """Share of the variance of a series that others explain together at the best delay of up to `longest` s; the search
    ends once it exceeds `USUAL`.
    """
    table, best, reach = np.column_stack([*columns, np.ones(len(u))]), 0.0, min(int(longest / dt), len(u) // 4)
    for lag in sorted(range(-reach, reach + 1), key=abs):
        y, X = (u[lag:], table[: len(u) - lag]) if lag >= 0 else (u[:lag], table[-lag:])
        rows = np.isfinite(y) & np.all(np.isfinite(X), axis=1)
        y, X = y[rows], X[rows] / np.maximum(np.sqrt(np.mean(X[rows] ** 2, axis=0)), 1e-300)
        residual = y - X @ np.linalg.lstsq(X, y, rcond=1e-6)[0]
        best = max(best, 1.0 - float(np.sum(residual**2) / max(np.sum((y - y.mean()) ** 2), 1e-300)))
        if best > USUAL:
            break
    return best


def check_spins(r: Recording) -> list[Finding]:
    """Rows in which the vehicle spins."""
    if not (out := spins(r)):
        return []
    rows = tuple(row for a, b in out for row in range(a, b))
    sentence = (
        f"the vehicle spins {listed([span(r, a, b) for a, b in out])}. No model of handling describes these rows; "
        "`gap` leaves them out. Leave them out of a fit."
    )
    return [Finding("spins", Severity.WARNING, FoundAt("yaw_rate", rows=rows), sentence, len(rows) * r.sample_time,
                    None, "s")]  # fmt: skip


def check_asleep(r: Recording) -> list[Finding]:
    """Stretches in which the logger or a sensor was off: constant readings, then a jump of a channel with inertia."""
    off: dict[tuple[int, int], list[str]] = {}
    for name in CANNOT_JUMP:
        for stretch in _stretches(r, name) if r.has(name) else []:
            off.setdefault(stretch, []).append(name)
    findings = []
    for (a, b), jumped in sorted(off.items()):
        same = [name for name, values in r.signals.items() if not name.startswith(SD) and np.ptp(values[a:b]) == 0.0]
        others = [name for name in r.signals if not name.startswith(SD) and name not in same]
        if others and not all(r[name][a] == 0.0 for name in jumped):
            continue  # a single channel that repeats its last reading is stuck: `check_frozen` reports it
        where = f"row {file_row(r, a).split()[1].rstrip(',')} to {file_row(r, b - 1)}"
        reads = "exactly 0" if all(r[name][a] == 0.0 for name in same) else "the same in every row"
        sentence = (
            f"{listed(same)} {'are' if len(same) > 1 else 'is'} {reads} from t = {number(float(r.time[a]), 4)} to "
            f"{number(float(r.time[b - 1]), 4)} s ({where}), where {jumped[0]} jumps by "
            f"{quantity(_jump(r, jumped[0], a, b), r.unit(jumped[0]), 2)}: the logger or a sensor was off. "
            "Leave these rows out."
        )
        seconds = (b - a) * r.sample_time
        place = FoundAt(", ".join(same), rows=tuple(range(a, b)))
        findings.append(Finding("asleep", Severity.DISTRUST, place, sentence, seconds, None, "s"))
    return findings


def _jump(r: Recording, name: str, a: int, b: int) -> float:
    """The larger of the steps at both ends of rows [a, b), within runs."""
    begins = {start for start, _ in r.runs}
    ends = [k for k in (a, b) if 0 < k < len(r) and k not in begins]
    return max((abs(float(r[name][k] - r[name][k - 1])) for k in ends), default=0.0)


def _stretches(r: Recording, name: str) -> list[tuple[int, int]]:
    """Rows [a, b) in which a channel is constant and at whose ends it jumps."""
    values = r[name]
    good = values[np.isfinite(values)]
    if good.size < FEWEST_ROWS:
        return []
    same = np.concatenate([[False], np.diff(values) == 0.0])
    same[[start for start, _ in r.runs]] = False
    edges = np.flatnonzero(np.diff(same.astype(int), prepend=0, append=0))
    begins, ends = edges[::2] - 1, edges[1::2]
    lengths = ends - begins
    long = [int(k) for k in np.flatnonzero(lengths >= ASLEEP)]
    inside = np.ones(len(values) - 1, dtype=bool)
    inside[[start - 1 for start, _ in r.runs[1:]]] = False
    steps = np.abs(np.diff(values))[inside]
    steps = steps[np.isfinite(steps) & (steps > 0)]
    if not long or steps.size < FEWEST_ROWS // 2:
        return []
    low, high = np.quantile(good, [0.01, 0.99])
    least = max(JUMP * float(np.quantile(steps, 0.995)), RANGE * float(max(high - low, abs(high), abs(low))))
    result = []
    for k in long:
        a, b = int(begins[k]), int(ends[k])
        if not _jump(r, name, a, b) > least:
            continue
        others = np.delete(lengths, k)
        usual = float(np.quantile(others, 0.9)) if len(others) > 5 else 1.0
        if b - a >= TIMES * usual:
            result.append((a, b))
    return result
