"""From equations to functions: a model traced once, symbolically, with CasADi.

Tracing splits a discrete map with memory, without the author's help, into three stages

    z_k = stage(u_k, p)                  signals that the windows look at, one sample at a time
    h_k = sum_i W_i(p) z_{k-L+i}         the windows: finite impulse responses
    y_{k+1} = head(h_k, u_k, p)          outputs

so that a sample shared by twenty windows is evaluated once, not twenty times, and every derivative is a
sparse piece of one of the three.

`called` evaluates any model's equations on symbols, and explains why they cannot be traced: users write them too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from pathlib import Path
from types import SimpleNamespace, TracebackType
from typing import Any

import casadi as cs
import numpy as np

from ..base.errors import BadModel, GreyboxError, near_or_all
from ..base.shorthands import Index
from ..models.memory_model import MemoryModel
from ..models.model import Model, Namespace, Symbol
from .elements import Actuation, namespace
from .virtual import SampledFunction

KINDS = {"x": "state", "u": "input", "p": "parameter"}
"""Contents of the namespaces that equations read."""


def called(
    model: Model, equations: Callable[..., Any], spaces: Mapping[str, Namespace], *arguments: object
) -> dict[str, Any]:
    """Evaluate equations on symbols: name -> expression.

    Parameters
    ----------
    model : the model they belong to.
    equations : called with the arguments.
    spaces : letter -> namespace that they read: x states, u inputs, p parameters.

    Raises
    ------
    BadModel : they read an unknown name, branch on a symbol, or return no mapping of names.
    """
    with tracing(model, spaces):
        expressions = equations(*arguments)
    if not isinstance(expressions, Mapping):
        raise BadModel(
            f"The equations of {model.name} must give a mapping of names to expressions, not {expressions!r:.40}."
        )
    for name, value in expressions.items():
        if isinstance(value, str) or not isinstance(value, Real | cs.SX | cs.MX | cs.DM):
            raise BadModel(f"The equations of {model.name} give {name} as {value!r:.40}, which is not an expression.")
    return dict(expressions)


@contextmanager
def tracing(model: Model, spaces: Mapping[str, Namespace]) -> Iterator[None]:
    """Turn exceptions in the equations of a model or of its effects into `BadModel`."""
    try:
        yield
    except GreyboxError:
        raise
    except Exception as error:
        where = _line(error.__traceback__)
        raise BadModel(f"Model {model.name}{where}: {_reason(model, error, spaces)}") from error


def must_be_numbers(model: Model, expressions: Mapping[str, Any], symbols: list[Any]) -> None:
    """Raise `BadModel` if an expression contains NaN, the result of a `math` function of a symbol."""
    names = [name for name, value in expressions.items() if _holds_nan(value, symbols)]
    if names:
        raise BadModel(
            f"The equations of {model.name} give {', '.join(names)} as NaN. Functions of math, such as math.tan, "
            "return NaN for a CasADi symbol: use casadi.tan and the like."
        )


def _holds_nan(value: Any, symbols: list[Any]) -> bool:
    function = cs.Function("looked_through", symbols, [cs.SX(value)], {"allow_free": True})
    return any(
        function.instruction_id(k) == cs.OP_CONST and math.isnan(function.instruction_constant(k))
        for k in range(function.n_instructions())
    )


def _reason(model: Model, error: Exception, spaces: Mapping[str, Namespace]) -> str:
    if isinstance(error, AttributeError):
        for letter, space in spaces.items():
            if error.obj is space and error.name:
                hint = near_or_all(error.name, vars(space))
                return f"its equations read {letter}.{error.name}, but it has no {KINDS[letter]} {error.name}.{hint}"
        return str(error)
    if "truth value" in str(error):
        return (
            "its equations branch on a symbol (if, and, or, min, max), which has no value yet: use casadi.if_else, "
            "fmin or fmax."
        )
    return f"its equations cannot be traced: {type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}"


def _line(trace: TracebackType | None) -> str:
    """The last traceback line in the equations' file; lines inside this package are ignored."""
    result = ""
    package = str(Path(__file__).parents[1])
    while trace is not None:
        file = trace.tb_frame.f_code.co_filename
        if not file.startswith(package) and "casadi" not in Path(file).parts:
            result = f" ({Path(file).name}, line {trace.tb_lineno})"
        trace = trace.tb_next
    return result


