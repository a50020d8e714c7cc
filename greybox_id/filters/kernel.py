"""Compiled filters: from a model's segments and readings to states and their covariance.

The UKF uses the scaled sigma points of Van der Merwe, Sigma-Point Kalman Filters for Probabilistic Inference in Dynamic
State-Space Models, 2004, Sec. 3.2.2: the mean, and n points on either side of it at sqrt(n + lambda) standard
deviations along the columns of a root of P, lambda = alpha^2 (n + kappa) - n.

In the C code, extended filters run side by side, one per lane, on the same readings, since tuning compares them; an
unscented filter has its sigma points in the lanes. Readings are processed one at a time (their noise is independent),
covariances updated in Joseph's form; those of the unscented filter by the unscented transform. A reading further off
than `gate` standard deviations gets just so much more noise that it lies at the gate: a glitch then has little effect,
and a filter that lost the vehicle can still recover.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass, fields
from importlib import resources
from typing import Literal

import casadi as cs
import numpy as np

from ..base.shorthands import Array
from ..engine.compiler import library
from ..engine.straight import Result, straight_line
from ..engine.vectors import of_lanes, product, table, writers
from .state_space import StateSpace

NARROW = "#define NARROW"
"""Requests vectors of four lanes even if wider ones exist."""
LOOPS = r"""
/* loops over the entries of covariances are worth unrolling, which -O1 does not do: a sixth of the time */
#pragma GCC optimize("O3")

typedef struct { double *predicted, *predicted_P, *filtered, *filtered_P, *forward, *off, *spread; } Record;
"""


def written(
    step: cs.Function, output: cs.Function, tables: Sequence[str], loops: str, *, narrow: bool = False, **sizes: int
) -> str:
    """The C of a filter.

    Parameters
    ----------
    step, output : (x, s, p) -> value, variance of its noise and, if the filter uses it, the derivative by x.
    tables : declarations that the loops need.
    loops : file of loops over segments, with `filter` as the function to call.
    narrow : whether to use vectors of four lanes.
    sizes : further constants.
    """
    x, s, p = (step.numel_in(k) for k in range(3))
    constants = {"NX": x, "NS": s, "NP": p, "NY": output.numel_out(0), **sizes}
    names = [["next", "noise", "F"], ["y", "noise", "H"]]
    return "\n".join(
        [
            *([NARROW] if narrow else []),
            of_lanes(step, output),
            *[f"#define {name} {size}" for name, size in constants.items()],
            *[
                straight_line(function.name(), function, [Result(name) for name in item[: function.n_out()]])
                for function, item in zip((step, output), names, strict=True)
            ],
            *tables,
            LOOPS,
            resources.files(__package__).joinpath(loops).read_text("utf-8"),
        ]
    )


def ekf_source(step: cs.Function, output: cs.Function, many: bool, throughout: bool) -> str:
    """The C of extended Kalman filters.

    Parameters
    ----------
    step : (x, s, p) -> x_next, variance of its noise, F = d x_next / d x (sparse).
    output : (x, s, p) -> y, variance of its noise, H = d y / d x (sparse).
    many : whether many filters run side by side; a single one is a quarter faster in vectors of four lanes.
    throughout : whether a segment's process noise enters throughout the segment, not at its end; not for smoothers.
    """
    F, H = step.sparsity_out(2), output.sparsity_out(2)
    row, column = H.get_triplet()
    by_row = sorted(range(H.nnz()), key=row.__getitem__)
    tables = [
        table("H_BEGIN", [sum(r < i for r in row) for i in range(H.size1() + 1)]),
        table("H_PLACE", by_row),
        table("H_COLUMN", [column[k] for k in by_row]),
        product("F_times", F),
        *(table(f"F_{name}", item) for name, item in zip(("ROW", "COLUMN"), F.get_triplet(), strict=True)),
        *(["#define THROUGHOUT"] if throughout else []),
    ]
    return written(step, output, tables, "ekf.c", narrow=not many, NF=F.nnz(), NH=H.nnz())


def ukf_source(step: cs.Function, output: cs.Function) -> str:
    """The C of an unscented Kalman filter; the functions as for `ekf_source`, whose derivatives are not used."""
    return written(_without_derivative(step), _without_derivative(output), [], "ukf.c")


def _without_derivative(function: cs.Function) -> cs.Function:
    arguments = function.sx_in()
    return cs.Function(function.name(), arguments, list(function(*arguments))[:2])


@dataclass(frozen=True)
class SigmaPoints:
    """Scaled sigma points.

    Attributes
    ----------
    alpha, beta, kappa : spread, knowledge of the fourth moment, second scale. By default the points lie at sqrt(n)
        standard deviations and the mean has weight zero in means: no weight is negative, so that no covariance can
        become indefinite, however many states there are.
    """

    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0

    def weights(self, n: int) -> Array:
        """(4,): the mean's weights in means and in covariances, weight of every other point, and its distance."""
        scale = self.alpha**2 * (n + self.kappa)
        middle = 1 - n / scale
        return np.array([middle, middle + 1 - self.alpha**2 + self.beta, 0.5 / scale, np.sqrt(scale)])


