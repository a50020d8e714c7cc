"""Many trajectories at once, segment by segment, with forward sensitivities.

A model is integrated by a function of one segment, z_next = step(z, s, p), and read by y = output(z, s, p) at the
start of chosen segments; s are the segment's numbers (inputs, duration), p the parameters. Differentiated:

    Z <- A Z + [0 | B]      A, B = derivatives of step by z and p
    Y =  C Z + [0 | D]      C, D = derivatives of output by z and p

with Z the derivative of the state by the initial state and by chosen parameters. It runs as generated C, several lanes
at a time, if there is a compiler and the work pays for compiling, else in CasADi's virtual machine.
The numbers are the same (1e-12 relative, unless the model cancels digits).

The lanes of one call are divided between two threads: compiled code does not hold Python's lock, and lanes are
independent, so that results are the same to the last digit. Where other fits run in parallel (`--jobs`, fleets,
servers) each uses one thread. The environment variable GREYBOX_THREADS sets their number, 1 or more.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from threading import Thread

import casadi as cs
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.shorthands import Array
from .compiler import CannotCompile, library, warn_slow
from .lane_targets import LaneTargets, square, to_unknowns
from .vectors import FEW, WIDE, narrow_source, scratch_size, source, writers
from .virtual import VirtualMachine

WIDEST = 8
"""Lanes of the widest vector; threads get whole vectors."""
SHARED_FROM = 8_000
"""Lanes times segments from which a call is divided: half a millisecond, ten times the time to start a thread."""
MOST = 2
"""Default limit of threads: more of them wait for memory."""


def threads() -> int:
    """Number of threads for a call."""
    stated = os.environ.get("GREYBOX_THREADS", "")
    if stated.isdecimal():
        return max(1, int(stated))
    return min(MOST, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)


def shared_out(lanes: int, segments: int, run: Callable[[int, int], None]) -> None:
    """Call `run` on ranges [first, last) of lanes, in as many threads as pay."""
    count = threads() if lanes * segments >= SHARED_FROM and lanes >= 2 * WIDEST else 1
    blocks = -(-lanes // WIDEST)
    edges = [min(lanes, WIDEST * (blocks * k // count)) for k in range(count)] + [lanes]
    others = [Thread(target=run, args=item, daemon=True) for item in zip(edges[1:-1], edges[2:], strict=True)]
    for thread in others:
        thread.start()
    run(edges[0], edges[1])
    for thread in others:
        thread.join()


PAYS = 20_000
"""Work, lanes times segments, from which a kernel is compiled: a fifth of the work that takes the virtual machine as
long as compiling, since the library is cached. Both times grow alike with the model's size, so that one number serves
all models: a tenth of a second for a single-track model, half a second for a large one. The work alone decides, not the
content of the cache: a first run and a later one give the same digits."""

LINEARISED = 5
"""Cost of a segment's derivatives, in segments."""


MOST_FUSED = 128
"""Largest number of unknowns for which J'J is accumulated reading by reading: it takes a megabyte, the size of a
second-level cache. Beyond, J is stored, and multiplied as a whole."""


