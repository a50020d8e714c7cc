"""Delays between channels, run by run."""

from __future__ import annotations

import numpy as np

from ...base.numbers import short_with_sd
from ..recording import Recording
from .finding import Finding, FoundAt, Severity, listed
from .lag import Lag, estimate_lag
from .pairs import Pair
from .values import ZERO_SHARE, zero_share

SIGNIFICANT = 4.0
"""Standard errors: a disagreement is looked for among many runs and pairs, chance must not find one."""
DISAGREEMENT = 0.5
"""Samples by which a run's delay may differ from the others' before no one model can fit both."""
RESPONSE_SHARE = 0.25
"""The vehicle's own response lies between steering and yaw rate, and its lag varies with the manoeuvre by up to a
quarter; only what goes beyond is put down to the recording."""
LIKE_SPEED = 2.0
"""That lag grows with speed: only runs whose mean speeds lie within this factor are compared."""
MANY, MANY_RUNS = 0.25, 8
"""Where more than a quarter of 8 runs or more lie apart, no run is odd: the delay as such is not one number."""
WORTH_TELLING = 0.5
"""Samples of a delay between two ways to the same quantity that a fit should be told of."""
OF_HELD_COMMANDS = 0.5
"""Samples that commands held from row to row put between a reading and the difference of readings about it."""
BLUNT = "The steering signal has a dead zone, which delays it as well."
PRECISE = 0.5
"""Samples of uncertainty above which a delay is not told."""


def check_delays(recording: Recording, pairs: list[Pair]) -> list[Finding]:
    """Delays of each pair, and runs whose delay differs from the others'."""
    findings: list[Finding] = []
    for pair in pairs:
        lags = run_lags(recording, pair)
        if lags:
            findings += _usual(pair, lags, recording.sample_time)
            findings += _disagreements(recording, pair, lags)
    return findings


def run_lags(recording: Recording, pair: Pair) -> dict[int, Lag]:
    """Delay of the pair's left side after its right side for each run in which it can be told: run number -> lag."""
    if pair.lag_smoothing is None:
        return {}
    dt = recording.sample_time
    lags = {}
    for number, (start, stop) in enumerate(recording.runs, 1):
        left, right = pair.left_values[start:stop], pair.right_values[start:stop]
        lag = estimate_lag(left, right, dt, pair.lag_smoothing)
        if lag is not None and lag.error < max(PRECISE, 0.01 / dt):
            lags[number] = lag
    return lags


def _usual(pair: Pair, lags: dict[int, Lag], dt: float) -> list[Finding]:
    delays = np.array([lag.samples for lag in lags.values()])
    errors = np.array([lag.error for lag in lags.values()])
    usual = float(np.median(delays))
    weights = 1 / errors**2
    error = float(max(1 / np.sqrt(weights.sum()), 1.25 * np.std(delays) / np.sqrt(len(delays))))
    ms = 1000 * dt
    findings = []
    if not pair.kinematic or (abs(usual) > WORTH_TELLING and abs(usual) > SIGNIFICANT * error):
        verb = "lags" if usual >= 0 else "leads"
        runs = f"median of {len(lags)} runs" if len(lags) > 1 else f"run {next(iter(lags))}"
        why = (
            "the vehicle's response included" if not pair.kinematic else "both are the same quantity: shift one of them"
        )
        sentence = (
            f"{pair.left} {verb} {pair.right} by {short_with_sd(abs(usual), error)} samples "
            f"({short_with_sd(abs(usual) * ms, error * ms)} ms; {runs}), {why}."
        )
        apart = pair.kinematic and abs(usual) > WORTH_TELLING + OF_HELD_COMMANDS
        severity = Severity.WARNING if apart else Severity.NOTE
        findings.append(Finding("delay", severity, FoundAt(pair.nodes[0]), sentence, usual * dt, error * dt, "s"))
    return findings


