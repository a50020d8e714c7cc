"""Checks of single channels: missing, constant, clipped, held or outlying values.

Checks of the clock: joins, gaps, time that runs backwards or stands still, irregular sampling.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from ...base.numbers import exact, number, quantity, with_unit
from ...base.shorthands import Array, Index
from ...base.signals import ANGLES_AROUND, COMMANDS, SIGNALS
from ...base.statistics import median_of_five, moving_maximum
from ..recording import Recording
from .finding import Finding, FoundAt, Severity, file_row, file_rows, listed, runs_words
from .pairs import smooth, standard

NEEDED = ("v_x", "v_y", "yaw_rate", "a_x", "a_y", "steer", "motor_current", "drive_force")
"""Channels that models use as inputs or are fitted to: missing values in them affect the result."""
TURNING = ("steer", "yaw_rate", "a_y", "v_y", "yaw", "sideslip")
"""Channels that change together when the vehicle turns."""
LEAST_MOTION, LEAST_TURN = 0.05, 0.5
"""Smallest change of a channel's mean over MOTION_SECONDS that counts as motion, in rad/s, m/s, m/s^2 or rad; and of
yaw in rad, since no vehicle drives straight on for ever ..."""
MOTION_SECONDS, NOISE_LEFT = 1.0, 5.0
"""... and this many times the noise of that mean: steps that are noise alone average out."""
HELD_SHARE = 0.2
"""Share of exact repeats without noise above which the channel is updated more slowly than rows are recorded."""
ZERO_SHARE = 0.2
CLIP_COUNT = 8
CLIP_RATIO = 5
"""Samples at the extreme level over those at the next ones: a stop collects many, noise has fewer towards extremes."""
SPIKE_LOCAL = 6.0
"""An outlier deviates from a running median by this many times the largest other deviation nearby ..."""
SPIKE_GLOBAL = 4.0
"""... and this many times the 99th percentile of deviations in the whole channel. Noise stays below 2.5 in both."""
SPIKE_RANGE = 0.1
"""... and at least a tenth of the channel's usual range: smaller ones do no harm."""
SPIKE_END = 1.0
"""... but the whole usual range in the first and last row of a run, which have a neighbour on one side only."""

FAR_OFF = 3.0
"""Distance of a placeholder number from all other values, in units of their range."""


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
    tail = f", while {listed(moving)} var{'y' if moving[1:] else 'ies'}: the channel is dead." if dead else "."
    sentence = f"{name} is {with_unit(exact(value, 6), recording.unit(name))} in every row{tail}"
    return Finding(
        "dead" if dead else "constant",
        Severity.DISTRUST if dead and name in NEEDED else Severity.WARNING if dead else Severity.NOTE,
        FoundAt(name), sentence, value, unit=recording.unit(name),
    )  # fmt: skip


def _moves(recording: Recording, name: str) -> bool:
    """Whether a channel shows motion of the vehicle: more than noise, offsets and road camber."""
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
        sentence += f"a dead zone or a one-sided sensor, since {' and '.join(awake)} varies in these rows."
    else:
        sentence += "a dead zone, an unused input, or a sensor without updates."
    severity = Severity.WARNING if awake or name not in COMMANDS else Severity.NOTE
    return [Finding("dead_zone", severity, FoundAt(name), sentence, share)]


def zero_share(recording: Recording, name: str) -> float:
    """Share of rows in motion in which a signal is exactly zero."""
    driving = _driving(recording)
    return float(np.mean(recording[name][driving] == 0.0)) if driving.any() else 0.0


def _held(recording: Recording, name: str, values: Array) -> list[Finding]:
    steps, repeats = _steps(recording, name, values)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], repeats.astype(int), [0]])))
    longest = int(np.max(edges[1::2] - edges[::2], initial=0))  # excluded: one long hold is a stuck channel
    if steps.size - longest < 20:
        return []
    share = float(np.count_nonzero(repeats) - longest) / (steps.size - longest)
    if share < HELD_SHARE:
        return []
    rate = (1 - share) / recording.sample_time
    sentence = (
        f"{name} repeats {100 * share:.0f} % of its samples exactly: its sensor gives about {exact(rate)} new values "
        "a second, "
        f"and the {exact(1 / recording.sample_time)} Hz of the recording hold each of them."
    )
    severity = Severity.WARNING if name in NEEDED and name not in COMMANDS else Severity.NOTE
    return [Finding("held", severity, FoundAt(name), sentence, share)]


