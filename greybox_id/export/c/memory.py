"""A map with memory in C: its window as a struct, a step of it, and the derivatives of what it predicts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as cs

from ...model import Symbol
from ..equations import Named
from ..memory_equations import MemoryEquations
from .functions import Argument, CFunction, mathematics_of
from .mathematics import EXACT
from .memory_text import ABOUT, DECLARATIONS, DEFINITIONS
from .naming import constant, names, numbers, vector


class MemoryC:
    """The C of a map with memory.

    Parameters
    ----------
    name : what its functions are called after.
    equations : its functions.
    title : a line that says what it is and where it comes from.
    """

    def __init__(self, name: str, equations: MemoryEquations, title: str) -> None:
        self.name, self.equations, self.title = name, equations, title
        self.functions = tuple(self._functions())

    @property
    def tasks(self) -> dict[str, str]:
        """Function -> what it does, for people."""
        return {
            f"{self.name}_start": "A window as though inputs and readings had stood there since ever.",
            f"{self.name}_push": "A sample is added whose outputs were read: fills the window before it runs alone.",
            f"{self.name}_step": "A sample later, on its own predictions.",
            f"{self.name}_output": "What sensors read now.",
            f"{self.name}_step_jacobian": "The next predictions and their derivatives.",
        }

    @property
    def window_bytes(self) -> int:
        """How large the window is."""
        sizes = self._sizes
        kept = sizes["PAST"] * sizes["NY"] + sizes["MEMORY"] * (sizes["SEEN"] + sizes["SIGNALS"] + sizes["TAPS"])
        return 8 * (sizes["NP"] + 1 + sizes["ACTUATORS"] + kept)

    @property
    def stack_bytes(self) -> int:
        """What any of the functions needs of the stack at most."""
        sizes = self._sizes
        own = sum(int(jacobian.nnz()) + 1 for _, jacobian in self._sparse.values())
        own += (sizes["NY"] + 1) * (sizes["TAPS"] + sizes["SEEN"] + sizes["SIGNALS"]) + sizes["SEEN"] * sizes["NU"]
        return self.window_bytes + max(function.stack_bytes for function in self.functions) + 8 * own

    @property
    def header(self) -> str:
        """The header: sizes, places and units of all entries, and what the functions do."""
        own, e = self.name, self.equations
        guard = constant(own, "h")
        seen = [Named(name, "", "") for name in e.model.inputs]
        told = ", ".join(f"{k} {name.name}" for k, name in enumerate(seen))
        return "\n".join(
            [
                f"/* {self.title}\n",
                ABOUT.format(time=e.sample_time, stack=self.stack_bytes, window=self.window_bytes),
                f"\n#ifndef {guard}\n#define {guard}\n",
                '#ifdef __cplusplus\nextern "C" {\n#endif\n',
                f"#define {constant(own, 'SAMPLE_TIME')} {e.sample_time!r} /* s */\n",
                vector(own, "U", "Inputs that are handed in", e.inputs),
                vector(own, "P", "Parameters", e.parameters),
                vector(own, "Y", "Outputs", e.outputs),
                f"/* The window. Inputs as the equations see them: {told}. */",
                *(f"#define {constant(own, word)} {size}" for word, size in self._sizes.items() if word[0] != "N"),
                f"\nextern const double {own}_default_parameters[];",
                *(f"extern const char *const {own}_{which}_names[];" for which in ("input", "parameter", "output")),
                DECLARATIONS.replace("@", own).replace("$", constant(own)),
                "#ifdef __cplusplus\n}\n#endif\n\n#endif\n",
            ]
        )

    @property
    def source(self) -> str:
        """The source."""
        own, e = self.name, self.equations
        static = [f"static {function.definition}" for function in self.functions]
        return "\n".join(
            [
                f"/* {self.title} */\n",
                EXACT,
                f'#include "{own}.h"\n\n#include <math.h>\n#include <stdint.h>\n#include <string.h>\n',
                mathematics_of(self.functions),
                f"const double {own}_default_parameters[] = {{\n{numbers(e.values if len(e.values) else [0.0])}\n}};\n",
                names(f"{own}_input_names", e.inputs),
                names(f"{own}_parameter_names", e.parameters),
                names(f"{own}_output_names", e.outputs),
                *static,
                self._tables,
                DEFINITIONS.replace("@", own).replace("$", constant(own)),
            ]
        )

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
        """Which signal each window looks at, and where the nonzeros of sparse derivatives stand."""
        e = self.equations
        handed_in = [own.name for own in e.inputs]
        tables = {
            "tap_signal": [int(k) for k in e.trace.tap_signal],
            "held": list(e.held.values()),
            "actuator_input": [handed_in.index(own.signal) for own in e.model.actuators] or [-1],
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
        """The equations' stages, at the parameters that move."""
        e, trace = self.equations, self.equations.trace
        seen, h = cs.SX.sym("seen", len(e.model.inputs)), cs.SX.sym("h", len(trace.tap_signal))
        return (
            _Stage("stage", {"u": seen, "p": e.p}, "z", trace.stage.function(seen, e.all_of_p)),
            _Stage("weights", {"p": e.p}, "W", trace.weights.function(e.all_of_p)),
            _Stage("head", {"h": h, "u": seen, "p": e.p}, "y", trace.head.function(h, seen, e.all_of_p)),
        )

    @cached_property
    def _sparse(self) -> dict[str, tuple[_Stage, Symbol]]:
        """Sparse derivatives: by the name of their function, of which stage."""
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
        found = [_function(own.name, own.arguments, {own.result: own.value}) for own in self._stages]
        found.append(_function("head_by", head.arguments, _derivatives(head.value, head.arguments)))
        for name, (of, jacobian) in self._sparse.items():
            nonzeros = cs.vertcat(*jacobian.nonzeros()) if jacobian.nnz() else cs.SX(1, 1)
            found.append(_function(name, of.arguments, {"nonzeros": nonzeros}))
        found.append(_function("seen", known, {"sees": sees, "a_next": a_next}))
        found.append(_function("seen_by", known, _derivatives(sees, {"y": y, "u": e.u})))
        found.append(_function("sensors", {"p": e.p}, {"weight": cs.SX(sensors)}))
        return found


@dataclass(frozen=True)
class _Stage:
    """A stage of the equations: a function's name, its arguments, and what it gives."""

    name: str
    arguments: Mapping[str, Symbol]
    result: str
    value: Symbol


def _derivatives(value: Symbol, arguments: Mapping[str, Symbol]) -> dict[str, Symbol]:
    return {f"by_{name}": cs.jacobian(value, symbol) for name, symbol in arguments.items()}


def _function(name: str, arguments: Mapping[str, Symbol], results: Mapping[str, Symbol]) -> CFunction:
    made = cs.Function(name, list(arguments.values()), [cs.vec(cs.densify(value)) for value in results.values()])
    given, got = (tuple(Argument(own, "all") for own in names) for names in (arguments, results))
    return CFunction(name, made, given, got, "")
