"""Are the values to be trusted: missing, frozen at zero, clipped, held, spiked."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...base.numbers import exact, quantity, with_unit
from ...base.shorthands import Array
from ...base.signals import ANGLES_AROUND, COMMANDS
from ...base.windows import median_of_five, moving_maximum
from ..recording import Recording
from .agreement import standard
from .finding import Finding, FoundAt, Severity, file_rows
from .pairs import smooth

NEEDED = ("v_x", "v_y", "yaw_rate", "a_x", "a_y", "steer", "motor_current", "drive_force")
"""Channels that models are driven by or fitted to: a hole in one of them is a hole in the result."""
TURNING = ("steer", "yaw_rate", "a_y", "v_y", "yaw", "sideslip")
"""When one of these moves, the others move with it."""
LEAST_MOTION, LEAST_TURN = 0.05, 0.5
"""rad/s, m/s, m/s^2 or rad by which a channel's mean over MOTION_SECONDS must change before it counts as moving, and
rad by which yaw must, for no vehicle drives straight on for ever ..."""
MOTION_SECONDS, NOISE_LEFT = 1.0, 5.0
"""... and so many times what its noise leaves of it: steps that are noise alone average out."""
HELD_SHARE = 0.2
"""Noise-free repeats in more than a fifth of the steps: the channel is updated more slowly than the rows say."""
ZERO_SHARE = 0.2
CLIP_COUNT = 8
CLIP_RATIO = 5
"""A stop collects many samples at the very extreme; noise has ever fewer towards it, quantised or not."""
SPIKE_LOCAL = 6.0
"""A spike is this many times larger than the largest other departure from a running median nearby ..."""
SPIKE_GLOBAL = 4.0
"""... and than the 99th percentile of such departures in the whole channel. Clean noise stays below 2.5 in both."""
SPIKE_RANGE = 0.1
"""... and at least a tenth of the channel's usual range: smaller ones do no harm."""
SPIKE_END = 1.0
"""... but the whole usual range in the first and last row of a run, which have a neighbour on one side only."""


def check_values(recording: Recording) -> list[Finding]:
    """Findings about single channels."""
    findings: list[Finding] = []
    for name, values in recording.signals.items():
        good = values[np.isfinite(values)]
        findings += _missing(recording, name, values)
        if good.size < 3:
            continue
        if np.ptp(good) == 0.0:
            findings.append(_constant(recording, name, float(good[0])))
            continue
        findings += [*_zeros(recording, name, values), *_held(recording, name, values)]
        findings += [*_clipped(recording, name, values), *_spikes(recording, name, values)]
    return findings


def _missing(recording: Recording, name: str, values: Array) -> list[Finding]:
    rows = np.flatnonzero(~np.isfinite(values))
    if not rows.size:
        return []
    severity = Severity.DISTRUST if name in NEEDED else Severity.WARNING
    what = "all" if rows.size == len(values) else f"{rows.size} of {len(values)}"
    sentence = f"{name} is missing or not finite in {what} rows ({file_rows(recording, rows)})."
    return [Finding("missing", severity, FoundAt(name, rows=tuple(rows.tolist())), sentence, float(rows.size))]


def _constant(recording: Recording, name: str, value: float) -> Finding:
    moving = [n for n in TURNING if n != name and _moves(recording, n)] if name in TURNING else []
    if name == "v_x" and value == 0.0:
        moving = [n for n in ("yaw_rate", "a_y", "a_x", "x") if _moves(recording, n)]
    elif name == "a_x" and _moves(recording, "v_x"):
        moving = ["v_x"]
    elif name == "steer" and (value != 0.0 or ("yaw_rate" in recording and "yaw_rate" not in moving)):
        moving = []  # a circle at constant steering angle is a manoeuvre; straight ahead, side wind and camber move a_y
    dead = bool(moving)
    tail = f" while {', '.join(moving)} moves: the channel is dead." if dead else "."
    sentence = f"{name} is {with_unit(exact(value, 6), recording.unit(name))} in every row{tail}"
    return Finding(
        "dead" if dead else "constant",
        Severity.DISTRUST if dead and name in NEEDED else Severity.WARNING if dead else Severity.NOTE,
        FoundAt(name), sentence, value, unit=recording.unit(name),
    )  # fmt: skip