def _steps(recording: Recording, name: str, values: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Steps within runs while the vehicle moves, and a mask of exact repeats; steps between zeros are left out."""
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
        ("larger", levels[-1], counts[-1], counts[-4:-1]), ("smaller", levels[0], counts[0], counts[1:4])
    ):  # fmt: skip
        if len(levels) < 20 or level == 0.0 or count < CLIP_COUNT or count < CLIP_RATIO * below.max():
            continue
        stretches = int(np.count_nonzero(np.diff((values == level).astype(int), prepend=0) == 1))
        if stretches < 2:
            continue  # a single stretch is a standstill or a long hold
        unit = recording.unit(name)
        sentence = (
            f"{name} reads exactly {with_unit(exact(level, 4), unit)} in {count} rows ({stretches} stretches of the "
            f"recording) and is never {end}: "
        )
        sentence += "the command is at its limit." if name in COMMANDS else "it is clipped there."
        severity = Severity.NOTE if name in COMMANDS else Severity.WARNING
        rows = tuple(np.flatnonzero(values == level).tolist())
        findings.append(Finding("clipped", severity, FoundAt(name, rows=rows), sentence, float(level), unit=unit))
    return findings


def check_placeholders(recording: Recording) -> list[Finding]:
    """Placeholder numbers for missing readings, such as -9999: repeated exactly, and far from all other values."""
    findings = []
    for name, values in recording.signals.items():
        for level, rows in placeholders(values, CLIP_COUNT):
            sentence = (
                f"{name} reads exactly {with_unit(exact(level, 4), recording.unit(name))} in {rows.size} rows, far "
                f"from all others: probably a code for a missing reading. State the file's number under 'missing' in "
                f"the column map, or leave these rows out ({file_rows(recording, rows)})."
            )
            where = FoundAt(name, rows=tuple(rows.tolist()))
            findings.append(Finding("placeholder", Severity.DISTRUST, where, sentence, level))
    return findings


def placeholders(values: Array, fewest: int) -> list[tuple[float, Index]]:
    """Extreme values of a channel that occur in at least `fewest` rows, far from all others; and their rows."""
    result = []
    levels, counts = np.unique(values[np.isfinite(values)], return_counts=True)
    for level, count, others in ((levels[:1], counts[:1], levels[1:]), (levels[-1:], counts[-1:], levels[:-1])):
        if len(others) < 20 or level[0] == 0.0 or count[0] < fewest:
            continue
        if np.min(np.abs(others - level)) > FAR_OFF * np.ptp(others):
            result.append((float(level[0]), np.flatnonzero(values == level)))
    return result


def outlying(recording: Recording, name: str) -> Finding | None:
    """Finding about values of a signal that deviate from their neighbours for a sample or two; None without any."""
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
        # The median mirrors the series at the ends, so that a spike in the first row of a run is detected as well.
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


RESTART_SECONDS = 1.0
"""Time that falls by less than this, and by fewer than RESTART_SAMPLES, is not a new recording: rows are unordered."""
RESTART_SAMPLES = 20
JITTER_SHARE = 0.05
"""Scatter of steps relative to the usual step above which delays are blurred by as much."""
BROKEN_SHARE = 0.02
"""Share of rows that begin a run above which runs have under 50 rows: that is irregular sampling, not a join."""

STEPS = (5e-5, 2.0)
"""Plausible sample times of a vehicle's recording, s: 20 kHz to one reading in two seconds."""
UNITS = (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9), ("min", 60.0), ("h", 3600.0), ("day", 86_400.0))
"""Units in which time may be recorded although it is declared as seconds, and their size in s."""
USUAL_STEPS, MIDDLE_STEP = (0.5e-3, 1.0), 0.02
"""Range of sample times in s for a suggested unit; of several, the one whose step is nearest to the second is named."""


def sample_time_believable(step: float) -> bool:
    """Whether a sample time in s is plausible for a vehicle's recording."""
    return bool(STEPS[0] <= step <= STEPS[1])


def check_time(recording: Recording) -> list[Finding]:
    """Findings about the time column."""
    time, dt = recording.time, recording.sample_time
    findings: list[Finding] = []
    missing = np.flatnonzero(~np.isfinite(time))
    if missing.size:
        sentence = f"time is missing or not finite in {missing.size} rows ({file_rows(recording, missing)})."
        findings.append(_clock("missing", Severity.DISTRUST, sentence, missing, float(missing.size)))
    if not np.isfinite(dt) or dt <= 0:
        sentence = "time never increases from one row to the next; check which column holds it."
        return [*findings, _clock("still", Severity.DISTRUST, sentence, np.arange(0))]
    if not sample_time_believable(dt):
        findings.append(_unit_of_time(dt))
    return [*findings, *_uneven_steps(recording, bool(missing.size)), *_jitter(recording, dt)]


