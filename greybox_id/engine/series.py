"""A model applied to the unbroken runs of a recording: predictions and their derivatives, all rows at once.

Rows are samples. The output at row k + 1 follows from the window of rows k - memory + 1 ... k; no window
crosses a join or a missing value. In closed loop the fed-back inputs come from `nodes`, one value of every
output per row: predictions (simulated in CasADi's virtual machine) or free variables of a lifted problem.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import lapack

from ..base.errors import BadInput
from ..base.shorthands import Array, Index, Mask
from ..datasets.recording import Recording
from .free_run import free_run
from .trace import Columns, Trace, tidy
from .windows import samples, weighted_windows, windows

SAMPLE_TIME_TOLERANCE = 0.02
"""Largest relative difference between the sample times of a recording and of the model."""


@dataclass(frozen=True)
class Linearisation:
    """Predictions of one run with their derivatives.

    Attributes
    ----------
    y : (rows, outputs) predictions.
    by_p : (rows, outputs, parameters) derivative by the parameters, nodes fixed.
    by_nodes : (rows, outputs, memory, outputs) derivative by the nodes in the window, oldest first; None in open loop.
    """

    y: Array
    by_p: Array
    by_nodes: Array | None


class Run:
    """One unbroken run with a traced model.

    Attributes
    ----------
    trace : the model.
    recorded : (n, inputs) as recorded; NaN where a fed-back input was not recorded.
    measured : (n, outputs) recorded outputs; NaN where not recorded.
    rows : the recording's rows of the n samples.
    pieces : row ranges (of the run) that actuators run through; one, unless windows may cross joins.
    actuation : the model's actuators.
    first : first row (of the run) with a prediction; predictions cover rows first ... n-1.
    unpredicted : the rows before it, which hold measurements in closed loop too.
    """

    def __init__(self, trace: Trace, recording: Recording, rows: range, joins: Sequence[int] = ()) -> None:
        self.trace, model = trace, trace.model
        self.rows = rows
        edges = [0, *(join - rows.start for join in joins if rows.start < join < rows.stop), len(rows)]
        self.pieces = [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]
        self.first = trace.memory
        self.unpredicted: slice | Mask = slice(0, self.first)
        self.recorded = np.column_stack(
            [_input(trace, recording, name)[rows.start : rows.stop] for name in model.inputs]
        )
        nothing = np.full(len(rows), np.nan)
        self.measured = np.column_stack(
            [recording[n][rows.start : rows.stop] if n in recording else nothing for n in model.outputs]
        )
        self._fed = [model.inputs.index(name) for name in trace.fed_back]
        self.actuation = trace.actuation
        self._constant_stage_by_p: list[Array] | None = None
        self._stage_at_zero: Array | None = None
        self._constant_weights_by_p: Array | None = None
        self._seen: tuple[Array, Array, Array | None] | None = None
        self._looked: tuple[Array, Array, Array, Array] | None = None

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def complete(self) -> bool:
        """Whether the fed-back inputs were recorded too."""
        return not np.any(np.isnan(self.recorded))

    @property
    def predicted(self) -> slice:
        """Rows of the run with a prediction."""
        return slice(self.first, len(self))

    def inputs(self, p: Array, nodes: Array | None) -> tuple[Array, Array | None]:
        """Inputs of the equations, (n, inputs), and their derivative, (n, inputs, parameters) or None.

        `nodes` (n, outputs) determine the fed-back inputs; with None these are as recorded.
        """
        if nodes is None or not self._fed:
            return self._commanded(p)
        u, u_by_p = self._commanded(p)
        u = u.copy()
        u[:, self._fed] = self.trace.feedback(nodes, np.where(np.isnan(u), 0.0, u))
        return u, u_by_p

    def _commanded(self, p: Array) -> tuple[Array, Array | None]:
        """The recorded inputs after their actuators, recomputed only when an actuator's parameter changes."""
        acting = p[self.actuation.touched]
        if self._seen is None or not np.array_equal(self._seen[0], acting):
            self._seen = (acting, *self.actuation(self.recorded, p, self.pieces))
            self._constant_stage_by_p = self._stage_at_zero = None
        return self._seen[1], self._seen[2]

    def predict(self, p: Array, nodes: Array | None = None) -> Array:
        """Predictions for rows first ... n-1, (rows, outputs), from the recorded inputs or from nodes."""
        u, _ = self.inputs(p, nodes)
        _, h = self._windows(u, p)
        return self.trace.head(h, self._newest(u), p)

    def simulate(self, p: Array, runs: Sequence[slice] = (slice(0, None),)) -> Array:
        """Closed loop from the first window of each run on: nodes (n, outputs), measured before, predicted from there.

        Parameters
        ----------
        p : (parameters,).
        runs : rows of each run, if several are concatenated here.
        """
        if not self._fed:
            return np.vstack([self.measured[: self.first], self.predict(p)])
        u, _ = self.inputs(p, self.measured)
        return free_run(self.trace, u, self.measured, p, [slice(*run.indices(len(self))[:2]) for run in runs])

    def linearise(self, p: Array, nodes: Array | None = None, weight: Array | None = None) -> Linearisation:
        """Predictions and derivatives, with the recorded inputs or around nodes.

        Parameters
        ----------
        p : (parameters,).
        nodes : (n, outputs).
        weight : (rows, outputs) factors on the derivatives by the parameters.
        """
        trace = self.trace
        u, u_by_p = self.inputs(p, nodes)
        z, h = self._windows(u, p)
        newest = self._newest(u)
        weights = trace.weights(p).reshape(len(trace.tap_signal), trace.memory)
        direct, outputs = trace.head_by_p, len(trace.model.outputs)
        y, y_by_h, y_by_p = self._head_by_p(h, newest, p)
        with_inputs = u_by_p is not None or nodes is not None
        y_by_u = trace.head_by_u.nonzeros(h, newest, p) if with_inputs else np.empty((len(h), 0))
        weighted = [y_by_h, y_by_p, y_by_u]
        if weight is not None:
            of_outputs = (trace.head_by_h.row, direct.row, trace.head_by_u.row)
            pairs = zip(weighted, of_outputs, strict=True)  # stored by columns, as they are used
            weighted = [(of.T * weight.T[rows]).T if of.size else of for of, rows in pairs]
        by_p = _Sum(len(h), outputs, len(p), by_rows=nodes is not None)
        z_by_p = self._stage_by_p(u, p)
        z_by_u = trace.stage_by_u.nonzeros(u, p) if nodes is not None or u_by_p is not None else None
        through_stage: dict[int, tuple[Columns, Array]] = {}
        for tap, signal in enumerate(trace.tap_signal):
            columns, h_by_p = self._through_stage(int(signal), z_by_p, z_by_u, u_by_p, weights[tap])
            first = trace.first_alike[tap] if u_by_p is None else tap
            if first in through_stage:  # one sum for all windows that act alike: J is written once
                np.add(through_stage[first][1], h_by_p, out=through_stage[first][1])
            elif h_by_p.size:
                through_stage[first] = columns, h_by_p
        for tap, (columns, h_by_p) in through_stage.items():
            for k, output in trace.tap_outputs[tap]:
                by_p.add(output, columns, weighted[0][:, k, None], h_by_p)
        seen: dict[int, Array] = {}
        for tap, signal in enumerate(trace.tap_signal.tolist()):
            if len(trace.tap_weights[tap].places):
                if signal not in seen:
                    seen[signal] = samples(z[:-1, signal], trace.memory)
                h_by_p = self._through_weights(tap, seen[signal], p)
                for k, output in trace.tap_outputs[tap]:
                    by_p.add(output, trace.tap_weights[tap].at, weighted[0][:, k, None], h_by_p)
        for k, (output, column) in enumerate(zip(direct.row, direct.column, strict=True)):
            by_p.add(output, slice(column, column + 1), weighted[1][:, k, None], 1.0)
        if u_by_p is not None:
            newest_by_p = u_by_p[trace.memory - 1 : -1]
            for k, (output, signal) in enumerate(zip(trace.head_by_u.row, trace.head_by_u.column, strict=True)):
                by_p.add(output, slice(0, len(p)), weighted[2][:, k, None], newest_by_p[:, signal])
        by_nodes = None
        if nodes is not None and z_by_u is not None:
            by_nodes = self._by_nodes(nodes, u, z_by_u, y_by_h, y_by_u, weights)
        return Linearisation(y, by_p.total(), by_nodes)

    def adjoint_product(self, p: Array, weighed: Callable[[Array], Array], nodes: Array | None = None) -> Array | None:
        """Derivative of the weighted sum of the predictions by the parameters, (parameters,).

        Adjoint mode: windows backwards, without storing the Jacobian. Around matched nodes the derivative includes the
        parameters' effect through the nodes. None if a free parameter acts through an actuator.

        Parameters
        ----------
        weighed : predictions (rows, outputs) -> their weights (rows, outputs).
        """
        trace = self.trace
        u, u_by_p = self.inputs(p, nodes)
        if u_by_p is not None:
            return None
        z, h = self._windows(u, p)
        newest = self._newest(u)
        y, by_h, direct_by_p = self._head_by_p(h, newest, p)
        weights = weighed(y if nodes is None else nodes[self.predicted])
        of_window = trace.weights(p).reshape(len(trace.tap_signal), trace.memory)
        if nodes is not None and self._fed:
            slopes = trace.stage_by_u.nonzeros(u, p), by_h, trace.head_by_u.nonzeros(h, newest, p)
            weights = _fed_back(weights, self._by_nodes(nodes, u, *slopes, of_window))
        by_z = np.zeros((len(z) - 1, z.shape[1]))
        total = np.zeros(len(p))
        for tap, signal in enumerate(trace.tap_signal):
            by_tap = sum((weights[:, o] * by_h[:, k] for k, o in trace.tap_outputs[tap]), np.zeros(len(h)))
            if len(trace.stage_columns[signal]):
                by_z[:, signal] += np.convolve(by_tap, of_window[tap])
            tap_weight = trace.tap_weights[tap]
            if len(tap_weight.places):
                by_lag = np.correlate(z[:-1, signal], by_tap)
                np.add.at(
                    total,
                    trace.weights_by_p.column[tap_weight.places],
                    self._weights_by_p(p)[tap_weight.places] * by_lag[tap_weight.lags],
                )
        for signal, (by_p, columns) in enumerate(zip(self._stage_by_p(u, p), trace.stage_columns, strict=True)):
            total[columns] += by_z[:, signal] @ by_p[:-1]
        direct = trace.head_by_p
        if len(direct.row):
            np.add.at(total, direct.column, np.einsum("ij,ij->j", direct_by_p, weights[:, direct.row]))
        return total

    def _head_by_p(self, h: Array, newest: Array, p: Array) -> tuple[Array, Array, Array]:
        """Predictions, and the nonzeros of their derivatives by the windows' results and by the parameters."""
        outputs = len(self.trace.model.outputs)
        edges = [outputs, outputs + len(self.trace.head_by_h.row)]
        y, by_h, by_p = np.split(self.trace.head_with_slopes(h, newest, p), edges, axis=1)
        return y, by_h, by_p

    def _windows(self, u: Array, p: Array) -> tuple[Array, Array]:
        """Stage signals and the windows' results; cached, since an accepted trial step is linearised next."""
        trace, last = self.trace, self._looked
        if last is not None and u is last[0] and np.array_equal(p, last[1]):
            return last[2:]
        z = self._stage(u, p)
        weights = trace.weights(p).reshape(len(trace.tap_signal), trace.memory)
        h = np.empty((len(u) - trace.memory, len(weights)))
        for signal in range(z.shape[1]):
            taps = np.flatnonzero(trace.tap_signal == signal)
            h[:, taps] = samples(z[:-1, signal], trace.memory) @ weights[taps].T
        if self._seen is not None and u is self._seen[1]:  # inputs from fed-back predictions differ every time
            self._looked = u, p.copy(), z, h
        return z, h

    def _stage(self, u: Array, p: Array) -> Array:
        """Stage signals; a matrix product if they are linear in the parameters and the inputs are unchanged."""
        if not self._unmoved(u):
            return self.trace.stage(u, p)
        if self._stage_at_zero is None:
            self._stage_at_zero = self.trace.stage(u, np.zeros(len(p)))
        z = self._stage_at_zero.copy()
        for signal, (by_p, columns) in enumerate(zip(self._stage_by_p(u, p), self.trace.stage_columns, strict=True)):
            z[:, signal] += by_p @ p[columns]
        return z

    def _unmoved(self, u: Array) -> bool:
        """Whether the inputs are unchanged and the stage's derivative by the parameters is constant."""
        return self.trace.stage_by_p.constant and self._seen is not None and u is self._seen[1]

    def _stage_by_p(self, u: Array, p: Array) -> list[Array]:
        """Per signal, derivative of the stage by the parameters it depends on; cached if it is constant."""
        if self._unmoved(u) and self._constant_stage_by_p is not None:
            return self._constant_stage_by_p
        values = self.trace.stage_by_p.nonzeros(u, p)
        result = [values[:, tidy(places)] for places in self.trace.stage_places]
        if self._unmoved(u):
            self._constant_stage_by_p = result = [np.ascontiguousarray(item) for item in result]
        return result

    def _weights_by_p(self, p: Array) -> Array:
        """Nonzeros of the derivative of the windows' weights; cached if it is constant."""
        if not self.trace.weights_by_p.constant or self._constant_weights_by_p is None:
            self._constant_weights_by_p = self.trace.weights_by_p.nonzeros(p)[0]
        return self._constant_weights_by_p

    def _newest(self, u: Array) -> Array:
        return u[self.trace.memory - 1 : -1]

    def _through_stage(
        self, signal: int, z_by_p: list[Array], z_by_u: Array | None, u_by_p: Array | None, weights: Array
    ) -> tuple[Columns, Array]:
        """Derivative of one window's result by the parameters that its signal depends on, (rows, columns)."""
        trace, usable = self.trace, len(z_by_p[signal]) - 1
        columns, at = trace.stage_columns[signal], trace.stage_at[signal]
        signal_by_p = z_by_p[signal][:usable]
        if u_by_p is not None and z_by_u is not None:
            signal_by_p, columns = self._with_actuators(signal, signal_by_p, columns, z_by_u, u_by_p, usable)
            at = tidy(columns)
        return at, weighted_windows(signal_by_p, weights) if len(columns) else np.empty((0, 0))

    def _through_weights(self, tap: int, seen: Array, p: Array) -> Array:
        """Derivative of one window's result by the parameters in its weights, (rows, columns); `seen`: its samples."""
        tap_weight = self.trace.tap_weights[tap]
        slopes = self._weights_by_p(p)[tap_weight.places]
        if tap_weight.order is not None:
            ordered = slopes[tap_weight.order]
            weighted: Array = seen[:, tap_weight.samples]
            return weighted if np.all(ordered == 1.0) else weighted * ordered
        weights_by_p = np.zeros((self.trace.memory, len(tap_weight.columns)))
        weights_by_p[tap_weight.lags, tap_weight.among] = slopes
        return np.asarray(seen @ weights_by_p)

    def _with_actuators(
        self, signal: int, signal_by_p: Array, columns: Index, z_by_u: Array, u_by_p: Array, usable: int
    ) -> tuple[Array, Index]:
        """A stage signal's derivative by the parameters, with their effect through actuators added."""
        full = np.zeros((usable, u_by_p.shape[2]))
        full[:, columns] = signal_by_p
        for k in np.flatnonzero(self.trace.stage_by_u.row == signal):
            full += z_by_u[:usable, k, None] * u_by_p[:usable, self.trace.stage_by_u.column[k]]
        reached = np.flatnonzero(np.any(full, axis=0))
        return full[:, reached], reached

    def _by_nodes(self, nodes: Array, u: Array, z_by_u: Array, y_by_h: Array, y_by_u: Array, weights: Array) -> Array:
        trace, outputs = self.trace, len(self.trace.model.outputs)
        fed_by_y = trace.feedback_by_y(nodes, u).reshape(len(u), len(self._fed), outputs)
        fed_by_y[self.unpredicted] = 0.0  # before the first prediction the window holds measurements, not nodes
        usable = len(u) - 1
        rows = usable - trace.memory + 1
        result = np.zeros((rows, outputs, trace.memory, outputs))
        for position, column in enumerate(self._fed):
            u_by_y = fed_by_y[:usable, position]
            through_windows = np.zeros((outputs, rows, trace.memory))
            for tap, signal in enumerate(trace.tap_signal):
                for k in np.flatnonzero((trace.stage_by_u.row == signal) & (trace.stage_by_u.column == column)):
                    h_by_u = windows(z_by_u[:usable, k], trace.memory) * weights[tap]
                    for m, output in trace.tap_outputs[tap]:
                        through_windows[output] += y_by_h[:, m, None] * h_by_u
            for k in np.flatnonzero(trace.head_by_u.column == column):
                through_windows[trace.head_by_u.row[k], :, -1] += y_by_u[:, k]
            for by in np.flatnonzero(np.any(u_by_y, axis=0)):
                result[..., by] += (through_windows * windows(u_by_y[:, by], trace.memory)).transpose(1, 0, 2)
        return result