Kind = Literal["ekf", "ukf"]
Kept = Literal["nothing", "innovations", "filtered", "both ways"]
"""Contents of a filter's history: nothing, innovations of each filter, or for the first filter the states after each
segment's readings, or all that a smoother needs."""


@dataclass(frozen=True)
class History:
    """History of a filter, segment by segment (S segments, n entries of x, m readings).

    Attributes
    ----------
    predicted, predicted_P : (S, n), (S, n, n) before a segment's readings; empty unless a smoother needs them.
    filtered, filtered_P : after them; empty if only innovations are kept.
    forward : (S, n, n) covariance of x after a segment's readings with x predicted for the next one; empty likewise.
    off : (S, m) innovations, reading minus prediction; NaN without a reading. (L, S, m) for L filters, if only
        innovations are kept.
    spread : their predicted variance, likewise.
    """

    predicted: Array
    predicted_P: Array
    filtered: Array
    filtered_P: Array
    forward: Array
    off: Array
    spread: Array


class _Record(ctypes.Structure):
    _fields_ = [(field.name, ctypes.c_void_p) for field in fields(History)]


class CompiledFilter:
    """An EKF or a UKF in C; EKFs for a single filter, or for many side by side. Raises `CannotCompile`."""

    def __init__(self, space: StateSpace, kind: Kind, points: SigmaPoints, *, many: bool = False) -> None:
        self.space, self.kind = space, kind
        self._weights = points.weights(space.size)
        functions = (space.step, space.output)
        requested = f"{kind} {many} {space.throughout}"
        known_by = "\0".join([writers(__file__), cs.__version__, requested, *(f.serialize() for f in functions)])
        made = library(lambda: [_source(kind, functions, many, space.throughout)], known_by)
        made.filter.argtypes = [ctypes.c_ssize_t] * 2 + [ctypes.c_double] + [ctypes.c_void_p] * 7 + [_Record]
        made.filter.restype = None
        self._library = made

    def run(
        self, x: Array, P: Array, s: Array, y: Array, p: Array, gate: float, kept: Kept
    ) -> tuple[Array, History | None]:
        """Filter; x and P, (L, n) and (L, n, n), are updated in place to after the last segment's readings.

        Parameters
        ----------
        x, P : states and covariances at the start.
        s, y : (S, numbers) and (S, m) segments, and readings at their starts (NaN where missing).
        p : (L, parameters) of each filter.
        gate : innovation, in standard deviations, beyond which a reading's noise is raised.
        kept : contents of the history.

        Returns
        -------
        Negative log-likelihood of each filter up to a constant, (L,), and the history.
        """
        (lanes, n), (segments, m) = x.shape, y.shape
        shapes = [P.shape, s.shape, p.shape]
        expected = [(lanes, n, n), (segments, self.space.step.numel_in(1)), (lanes, self.space.step.numel_in(2))]
        if shapes != expected or n != self.space.size or m != len(self.space.model.outputs):
            raise ValueError(f"Shapes {shapes} do not match {lanes} filters of {n} states over {segments} segments.")
        for array in (x, P, s, y, p):
            if not (array.flags.c_contiguous and array.dtype == np.float64):
                raise ValueError("Filters work on contiguous arrays of doubles.")
        cost = np.zeros(lanes)
        history = blank_history(lanes, segments, n, m, kept) if kept != "nothing" else None
        kept_in = [getattr(history, field.name) for field in fields(History)] if history else []
        record = _Record(*(array.ctypes.data if len(array) else None for array in kept_in))
        places = [array.ctypes.data for array in (self._weights, s, y, p, x, P, cost)]
        self._library.filter(lanes, segments, gate, *places, record)
        return cost, history


def blank_history(lanes: int, segments: int, n: int, m: int, kept: Kept) -> History:
    """A history of zeros, to be filled in."""
    forwards = 0 if kept == "innovations" else segments
    backwards = segments if kept == "both ways" else 0
    back, after = ([(item, n), (item, n, n)] for item in (backwards, forwards))
    off = (segments, m) if forwards else (lanes, segments, m)
    return History(*[np.zeros(size) for size in (*back, *after, (backwards, n, n), off, off)])


def _source(kind: Kind, functions: tuple[cs.Function, cs.Function], many: bool, throughout: bool) -> str:
    return ekf_source(*functions, many, throughout) if kind == "ekf" else ukf_source(*functions)