def _disagreements(recording: Recording, pair: Pair, lags: dict[int, Lag]) -> list[Finding]:
    """Runs whose delay differs from that of most others they can be compared with."""
    dt = recording.sample_time
    ms = 1000 * dt
    odd: dict[int, tuple[float, float]] = {}
    compared: dict[int, list[int]] = {}
    for number, lag in lags.items():
        likes = [n for n in lags if n != number and (pair.kinematic or _alike(recording, n, number))]
        others = [lags[n] for n in likes]
        apart = np.array([lag.samples - other.samples for other in others])
        errors = np.array([np.hypot(lag.error, other.error) for other in others])
        allowed = [
            DISAGREEMENT if pair.kinematic else max(DISAGREEMENT, RESPONSE_SHARE * abs(o.samples)) for o in others
        ]
        differs = (np.abs(apart) > allowed) & (np.abs(apart) > SIGNIFICANT * errors)
        if len(others) >= min(2, len(lags) - 1) and np.count_nonzero(differs) > len(others) / 2:
            middle = int(np.argsort(apart)[len(apart) // 2])
            odd[number], compared[number] = (float(apart[middle]), float(errors[middle])), likes
    if len(lags) == 2 and odd:
        odd = {max(odd): odd[max(odd)]}  # two runs disagree with each other: say it once
    blunt = not pair.kinematic and zero_share(recording, "steer") > ZERO_SHARE
    if len(lags) >= MANY_RUNS and len(odd) > MANY * len(lags):
        return [_scattered(pair, lags, odd, dt)]
    like = "in other runs" if pair.kinematic else "in runs of like speed"
    findings = []
    for number, (distance, error) in sorted(odd.items()):
        lag = lags[number]
        elsewhere = [f"{lags[n].samples:.2f} in run {n}" for n in compared[number]]
        sentence = (
            f"run {number}: {pair.left} lags {pair.right} by {short_with_sd(lag.samples, lag.error)} samples "
            f"({short_with_sd(lag.samples * ms, lag.error * ms)} ms), but {like} by {listed(elsewhere, 5)}: "
            f"it is {short_with_sd(abs(distance) * ms, error * ms)} ms off their median. "
        )
        sentence += BLUNT if blunt else "No model with one delay fits both; estimate it for each run."
        where = FoundAt(pair.nodes[0], number)
        severity = Severity.WARNING if blunt else Severity.DISTRUST
        findings.append(Finding("run_delay", severity, where, sentence, distance * dt, error * dt, "s"))
    return findings


def _alike(recording: Recording, a: int, b: int) -> bool:
    speeds = [float(np.nanmean(np.abs(recording["v_x"][slice(*recording.runs[n - 1])]))) for n in (a, b)]
    return max(speeds) < LIKE_SPEED * min(speeds)


def _scattered(pair: Pair, lags: dict[int, Lag], odd: dict[int, tuple[float, float]], dt: float) -> Finding:
    low, high = (choose(lags, key=lambda number: lags[number].samples) for choose in (min, max))
    ms = 1000 * dt
    ends = [f"{short_with_sd(ms * lags[n].samples, ms * lags[n].error)} ms in run {n}" for n in (low, high)]
    sentence = (
        f"the delay of {pair.left} after {pair.right} differs from run to run, from {ends[0]} to {ends[1]}; "
        f"{len(odd)} of {len(lags)} runs lie apart from the rest. "
    )
    if pair.kinematic:
        sentence += "Both are the same quantity: the clocks of the two channels do not run together."
    else:
        sentence += "With so many it is the vehicle's response or a dead zone in the steering rather than the clock."
    severity = Severity.DISTRUST if pair.kinematic else Severity.WARNING
    apart, error = odd[max(odd, key=lambda number: abs(odd[number][0]))]
    return Finding("run_delay", severity, FoundAt(pair.nodes[0]), sentence, apart * dt, error * dt, "s")