class _Sum:
    """A sum of derivatives by parameters, (rows, outputs, parameters), stored row by row or parameter by parameter.

    A window's derivative by its weights consists of its signal's samples, shifted by a row each: long copies if stored
    parameter by parameter, a dozen numbers at a time if row by row. Fed-back derivatives are propagated row by row.
    """

    def __init__(self, rows: int, outputs: int, parameters: int, by_rows: bool) -> None:
        by_parameters = np.empty((0 if by_rows else parameters, rows, outputs)).transpose(1, 2, 0)
        self._sum = np.empty((rows, outputs, parameters)) if by_rows else by_parameters
        self._filled = np.zeros((outputs, parameters), dtype=bool)

    def add(self, output: int, columns: Columns, outer: Array, inner: Array | float) -> None:
        """Add a product to an output's derivatives by some parameters."""
        filled = self._filled[output, columns]
        if not np.any(filled) and isinstance(columns, slice):
            np.multiply(outer, inner, out=self._sum[:, output, columns])
        else:
            if not np.all(filled):
                self._zero(output, columns)
            self._sum[:, output, columns] += outer * inner
        self._filled[output, columns] = True

    def _zero(self, output: int, columns: Columns) -> None:
        fresh = np.zeros(self._filled.shape[1], dtype=bool)
        fresh[columns] = True
        self._sum[:, output, fresh & ~self._filled[output]] = 0.0

    def total(self) -> Array:
        """The sum; zero where nothing was added."""
        for output, filled in enumerate(self._filled):
            self._sum[:, output, ~filled] = 0.0
        return self._sum


