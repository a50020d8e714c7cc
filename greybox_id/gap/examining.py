"""The numbers of a diagnosis, before it is worded: refits, their weights, and signs of something unknown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from ..base.errors import BadInput
from ..base.shorthands import Array
from ..datasets.checks.finding import listed
from ..datasets.recording import Recording
from ..engine.simulation import Diagnosed, FreeRuns
from ..models.effect import Effect
from ..models.vehicle import Vehicle
from .beginning import as_it_acts, with_beginnings
from .closing import closed_by
from .estimation.axes import candidates, nuisances, shifting
from .estimation.bench import Bench
from .estimation.calibration import CAL
from .estimation.causes import causes
from .estimation.constancy import Spread, orders_of, unsteadiness, varies
from .estimation.free_runs import at_their_best, inliers, misfit
from .estimation.hold import explained_otherwise, otherwise
from .estimation.hypothesis import Hypothesis, by_cost
from .estimation.model_error import (
    AmplitudePrior,
    Amplitudes,
    ForceSizes,
    ModelError,
    amplitude_prior,
    estimated,
    linearised,
    model_error,
)
from .estimation.noise import Whitener, colour, stated_noise, white_noise, without_spikes
from .estimation.observer import PULLED
from .estimation.preparing import Prepared, excerpt, prepare, with_direction
from .estimation.problem import JointProblem
from .estimation.search import Search
from .estimation.together import JointSearch, JointWhitening
from .estimation.unknown_forces import knows_unknown_forces
from .estimation.variance import (
    Scatter,
    dropped,
    jitters,
    jumps_by_commands,
    repeats,
    scatter_probability,
    sole_jitter,
    without_stale_rows,
)
from .estimation.wandering import Wander, wandering
from .evidence import Evidence, by_plain_errors, costs, evidence, heaviest, tempering
from .gap import Closure, Unnamed
from .regimes import signals
from .selection import Selection, select
from .unknown import Signs, driving_gain_where_it_acts, excess_ratio, signs, strained_shares, unnamed

TINY = 1e-12
MOVING = ("steering", "drive", "tyres", "body", "road")
"""Groups of effects that move the vehicle: a sensor's varying effect is its slow error."""


@dataclass(frozen=True)
class Examined:
    """Everything a diagnosis computes, before it is put in words.

    Attributes
    ----------
    prepared, bench, selection, evidence : what was simulated, refitted and weighed.
    best : the hypothesis of largest weight; the base where nothing outweighs it.
    sd, noise_stated : (channels,) sensor noise, and whether it was stated.
    good : (N, channels) readings that count.
    inexact : whether equations are inexact: tolerances are stated, or networks replace them.
    scatter : effects on the scatter of readings, each with the probability that it is present.
    closed : how far the gap closes on these recordings.
    signs : of something unknown.
    seen, y : signals that define regimes, and readings as the best hypothesis predicts them.
    unnamed : remaining model error; None for models without unknown forces.
    freed : by effects' names, hypotheses with tolerances refitted to free runs: base, best and others on request; see
        `at_its_best`.
    amplitudes, expected : of the remaining model error, and their prior.
    stands : whether free runs with the best hypothesis do not spin; where they do, no effect is trusted.
    """

    model: Diagnosed
    recordings: tuple[Recording, ...]
    effects: Mapping[str, Effect]
    vehicle: Vehicle | None
    prepared: Prepared
    bench: FreeRuns
    selection: Selection
    evidence: Evidence
    best: Hypothesis
    sd: Array
    noise_stated: bool
    good: NDArray[np.bool_]
    inexact: bool
    scatter: Mapping[str, tuple[Scatter, float]]
    closed: Closure
    signs: Signs
    seen: Mapping[str, Array]
    y: Array
    unnamed: Unnamed | None
    freed: dict[frozenset[str], Hypothesis]
    amplitudes: Amplitudes | None
    expected: AmplitudePrior
    stands: bool = True

    def at_its_best(self, hypothesis: Hypothesis) -> Hypothesis:
        """A hypothesis with its tolerances refitted to free runs."""
        names = frozenset(hypothesis.names)
        if names not in self.freed:
            (self.freed[names],) = at_their_best(self.selection.search, [hypothesis], self.sd, self.good)
        return self.freed[names]

    def closes(self, hypothesis: Hypothesis) -> Closure:
        """How far the gap closes on these recordings with a hypothesis: the best one, or some of its effects."""
        if hypothesis is self.best:
            return self.closed
        search = self.selection.search
        before, then = (misfit(search, self.at_its_best(item)) for item in (self.selection.base, hypothesis))
        good = inliers(then.e, self.good, self.bench)
        return closed_by(before, then, self.sd, good, self.bench, self.closed.recordings)

    @cached_property
    def resembles(self) -> tuple[Wander, ...]:
        """Effects whose magnitudes, if they varied all the time, would produce the remaining error."""
        search, bench = self.selection.search, self.bench
        if self.amplitudes is None or not isinstance(bench, Bench):
            return ()
        axes = {item.candidate.effect: item.candidate.axes[0] for item in self.selection.expected_gains}
        requested = [
            (name, axis) for name, axis in axes.items() if not axis.abrupt and self.effects[name].group in MOVING
        ]
        p = search.vector(self.best)
        return wandering(bench, p, self.best.e, self.good, self.amplitudes, self.expected, self.sd, requested)

    @cached_property
    def varying(self) -> Mapping[str, Spread]:
        """How the magnitudes of the best explanation's effects differ between parts of the recordings."""
        if self.unnamed is None:  # for models without unknown forces, `unknown` weighs it already
            return {}
        return varies(self.selection.search, self.best, self.seen)

    @cached_property
    def strained_shares(self) -> Mapping[str, float]:
        """Effect of the best explanation -> share of its action that strained tolerances produce as well."""
        return strained_shares(self.selection.search, self.best)

    @cached_property
    def driving_gains(self) -> Mapping[str, float]:
        """Effect of the best explanation -> log-likelihood that driving still explains where it acts."""
        return driving_gain_where_it_acts(self.selection.search, self.best, self.seen)