def _unit_of_time(dt: float) -> Finding:
    """The finding that time steps as no recording's does, with the unit for which it would."""
    believable = {item: dt * size for item, size in UNITS if USUAL_STEPS[0] <= dt * size <= USUAL_STEPS[1]}
    likely = min(believable, key=lambda item: abs(np.log(believable[item] / MIDDLE_STEP)), default="")
    remedy = f'as if it were in {likely}: set unit = "{likely}"' if likely else "check its unit"
    sentence = (
        f"time steps by {exact(dt)} s from row to row ({exact(1 / dt)} Hz), a rate at which no vehicle's motion is "
        f"recorded; {remedy} under [time] in the column map."
    )
    return Finding("time_scale", Severity.DISTRUST, FoundAt("time"), sentence, dt, None, "s")


def _uneven_steps(recording: Recording, missing: bool) -> list[Finding]:
    """Findings about rows that do not follow the one before in the usual step; `missing` if some have no time."""
    time, dt, findings = recording.time, recording.sample_time, list[Finding]()
    starts = [] if recording.source.where else [start for start, _ in recording.runs[1:]]  # a condition makes gaps
    steps = {row: float(time[row] - time[row - 1]) for row in starts if np.isfinite(time[row - 1 : row + 1]).all()}
    still = [row for row, step in steps.items() if step == 0]
    back = _set_back(recording, steps)
    disordered = [
        r for r, s in steps.items() if r not in back and s < 0 and -s < RESTART_SECONDS and -s < RESTART_SAMPLES * dt
    ]
    gaps = [row for row, step in steps.items() if step > 1.5 * dt]
    joins = [row for row in steps if row not in {*still, *disordered, *gaps, *back}]
    if still:
        severity = Severity.DISTRUST if len(still) > BROKEN_SHARE * len(recording) else Severity.WARNING
        sentence = f"time stands still at {file_rows(recording, still)}; remove the doubled rows."
        findings.append(_clock("still", severity, sentence, still, float(len(still))))
    if disordered:
        most = max(-steps[row] for row in disordered)
        sentence = (
            f"time runs backwards by up to {number(most)} s at {file_rows(recording, disordered)}, too little for a "
            "new recording: rows are out of order. Sort them, or write the file again."
        )
        findings.append(_clock("backwards", Severity.DISTRUST, sentence, disordered, most, "s"))
    if back and len(back) <= BROKEN_SHARE * len(recording):
        findings.append(_clock_set_back(recording, back, even=not (gaps or disordered or still or missing)))
    if gaps and len(gaps) <= BROKEN_SHARE * len(recording):
        longest = max(gaps, key=lambda row: steps[row])
        sentence = (
            f"time jumps ahead at {file_rows(recording, gaps)}; the longest gap is {number(steps[longest])} s "
            f"(usual step {exact(dt)} s). A new run begins after each gap."
        )
        findings.append(_clock("gap", Severity.WARNING, sentence, gaps, steps[longest], "s"))
    if len(starts) > BROKEN_SHARE * len(recording):
        sentence = (
            f"sampling is irregular: {len(starts)} of {len(recording)} rows do not follow the one before in the usual "
            f"step of {exact(dt)} s. Export it again with its true clock, or resample it with greybox data convert."
        )
        findings.append(_clock("irregular", Severity.DISTRUST, sentence, starts, len(starts) / len(recording)))
    elif joins:
        findings.append(_joins(recording, joins, steps))
    return findings


def _set_back(recording: Recording, steps: dict[int, float]) -> dict[int, float]:
    """Rows at which the clock was set back, and by how many s: stamps repeat, while measured signals continue smoothly.

    Rows out of order have no repeated stamps. At the start of another recording, readings jump.
    """
    time, dt = recording.time, recording.sample_time
    if not any(step < 0 for step in steps.values()) or np.min(np.diff(np.sort(time[np.isfinite(time)]))) > 0.5 * dt:
        return {}
    starts = {stop: start for start, stop in recording.runs}
    inside = np.setdiff1d(np.arange(1, len(time)), [start for start, _ in recording.runs])
    return {
        row: dt - step
        for row, step in steps.items()
        if step < 0 and time[row] > time[starts[row]] and _goes_on(recording, row, inside)
    }


def _goes_on(recording: Recording, row: int, inside: Index) -> bool:
    """Whether no signal changes more at this row than between the rows `inside` contiguous runs."""
    for values in recording.signals.values():
        changes = np.abs(np.diff(values, prepend=np.nan))
        usual = changes[inside][np.isfinite(changes[inside])]
        if usual.size and changes[row] > np.max(usual):
            return False
    return True


