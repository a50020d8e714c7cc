"""A model of motion in C: its functions, header and source, and commands that arrive late."""

from __future__ import annotations

from collections.abc import Collection

import casadi as cs

from ..equations import Equations
from .functions import Argument, CFunction, mathematics_of
from .mathematics import EXACT
from .naming import constant, names, numbers, vector

CAPACITY = 256
"""Commands that are remembered."""


def late_declarations(text: str, equations: Equations, capacity: int = CAPACITY) -> str:
    """For the header; so many commands are remembered."""
    n, size = constant(text, "NU"), constant(text, "COMMANDS")
    signals = ", ".join(equations.delayed)
    return f"""\
/* Commands arrive late here: {signals}. {text}_step takes the inputs as they act; {text}_step_late takes them
   from a line of past commands and cuts its step where a late one arrives, so that a delay of 3.7 samples is exact.

   {text}_commands_start   one command since ever.
   {text}_commands_push    a command that holds from a time on, later than the one before. Returns 0; -1 if it is not.
   {text}_commands_acting  the inputs that act at a time.
   {text}_commands_until   the same, and how many seconds they go on.
   {text}_step_late        the state at time + dt from that at time; x_next may be x. Returns 0; -1 where the line does
                          not reach back far enough and its oldest command was taken. */
#define {size} {capacity}

typedef struct {{
    double time[{size}];
    double u[{size}][{n}];
    size_t count; /* commands so far */
}} {text}_commands;

void {text}_commands_start({text}_commands *line, const double *u);
int {text}_commands_push({text}_commands *line, double time, const double *u);
int {text}_commands_acting(const {text}_commands *line, const double *p, double time, double *u);
int {text}_commands_until(const {text}_commands *line, const double *p, double time, double *u, double *on);
int {text}_step_late(const {text}_commands *line, const double *x, const double *p, double time, double dt,
    double *x_next);
"""


