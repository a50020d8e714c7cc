"""C programs that compare an export with numbers computed in Python.

Equations of motion are compared at random points, models with memory along a sequence of random inputs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ...base.shorthands import Array
from ..memory_equations import MemoryEquations
from ..points import points
from .functions import CFunction
from .memory import MemoryC
from .motion import MotionC
from .naming import numbers

POINTS = 100
TOLERANCE, RELAXED_TOLERANCE = 1e-12, 1e-10
"""Allowed difference relative to a number's size plus a thousandth of the largest of its kind; a hundred times as much
with relaxed quantities, whose exponential formulas lose digits by cancellation."""

COMPARE = """\
static double worst = 0.0;

/* entries of one result against those expected, relative to an entry and to a thousandth of the largest one */
static void compare(const double *found, const double *expected, int count, double largest)
{
    int k;
    for (k = 0; k < count; k++) {
        const double off = fabs(found[k] - expected[k]) / (fabs(expected[k]) + 1e-3 * largest + 1e-300);
        if (worst == worst && !(off <= worst)) { /* what is no number stays the worst */
            worst = off;
        }
    }
}
"""
MOST = 20_000
"""Largest number of values written per result; for larger results fewer points are used."""


def self_test(written: MotionC) -> str:
    """The program's text. The program returns 0 if all differences are within tolerance."""
    tolerance = RELAXED_TOLERANCE if written.equations.model.relaxations else TOLERANCE
    given = points(written.equations, POINTS)
    head = [
        f"/* {written.title}",
        "   Compares the functions with what Python computed at random points, among them some at standstill. */",
        f'\n#include "{written.name}.h"\n\n#include <math.h>\n#include <stdio.h>\n',
        *(table(f"given_{name}", values.reshape(POINTS, -1)) for name, values in given.items() if values.size),
        *([] if given["p"].size else ["static const double given_p[1][1] = {{0.0}};\n"]),
        COMPARE,
    ]
    tests = [_test(function, given) for function in written.functions]
    tests.append(_sensitivities(written, given))
    calls = "\n".join(f"    test_{name}();" for name in [*(item.name for item in written.functions), "sensitivities"])
    return (
        "\n".join(head + tests)
        + f"""
int main(void)
{{
{calls}
    printf("{written.name}: {POINTS} points, largest relative difference %.1e\\n", worst);
    return worst <= {tolerance} ? 0 : 1;
}}
"""
    )


def expected(function: CFunction, given: Mapping[str, Array]) -> list[Array]:
    """A function's results at all points by CasADi's virtual machine, (points, entries) each."""
    of: cs.Function = function.function
    arguments = [np.atleast_2d(given[argument.name].reshape(len(given["dt"]), -1).T) for argument in function.arguments]
    values = of.map(len(given["dt"])).call([cs.DM(argument) for argument in arguments])
    return [np.asarray(value).reshape(-1, len(given["dt"]), order="F").T for value in values]