def _fed_back(weights: Array, by_nodes: Array) -> Array:
    """Weights of predictions, plus their effect through each prediction on later ones.

    Later predictions follow from earlier ones: what solves for the sum is a triangular matrix with a narrow band.
    """
    rows, outputs, memory, _ = by_nodes.shape
    band = np.zeros((rows, outputs, (memory + 1) * outputs))  # below the diagonal, by columns
    for back in range(1, min(memory, rows - 1) + 1):
        for output in range(outputs):
            for by in range(outputs):
                below = band[: rows - back, by, back * outputs + output - by]
                np.negative(by_nodes[back:, output, memory - back, by], out=below)
    total, _ = lapack.dtbtrs(band.reshape(rows * outputs, -1).T, weights.ravel(), uplo="L", trans="T", diag="U")
    return np.asarray(total.reshape(rows, outputs))


def runs(trace: Trace, recording: Recording, across_joins: bool = False) -> list[Run]:
    """The unbroken stretches of a recording that are long enough for the model's windows.

    Parameters
    ----------
    across_joins : let windows cross joins as if the recording were one run (as the published protocol of the
        model-structured networks does; its error there is meaningless).

    Raises
    ------
    BadInput : a required signal is missing, the sample time differs, or no run is long enough.
    """
    model = trace.model
    recording.require([n for n in _needed(trace) if n not in model.defaults], f"model {model.name}")
    if abs(recording.sample_time / model.sample_time - 1.0) > SAMPLE_TIME_TOLERANCE:
        raise BadInput(
            f"{recording.name} is sampled every {_duration(recording.sample_time)}, model {model.name} every "
            f"{_duration(model.sample_time)}. Resample the recording with greybox data convert, or build the "
            "model with another sample time."
        )
    joins = [start for start, _ in recording.runs] if across_joins else []
    if across_joins:
        recording = replace(recording, runs=((0, len(recording)),))
    present = [recording[name] for name in _needed(trace) if name in recording]
    complete = np.all(np.isfinite(np.column_stack(present)), axis=1)
    shortest = trace.memory + 1
    result = [Run(trace, recording, rows, joins) for rows in _unbroken(recording, complete) if len(rows) >= shortest]
    if not result:
        raise BadInput(
            f"{recording.name} has no unbroken run of {shortest} samples "
            f"({shortest * model.sample_time:.3g} s), which model {model.name} needs to predict one."
        )
    return result


def _duration(seconds: float) -> str:
    return f"{1e3 * seconds:.4g} ms" if seconds < 1.0 else f"{seconds:.4g} s"


def _needed(trace: Trace) -> tuple[str, ...]:
    """Recorded signals without which the model cannot start: its exogenous inputs and its outputs."""
    exogenous = [name for name in trace.model.inputs if name not in trace.fed_back]
    return tuple(dict.fromkeys([*exogenous, *trace.model.outputs]))


def _input(trace: Trace, recording: Recording, name: str) -> Array:
    if name in recording:
        return recording[name]
    return np.full(len(recording), trace.model.defaults.get(name, np.nan))


def _unbroken(recording: Recording, whole: Mask) -> list[range]:
    result = []
    for start, stop in recording.runs:
        gaps = [start - 1, *(start + np.flatnonzero(~whole[start:stop])).tolist(), stop]
        result += [range(a + 1, b) for a, b in zip(gaps[:-1], gaps[1:], strict=True) if b > a + 1]
    return result
