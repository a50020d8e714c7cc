"""A C program that compares an export with numbers computed in Python."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as cs
import numpy as np

from ...parameter import Array
from ..points import points
from .comparing import COMPARE, POINTS, TOLERANCE, table
from .functions import CFunction
from .motion import MotionC

MOST = 20_000
"""Numbers of one result that are written down at most; of larger ones fewer points are."""


def self_test(written: MotionC) -> str:
    """The program's text. It returns 0 if all went well."""
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
    calls = "\n".join(f"    test_{name}();" for name in [*(own.name for own in written.functions), "sensitivities"])
    return (
        "\n".join(head + tests)
        + f"""
int main(void)
{{
{calls}
    printf("{written.name}: {POINTS} points, largest relative difference %.1e\\n", worst);
    return worst <= {TOLERANCE} ? 0 : 1;
}}
"""
    )


def expected(function: CFunction, given: Mapping[str, Array]) -> list[Array]:
    """What CasADi's virtual machine says of a function's results at all points, (points, entries) each."""
    of: cs.Function = function.function
    arguments = [np.atleast_2d(given[own.name].reshape(len(given["dt"]), -1).T) for own in function.arguments]
    values = of.map(len(given["dt"])).call([cs.DM(argument) for argument in arguments])
    return [np.asarray(value).reshape(-1, len(given["dt"]), order="F").T for value in values]


def _test(function: CFunction, given: Mapping[str, Array]) -> str:
    values = expected(function, given)
    rows = min(POINTS, max(1, MOST // max(1, max(value.shape[1] for value in values))))
    lines, declared = [], []
    for own, value in zip(function.results, values, strict=True):
        lines.append(table(f"{function.name}_{own.name}", value[:rows]))
        declared.append(f"double {own.name}[{value.shape[1]}];")
    arguments = [f"given_{own.name}[k]" if own.size else f"given_{own.name}[k][0]" for own in function.arguments]
    call = ", ".join([*arguments, *(own.name for own in function.results)]).replace(
        "given_p[k]", "given_p[k]" if given["p"].size else "given_p[0]"
    )
    compared = [
        f"compare({own.name}, {function.name}_{own.name}[k], {value.shape[1]}, {largest!r});"
        for own, value in zip(function.results, values, strict=True)
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
    """A test of the forward sensitivities, at sensitivities of which each entry is another number."""
    own, e = written.name, written.equations
    jacobian = next(function for function in written.functions if function.name == f"{own}_ode_jacobian")
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
        {own}_vde_forw(given_x[k], given_S_x[0], given_S_u[0], given_u[k], {p}, x_dot, S_x_dot, S_u_dot);
        {" ".join(compared)}
    }}
}}
"""
    )