def _moves(recording: Recording, name: str) -> bool:
    """Whether a channel says that the vehicle does something: more than noise, offsets and road camber."""
    if name not in recording or not recording.sample_time > 0:
        return False
    values = recording[name].copy()
    for start, stop in recording.runs if name in ANGLES_AROUND else ():
        if np.isfinite(values[start:stop]).all():
            values[start:stop] = np.unwrap(values[start:stop])
    slow = smooth(recording, values, MOTION_SECONDS)
    slow = slow[np.isfinite(slow)]
    steps = np.diff(values[np.isfinite(values)])
    least = LEAST_TURN if name in ANGLES_AROUND else LEAST_MOTION
    if slow.size < 3 or not slow.max() - slow.min() > least:
        return False
    noise = 1.48 * float(np.median(np.abs(steps))) / np.sqrt(2 * max(MOTION_SECONDS / recording.sample_time, 1.0))
    return bool(np.std(slow) > NOISE_LEFT * noise)


def _zeros(recording: Recording, name: str, values: Array) -> list[Finding]:
    share, zero = zero_share(recording, name), values == 0.0
    if share < ZERO_SHARE:
        return []
    sentence = f"{name} is exactly 0 in {100 * share:.0f} % of the rows while the vehicle moves: "
    others = [n for n in recording.signals if n != name and recording.unit(n) == recording.unit(name)]
    awake = [n for n in others if np.mean(recording[n][zero] != 0) > 0.5 and _correlation(values, recording[n]) > 0.9]
    if awake:
        sentence += f"a dead zone, or a one-sided sensor, as {' and '.join(awake)} keeps moving there."
    else:
        sentence += "a dead zone, an unused input, or a sensor without updates."
    severity = Severity.WARNING if awake or name not in COMMANDS else Severity.NOTE
    return [Finding("dead_zone", severity, FoundAt(name), sentence, share)]


def zero_share(recording: Recording, name: str) -> float:
    """Share of the rows, while the vehicle moves, in which a signal is exactly zero."""
    driving = _driving(recording)
    return float(np.mean(recording[name][driving] == 0.0)) if driving.any() else 0.0


def _held(recording: Recording, name: str, values: Array) -> list[Finding]:
    steps, repeats = _steps(recording, name, values)
    if steps.size < 20 or repeats.mean() < HELD_SHARE:
        return []
    share = float(repeats.mean())
    rate = (1 - share) / recording.sample_time
    sentence = (
        f"{name} repeats {100 * share:.0f} % of its samples exactly: it is held between updates, "
        f"about {exact(rate)} new values a second in rows at {exact(1 / recording.sample_time)} Hz."
    )
    severity = Severity.WARNING if name in NEEDED and name not in COMMANDS else Severity.NOTE
    return [Finding("held", severity, FoundAt(name), sentence, share)]


