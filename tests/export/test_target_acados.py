"""The exported module fills an AcadosModel. acados is not on the package index: a stand-in has the attributes that its
documentation names, and no others."""

import sys
from types import ModuleType

import casadi as cs
import numpy as np
import pytest
from exported import EFFECTS, memory, motion, points, values, write

from greybox_id.export.equations import Equations
from greybox_id.export.memory_equations import MemoryEquations

LISTS = {"z": [], "p": [], "t": []}
NOTHING = ("name", "x", "u", "xdot", "f_impl_expr", "f_expl_expr", "disc_dyn_expr", "x_labels", "u_labels", "t_label")


class AcadosModel:
    def __init__(self):
        vars(self).update(dict.fromkeys(NOTHING) | LISTS)

    def __setattr__(self, name, value):
        assert name in vars(self), f"AcadosModel has no {name}"
        super().__setattr__(name, value)


@pytest.fixture
def acados(monkeypatch, tmp_path):
    """Export a model, and import the module it makes."""
    stand_in = ModuleType("acados_template")
    stand_in.AcadosModel = AcadosModel
    monkeypatch.setitem(sys.modules, "acados_template", stand_in)

    def of(model):
        monkeypatch.syspath_prepend(write(model, "acados", tmp_path / "out"))
        for name in ("car", "car_acados"):
            monkeypatch.delitem(sys.modules, name, raising=False)
        import car_acados

        return car_acados

    yield of
    for name in ("car", "car_acados"):
        sys.modules.pop(name, None)


def of_model(made, expression, *more):
    """An expression of a model's symbols as a function of x, u, and p where there is one."""
    arguments = [made.x, made.u, *([made.p] if isinstance(made.p, cs.SX) else []), *more]
    return cs.Function("f", arguments, [expression])


@pytest.mark.parametrize("effects", [(), EFFECTS], ids=["bare", "with effects"])
def test_expressions_are_the_models_functions(effects, acados):
    model = motion("single_track on pacejka", effects)
    module, equations = acados(model), Equations(model)
    x, u = points(equations, 100)
    made, p = module.model(dt=0.02), module.parameter_values()
    rates = values(equations.ode, x, u, model.values)
    np.testing.assert_array_equal(values(of_model(made, made.f_expl_expr), x, u, p), rates)
    implicit = of_model(made, made.f_impl_expr, made.xdot)
    np.testing.assert_array_equal(values(implicit, x, u, p, rates), 0 * rates)
    assert cs.jacobian(made.f_impl_expr, made.xdot).is_eye()
    discrete = of_model(made, made.disc_dyn_expr)
    np.testing.assert_array_equal(values(discrete, x, u, p), values(equations.step, x, u, model.values, [0.02]))
    y = cs.vertcat(*module.outputs(made).values())
    np.testing.assert_array_equal(values(of_model(made, y), x, u, p), values(equations.output, x, u, model.values))


def test_parameters_may_be_numbers(acados):
    model = motion("lateral on brush")
    module, equations = acados(model), Equations(model)
    x, u = points(equations, 20)
    made = module.model(dt=0.01, fixed=True)
    assert made.p == []
    expected = values(equations.step, x, u, model.values, [0.01])
    np.testing.assert_allclose(values(of_model(made, made.disc_dyn_expr), x, u), expected, rtol=1e-12)
    assert list(module.outputs(made)) == list(model.outputs)


def test_names_and_units_are_labels(acados):
    made = acados(motion("kinematic", ("steering_lag",))).model()
    assert made.name == "car"
    assert made.x_labels == ["yaw_rate [rad/s]", "steering_lag_state [rad]"]
    assert made.u_labels == ["steer [rad]", "v_x [m/s]"]
    assert made.t_label == "t [s]"
    assert made.disc_dyn_expr is None


@pytest.mark.parametrize("fixed", [False, True])
def test_a_map_with_memory_has_discrete_dynamics(fixed, acados):
    model = memory("msnn_full_plus")
    module, equations = acados(model), MemoryEquations(model)
    x, u = points(equations, 20)
    made = module.model(fixed)
    given = [] if fixed else [module.parameter_values()]
    found = values(of_model(made, made.disc_dyn_expr), x, u, *given)
    np.testing.assert_allclose(found, values(equations.step, x, u, model.values), rtol=1e-12, atol=1e-14)
    assert made.f_expl_expr is None
