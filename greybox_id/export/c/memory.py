"""A map with memory in C: functions, header and source; @ stands for the export's name, $ for the same in capitals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as cs

from ...models.model import Symbol
from ..equations import Named
from ..memory_equations import MemoryEquations
from .functions import Argument, CFunction, mathematics_of
from .mathematics import EXACT
from .naming import constant, names, numbers, vector

ABOUT = """\
   A map with memory: the outputs a sample later follow from a window of past inputs. The window is a struct
   of yours; {window} bytes. One sample is {time:g} s. u are the inputs handed in, p the parameters, y the
   outputs. SI units throughout; angles to the left are positive (ISO 8855). Matrices are dense, column after
   column: by_u[row + rows * column]. No function keeps anything but in the window, takes memory from the heap
   or calls more than the mathematical library; windows of their own may run at the same time.
   Stack: at most {stack} bytes. */"""

DECLARATIONS = """
typedef struct {
    double p[$_NP + 1];
    double weights[$_TAPS][$_MEMORY];  /* of past signals, oldest first */
    double actuators[$_ACTUATORS];
    double y[$_PAST][$_NY];            /* predictions, newest first */
    double u[$_MEMORY][$_SEEN];        /* inputs as the equations saw them, oldest first */
    double z[$_SIGNALS][$_MEMORY];     /* signals made of them */
} @_window;

/* A window as though inputs and readings had stood there since ever. Actuators begin at their commands' value. */
void @_start(@_window *window, const double *p, const double *u, const double *y);

/* A sample is added whose outputs a sample later were read: y. Fills a window before it runs alone. */
void @_push(@_window *window, const double *u, const double *y);

/* A sample later, on its own predictions. */
void @_step(@_window *window, const double *u);

/* What sensors read now. */
void @_output(const @_window *window, double *y);

/* What @_step would predict, y_next ($_NY), and its derivatives by the inputs that the equations see now and
   saw before, by_window ($_NY x $_SEEN x $_MEMORY, oldest sample first, the newest as it will be seen), by the
   inputs handed in, by_u ($_NY x $_NU), the predictions now, by_y ($_NY x $_NY), and the parameters of the
   equations, by_p ($_NY x $_NP). */
void @_step_jacobian(const @_window *window, const double *u, double *y_next, double *by_window, double *by_u,
    double *by_y, double *by_p);
"""

DEFINITIONS = """
static double inner(const double *a, const double *b)
{
    double even = 0.0, odd = 0.0, third = 0.0, last = 0.0;
    int k;
    for (k = 0; k + 3 < $_MEMORY; k += 4) {
        even += a[k] * b[k];
        odd += a[k + 1] * b[k + 1];
        third += a[k + 2] * b[k + 2];
        last += a[k + 3] * b[k + 3];
    }
    for (; k < $_MEMORY; k++) {
        even += a[k] * b[k];
    }
    return (even + odd) + (third + last);
}

static void windows(const @_window *window, double *h)
{
    int t;
    for (t = 0; t < $_TAPS; t++) {
        h[t] = inner(window->weights[t], window->z[tap_signal[t]]);
    }
}

/* the newest sample of the window is what the equations see */
static void look(@_window *window, const double *sees)
{
    double z[$_SIGNALS];
    int s;
    memmove(window->u[0], window->u[1], sizeof window->u - sizeof window->u[0]);
    memcpy(window->u[$_MEMORY - 1], sees, sizeof window->u[0]);
    stage(sees, window->p, z);
    for (s = 0; s < $_SIGNALS; s++) {
        memmove(window->z[s], window->z[s] + 1, sizeof window->z[s] - sizeof window->z[s][0]);
        window->z[s][$_MEMORY - 1] = z[s];
    }
}

static void predicted(@_window *window, const double *y)
{
    memmove(window->y[$_PAST > 1 ? 1 : 0], window->y[0], sizeof window->y - sizeof window->y[0]);
    memcpy(window->y[0], y, sizeof window->y[0]);
}

static void advance(@_window *window, const double *u)
{
    double sees[$_SEEN], actuators[$_ACTUATORS];
    memcpy(actuators, window->actuators, sizeof actuators);
    seen(window->y[0], window->actuators, u, window->p, sees, actuators);
    memcpy(window->actuators, actuators, sizeof actuators);
    look(window, sees);
}

void @_start(@_window *window, const double *p, const double *u, const double *y)
{
    int k;
    memset(window, 0, sizeof *window);
    memcpy(window->p, p, $_NP * sizeof(double));
    weights(window->p, window->weights[0]);
    for (k = 0; k < $_PAST; k++) {
        predicted(window, y);
    }
    for (k = 0; k < $_ACTUATORS; k++) {
        window->actuators[k] = actuator_input[k] < 0 ? 0.0 : u[actuator_input[k]];
    }
    for (k = 0; k < $_MEMORY; k++) {
        advance(window, u);
    }
}

void @_push(@_window *window, const double *u, const double *y)
{
    advance(window, u);
    predicted(window, y);
}

void @_step(@_window *window, const double *u)
{
    double h[$_TAPS], y[$_NY];
    advance(window, u);
    windows(window, h);
    head(h, window->u[$_MEMORY - 1], window->p, y);
    predicted(window, y);
}

