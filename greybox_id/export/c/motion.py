"""A model of motion in C: its functions, header and source."""

from __future__ import annotations

from collections.abc import Collection

import casadi as cs

from ..equations import Equations
from .functions import Argument, CFunction, mathematics_of
from .late import CAPACITY, late_declarations, late_definitions
from .mathematics import EXACT
from .naming import constant, names, numbers, vector

ABOUT = """\
   x is the state, u what is commanded or measured of the inputs, held over a step, p the parameters, y
   what sensors read. SI units throughout; angles to the left are positive (ISO 8855). Matrices are dense,
   column after column: by_x[row + rows * column]. No function keeps anything, takes memory from the heap or
   calls more than the mathematical library; all may run at the same time. x_next may be x; other results
   have places of their own. Stack: at most {stack} bytes. */"""


class MotionC:
    """The C of a model of motion.

    Parameters
    ----------
    name : what its functions are called after.
    equations : its functions.
    title : a line that says what it is and where it comes from.
    commands : how many commands are remembered where they arrive late.
    left_out : functions that are not needed, such as "step_by_p"; without "ode_jacobian" there is no vde_forw either.
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
        """Function -> what it does, for people."""
        sensitivities = {f"{self.name}_vde_forw": "The derivatives of the state and of its forward sensitivities."}
        return {function.name: function.about for function in self.functions} | sensitivities

    @property
    def stack_bytes(self) -> int:
        """What any of the functions needs of the stack at most."""
        n = len(self.equations.states)
        return max(own.stack_bytes for own in self.functions) + 8 * n * (n + len(self.equations.inputs))

    @property
    def header(self) -> str:
        """The header: sizes, places and units of all entries, and what the functions do."""
        own, e = self.name, self.equations
        guard = constant(own, "h")
        return "\n".join(
            [
                f"/* {self.title}",
                "",
                ABOUT.format(stack=self.stack_bytes),
                "",
                f"#ifndef {guard}\n#define {guard}\n",
                *(["#include <stddef.h>\n"] if e.delayed else []),
                '#ifdef __cplusplus\nextern "C" {\n#endif\n',
                vector(own, "X", "State", e.states),
                vector(own, "U", "Inputs", e.inputs),
                vector(own, "P", "Parameters", e.parameters),
                vector(own, "Y", "Outputs", e.outputs),
                f"extern const double {own}_default_parameters[];",
                *(
                    f"extern const char *const {own}_{which}_names[];"
                    for which in ("state", "input", "parameter", "output")
                ),
                "",
                *(function.declaration for function in self.functions),
                *([self._vde[0]] if "ode_jacobian" not in self._left_out else []),
                *([late_declarations(own, e, self.commands)] if e.delayed else []),
                "#ifdef __cplusplus\n}\n#endif\n\n#endif",
                "",
            ]
        )

    @property
    def source(self) -> str:
        """The source."""
        own, e = self.name, self.equations
        return "\n".join(
            [
                f"/* {self.title} */",
                "",
                EXACT,
                f'#include "{own}.h"\n\n#include <math.h>\n#include <stdint.h>\n#include <string.h>\n',
                mathematics_of(self.functions),
                f"const double {own}_default_parameters[] = {{\n{numbers(e.values if len(e.values) else [0.0])}\n}};\n",
                names(f"{own}_state_names", e.states),
                names(f"{own}_input_names", e.inputs),
                names(f"{own}_parameter_names", e.parameters),
                names(f"{own}_output_names", e.outputs),
                *(function.definition for function in self.functions),
                *([self._vde[1]] if "ode_jacobian" not in self._left_out else []),
                *([late_definitions(own, e)] if e.delayed else []),
            ]
        )

    def _functions(self) -> list[CFunction]:
        e, own = self.equations, self.name
        n, m, q, r = (constant(own, f"N{letter}") for letter in "XUPY")
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
            blocks = ([at] if value else []) + [cs.densify(cs.jacobian(at, own)) for own in by]
            together = cs.cse(cs.vertcat(*[cs.vec(block) for block in blocks]))
            ends = [0]
            for block in blocks:
                ends.append(ends[-1] + block.numel())
            split = [together[a:b] for a, b in zip(ends[:-1], ends[1:], strict=True)]
            arguments = (x, u, p, dt) if of.n_in() == 4 else (x, u, p)
            traced = cs.Function(name, symbols, split)
            return CFunction(f"{own}_{name}", traced, arguments, tuple(Argument(*told) for told in results), about)

        half = "One step of the classical Runge-Kutta method; lags and limits of actuators are exact."
        found = [
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
            function("output", e.output, (("y", r),), (), "What sensors read, but for their latency."),
            function(
                "output_jacobian", e.output, (("y", r), ("by_x", f"{r} x {n}"), ("by_u", f"{r} x {m}")), (e.x, e.u),
                "What sensors read, and its derivatives by state and inputs.",
            ),
        ]  # fmt: skip
        if e.parameters:
            by_p = "The derivative of the state dt [s] later by the parameters."
            found.insert(2, function("step_by_p", e.step, (("by_p", f"{n} x {q}"),), (e.p,), by_p, value=False))
        if e.settles:
            about = "The state with actuators at their commands and relaxed quantities where they settle: how to start."
            found.append(function("settled", e.settled, (("x_next", n),), (), about))
        for name, of, signals in (("delays", e.delays, e.delayed), ("latencies", e.latencies, e.late)):
            if signals:
                about = f"By how many seconds these are late: {', '.join(signals)}."
                found.append(CFunction(f"{own}_{name}", of, (p,), (Argument("s", str(len(signals))),), about))
        return [own for own in found if own.name.removeprefix(f"{self.name}_") not in self._left_out]

    @property
    def _vde(self) -> tuple[str, str]:
        """Forward sensitivities: declaration and definition."""
        own, n, m = self.name, constant(self.name, "NX"), constant(self.name, "NU")
        signature = (
            f"void {own}_vde_forw(const double *x, const double *S_x, const double *S_u, const double *u,\n"
            "    const double *p, double *x_dot, double *S_x_dot, double *S_u_dot)"
        )
        about = (
            "/* The derivative of the state, and those of its sensitivities by state and inputs at the beginning:\n"
            f"   by_x S_x, and by_x S_u + by_u. Lengths: S_x {n} x {n}, S_u {n} x {m}. */\n"
        )
        definition = f"""{signature}
{{
    double by_x[{n} * {n}], by_u[{n} * {m}];
    int i, j, k;
    {own}_ode_jacobian(x, u, p, x_dot, by_x, by_u);
    for (j = 0; j < {n}; j++) {{
        for (i = 0; i < {n}; i++) {{
            double sum = 0.0;
            for (k = 0; k < {n}; k++) {{
                sum += by_x[i + {n} * k] * S_x[k + {n} * j];
            }}
            S_x_dot[i + {n} * j] = sum;
        }}
    }}
    for (j = 0; j < {m}; j++) {{
        for (i = 0; i < {n}; i++) {{
            double sum = by_u[i + {n} * j];
            for (k = 0; k < {n}; k++) {{
                sum += by_x[i + {n} * k] * S_u[k + {n} * j];
            }}
            S_u_dot[i + {n} * j] = sum;
        }}
    }}
}}
"""
        return f"{about}{signature};\n", definition
