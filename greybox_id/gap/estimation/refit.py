"""Refitting of hypotheses side by side: Gauss-Newton steps in nuisances and magnitudes, shortened if too long."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...base.shorthands import Array
from ...engine.motion.lanes import WIDTHS
from ...engine.solvers.gauss_newton import least_within
from .axes import Axis
from .calibration import CAL
from .hypothesis import Hypothesis, Start, parts_of
from .search import Search

CALL = min(WIDTHS)
"""Simulations that a call makes in the time of one, where the recordings are a single run."""


def refit(search: Search, starts: Sequence[Start], settle_on_rows: bool = True) -> list[Hypothesis]:
    """Refit hypotheses side by side, in their order; those without finite residuals are omitted.

    Parameters
    ----------
    search : what they are refitted on.
    starts : where they begin.
    settle_on_rows : whether delays of whole rows are tried too.
    """
    work = [_Refit(search, start) for start in starts]
    _walk(search, work, CAL.iterations)
    result = [item.best for item in work if item.best is not None]
    return _on_rows(search, result) if settle_on_rows else result


def _walk(search: Search, work: Sequence[_Refit], steps: int) -> None:
    """Advance hypotheses side by side, by at most `steps` steps each."""
    for item in work:
        item.left = steps
    while active := [item for item in work if item.left > 0 and not item.done]:
        target = [item.vectors() for item in active]
        room = -sum(len(each) for each in target) % CALL if len(search.bench.runs) == 1 else 0
        for k, item in enumerate(active):  # a call that is not full takes as long
            if item.differentiates_within(room):
                target[k] = item.vectors()
                room -= len(target[k]) - 1
        edges = np.cumsum([0, *(len(each) for each in target)])
        e = search.residuals([p for each in target for p in each])
        more = search.first_orders([item.at[2] for item in active])
        values = [
            item.values(e[a:b], more[:, :, k])
            for k, (item, a, b) in enumerate(zip(active, edges[:-1], edges[1:], strict=True))
        ]
        edges = np.cumsum([0, *(each.shape[2] for each in values)])
        white = search.weighed(np.concatenate(values, axis=2))  # of all at once: a filter takes as long for one
        white = white.reshape(-1, white.shape[2])
        cross = (white.T @ search.white).T  # several times as fast as the product the other way round
        for item, each, a, b in zip(active, values, edges[:-1], edges[1:], strict=True):
            item.take(each, white[:, a:b], cross[:, a:b])


def with_slopes(search: Search, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Hypotheses with derivatives taken at their coordinates, for the sds and spreads of their magnitudes."""
    work = [_Refit(search, replace(search.start_of(item), slopes=None)) for item in hypotheses]
    target = [item.vectors() for item in work]
    edges = np.cumsum([0, *(len(each) for each in target)])
    e, nothing = search.residuals([p for each in target for p in each]), np.zeros(search.bench.measured.shape)
    new = []
    for item, each, a, b in zip(hypotheses, work, edges[:-1], edges[1:], strict=True):
        J = each.values(e[a:b], nothing)[:, :, 1:]
        new.append(replace(item, J=each.over_axes(J)) if np.all(np.isfinite(J)) else item)
    return new


def settled(search: Search, result: Hypothesis, again_at_most: int = CAL.again) -> Hypothesis:
    """A hypothesis refitted, its nuisances linearised about their estimates each time, until its cost falls no more.

    Derivatives taken at the prior means are near enough unless a gap is small against the tolerances: what they then
    miss would pass for a gap. A linearisation after which the cost rises, as where the vehicle spins, is discarded.
    """
    for _ in range(again_at_most if search.moving or search.shifts else 0):
        place = search.place()
        search.about(result, delays=False)
        again = refit(search, [search.start_of(result)])
        if not again or not again[0].cost < result.cost + CAL.enough:
            search.back(place)
            break
        before, result = result, again[0]
        if result.cost > before.cost - CAL.enough:
            break
    return result


