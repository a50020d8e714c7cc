"""Exported C beside CasADi's virtual machine: what one step costs, and with derivatives.

    python benchmarks/exported.py [--compiler clang]

Each figure is the fastest of many short stretches, in one run. States and inputs differ from step to step. The virtual
machine loops over them by itself, without Python in between.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
import time
from pathlib import Path

import casadi as cs
import numpy as np
from running import options, tell

from greybox_id.export.memory_equations import equations_of
from greybox_id.export.subject import Subject
from greybox_id.export.verb import export
from greybox_id.models.registry import build

TIMER = r"""
#include <stdio.h>
#include <time.h>
#define TIMED(name, work) do { \
    double best = 1e300; int r, k; for (r = 0; r < 3000; r++) { struct timespec a, b; double t; \
    clock_gettime(CLOCK_MONOTONIC, &a); for (k = 0; k < 100; k++) { work; } clock_gettime(CLOCK_MONOTONIC, &b); \
    t = (1e9 * (double)(b.tv_sec - a.tv_sec) + (double)(b.tv_nsec - a.tv_nsec)) / 100; if (t < best) best = t; } \
    printf("%s %.1f\n", name, best); } while (0)
"""


def motion_program() -> str:
    return f"""#define _POSIX_C_SOURCE 200112L
#include "car.h"
{TIMER}
int main(void)
{{
    double x[128][CAR_NX], u[128][CAR_NU], next[CAR_NX], A[CAR_NX * CAR_NX], B[CAR_NX * CAR_NU], sum = 0.0;
    int i;
    for (i = 0; i < 128; i++) {{
        x[i][0] = 8.0 + 0.1 * i; x[i][1] = 0.01 * (i % 40) - 0.2; x[i][2] = 0.02 * (i % 30) - 0.3;
        u[i][0] = 0.002 * (i % 50) - 0.05; u[i][1] = 0.02 * (i % 20);
    }}
    TIMED("step", car_step(x[k], u[k], car_default_parameters, 0.02, next); sum += next[0]);
    TIMED("jacobian", car_step_jacobian(x[k], u[k], car_default_parameters, 0.02, next, A, B); sum += A[0]);
    next[0] = 10.0; next[1] = next[2] = 0.0;
    TIMED("chained", car_step(next, u[k], car_default_parameters, 0.02, next));
    return sum == 12345.0;
}}
"""


def memory_program() -> str:
    return f"""#define _POSIX_C_SOURCE 200112L
#include "net.h"
{TIMER}
int main(void)
{{
    static net_window window;
    double u[128][NET_NU], y[NET_NY] = {{0.0}};
    int i, j;
    for (i = 0; i < 128; i++) for (j = 0; j < NET_NU; j++) u[i][j] = j == 0 ? 2.0 + 0.001 * i : 0.01 * (i % 20);
    net_start(&window, net_default_parameters, u[0], y);
    TIMED("step", net_step(&window, u[k]));
    return 0;
}}
"""


def measured(program: str, folder: Path, name: str, compiler: str) -> dict[str, float]:
    """What a program prints: word and nanoseconds."""
    (folder / "timed.c").write_text(program)
    sources = [str(folder / file) for file in ("timed.c", f"{name}.c")]
    command = [compiler, "-std=c99", "-O2", *sources, "-I", str(folder), "-lm", "-o", str(folder / "timed")]
    subprocess.run(command, check=True)
    said = subprocess.run([str(folder / "timed")], check=True, capture_output=True, text=True).stdout
    return {word: float(number) for word, number in re.findall(r"(\w+) ([\d.]+)", said)}


def virtual_machine(function: cs.Function, arguments: list[np.ndarray], repeats: int) -> float:
    """Nanoseconds of one evaluation in CasADi's virtual machine, which loops over the arguments' columns itself."""
    columns = arguments[0].shape[1]
    buffer, run = function.map(columns, "serial").buffer()
    held = [np.asfortranarray(own, dtype=float) for own in arguments]
    results = [np.empty(columns * function.numel_out(k)) for k in range(function.n_out())]
    for k, own in enumerate(held):
        buffer.set_arg(k, own.T.reshape(-1).data)
    for k, own in enumerate(results):
        buffer.set_res(k, own.data)
    times = []
    for _ in range(repeats):
        begun = time.perf_counter_ns()
        run()
        times.append(time.perf_counter_ns() - begun)
    return min(times) / columns


def motion(compiler: str, moving: tuple[str, ...] | None) -> dict[str, dict[str, float]]:
    """A single track on Pacejka tyres, four times through its equations."""
    subject = Subject(build("single_track"), "car", moving)
    e = subject.equations
    rng = np.random.default_rng(0)
    x = np.vstack([rng.uniform(8, 20, 100), rng.uniform(-0.2, 0.2, 100), rng.uniform(-0.3, 0.3, 100)])
    u = np.vstack([rng.uniform(-0.05, 0.05, 100), rng.uniform(0, 0.4, 100)])
    given = [x, u, np.tile(e.values[:, None], 100), np.full((1, 100), 0.02)]
    symbols = [e.x, e.u, e.p, e.dt]
    following = e.step(*symbols)
    slopes = [cs.densify(cs.jacobian(following, own)) for own in (e.x, e.u)]
    both = cs.Function("both", symbols, [following, *slopes], {"cse": True})
    with tempfile.TemporaryDirectory() as folder:
        export(subject, "c", Path(folder, "car"))
        c = measured(motion_program(), Path(folder, "car"), "car", compiler)
    vm = {"step": virtual_machine(e.step, given, 300), "jacobian": virtual_machine(both, given, 300)}
    return {name: {"c": c[name], "casadi": vm[name], "ratio": vm[name] / c[name]} for name in vm} | {
        "step of the step before": {"c": c["chained"]}
    }


def network(compiler: str) -> dict[str, dict[str, float]]:
    """MS-NN-full of the authors' size: a sample in closed loop."""
    subject = Subject(build("msnn_full"), "net", ())
    e = equations_of(subject)
    rng = np.random.default_rng(0)
    x, u = 0.1 * rng.standard_normal((len(e.states), 20)), 0.1 * rng.standard_normal((len(e.inputs), 20))
    with tempfile.TemporaryDirectory() as folder:
        export(subject, "c", Path(folder, "net"))
        c = measured(memory_program(), Path(folder, "net"), "net", compiler)
    vm = virtual_machine(e.step, [x, u, np.empty((0, 20))], 100)
    return {"step": {"c": c["step"], "casadi": vm, "ratio": vm / c["step"]}}


def main() -> None:
    given = options(__doc__, compiler="gcc")
    model = build("single_track")
    free = tuple(parameter.name for parameter in model.parameters if not parameter.fixed)
    found = {
        "single_track, free parameters": motion(given.compiler, free),
        "single_track, all parameters": motion(given.compiler, None),
        "MS-NN-full": network(given.compiler),
    }
    rows = [{"what": f"{name}: {what}", **row} for name, steps in found.items() for what, row in steps.items()]
    tell(found if given.json else {"ns": rows}, given.json)


if __name__ == "__main__":
    main()