Columns = slice | Index


@dataclass(frozen=True)
class SparseFunction:
    """Nonzeros of a Jacobian as a function of one sample, and their positions.

    Attributes
    ----------
    nonzeros : CasADi function of the same arguments as the differentiated stage.
    row, column : (nnz,) position of each nonzero.
    constant : whether the nonzeros do not depend on the parameters.
    """

    nonzeros: SampledFunction
    row: Index
    column: Index
    constant: bool


@dataclass(frozen=True)
class WindowWeights:
    """Dependence of one window's weights on the parameters.

    Attributes
    ----------
    places : indices of this window's nonzeros in `Trace.weights_by_p`.
    lags : for each of them, the sample of the window that the weight multiplies.
    columns : the distinct parameters among them.
    at : `columns` as an index, a slice if they are consecutive.
    among : for each nonzero, the index of its parameter in `columns`.
    order : permutation of the nonzeros if each parameter weights one sample and both ascend together; else None.
    samples : the samples in that order, as an index; all without an order.
    """

    places: Index
    lags: Index
    columns: Index
    at: Columns
    among: Index
    order: Index | None
    samples: Columns


class Trace:
    """A model's equations as CasADi functions of one sample.

    Attributes
    ----------
    model : the model that was traced.
    memory : samples in the longest window, the newest included.
    tap_signal : (taps,) the stage signal of each window.
    """

    def __init__(self, model: MemoryModel) -> None:
        self.model = model
        self.u = cs.SX.sym("u", len(model.inputs))
        self.p = cs.SX.sym("p", model.size)
        self._windows = _Windows()
        named = namespace(model, self.p)
        inputs = SimpleNamespace(**{name: self.u[k] for k, name in enumerate(model.inputs)})
        outputs = called(model, model.equations, {"u": inputs, "p": named}, inputs, named, self._windows)
        missing = [name for name in model.outputs if name not in outputs]
        if missing:
            raise BadModel(f"The equations of {model.name} do not give its output {', '.join(missing)}.")
        must_be_numbers(model, {name: outputs[name] for name in model.outputs}, [self.u, self.p])
        self.y = cs.vertcat(*[outputs[name] for name in model.outputs])
        self.z = cs.vertcat(*self._windows.signals) if self._windows.signals else cs.SX(0, 1)
        self.h = cs.vertcat(*self._windows.symbols) if self._windows.symbols else cs.SX(0, 1)
        if self.h.numel() and cs.depends_on(self.z, self.h):
            raise BadModel(
                f"{model.name}: a window looks at another window; past(past(...)) would have no finite memory."
            )
        self.tap_signal: Index = np.array(self._windows.which, dtype=np.intp)
        self.memory = max((len(w) for w in self._windows.weights), default=1)
        self.W = cs.vertcat(*[_padded(w, self.memory) for w in self._windows.weights])

    @cached_property
    def actuation(self) -> Actuation:
        """The model's actuators, made once for all runs, since each is a CasADi function."""
        return Actuation(self.model, self.fed_back)

    @cached_property
    def stage(self) -> SampledFunction:
        """(u, p) -> z, all signals that windows look at."""
        return SampledFunction(cs.Function("stage", [self.u, self.p], [cs.densify(self.z)]))

    @cached_property
    def stage_by_p(self) -> SparseFunction:
        """Derivative of the stage by the parameters."""
        return self._sparse("stage_by_p", self.z, self.p, [self.u, self.p])

    @cached_property
    def stage_by_u(self) -> SparseFunction:
        """Derivative of the stage by the inputs."""
        return self._sparse("stage_by_u", self.z, self.u, [self.u, self.p])

    @cached_property
    def weights(self) -> SampledFunction:
        """p -> W row by row, (taps, memory) weights of the windows, oldest sample first."""
        return SampledFunction(cs.Function("weights", [self.p], [cs.densify(cs.vec(self.W.T))]))

    @cached_property
    def weights_by_p(self) -> SparseFunction:
        """Derivative of the windows' weights (row by row) by the parameters."""
        return self._sparse("weights_by_p", cs.vec(self.W.T), self.p, [self.p])

    @cached_property
    def stage_places(self) -> list[Index]:
        """Per signal, the indices of its derivative's nonzeros in `stage_by_p`."""
        return [np.flatnonzero(self.stage_by_p.row == signal) for signal in range(self.z.numel())]

    @cached_property
    def stage_columns(self) -> list[Index]:
        """Per signal, the parameters that it depends on."""
        return [self.stage_by_p.column[places] for places in self.stage_places]

    @cached_property
    def stage_at(self) -> list[Columns]:
        """`stage_columns` as indices: slices if they are consecutive."""
        return [tidy(columns) for columns in self.stage_columns]

    @cached_property
    def tap_outputs(self) -> list[list[tuple[int, int]]]:
        """Per window, the outputs that depend on it: (index of the nonzero in `head_by_h`, output)."""
        by_h = self.head_by_h
        several = [np.flatnonzero(by_h.column == tap) for tap in range(len(self.tap_signal))]
        return [[(int(k), int(by_h.row[k])) for k in item] for item in several]

    @cached_property
    def first_alike(self) -> list[int]:
        """Per window, the first one with the same constant effect and a signal of the same parameters, or itself."""
        by_h, firsts = cs.jacobian(self.y, self.h), dict[tuple[object, ...], int]()
        result = []
        for tap, signal in enumerate(self.tap_signal.tolist()):
            effect = by_h[:, tap]
            same = tuple(cs.DM(effect).full().ravel().tolist()) if effect.is_constant() else tap
            result.append(firsts.setdefault((same, self.stage_columns[signal].tobytes()), tap))
        return result

    @cached_property
    def tap_weights(self) -> list[WindowWeights]:
        """Per window, how its weights depend on the parameters."""
        result = []
        for tap in range(len(self.tap_signal)):
            places = np.flatnonzero(self.weights_by_p.row // self.memory == tap)
            lags = self.weights_by_p.row[places] % self.memory
            columns, among = np.unique(self.weights_by_p.column[places], return_inverse=True)
            order = np.argsort(among)
            alone = len(columns) == len(lags) and np.all(np.diff(lags[order]) == 1)
            sorting, samples = (order, tidy(lags[order])) if alone else (None, slice(None))
            result.append(WindowWeights(places, lags, columns, tidy(columns), among, sorting, samples))
        return result

    @cached_property
    def head(self) -> SampledFunction:
        """(h, u, p) -> y."""
        return SampledFunction(cs.Function("head", [self.h, self.u, self.p], [cs.densify(self.y)]))

    @cached_property
    def head_with_slopes(self) -> SampledFunction:
        """(h, u, p) -> y and the nonzeros of `head_by_h` and `head_by_p`, concatenated; shared terms computed once."""
        arguments = [self.h, self.u, self.p]
        pieces = (self.head, self.head_by_h.nonzeros, self.head_by_p.nonzeros)
        several = cs.cse(cs.vertcat(*[one.function(*arguments) for one in pieces]))
        return SampledFunction(cs.Function("head_with_slopes", arguments, [cs.densify(several)]))

    @cached_property
    def head_by_h(self) -> SparseFunction:
        """Derivative of the outputs by the results of the windows that anything else is differentiated through."""
        moved = self.model.inputs if self.model.actuators else self.fed_back
        by = cs.vertcat(self.p, *[self.u[self.model.inputs.index(name)] for name in moved])
        weights = cs.vertsplit(self.W) if self.W.numel() else []
        constant = [
            tap
            for tap, (signal, row) in enumerate(zip(self.tap_signal.tolist(), weights, strict=True))
            if not cs.depends_on(cs.horzcat(self.z[signal], row), by)
        ]
        return self._sparse("head_by_h", self.y, self.h, [self.h, self.u, self.p], constant)

    @cached_property
    def head_by_p(self) -> SparseFunction:
        """Derivative of the outputs by the parameters, the windows' results fixed."""
        return self._sparse("head_by_p", self.y, self.p, [self.h, self.u, self.p])

    @cached_property
    def head_by_u(self) -> SparseFunction:
        """Derivative of the outputs by the newest inputs, the windows' results fixed."""
        return self._sparse("head_by_u", self.y, self.u, [self.h, self.u, self.p])

    @cached_property
    def fed_back(self) -> tuple[str, ...]:
        """Inputs that come from the model's own outputs in closed loop."""
        return tuple(self._feedback()[0])

    @cached_property
    def feedback(self) -> SampledFunction:
        """(y, u) -> the fed-back inputs, in the order of `fed_back`."""
        named, y = self._feedback()
        return SampledFunction(cs.Function("feedback", [y, self.u], [cs.densify(cs.vertcat(*named.values()))]))

    @cached_property
    def feedback_by_y(self) -> SampledFunction:
        """(y, u) -> derivative of the fed-back inputs by the outputs, dense, row by row."""
        named, y = self._feedback()
        jacobian = cs.jacobian(cs.vertcat(*named.values()), y)
        return SampledFunction(cs.Function("feedback_by_y", [y, self.u], [cs.densify(cs.vec(jacobian.T))]))

    @cached_property
    def step(self) -> tuple[Symbol, Symbol]:
        """One whole window: symbols U, (inputs, memory) oldest sample first, and the outputs y(U, p) it leads to."""
        U = cs.SX.sym("U", len(self.model.inputs), self.memory)
        stage, head = self.stage.function, self.head.function
        Z = cs.horzcat(*[stage(U[:, k], self.p) for k in range(self.memory)])
        h = cs.vertcat(*[cs.dot(self.W[t, :].T, Z[int(s), :].T) for t, s in enumerate(self.tap_signal)])
        return U, head(h, U[:, -1], self.p)

    def _feedback(self) -> tuple[dict[str, Symbol], Symbol]:
        y = cs.SX.sym("y", len(self.model.outputs))
        if self.model.feedback is None:
            return {}, y
        outputs = SimpleNamespace(**{name: y[k] for k, name in enumerate(self.model.outputs)})
        inputs = SimpleNamespace(**{name: self.u[k] for k, name in enumerate(self.model.inputs)})
        return dict(self.model.feedback(outputs, inputs)), y

    def _sparse(
        self, name: str, of: Symbol, by: Symbol, arguments: list[Symbol], without: Sequence[int] = ()
    ) -> SparseFunction:
        """Nonzeros of a Jacobian, `without` some of its columns."""
        jacobian = cs.jacobian(of, by)
        jacobian[:, list(without)] = 0.0
        transposed = cs.sparsify(jacobian).T  # its nonzeros column by column are those of each expression in succession
        column, row = transposed.sparsity().get_triplet()
        nonzeros = cs.vertcat(*transposed.nonzeros()) if transposed.nnz() else cs.SX(0, 1)
        return SparseFunction(
            nonzeros=SampledFunction(cs.Function(name, arguments, [nonzeros])),
            row=np.array(row, dtype=np.intp),
            column=np.array(column, dtype=np.intp),
            constant=not (transposed.nnz() and cs.depends_on(nonzeros, cs.vertcat(self.p, self.h))),
        )


class _Windows:
    """Collects the windows that the equations request, each signal once."""

    def __init__(self) -> None:
        self.signals: list[Symbol] = []
        self.which: list[int] = []
        self.weights: list[list[Symbol]] = []
        self.symbols: list[Symbol] = []
        self._known: dict[int, int] = {}

    def __call__(self, signal: Symbol, weights: Sequence[Symbol]) -> Symbol:
        signal = cs.SX(signal)
        key = signal.element_hash()
        if key not in self._known:
            self._known[key] = len(self.signals)
            self.signals.append(signal)
        self.which.append(self._known[key])
        self.weights.append(list(weights))
        self.symbols.append(cs.SX.sym(f"h{len(self.symbols)}"))
        return self.symbols[-1]


def tidy(index: Index) -> Columns:
    """An index as a slice if it is consecutive: numpy then works in place instead of copying."""
    if len(index) and np.array_equal(index, np.arange(index[0], index[0] + len(index))):
        return slice(int(index[0]), int(index[0]) + len(index))
    return index


def _padded(weights: Sequence[Symbol], length: int) -> Symbol:
    return cs.horzcat(cs.SX.zeros(1, length - len(weights)), *weights)
