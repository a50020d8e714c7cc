"""Exported C: it compiles under strict flags, says what Python says, takes no heap and as much stack as it states."""

import re
import subprocess

import casadi as cs
import numpy as np
import pytest
from compiled import COMPILERS, Library, compiled, needed, run
from exported import EFFECTS, MEMORY, MOTION, memory, motion, points, values, write

from greybox_id.export.equations import Equations
from greybox_id.models.registry import build

SANITIZED = ("-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
DELAYED = {"steering_delay": 0.037, "steering_lag": 0.02}


def close(found, true, tolerance=1e-12, spared=0.0, rarely=1e-3):
    """Entries relative to themselves and to a thousandth of the largest of their column.

    Where a change of the arguments' last digits changes the truth by `spared`, as in long steps of a car that hardly
    moves, whose equations are too stiff for them, a hundred such digits are allowed, in one of a thousand points.
    """
    scale = np.abs(true) + 1e-3 * np.max(np.abs(true), axis=0) + 1e-300
    off = np.abs(found - true) / scale
    assert np.all((off <= tolerance) | (np.abs(found - true) <= 100 * spared))
    assert np.mean(np.any(off > tolerance, axis=1)) <= rarely


def self_tested(folder, target, *flags, compiler="gcc", name="car"):
    compiled([folder / f"{name}.c", folder / f"{name}_test.c"], folder / target, *flags, compiler=compiler)
    return run(folder / target)


@pytest.mark.parametrize("name", MOTION)
def test_every_model_and_tyre_passes_its_self_test(tmp_path, name):
    folder = write(motion(name), "c", tmp_path / "car")
    assert "100 points" in self_tested(folder, "test")


@pytest.mark.parametrize("wrong", ["NAN", "INFINITY", "1.0 + 1e-9"])
def test_the_self_test_fails_where_a_result_is_wrong(tmp_path, wrong):
    folder = write(motion("kinematic"), "c", tmp_path / "car")
    text = (folder / "car.c").read_text()
    spoilt, count = re.subn(
        r"(void car_step\(.*?)x_next\[0\] = ([^;]+);", rf"\1x_next[0] = (\2) * ({wrong});", text, count=1, flags=re.S
    )
    assert count == 1
    (folder / "car.c").write_text(spoilt)
    program = compiled([folder / "car.c", folder / "car_test.c"], folder / "test")
    assert subprocess.run([program], check=False, capture_output=True).returncode == 1


@pytest.mark.parametrize("name", MEMORY)
def test_maps_with_memory_pass_their_self_test(tmp_path, name):
    folder = write(memory(name), "c", tmp_path / "net", "net")
    assert "100 samples" in self_tested(folder, "test", name="net")


def test_actuators_and_late_sensors_of_a_map_pass_its_self_test(tmp_path):
    model = build("msnn_full_plus", {"timing_offset": True})
    folder = write(model, "c", tmp_path / "net", "net")
    assert "100 samples" in self_tested(folder, "test", name="net")


@pytest.mark.slow
@pytest.mark.parametrize("effect", EFFECTS)
def test_effects_pass_their_self_test(tmp_path, effect):
    folder = write(motion("single_track on pacejka", [effect]), "c", tmp_path / "car")
    self_tested(folder, "test")


def equal_at_random_points(model, folder, count, seed):
    """Values and derivatives of step, ode and output, at any parameters."""
    library, e = Library(folder), Equations(model)
    x, u = points(e, count, seed)
    rng = np.random.default_rng(seed)
    p = e.values * np.exp(0.1 * rng.standard_normal((count, len(e.values))))
    dt = rng.uniform(1e-3, 0.05, count)
    n, m, r = len(e.states), len(e.inputs), len(e.outputs)
    for name, of, rows in (("step", e.step, n), ("ode", e.ode, n), ("output", e.output, r)):
        symbols = of.sx_in()
        given = (x, u, p, dt) if len(symbols) == 4 else (x, u, p)
        at = of(*symbols)
        slopes = [cs.vec(cs.densify(cs.jacobian(at, symbol))) for symbol in symbols[:2]]
        whole = cs.Function("all", symbols, [cs.vertcat(at, *slopes)])
        columns = [own[:, None] if own.ndim == 1 else own for own in given]
        true = values(whole, *columns)
        last_digits = [1 + np.finfo(float).eps * rng.choice([-1, 0, 1], column.shape) for column in columns]
        magnified = np.abs(values(whole, *map(np.multiply, columns, last_digits)) - true)
        found = library(f"{name}_jacobian", given, (rows, rows * n, rows * m))
        close(np.hstack(found), true, spared=magnified)
        close(library(name, given, (rows,))[0], true[:, :rows], spared=magnified[:, :rows])


def test_values_and_derivatives_are_pythons_at_random_points(tmp_path):
    model = motion("single_track on pacejka")
    equal_at_random_points(model, write(model, "c", tmp_path / "car"), 2_000, 1)


@pytest.mark.slow
@pytest.mark.parametrize("name", MOTION)
def test_values_and_derivatives_are_pythons_at_a_hundred_thousand_points(tmp_path, name):
    model = motion(name)
    equal_at_random_points(model, write(model, "c", tmp_path / "car"), 100_000, 2)


def test_parameters_that_do_not_move_are_constants_of_the_code(tmp_path):
    model = motion("single_track on pacejka")
    moving = tuple(p.name for p in model.parameters if not p.fixed)
    folder = write(model, "c", tmp_path / "car", moving=moving)
    self_tested(folder, "test")
    assert f"#define CAR_NP {len(moving)}\n" in (folder / "car.h").read_text()
    none = write(model, "c", tmp_path / "held", moving=())
    self_tested(none, "test")


def test_derivatives_by_parameters_are_those_of_differences(tmp_path):
    model = motion("single_track on pacejka")
    library, e = Library(write(model, "c", tmp_path / "car")), Equations(model)
    x, u, dt = np.array([[15.0, 0.2, 0.3]]), np.array([[0.05, 1.0]]), np.array([0.02])
    (by_p,) = library("step_by_p", (x, u, e.values[None], dt), (3 * len(e.values),))
    for k, value in enumerate(e.values):
        h = 1e-5 * max(abs(value), 1e-2)
        ahead, behind = (
            library("step", (x, u, e.values[None] + sign * h * np.eye(len(e.values))[k], dt), (3,))[0]
            for sign in (1, -1)
        )
        np.testing.assert_allclose(by_p.reshape(-1, 3)[k], ((ahead - behind) / (2 * h))[0], rtol=1e-5, atol=1e-8)


def test_a_step_may_write_over_its_state(tmp_path):
    model = motion("single_track on linear")
    library, e = Library(write(model, "c", tmp_path / "car")), Equations(model)
    x, u, dt = np.array([[15.0, 0.2, 0.3]]), np.array([[0.05, 1.0]]), np.array([0.02])
    (apart,) = library("step", (x, u, e.values[None], dt), (3,))
    place = [own.ctypes.data_as(np.ctypeslib.ctypes.c_void_p) for own in (x, u, e.values)]
    library.library.car_step(*place, np.ctypeslib.ctypes.c_double(0.02), place[0])
    np.testing.assert_array_equal(x, apart)


def test_late_commands_act_when_they_should(tmp_path):
    """Against steps cut by hand where the steering arrives, 3.7 samples late."""
    model = build("single_track", effects=DELAYED)
    folder, e = write(model, "c", tmp_path / "car"), Equations(model)
    steer = 0.05 * np.sin(np.arange(40))
    program = f"""
#include "car.h"
#include <stdio.h>
int main(void)
{{
    static const double steer[] = {{{", ".join(map(repr, steer.tolist()))}}};
    car_commands line;
    double x[CAR_NX] = {{10.0}}, u[CAR_NU] = {{0.0, 1.0}};
    int k, i;
    car_commands_start(&line, u);
    for (k = 0; k < 40; k++) {{
        u[CAR_U_STEER] = steer[k];
        if (car_commands_push(&line, k * 0.01, u) || car_commands_push(&line, k * 0.01, u) != -1) return 1;
        if (car_step_late(&line, x, car_default_parameters, k * 0.01, 0.01, x)) return 2;
        for (i = 0; i < CAR_NX; i++) printf("%.17g ", x[i]);
        printf("\\n");
    }}
    return 0;
}}
"""
    (tmp_path / "late.c").write_text(program)
    compiled([tmp_path / "late.c", folder / "car.c"], tmp_path / "late", f"-I{folder}")
    found = np.array([line.split() for line in run(tmp_path / "late").splitlines()], dtype=float)
    x, true = np.array([10.0, *[0.0] * (len(e.states) - 1)]), []
    for k in range(40):
        for behind, h in ((4, 0.007), (3, 0.003)):
            acting = [steer[k - behind] if k >= behind else 0.0, 1.0]
            x = np.array(e.step(x, acting, e.values, h)).ravel()
        true.append(x)
    np.testing.assert_allclose(found, true, rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("name", ["car", "net"])
def test_there_is_no_heap_and_the_stack_is_as_stated(tmp_path, name):
    model = build("single_track", effects=DELAYED) if name == "car" else memory("msnn_full")
    folder = write(model, "c", tmp_path / name, name)
    run(needed("gcc"), "-std=c99", "-O2", "-fstack-usage", "-c", f"{name}.c", cwd=folder)
    called = set(re.findall(r" U (\w+)", run(needed("nm"), f"{name}.o", cwd=folder)))
    allowed = {"sin", "cos", "sincos", "atan", "atan2", "tanh", "exp", "expm1", "sqrt", "tan", "pow", "fmod", "floor"}
    assert called <= allowed | {"memcpy", "memmove", "memset", "__stack_chk_fail"}
    used = [int(line.split("\t")[1]) for line in (folder / f"{name}.su").read_text().splitlines()]
    stated = int(re.search(r"Stack: at most (\d+) bytes", (folder / f"{name}.h").read_text())[1])
    assert max(used) < stated
    assert sum(sorted(used)[-3:]) < 2 * stated  # a call within a call


@pytest.mark.slow
@pytest.mark.parametrize("name", ["car", "net"])
def test_sanitizers_and_checkers_find_nothing(tmp_path, name):
    model = build("single_track", effects=DELAYED) if name == "car" else memory("msnn_full")
    folder = write(model, "c", tmp_path / name, name)
    self_tested(folder, "sanitized", *SANITIZED, name=name)
    compiled([folder / f"{name}.c", folder / "main.c"], folder / "example", *SANITIZED)
    assert len(run(folder / "example").splitlines()) > 50


@pytest.mark.slow
def test_cppcheck_finds_nothing(tmp_path):
    folder = write(motion("lateral on linear"), "c", tmp_path / "car")
    net = write(memory("msnn_lat"), "c", tmp_path / "net", "net")
    for own, name in ((folder, "car"), (net, "net")):
        files = [own / f"{name}.c", own / "main.c", own / f"{name}_test.c"]
        flags = ("-q", "--enable=all", "--suppress=missingIncludeSystem", "--error-exitcode=1")
        run(needed("cppcheck"), *flags, *files)


@pytest.mark.slow
@pytest.mark.parametrize("compiler", COMPILERS)
def test_both_compilers_take_it_without_a_warning(tmp_path, compiler):
    folder = write(build("single_track", effects=DELAYED), "c", tmp_path / "car")
    self_tested(folder, "test", compiler=compiler)
    net = write(memory("msnn_full"), "c", tmp_path / "net", "net")
    self_tested(net, "test", compiler=compiler, name="net")
    compiled([net / "net.c", net / "main.c"], net / "example", compiler=compiler)


@pytest.mark.slow
def test_cmake_builds_and_tests_it(tmp_path):
    folder = write(motion("kinematic"), "c", tmp_path / "car")
    build_folder = tmp_path / "build"
    run(needed("cmake"), "-S", folder, "-B", build_folder)
    run("cmake", "--build", build_folder)
    run("ctest", "--test-dir", build_folder)


@pytest.mark.parametrize(
    "flags", [("-ffast-math",), ("-Ofast",), ("-O2", "-ffinite-math-only"), ("-O3", "-ffast-math")]
)
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("model", [motion("single_track on pacejka"), memory("msnn_lat")], ids=["motion", "memory"])
def test_flags_that_change_the_numbers_end_the_compilation(model, compiler, flags, tmp_path):
    folder = write(model, "c", tmp_path / "car")
    command = [needed(compiler), "-std=c99", *flags, "-c", folder / "car.c", "-o", tmp_path / "car.o"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "#error" in done.stderr or "order of sums" in done.stderr or "NaN must be kept" in done.stderr