def _on_rows(search: Search, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
    """Hypotheses, or better ones with a delay of whole rows: likelihoods jump there, which stops refits."""
    better, owners, work = list(hypotheses), [], []
    for at, item in enumerate(hypotheses):
        for start in _whole_rows(search, item):
            owners.append(at)
            work.append(_Refit(search, start))
    _walk(search, work, CAL.screening_steps)
    likely = [each for at, each in zip(owners, work, strict=True) if each.best and each.best.cost < hypotheses[at].cost]
    _walk(search, likely, CAL.iterations - CAL.screening_steps)
    for at, each in zip(owners, work, strict=True):
        if each.best is not None and each.best.cost < better[at].cost:
            better[at] = each.best
    return better


def _whole_rows(search: Search, hypothesis: Hypothesis) -> list[Start]:
    """Starts with one of a hypothesis' delays at the nearest whole row, and just beyond it if the delay is below."""
    starts, step = [], search.bench.sample_time
    for k, axis in enumerate(hypothesis.axes):
        whole = step * float(np.round(hypothesis.m[k] / step))
        for at in (whole, whole + CAL.shifted) if hypothesis.m[k] < whole else (whole,):
            if axis.shift and whole > 0 and axis.low <= at <= axis.high and at != hypothesis.m[k]:
                m = hypothesis.m.copy()
                m[k] = at
                starts.append(Start(hypothesis.candidates, m, hypothesis.theta, hypothesis.linear))
    return starts


@dataclass(frozen=True)
class _Slopes:
    """Derivatives of residuals by the coordinates that move.

    Attributes
    ----------
    m : coordinates at which they were taken.
    plain, white : (N, channels, moving), (N channels, moving) derivatives, and the same whitened.
    gram, cross : products of the whitened ones with themselves, and of the nuisances' columns with them.
    """

    m: Array
    plain: Array
    white: Array
    gram: Array
    cross: Array


class _Refit:
    """The refit of one hypothesis, step by step.

    A derivative is kept as long as its coordinate moves little and steps gain what was predicted; those by delays, at
    which readings jump with rows, are taken anew at every point.
    """

    def __init__(self, search: Search, start: Start) -> None:
        self.search, self.candidates = search, start.candidates
        self.axes = tuple(axis for candidate in start.candidates for axis in candidate.axes)
        self._candidate_indices = {axis.index for axis in self.axes}
        self._moving = [k for k, axis in enumerate(self.axes) if axis.low < axis.high]
        linear = search.released(np.array(start.linear, dtype=float), self.axes)
        self.at = (np.array(start.m, dtype=float), np.array(start.theta, dtype=float), linear)
        self.best: Hypothesis | None = None
        self._step: Array | None = None
        self._origin: Array | None = None
        self._stride = 1.0
        self._system: tuple[Array, Array, Array] | None = None
        self.done, self._share, self._least_gain, self.left = False, 1.0, 0.0, 0
        self._everywhere = any(axis.shift for axis in self.axes)
        self._slopes: _Slopes | None = None
        self._given_slopes = start.slopes
        self._differentiates, self._renews = True, False
        self._due = [k for k in self._moving if self._everywhere or not self._knows(k)]
        self._gained, self._predicted = np.inf, 0.0
        if start.origin is not None and np.array_equal(linear, start.linear):
            self._begin_at(*start.origin)

    def _begin_at(self, origin: Hypothesis, m: Array) -> None:
        """Treat the start as a step from its origin, which may be shortened."""
        nothing = np.zeros((*origin.e.shape, len(m)))
        self.best = Hypothesis(self.candidates, m, origin.theta, origin.linear, origin.cost, origin.e, nothing)
        self._origin = m
        there = np.concatenate([self.at[1], self.at[2], self.at[0]])
        self._step = there - np.concatenate([origin.theta, origin.linear, m])

    def _knows(self, k: int) -> bool:
        """Whether the start came with this derivative."""
        return (
            self._given_slopes is not None
            and k < self._given_slopes.shape[2]
            and bool(np.any(self._given_slopes[:, :, k]))
        )

    def differentiates_within(self, room: int) -> bool:
        """Whether it takes derivatives at its point although none are due: in at most `room` simulations."""
        if self._differentiates or not 0 < len(self._moving) <= room:
            return False
        self._differentiates, self._due = True, self._moving
        return True

    def vectors(self) -> list[Array]:
        """Parameter vectors to simulate: its point, and one beside it for each derivative that is due."""
        m, theta, _ = self.at
        search = self.search
        p = search.placed(search.moved(theta), self.axes, m)
        result = [p]
        for k in self._due if self._differentiates else ():
            beside = m.copy()
            beside[k] += self._difference(self.axes[k], m[k])
            result.append(search.placed(p, self.axes, beside))
        return result

    def _difference(self, axis: Axis, at: float) -> float:
        """Step of a finite difference; that of a delay does not cross a row, where readings jump."""
        if not axis.shift:
            step = max(CAL.beside * axis.scale, CAL.beside * abs(at))
            return step if at + step <= axis.high else -step
        rows = at / self.search.bench.sample_time
        crosses = np.floor(rows + CAL.shifted / self.search.bench.sample_time) > np.floor(rows - CAL.on_a_row)
        return -CAL.shifted if crosses and at >= CAL.shifted else CAL.shifted

    def values(self, e: Array, more: Array) -> Array:
        """(N, channels, 1 or 1 + moving) residuals at its point, and their derivatives by moving coordinates, if due.

        Parameters
        ----------
        e : (K, N, channels) residuals at the `vectors`.
        more : (N, channels) that linear nuisances add.
        """
        m = self.at[0]
        result = np.empty((*e.shape[1:], 1 + (len(self._moving) if self._differentiates else 0)))
        result[:, :, 0] = e[0] + more
        for at, k in enumerate(self._moving if self._differentiates else (), 1):
            if k in self._due:
                result[:, :, at] = (e[1 + self._due.index(k)] - e[0]) / self._difference(self.axes[k], m[k])
            else:
                assert self._given_slopes is not None
                result[:, :, at] = self._given_slopes[:, :, k]
        return result

    def take(self, values: Array, white: Array, cross: Array) -> None:
        """Take up `values` that were simulated, the same whitened, and the nuisances' columns times these."""
        slopes = values[:, :, 1:]
        sane = bool(np.all(np.isfinite(slopes)))
        fresh = None
        if self._differentiates and sane:
            columns = white[:, 1:].copy()
            gram = columns.T @ columns  # overflows where the vehicle spins
            if np.all(np.isfinite(gram)):
                fresh = _Slopes(self.at[0], slopes.copy(), columns, gram, cross[:, 1:].copy())
        if self._renews:
            self._renews = False
            if fresh is None or self.best is None:  # the vehicle spins beside this point: no step leads on
                self.done = True
                return
            self._slopes = fresh
            self.best = replace(self.best, J=self._derivatives(self.best.e.shape))
        else:
            self.left -= 1
            if not self._improves(values[:, :, 0], white[:, 0], sane, fresh):
                return
            if self._stale():
                self._renew()
                return
        self._differentiates = self._everywhere
        self._step_on(white[:, 0], cross[:, 0])

    def _derivatives(self, shape: tuple[int, ...]) -> Array:
        """(N, channels, axes) derivatives as last taken; zero where none were."""
        return np.zeros((*shape, len(self.axes))) if self._slopes is None else self.over_axes(self._slopes.plain)

    def over_axes(self, moving: Array) -> Array:
        """(N, channels, axes) from (N, channels, moving): zero for coordinates that are held."""
        J = np.zeros((*moving.shape[:2], len(self.axes)))
        J[:, :, self._moving] = moving
        return J

    def _stale(self) -> bool:
        """Whether derivatives have to be taken anew: coordinates moved too far, or a gain was not as predicted."""
        if not self._moving:
            return False
        if self._slopes is None:
            return True
        old, m = self._slopes.m, self.at[0]
        if np.array_equal(old, m):
            return False
        null = np.array([axis.null for axis in self.axes])
        size = np.abs(old - null)
        for item, at in parts_of(self.candidates):
            if item.gradual:
                size[at] = np.maximum(size[at], [axis.scale for axis in item.axes])
        off = abs(self._gained - self._predicted)
        return bool(np.any(np.abs(m - old) > CAL.stale * size)) or off > CAL.prediction_error * self._predicted

    def _renew(self) -> None:
        """Request derivatives at the best point so far."""
        assert self.best is not None
        self.at = (self.best.m, self.best.theta, self.best.linear)
        self._differentiates, self._renews, self._due = True, True, self._moving

    def _improves(self, e: Array, r: Array, sane: bool, fresh: _Slopes | None) -> bool:
        """Whether its point is the best so far by enough to go on; else the step is shortened, or the refit ends."""
        search, (m, theta, linear) = self.search, self.at
        off = np.concatenate([theta, linear]) - search.means
        cost = 0.5 * float(r @ r) + 0.5 * float(off @ search.prior_precision(self._candidate_indices) @ off)
        if not (np.isfinite(cost) and sane):  # the vehicle spins here
            cost = np.inf
        if self.best is not None and not cost <= self.best.cost:
            self._differentiates = self._everywhere or self._slopes is None
            known = self._slopes is None or self._system is None or np.array_equal(self._slopes.m, self.best.m)
            if known or not self._moving:
                self._shorten(cost - self.best.cost)
            else:
                self._renew()
            return False
        if not np.isfinite(cost):
            self.done = True
            return False
        self._gained = np.inf if self.best is None or self._origin is not None else self.best.cost - cost
        self._origin, self._slopes = None, fresh or self._slopes
        self.best = Hypothesis(self.candidates, m, theta, linear, cost, e.copy(), self._derivatives(e.shape))
        least = CAL.settled + CAL.hopeless * max(cost - 0.5 * search.trust * search.whitener.readings, 0.0)
        self._least_gain = CAL.expected * least
        self.done = self._gained < least
        return not self.done

    def _step_on(self, r: Array, pull: Array) -> None:
        """Step from the best point so far.

        Parameters
        ----------
        r, pull : its residuals, whitened, and the nuisances' columns times these.
        """
        search, (_, theta, linear) = self.search, self.at
        u, precision = np.concatenate([theta, linear]), search.prior_precision(self._candidate_indices)
        count = len(u)
        whole = np.zeros((1 + count + len(self.axes), 1 + count + len(self.axes)))  # residuals before coordinates
        whole[1 : 1 + count, 0] = pull + precision @ (u - search.means)
        whole[1 : 1 + count, 1 : 1 + count] = search.gram + precision
        if self._slopes is not None:
            places = [1 + count + k for k in self._moving]
            whole[places, 0] = self._slopes.white.T @ r
            whole[np.ix_(places, places)] = self._slopes.gram
            whole[1 : 1 + count, places], whole[places, 1 : 1 + count] = self._slopes.cross, self._slopes.cross.T
        if not np.all(np.isfinite(whole)):  # the vehicle spins beside this point: no step leads on
            self.done = True
            return
        self._share, self._system = min(3 * self._share, 1.0), (whole[1:, 1:], whole[1:, 0], u)
        self._step = self._solve(*self._system)
        self._take_step()

    def _solve(self, H: Array, g: Array, u: Array) -> Array:
        """The Gauss-Newton step within the bounds."""
        assert self.best is not None
        search, m = self.search, self.best.m
        stride = self._stride * search.stride
        low = np.concatenate([np.maximum(search.low - u, -stride), [a.low for a in self.axes] - m])
        high = np.concatenate([np.minimum(search.high - u, stride), [a.high for a in self.axes] - m])
        free = np.append(~search.among(self._candidate_indices), np.ones(len(m), dtype=bool))
        return least_within(H, g, low, high, free, CAL.ridge)

    def _take_step(self) -> None:
        """Take the step, shortened as it is by now, unless it is expected to gain next to nothing."""
        assert self.best is not None
        assert self._step is not None
        n, count = len(self.best.theta), len(self.best.theta) + len(self.best.linear)
        step = self._share * self._step
        if self._system is not None:
            self._predicted = -float(self._system[1] @ step + 0.5 * step @ self._system[0] @ step)
            if self._predicted < self._least_gain:
                self.done = True
                return
        self.at = (self.best.m + step[count:], self.best.theta + step[:n], self.best.linear + step[n:count])

    def _shorten(self, rise: float) -> None:
        """Shorten the step, after which the cost rose by `rise`.

        A step to the start from its origin is given up for the origin once it is short. Elsewhere the coordinates that
        shape tyre curves are bounded more tightly first, and the step is solved for again.
        """
        if self._system is not None and self._stride == 1.0 and np.any(np.isfinite(self.search.stride)):
            self._stride = CAL.shorter_stride
            self._step = self._solve(*self._system)
            self._take_step()
            return
        shorter = self._share / 3
        steps = self._everywhere  # likelihoods of delays jump at rows: no parabola fits
        if self._system is not None and self._step is not None and np.isfinite(rise) and not steps:
            slope = -self._share * float(self._system[1] @ self._step)
            least = slope / (2 * (rise + slope))  # share of it at the parabola's minimum
            if least >= CAL.shortened and 0.5 * least * slope < self._least_gain:
                self.done = True
                return
            shorter = self._share * min(max(least, CAL.shortened), 1 / 3)
        self._share = shorter
        if self._share >= (CAL.short if self._origin is not None else CAL.shortest) and self._step is not None:
            self._take_step()
        elif self._origin is not None and self.best is not None:
            self.at, self.best, self._origin = (self._origin, self.best.theta, self.best.linear), None, None
        else:
            self.done = True