void @_output(const @_window *window, double *y)
{
    double weight[$_SENSED];
    int i, k, place = 0;
    sensors(window->p, weight);
    for (i = 0; i < $_NY; i++) {
        y[i] = 0.0;
        for (k = 0; k < held[i]; k++) {
            y[i] += weight[place++] * window->y[k][i];
        }
    }
}

void @_step_jacobian(const @_window *window, const double *u, double *y_next, double *by_window, double *by_u,
    double *by_y, double *by_p)
{
    @_window next = *window;
    const double *const now = next.u[$_MEMORY - 1];
    double h[$_TAPS], by_h[$_NY * $_TAPS], by_now[$_NY * $_SEEN], through[$_NY * $_SIGNALS];
    double of_stage[STAGE_BY_U + STAGE_BY_P + 1], of_weights[WEIGHTS_BY_P + 1];
    double sees_by_y[$_SEEN * $_NY], sees_by_u[$_SEEN * $_NU];
    double *newest = by_window + $_NY * $_SEEN * ($_MEMORY - 1);
    int i, j, k, l, r, t;
    advance(&next, u);
    windows(&next, h);
    head(h, now, next.p, y_next);
    head_by(h, now, next.p, by_h, by_now, by_p);
    memset(by_window, 0, sizeof(double) * $_NY * $_SEEN * $_MEMORY);
    for (l = 0; l < $_MEMORY; l++) {
        double *const by_then = by_window + $_NY * $_SEEN * l;
        memset(through, 0, sizeof through); /* of the predictions by the signals at this sample */
        for (t = 0; t < $_TAPS; t++) {
            for (r = 0; r < $_NY; r++) {
                through[r + $_NY * tap_signal[t]] += by_h[r + $_NY * t] * next.weights[t][l];
            }
        }
        stage_by_u(next.u[l], next.p, of_stage);
        for (k = 0; k < STAGE_BY_U; k++) {
            for (r = 0; r < $_NY; r++) {
                by_then[r + $_NY * stage_by_u_column[k]] += through[r + $_NY * stage_by_u_row[k]] * of_stage[k];
            }
        }
        stage_by_p(next.u[l], next.p, of_stage);
        for (k = 0; k < STAGE_BY_P; k++) {
            for (r = 0; r < $_NY; r++) {
                by_p[r + $_NY * stage_by_p_column[k]] += through[r + $_NY * stage_by_p_row[k]] * of_stage[k];
            }
        }
    }
    weights_by_p(next.p, of_weights);
    for (k = 0; k < WEIGHTS_BY_P; k++) {
        t = weights_by_p_row[k] / $_MEMORY;
        l = weights_by_p_row[k] % $_MEMORY;
        for (r = 0; r < $_NY; r++) {
            by_p[r + $_NY * weights_by_p_column[k]] += by_h[r + $_NY * t] * next.z[tap_signal[t]][l] * of_weights[k];
        }
    }
    for (k = 0; k < $_NY * $_SEEN; k++) {
        newest[k] += by_now[k];
    }
    seen_by(window->y[0], window->actuators, u, next.p, sees_by_y, sees_by_u);
    for (r = 0; r < $_NY; r++) {
        for (j = 0; j < $_NY; j++) {
            by_y[r + $_NY * j] = 0.0;
            for (i = 0; i < $_SEEN; i++) {
                by_y[r + $_NY * j] += newest[r + $_NY * i] * sees_by_y[i + $_SEEN * j];
            }
        }
        for (j = 0; j < $_NU; j++) {
            by_u[r + $_NY * j] = 0.0;
            for (i = 0; i < $_SEEN; i++) {
                by_u[r + $_NY * j] += newest[r + $_NY * i] * sees_by_u[i + $_SEEN * j];
            }
        }
    }
}
"""


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
        value = sum(int(jacobian.nnz()) + 1 for _, jacobian in self._sparse.values())
        value += (sizes["NY"] + 1) * (sizes["TAPS"] + sizes["SEEN"] + sizes["SIGNALS"]) + sizes["SEEN"] * sizes["NU"]
        return self.window_bytes + max(function.stack_bytes for function in self.functions) + 8 * value

    @property
    def header(self) -> str:
        """The header: sizes, places and units of all entries, and what the functions do."""
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
                DECLARATIONS.replace("@", value).replace("$", constant(value)),
                "#ifdef __cplusplus\n}\n#endif\n\n#endif\n",
            ]
        )

    @property
    def source(self) -> str:
        """The source."""
        one, e = self.name, self.equations
        static = [f"static {function.definition}" for function in self.functions]
        return "\n".join(
            [
                f"/* {self.title} */\n",
                EXACT,
                f'#include "{one}.h"\n\n#include <math.h>\n#include <stdint.h>\n#include <string.h>\n',
                mathematics_of(self.functions),
                f"const double {one}_default_parameters[] = {{\n{numbers(e.values if len(e.values) else [0.0])}\n}};\n",
                names(f"{one}_input_names", e.inputs),
                names(f"{one}_parameter_names", e.parameters),
                names(f"{one}_output_names", e.outputs),
                *static,
                self._tables,
                DEFINITIONS.replace("@", one).replace("$", constant(one)),
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
    """A stage of the equations: a function's name, its arguments, and what it gives."""

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
