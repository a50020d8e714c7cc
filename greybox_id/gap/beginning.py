"""Effects that begin or end within a recording: rain, a tyre that loses pressure, a load that falls off.

Constant effects have been weighed before. Where an effect gains more by acting in part of the recordings only, it is
refitted with that part; the instant is estimated to first order on a grid and then by simulation. It is charged for the
number of possible instants and for both directions. If it is the best explanation, all other hypotheses are refitted
about it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from ..base.shorthands import Array
from .estimation.axes import ActingRows, Candidate
from .estimation.bench import Bench
from .estimation.calibration import CAL
from .estimation.hypothesis import Hypothesis, Start, by_cost
from .estimation.model_error import ModelError
from .estimation.noise import Whitener
from .estimation.part_bench import PartBench
from .estimation.refit import refit, settled
from .estimation.search import Search
from .evidence import Costs, price
from .selection import Selection


@dataclass(frozen=True)
class _Begun:
    """A hypothesis one of whose effects acts in part of the rows, and what refits it."""

    search: Search
    hypothesis: Hypothesis


def with_beginnings(
    selection: Selection,
    candidates: Sequence[Candidate],
    whitener: Callable[[Search, Hypothesis | None], Whitener],
    cost: Costs,
) -> Selection:
    """The selection with effects that begin or end, if one of these is the best of all; else unchanged."""
    search = selection.search
    if not isinstance(search.bench, Bench) or not isinstance(search.whitener, ModelError):
        return selection

    def score(hypothesis: Hypothesis) -> float:
        return hypothesis.cost + price(hypothesis, cost)

    known = min((selection.base, *selection.tried), key=score)
    single = {item.names[0]: item for item in selection.tried if len(item.names) == 1}
    result = list[_Begun]()
    for parent in (selection.base, *(single[name] for name in known.names if name in single)):
        for promising in _part_candidates(search, parent, candidates, cost, min(known.cost, parent.cost)):
            begun = _refitted(search, parent, *promising)
            if begun is not None and score(begun.hypothesis) < score(known) + CAL.alike:
                result.append(begun)
    if not result:
        return selection
    best = _placed(min(result, key=lambda each: score(each.hypothesis)))
    if score(best.hypothesis) >= score(known):
        return selection
    return _weighed(selection, best, result, whitener, score)


def _part_candidates(
    search: Search, parent: Hypothesis, candidates: Sequence[Candidate], cost: Costs, least: float
) -> list[tuple[Candidate, slice, Array]]:
    """Effects that may gain enough by acting in part of the rows only, with rows and coordinates; best first.

    Second parameters are as stated: in other forms, which resemble tolerances of tyres more, they gain on vehicles
    without a gap, too.

    Enough is more than the same effect gains everywhere by the cost of the instant, and at least a share of what the
    best explanation gains.
    """
    new = [
        candidate
        for candidate in candidates
        if candidate.effect not in parent.names and candidate.gradual and candidate.free == 1
    ]
    new = [item for item in new if all(search.nominal[axis.index] == axis.low for axis in item.axes[1:])]
    if not new:
        return []
    J = search.bench.linearise(search.vector(parent), [item.axes[0].index for item in new])[1]
    everywhere, places, gains, steps = _gains_in_parts(search, parent, J)
    result = list[tuple[float, Candidate, slice, Array]]()
    for k, item in enumerate(new):
        axis, null = item.axes[0], search.where(parent, item.axes[0])
        step = steps[:, k]
        at = np.clip(null + step, axis.low, axis.high)
        done = np.divide(at - null, step, out=np.ones_like(step), where=step != 0)  # a bound may cut the step short
        expected = gains[:, k] * (1 - (1 - done) ** 2)  # a parabola
        best = int(np.argmax(expected))
        needed = max(everywhere[k] + CAL.begins, cost(item.effect) + CAL.begins, CAL.nearly * (parent.cost - least))
        if expected[best] > needed:
            result.append((float(expected[best]), item, places[best], np.array([at[best], *item.held])))
    result.sort(key=lambda each: -each[0])
    return [(item, rows, m) for _, item, rows, m in result[: CAL.refitted]]


def _gains_in_parts(search: Search, parent: Hypothesis, J: Array) -> tuple[Array, list[slice], Array, Array]:
    """Gains of single effects everywhere and in parts of the rows, nuisances and the parent's magnitudes refitted.

    Parameters
    ----------
    J : (N, channels, K) derivatives by their magnitudes.

    Returns
    -------
    everywhere : (K,) log-likelihood.
    places : P parts, up to an instant or from it on.
    gains, steps : (P, K) log-likelihood and magnitudes, to first order; no gain where one side has too little of the
        effect's information: tolerances may then absorb the effect there.
    """
    rows, channels, count = J.shape
    W, r = search.weighed(J), search.weighed(parent.e[:, :, None])[:, :, 0]
    columns = search.weighed(parent.J)
    A = np.concatenate([search.white.reshape(rows, channels, -1), columns], axis=2)
    u = np.concatenate([parent.theta, parent.linear])
    n = len(u)
    H, g = _products(A, A), _products(A, r[:, :, None])[:, 0]
    H[:n, :n] += search.precision
    g[:n] += search.precision @ (u - search.means)
    free = np.ones(len(g), dtype=bool)
    free[:n] = ~(((u <= search.low) & (g[:n] > 0)) | ((u >= search.high) & (g[:n] < 0)))
    edges = np.unique(np.linspace(0, rows, CAL.places + 1).astype(int))
    slices = [slice(int(a), int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    cross = np.array([_products(A[item], W[item]) for item in slices])
    raw = np.array([np.sum(W[item] ** 2, axis=(0, 1)) for item in slices])
    slope = np.array([_products(W[item], r[item][:, :, None])[:, 0] for item in slices])
    inner = [k for k in range(1, len(slices)) if CAL.least_part * rows <= edges[k] <= (1 - CAL.least_part) * rows]
    sums = [(np.cumsum(each, axis=0)[[k - 1 for k in inner]], np.sum(each, axis=0)) for each in (cross, raw, slope)]
    stacked = [np.concatenate([whole[None], until, whole - until]) for until, whole in sums]
    C, own_raw, own_slope = stacked[0][:, free], stacked[1], stacked[2]
    scale = 1 / np.sqrt(np.maximum(np.diag(H)[free], 1e-300))
    scaled = H[np.ix_(free, free)] * np.outer(scale, scale) + CAL.ridge * np.eye(int(np.sum(free)))
    wide = np.moveaxis(C, 1, 0).reshape(len(scale), -1)
    solved = np.linalg.solve(scaled, np.column_stack([g[free], wide]) * scale[:, None]) * scale[:, None]
    undone = np.moveaxis(solved[:, 1:].reshape(len(scale), len(C), count), 0, 1)
    curve = np.maximum(own_raw - np.sum(C * undone, axis=1), 1e-6 * own_raw + 1e-300)
    left = own_slope - np.einsum("pnk,n->pk", C, solved[:, 0])
    known = own_raw[1:] / np.maximum(own_raw[0], 1e-300)
    enough = (known >= CAL.part_information) & (known <= 1 - CAL.part_information)
    both = np.vstack([np.ones(count, dtype=bool), enough])
    gains, steps = np.where(both, 0.5 * left**2 / curve, 0.0), -left / curve
    places = [slice(0, int(edges[k])) for k in inner] + [slice(int(edges[k]), rows) for k in inner]
    return gains[0], places, gains[1:], steps[1:]


def _products(A: Array, B: Array) -> Array:
    """(n, m) sums over rows and channels of (N, channels, n) times (N, channels, m)."""
    return np.asarray(A.reshape(-1, A.shape[2]).T @ B.reshape(-1, B.shape[2]))


def _refitted(search: Search, parent: Hypothesis, candidate: Candidate, rows: slice, at: Array) -> _Begun | None:
    """A hopeful effect beside its parent, refitted from the parent's nuisances and from their prior means."""
    acting, candidate = _acting(search, candidate, rows)
    candidates, m = (*parent.candidates, candidate), np.append(parent.m, at)
    null = np.append(parent.m, (candidate.axes[0].null, *at[1:]))
    count = len(parent.theta)
    starts = [
        Start(candidates, m, parent.theta, parent.linear, (parent, null), parent.J),
        Start(candidates, m, search.means[:count], search.means[count:], slopes=parent.J),
    ]
    result = refit(acting, starts)
    return _Begun(acting, min(result, key=by_cost)) if result else None