def examine(
    model: Diagnosed,
    recordings: Sequence[Recording],
    effects: Mapping[str, Effect],
    vehicle: Vehicle | None,
    tell: Callable[..., None],
) -> Examined:
    """Refit and weigh the hypotheses that may explain recordings.

    Where no column map states how commands run between rows, they run as that explains more: `Examined.recordings` say.
    """
    if (seconds := sum(recording.duration for recording in recordings)) < CAL.least_seconds:
        raise BadInput(
            f"{recordings[0].name} lasts {seconds:.2g} s: too short to show what a simulation lacks. Name recordings "
            f"of {CAL.least_seconds:g} s at least; half a minute is usual."
        )
    given = (effects, vehicle)
    examined, rows = excerpt(recordings), sum(len(recording) for recording in recordings)
    vehicle, effects = with_direction(vehicle, effects, model, recordings)
    prepared = prepare(model, examined, effects, vehicle)
    tell(
        f"simulating {model.name} with {len(prepared.effects)} candidate effects on the recording"
        f"{'s' if len(recordings) > 1 else ''} {listed([one.name for one in recordings])}"
    )
    if (count := sum(len(item) for item in examined)) < rows:
        tell(f"examining {count} of {rows} rows, in blocks spread evenly")
    bench = prepared.bench(examined)
    timing = shifting(prepared.everything)
    tolerated = nuisances(prepared.everything, effects, timing)
    possible = candidates(prepared.everything, prepared.effects, timing)
    start = np.where(bench.counted, bench.simulate(bench.model.values[None])[0] - bench.measured, 0.0)
    sd, noise_is_stated = stated_noise(bench, vehicle, start)
    stale = dropped(repeats(bench))
    good = without_spikes(start, without_stale_rows(bench), bench.rows)
    tell(f"refitting {len(tolerated)} parameters with tolerances and candidate effects")
    inexact = bench.learnt or any(not axis.abrupt for axis in tolerated)
    forces = isinstance(bench, Bench) and knows_unknown_forces(bench.model)
    tempered = inexact and not forces
    search = Search(bench, tolerated, white_noise(sd, good, bench.rows), tempering(int(np.sum(good)), tempered))
    stated_error = vehicle.model_error if vehicle is not None else {}
    prior = amplitude_prior(sd, noise_is_stated, not inexact, stated_error)
    whiten = _whitener(bench, good, prior, sd)
    cost = costs(forces, possible)
    # zones of indifference are no part of the joint problem: its causes have spikes instead
    tolerances = [axis for axis in tolerated if not axis.narrow]
    possible_causes = causes(prepared.everything, prepared.effects, timing, tolerances, bench.sample_time, inexact)
    problem = JointProblem(bench, tolerances, possible_causes, good)
    observer = _kept_from_spinning(problem) if spins(bench, start, good) else None
    stands = partial(_stands, observer, good)
    together = JointSearch(problem, JointWhitening(problem, sd, prior, forces, search.trust), tell)
    selection = select(together, tolerated, cost, _unsteadiness, search.trust, partial(stands, bench))
    search, likeliest = selection.search, min((*selection.tried, selection.base), key=by_cost)
    if explained_otherwise(search, likeliest, prepared, examined):
        tell("commands that run the other way between rows explain the recordings better: examining them so")
        stated = [replace(recording, hold_stated=True) for recording in otherwise(recordings)]
        return examine(model, stated, *given, tell)
    if stands(bench, search.vector(likeliest)):
        selection = with_beginnings(selection, possible, whiten, cost)
    if bench.learnt:
        selection = by_plain_errors(selection, sd, good)
    least = min((selection.base, *selection.tried), key=by_cost)
    (freed,) = at_their_best(search, (least,), sd, good) if tempered else (least,)
    left = float(np.mean((freed.e / sd)[good] ** 2)) - 1.0 if noise_is_stated and np.any(good) else 0.0  # else unknown
    seen = signals(selection.search.bench, np.where(bench.counted, least.e + bench.measured, 0.0))
    unsteady = partial(_unsteadiness, selection.search) if forces else None
    weighed = evidence(selection, tempered, cost, left, unsteady)
    best = heaviest(selection, weighed)
    search = as_it_acts(selection.search, best)
    if selection.beside and not best.names:  # the base outweighs what nuisances were linearised beside
        search.about(best)
    selection, bench = replace(selection, search=search), search.bench
    sd, noise_is_stated = stated_noise(bench, vehicle, best.e)
    if not noise_is_stated:  # the residuals of the best explanation are the best estimate of noise
        squares = np.where(good, best.e, 0.0) ** 2
        sd = np.sqrt(np.sum(squares, axis=0) / np.maximum(np.sum(good, axis=0), 1)) + TINY
    expected = amplitude_prior(sd, noise_is_stated, not inexact, stated_error)
    amplitudes, left_over = _left(bench, search, best, sd, good, expected)
    jump = jumps_by_commands(bench, search.vector(best), effects)
    if best.candidates and jitters(bench, selection.base.e, best.e, sd, good, jump):
        best = selection.base
        weighed = replace(weighed, weights=(*[0.0] * len(selection.tried), 1.0))
    y = np.where(bench.counted, best.e + bench.measured, 0.0)
    ways = {frozenset(item.names): item for item in (selection.base, best)}
    freed_ways = dict(zip(ways, at_their_best(search, list(ways.values()), sd, good), strict=True))
    before, then = (misfit(search, freed_ways[frozenset(item.names)]) for item in (selection.base, best))
    closed = closed_by(
        before, then, sd, inliers(then.e, good, bench), bench, tuple(recording.name for recording in recordings)
    )
    scatter = {} if stale is None else {"dropped_samples": (stale, scatter_probability(weighed.temper * stale.gain))}
    jittered, after, leaves = sole_jitter(bench, best.e, y, sd, good, jump), closed.after, 1.0
    if jittered is not None:
        present = scatter_probability(jittered.gain)  # not tempered: model error does not scatter from row to row
        scatter["timestamp_jitter"] = (jittered, present)
        after = jittered.left if present > CAL.present else after
        if present > CAL.present:
            leaves = float(np.clip((after - 1.0) / max(closed.after - 1.0, TINY), 0.0, 1.0))
    scattered = sum(item.gain for item, present in scatter.values() if present > CAL.present)
    alone = CAL.excess_learnt if bench.learnt else CAL.excess_inexact if inexact else CAL.excess_exact
    beyond = leaves * excess_ratio(then.e, y, sd, good, bench.channels, alone, inexact)
    signs_of_unknown = signs(
        search, selection.base, best, closed.before, after, beyond, seen, scattered, _alone(selection, best)
    )
    return Examined(
        model, tuple(recordings), effects, vehicle, prepared, bench, selection, weighed, best, sd, noise_is_stated,
        good, inexact, scatter, closed, signs_of_unknown, seen, y, left_over, freed_ways, amplitudes, expected,
        stands(bench, search.vector(best)),
    )  # fmt: skip


