"""Free runs with tolerances refitted to them: the error that remains, no tolerance explains.

Models before and after an effect are refitted and charged alike, so that a fitted nuisance never passes for a gap that
closed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from ...base.errors import BadInput
from ...base.shorthands import Array, Mask
from ...base.statistics import correlation_time, robust_sd
from ...datasets.recording import Recording
from ...engine.simulation import Diagnosed, FreeRuns
from ...engine.solvers.gauss_newton import least_within
from ...models.effect import Effect
from ...models.vehicle import Vehicle
from .axes import nuisances, shifting
from .calibration import CAL
from .hypothesis import Hypothesis, Start, by_cost
from .model_error import ModelError
from .noise import stated_noise, white_noise, without_spikes
from .preparing import excerpt, prepare_plain
from .refit import refit, settled
from .search import Search
from .variance import without_stale_rows


@dataclass(frozen=True)
class Misfit:
    """Errors of a model with its tolerances refitted.

    Attributes
    ----------
    e : (N, channels) prediction minus reading.
    charge : cost of the tolerances, twice their negative log prior.
    trust : how many independent readings one counted as.
    values : parameter -> its refitted value.
    cost : what the refit minimised; NaN where it is not known.
    """

    e: Array
    charge: float
    trust: float = 1.0
    values: Mapping[str, float] = field(default_factory=dict)
    cost: float = np.nan


def refitted_tolerances(
    model: Diagnosed,
    recordings: Sequence[Recording],
    vehicle: Vehicle | None,
    effects: Mapping[str, Effect],
    sd: Array | None = None,
    start_values: Sequence[Mapping[str, float]] = (),
    trust: float | None = None,
) -> tuple[Misfit, Search, Hypothesis]:
    """Errors of a model whose tolerances are refitted to recordings, the search, and the refitted hypothesis.

    Parameters
    ----------
    model : as stated, or with effects at their magnitudes.
    recordings : on which it is simulated.
    vehicle : its stated tolerances and sensor noise.
    effects : by name, for the vehicle's tolerances.
    sd : (channels,) noise where none is stated; None: estimated from what is faster than motion.
    start_values : parameter values from which tolerances are refitted, too; the best of all counts.
    trust : how many independent readings one counts as, if it has to be that of another model for comparison; None: by
        the errors that remain. Errors beyond noise are alike for a while: taken for noise, they would press every
        tolerance to its limit.
    """
    examined = excerpt(recordings)
    prepared = prepare_plain(model, examined, effects, vehicle)
    bench = prepared.bench(examined)
    tolerances = nuisances(prepared.everything, effects, shifting(prepared.everything))
    start = np.where(bench.counted, bench.simulate(bench.model.values[None])[0] - bench.measured, 0.0)
    if not np.all(np.isfinite(start)):
        raise BadInput(f"{model.name} diverges on {recordings[0].name}: check the numbers of the vehicle.")
    noise, known = stated_noise(bench, vehicle, start)
    sd = noise if known or sd is None else sd
    good = without_spikes(start, without_stale_rows(bench), bench.rows)
    search = Search(bench, tolerances, white_noise(sd, good, bench.rows), CAL.trusts[0])
    search.about(None)
    starts = [search.at_means(), *(map(search.at_values, start_values) if search.moving else ())]
    result, most = starts[0], 1.0
    for step in CAL.trusts if tolerances else CAL.trusts[-1:]:
        search.trusting(min(step, most))
        tried = list[Hypothesis]()
        for begin in starts:
            search.about(begin)
            for each in refit(search, _starts_about(search, begin)):
                tried += [each, settled(search, each)]
        if tried:  # none where derivatives leave the range of numbers
            result = min(tried, key=by_cost)
            starts, most = [result], _independent_share(result.e / sd, good) if trust is None else trust
    if not np.isfinite(result.cost):  # wherever it was refitted: as stated it is within the range
        return Misfit(start, 0.0), search, replace(result, e=start)
    freed = replace(misfit(search, result), trust=search.trust, values=search.values(result), cost=result.cost)
    return freed, search, result


def _starts_about(search: Search, begin: Hypothesis) -> list[Start]:
    """Starts at a hypothesis, and the same with linear nuisances at their prior means.

    Where the vehicle nearly spins, their estimates may not suit derivatives that are taken anew.
    """
    at_means = Start((), begin.m, begin.theta, search.means[len(begin.theta) :])
    same = np.array_equal(begin.linear, at_means.linear)
    return [search.start_of(begin), *([] if same else [at_means])]


def _independent_share(e: Array, good: Mask) -> float:
    """How many independent readings one counts as: noise is new in each, errors beyond it are correlated."""
    if not np.any(good):
        return 1.0
    beyond = robust_sd(e[good]) ** 2 - 1.0  # robust, since a few spins are not typical
    return 1.0 / (1.0 + beyond * correlation_time(np.where(good, e, 0.0))) if beyond > 0 else 1.0


def misfit(search: Search, hypothesis: Hypothesis) -> Misfit:
    """Errors that a hypothesis leaves, and the charge of its nuisances."""
    return Misfit(hypothesis.e, search.charge(hypothesis))


def inliers(e: Array, good: Mask, bench: FreeRuns) -> Mask:
    """(N, channels) readings whose errors are far from outliers: a few larger ones would weigh as much as a gap."""
    return without_spikes(e, good, bench.rows, CAL.far_reading)


def at_their_best(search: Search, hypotheses: Sequence[Hypothesis], sd: Array, good: Mask) -> list[Hypothesis]:
    """Hypotheses with tolerances refitted to free runs, magnitudes held: the error that remains, no tolerance explains.

    Where unknown forces whiten residuals, free runs may drift as far as these allow; how far a gap closes is a question
    about free runs themselves. Tolerances then move far, and are linearised again.
    """
    if not isinstance(search.whitener, ModelError):
        if search.trust == 1.0:
            return list(hypotheses)
        trust = search.trust
        search.trusting(1.0)
        result = [_refitted(search, hypothesis) for hypothesis in hypotheses]
        search.trusting(trust)
        return result
    with search.counted(white_noise(sd, good, search.bench.rows)):
        return [_settled(search, hypothesis) for hypothesis in hypotheses]


def _settled(search: Search, hypothesis: Hypothesis) -> Hypothesis:
    """A hypothesis with its nuisances refitted and linearised again about their estimates, magnitudes held."""
    best = _refitted(search, replace(hypothesis, cost=np.inf))
    for _ in range(CAL.freed_again if search.moving or search.shifts else 0):
        search.about(best, delays=False)
        again = _refitted(search, best)
        settled = again.cost > (1 - CAL.freed_enough) * best.cost
        best = min(best, again, key=by_cost)
        if settled:
            break
    return best


def _refitted(search: Search, hypothesis: Hypothesis) -> Hypothesis:
    """A hypothesis with nuisances refitted, its magnitudes held."""
    held = []
    for candidate, at in hypothesis.parts:
        axes = (
            replace(axis, low=float(m), high=float(m)) for axis, m in zip(candidate.axes, hypothesis.m[at], strict=True)
        )
        held.append(replace(candidate, axes=tuple(axes)))
    again = refit(search, [replace(search.start_of(hypothesis), candidates=tuple(held))], settle_on_rows=False)
    return again[0] if again else hypothesis


def to_first_order(search: Search, hypothesis: Hypothesis, e: Array) -> Misfit:
    """Errors, (N, channels), of which the nuisances of a hypothesis, refitted to first order, explain what they can."""
    u = np.concatenate([hypothesis.theta, hypothesis.linear])
    g = search.white.T @ search.weighed(e[:, :, None]).ravel() + search.precision @ (u - search.means)
    H, free = search.gram + search.precision, np.ones(len(u), dtype=bool)
    step = least_within(H, g, search.low - u, search.high - u, free, CAL.ridge)
    off = u + step - search.means
    return Misfit(e + search.moved_by(step), float(off @ search.precision @ off) / search.trust, search.trust)


def subsets(names: tuple[str, ...]) -> list[frozenset[str]]:
    """All sets of some names, the empty one first, all of them last."""
    return [frozenset(combination) for size in range(len(names) + 1) for combination in combinations(names, size)]


def of_subsets(
    search: Search, whole: Hypothesis, absent: Mapping[str, Mapping[int, float]], known: Mapping[frozenset[str], Misfit]
) -> dict[frozenset[str], Misfit]:
    """Errors with every set of some effects: contributions add up, and tolerances are refitted to first order.

    Parameters
    ----------
    search : linearised about the whole, in the noise by which free runs are weighed.
    whole : with all of them.
    absent : effect -> index of a parameter -> its value where the effect is absent.
    known : sets whose errors are known from refits.
    """
    ways = [search.vector(whole)]
    for changed in absent.values():
        ways.append(ways[0].copy())
        ways[-1][[*changed]] = [*changed.values()]
    e = search.residuals(ways)
    each = dict(zip(absent, np.nan_to_num(e[1:] - e[0]), strict=True))
    result = dict(known)
    for item in subsets(tuple(absent)):
        if item not in known:
            missing = [each[name] for name in absent if name not in item]
            result[item] = to_first_order(search, whole, whole.e + sum(missing, start=np.zeros_like(whole.e)))
    return result