@dataclass(frozen=True)
class KnownSimulation:
    """Result of a simulation, whose trajectories another one from other initial states may meet.

    Attributes
    ----------
    results : stored states, (L, K, nz), and readings, (L, R, ny).
    near : (nz,) distance within which a state counts as equal to a stored one.
    """

    results: tuple[Array, Array]
    near: Array

    def elsewhere(self, z0: Array, keep: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(L,) lanes whose initial state differs from the stored one; all lanes if initial states are not stored."""
        states = self.results[0]
        return np.any(~(np.abs(z0 - states[:, 0]) <= self.near), axis=1) if keep[0] else np.ones(len(z0), dtype=bool)


class Kernel:
    """Integrates trajectories ("lanes") and their sensitivities.

    Shapes below: L lanes, S segments, R readings, q parameters to differentiate by, and the functions' nz, ns, np, ny.

    Parameters
    ----------
    step : SX function (z[nz], s[ns], p[np]) -> z_next[nz] of one segment.
    output : SX function (z[nz], s[ns], p[np]) -> y[ny], the readings at the start of a segment.
    compiled : True: always compiled C, or `CannotCompile`. False: never. None: as the environment variable
        GREYBOX_COMPILE says, 1 or 0; if it is not set, as soon as the work requested so far pays for compiling
        (`PAYS`), without an error if that fails.

    Attributes
    ----------
    compiled : whether the last call ran as compiled C.
    """

    def __init__(self, step: cs.Function, output: cs.Function, *, compiled: bool | None = None) -> None:
        self.compiled = False
        self._model = _Functions(step, output)
        stated = os.environ.get("GREYBOX_COMPILE")
        self._wanted = compiled if compiled is not None or not stated else stated != "0"
        self._work = 0
        self._library: ctypes.CDLL | None = None
        self._cannot = False

    def prepare(self) -> None:
        """Compile before the first call, if possible.

        The results of a long calculation then depend neither on the kernel's earlier work nor on the number of
        processes that share the work.
        """
        self._load(PAYS)

    def expect(self, work: int) -> None:
        """Compile before the first call if the work requested next, lanes times segments, pays for it."""
        if self._work + work >= PAYS:
            self.prepare()

    def simulate(
        self,
        z0: ArrayLike,
        s: ArrayLike,
        p: ArrayLike,
        reads: ArrayLike,
        keeps: ArrayLike | None = None,
        known: KnownSimulation | None = None,
    ) -> tuple[Array, Array]:
        """Integrate.

        Parameters
        ----------
        z0 : (L, nz) initial states.
        s : (L, S, ns) numbers of each segment; for lanes with the same numbers, `np.broadcast_to` saves memory and
            time, for lanes whose numbers overlap, a view does.
        p : (L, np) parameters, or (np,) for all lanes.
        reads : (S,) bool, the segments at whose start the outputs are read.
        keeps : (S + 1,) bool, the segments at whose start the state is returned, and whether at the end; None: all.
        known : result of this call from other initial states, updated in place; a lane stops where its state is near
            the stored one.

        Returns
        -------
        z : (L, K, nz) the requested states.
        y : (L, R, ny) readings.
        """
        arguments = self._checked(z0, s, p, reads)
        lanes, segments, readings = *arguments[1].shape[:2], np.count_nonzero(arguments[3])
        keep = np.ones(segments + 1, dtype=bool) if keeps is None else np.ascontiguousarray(keeps, dtype=bool)
        if keep.shape != (segments + 1,):
            raise ValueError(f"Shape {keep.shape} of keeps does not match {segments} segments.")
        self._load(lanes * segments)
        if self._library is None:
            z, y = self._model.virtual.simulate(*arguments)
            return z if keeps is None else z[:, keep], y
        kept, stride = np.count_nonzero(keep), arguments[1].strides[0] // arguments[1].itemsize
        shapes = (lanes, kept, self._model.states), (lanes, readings, self._model.outputs)
        z, y = known.results if known else (np.empty(shape) for shape in shapes)
        near = None if known is None else known.near
        if (z.shape, y.shape) != shapes or (near is not None and near.shape != shapes[0][2:]):
            raise ValueError(f"Shapes {z.shape} and {y.shape} of what is known do not match {shapes}.")
        which = np.arange(lanes) if known is None else np.flatnonzero(known.elsewhere(arguments[0], keep))
        remainder = len(which) % WIDE if hasattr(self._library, "simulate_few") else 0
        whole = len(which) - remainder if remainder <= FEW else len(which)
        addresses = _places(*arguments, keep, near, z, y)

        def run(name: str, first: int, last: int) -> None:
            begin = which.ctypes.data + first * which.itemsize
            getattr(self._library, name)(last - first, segments, readings, kept, stride, begin, *addresses)

        if whole:
            shared_out(whole, segments, partial(run, "simulate"))
        if whole < len(which):
            run("simulate_few", whole, len(which))
        return z, y

    def followed(
        self, s: ArrayLike, p: ArrayLike, begins: ArrayLike, z: Array, given: ArrayLike, complete: ArrayLike
    ) -> Array:
        """Integrate one trajectory from row to row, resetting given states in rows where they are complete.

        Parameters
        ----------
        s : (S, ns) numbers of each segment.
        p : (np,) parameters.
        begins : (n,) index of the segment that starts at each row.
        z : (n, nz) initial state in row 0, values of the given states in later rows; may be overwritten.
        given : (nz,) bool, the states that are given.
        complete : (n,) bool, the rows in which they are reset.

        Returns
        -------
        (n, nz) states of the trajectory.
        """
        states, numbers, parameters, _ = self._checked(z[:1], np.asarray(s)[None], p, np.zeros(len(np.asarray(s))))
        row_starts, set_to = np.ascontiguousarray(begins, dtype=np.intp), np.ascontiguousarray(given, dtype=bool)
        resets, trajectory = np.ascontiguousarray(complete, dtype=bool), np.ascontiguousarray(z, dtype=float)
        shapes = (len(trajectory),), (len(trajectory),), states.shape[1:]
        inside = np.all(np.diff(row_starts, prepend=0, append=len(numbers[0])) >= 0)  # ascending, none beyond the last
        if (row_starts.shape, resets.shape, set_to.shape) != shapes or not inside:
            raise ValueError(f"Rows, or what is given at them, do not match {trajectory.shape} states.")
        self._load(len(numbers[0]))
        if self._library is not None:
            few = hasattr(self._library, "follow_few")
            run = self._library.follow_few if few else self._library.follow
            run(len(trajectory), *_places(row_starts, numbers, parameters, resets, set_to, trajectory))
            return trajectory
        for row in range(1, len(trajectory)):
            if resets[row] and set_to.all():
                continue
            stretch = slice(row_starts[row - 1], row_starts[row])
            nothing = np.zeros(stretch.stop - stretch.start, dtype=bool)
            following, _ = self._model.virtual.simulate(
                trajectory[row - 1 : row], numbers[:, stretch], parameters, nothing
            )
            trajectory[row] = np.where(resets[row] & set_to, trajectory[row], following[0, -1])
        return trajectory

    def linearise(
        self, z0: ArrayLike, s: ArrayLike, p: ArrayLike, reads: ArrayLike, columns: ArrayLike,
        taken: NDArray[np.bool_] | None = None,
    ) -> tuple[Array, Array, Array, Array]:  # fmt: skip
        """Integrate, and differentiate by the initial states and some parameters.

        Parameters
        ----------
        z0, s, p, reads : as for `simulate`.
        columns : (q,) indices of the parameters to differentiate by, each once.
        taken : (L, R) which of the readings each lane takes; None: all.

        Returns
        -------
        z : (L, nz) states at the end.
        Z : (L, nz, nz + q) their derivatives, by z0 first.
        y : (L, R, ny) readings; with `taken` (T, ny), those of one lane after the other.
        Y : (L, R, ny, nz + q) or (T, ny, nz + q) their derivatives, by z0 first.
        """
        arguments = self._checked(z0, s, p, reads)
        lanes, segments, readings = *arguments[1].shape[:2], np.count_nonzero(arguments[3])
        states, outputs, chosen = self._model.states, self._model.outputs, np.asarray(columns, dtype=np.intp)
        width = states + len(chosen)
        moving = self._placed(chosen, states + np.arange(len(chosen)))
        self._load(LINEARISED * lanes * segments)
        if self._library is None:
            z, Z, y, Y = self._model.virtual.linearise(*arguments, chosen)
            return (z, Z, y, Y) if taken is None else (z, Z, y[taken], Y[taken])
        if taken is not None and taken.shape != (lanes, readings):
            raise ValueError(f"Shape {taken.shape} of taken does not match {lanes} lanes and {readings} readings.")
        shape = (lanes, readings) if taken is None else (np.count_nonzero(taken),)
        z, Z = np.empty((lanes, states)), np.empty((lanes, states, width))
        y, Y = np.empty((*shape, outputs)), np.empty((*shape, outputs, width))
        seed = np.tile(np.eye(states, width), (lanes, 1, 1))
        self._call(arguments, moving, seed, z, Z, y, Y, taken=taken)
        return z, Z, y, Y

    def normal_equations(
        self,
        z0: ArrayLike,
        s: ArrayLike,
        p: ArrayLike,
        reads: ArrayLike,
        columns: ArrayLike,
        seed: Array,
        places: ArrayLike,
        against: LaneTargets,
        residuals: Array | None = None,
    ) -> tuple[Array, Array, Array]:
        """J'J and J'r of every lane, with r the weighted residuals of readings and J their derivative.

        J is not stored: each reading's contribution is added while it is in the processor's cache.

        Parameters
        ----------
        z0, s, p, reads, columns : as for `linearise`.
        seed : (L, nz, c) derivative of the initial states by c unknowns.
        places : (q,) index among the unknowns of each parameter in `columns`.
        against : targets and weights of the readings.
        residuals : (L, R, ny) weighted residuals to use as r, without J'J; None: those of this simulation.

        Returns
        -------
        Z : (L, nz, c) derivative of the states at the end.
        H : (L, c, c) J'J; (L, 0, 0) if residuals are given.
        g : (L, c) J'r.
        """
        arguments = self._checked(z0, s, p, reads)
        lanes, segments, readings = *arguments[1].shape[:2], np.count_nonzero(arguments[3])
        states, outputs, chosen = self._model.states, self._model.outputs, np.asarray(columns, dtype=np.intp)
        count, placed = seed.shape[2], np.asarray(places, dtype=np.intp)
        moving, shape = self._placed(chosen, placed), (lanes, readings, outputs)
        shapes = [item.shape for item in (against.target, against.weight, *(() if residuals is None else (residuals,)))]
        if {*shapes} != {shape} or seed.shape[:2] != (lanes, states) or np.max(placed, initial=-1) >= count:
            raise ValueError(f"Shapes {shapes} of targets and {seed.shape} of the seed do not match {shape}.")
        self._load(LINEARISED * lanes * segments)
        if self._library is None or count > min(MOST_FUSED, states + self._model.parameters):
            _, Z_free, y, Y_free = self.linearise(*arguments, chosen)
            Z, Y = (to_unknowns(item, seed, placed) for item in (Z_free, Y_free))
            return Z, *against.accumulated(y, Y, residuals)
        as_contiguous = np.ascontiguousarray
        z, Z, packed = np.empty((lanes, states)), np.empty((lanes, states, count)), count * (count + 1) // 2
        H = np.empty((lanes, packed + count))
        contiguous = [as_contiguous(item, dtype=float) for item in (seed, against.target, against.weight)]
        r = None if residuals is None else as_contiguous(residuals, dtype=float)
        self._call(arguments, moving, contiguous[0], z, Z, None, None, against.robust, *contiguous[1:], r, H)
        return Z, square(H[:, : packed if residuals is None else 0], count), H[:, packed:]

    def _placed(self, chosen: NDArray[np.intp], places: NDArray[np.intp]) -> NDArray[np.intp]:
        """For each parameter, the column of its derivative; -1 for none."""
        moving = np.full(self._model.parameters, -1, dtype=np.intp)
        moving[chosen] = places
        if np.count_nonzero(moving >= 0) != len(chosen):
            raise ValueError("columns names a parameter twice.")
        return moving

    def _call(
        self,
        arguments: tuple[Array, Array, Array, NDArray[np.bool_]],
        moving: NDArray[np.intp],
        seed: Array,
        z: Array,
        Z: Array,
        y: Array | None,
        Y: Array | None,
        robust: float | None = None,
        *others: Array | None,
        taken: NDArray[np.bool_] | None = None,
    ) -> None:
        """Call the compiled function that linearises: it stores the readings' derivatives, or accumulates J'J."""
        z0, s, p, reads = arguments
        at_segments, begin = None, None
        if taken is not None:
            at_segments = np.zeros(s.shape[:2], dtype=bool)
            at_segments[:, reads] = taken
            begin = np.concatenate(([0], np.cumsum(np.count_nonzero(taken, axis=1))))[:-1]
        counts = s.shape[1], np.count_nonzero(reads), seed.shape[2], s.strides[0] // s.itemsize
        robust = np.inf if robust is None else robust
        accumulates, size = bool(others), scratch_size(seed.shape[2], self._model.outputs)

        def run(first: int, last: int) -> None:
            by_lane = (z0, s, p, at_segments, begin, seed, z, Z, *((y, Y) if taken is None else ()), *others)
            value = [None if array is None else array[first:last] for array in by_lane]
            results = [] if taken is None else [y, Y]
            arrays = [moving, *value[:3], reads, *value[3:], *results, *([] if accumulates else [None] * 4)]
            scratch = np.empty(size) if accumulates else None
            assert self._library is not None
            self._library.linearise(last - first, *counts, robust, *_places(*arrays, scratch))

        shared_out(len(z0), s.shape[1], run)

    def _checked(
        self, z0: ArrayLike, s: ArrayLike, p: ArrayLike, reads: ArrayLike
    ) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        """The arguments as contiguous arrays for C; wrong shapes would let it read beyond their ends."""
        numbers = np.asarray(s, dtype=float)
        in_place = len(numbers) > 1 and numbers[0].flags.c_contiguous and numbers.strides[0] % numbers.itemsize == 0
        numbers = numbers if in_place else np.ascontiguousarray(numbers)
        lanes, segments, _ = numbers.shape
        model = self._model
        states = np.ascontiguousarray(z0, dtype=float)
        parameters = np.ascontiguousarray(p, dtype=float)
        if parameters.ndim == 1:
            parameters = np.tile(parameters, (lanes, 1))
        read = np.ascontiguousarray(reads, dtype=bool)
        shapes = [states.shape, numbers.shape, parameters.shape, read.shape]
        if shapes != [(lanes, model.states), (lanes, segments, model.numbers), (lanes, model.parameters), (segments,)]:
            raise ValueError(f"Shapes {shapes} of z0, s, p and reads do not match.")
        return states, numbers, parameters, read

    def _load(self, work: int) -> None:
        """Load or compile the library if the work so far, this included, pays for it."""
        self._work += work
        pays = self._wanted is True or self._work >= PAYS
        if self._library is None and self._wanted is not False and not self._cannot and pays:
            try:
                self._library = _declared(library(lambda: self._model.sources, self._model.known_by))
            except CannotCompile as error:
                if self._wanted:
                    raise
                warn_slow("The model", "ten", error)
                self._cannot = True
        self.compiled = self._library is not None


class _Functions:
    """A model's functions of one segment, for the virtual machine and for C.

    Attributes
    ----------
    states, numbers, parameters, outputs : sizes of z, s, p and y.
    known_by : text that determines the C source: the functions, and the code that writes it.
    """

    def __init__(self, step: cs.Function, output: cs.Function) -> None:
        self.known_by = "\0".join([writers(__file__), cs.__version__, step.serialize(), output.serialize()])
        self.arguments = [cs.SX.sym(letter, step.numel_in(k)) for k, letter in enumerate("zsp")]
        self.states, self.numbers, self.parameters = (step.numel_in(k) for k in range(3))
        self.outputs = output.numel_out(0)
        # step and output together: shared subexpressions would otherwise be differentiated twice
        both = cs.cse(cs.densify(cs.vertcat(step(*self.arguments), output(*self.arguments))))
        self.results = [both[: self.states], both[self.states :]]

    @cached_property
    def slopes(self) -> list[cs.SX]:
        """A, B, C, D: the derivatives of z_next and y, each by z and p, sparse."""
        z, _, p = self.arguments
        J, n = cs.jacobian(cs.vertcat(*self.results), cs.vertcat(z, p)), self.states
        return [J[:n, :n], J[:n, n:], J[n:, :n], J[n:, n:]]

    @cached_property
    def virtual(self) -> VirtualMachine:
        """The functions in CasADi's virtual machine."""
        A, B, C, D = (cs.densify(slope) for slope in self.slopes)
        following, y = self.results
        parts = {"step": [following], "output": [y], "step_by": [following, A, B], "output_by": [y, C, D]}
        return VirtualMachine(*[cs.Function(name, self.arguments, results) for name, results in parts.items()])

    @cached_property
    def sources(self) -> tuple[str, str]:
        """The C source files."""
        value = cs.Function("value", self.arguments, self.results)
        slope = cs.Function("slope", self.arguments, [*self.results, *self.slopes])
        return source(value, slope), narrow_source(value)


def _declared(made: ctypes.CDLL) -> ctypes.CDLL:
    """A library with the argument types of its functions declared: counts, then arrays."""
    made.simulate.argtypes = [ctypes.c_ssize_t] * 5 + [ctypes.c_void_p] * 9
    made.linearise.argtypes = [ctypes.c_ssize_t] * 5 + [ctypes.c_double] + [ctypes.c_void_p] * 17
    made.follow.argtypes = [ctypes.c_ssize_t] + [ctypes.c_void_p] * 6
    made.simulate.restype = made.follow.restype = made.linearise.restype = None
    if hasattr(made, "simulate_few"):
        made.simulate_few.argtypes, made.simulate_few.restype = made.simulate.argtypes, None
        made.follow_few.argtypes, made.follow_few.restype = made.follow.argtypes, None
    return made


def _places(*arrays: NDArray[np.generic] | None) -> list[int | None]:
    """Addresses of arrays."""
    return [None if array is None else array.ctypes.data for array in arrays]
