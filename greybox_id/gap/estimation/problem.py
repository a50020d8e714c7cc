"""The joint problem: tolerances, magnitudes and second parameters of all effects, and starts of runs, in one state.

About a state the problem is linear and Gaussian: whitened residuals, and one column of derivatives per coordinate.
Three kinds of coordinates enter to first order alone, without being simulated: small magnitudes of abrupt effects,
starts of runs, and whether a reading just precedes its row's command.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...base.shorthands import Array, Mask
from ...engine.simulation import FreeRuns
from .axes import Axis
from .calibration import CAL
from .causes import Form, PossibleCause
from .form import curve_priors
from .noise import Whitener

LEAST_ZONE = 1e-4
"""Least zone (sd of the spike) of a cause over its usual size: stands for zero where equations are exact."""
RIDGE = 1e-10
"""Added to the diagonal of matrices that are scaled to a unit diagonal: rounding in directions without information."""
FORM = "form_"
"""Prefix of the names of model-form errors: relative errors of a force by driving regime."""


def inverse(H: Array) -> Array:
    """Inverse of a positive definite matrix that may be badly scaled and nearly singular."""
    unit = 1 / np.sqrt(np.maximum(np.diag(H), np.finfo(float).tiny))
    scaled = np.linalg.inv(H * unit[:, None] * unit + RIDGE * np.eye(len(H)))
    result: Array = scaled * unit[:, None] * unit
    return result


@dataclass(frozen=True)
class JointState:
    """Coordinates of everything that is estimated.

    Attributes
    ----------
    theta : (tolerances,) coordinates; those of tyre curves are the ones of `curve_priors` at the present model-error
        scale.
    m : (causes,) coordinates of magnitudes.
    seconds : of each cause, coordinates of all its second parameters.
    form : of each cause, the index of its form.
    on : (causes,) whether a cause is simulated at its magnitude; gradual ones without second parameters always are.
    """

    theta: Array
    m: Array
    seconds: tuple[tuple[float, ...], ...]
    form: tuple[int, ...]
    on: Mask


class Linear(NamedTuple):
    """The problem linearised about a state: R whitened residuals, K coordinates.

    Attributes
    ----------
    columns : (R, 1 + K) whitened, in one array: the residuals, then their derivatives by tolerances, causes, second
        parameters of causes that are `on`, and first-order coordinates.
    at, mean, low, high : (K,) present values, prior means and bounds of the coordinates.
    sd : (K,) prior standard deviations; of magnitudes the zones.
    cause : (K,) of magnitudes and second parameters, the index of their cause; else -1.
    main : (K,) whether a coordinate is a cause's magnitude.
    moved : (K,) whether a coordinate is simulated; else it enters to first order alone, and a step does not change it
        in the state.
    """

    columns: Array
    at: Array
    mean: Array
    low: Array
    high: Array
    sd: Array
    cause: Array
    main: Mask
    moved: Mask

    @property
    def r(self) -> Array:
        """(R,) whitened residuals."""
        return self.columns[:, 0]

    @property
    def A(self) -> Array:
        """(R, K) derivatives."""
        return self.columns[:, 1:]


class _Difference(NamedTuple):
    """Parameter vectors between which residuals are divided by a step; none below stands for the present ones."""

    above: Array
    below: Array | None
    step: float


class JointProblem:
    """Recordings, and everything that may explain them.

    Parameters
    ----------
    bench : simulates the recordings.
    tolerances : nuisances with stated priors, and model-form errors; no zones of indifference.
    causes : effects that may be present.
    good : (N, channels) readings that count.
    """

    def __init__(
        self, bench: FreeRuns, tolerances: Sequence[Axis], causes: Sequence[PossibleCause], good: Mask
    ) -> None:
        self.bench, self.causes, self.good = bench, tuple(causes), good
        indices = {each.main.index for each in causes}
        self._stated = [axis for axis in tolerances if axis.index not in indices and not axis.abrupt]
        self.shifts = tuple(axis for axis in tolerances if axis.index not in indices and axis.abrupt)
        self.nominal = np.array(bench.model.values)
        self.usual = np.array([each.usual for each in self.causes])
        self.zone = np.maximum([each.zone for each in self.causes], LEAST_ZONE * self.usual)
        self.null = np.array([each.main.null for each in self.causes])
        self.mean = np.array([each.main.mean for each in self.causes])
        self.low = np.array([each.main.low for each in self.causes])
        self.high = np.array([each.main.high for each in self.causes])
        self.smooth = np.array(
            [each.gradual and not each.main.inverse and not each.forms[0].starts for each in self.causes], dtype=bool
        )
        self.simulations = 0
        self._probes = dict[int, tuple[int, int]]()
        self._slopes = dict[int, Array]()
        self._room = np.empty(0)  # memory for columns until they are whitened, reused by each linearisation
        self.set_error_scale(1.0)

    # ---- priors

    def set_error_scale(self, factor: float, state: JointState | None = None) -> JointState | None:
        """Scale the priors of curves and form errors by `factor`; the state keeps its parameters' values."""
        before = None if state is None else self._parameters(state.theta)
        axes = [replace(a, sd=a.sd * factor, scale=a.scale * factor) if a.name.startswith(FORM) else a
                for a in self._stated]  # fmt: skip
        self.tolerances, self.mix = curve_priors(axes, factor)
        self.theta_mean = np.array([axis.mean for axis in self.tolerances])
        self.theta_sd = np.array([axis.sd for axis in self.tolerances])
        if state is None or before is None:
            return state
        theta = self.theta_mean + np.linalg.solve(self.mix, before - self.theta_mean) if len(before) else state.theta
        return replace(state, theta=theta)

    def _parameters(self, theta: Array) -> Array:
        return np.asarray(self.theta_mean + self.mix @ (theta - self.theta_mean))

    def begin(self) -> JointState:
        """The state at the prior means; abrupt causes are at their nulls."""
        forms = [each.forms[0] for each in self.causes]
        return JointState(
            self.theta_mean.copy(),
            np.where(self.smooth, self.mean, self.null),
            tuple(_at_start(form, 0) for form in forms),
            (0,) * len(forms),
            np.zeros(len(forms), dtype=bool),
        )

    # ---- simulation

    def vector(self, state: JointState) -> Array:
        """The parameter vector of a state."""
        p = self.nominal.copy()
        for axis, x in zip(self.tolerances, self._parameters(state.theta), strict=True):
            p[axis.index] = axis.value(float(x))
        for k, cause in enumerate(self.causes):
            if self.smooth[k]:
                p[cause.main.index] = cause.main.value(float(state.m[k]))
            elif state.on[k]:
                self._place(p, k, state.form[k], (float(state.m[k]), *state.seconds[k]))
        return p

    def _place(self, p: Array, k: int, form: int, at: Sequence[float]) -> None:
        for axis, x in zip(self.causes[k].forms[form].candidate.axes, at, strict=True):
            p[axis.index] = axis.value(float(x))

    def residuals(self, P: Sequence[Array]) -> Array:
        """(K, N, channels) predictions minus readings; zero where no reading counts."""
        if not len(P):
            return np.zeros((0, *self.bench.measured.shape))
        self.simulations += len(P)
        e = self.bench.simulate(np.array(P))
        e -= self.bench.measured
        e[:, ~self.bench.counted] = 0.0
        return e

    # ---- linearisation

    def linearise(
        self, state: JointState, whitener: Whitener, probe: bool, precision: Array
    ) -> tuple[JointState, Linear]:
        """Linearise about a state.

        Parameters
        ----------
        probe : whether causes that are not simulated are probed from all their starts; the best start of each is kept.
        precision : (causes,) prior precisions of magnitudes, for choosing these starts.
        """
        state = self._at_probes(state)
        p, nt, E = self.vector(state), len(self.tolerances), len(self.causes)
        ons = [k for k in range(E) if state.on[k] and not self.smooth[k]]
        offs = [k for k in range(E) if not self.smooth[k] and not state.on[k]]
        jumps = [k for k in range(E) if self.causes[k].main.shift and not state.on[k] and self.causes[k].zone > 0]
        seconds = [(k, j, axis) for k in ons for j, axis in enumerate(self._form(state, k).candidate.axes[1:])
                   if axis.low < axis.high]  # fmt: skip
        kept = [] if probe else [k for k in offs if k in self._slopes]
        starts = [(k, f, s) for k in offs if k not in kept for f, s in self._starts(k, probe)]
        e, slopes = self._differences(p, [
            *(self._by_magnitude(p, state, k) for k in ons),
            *(_Difference(_with(p, self.causes[k].main, CAL.at_once * self.zone[k]), None, 1.0) for k in jumps),
            *(_Difference(_with(p, axis, axis.value(axis.mean + axis.sd)), None, axis.sd) for axis in self.shifts),
            *(self._probe(p, *start) for start in starts),
        ])  # fmt: skip
        every, by_starts = self._columns(e, p, [axis for _, _, axis in seconds], slopes[len(ons) :])
        for k, slope in [*zip(ons, slopes, strict=False), *((k, self._slopes[k]) for k in kept)]:
            every[:, :, 1 + nt + k] = slope
        white = whitener.white(_limited(every)).reshape(-1, every.shape[2])
        count, at_mains = every.shape[2] - len(starts), 1 + nt
        if starts:
            known = np.setdiff1d(np.arange(E), [k for k, *_ in starts])
            beside = np.r_[1:at_mains, at_mains + E : count, at_mains + known]
            precisions = np.concatenate([self._precisions(whitener, seconds, len(jumps)), precision[known]])
            state = self._with_best_probes(state, starts, white, beside, precisions)
        for (k, f, s), column, slope in zip(starts, white.T[count:], slopes[len(slopes) - len(starts) :], strict=True):
            if (f, s) == self._probes.get(k):
                white[:, at_mains + k], self._slopes[k] = column, slope.copy()
        for k in ons:
            self._slopes.pop(k, None)
        return state, self._linear(state, white[:, :count], seconds, whitener, by_starts, len(jumps))

    def _columns(self, e: Array, p: Array, seconds: Sequence[Axis], others: Array) -> tuple[Array, int]:
        """Residuals and their derivatives by tolerances, magnitudes, second parameters, the starts of runs; others.

        Parameters
        ----------
        e : (N, channels) residuals.
        p : parameters.
        seconds : axes of second parameters.
        others : (K, N, channels) further columns.

        Returns
        -------
        (N, channels, columns), those of magnitudes zero that the bench does not differentiate by; the number of starts.
        """
        nt, smooth, E = len(self.tolerances), np.flatnonzero(self.smooth), len(self.causes)
        axes = [*self.tolerances, *(self.causes[k].main for k in smooth), *seconds]
        _, J, S = self.bench.linearise(p, [axis.index for axis in axes])
        rest = nt + len(smooth)
        edges = np.cumsum([1, nt, E, len(seconds), S.shape[2], len(others)])
        if len(self._room) < e.size * edges[-1]:
            self._room = np.empty(e.size * edges[-1])
        every, by_axes = self._room[: e.size * edges[-1]].reshape(e.size, edges[-1]), J.reshape(e.size, len(axes))
        every[:, 0] = e.ravel()
        mixed = self.mix * _by_coordinates(p, self.tolerances)[:, None]
        np.matmul(by_axes[:, :nt], mixed, out=every[:, 1 : edges[1]])
        every[:, edges[1] : edges[2]] = 0.0
        every[:, edges[1] + smooth] = by_axes[:, nt:rest]
        np.multiply(by_axes[:, rest:], _by_coordinates(p, seconds), out=every[:, edges[2] : edges[3]])
        every[:, edges[3] : edges[4]] = S.reshape(e.size, S.shape[2])
        every[:, edges[4] :] = others.reshape(len(others), e.size).T
        return every.reshape(*e.shape, edges[-1]), S.shape[2]

    def _differences(self, p: Array, requested: Sequence[_Difference]) -> tuple[Array, Array]:
        """(N, channels) residuals at p, and (K, N, channels) difference quotients; those that diverge are zero."""
        K, centred = len(requested), [k for k, each in enumerate(requested) if each.below is not None]
        e = self.residuals([p, *(each.above for each in requested),
                            *(each.below for each in requested if each.below is not None)])  # fmt: skip
        before = dict(zip(centred, e[1 + K :], strict=True))
        slopes = e[1 : 1 + K]  # a view
        for k, (slope, each) in enumerate(zip(slopes, requested, strict=True)):
            slope -= before.get(k, e[0])
            slope /= each.step
        with np.errstate(all="ignore"):
            finite = np.isfinite(np.sum(slopes))
        if not finite:
            slopes[~np.isfinite(slopes)] = 0.0
        return e[0], slopes

    def _form(self, state: JointState, k: int) -> Form:
        return self.causes[k].forms[state.form[k]]

    def _by_magnitude(self, p: Array, state: JointState, k: int) -> _Difference:
        """The difference by the magnitude of a simulated cause.

        About a delay it is centred, half a row to either side, less far where the delay is shorter. A difference to one
        side alone describes what would be a row later: a step that follows it may raise the cost, and is then refused
        together with the steps of all other coordinates.
        """
        axis, m = self.causes[k].main, float(state.m[k])
        if axis.shift:
            half = min(max(0.5 * self.bench.sample_time, 0.05 * (m - axis.null)), CAL.within_delay * (m - axis.null))
            start, end = m - half, min(m + max(half, CAL.shifted), float(self.high[k]))
            below, above = (_with(p, axis, axis.value(x)) for x in (start, end))
            return _Difference(above, below, max(end - start, CAL.shifted))
        step = 0.02 * max(abs(m - axis.null), 0.3 * self.causes[k].usual)
        if m + step > self.high[k]:
            step = -step
        return _Difference(_with(p, axis, axis.value(m + step)), None, step)

    def _probe(self, p: Array, k: int, form: int, start: int) -> _Difference:
        """The secant of a cause from its null to one of its starts."""
        q, at = p.copy(), self.causes[k].forms[form].starts[start]
        self._place(q, k, form, at)
        return _Difference(q, None, at[0] - self.causes[k].main.null)

    def _starts(self, k: int, probe: bool) -> list[tuple[int, int]]:
        """(form, start) pairs from which a cause that is not simulated is probed."""
        if probe or k not in self._probes:
            return [(f, s) for f, form in enumerate(self.causes[k].forms) for s in range(len(form.starts))]
        return [self._probes[k]]

    def _precisions(self, whitener: Whitener, seconds: Sequence[tuple[int, int, Axis]], jumps: int) -> Array:
        """Prior precisions of all coordinates but magnitudes: tolerances, second parameters, first-order ones."""
        sds = [*self.theta_sd, *(axis.sd for _, _, axis in seconds), *self._of_starts(whitener),
               *[CAL.jumps_sd] * jumps, *(axis.sd for axis in self.shifts)]  # fmt: skip
        return np.asarray(1 / np.array(sds) ** 2)

    def _of_starts(self, whitener: Whitener) -> list[float]:
        """Prior standard deviations of the states at the starts of runs: those of the readings that they start at."""
        channel = [self.bench.channels.index(self.bench.model.states[k].name) for k in self.bench.loose]
        return [float(whitener.stationary_sd[c]) for _ in self.bench.runs for c in channel]

    def _with_best_probes(
        self, state: JointState, starts: Sequence[tuple[int, int, int]], columns: Array, beside: Array, known: Array
    ) -> JointState:
        """The state with each cause that is not simulated at the start from which it explains most beside all else.

        Parameters
        ----------
        starts : (cause, form, start) of each probe.
        columns : (R, C) whitened: residuals first, those of the probes last.
        beside : indices of the columns of all else.
        known : prior precisions of the latter.
        """
        probes, products = self._probes, columns.T @ columns
        each = np.arange(columns.shape[1] - len(starts), columns.shape[1])
        solve = inverse(products[np.ix_(beside, beside)] + np.diag(known))
        cross = products[np.ix_(beside, each)]
        left = products[each, 0] - cross.T @ (solve @ products[beside, 0])
        curve = np.maximum(np.diag(products)[each] - np.sum(cross * (solve @ cross), axis=0), 1e-12)
        best = dict[int, float]()
        for (k, f, s), g, h in zip(starts, left, curve, strict=True):
            size = self.causes[k].forms[f].starts[s][0] - self.causes[k].main.null
            slab = 1 / self.usual[k] ** 2
            at = -g / (h + slab)
            signed = self.causes[k].gradual and not any(o.unit == "rad" for o in self.causes[k].forms[f].seconds)
            reach = CAL.beyond_start * abs(size)
            c = float(np.clip(at, -reach if signed else 0.0, reach)) if size > 0 else float(np.clip(at, -reach, 0.0))
            gain = -g * c - 0.5 * (h + slab) * c * c
            if k not in best or gain > best[k]:
                best[k] = gain
                probes[k] = (f, s)
        return self._at_probes(state)

    def _at_probes(self, state: JointState) -> JointState:
        """The state with causes that are not simulated in the form and at the start of their best probe."""
        seconds, forms = list(state.seconds), list(state.form)
        for k, (f, s) in self._probes.items():
            if not state.on[k]:
                forms[k], seconds[k] = f, _at_start(self.causes[k].forms[f], s)
        return replace(state, seconds=tuple(seconds), form=tuple(forms))

    def _linear(
        self, state: JointState, columns: Array, seconds: Sequence[tuple[int, int, Axis]], whitener: Whitener,
        starts: int, jumps: int,
    ) -> Linear:  # fmt: skip
        nt, E, shifts = len(self.tolerances), len(self.causes), len(self.shifts)
        reach = CAL.reach_sd * self.theta_sd
        t_low = np.maximum([axis.low for axis in self.tolerances], self.theta_mean - reach)
        t_high = np.minimum([axis.high for axis in self.tolerances], self.theta_mean + reach)
        low, high = self.low.copy(), self.high.copy()
        for k in range(E):
            if not self.smooth[k] and not state.on[k]:
                form = self._form(state, k)
                size = abs(form.starts[self._probes.get(k, (0, 0))[1]][0] - self.null[k]) if form.starts else np.inf
                low[k] = max(low[k], self.null[k] - CAL.beyond_start * size)
                high[k] = min(high[k], self.null[k] + CAL.beyond_start * size)
        nx, nf = len(seconds), starts + jumps + shifts
        at_seconds = [state.seconds[k][j] for k, j, _ in seconds]
        of_seconds = [axis for _, _, axis in seconds]
        ones, inf, none = np.ones(jumps), np.full(starts, np.inf), np.zeros(starts + jumps)
        return Linear(
            columns=columns,
            at=np.concatenate([state.theta, state.m, at_seconds, none, [a.mean for a in self.shifts]]),
            mean=np.concatenate([self.theta_mean, self.mean, [a.mean for a in of_seconds], none,
                                 [a.mean for a in self.shifts]]),
            low=np.concatenate([t_low, low, [a.low for a in of_seconds], -inf, 0 * ones, [a.low for a in self.shifts]]),
            high=np.concatenate([t_high, high, [a.high for a in of_seconds], inf, ones, [a.high for a in self.shifts]]),
            sd=np.concatenate([self.theta_sd, self.zone, [a.sd for a in of_seconds], self._of_starts(whitener),
                               CAL.jumps_sd * ones, [a.sd for a in self.shifts]]),
            cause=np.array([*[-1] * nt, *range(E), *(k for k, _, _ in seconds), *[-1] * nf], dtype=int),
            main=np.concatenate([np.zeros(nt), np.ones(E), np.zeros(nx + nf)]).astype(bool),
            moved=np.concatenate([np.ones(nt), self.smooth | state.on, np.ones(nx), np.zeros(nf)]).astype(bool),
        )  # fmt: skip

    def formed(self, state: JointState, k: int, form: int) -> JointState:
        """The state with a cause in one of its forms, not simulated, and probed from the form's first start."""
        if form == state.form[k]:
            return state
        self._probes[k] = (form, 0)
        on = state.on.copy()
        on[k] = False
        return self._at_probes(replace(state, on=on))

    def forget(self, which: Mask | None = None) -> None:
        """Drop kept columns of causes that are not simulated, (causes,) some or all: they lie about another state."""
        for k in [k for k in self._slopes if which is None or which[k]]:
            del self._slopes[k]

    def moved(self, state: JointState, x: Array, on: Mask) -> JointState:
        """The state at coordinates `x` of `Linear`, with the causes `on` simulated at their magnitudes there."""
        nt, E = len(self.tolerances), len(self.causes)
        m = np.clip(np.where(self.smooth | on, x[nt : nt + E], self.null), self.low, self.high)
        seconds, place = [list(second) for second in state.seconds], nt + E
        for k in range(E):
            if state.on[k] and not self.smooth[k]:
                for j, axis in enumerate(self._form(state, k).candidate.axes[1:]):
                    if axis.low < axis.high:
                        seconds[k][j] = x[place]
                        place += 1
        return JointState(x[:nt], m, tuple(tuple(second) for second in seconds), state.form, on.copy())


def _with(p: Array, axis: Axis, value: float) -> Array:
    """Parameters with another value of one."""
    q = p.copy()
    q[axis.index] = value
    return q


def _by_coordinates(p: Array, axes: Sequence[Axis]) -> Array:
    """(axes,) derivatives of parameters by their coordinates."""
    return np.array([p[axis.index] if axis.relative else 1.0 for axis in axes])


def _limited(values: Array) -> Array:
    """Clip values to +- `CAL.far` in place; NaN becomes zero."""
    np.clip(values, -CAL.far, CAL.far, out=values)
    if np.isnan(np.sum(values)):
        values[np.isnan(values)] = 0.0
    return values


def _at_start(form: Form, s: int) -> tuple[float, ...]:
    """Second parameters at one of a form's starts; their means or held values where it has none."""
    if form.starts:
        return form.starts[s][1:]
    return tuple(axis.mean if axis.low < axis.high else axis.low for axis in form.candidate.axes[1:])
