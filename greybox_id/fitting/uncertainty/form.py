"""Model-form error: how residuals depend on the drive, and the uncertainty of parameters that follows.

A model of the right form leaves residuals that depend on nothing: not on speed, steering, the size, sign or rate of the
predictions, nor on time. The residuals of an incomplete model do, and they show only the part of its error that no
parameter could absorb. The size of the absorbed part, which biased the parameters, is invisible; but both parts belong
to one error, so that one indicates the size of the other. Here the error of every output is a sum of functions of the
drive (`_output_error_functions`) with normal coefficients of zero mean and one standard deviation, a share of the
output's spread. Inputs may have errors as well, which affect all outputs at once: a sensor's offset, a ratio that
varies, a late command. Every input therefore has such functions too (`_input_errors`), which the model propagates. The
share with the largest marginal likelihood is taken (empirical Bayes); it is zero if there is nothing to explain. With
such an error, parameters have a larger covariance and another optimum: intervals include both.

Sources: Kennedy & O'Hagan, Bayesian calibration of computer models, J. R. Statist. Soc. B 63 (2001); Brynjarsdottir &
O'Hagan, Learning about physical parameters: the importance of model discrepancy, Inverse Problems 30 (2014).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...base.shorthands import Array, Index, Mask
from ...base.statistics import correlation_time, white_noise_sd
from ...engine.motion.shooting import MotionProblem, SimulatedRuns
from ..fit import CLEARLY
from .evidence import SHARES, Joint, OutputEquations, StartEquations, likeliest
from .halves import BLOCKS, BY_CHANCE, HALF, OTHERS, Deviations, mixed_halves, prediction_limit

NOISE_ALONE = (
    "Noise alone: the interval if the equations of the model were exact. The other intervals include the error of the "
    "equations."
)
"""Note below tables with both intervals."""
QUARTERS = 4
"""Parts of the rows in order of time, between which changes within a drive show."""
MOST_ROWS = 50_000
"""Largest number of rows used, evenly spread: dependences show in fewer, and memory is bounded."""
STEP = 0.01
"""Perturbation of an input for finite differences, in standard deviations of the input."""


@dataclass(frozen=True)
class OutputForm:
    """The residuals of one output.

    Attributes
    ----------
    residual : their root mean square, in the output's unit.
    spread : standard deviation of the readings.
    noise : standard deviation of the readings' white noise, NaN if unknown.
    share : size of one function of the drive in the error, over the spread.
    explained : share of the residuals' mean square explained by functions of the drive and errors of inputs.
    on : variables that they depend on, in words, with the share each explains, the largest first.
    gain : log evidence of such functions.
    independent : effective number of independent residuals.
    """

    residual: float
    spread: float
    noise: float
    share: float
    explained: float
    on: Mapping[str, float]
    gain: float
    independent: float


@dataclass(frozen=True)
class FormError:
    """Model-form error of a fit.

    Attributes
    ----------
    outputs : name -> its residuals.
    covariance : (unknowns, unknowns) contribution of the model-form error to the covariance of the unknowns.
    halves : share of the residuals' mean square explained by other parameters in the second half of the rows, in
        addition to functions of the drive; or in another later part, if that differs by more than chance.
    halves_gain : log evidence of other parameters there.
    first : number of blocks before that part, of `BLOCKS`.
    apart : whether that part differs by more than blocks within either part differ, beyond chance.
    mixed : whether the second half gains more than halves that mix early and late rows do, beyond chance.
    odd : blocks, counted from 0, that differ from all others by more than these among themselves.
    """

    outputs: Mapping[str, OutputForm]
    covariance: Array
    halves: float
    halves_gain: float
    first: int
    apart: bool
    mixed: bool
    odd: tuple[int, ...]

    def as_dict(self) -> dict[str, Any]:
        """All but the covariance, as plain data."""
        outputs = {name: asdict(one) for name, one in self.outputs.items()}
        names = ("halves", "halves_gain", "first", "apart", "mixed")
        return {"outputs": outputs} | {name: getattr(self, name) for name in names} | {"odd": [*self.odd]}


def form_error(problem: MotionProblem, x: Array, nodes: SimulatedRuns | None) -> FormError:
    """Estimate the model-form error from the residuals of a fit.

    Parameters
    ----------
    problem : the problem.
    x : (unknowns,) an optimum of it.
    nodes : the problem's simulation there; None, for hours of data, makes it here and releases other layouts.
    """
    simulated = problem.simulated_nodes(x) if nodes is None else nodes
    every = max(1, -(-len(simulated.y) // MOST_ROWS))
    problem.forget_targets()  # for hours of data, they would take memory beside drives and schedules of moved inputs
    series, y = list(_output_series(problem, simulated, every)), simulated.y[::every].copy()
    if nodes is None:
        del simulated
        problem.forget()
    input_errors = _input_errors(problem, x, y, every)
    simulated = _simulated_in_lanes(problem, x) if nodes is None else nodes
    low, high = problem.bounds
    inside = problem.free & (x > low) & (x < high)
    inside[problem.parameters.size :] = False
    block = BLOCKS * np.arange(len(series[0].error)) // len(series[0].error)
    by_block = _normal_equations(problem, x, simulated, series, input_errors, inside, every, block)
    count, group_of_parts = int(np.sum(inside)), len(series) + len(input_errors)
    sizes_of = [*(one.columns.shape[1] for one in series), *(one.effect.shape[2] for one in input_errors), count]
    owner = np.repeat(np.arange(group_of_parts + 1), sizes_of)
    unit = np.ones(len(owner))
    H, g, alone = _for_two_parts(by_block, tuple(range(HALF)), count)
    power = np.diag(H)[-count:] if count else np.zeros(0)
    whole = sum(float(np.sum((one.columns**2).max(axis=1))) / one.alone for one in series)
    unit[owner == group_of_parts] = np.sqrt(whole / np.maximum(power, 1e-300)) * (power > 0.0)
    joint = Joint(H, g, count)
    shares, gains = likeliest(joint, owner, unit, group_of_parts + 1)
    # a change may begin anywhere; intervals use halves only: the best of five splits would widen those of any drive
    change = _changed(by_block, count, shares, owner, unit, float(gains[group_of_parts]))
    widened, moved, sizes = joint.beside((shares[owner] * unit) ** 2)
    covariance = np.zeros((len(x), len(x)))
    covariance[np.ix_(inside, inside)] = widened + np.outer(moved, moved)
    of_inputs = [(one, sizes[owner == len(series) + k]) for k, one in enumerate(input_errors)]
    estimates = np.concatenate([moved, sizes])
    outputs = {
        one.name: one.seen(
            float(shares[k]), sizes[owner == k], float(gains[k]), of_inputs, alone[k].explained_share(estimates)
        )
        for k, one in enumerate(series)
    }
    deviation = sizes[owner == group_of_parts]
    if change.first != HALF:
        H, deviation = _deviation_of_part(by_block, tuple(range(change.first)), count, shares, owner, unit)
    total = sum(float(np.sum((one.error * one.weight) ** 2)) / one.alone for one in series)
    explained = float(deviation @ H[-count:, -count:] @ deviation) / max(total, 1e-300) if count else 0.0
    return FormError(outputs, covariance, float(np.clip(explained, 0.0, 1.0)), **vars(change))


_Normal = tuple[Array, Array, list[OutputEquations]]


@dataclass(frozen=True)
class _Change:
    """A change of parameters between parts of the rows; attributes as in `FormError`."""

    halves_gain: float
    first: int = HALF
    apart: bool = False
    mixed: bool = False
    odd: tuple[int, ...] = ()


def _changed(by_block: _Normal, count: int, shares: Array, owner: Index, unit: Array, of_half: float) -> _Change:
    """The part of the rows with other parameters, their log evidence, and whether it exceeds chance.

    Of several parts the least probable by chance is taken, with a correction for their number; not if a single block
    explains more: then the vehicle, or its error, differed in that block, and not from there on.
    """
    if count == 0:
        return _Change(of_half)
    H, g, _ = by_block
    model_terms = count, shares, owner, unit
    functions = len(g) - count * BLOCKS
    deviations = Deviations.of(H, g, (shares[owner[:functions]] * unit[:functions]) ** 2, unit[-count:])
    chances = {k: deviations.chance(range(k)) for k in (*OTHERS, HALF)}
    chance_of_block = [deviations.chance([k]) for k in range(BLOCKS)]
    odd = tuple(k for k, chance in enumerate(chance_of_block) if chance < BY_CHANCE / BLOCKS)
    best = min(chances, key=lambda k: chances[k])
    if best != HALF and chances[best] < min(BY_CHANCE / len(OTHERS), *chance_of_block):
        gain = _evidence_of_part(by_block, tuple(range(best)), *model_terms)
        if gain > CLEARLY:
            return _Change(gain, best, apart=True, odd=odd)
    if not of_half > CLEARLY:
        return _Change(of_half, odd=odd)
    mixed = [_evidence_of_part(by_block, one, *model_terms) for one in mixed_halves()]
    stands_out = of_half > prediction_limit(np.sqrt(mixed)) ** 2  # square roots of such gains are nearly normal
    return _Change(of_half, apart=chances[HALF] < BY_CHANCE, mixed=stands_out, odd=odd)


def _deviation_of_part(
    by_block: _Normal, first: Sequence[int], count: int, shares: Array, owner: Index, unit: Array
) -> tuple[Array, Array]:
    """Curvature with other parameters in all blocks but the `first`, and the estimated deviation of these parameters.

    Parameters
    ----------
    count, shares, owner, unit : as in `_evidence_of_part`.
    """
    H, g, _ = _for_two_parts((*by_block[:2], []), first, count)
    joint = Joint(H, g, count)
    variances = [(np.append(shares[:-1], share)[owner] * unit) ** 2 for share in SHARES]
    return H, joint.beside(max(variances, key=joint.evidence))[2][-count:]


def _evidence_of_part(
    by_block: _Normal, first: Sequence[int], count: int, shares: Array, owner: Index, unit: Array
) -> float:
    """Log evidence of other parameters in all blocks but the `first`, in addition to functions of these shares.

    Parameters
    ----------
    count : number of parameters.
    shares, owner, unit : as in `likeliest`; the last group is that of the parameters.
    """
    H, g, _ = _for_two_parts((*by_block[:2], []), first, count)
    joint, tried = Joint(H, g, count), []
    for share in SHARES:
        of_group = np.append(shares[:-1], share)
        tried.append(joint.evidence((of_group[owner] * unit) ** 2))
    return max(tried) - tried[0]


def _for_two_parts(by_block: _Normal, first: Sequence[int], count: int) -> _Normal:
    """Normal equations for two parts of the rows, from those by block of `_normal_equations`.

    Either part may have the other parameters; here it is the one without block 0.
    """
    H, g, alone = by_block
    rest = len(g) - count * (BLOCKS - 1)
    other = [float((k in first) != (0 in first)) for k in range(1, BLOCKS)]
    both = np.zeros((len(g), rest + count))
    both[:rest, :rest] = np.eye(rest)
    both[rest:, rest:] = np.kron(np.array(other)[:, None], np.eye(count))
    of_outputs = [OutputEquations(both.T @ one.H @ both, both.T @ one.g, one.total) for one in alone]
    return both.T @ H @ both, both.T @ g, of_outputs


@dataclass(frozen=True)
class _InputErrors:
    """Effects of errors of one input on the predictions.

    Attributes
    ----------
    name : name of the input.
    words : kind of error of each function, in words.
    effect : (N, outputs, functions) change of the predictions for an input error of one standard deviation.
    """

    name: str
    words: Sequence[str]
    effect: Array


@dataclass(frozen=True)
class _OutputSeries:
    """One output along all intervals, row by row.

    Attributes
    ----------
    name, place : name and index of the output.
    error, reading : (N,) in its unit, zero without a reading.
    read : (N,) whether there is a reading.
    weight : (N,) weight of a residual.
    columns : (N, functions) weighted functions, scaled to the output's spread; zero without a reading.
    words : variable of each function.
    edges : rows at which intervals begin and end.
    alone : mean squared weighted residual after regression on the functions, times its correlation time.
    correlation : that correlation time, rows.
    """

    name: str
    place: int
    error: Array
    reading: Array
    read: Mask
    weight: Array
    columns: Array
    words: Sequence[str]
    edges: Array
    alone: float
    correlation: float

    def seen(
        self, share: float, sizes: Array, gain: float, of_inputs: Sequence[tuple[_InputErrors, Array]], explained: float
    ) -> OutputForm:
        """Summary of the residuals, given the estimated sizes of functions of the drive and of errors of inputs."""
        unit = 1.0 / self.weight[self.read]
        square = max(float(np.mean(self.error[self.read] ** 2)), 1e-300)
        parts, words = [self.columns[self.read] * sizes * unit[:, None]], list(self.words)
        for one, sizes_of_input in of_inputs:
            parts.append(one.effect[self.read, self.place] * sizes_of_input)
            words += one.words
        table = np.hstack(parts)
        on = {
            word: float(np.mean(table[:, [item == word for item in words]].sum(axis=1) ** 2)) / square
            for word in dict.fromkeys(words)
        }
        readings = np.where(self.read, self.reading, np.nan)
        pieces = [readings[a:b] for a, b in zip(self.edges[:-1], self.edges[1:], strict=True)]
        return OutputForm(
            float(np.sqrt(square)), float(np.std(self.reading[self.read])), white_noise_sd(pieces, held=True), share,
            explained, dict(sorted(on.items(), key=lambda item: -item[1])), gain,
            float(np.count_nonzero(self.read)) / self.correlation,
        )  # fmt: skip


def _simulated_in_lanes(problem: MotionProblem, x: Array) -> SimulatedRuns:
    """The simulation in the lanes of the linearisation: in others, readings would be laid out twice."""
    problem.normal_equations(x, problem.simulated_nodes(x))
    return problem.simulated_nodes(x)


def _output_series(problem: MotionProblem, nodes: SimulatedRuns, every: int) -> Iterator[_OutputSeries]:
    model, runs = problem.model, problem.runs
    errors = problem.errors(nodes)[::every].copy()
    inputs = np.vstack([runs[i.run].inputs[i.start : i.stop] for i in problem.intervals])
    time = np.concatenate([runs[i.run].time[i.start : i.stop] for i in problem.intervals])
    edges = np.concatenate([[0], np.cumsum([i.rows for i in problem.intervals])])
    predicted = np.where(np.isfinite(nodes.y), nodes.y, 0.0)
    table = {name: predicted[:, k] for k, name in enumerate(model.outputs)}
    table |= {name: inputs[:, k] for k, name in enumerate(model.inputs)}
    # copies: a view of some rows would keep all in memory
    rates = {name: _rate(values, time, edges)[::every].copy() for name, values in table.items()}
    table, edges = {name: values[::every].copy() for name, values in table.items()}, -(-edges // every)
    predicted, count = predicted[::every].copy(), len(errors)
    quarter = QUARTERS * np.arange(count) // count
    for k, name in enumerate(model.outputs):
        read = np.isfinite(errors[:, k])
        if not np.any(read):
            continue
        error = np.where(read, errors[:, k], 0.0)
        reading = np.where(read, predicted[:, k] - error, 0.0)
        weight = np.where(read, problem.weight[::every, k], 0.0)
        spread = float(np.std(reading[read]))
        columns, words = [np.zeros(count)], ["nothing"]
        for word, values in _output_error_functions(name, table, rates, quarter, model.inputs):
            power = float(np.sqrt(np.mean(values[read] ** 2)))
            if np.isfinite(power) and power > 1e-9 * float(np.max(np.abs(values), initial=0.0)):
                columns.append(values * (spread / power) * weight)
                words.append(word)
        table_of = np.column_stack(columns)
        alone, correlation = _unexplained(table_of[read], (error * weight)[read])
        yield _OutputSeries(name, k, error, reading, read, weight, table_of, words, edges, alone, correlation)


def _output_error_functions(
    name: str, table: Mapping[str, Array], rates: Mapping[str, Array], quarter: Index, inputs: Sequence[str]
) -> Iterator[tuple[str, Array]]:
    """Functions to which the error of an output may be proportional: words and (N,) values."""
    y, dy, v = table[name], rates[name], table.get("v_x")
    yield "none of the drive", np.ones(len(y))
    for power in (1, 3):
        yield f"the size of {name}", y**power
    yield f"the sign of {name}", np.abs(y)
    yield f"the size of {name}", y * np.abs(y)
    yield f"the rate of change of {name}", dy
    for q in range(1, QUARTERS):
        yield "time", (quarter >= q).astype(float)
        yield "time", (quarter >= q) * y
    if v is not None and name != "v_x":
        pace = v - np.mean(v)
        for values in (pace, y * pace, y * pace**2):
            yield "v_x", values
        yield f"the rate of change of {name}", dy * pace
    for other in inputs:
        if other != "v_x":
            u = table[other]
            for values in (u, np.abs(u), u * np.abs(u)):
                yield other, values
            yield f"the rate of change of {other}", rates[other]


def _input_errors(problem: MotionProblem, x: Array, y: Array, every: int) -> list[_InputErrors]:
    """Effects of each input's errors, by simulations with slightly changed inputs; `y`: predictions of these rows."""
    runs, result = problem.runs, list[_InputErrors]()
    edges = np.concatenate([[0], np.cumsum([len(run) for run in runs])])
    one = len(runs) == 1  # no second copy of what may be hours of data
    time = runs[0].time if one else np.concatenate([run.time for run in runs])
    inputs = runs[0].inputs if one else np.vstack([run.inputs for run in runs])
    table = {name: inputs[:, k] for k, name in enumerate(problem.model.inputs)}
    for k, name in enumerate(problem.model.inputs):
        u, spread = inputs[:, k], float(np.std(inputs[:, k]))
        if not spread > 1e-9 * max(1.0, float(np.max(np.abs(u)))):
            continue
        words, effects = [], []
        for word, values in _input_error_functions(name, table, _rate(u, time, edges), spread):
            power = float(np.sqrt(np.mean(values**2)))
            if not 0.0 < power < np.inf:
                continue
            moved = inputs.copy()
            moved[:, k] += STEP * spread / power * values
            other = problem.driven_by([moved[a:b] for a, b in zip(edges[:-1], edges[1:], strict=True)])
            change = (other.predicted_readings(x[None])[0, ::every] - y) / STEP
            del other, moved, values  # large for hours of data
            words.append(word)
            effects.append(np.where(np.isfinite(change), change, 0.0))
        if effects:
            result.append(_InputErrors(name, words, np.stack(effects, axis=2)))
    return result


