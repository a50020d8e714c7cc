"""A C program that shows how an export is used."""

from __future__ import annotations

from .memory import MemoryC
from .motion import MotionC
from .naming import constant, number


def example(written: MotionC) -> str:
    """`main.c`: five seconds of a step steer, or of whatever inputs there are, printed as CSV."""
    value, e = written.name, written.equations
    n, m, r = (constant(value, f"N{letter}") for letter in "XUY")
    starts = [10.0 if state.name == "v_x" else 0.0 for state in e.states]
    steers = [k for k, i in enumerate(e.inputs) if i.name == "steer"]
    speeds = [k for k, i in enumerate(e.inputs) if i.name == "v_x"]
    first = [10.0 if k in speeds else 0.0 for k in range(len(e.inputs))]
    turned = f"    u[{constant(value, 'U', 'steer')}] = k < 50 ? 0.0 : 0.05; /* rad */\n" if steers else ""
    if e.delayed:
        before = f"    {value}_commands line;\n"
        begin = f"    {value}_commands_start(&line, u);\n"
        step = (
            f"        if ({value}_commands_push(&line, k * dt, u) != 0\n"
            f"            || {value}_step_late(&line, x, {value}_default_parameters, k * dt, dt, x) != 0) {{\n"
            "            return 1;\n        }\n"
        )
    else:
        before = begin = ""
        step = f"        {value}_step(x, u, {value}_default_parameters, dt, x);\n"
    return f"""\
/* {written.title}
   Five seconds at 100 Hz{" with a step of the steering" if steers else ""}, as CSV. */

#include "{value}.h"

#include <stdio.h>

int main(void)
{{
    const double dt = 0.01; /* s */
    double x[{n}] = {{{", ".join(map(number, starts))}}};
    double u[{m}] = {{{", ".join(map(number, first))}}};
    double y[{r}];
    int i, k;
{before}{begin}    printf("time");
    for (i = 0; i < {r}; i++) {{
        printf(",%s", {value}_output_names[i]);
    }}
    printf("\\n");
    for (k = 0; k < 500; k++) {{
{turned.replace("    u", "        u")}        {value}_output(x, u, {value}_default_parameters, y);
        printf("%.2f", k * dt);
        for (i = 0; i < {r}; i++) {{
            printf(",%.6g", y[i]);
        }}
        printf("\\n");
{step}    }}
    return 0;
}}
"""


def memory_example(written: MemoryC) -> str:
    """`main.c`: five seconds of steady inputs with a step of the steering, on the map's own predictions, as CSV."""
    value, e = written.name, written.equations
    m, r, time = (constant(value, word) for word in ("NU", "NY", "SAMPLE_TIME"))
    first = [2.0 if i.name == "v_x" else 0.0 for i in e.inputs]
    steers = any(i.name == "steer" for i in e.inputs)
    turned = f"        u[{constant(value, 'U', 'steer')}] = k < 20 ? 0.0 : 0.1; /* rad */\n" if steers else ""
    return f"""\
/* {written.title}
   Five seconds{" with a step of the steering" if steers else ""}, as CSV. */

#include "{value}.h"

#include <stdio.h>

int main(void)
{{
    static {value}_window window;
    double u[{m}] = {{{", ".join(map(number, first))}}};
    double y[{r}] = {{0.0}};
    int i, k;
    {value}_start(&window, {value}_default_parameters, u, y);
    printf("time");
    for (i = 0; i < {r}; i++) {{
        printf(",%s", {value}_output_names[i]);
    }}
    printf("\\n");
    for (k = 0; k * {time} < 5.0; k++) {{
{turned}        {value}_output(&window, y);
        printf("%.2f", k * {time});
        for (i = 0; i < {r}; i++) {{
            printf(",%.6g", y[i]);
        }}
        printf("\\n");
        {value}_step(&window, u);
    }}
    return 0;
}}
"""
