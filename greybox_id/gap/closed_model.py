"""The closed model: the nominal one with the effects that are causes, and with tolerances estimated."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..base.shorthands import Array
from ..base.statistics import correlation_time, robust_sd
from ..datasets.recording import Recording
from ..engine.motion.shooting import MotionProblem
from ..engine.motion.simulator import Simulator
from ..engine.simulation import Diagnosed
from ..engine.solvers.gauss_newton import Status, gauss_newton
from ..fitting.attempt import LEAST_NOISE, ROUGH
from ..fitting.scores.horizons import Errors, Squares, between, mean_squares
from ..models.effect import Effect
from ..models.motion_model import MotionModel
from .closing import closure
from .estimation.axes import ActingRows
from .estimation.calibration import CAL
from .estimation.hypothesis import Hypothesis
from .estimation.preparing import excerpt, thinned, with_priors
from .examining import Examined
from .gap import Budget, Closure, Moved

WORSE = "held-out errors are larger with it, unless all parameters are refitted too"
HARMS = "held-out errors are larger with it, whether or not the other parameters are refitted"


def closed_model(
    examined: Examined, best: Hypothesis, detected: bool, held_out: Sequence[Recording], shared: Budget | None = None
) -> tuple[Diagnosed, Closure | None, str]:
    """The closed model, how far it closes the gap on held-out recordings, and why its effects are no causes, if so.

    There are several candidates for its tolerances: as stated, as estimated with the effects, and as fitted to free
    runs. The one with the smallest errors on held-out recordings is taken; without these, on the diagnosed ones. That
    choice is all that held-out recordings decide: the share that closes is computed with tolerances refitted to them,
    and does not depend on it. Fits begin at the estimates; where they end worse than as stated, again at the stated
    values.

    Parameters
    ----------
    best : the causes.
    detected : whether there is a gap: without one, the model is the nominal one; if that errs as its numbers are
        stated, though tolerances explain the error, it may have the estimated tolerances.
    held_out : recordings that chose no effect.
    shared : the causes' budget, if known: it has refitted tolerances to the held-out recordings already.
    """
    added, nominal = with_effects(examined, best), with_effects(examined, best, set())
    everything = with_priors(added, examined.effects, examined.vehicle) if isinstance(added, MotionModel) else added
    simulator = Simulator(everything) if isinstance(everything, MotionModel) else None
    ways, fitted = [added], list[MotionModel]()
    if detected or _errs_as_stated(examined):
        moved = _moved_along(examined, best, added)
        fitted = _fitted(examined, best, moved, simulator) if detected else []
        ways += [moved, *fitted]
    judges = list(held_out) or excerpt(_as_they_end(examined, best))
    errors = list[tuple[Errors, ...]]()
    if held_out or len(ways) > 1:

        def squares(model: Diagnosed) -> Squares:
            same = model if simulator is None else _among(everything, model, examined.effects)
            return mean_squares(same, judges, simulator)

        before = squares(nominal)

        def err(ways: Sequence[Diagnosed]) -> list[tuple[Errors, ...]]:
            return [between(added.outputs, before, squares(model), examined.sd) for model in ways]

        errors = err(ways)
        if fitted and _least(errors) == 0:  # fits began where simulations need unknown forces
            again = _fitted(examined, best, added, simulator)
            ways, errors = [*ways, *again], [*errors, *err(again)]
    least = _least(errors)
    closed = ways[least]
    if not held_out:
        return closed, None, ""
    verified = shared.together if shared is not None else None
    if verified is None:
        verified = closure(
            nominal, added, held_out, examined.vehicle, examined.effects, examined.sd, as_it_stands=closed
        )
    verified = replace(verified, errors=errors[least])
    if best.candidates and _size(verified.errors, "after") > _size(verified.errors, "before"):
        return closed, verified, WORSE
    if best.candidates and verified.shows and verified.closed_interval[1] < 0:
        return closed, verified, HARMS
    return closed, verified, ""


def _errs_as_stated(examined: Examined) -> bool:
    """Whether free runs of the model at its stated numbers exceed noise."""
    bench = examined.bench
    e = (bench.simulate(bench.model.values[None])[0] - bench.measured) / examined.sd
    return bool(np.mean(e[examined.good] ** 2) > 1.0 + CAL.shows) if np.any(examined.good) else False


def with_effects(examined: Examined, best: Hypothesis, present: Collection[str] | None = None) -> Diagnosed:
    """The model with a hypothesis' effects at their magnitudes; tolerances keep their stated values.

    Parameters
    ----------
    present : those of them that act, while the others stay at their null or tolerance; None: all of them. The equations
        do not depend on which act, so that they share a compiled kernel.
    """
    model = examined.model
    for candidate, at in best.parts:
        effect = examined.effects[candidate.effect]
        acts = present is None or candidate.effect in present
        acts = acts and (candidate.part is None or candidate.part.lasts)  # the model is for after the recordings
        values = [axis.value(float(m)) for axis, m in zip(candidate.axes, best.m[at], strict=True)]
        if effect.parameter.name not in model:
            model = model + effect.at(values[0] if acts else float(effect.parameter.array))
        if acts:
            names = [axis.name for axis in candidate.axes]
            model = model.with_parameters(
                *(replace(model[n].with_value(v), fixed=True) for n, v in zip(names, values, strict=True))
            )
    return model


def _as_they_end(examined: Examined, best: Hypothesis) -> list[Recording]:
    """The recordings from where all effects that begin or end have done so: the closed model is of that vehicle."""
    first, row = max(
        (place_of(examined, candidate.part)[::2] for candidate in best.candidates if candidate.part is not None),
        default=(0, 0),
    )
    partly, *whole = examined.recordings[first:]
    return [partly.rows(row, len(partly)), *whole]


def place_of(examined: Examined, part: ActingRows) -> tuple[int, int, int]:
    """Index of the recording and of its run in which an effect begins or ends, and the row of the recording."""
    at = part.until if part.since is None else part.since
    assert at is not None
    holding = [  # names need not be unique, and times may start anew
        (k, n, start + int(np.searchsorted(recording.time[start:stop], at)))
        for k, recording in enumerate(examined.recordings)
        if recording.name == part.recording
        for n, (start, stop) in enumerate(recording.runs)
        if recording.time[start] <= at <= recording.time[stop - 1]
    ]
    return next((item for item in holding if item[1] == part.run - 1), holding[0])  # excerpts number their runs anew


def _moved_along(examined: Examined, best: Hypothesis, closed: Diagnosed) -> Diagnosed:
    """The closed model with the tolerances that were estimated together with its effects."""
    search = examined.selection.search
    p, entry = search.vector(best), {axis.index for axis in best.axes}
    moved = [axis for axis in search.moving if axis.name in examined.model and axis.index not in entry]
    at = {axis.name: float(np.clip(p[axis.index], *closed[axis.name].bounds)) for axis in moved}  # curves have none
    return closed.with_parameters(*(closed[name].with_value(value) for name, value in at.items()))


def _among(everything: Diagnosed, model: Diagnosed, effects: Mapping[str, Effect]) -> Diagnosed:
    """A model as the one with more effects, these at their nulls: both then share a compiled kernel."""
    more = [effects[name].parameter for name in everything.effects if name not in model.effects]
    return everything.with_parameters(
        *(everything[each.name].with_value(each.array) for each in (*more, *model.parameters))
    )


def _fitted(examined: Examined, best: Hypothesis, begin: Diagnosed, simulator: Simulator | None) -> list[MotionModel]:
    """A closed model fitted to free runs: its tolerances, or these and the causes' magnitudes.

    Magnitudes were estimated beside unknown forces and with linearised tolerances: where a vehicle's file is far off,
    all parameters must move together.

    Parameters
    ----------
    simulator : of the model with priors.
    """
    if simulator is None or not isinstance(begin, MotionModel):
        return []
    with_prior = with_priors(begin, examined.effects, examined.vehicle)
    with_prior = with_prior.with_parameters(
        *(with_prior[parameter.name].with_value(parameter.array) for parameter in begin.parameters)
    )
    freed = [replace(with_prior[axis.name], fixed=False) for axis in best.axes if axis.low < axis.high]
    ways = [item for item in (with_prior, *([with_prior.with_parameters(*freed)] if freed else []))
            if not all(parameter.fixed for parameter in item.parameters)]  # fmt: skip
    if not ways:
        return []
    simulator.kernel.prepare()
    noise, recordings = _counted(examined, best), excerpt(thinned(_as_they_end(examined, best)))
    ended = list[MotionModel]()
    for way in ways:
        problem = MotionProblem(simulator.of(way), recordings, noise=noise, robust=CAL.far_reading, about=way.values)
        solution = gauss_newton(problem, problem.unknowns(way.values), tolerance=ROUGH, search="levenberg_marquardt")
        if solution.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        if np.isfinite(solution.objective):
            ended.append(way.with_values(problem.shared(solution.x)))
    return ended


def _counted(examined: Examined, best: Hypothesis) -> Array:
    """(outputs,) sd of readings in free runs: spread of errors, times the root of their correlation time."""
    freed, counted = examined.at_its_best(best), []
    for good, e in zip(examined.good.T, freed.e.T, strict=True):
        spread = robust_sd(e[good]) if np.any(good) else 1.0
        alike = correlation_time(np.where(good, e, 0.0)[:, None])
        counted.append(max(spread, LEAST_NOISE) * float(np.sqrt(alike)))
    return np.array(counted)


def moved(examined: Examined, best: Hypothesis, closed: Diagnosed) -> tuple[Moved, ...]:
    """Tolerances that a closed model has more than a standard deviation from their stated values; furthest first."""
    known, causes = [], {axis.name for axis in best.axes}
    for parameter in with_priors(examined.model, examined.effects, examined.vehicle).parameters:
        name, prior = parameter.name, parameter.prior
        if parameter.fixed or prior is None or parameter.shape != () or name not in closed or name in causes:
            continue
        mean = parameter.array if prior.mean is None else prior.mean
        stated, sd, value = (float(np.asarray(each)) for each in (mean, prior.sd, closed[name].array))
        one = Moved(name, parameter.unit, stated, sd, value)
        if one.far > 1.0:
            known.append(one)
    return tuple(sorted(known, key=lambda each: -each.far))


def _least(errors: Sequence[tuple[Errors, ...]]) -> int:
    """Index of the way with the smallest errors; the first where none is known."""
    return min(range(len(errors)), key=lambda k: _size(errors[k], "after"), default=0)


def _size(errors: Sequence[Errors], when: str) -> float:
    """Mean square of errors over all horizons and channels, in units of their floors."""
    squares = [(getattr(each, when) / each.floor) ** 2 for each in errors if each.floor > 0]
    return float(np.mean(squares)) if squares else 0.0
