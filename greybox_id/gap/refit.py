"""Refitting of hypotheses side by side: Gauss-Newton steps in nuisances and magnitudes, shortened if too long."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..parameter import Array
from .axes import Axis
from .calibration import CAL
from .hypothesis import Hypothesis, Start
from .search import Search


def refit(search: Search, starts: Sequence[Start], settle_on_rows: bool = True) -> list[Hypothesis]:
    """Refit hypotheses side by side, in their order; those that have no finite residuals are left out.

    Parameters
    ----------
    search : what they are refitted on.
    starts : where they begin.
    settle_on_rows : whether delays of whole rows are tried too.
    """
    work = [_Work(search, start) for start in starts]
    _walk(search, work, CAL.iterations)
    found = [own.best for own in work if own.best is not None]
    return _on_rows(search, found) if settle_on_rows else found


def _walk(search: Search, work: Sequence[_Work], steps: int) -> None:
    """So many steps of hypotheses, side by side."""
    for _ in range(steps):
        active = [own for own in work if not own.done]
        if not active:
            break
        wanted = [own.wanted() for own in active]
        e = search.residuals([p for each in wanted for p in each])
        first = 0
        for own, each in zip(active, wanted, strict=True):
            own.take(e[first : first + len(each)])
            first += len(each)


def settled(search: Search, found: Hypothesis, again_at_most: int = CAL.again) -> Hypothesis:
    """A hypothesis whose nuisances are linearised about where they are until they move no more.

    They are believed to be near their means, but where gaps are small against tolerances they are not near enough for
    derivatives taken there: what they then miss would pass for a gap.
    """
    for _ in range(again_at_most if search.moving or search.shifts else 0):
        search.about(found, delays=False)
        again = refit(search, [search.start_of(found)])
        if not again:
            break
        before, found = found, again[0]  # the later one even where it costs more: the others will stand beside it
        if found.cost > before.cost - CAL.enough:
            break
    return found


def _on_rows(search: Search, found: list[Hypothesis]) -> list[Hypothesis]:
    """Hypotheses, or better ones with a delay of whole rows: there likelihoods have steps, which stop refits."""
    better, owners, work = list(found), [], []
    for at, own in enumerate(found):
        for start in _whole_rows(search, own):
            owners.append(at)
            work.append(_Work(search, start))
    _walk(search, work, CAL.glance)
    likely = [each for at, each in zip(owners, work, strict=True) if each.best and each.best.cost < found[at].cost]
    _walk(search, likely, CAL.iterations - CAL.glance)
    for at, each in zip(owners, work, strict=True):
        if each.best is not None and each.best.cost < better[at].cost:
            better[at] = each.best
    return better


def _whole_rows(search: Search, found: Hypothesis) -> list[Start]:
    """A hypothesis with a delay of it at the whole rows that are nearest, and just beyond them if it is below."""
    starts, step = [], search.bench.sample_time
    for k, axis in enumerate(found.axes):
        whole = step * float(np.round(found.m[k] / step))
        for at in (whole, whole + CAL.shifted) if found.m[k] < whole else (whole,):
            if axis.shift and whole > 0 and axis.low <= at <= axis.high and at != found.m[k]:
                m = found.m.copy()
                m[k] = at
                starts.append(Start(found.candidates, m, found.theta, found.linear))
    return starts


class _Work:
    """One hypothesis on its way."""

    def __init__(self, search: Search, start: Start) -> None:
        self.search, self.candidates = search, start.candidates
        self.axes = tuple(axis for candidate in start.candidates for axis in candidate.axes)
        self._own = {axis.index for axis in self.axes}
        self._moving = [k for k, axis in enumerate(self.axes) if axis.low < axis.high]
        linear = search.released(np.array(start.linear, dtype=float), self.axes)
        self.at = (np.array(start.m, dtype=float), np.array(start.theta, dtype=float), linear)
        self.best: Hypothesis | None = None
        self._step: Array | None = None
        self._origin: Array | None = None
        self._stride = 1.0
        self._here: tuple[Array, Array, Array, Array] | None = None
        self.done, self._share = False, 1.0
        if start.origin is not None and np.array_equal(linear, start.linear):
            self._begin_at(*start.origin)

    def _begin_at(self, origin: Hypothesis, m: Array) -> None:
        """Take the start for a step from the origin, which may be shortened."""
        nothing = np.zeros((*origin.e.shape, len(m)))
        self.best = Hypothesis(self.candidates, m, origin.theta, origin.linear, origin.cost, origin.e, nothing)
        self._origin = m
        there = np.concatenate([self.at[1], self.at[2], self.at[0]])
        self._step = there - np.concatenate([origin.theta, origin.linear, m])

    def wanted(self) -> list[Array]:
        """Parameter vectors to simulate: where it stands, and beside it."""
        m, theta, _ = self.at
        search = self.search
        p = search.placed(search.moved(theta), self.axes, m)
        found = [p]
        for k in self._moving:
            beside = m.copy()
            beside[k] += self._beside(self.axes[k], m[k])
            found.append(search.placed(p, self.axes, beside))
        return found

    def _beside(self, axis: Axis, at: float) -> float:
        """How far beside; a shift does not cross a row, where readings jump."""
        if not axis.shift:
            step = max(CAL.beside * axis.scale, CAL.beside * abs(at))
            return step if at + step <= axis.high else -step
        rows = at / self.search.bench.sample_time
        crosses = np.floor(rows + CAL.shifted / self.search.bench.sample_time) > np.floor(rows - CAL.on_a_row)
        return -CAL.shifted if crosses and at >= CAL.shifted else CAL.shifted

    def take(self, e: Array) -> None:
        """Simulations have come back."""
        search, (m, theta, linear) = self.search, self.at
        base = e[0] + search.linear_by @ (linear - search.null_linear)
        r = search.weighed(base[:, :, None]).ravel()
        u = np.concatenate([theta, linear])
        off = u - search.means
        precision = search.beliefs(self._own)
        with np.errstate(over="ignore", invalid="ignore"):  # simulations that spin are far off, and cost accordingly
            cost = 0.5 * float(r @ r) + 0.5 * float(off @ precision @ off)
            J = np.zeros((*base.shape, len(self.axes)))
            for k, beside in zip(self._moving, e[1:], strict=True):
                J[:, :, k] = (beside - e[0]) / self._beside(self.axes[k], m[k])
        if not (np.isfinite(cost) and np.all(np.isfinite(J))):  # it spins here or beside: no place to stay
            cost = np.inf
        if self.best is not None and not cost <= self.best.cost:
            self._back()
            return
        if not np.isfinite(cost):
            self.done = True
            return
        gained = np.inf if self.best is None or self._origin is not None else self.best.cost - cost
        self._origin = None
        self.best = Hypothesis(self.candidates, m, theta, linear, cost, base, J)
        if gained < CAL.settled + CAL.hopeless * max(cost - 0.5 * search.trust * search.colour.readings, 0.0):
            self.done = True
            return
        self._share, self._here = 1.0, (r, J, u, precision)
        self._step = self._solve(*self._here)
        self._go()

    def _solve(self, r: Array, J: Array, u: Array, precision: Array) -> Array:
        """A Gauss-Newton step within the bounds: what would leave them is held there, one after the other."""
        search = self.search
        W = search.weighed(J).reshape(-1, J.shape[2]) if J.shape[2] else np.zeros((len(r), 0))
        cross = search.white.T @ W
        H = np.block([[search.gram + precision, cross], [cross.T, W.T @ W]])
        g = np.concatenate([search.white.T @ r + precision @ (u - search.means), W.T @ r])
        m = self.at[0]
        stride = self._stride * search.stride
        low = np.concatenate([np.maximum(search.low - u, -stride), [a.low for a in self.axes] - m])
        high = np.concatenate([np.minimum(search.high - u, stride), [a.high for a in self.axes] - m])
        held = np.append(search.among(self._own), np.zeros(len(m), dtype=bool))
        return bounded_step(H, g, low, high, held)

    def _go(self) -> None:
        """Step from the best so far."""
        assert self.best is not None
        assert self._step is not None
        n, count = len(self.best.theta), len(self.best.theta) + len(self.best.linear)
        step = self._share * self._step
        self.at = (self.best.m + step[count:], self.best.theta + step[:n], self.best.linear + step[n:count])

    def _back(self) -> None:
        """The step was too long.

        Where it led away from the origin, another one is taken from there. Elsewhere what shapes curves goes less far
        first, and everything else as far as it then would.
        """
        if self._here is not None and self._stride == 1.0 and np.any(np.isfinite(self.search.stride)):
            self._stride = CAL.shy
            self._step = self._solve(*self._here)
            self._go()
            return
        self._share /= 3
        if self._share >= (CAL.short if self._origin is not None else CAL.shortest) and self._step is not None:
            self._go()
        elif self._origin is not None and self.best is not None:
            self.at, self.best, self._origin = (self._origin, self.best.theta, self.best.linear), None, None
        else:
            self.done = True


def bounded_step(H: Array, g: Array, low: Array, high: Array, held: NDArray[np.bool_]) -> Array:
    """Minimiser of g d + d H d / 2 with low <= d <= high, by holding what would leave; zero where held."""
    d, free, fixed = np.zeros(len(g)), ~held, np.zeros(len(g))
    scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
    for _ in range(len(g) + 1):
        index = np.flatnonzero(free)
        if len(index) == 0:
            break
        s = scale[index]
        A = H[np.ix_(index, index)] / np.outer(s, s) + CAL.ridge * np.eye(len(index))
        d = fixed.copy()
        d[index] = -np.linalg.solve(A, (g[index] + H[index] @ fixed) / s) / s
        outside = np.maximum(low - d, d - high) * scale
        outside[~free] = 0.0
        worst = int(np.argmax(outside))
        if outside[worst] <= 1e-12:
            break
        fixed[worst] = low[worst] if d[worst] < low[worst] else high[worst]
        free[worst] = False
        d = fixed.copy()
    return np.clip(d, np.where(held, 0.0, low), np.where(held, 0.0, high))