def _unsteadiness(search: Search, hypothesis: Hypothesis) -> list[float]:
    """Of each effect of a hypothesis, how its magnitude differs between parts of the drive."""
    bench = search.bench
    orders = orders_of(signals(bench, np.where(bench.counted, hypothesis.e + bench.measured, 0.0)), len(bench.measured))
    return [unsteadiness(search, hypothesis, orders, k) for k in range(len(hypothesis.candidates))]


def _whitener(
    bench: FreeRuns, good: NDArray[np.bool_], prior: AmplitudePrior, sd: Array
) -> Callable[[Search, Hypothesis | None], Whitener]:
    """How residuals are whitened: by unknown forces where the model has them, else as autoregressive processes."""
    if not isinstance(bench, Bench) or not knows_unknown_forces(bench.model):
        return lambda search, item: (
            white_noise(sd, good, bench.rows) if item is None else colour(item.e, good, bench.rows)
        )
    sizes = ForceSizes(bench)

    def whiten(search: Search, hypothesis: Hypothesis | None) -> Whitener:
        if hypothesis is None:
            p = search.moved(np.array([axis.mean for axis in search.moving]))
            return model_error(linearised(bench, p, sd, sizes), prior.median, good)
        assert isinstance(search.bench, Bench)  # another one where an effect acts in part of the rows
        about = linearised(search.bench, search.vector(hypothesis), sd, sizes)
        return model_error(about, estimated(about, hypothesis.e, good, prior), good)

    return whiten


