"""The course of an effect that varies all the time, and how far the gap closes with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..datasets.recording import Recording
from .closed_model import with_effects
from .closing import closed_by
from .estimation.bench import Bench
from .estimation.free_runs import inliers, refitted_tolerances
from .estimation.hypothesis import Hypothesis
from .estimation.preparing import excerpt
from .estimation.variance import without_stale_rows
from .estimation.varying import PATH, MagnitudeCourse, Places, course, with_course
from .estimation.wandering import Wander, quietened
from .examining import Examined
from .gap import Closure


def courses(
    examined: Examined, best: Hypothesis, like: Sequence[Wander], held_out: Sequence[Recording]
) -> tuple[MagnitudeCourse, ...]:
    """The course of the effect that resembles the unexplained error most, if errors of free runs surely fall with it.

    Parameters
    ----------
    best : the causes.
    like : effects that resemble the unexplained error if they vary, likeliest first.
    held_out : recordings that chose nothing: a course along the path is verified where these pass the same places.
    """
    search, amplitudes = examined.selection.search, examined.amplitudes
    bench = search.bench
    if not like or amplitudes is None or not isinstance(bench, Bench):
        return ()
    wander = like[0]
    (axis,) = [
        item.candidate.axes[0] for item in examined.selection.expected_gains if item.candidate.effect == wander.effect
    ]
    places = Places.of(bench, excerpt(examined.recordings))
    quiet = quietened(amplitudes, examined.expected.median)
    try:
        likeliest = course(search, best, wander, axis, quiet, examined.sd, examined.good, places)
    except (np.linalg.LinAlgError, ValueError):  # derivatives overflow where the vehicle nearly spins
        return ()
    closure = _verified(examined, best, likeliest, held_out) if held_out and likeliest.along == PATH else None
    if closure is None:
        sd, good = examined.sd, examined.good
        before, after = with_course(search, examined.at_its_best(best), likeliest, axis.index, sd, good, places)
        names = tuple(recording.name for recording in examined.recordings)
        closure = closed_by(before, after, sd, inliers(after.e, good, bench), bench, names)
    if not closure.closed_interval[0] > 0:
        return ()
    apart = closure.recordings != tuple(recording.name for recording in examined.recordings)
    return (replace(likeliest, closed=closure.closed, closed_interval=closure.closed_interval,
                    recordings=closure.recordings, held_out=apart),)  # fmt: skip


def _verified(
    examined: Examined, best: Hypothesis, course: MagnitudeCourse, held_out: Sequence[Recording]
) -> Closure | None:
    """How far a course along the path closes the gap on held-out recordings; None if these have no positions."""
    effect, model, search = examined.effects[course.effect], with_effects(examined, best), examined.selection.search
    if effect.parameter.name not in model:
        model = model + effect.at(float(effect.parameter.array))
    there = [search.values(best), search.values(examined.at_its_best(best))]
    _, its, freed = refitted_tolerances(model, held_out, examined.vehicle, examined.effects, examined.sd, there)
    bench = its.bench
    assert isinstance(bench, Bench)
    places, good = Places.of(bench, excerpt(held_out)), without_stale_rows(bench)
    if not len(places.x):
        return None
    index = [parameter.name for parameter in bench.model.parameters].index(effect.parameter.name)
    before, after = with_course(its, freed, course, index, examined.sd, good, places)
    names = tuple(recording.name for recording in held_out)
    return closed_by(before, after, examined.sd, inliers(after.e, good, bench), bench, names)