def late_definitions(text: str, equations: Equations) -> str:
    """For the source."""
    n, m, size = (constant(text, word) for word in ("NX", "NU", "COMMANDS"))
    places = [equations.delayed.index(i.name) if i.name in equations.delayed else -1 for i in equations.inputs]
    count = len(equations.delayed)
    return f"""\
/* which delay each input has; -1: none */
static const int {text}_delay_of[{m}] = {{{", ".join(map(str, places))}}};

void {text}_commands_start({text}_commands *line, const double *u)
{{
    line->time[0] = -HUGE_VAL;
    memcpy(line->u[0], u, sizeof line->u[0]);
    line->count = 1;
}}

int {text}_commands_push({text}_commands *line, double time, const double *u)
{{
    const size_t place = line->count % {size};
    if (!(time > line->time[(line->count - 1) % {size}])) {{
        return -1;
    }}
    line->time[place] = time;
    memcpy(line->u[place], u, sizeof line->u[place]);
    line->count++;
    return 0;
}}

/* what input i is at a time, and when it changes next; -1 where the line does not reach back */
static int {text}_command_at(const {text}_commands *line, size_t i, double time, double *u, double *until)
{{
    const size_t held = line->count < {size} ? line->count : {size};
    size_t back = 0;
    *until = HUGE_VAL;
    while (back + 1 < held && line->time[(line->count - 1 - back) % {size}] > time) {{
        *until = line->time[(line->count - 1 - back) % {size}];
        back++;
    }}
    *u = line->u[(line->count - 1 - back) % {size}][i];
    return line->time[(line->count - 1 - back) % {size}] > time ? -1 : 0;
}}

int {text}_commands_until(const {text}_commands *line, const double *p, double time, double *u, double *on)
{{
    double late[{count}];
    size_t i;
    int found = 0;
    {text}_delays(p, late);
    *on = HUGE_VAL;
    for (i = 0; i < {m}; i++) {{
        const double delay = {text}_delay_of[i] < 0 ? 0.0 : late[{text}_delay_of[i]];
        double until;
        if ({text}_command_at(line, i, time - delay, &u[i], &until) != 0) {{
            found = -1;
        }}
        if (until - (time - delay) < *on) {{
            *on = until - (time - delay);
        }}
    }}
    return found;
}}

int {text}_commands_acting(const {text}_commands *line, const double *p, double time, double *u)
{{
    double on;
    return {text}_commands_until(line, p, time, u, &on);
}}

int {text}_step_late(const {text}_commands *line, const double *x, const double *p, double time, double dt,
    double *x_next)
{{
    const double end = time + dt, soon = 1e-9 * dt; /* commands a billionth of a step apart act as one */
    double now[{n}], u[{m}], on;
    int found = 0;
    memcpy(now, x, sizeof now);
    while (end - time > soon) {{
        double h = end - time;
        if ({text}_commands_until(line, p, time + soon, u, &on) != 0) {{
            found = -1;
        }}
        if (on + soon < h) {{
            h = on + soon;
        }}
        {text}_step(now, u, p, h, now);
        time += h;
    }}
    memcpy(x_next, now, sizeof now);
    return found;
}}
"""


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
        return max(function.stack_bytes for function in self.functions) + 8 * n * (n + len(self.equations.inputs))

    @property
    def header(self) -> str:
        """The header: sizes, places and units of all entries, and what the functions do."""
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
                *([self._vde[0]] if "ode_jacobian" not in self._left_out else []),
                *([late_declarations(value, e, self.commands)] if e.delayed else []),
                "#ifdef __cplusplus\n}\n#endif\n\n#endif",
                "",
            ]
        )

    @property
    def source(self) -> str:
        """The source."""
        one, e = self.name, self.equations
        return "\n".join(
            [
                f"/* {self.title} */",
                "",
                EXACT,
                f'#include "{one}.h"\n\n#include <math.h>\n#include <stdint.h>\n#include <string.h>\n',
                mathematics_of(self.functions),
                f"const double {one}_default_parameters[] = {{\n{numbers(e.values if len(e.values) else [0.0])}\n}};\n",
                names(f"{one}_state_names", e.states),
                names(f"{one}_input_names", e.inputs),
                names(f"{one}_parameter_names", e.parameters),
                names(f"{one}_output_names", e.outputs),
                *(function.definition for function in self.functions),
                *([self._vde[1]] if "ode_jacobian" not in self._left_out else []),
                *([late_definitions(one, e)] if e.delayed else []),
            ]
        )

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
            function("output", e.output, (("y", r),), (), "What sensors read, but for their latency."),
            function(
                "output_jacobian", e.output, (("y", r), ("by_x", f"{r} x {n}"), ("by_u", f"{r} x {m}")), (e.x, e.u),
                "What sensors read, and its derivatives by state and inputs.",
            ),
        ]  # fmt: skip
        if e.parameters:
            by_p = "The derivative of the state dt [s] later by the parameters."
            result.insert(2, function("step_by_p", e.step, (("by_p", f"{n} x {q}"),), (e.p,), by_p, value=False))
        if e.settles:
            about = "The state with actuators at their commands and relaxed quantities where they settle: how to start."
            result.append(function("settled", e.settled, (("x_next", n),), (), about))
        for name, of, signals in (("delays", e.delays, e.delayed), ("latencies", e.latencies, e.late)):
            if signals:
                about = f"By how many seconds these are late: {', '.join(signals)}."
                result.append(CFunction(f"{entry}_{name}", of, (p,), (Argument("s", str(len(signals))),), about))
        return [item for item in result if item.name.removeprefix(f"{self.name}_") not in self._left_out]

    @property
    def _vde(self) -> tuple[str, str]:
        """Forward sensitivities: declaration and definition."""
        value, n, m = self.name, constant(self.name, "NX"), constant(self.name, "NU")
        signature = (
            f"void {value}_vde_forw(const double *x, const double *S_x, const double *S_u, const double *u,\n"
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
    {value}_ode_jacobian(x, u, p, x_dot, by_x, by_u);
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
