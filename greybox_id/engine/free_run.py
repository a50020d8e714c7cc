"""A model with memory on its own predictions: they are fed back into the windows, row after row.

What does not depend on a fed-back value is evaluated for all rows at once beforehand: windows of signals that are not
fed back, and the parts of the equations that only use them. The rest runs in CasADi's virtual machine.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import casadi as cs
import numpy as np

from ..base.shorthands import Array, Index
from .trace import Trace
from .virtual import SampledFunction, call, on_arrays
from .windows import samples

LOOP = 32
"""Steps of the loop per CasADi call: of MS-NN-full, making the function takes 10 ms, as long as two simulations of 2440
samples; with twice as many steps it takes twice the time, and saves no more than a tenth of a simulation's."""


def free_run(trace: Trace, u: Array, measured: Array, p: Array, runs: Sequence[slice]) -> Array:
    """Recorded outputs up to the first window of each run, and predictions from there on.

    Parameters
    ----------
    u : (n, inputs) inputs of the equations; the fed-back ones hold measurements before row `memory` of each run and are
        ignored from there on.
    measured : (n, outputs) recorded outputs; row memory - 1 of a run starts its loop.
    p : (parameters,).
    runs : rows of each run.

    Returns
    -------
    (n, outputs).
    """
    loop, first = _loop(trace), trace.memory
    u = np.nan_to_num(u)
    rows, fixed = loop.known(u, p)
    result = measured.copy()
    for run in runs:
        newest = run.start + first - 1
        past, y = trace.stage(u[run.start : newest], p)[:, loop.signals] if first > 1 else np.empty(0), measured[newest]
        for start in range(run.start + first, run.stop, LOOP):
            stop = min(start + LOOP, run.stop)
            known = rows[start - first : stop - first]
            if len(known) < LOOP:
                known = np.concatenate([known, np.repeat(known[-1:], LOOP - len(known), axis=0)])
            predicted, past = loop.steps(past, y, known, fixed)
            result[start:stop] = predicted[: stop - start]
            y = predicted[-1]
    return result


class _Loop:
    """The loop of a model, divided into what is known of every row before the loop and what follows in it.

    Attributes
    ----------
    signals : indices of the stage signals that depend on a fed-back value.
    steps : `LOOP` steps: past signals (memory - 1, signals), oldest first, last outputs, known values of each row and
        of all rows -> outputs (LOOP, outputs), and the signals past then.
    """

    def __init__(self, trace: Trace) -> None:
        model, self._trace = trace.model, trace
        u, p, y = (cs.SX.sym(name, size) for name, size in (
            ("u", len(model.inputs)), ("p", model.size), ("y", len(model.outputs))
        ))  # fmt: skip
        seen, fed = cs.SX(u), [model.inputs.index(name) for name in trace.fed_back]
        for position, k in enumerate(fed):
            seen[k] = trace.feedback.function(y, u)[position]
        others = [k for k in range(len(model.inputs)) if k not in fed]
        self.signals = _depending(trace.z, trace.u[fed], cs.vertcat(trace.u[others], trace.p))
        self._beside = np.setdiff1d(np.arange(trace.z.numel()), self.signals)
        self._taps = np.flatnonzero(~np.isin(trace.tap_signal, self.signals))
        self._stage_beside = SampledFunction(
            cs.Function("stage_beside", [trace.u, trace.p], [cs.densify(trace.z[self._beside.tolist()])])
        )
        past, beside = cs.SX.sym("past", len(self.signals), trace.memory - 1), cs.SX.sym("h", len(self._taps))
        newest = trace.stage.function(seen, p)[self.signals.tolist()]
        z = cs.horzcat(past, newest)
        weights = cs.reshape(trace.weights.function(p), trace.memory, len(trace.tap_signal)).T
        h = cs.SX(len(trace.tap_signal), 1)
        h[self._taps.tolist()] = beside
        for tap in np.setdiff1d(np.arange(len(trace.tap_signal)), self._taps).tolist():
            h[tap] = cs.dot(weights[tap, :], z[int(np.searchsorted(self.signals, trace.tap_signal[tap])), :])
        results = [newest, trace.head.function(h, seen, p)]
        of_row = cs.vertcat(u, beside)
        results, symbols, known = cs.extract_parametric(results, cs.vertcat(of_row, p), {"extract_trivial": True})
        symbols, known = cs.vertcat(*symbols), cs.vertcat(*known)
        vary = _depending(known, of_row, p)
        stay = np.setdiff1d(np.arange(known.numel()), vary).tolist()
        self._varying = SampledFunction(cs.Function("varying", [u, beside, p], [cs.densify(known[vary.tolist()])]))
        self._staying = cs.Function("staying", [p], [cs.densify(known[stay])])
        step = cs.Function("step", [past, y, symbols[vary.tolist()], symbols[stay]], results)
        self.steps = _steps(step)

    def known(self, u: Array, p: Array) -> tuple[Array, Array]:
        """Known values of each row with a prediction, and those that are the same in all rows."""
        trace = self._trace
        weights = trace.weights(p).reshape(len(trace.tap_signal), trace.memory)
        beside = np.empty((len(u) - trace.memory, len(self._taps)))
        for signal, z in zip(self._beside, self._stage_beside(u[:-1], p).T, strict=True):
            here = np.flatnonzero(trace.tap_signal[self._taps] == signal)
            beside[:, here] = samples(z, trace.memory) @ weights[self._taps[here]].T
        rows = self._varying(u[trace.memory - 1 : -1], beside, p)
        return rows, call(self._staying, p)


def _depending(expressions: cs.SX, by: cs.SX, beside: cs.SX) -> Index:
    """Indices of the expressions of two vectors of symbols that depend on the first one."""
    pattern = cs.Function("pattern", [by, beside], [expressions]).jac_sparsity(0, 0)
    return np.unique(np.array(pattern.row(), dtype=np.intp))


def _steps(step: cs.Function) -> Callable[..., list[Array]]:
    """`LOOP` steps in one function: past signals are not copied from step to step."""
    past, y, rows, fixed = (cs.SX.sym("a", step.sparsity_in(k)) for k in range(4))
    rows = cs.SX.sym("rows", rows.numel(), LOOP)
    along, predicted = past, [y]
    for k in range(LOOP):
        newest, following = step(along[:, k:], predicted[-1], rows[:, k], fixed)
        along = cs.horzcat(along, newest)
        predicted.append(following)
    return on_arrays(cs.Function("free_run", [past, y, rows, fixed], [cs.horzcat(*predicted[1:]), along[:, LOOP:]]))


@lru_cache(maxsize=64)
def _loop(trace: Trace) -> _Loop:
    return _Loop(trace)
