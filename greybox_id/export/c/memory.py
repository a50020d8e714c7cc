"""A model with memory in C: functions, header and source."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as cs

from ...models.model import Symbol
from ..equations import Named
from ..memory_equations import MemoryEquations
from ..template import filled
from .functions import Argument, CFunction, beginning
from .naming import constant, vector

ABOUT = """\
   A model with memory: the outputs one sample later follow from a window of past inputs. You allocate the
   window, a struct of {window} bytes. One sample is {time:g} s. u are the inputs handed in, p the
   parameters, y the outputs. SI units throughout; angles to the left are positive (ISO 8855). Matrices are
   dense, column after column: by_u[row + rows * column]. Functions keep data in the window only, take no
   memory from the heap and call no library other than the mathematical one. They may run at the same time
   on different windows. Stack: at most {stack} bytes. */"""


class MemoryC:
    """The C of a model with memory.

    Parameters
    ----------
    name : prefix of its functions.
    equations : its functions.
    title : a line with the model and its source.
    """

    def __init__(self, name: str, equations: MemoryEquations, title: str) -> None:
        self.name, self.equations, self.title = name, equations, title
        self.functions = tuple(self._functions())

    @property
    def tasks(self) -> dict[str, str]:
        """Function -> description, for people."""
        return {
            f"{self.name}_start": "Fills the window as if inputs and readings had always been constant.",
            f"{self.name}_push": "Adds a sample with measured outputs; first fill the window with such samples.",
            f"{self.name}_step": "Advances the window by one sample, with the model's own predictions.",
            f"{self.name}_output": "What sensors read now.",
            f"{self.name}_step_jacobian": "The next predictions and their derivatives.",
        }

    @property
    def window_bytes(self) -> int:
        """Size of the window in bytes."""
        sizes = self._sizes
        kept = sizes["PAST"] * sizes["NY"] + sizes["MEMORY"] * (sizes["SEEN"] + sizes["SIGNALS"] + sizes["TAPS"])
        return 8 * (sizes["NP"] + 1 + sizes["ACTUATORS"] + kept)

    @property
    def stack_bytes(self) -> int:
        """Upper bound of the stack that any of the functions needs."""
        sizes = self._sizes
        value = sum(int(jacobian.nnz()) + 1 for _, jacobian in self._sparse.values())
        value += (sizes["NY"] + 1) * (sizes["TAPS"] + sizes["SEEN"] + sizes["SIGNALS"]) + sizes["SEEN"] * sizes["NU"]
        return self.window_bytes + max(function.stack_bytes for function in self.functions) + 8 * value

    @property
    def header(self) -> str:
        """The header: sizes, indices and units of all entries, and descriptions of the functions."""
        value, e = self.name, self.equations
        guard = constant(value, "h")
        seen = [Named(name, "", "") for name in e.model.inputs]
        known = ", ".join(f"{k} {name.name}" for k, name in enumerate(seen))
        return "\n".join(
            [
                f"/* {self.title}\n",
                ABOUT.format(time=e.sample_time, stack=self.stack_bytes, window=self.window_bytes),
                f"\n#ifndef {guard}\n#define {guard}\n",
                '#ifdef __cplusplus\nextern "C" {\n#endif\n',
                f"#define {constant(value, 'SAMPLE_TIME')} {e.sample_time!r} /* s */\n",
                vector(value, "U", "Inputs that are handed in", e.inputs),
                vector(value, "P", "Parameters", e.parameters),
                vector(value, "Y", "Outputs", e.outputs),
                f"/* The window. Inputs as the equations see them: {known}. */",
                *(f"#define {constant(value, word)} {size}" for word, size in self._sizes.items() if word[0] != "N"),
                f"\nextern const double {value}_default_parameters[];",
                *(f"extern const char *const {value}_{which}_names[];" for which in ("input", "parameter", "output")),
                filled("c_window.h", value),
                "#ifdef __cplusplus\n}\n#endif\n\n#endif\n",
            ]
        )

    @property
    def source(self) -> str:
        """The source."""
        one, e = self.name, self.equations
        lists = {"input": e.inputs, "parameter": e.parameters, "output": e.outputs}
        first = beginning(self.title, one, self.functions, e.values, lists)
        static = [f"static {function.definition}" for function in self.functions]
        return "\n".join([*first, *static, self._tables, filled("c_window.c", one)])

    @property
    def _sizes(self) -> dict[str, int]:
        e, trace = self.equations, self.equations.trace
        return {
            "NU": len(e.inputs),
            "NP": len(e.parameters),
            "NY": len(e.outputs),
            "MEMORY": trace.memory,
            "SEEN": len(e.model.inputs),
            "SIGNALS": max(1, trace.stage.outputs),
            "TAPS": max(1, len(trace.tap_signal)),
            "ACTUATORS": max(1, len(e.model.actuators)),
            "PAST": max(e.held.values()),
            "SENSED": sum(e.held.values()),
        }

    @property
    def _tables(self) -> str:
        """C arrays: the signal of each window, and the positions of nonzeros of sparse derivatives."""
        e = self.equations
        handed_in = [item.name for item in e.inputs]
        tables = {
            "tap_signal": [int(k) for k in e.trace.tap_signal],
            "held": list(e.held.values()),
            "actuator_input": [handed_in.index(actuator.signal) for actuator in e.model.actuators] or [-1],
        }
        for name, (_, jacobian) in self._sparse.items():
            row, column = jacobian.sparsity().get_triplet()
            tables |= {f"{name}_row": row, f"{name}_column": column}
        counts = [f"#define {name.upper()} {jacobian.nnz()}" for name, (_, jacobian) in self._sparse.items()]
        written = [
            f"static const short {name}[] = {{{', '.join(map(str, entries)) or '0'}}};"
            for name, entries in tables.items()
        ]
        return "\n".join([*counts, *written, ""])

    @cached_property
    def _stages(self) -> tuple[_Stage, ...]:
        """The equations' stages, as functions of the adjustable parameters."""
        e, trace = self.equations, self.equations.trace
        seen, h = cs.SX.sym("seen", len(e.model.inputs)), cs.SX.sym("h", len(trace.tap_signal))
        return (
            _Stage("stage", {"u": seen, "p": e.p}, "z", trace.stage.function(seen, e.all_of_p)),
            _Stage("weights", {"p": e.p}, "W", trace.weights.function(e.all_of_p)),
            _Stage("head", {"h": h, "u": seen, "p": e.p}, "y", trace.head.function(h, seen, e.all_of_p)),
        )

    @cached_property
    def _sparse(self) -> dict[str, tuple[_Stage, Symbol]]:
        """Sparse derivatives: name of the function -> (stage, Jacobian)."""
        stage, weights, _ = self._stages
        return {
            f"{of.name}_by_{by}": (of, cs.jacobian(of.value, of.arguments[by]))
            for of, by in ((stage, "u"), (stage, "p"), (weights, "p"))
        }

    def _functions(self) -> list[CFunction]:
        e, head = self.equations, self._stages[2]
        y, a = cs.SX.sym("y", len(e.outputs)), cs.SX.sym("a", len(e.model.actuators))
        sees, a_next = e.seen(y, a, e.u, e.p)
        known = {"y": y, "a": a, "u": e.u, "p": e.p}
        sensors = cs.vertcat(*[weight for name in e.model.outputs for weight in e.sensor_weights(name)])
        result = [_function(stage.name, stage.arguments, {stage.result: stage.value}) for stage in self._stages]
        result.append(_function("head_by", head.arguments, _derivatives(head.value, head.arguments)))
        for name, (of, jacobian) in self._sparse.items():
            nonzeros = cs.vertcat(*jacobian.nonzeros()) if jacobian.nnz() else cs.SX(1, 1)
            result.append(_function(name, of.arguments, {"nonzeros": nonzeros}))
        result.append(_function("seen", known, {"sees": sees, "a_next": a_next}))
        result.append(_function("seen_by", known, _derivatives(sees, {"y": y, "u": e.u})))
        result.append(_function("sensors", {"p": e.p}, {"weight": cs.SX(sensors)}))
        return result


@dataclass(frozen=True)
class _Stage:
    """A stage of the equations: name, arguments, and name and expression of the result."""

    name: str
    arguments: Mapping[str, Symbol]
    result: str
    value: Symbol


def _derivatives(value: Symbol, arguments: Mapping[str, Symbol]) -> dict[str, Symbol]:
    return {f"by_{name}": cs.jacobian(value, symbol) for name, symbol in arguments.items()}


def _function(name: str, arguments: Mapping[str, Symbol], results: Mapping[str, Symbol]) -> CFunction:
    made = cs.Function(name, list(arguments.values()), [cs.vec(cs.densify(value)) for value in results.values()])
    given, got = (tuple(Argument(name, "all") for name in names) for names in (arguments, results))
    return CFunction(name, made, given, got, "")
