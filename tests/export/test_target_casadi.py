"""The exported CasADi module does what the model does, and needs nothing but CasADi."""

import subprocess
import sys

import casadi as cs
import numpy as np
import pytest
from exported import EFFECTS, MEMORY, MOTION, loaded, memory, motion, points, subject, values, write

from greybox_id.export.equations import Equations
from greybox_id.export.memory_equations import MemoryEquations, equations_of


@pytest.mark.parametrize(("name", "effects"), [*((name, ()) for name in MOTION), ("single_track on pacejka", EFFECTS)])
def test_functions_of_motion_are_the_models(name, effects, tmp_path):
    model = motion(name, effects)
    equations, module = Equations(model), loaded(write(model, "casadi", tmp_path / "out"))
    x, u = points(equations, 200)
    np.testing.assert_array_equal(
        values(module.step, x, u, module.P, [0.02]), values(equations.step, x, u, model.values, [0.02])
    )
    for function in ("ode", "output"):
        own, theirs = (values(getattr(of, function), x, u, model.values) for of in (module, equations))
        np.testing.assert_array_equal(own, theirs)
    np.testing.assert_array_equal(np.array(module.P).ravel(), model.values)
    np.testing.assert_array_equal(np.array(module.delays(module.P)), np.array(equations.delays(model.values)))
    assert (equations.delayed, equations.late) == (module.DELAYED, module.LATE)


@pytest.mark.parametrize("name", MEMORY)
def test_functions_of_a_map_with_memory_are_the_models(name, tmp_path):
    model = memory(name)
    equations, module = MemoryEquations(model), loaded(write(model, "casadi", tmp_path / "out"))
    x, u = points(equations, 50)
    np.testing.assert_array_equal(values(module.step, x, u, module.P), values(equations.step, x, u, model.values))
    np.testing.assert_array_equal(values(module.output, x, u, module.P), values(equations.output, x, u, model.values))
    assert model.sample_time == module.SAMPLE_TIME
    assert [parameter.unit for parameter in module.PARAMETERS] == [parameter.unit for parameter in equations.parameters]


def test_jacobians_are_derivatives(tmp_path):
    model = motion("single_track on pacejka", ("steering_lag", "tyre_relaxation"))
    module = loaded(write(model, "casadi", tmp_path / "out"))
    x, u = (
        np.array(module.state(v_x=20.0, v_y=0.3, yaw_rate=0.2, steering_lag_state=0.02, alpha_f=0.01, alpha_r=0.02)),
        np.array(module.inputs(steer=0.03)),
    )
    A, B = module.step_jacobians(x, u, module.P, 0.02)
    C, D = module.output_jacobians(x, u, module.P)
    A_t, B_t = module.ode_jacobians(x, u, module.P)

    def differences(of, at):
        steps = 1e-5 * np.eye(len(at))
        return np.hstack([(np.array(of(at + s[:, None])) - np.array(of(at - s[:, None]))) / 2e-5 for s in steps])

    close = {"rtol": 1e-5, "atol": 1e-5}
    np.testing.assert_allclose(A, differences(lambda at: module.step(at, u, module.P, 0.02), x), **close)
    np.testing.assert_allclose(B, differences(lambda at: module.step(x, at, module.P, 0.02), u), **close)
    np.testing.assert_allclose(C, differences(lambda at: module.output(at, u, module.P), x), **close)
    np.testing.assert_allclose(D, differences(lambda at: module.output(x, at, module.P), u), **close)
    np.testing.assert_allclose(A_t, differences(lambda at: module.ode(at, u, module.P), x), rtol=1e-4, atol=1e-2)
    np.testing.assert_allclose(B_t, differences(lambda at: module.ode(x, at, module.P), u), rtol=1e-4, atol=1e-2)


@pytest.mark.parametrize("kind", [cs.SX, cs.MX])
def test_symbols_go_by_name(kind, tmp_path):
    module = loaded(write(motion("single_track on linear"), "casadi", tmp_path / "out"))
    x, u, p = module.symbols(kind)
    slip = cs.Function("slip", [x.column, p.column], [cs.atan2(x.v_y, x["v_x"]) + 0 * p.m])
    assert float(slip(module.state(v_x=2.0, v_y=2.0), module.P)) == pytest.approx(np.pi / 4)
    assert module.ode(x.column, u.column, p.column).shape == (3, 1)
    with pytest.raises(AttributeError, match=r"no v_z; there are v_x, v_y, yaw_rate"):
        _ = x.v_z
    with pytest.raises(KeyError, match="no mass; there are m,"):
        module.parameters(mass=3.0)
    assert float(module.parameters(m=3.0)[module.p_index["m"]]) == 3.0
    assert float(module.P[module.p_index["m"]]) == 1450.0


def test_values_that_no_literal_writes_are_kept(tmp_path):
    model = memory("msnn_full_plus")
    model = model.with_parameters(model["steering_rate_limit"].with_value(np.inf))
    module = loaded(write(model, "casadi", tmp_path / "out"))
    assert np.isinf(float(module.P[module.p_index["steering_rate_limit"]]))


FEW = {"single_track on pacejka": ("I_z", "B_f"), "msnn_full_plus": ("kappa_1", "steering_rate_limit"), "kinematic": ()}


@pytest.mark.parametrize("name", FEW)
def test_parameters_that_are_to_stay_are_constants(name, tmp_path):
    model = memory(name) if name in MEMORY else motion(name)
    module = loaded(write(model, "casadi", tmp_path / "out", moving=FEW[name]))
    whole = equations_of(subject(model))
    x, u = points(whole, 20)
    dt = [] if name in MEMORY else [[0.02]]
    assert {parameter.name.partition("[")[0] for parameter in module.PARAMETERS} == set(FEW[name])
    p, names = np.array(module.P).ravel() * 1.1, [parameter.name for parameter in whole.parameters]
    moved = [p[module.p_index[n]] if n in module.p_index else v for n, v in zip(names, model.values, strict=True)]
    expected = values(whole.step, x, u, moved, *dt)
    np.testing.assert_allclose(values(module.step, x, u, p, *dt), expected, rtol=1e-11, atol=1e-13)


def test_the_folder_needs_nothing_but_casadi(tmp_path):
    folder = write(motion("kinematic"), "casadi", tmp_path / "out")
    program = "import sys, car; car.step(car.state(), car.inputs(), car.P, 0.01); print('greybox_id' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=folder,
        env={"PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "False\n"
