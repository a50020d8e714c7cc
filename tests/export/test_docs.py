"""What docs/export.md shows runs."""

import importlib.util
import re
import sys
from types import ModuleType

import numpy as np
import pytest
from documents import indented, page

from greybox_id.export.equations import Equations
from greybox_id.export.subject import Subject
from greybox_id.export.verb import export
from greybox_id.models.parameter import Stated
from greybox_id.models.registry import build
from greybox_id.models.vehicle import Vehicle

SMALL = Vehicle("small car", {name: Stated(value) for name, value in {
    "m": 3.5, "I_z": 0.05, "l_f": 0.16, "l_r": 0.17, "h_cg": 0.07, "force_per_unit": 3.5, "c_0": 1.5, "c_2": 0.4,
}.items()})  # fmt: skip


def example(of, target, tmp_path, monkeypatch, needs=None):
    """Run the example that imports `of` beside an export called car; its names."""
    if importlib.util.find_spec(needs or of) is None:
        pytest.skip(f"{needs or of} is not installed; it is no dependency")
    blocks = [own.text for own in indented(page("export.md"))]
    (code,) = [block for block in blocks if re.search(rf"^(import|from) {of}\b", block, re.MULTILINE)]
    model = build("single_track", vehicle=SMALL)
    export(Subject(model, "car", source="a test"), target, tmp_path / "car")
    monkeypatch.chdir(tmp_path / "car")
    monkeypatch.syspath_prepend(tmp_path / "car")
    for name in ("car", "car_acados"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    try:
        names = {}
        exec(compile(code, "docs/export.md", "exec"), names)
    finally:
        for name in ("car", "car_acados"):
            sys.modules.pop(name, None)
    return names, Equations(model)


def test_do_mpc_simulates_the_model(tmp_path, monkeypatch):
    names, equations = example("do_mpc", "casadi", tmp_path, monkeypatch)
    x, u = np.array([3.0, 0.0, 0.0]), [0.1, 0.5]
    for _ in range(100):
        x = np.array(equations.step(x, u, equations.model.values, 0.0002)).ravel()
    np.testing.assert_allclose(names["after"].ravel(), x, rtol=1e-8)


def test_rockit_plans_with_the_model(tmp_path, monkeypatch):
    names, equations = example("rockit", "casadi", tmp_path, monkeypatch)
    _, u = names["solution"].sample(names["u"], grid="control")
    x = names["driven"][0]
    for k in range(20):
        for _ in range(5):
            x = np.array(equations.step(x, u[k], equations.model.values, 0.01)).ravel()
    np.testing.assert_allclose(x, names["driven"][-1], atol=1e-6)
    np.testing.assert_allclose(x[[0, 2]], [3.0, 1.0], atol=1e-2)


def test_acados_gets_its_model(tmp_path, monkeypatch):
    stand_in = ModuleType("acados_template")
    stand_in.AcadosModel = type("AcadosModel", (), {"p": []})
    monkeypatch.setitem(sys.modules, "acados_template", stand_in)
    names, equations = example("car_acados", "acados", tmp_path, monkeypatch, needs="casadi")
    assert names["model"].disc_dyn_expr.shape == (3, 1)
    assert names["yaw_rate"].name() == "yaw_rate"
    np.testing.assert_array_equal(names["p"], equations.model.values)


def test_onnxruntime_steps(tmp_path, monkeypatch):
    names, equations = example("onnxruntime", "onnx", tmp_path, monkeypatch)
    for k in range(2):
        expected = np.array(equations.step(names["x"][k], names["u"][k], equations.model.values, 0.02)).ravel()
        np.testing.assert_allclose(names["x_next"][k], expected, rtol=1e-12, atol=1e-14)


def test_the_gyms_parameters_are_read(tmp_path, monkeypatch):
    names, _ = example("yaml", "f1tenth", tmp_path, monkeypatch)
    assert names["params"]["m"] == 3.5


def test_fmpy_simulates_the_unit(tmp_path, monkeypatch):
    names, _ = example("fmpy", "fmu", tmp_path, monkeypatch)
    found = names["found"]
    assert (found["v_x"][0], len(found)) == (15.0, 501)
    assert np.max(found["yaw_rate"]) > 0.1