def _steps(recording: Recording, name: str, values: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Steps within runs while the vehicle moves, and which are exact repeats; rests at exactly zero are left out."""
    inside = np.ones(len(values) - 1, dtype=bool)
    inside[[start - 1 for start, _ in recording.runs[1:]]] = False
    moving = _driving(recording)
    inside &= moving[1:] & moving[:-1] & np.isfinite(values[1:]) & np.isfinite(values[:-1])
    inside &= ~((values[1:] == 0.0) & (values[:-1] == 0.0))
    steps = np.diff(values, prepend=0.0)[1:][inside]
    return steps, steps == 0.0


def _driving(recording: Recording) -> NDArray[np.bool_]:
    if "v_x" not in recording:
        return np.ones(len(recording), dtype=bool)
    speed = np.abs(np.nan_to_num(recording["v_x"]))
    return speed > 0.05 * float(np.quantile(speed, 0.95))


def _clipped(recording: Recording, name: str, values: Array) -> list[Finding]:
    good = values[np.isfinite(values)]
    levels, counts = np.unique(good, return_counts=True)
    findings = []
    for end, level, count, below in (
        ("most", levels[-1], counts[-1], counts[-4:-1]), ("least", levels[0], counts[0], counts[1:4])
    ):  # fmt: skip
        if len(levels) < 20 or level == 0.0 or count < CLIP_COUNT or count < CLIP_RATIO * below.max():
            continue
        stretches = int(np.count_nonzero(np.diff((values == level).astype(int), prepend=0) == 1))
        if stretches < 2:
            continue  # one stretch is a vehicle at rest or a long hold
        unit = recording.unit(name)
        sentence = (
            f"{name} reads exactly {with_unit(exact(level, 4), unit)} in {count} rows, in {stretches} stretches, "
        )
        sentence += f"and never {end}: "
        sentence = sentence.replace("never most", "never more").replace("never least", "never less")
        sentence += "the command is at its stop." if name in COMMANDS else "it is clipped there."
        severity = Severity.NOTE if name in COMMANDS else Severity.WARNING
        rows = tuple(np.flatnonzero(values == level).tolist())
        findings.append(Finding("clipped", severity, FoundAt(name, rows=rows), sentence, float(level), unit=unit))
    return findings


def outlying(recording: Recording, name: str) -> Finding | None:
    """Values of a signal that stand out from their neighbours, each for a sample or two."""
    findings = _spikes(recording, name, recording[name])
    return findings[0] if findings else None


def _spikes(recording: Recording, name: str, values: Array) -> list[Finding]:
    departures = np.zeros(len(values))
    ends = np.zeros(len(values), dtype=bool)
    nearby = np.zeros(len(values))
    for start, stop in recording.runs:
        run = np.unwrap(values[start:stop]) if name == "yaw" else values[start:stop]
        if len(run) < 12 or not np.isfinite(run).all():
            continue
        # Mirrored at the ends: a spike in the first row of a run must show as well.
        departure = np.abs(run - median_of_five(run))
        departures[start:stop] = departure
        ends[[start, stop - 1]] = True
        sides = moving_maximum(departure, 21)
        nearby[start:stop] = np.maximum(_shifted(sides, 13), _shifted(sides, -13))
    usual = values[np.isfinite(values)]
    low, high = np.quantile(usual, [0.005, 0.995])
    least = np.where(ends, SPIKE_END, SPIKE_RANGE) * (high - low)
    floor = np.maximum(SPIKE_GLOBAL * float(np.quantile(departures, 0.99)), least)
    rows = np.flatnonzero((departures > floor) & (departures > SPIKE_LOCAL * nearby))
    if not rows.size:
        return []
    unit, time = recording.unit(name), recording.time
    where = [f"{quantity(values[r], unit, 4)} at t = {time[r]:.2f} s (run {_run(recording, int(r))})" for r in rows[:4]]
    more = f" and {rows.size - 4} more" if rows.size > 4 else ""
    plural = "values stand out from their" if rows.size > 1 else "value stands out from its"
    sentence = f"{name}: {rows.size} {plural} neighbours: {', '.join(where)}{more}; "
    sentence += f"{file_rows(recording, rows)}. Leave such rows out."
    numbers = {_run(recording, int(row)) for row in rows}
    place = FoundAt(name, numbers.pop() if len(numbers) == 1 else None, tuple(rows.tolist()))
    return [Finding("outlier", Severity.WARNING, place, sentence, float(rows.size))]


def _shifted(values: Array, by: int) -> Array:
    out = np.zeros_like(values)
    if by > 0:
        out[by:] = values[:-by]
    else:
        out[:by] = values[-by:]
    return out


def _run(recording: Recording, row: int) -> int:
    return next(number for number, (start, stop) in enumerate(recording.runs, 1) if start <= row < stop)


def _correlation(a: Array, b: Array) -> float:
    both = np.isfinite(a) & np.isfinite(b)
    (x, x_scale), (y, y_scale) = standard(a[both]), standard(b[both])
    return float(np.mean(x * y)) if x_scale and y_scale else 0.0
