"""How far a gap closes: errors before and after, over those that noise alone would leave.

Stated tolerances are refitted in both, and both are charged for them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..base.numbers import the_recordings
from ..base.shorthands import Array, Mask
from ..base.signals import unit_of
from ..base.statistics import resampled
from ..datasets.recording import Recording
from ..engine.simulation import Diagnosed, FreeRuns
from ..fitting.scores.horizons import Errors, diverges
from ..models.effect import Effect
from ..models.vehicle import Vehicle
from .estimation.calibration import CAL
from .estimation.free_runs import Misfit, inliers, refitted_tolerances
from .estimation.noise import blocks, stated_noise
from .estimation.variance import without_stale_rows
from .gap import Closure


def closure(
    before: Diagnosed,
    after: Diagnosed,
    recordings: Sequence[Recording],
    vehicle: Vehicle | None,
    effects: Mapping[str, Effect],
    sd: Array | None = None,
    as_it_stands: Diagnosed | None = None,
) -> Closure:
    """How far a gap closes on recordings that chose nothing.

    Parameters
    ----------
    before, after : the model as stated, and with effects at their magnitudes.
    recordings, vehicle, effects, sd : as of `refitted_tolerances`.
    as_it_stands : `after` with other tolerances, at which refits begin; None: its own.
    """
    there = {one.name: float(one.array) for one in (as_it_stands or after).parameters if one.shape == ()}
    then, search, _ = refitted_tolerances(after, recordings, vehicle, effects, sd, [there])
    first, bench = then, search.bench
    if after is not before:
        there |= then.values
        first, _, _ = refitted_tolerances(before, recordings, vehicle, effects, sd, [there], then.trust)
    noise, known = stated_noise(bench, vehicle, then.e)
    sd = noise if known or sd is None else sd
    good = inliers(then.e, without_stale_rows(bench), bench) & np.isfinite(first.e)
    return closed_by(first, then, sd, good, bench, tuple(recording.name for recording in recordings))


def closed_by(before: Misfit, after: Misfit, sd: Array, good: Mask, bench: FreeRuns, names: tuple[str, ...]) -> Closure:
    """The closure from one misfit to another.

    Parameters
    ----------
    before, after : on the same readings.
    sd : (channels,) of noise.
    good : (N, channels) readings that count.
    bench, names : whose recordings these are, and their names.
    """
    count = max(int(np.sum(good)), 1)
    first, then = (np.sum(np.where(good, item.e / sd, 0.0) ** 2, axis=1) for item in (before, after))
    rows = np.sum(good, axis=1)
    edges = blocks(bench)
    sums = np.array([[np.sum(first[a:b]), np.sum(then[a:b]), np.sum(rows[a:b])] for a, b in edges])
    charges = np.array([before.charge, after.charge])
    E0, E1 = (float(np.sum(first)) + before.charge) / count, (float(np.sum(then)) + after.charge) / count
    floor = min(1.0, E1)  # noise is no larger than the errors

    def closed(E0: float, E1: float) -> float:
        return float((E0 - E1) / max(E0 - floor, CAL.least_gap))

    low, high = resampled(sums, lambda total: closed(*((total[:2] + charges) / total[2])), CAL.draws)
    errors = _errors(before, after, sd, good, bench)
    return Closure(E0, E1, floor, closed(E0, E1), (float(low), float(high)), names, errors)


def on_held_out(recordings: Sequence[Recording]) -> str:
    """Where a closure is verified, in words."""
    return the_recordings([item.name for item in recordings], "held-out")


def left_open(closure: Closure) -> Closure:
    """The closure where no effect is applied: errors stay as they were."""
    errors = tuple(replace(error, after=error.before) for error in closure.errors)
    before, none = closure.before, (0.0, 0.0)
    return replace(closure, after=before, floor=min(1.0, before), closed=0.0, closed_interval=none, errors=errors)


def _errors(before: Misfit, after: Misfit, sd: Array, good: Mask, bench: FreeRuns) -> tuple[Errors, ...]:
    """Free-run errors per channel."""
    result = []
    for c, channel in enumerate(bench.channels):
        counted = good[:, c]
        if np.any(counted):
            readings, free = bench.measured[counted, c], (each.e[counted, c] for each in (before, after))
            a, b = (np.inf if diverges(e, readings) else float(np.sqrt(np.mean(e**2))) for e in free)
            result.append(Errors(channel, unit_of(channel), None, a, b, float(sd[c])))
    return tuple(result)