def _input_error_functions(
    name: str, table: Mapping[str, Array], du: Array, spread: float
) -> Iterator[tuple[str, Array]]:
    """Functions that the error of an input may be proportional to: words and (n,) values."""
    u, v = table[name], table.get("v_x")
    yield f"an offset of the {name} signal", np.ones(len(u))
    yield f"a wrong gain of the {name} signal", u
    yield f"a gain of the {name} signal that varies with its size", u * np.abs(u)
    yield f"a gain of the {name} signal that varies with its size", u**3
    yield f"the sign of {name}", np.abs(u)
    yield f"the rate of change of {name}", du
    if v is not None and name != "v_x" and float(np.std(v)) > 1e-3 * float(np.mean(np.abs(v))):
        yield f"a gain of the {name} signal that varies with v_x", u * (v - np.mean(v)) / np.std(v)


def _rate(values: Array, time: Array, edges: Array) -> Array:
    """(N,) time derivative, interval by interval; zero in intervals of one row."""
    result = np.zeros(len(values))
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        if b - a > 1:
            result[a:b] = np.gradient(values[a:b], time[a:b])
    return result


def _unexplained(columns: Array, residuals: Array) -> tuple[float, float]:
    """Mean square of the residuals after regression on functions of the drive, times its correlation time in rows; and
    that time. With fewer than twice as many rows as functions, there is no regression.
    """
    left, count = residuals, len(residuals)
    if count > 2 * columns.shape[1]:
        left = residuals - columns @ np.linalg.lstsq(columns, residuals, rcond=1e-6)[0]
        count -= columns.shape[1]
    correlation = correlation_time(left[:, None])
    return max(float(np.sum(left**2)) / count, 1e-300) * correlation, correlation


