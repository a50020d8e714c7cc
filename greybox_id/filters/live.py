"""One row after the other, as it arrives, in constant memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..engine.motion.runs import MotionRun
from ..engine.motion.schedule import longest_segment
from ..errors import BadInput
from ..parameter import Array
from .filtering import Filtering
from .laid import LaidRun

STEADY = 8.0
"""An input that jumps by more than so many times its largest step of the last seconds is waited with for a row ..."""
LEAST_JUMP = 0.02
"""... if the jump is more than this share of the range it has been through."""
FADES = 2.0
"""Steps are remembered for about so many seconds."""


class LiveFilter:
    """A filter that is handed rows.

    Parameters
    ----------
    filtering : what filters.
    names : of the estimates wanted.
    p : (parameters,) model and noise.
    moves : (k, parameters) what is uncertain of p: each moves a filter of its own that runs beside.
    hold : what commands do between rows, "zero" or "linear".
    longest_gap : s without a row after which the filter starts anew.
    """

    def __init__(
        self, filtering: Filtering, names: Sequence[str], p: Array, moves: Array, hold: str, longest_gap: float = 0.5
    ) -> None:
        trace = filtering.space.trace
        if trace.shift_count and np.any(np.asarray(trace.timing(p[: trace.model.size]).full()) != 0):
            raise BadInput(
                f"{trace.model.name} has delays or latencies, which need rows yet to come; leave those effects "
                "out to follow a vehicle live."
            )
        self._filtering, self.names, self._hold, self._longest_gap = filtering, tuple(names), hold, longest_gap
        self._p = np.ascontiguousarray(np.vstack([p, *(p + move for move in moves)]))
        self._seen = filtering.space.seen(self.names)
        self._guard = _LiveGuard(trace.model.inputs)
        self._last: tuple[float, Array] | None = None
        self._x = self._P = np.empty(0)

    def push(self, time: float, inputs: Array, readings: Array) -> tuple[Array, Array, tuple[str, ...]]:
        """Take a row: estimates, their standard deviations, and inputs that were held back as glitches.

        Parameters
        ----------
        time : s.
        inputs : (inputs,) of the model; NaN keeps the value before.
        readings : (outputs,), NaN where nothing is read.
        """
        space = self._filtering.space
        if self._last is None and not np.all(np.isfinite(inputs)):
            lacking = [n for n, v in zip(space.model.inputs, inputs, strict=True) if not np.isfinite(v)]
            raise BadInput(f"The first row lacks {', '.join(lacking)}; begin with one that has every input.")
        step = np.inf if self._last is None else time - self._last[0]
        if self._last is not None and step <= 0:
            raise BadInput(f"Time runs on from {self._last[0]:g} s to {time:g} s; rows must come in order.")
        u, glitches = self._guard.clean(inputs, step)
        row = np.concatenate([[0.0], u, np.zeros(space.trace.segment_size - 1 - len(u))])
        if step > self._longest_gap:
            self._start(row, readings)
        else:
            self._go(row, u, step)
        segments, y = np.ascontiguousarray(row[None]), np.ascontiguousarray(readings[None], dtype=float)
        filtering = self._filtering
        filtering.filter.run(self._x, self._P, segments, y, self._p, filtering.gate, "nothing")
        self._last = (time, u)
        return *self._told(row), glitches

    def _start(self, row: Array, readings: Array) -> None:
        inputs = row[1 : 1 + len(self._filtering.space.model.inputs)]
        run = MotionRun("live", np.zeros(1), inputs[None], np.zeros(len(inputs), dtype=bool), readings[None], range(1))
        own = LaidRun(run, row[None], readings[None], np.zeros(1, dtype=np.intp))
        before = (self._x, self._P)
        self._x, self._P = self._filtering.begin(own, self._p, before if before[0].size else None)

    def _go(self, row: Array, u: Array, step: float) -> None:
        """From the row before to this one."""
        assert self._last is not None
        space, before = self._filtering.space, self._last[1]
        held = np.array([n in space.model.commands and self._hold == "zero" for n in space.model.inputs], dtype=bool)
        slope = np.where(held, 0.0, (u - before) / step)
        state = np.full((1, len(space.model.outputs)), np.nan)
        for k, name in enumerate(space.model.outputs):
            if name in space.trace.names:
                state[0, k] = self._x[0, space.trace.names.index(name)]
        times = np.array([0.0, step])
        run = MotionRun("live", times, np.vstack([before, u]), held, np.repeat(state, 2, axis=0), range(2))
        longest = longest_segment(space.trace, [run], self._p[0, : space.model.size])
        parts = max(1, int(np.ceil(step / longest - 1e-9)))
        segments = np.tile(row, (parts + 1, 1))
        segments[:, 0] = step / parts
        begins = step / parts * np.arange(parts + 1)
        segments[:, 1 : 1 + len(u)] = before + slope * begins[:, None]
        segments[:, 1 + len(u) : 1 + 2 * len(u)] = slope
        nothing = np.full((parts + 1, len(space.model.outputs)), np.nan)
        filtering = self._filtering
        filtering.filter.run(self._x, self._P, segments, nothing, self._p, filtering.gate, "nothing")

    def _told(self, row: Array) -> tuple[Array, Array]:
        count, n = len(self.names), self._filtering.space.size
        rows = np.tile(row, (len(self._p), 1))
        found = self._seen(np.ascontiguousarray(self._x), rows, self._p)
        by_x = found[0, count:].reshape(count, n)
        variance = np.einsum("ij,jl,il->i", by_x, self._P[0], by_x)
        variance += np.sum((found[1:, :count] - found[0, :count]) ** 2, axis=0)
        values = found[0, :count]
        return values, np.where(np.isnan(values), np.nan, np.sqrt(np.maximum(variance, 0.0)))


class _LiveGuard:
    """Holds an input back for a row where it jumps as it never did; a glitch is gone by then, a true jump is not."""

    def __init__(self, inputs: Sequence[str]) -> None:
        self._names = tuple(inputs)
        self._before: Array | None = None
        self._largest = np.zeros(len(inputs))
        self._low = self._high = np.zeros(len(inputs))
        self._doubted = np.zeros(len(inputs), dtype=bool)
        self._rows = 0

    def clean(self, inputs: Array, step: float) -> tuple[Array, tuple[str, ...]]:
        """The inputs to believe, and names of those held back."""
        if self._before is None:
            self._before, self._low, self._high = inputs.copy(), inputs.copy(), inputs.copy()
            return inputs.copy(), ()
        missing = ~np.isfinite(inputs)
        given = np.where(missing, self._before, inputs)
        jump = np.abs(given - self._before)
        known = self._rows * min(step, 1.0) > FADES
        odd = known & (jump > STEADY * self._largest) & (jump > LEAST_JUMP * (self._high - self._low)) & ~self._doubted
        found = np.where(odd, self._before, given)
        self._doubted = odd
        decay = np.exp(-min(step, FADES) / FADES)
        self._largest = np.where(odd, self._largest, np.maximum(jump, self._largest * decay))
        self._low, self._high = np.minimum(self._low, found), np.maximum(self._high, found)
        self._before, self._rows = found, self._rows + 1
        return found, tuple(name for name, held in zip(self._names, odd, strict=True) if held)


def as_row(values: Mapping[str, float], names: Sequence[str]) -> Array:
    """Values by name as an array, NaN where there is none."""
    return np.array([values.get(name, np.nan) for name in names])