def _clock_set_back(recording: Recording, back: dict[int, float], even: bool) -> Finding:
    """`even` : whether all other rows follow each other in the usual step."""
    rows, dt = list(back), recording.sample_time
    by = number(max(back.values()), 2)
    where = file_row(recording, rows[0]) if len(rows) == 1 else file_rows(recording, rows)
    sentence = f"the clock was set back by {'' if len(rows) == 1 else 'up to '}{by} s at {where}, and readings go on. "
    sentence += "The rows are in order: do not sort them. A new run begins there; no repair is needed."
    if even:
        sentence += (
            f" If no row is missing, write rate = {exact(1 / dt, 4)} in place of [time] in the column map: all rows "
            "are then one run."
        )
    return _clock("set_back", Severity.WARNING, sentence, rows, max(back.values()), "s")


def _joins(recording: Recording, joins: list[int], steps: dict[int, float]) -> Finding:
    restarts = [row for row in joins if steps[row] < 0]
    what = "time restarts" if restarts else "a new run begins"
    if len(joins) == 1:
        place = f"at {file_row(recording, joins[0])}"
    elif len(joins) <= 12:
        place = f"at {file_rows(recording, joins)}"
    else:
        place = f"at {len(joins)} places"
    sentence = f"several recordings are joined: {what} {place}. Each begins a new run."
    severity = Severity.WARNING if restarts else Severity.NOTE
    return _clock("join", severity, sentence, joins, float(len(joins)))


def _jitter(recording: Recording, dt: float) -> list[Finding]:
    result = {}
    for run, (start, stop) in enumerate(recording.runs, 1):
        if stop - start > 10:
            scatter = float(np.std(np.diff(recording.time[start:stop]))) / dt
            if scatter > JITTER_SHARE:
                result[run] = scatter
    if not result:
        return []
    worst = max(result, key=lambda run: result[run])
    sentence = (
        f"the step of time scatters by {100 * result[worst]:.0f} % of {exact(dt)} s in run {worst}"
        f"{f' (also in {runs_words(n for n in result if n != worst)})' if len(result) > 1 else ''}: "
        "delays cannot be estimated more finely than that."
    )
    return [Finding("jitter", Severity.WARNING, FoundAt("time", worst), sentence, result[worst])]


def _clock(
    kind: str, severity: Severity, sentence: str, rows: object, value: float | None = None, unit: str = "1"
) -> Finding:
    return Finding(
        kind, severity, FoundAt("time", rows=tuple(np.asarray(rows, dtype=int).tolist())), sentence, value, unit=unit
    )


SMALL = 0.05
"""Resampling error relative to the signal's scatter above which a finding is a warning, not a note."""
QUESTION = re.compile(r'^\s*#\?\s*(\w+)\s*=\s*\{\s*column\s*=(?!\s*"\.\.\.")', re.MULTILINE)
"""An open question in a proposed map: a commented signal with a column; one without a column is only an offer."""


def check_reading(recording: Recording) -> list[Finding]:
    """Findings about resampled signals, and the notes from reading the file."""
    findings = [Finding("reading", Severity.NOTE, FoundAt("file"), note) for note in recording.notes]
    findings += _open_questions(recording)
    for name, how in recording.resampled.items():
        unit = recording.unit(name)
        what = "interpolated linearly" if how.method == "linear" else "with each reading held until the next"
        sentence = f"recorded at {exact(how.rate, 4)} Hz on the clock of {how.clock} and resampled, {what}. "
        if not np.isfinite(how.error):
            sentence += "There are too few readings to estimate the error of resampling."
            findings.append(Finding("resampled", Severity.WARNING, FoundAt(name), sentence))
            continue
        values = recording[name][np.isfinite(recording[name])]
        scatter = float(np.std(values)) if values.size else 0.0
        sentence += (
            f"Resampling adds an error of {quantity(how.error, unit, 2)} (root mean square, estimated; at most "
            f"{number(how.largest, 2)}). The standard deviation of {name} itself is {quantity(scatter, unit, 2)}."
        )
        severity = Severity.NOTE if how.error <= SMALL * scatter else Severity.WARNING
        findings.append(Finding("resampled", severity, FoundAt(name), sentence, how.error, None, unit))
    return findings


def _open_questions(recording: Recording) -> list[Finding]:
    """A finding about signals that the column map leaves open."""
    text = recording.source.column_map
    names = [name for name in dict.fromkeys(QUESTION.findall(text)) if name in SIGNALS and name not in recording]
    if not names:
        return []
    sentence = (
        f"the column map does not yet state the column or unit of {listed(names)}. Choose one of the lines that "
        "begin with #? and remove its #?, or delete all these lines."
    )
    return [Finding("question", Severity.WARNING, FoundAt(names[0]), sentence, float(len(names)))]