def _acting(search: Search, candidate: Candidate, rows: slice) -> tuple[Search, Candidate]:
    """A search in which a candidate acts in some rows alone, and that candidate."""
    bench = search.bench.whole if isinstance(search.bench, PartBench) else search.bench
    assert isinstance(bench, Bench)
    size, (axis, *others) = bench.model.size, candidate.axes
    other = copy(search)
    other.bench = PartBench(bench, _place(bench, candidate), rows)
    other.nominal = np.append(search.nominal[:size], np.nan)
    other.expanded = search.expanded.copy()
    return other, replace(candidate, axes=(replace(axis, index=size), *others), part=_part(bench, rows))


def _part(bench: Bench, rows: slice) -> ActingRows:
    """Rows as the part in which an effect acts: since when, or until when, in the recording's time."""
    begins = rows.start > 0
    row = rows.start if begins else rows.stop
    run = next(k for k, item in enumerate(bench.rows) if item.start <= row < item.stop)
    at = float(bench.time[row])
    whole = bench.runs[run]
    return ActingRows(rows, whole.name, whole.number, *((at, None) if begins else (None, at)))


def _placed(begun: _Begun) -> _Begun:
    """The hypothesis with its effect beginning or ending at the best row, by a search with ever smaller steps."""
    best = begun
    rows = len(best.search.bench.time)
    step = rows / (CAL.places / 4)
    while step >= 1:
        for sign in (-1, 1):
            moved = _moved(best, round(sign * step), rows)
            if moved is not None and moved.hypothesis.cost < best.hypothesis.cost:
                best = moved
                break
        step /= 2
    return best


