"""A motion model in C: functions, header and source, and delayed commands."""

from __future__ import annotations

from collections.abc import Collection

import casadi as cs

from ..equations import Equations
from ..template import filled
from .functions import Argument, CFunction, beginning
from .naming import constant, vector

CAPACITY = 256
"""Number of commands stored."""


ABOUT = """\
   x is the state and p the parameters; u are the inputs as commanded or measured, held over a step; y is
   what sensors read. SI units throughout; angles to the left are positive (ISO 8855). Matrices are dense,
   column after column: by_x[row + rows * column]. Functions keep no data between calls, take no memory from
   the heap and call no library other than the mathematical one. They may run at the same time. x_next may
   be x; other results have places of their own. Stack: at most {stack} bytes. */"""


class MotionC:
    """The C of a motion model.

    Parameters
    ----------
    name : prefix of its functions.
    equations : its functions.
    title : a line with the model and its source.
    commands : number of commands stored if they are delayed.
    left_out : functions to omit, such as "step_by_p"; without "ode_jacobian" there is no vde_forw either.
    """

    def __init__(
        self,
        name: str,
        equations: Equations,
        title: str,
        commands: int = CAPACITY,
        left_out: Collection[str] = (),
    ) -> None:
        self.name, self.equations, self.title, self.commands = name, equations, title, commands
        self._left_out = left_out
        self.functions = tuple(self._functions())

    @property
    def tasks(self) -> dict[str, str]:
        """Function -> description, for people."""
        sensitivities = {f"{self.name}_vde_forw": "The derivatives of the state and of its forward sensitivities."}
        return {function.name: function.about for function in self.functions} | sensitivities

    @property
    def stack_bytes(self) -> int:
        """Upper bound of the stack that any of the functions needs."""
        n = len(self.equations.states)
        return max(function.stack_bytes for function in self.functions) + 8 * n * (n + len(self.equations.inputs))

    @property
    def header(self) -> str:
        """The header: sizes, indices and units of all entries, and descriptions of the functions."""
        value, e = self.name, self.equations
        guard = constant(value, "h")
        return "\n".join(
            [
                f"/* {self.title}",
                "",
                ABOUT.format(stack=self.stack_bytes),
                "",
                f"#ifndef {guard}\n#define {guard}\n",
                *(["#include <stddef.h>\n"] if e.delayed else []),
                '#ifdef __cplusplus\nextern "C" {\n#endif\n',
                vector(value, "X", "State", e.states),
                vector(value, "U", "Inputs", e.inputs),
                vector(value, "P", "Parameters", e.parameters),
                vector(value, "Y", "Outputs", e.outputs),
                f"extern const double {value}_default_parameters[];",
                *(
                    f"extern const char *const {value}_{which}_names[];"
                    for which in ("state", "input", "parameter", "output")
                ),
                "",
                *(function.declaration for function in self.functions),
                *([filled("c_sensitivities.h", value)] if "ode_jacobian" not in self._left_out else []),
                *([self._late("c_late.h")] if e.delayed else []),
                "#ifdef __cplusplus\n}\n#endif\n\n#endif",
                "",
            ]
        )

    @property
    def source(self) -> str:
        """The source."""
        one, e = self.name, self.equations
        lists = {"state": e.states, "input": e.inputs, "parameter": e.parameters, "output": e.outputs}
        return "\n".join(
            [
                *beginning(self.title, one, self.functions, e.values, lists),
                *(function.definition for function in self.functions),
                *([filled("c_sensitivities.c", one)] if "ode_jacobian" not in self._left_out else []),
                *([self._late("c_late.c")] if e.delayed else []),
            ]
        )

    def _late(self, template: str) -> str:
        """Code for delayed commands."""
        late, inputs = self.equations.delayed, self.equations.inputs
        places = [late.index(item.name) if item.name in late else -1 for item in inputs]
        return filled(
            template, self.name, SIGNALS=", ".join(late), CAPACITY=self.commands, COUNT=len(late),
            PLACES=", ".join(map(str, places)),
        )  # fmt: skip

    def _functions(self) -> list[CFunction]:
        e, entry = self.equations, self.name
        n, m, q, r = (constant(entry, f"N{letter}") for letter in "XUPY")
        x, u, p, dt = Argument("x", n), Argument("u", m), Argument("p", q), Argument("dt", "")

        def function(
            name: str,
            of: cs.Function,
            results: tuple[tuple[str, str], ...],
            by: tuple[cs.SX, ...],
            about: str,
            value: bool = True,
        ) -> CFunction:
            symbols = [e.x, e.u, e.p, *([e.dt] if of.n_in() == 4 else [])]
            at = of(*symbols)
            blocks = ([at] if value else []) + [cs.densify(cs.jacobian(at, item)) for item in by]
            together = cs.cse(cs.vertcat(*[cs.vec(block) for block in blocks]))
            ends = [0]
            for block in blocks:
                ends.append(ends[-1] + block.numel())
            split = [together[a:b] for a, b in zip(ends[:-1], ends[1:], strict=True)]
            arguments = (x, u, p, dt) if of.n_in() == 4 else (x, u, p)
            traced = cs.Function(name, symbols, split)
            return CFunction(f"{entry}_{name}", traced, arguments, tuple(Argument(*item) for item in results), about)

        half = "One step of the classical Runge-Kutta method; lags and limits of actuators are exact."
        result = [
            function("step", e.step, (("x_next", n),), (), f"The state dt [s] later. {half}"),
            function(
                "step_jacobian", e.step, (("x_next", n), ("by_x", f"{n} x {n}"), ("by_u", f"{n} x {m}")), (e.x, e.u),
                "The state dt [s] later and its derivatives by state and inputs.",
            ),
            function("ode", e.ode, (("x_dot", n),), (), "The derivative of the state."),
            function(
                "ode_jacobian", e.ode, (("x_dot", n), ("by_x", f"{n} x {n}"), ("by_u", f"{n} x {m}")), (e.x, e.u),
                "The derivative of the state, and its derivatives by state and inputs.",
            ),
            function("output", e.output, (("y", r),), (), "What sensors read, without their latency."),
            function(
                "output_jacobian", e.output, (("y", r), ("by_x", f"{r} x {n}"), ("by_u", f"{r} x {m}")), (e.x, e.u),
                "What sensors read, and its derivatives by state and inputs.",
            ),
        ]  # fmt: skip
        if e.parameters:
            by_p = "The derivative of the state dt [s] later by the parameters."
            result.insert(2, function("step_by_p", e.step, (("by_p", f"{n} x {q}"),), (e.p,), by_p, value=False))
        if e.settles:
            about = "A state to start from: actuators at their commands, relaxed quantities at their steady values."
            result.append(function("settled", e.settled, (("x_next", n),), (), about))
        for name, of, signals in (("delays", e.delays, e.delayed), ("latencies", e.latencies, e.late)):
            if signals:
                about = f"Delays in seconds, in this order: {', '.join(signals)}."
                result.append(CFunction(f"{entry}_{name}", of, (p,), (Argument("s", str(len(signals))),), about))
        return [item for item in result if item.name.removeprefix(f"{self.name}_") not in self._left_out]