def _left(
    bench: FreeRuns, search: Search, best: Hypothesis, sd: Array, good: NDArray[np.bool_], prior: AmplitudePrior
) -> tuple[Amplitudes, Unnamed] | tuple[None, None]:
    """Model error that remains beside a hypothesis; None for models without unknown forces."""
    if not isinstance(bench, Bench) or not knows_unknown_forces(bench.model):
        return None, None
    near = search.whitener.amplitudes if isinstance(search.whitener, ModelError) else None
    about = linearised(bench, search.vector(best), sd, ForceSizes(bench))
    amplitudes = estimated(about, best.e, good, prior, near)
    return amplitudes, unnamed(search, best, amplitudes, prior.median, about)


def _alone(selection: Selection, best: Hypothesis) -> float:
    """Sum of what each effect of a pair gains by itself over the base; zero where that is not known."""
    singles = {item.names[0]: selection.base.cost - item.cost for item in selection.of(1)}
    if len(best.names) != 2 or not set(best.names) <= set(singles):
        return 0.0
    return max(sum(singles[name] for name in best.names), TINY)


def spins(bench: FreeRuns, e: Array, good: NDArray[np.bool_]) -> bool:
    """Whether errors of the yaw rate exceed the yaw rate: derivatives of such a simulation are useless.

    Parameters
    ----------
    bench : what was measured.
    e, good : (N, channels) errors of the nominal simulation, and readings that count.
    """
    if "yaw_rate" not in bench.channels:
        return False
    at = bench.channels.index("yaw_rate")
    rows = good[:, at]
    return bool(np.any(rows) and np.mean(e[rows, at] ** 2) > np.mean(bench.measured[rows, at] ** 2))


def _kept_from_spinning(problem: JointProblem) -> int | None:
    """Raise the yaw rate observer's rate until the nominal simulation does not spin; its index, if there is one.

    Without it derivatives are useless, and a search that follows them selects whatever stops the spin.
    """
    name, names = PULLED.format("yaw_rate"), [parameter.name for parameter in problem.bench.model.parameters]
    if name not in names:
        return None
    at = names.index(name)
    for rate in CAL.observer_rates:
        problem.nominal[at] = rate
        if not spins(problem.bench, problem.residuals([problem.nominal])[0], problem.good):
            break
    return at


def _stands(observer: int | None, good: NDArray[np.bool_], bench: FreeRuns, p: Array) -> bool:
    """Whether free runs with these parameters do not spin without the observer, if the search needed one."""
    if observer is None:
        return True
    p = p.copy()
    p[observer] = 0.0
    y = bench.simulate(p[None])[0]
    return not spins(bench, np.where(bench.counted, y - bench.measured, 0.0), good)