def _moved(begun: _Begun, by: int, rows: int) -> _Begun | None:
    """The hypothesis with its effect beginning or ending `by` rows later; None where that is too near to an end."""
    *others, begins = begun.hypothesis.candidates
    old = _acting_rows(begun.hypothesis)
    edge = (old.start or old.stop) + by
    if not CAL.least_part * rows <= edge <= (1 - CAL.least_part) * rows:
        return None
    acting, candidate = _acting(begun.search, begins, slice(edge, rows) if old.start else slice(0, edge))
    start = replace(begun.search.start_of(begun.hypothesis), candidates=(*others, candidate))
    result = refit(acting, [start])
    return _Begun(acting, result[0]) if result else None


def _weighed(
    selection: Selection,
    best: _Begun,
    result: Sequence[_Begun],
    whitener: Callable[[Search, Hypothesis | None], Whitener],
    score: Callable[[Hypothesis], float],
) -> Selection:
    """The selection about a best hypothesis that acts in part of the rows: all refitted in the noise it leaves."""
    search = best.search
    search.set_whitener(whitener(search, best.hypothesis))
    search.about(best.hypothesis)
    hypothesis = settled(
        search, min(refit(search, [search.start_of(best.hypothesis)]), key=by_cost, default=best.hypothesis)
    )
    best = _placed(_Begun(search, hypothesis))
    search, hypothesis = best.search, best.hypothesis
    constant = (selection.base, *selection.tried[: CAL.refitted])
    starts = [Start(each.candidates, each.m, hypothesis.theta, hypothesis.linear, slopes=each.J) for each in constant]
    again = refit(search, [*(search.start_of(each) for each in constant), *starts])
    bases, tried = [each for each in again if not each.names], {frozenset(hypothesis.names): hypothesis}
    here = _acting_rows(hypothesis)
    others = [(hypothesis.candidates[-1:], hypothesis.m[hypothesis.parts[-1][1]], here)]
    for each in (begun.hypothesis for begun in result):
        there = _acting_rows(each)
        others += [(each.candidates, each.m, rows) for rows in ([there] if there == here else [there, here])]
    for candidates, m, rows in others:
        if (names := frozenset(each.effect for each in candidates)) == frozenset(hypothesis.names):
            continue
        acting, candidate = _acting(search, candidates[-1], rows)
        for one in refit(acting, [Start((*candidates[:-1], candidate), m, hypothesis.theta, hypothesis.linear)]):
            placed = _placed(_Begun(acting, one)).hypothesis if score(one) < score(hypothesis) + CAL.cost else one
            if names not in tried or placed.cost < tried[names].cost:
                tried[names] = placed
    for each in sorted((each for each in again if each.names and not search.tolerated(each)), key=by_cost):
        tried.setdefault(frozenset(each.names), each)
    base, first = min(bases, key=by_cost, default=None), min(tried.values(), key=score)
    if base is None or score(first) >= min(score(each) for each in again):
        return selection
    best_first = tuple(sorted(tried.values(), key=by_cost))
    return replace(selection, search=as_it_acts(search, first), base=base, tried=best_first)


def _acting_rows(hypothesis: Hypothesis) -> slice:
    """Rows in which a hypothesis' last effect acts, which begins or ends."""
    part = hypothesis.candidates[-1].part
    assert part is not None
    return part.rows


def as_it_acts(search: Search, hypothesis: Hypothesis) -> Search:
    """The search on a bench where a hypothesis' effects act in their parts of the rows."""
    for candidate in hypothesis.candidates:
        bench = search.bench
        if candidate.part is not None and isinstance(bench, PartBench):
            index = _place(bench, candidate)
            if (index, candidate.part.rows) != (bench.index, bench.part):
                search = copy(search)
                search.bench = PartBench(bench.whole, index, candidate.part.rows)
    return search


def _place(bench: Bench, candidate: Candidate) -> int:
    """Index of a candidate's magnitude among the model's parameters."""
    return [parameter.name for parameter in bench.model.parameters].index(candidate.axes[0].name)
