"""A C program that compares a map with memory with numbers computed in Python."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as cs
import numpy as np

from ...parameter import Array
from ..memory_equations import MemoryEquations
from .comparing import COMPARE, POINTS, TOLERANCE, table
from .memory import MemoryC

PUSHED = 5
"""Samples with readings before the map runs alone."""
EVERY = 20
"""Samples between those at which derivatives are compared."""
USUAL = {"v_x": 0.5, "steer": 0.1, "a_x": 1.0, "a_y": 2.0, "yaw_rate": 0.5, "motor_current": 5.0, "road_slope": 0.02}
"""Standard deviations of inputs and readings, SI; others have one."""
SPEED = 2.5
"""Mean of the speed, m/s."""


@dataclass(frozen=True)
class CheckedCourse:
    """What is handed in and what comes of it.

    Attributes
    ----------
    u, y : (samples, ...) inputs and readings handed in.
    outputs : (samples, NY) what sensors read after each sample.
    derivatives : sample -> y_next, by_window, by_u, by_y, by_p, flat, before the next sample.
    """

    u: Array
    y: Array
    outputs: Array
    derivatives: dict[int, list[Array]]


def course(e: MemoryEquations) -> CheckedCourse:
    """A window of steady driving, a few samples with readings, then `POINTS` on own predictions."""
    rng = np.random.default_rng(0)
    u, y = (np.column_stack([_random(own.name, rng) for own in entries]) for entries in (e.inputs, e.outputs))
    handed_in = [own.name for own in e.inputs]
    actuators = np.array([u[0, handed_in.index(own.signal)] for own in e.model.actuators])
    predicted = {name: [y[0, k]] * count for k, (name, count) in enumerate(e.held.items())}
    seen = [np.array(e.seen(y[0], actuators, u[0], e.values)[0]).ravel()] * e.trace.memory
    U, value = e.trace.step
    predict = cs.Function("predict", [U, e.trace.p], [value])
    at = predict(U, e.all_of_p)
    derived = cs.Function("derived", [U, e.p], [cs.jacobian(at, cs.vec(U)), cs.jacobian(at, e.p)])
    outputs, derivatives = [], {}
    for k in range(PUSHED + POINTS):
        newest = np.array([predicted[name][0] for name in e.model.outputs])
        sees, moved = (np.array(own).ravel() for own in e.seen(newest, actuators, u[k], e.values))
        window = np.column_stack([*seen[1:], sees])
        following = np.array(predict(window, _whole(e))).ravel()
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
    """The program's text. It returns 0 if all went well."""
    own, e = written.name, written.equations
    run = course(e)
    results = ("y_next", "by_window", "by_u", "by_y", "by_p")
    places = sorted(run.derivatives)
    found = {name: np.array([run.derivatives[k][i] for k in places]) for i, name in enumerate(results)}
    tables = [table("given_u", run.u), table("given_y", run.y), table("expected_outputs", run.outputs)]
    tables += [table(f"expected_{name}", values) for name, values in found.items() if values.size]
    declared = "\n    ".join(f"static double {name}[{values.shape[1] or 1}];" for name, values in found.items())
    compared = "\n            ".join(
        f"compare({name}, expected_{name}[place], {values.shape[1]}, {float(np.max(np.abs(values)))!r});"
        for name, values in found.items()
        if values.size
    )
    return "\n".join(
        [
            f"/* {written.title}",
            "   Compares the functions with what Python computed along a course of random inputs. */",
            f'\n#include "{own}.h"\n\n#include <math.h>\n#include <stdio.h>\n',
            *tables,
            COMPARE,
            f"""\
int main(void)
{{
    static {own}_window window;
    double y[{len(e.outputs)}];
    {declared}
    int k, place = 0;
    {own}_start(&window, {own}_default_parameters, given_u[0], given_y[0]);
    for (k = 0; k < {PUSHED + POINTS}; k++) {{
        if (k >= {PUSHED} && k % {EVERY} == 0) {{
            {own}_step_jacobian(&window, given_u[k], y_next, by_window, by_u, by_y, by_p);
            {compared}
            place++;
        }}
        if (k < {PUSHED}) {{
            {own}_push(&window, given_u[k], given_y[k]);
        }} else {{
            {own}_step(&window, given_u[k]);
        }}
        {own}_output(&window, y);
        compare(y, expected_outputs[k], {len(e.outputs)}, {float(np.max(np.abs(run.outputs)))!r});
    }}
    printf("{own}: {POINTS} samples, largest relative difference %.1e\\n", worst);
    return worst <= {TOLERANCE} ? 0 : 1;
}}
""",
        ]
    )


def _random(name: str, rng: np.random.Generator) -> Array:
    mean = SPEED if name == "v_x" else 0.0
    return mean + USUAL.get(name, 1.0) * rng.standard_normal(PUSHED + POINTS)


def _whole(e: MemoryEquations) -> Array:
    return np.array(cs.Function("whole", [e.p], [e.all_of_p])(e.values)).ravel()


def _sensor(e: MemoryEquations, name: str) -> Array:
    return np.array(cs.Function("sensor", [e.p], [cs.vertcat(*e.sensor_weights(name))])(e.values)).ravel()


def _derivatives(
    e: MemoryEquations, derived: cs.Function, window: Array, y: Array, actuators: Array, u: Array
) -> list[Array]:
    """by_window, by_u, by_y, by_p of the next predictions, flat, column after column."""
    by_window, by_p = (np.array(own) for own in derived(window, e.values))
    now, a, command = (cs.SX.sym(name, size) for name, size in (("y", len(y)), ("a", len(actuators)), ("u", len(u))))
    sees = e.seen(now, a, command, e.p)[0]
    chain = cs.Function("chain", [now, a, command, e.p], [cs.jacobian(sees, now), cs.jacobian(sees, command)])
    by_y, by_u = (np.array(cs.densify(own)) for own in chain(y, actuators, u, e.values))
    newest = by_window[:, -len(e.model.inputs) :]
    return [own.ravel(order="F") for own in (by_window, newest @ by_u, newest @ by_y, by_p)]