def _normal_equations(
    problem: MotionProblem, x: Array, nodes: SimulatedRuns, series: Sequence[_OutputSeries],
    input_errors: Sequence[_InputErrors], kept: Mask, every: int, part: Index,
) -> tuple[Array, Array, list[OutputEquations]]:  # fmt: skip
    """Normal equations of the kept parameters, of the coefficients of functions of the drive and of errors of inputs,
    and of deviations of kept parameters in each of the `BLOCKS` parts of the rows but the first, `part` (N,); and those
    of each output.

    Residuals are weighted by their effective number. Initial states are eliminated, interval by interval.
    """
    place, count = np.cumsum(kept) - 1, int(np.sum(kept))
    firsts = count + np.concatenate([[0], np.cumsum([one.columns.shape[1] for one in series])]).astype(int)
    common = np.dstack([one.effect for one in input_errors]) if input_errors else np.zeros((*nodes.y[::every].shape, 0))
    last = int(firsts[-1]) + common.shape[2]
    size = last + count * (BLOCKS - 1)
    H, g = np.zeros((size, size)), np.zeros(size)
    H[:count, :count] = problem.prior_curvature[np.ix_(kept, kept)]
    g[:count] = problem.prior_gradient(x)[kept]
    first_loose = problem.parameters.size
    alone = [OutputEquations(np.zeros_like(H), np.zeros_like(g), 0.0) for _ in series]
    rows_of_intervals = list(problem.rows_of_intervals(nodes))
    loose_of = [index >= first_loose for index in problem.layout.index]
    eliminated = [StartEquations.of(int(np.sum(loose)), len(g)) for loose in loose_of]
    for k, begin, residuals, J in problem.parts(x, nodes):
        rows = rows_of_intervals[k][begin : begin + len(residuals)]
        chosen = rows % every == 0
        rows, residuals, J = rows[chosen] // every, residuals[chosen], J[chosen]
        index, loose = problem.layout.index[k], loose_of[k]
        kept_of_interval = kept[index]
        at = place[index[kept_of_interval]]
        for one, first, squares in zip(series, firsts[:-1], alone, strict=True):
            scale = 1.0 / np.sqrt(one.alone)
            r, by_p = residuals[:, one.place] * scale, J[:, one.place] * scale
            elsewhere = (r == 0.0) & np.all(by_p == 0.0, axis=1)  # in another part, or without a reading
            row_scale = np.where(elsewhere, 0.0, scale)[:, None]
            wide = np.zeros((len(rows), len(g)))
            wide[:, at] = by_p[:, kept_of_interval]
            wide[:, first : first + one.columns.shape[1]] = one.columns[rows] * row_scale
            wide[:, firsts[-1] : last] = common[rows, one.place] * (one.weight[rows][:, None] * row_scale)
            for later in np.unique(part[rows][part[rows] > 0]):
                wide[:, last + count * (later - 1) + at] = by_p[:, kept_of_interval] * (part[rows] == later)[:, None]
            squares.add(wide, r)
            eliminated[k].add(by_p[:, loose], wide, r)
    H += sum(one.H for one in alone)
    g += sum(one.g for one in alone)
    for starts in eliminated:
        starts.eliminate_from(H, g)
    return H, g, alone