def _test(function: CFunction, given: Mapping[str, Array]) -> str:
    values = expected(function, given)
    rows = min(POINTS, max(1, MOST // max(1, max(value.shape[1] for value in values))))
    lines, declared = [], []
    for result, value in zip(function.results, values, strict=True):
        lines.append(table(f"{function.name}_{result.name}", value[:rows]))
        declared.append(f"double {result.name}[{value.shape[1]}];")
    arguments = [f"given_{item.name}[k]" if item.size else f"given_{item.name}[k][0]" for item in function.arguments]
    call = ", ".join([*arguments, *(result.name for result in function.results)]).replace(
        "given_p[k]", "given_p[k]" if given["p"].size else "given_p[0]"
    )
    compared = [
        f"compare({result.name}, {function.name}_{result.name}[k], {value.shape[1]}, {largest!r});"
        for result, value in zip(function.results, values, strict=True)
        for largest in [float(np.max(np.abs(value), initial=0.0))]
    ]
    body = "\n        ".join([*declared, f"{function.name}({call});", *compared])
    return (
        "\n".join(lines)
        + f"""
static void test_{function.name}(void)
{{
    int k;
    for (k = 0; k < {rows}; k++) {{
        {body}
    }}
}}
"""
    )


def _sensitivities(written: MotionC, given: Mapping[str, Array]) -> str:
    """A test of the forward sensitivities, for matrices with distinct entries."""
    entry, e = written.name, written.equations
    jacobian = next(function for function in written.functions if function.name == f"{entry}_ode_jacobian")
    n, m = len(e.states), len(e.inputs)
    _, by_x, by_u = expected(jacobian, given)
    S_x, S_u = (1.0 / (2.0 + np.arange(n)[:, None] + 3.0 * np.arange(count)) for count in (n, m))
    A, B = by_x.reshape(-1, n, n, order="F"), by_u.reshape(-1, n, m, order="F")
    made = {"S_x_dot": A @ S_x, "S_u_dot": A @ S_u + B}
    tables = [table(f"expected_{name}", value.transpose(0, 2, 1).reshape(POINTS, -1)) for name, value in made.items()]
    tables += [table(f"given_{name}", value.ravel(order="F")[None]) for name, value in (("S_x", S_x), ("S_u", S_u))]
    compared = [
        f"compare({name}, expected_{name}[k], {value[0].size}, {float(np.max(np.abs(value)))!r});"
        for name, value in made.items()
    ]
    p = "given_p[k]" if given["p"].size else "given_p[0]"
    return (
        "\n".join(tables)
        + f"""
static void test_sensitivities(void)
{{
    int k;
    for (k = 0; k < {POINTS}; k++) {{
        double x_dot[{n}], S_x_dot[{n * n}], S_u_dot[{n * m}];
        {entry}_vde_forw(given_x[k], given_S_x[0], given_S_u[0], given_u[k], {p}, x_dot, S_x_dot, S_u_dot);
        {" ".join(compared)}
    }}
}}
"""
    )


def table(name: str, rows: Array) -> str:
    """C of an array of rows."""
    lines = ",\n".join(f"    {{\n{numbers(row)}\n    }}" for row in rows)
    return f"static const double {name}[{len(rows)}][{rows.shape[1]}] = {{\n{lines}\n}};\n"


PUSHED = 5
"""Samples with readings before the model runs on its own predictions."""
EVERY = 20
"""Samples between comparisons of derivatives."""
USUAL = {"v_x": 0.5, "steer": 0.1, "a_x": 1.0, "a_y": 2.0, "yaw_rate": 0.5, "motor_current": 5.0, "road_slope": 0.02}
"""Standard deviations of inputs and readings, SI units; others have one."""
SPEED = 2.5
"""Mean speed, m/s."""


@dataclass(frozen=True)
class CheckedCourse:
    """Inputs of a test sequence and the expected results.

    Attributes
    ----------
    u, y : (samples, ...) inputs and readings.
    outputs : (samples, NY) readings of sensors after each sample.
    derivatives : sample -> y_next, by_window, by_u, by_y, by_p, flattened, before the next sample.
    """

    u: Array
    y: Array
    outputs: Array
    derivatives: dict[int, list[Array]]


def course(e: MemoryEquations) -> CheckedCourse:
    """A window of steady driving, a few samples with readings, then `POINTS` on the model's own predictions."""
    rng = np.random.default_rng(0)
    u, y = (np.column_stack([_random(entry.name, rng) for entry in entries]) for entries in (e.inputs, e.outputs))
    handed_in = [item.name for item in e.inputs]
    actuators = np.array([u[0, handed_in.index(actuator.signal)] for actuator in e.model.actuators])
    predicted = {name: [y[0, k]] * count for k, (name, count) in enumerate(e.held.items())}
    seen = [np.array(e.seen(y[0], actuators, u[0], e.values)[0]).ravel()] * e.trace.memory
    U, value = e.trace.step
    predict = cs.Function("predict", [U, e.trace.p], [value])
    at = predict(U, e.all_of_p)
    derived = cs.Function("derived", [U, e.p], [cs.jacobian(at, cs.vec(U)), cs.jacobian(at, e.p)])
    whole = np.array(cs.Function("whole", [e.p], [e.all_of_p])(e.values)).ravel()
    outputs, derivatives = [], {}
    for k in range(PUSHED + POINTS):
        newest = np.array([predicted[name][0] for name in e.model.outputs])
        sees, moved = (np.array(item).ravel() for item in e.seen(newest, actuators, u[k], e.values))
        window = np.column_stack([*seen[1:], sees])
        following = np.array(predict(window, whole)).ravel()
        if k >= PUSHED and k % EVERY == 0:
            derivatives[k] = [following, *_derivatives(e, derived, window, newest, actuators, u[k])]
        actuators, seen = moved, [*seen[1:], sees]
        for i, name in enumerate(e.model.outputs):
            predicted[name] = [y[k, i] if k < PUSHED else following[i], *predicted[name][:-1]]
        outputs.append(
            [float(sum(w * v for w, v in zip(_sensor(e, name), predicted[name], strict=True))) for name in predicted]
        )
    return CheckedCourse(u, y, np.array(outputs), derivatives)


def memory_self_test(written: MemoryC) -> str:
    """The program's text. The program returns 0 if all differences are within tolerance."""
    value, e = written.name, written.equations
    run = course(e)
    results = ("y_next", "by_window", "by_u", "by_y", "by_p")
    places = sorted(run.derivatives)
    result = {name: np.array([run.derivatives[k][i] for k in places]) for i, name in enumerate(results)}
    tables = [table("given_u", run.u), table("given_y", run.y), table("expected_outputs", run.outputs)]
    tables += [table(f"expected_{name}", values) for name, values in result.items() if values.size]
    declared = "\n    ".join(f"static double {name}[{values.shape[1] or 1}];" for name, values in result.items())
    compared = "\n            ".join(
        f"compare({name}, expected_{name}[place], {values.shape[1]}, {float(np.max(np.abs(values)))!r});"
        for name, values in result.items()
        if values.size
    )
    return "\n".join(
        [
            f"/* {written.title}",
            "   Compares the functions with what Python computed along a course of random inputs. */",
            f'\n#include "{value}.h"\n\n#include <math.h>\n#include <stdio.h>\n',
            *tables,
            COMPARE,
            f"""\
int main(void)
{{
    static {value}_window window;
    double y[{len(e.outputs)}];
    {declared}
    int k, place = 0;
    {value}_start(&window, {value}_default_parameters, given_u[0], given_y[0]);
    for (k = 0; k < {PUSHED + POINTS}; k++) {{
        if (k >= {PUSHED} && k % {EVERY} == 0) {{
            {value}_step_jacobian(&window, given_u[k], y_next, by_window, by_u, by_y, by_p);
            {compared}
            place++;
        }}
        if (k < {PUSHED}) {{
            {value}_push(&window, given_u[k], given_y[k]);
        }} else {{
            {value}_step(&window, given_u[k]);
        }}
        {value}_output(&window, y);
        compare(y, expected_outputs[k], {len(e.outputs)}, {float(np.max(np.abs(run.outputs)))!r});
    }}
    printf("{value}: {POINTS} samples, largest relative difference %.1e\\n", worst);
    return worst <= {TOLERANCE} ? 0 : 1;
}}
""",
        ]
    )


def _random(name: str, rng: np.random.Generator) -> Array:
    mean = SPEED if name == "v_x" else 0.0
    return mean + USUAL.get(name, 1.0) * rng.standard_normal(PUSHED + POINTS)


def _sensor(e: MemoryEquations, name: str) -> Array:
    return np.array(cs.Function("sensor", [e.p], [cs.vertcat(*e.sensor_weights(name))])(e.values)).ravel()


def _derivatives(
    e: MemoryEquations, derived: cs.Function, window: Array, y: Array, actuators: Array, u: Array
) -> list[Array]:
    """by_window, by_u, by_y, by_p of the next predictions, flattened column by column."""
    by_window, by_p = (np.array(item) for item in derived(window, e.values))
    now, a, command = (cs.SX.sym(name, size) for name, size in (("y", len(y)), ("a", len(actuators)), ("u", len(u))))
    sees = e.seen(now, a, command, e.p)[0]
    chain = cs.Function("chain", [now, a, command, e.p], [cs.jacobian(sees, now), cs.jacobian(sees, command)])
    by_y, by_u = (np.array(cs.densify(actuator)) for actuator in chain(y, actuators, u, e.values))
    newest = by_window[:, -len(e.model.inputs) :]
    return [item.ravel(order="F") for item in (by_window, newest @ by_u, newest @ by_y, by_p)]
