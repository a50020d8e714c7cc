"""The exported ONNX graphs compute what the model's functions do, in double precision."""

import builtins
import json

import casadi as cs
import numpy as np
import pytest
from exported import EFFECTS, MEMORY, MOTION, memory, motion, points, subject, values, write

from greybox_id.base.errors import BadInput
from greybox_id.export.memory_equations import equations_of
from greybox_id.export.target_onnx import files

onnx = pytest.importorskip("onnx", reason="onnx is not installed; make test installs it")
onnxruntime = pytest.importorskip("onnxruntime", reason="onnxruntime is not installed; make test installs it")
from greybox_id.export.onnx_graph import graph_of  # noqa: E402

POINTS = 10_000
MODELS = {
    **{name: lambda name=name: motion(name) for name in MOTION},
    **{f"with {effect}": lambda effect=effect: motion("single_track on pacejka", (effect,)) for effect in EFFECTS},
    **{name: lambda name=name: memory(name) for name in MEMORY},
}


def session(graph):
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])


def ran(graph, **given):
    made = session(graph)
    known = {tensor.name for tensor in made.get_inputs()} | {
        initializer.name for initializer in made.get_overridable_initializers()
    }
    return made.run(None, {name: value for name, value in given.items() if name in known})[0]


def assert_close(found, expected):
    """To 1e-12 of each number and of its column's mean size: what has cancelled has no more digits to agree in."""
    assert found.dtype == np.float64
    assert np.all(np.isfinite(expected))
    size = np.abs(expected) + np.abs(expected).mean(axis=0)
    assert np.max(np.abs(found - expected) / (size + (size == 0))) <= 1e-12


@pytest.mark.parametrize("name", MODELS)
def test_graphs_are_the_models_functions(name):
    model = MODELS[name]()
    equations, graphs = equations_of(subject(model)), files(subject(model))
    x, u = points(equations, POINTS)
    dt = [[0.02]] if "dt" in equations.step.name_in() else []
    step = values(equations.step, x, u, model.values, *dt)
    assert_close(ran(graphs["car_step.onnx"], x=x, u=u, dt=np.full((1, 1), 0.02)), step)
    assert_close(ran(graphs["car_output.onnx"], x=x, u=u), values(equations.output, x, u, model.values))


@pytest.mark.parametrize("model", [motion("single_track on brush"), memory("msnn_full_plus")], ids=lambda own: own.name)
def test_parameters_may_be_handed_in(model):
    equations, graphs = equations_of(subject(model)), files(subject(model))
    x, u = points(equations, 20)
    p = model.values * 1.1
    dt = [[0.02]] if "dt" in equations.step.name_in() else []
    expected = values(equations.step, x, u, p, *dt)
    assert_close(ran(graphs["car_step.onnx"], x=x, u=u, p=p[None], dt=np.full((1, 1), 0.02)), expected)
    assert np.abs(expected - values(equations.step, x, u, model.values, *dt)).max() > 1e-6


@pytest.mark.parametrize(("name", "moving"), [
    ("single_track on pacejka", ("I_z",)), ("kinematic", ()), ("msnn_full_plus", ("kappa_1",)), ("msnn_full", ()),
])  # fmt: skip
def test_parameters_that_are_to_stay_are_constants(name, moving):
    meant = subject(MODELS[name](), moving=moving)
    equations, graphs = equations_of(meant), files(meant)
    x, u = points(equations, 20)
    dt = [[0.02]] if "dt" in equations.step.name_in() else []
    expected = values(equations.step, x, u, equations.values, *dt)
    assert_close(ran(graphs["car_step.onnx"], x=x, u=u, dt=np.full((1, 1), 0.02)), expected)
    assert {parameter.name.partition("[")[0] for parameter in equations.parameters} == set(moving)


def test_precision_opset_and_names_are_identifiable_in_graph_and_manifest(tmp_path):
    folder = write(motion("kinematic", ("steering_delay",)), "onnx", tmp_path / "out")
    graph = onnx.load(folder / "car_step.onnx")
    told = {entry.key: entry.value for entry in graph.metadata_props}
    assert (told["precision"], int(told["opset"])) == ("float64", graph.opset_import[0].version)
    assert json.loads(told["u"]) == [["steer", "rad"], ["v_x", "m/s"]]
    manifest = json.loads((folder / "manifest.json").read_text())
    assert (manifest["precision"], manifest["opset"]) == ("float64", 17)
    assert manifest["lacking"] == [
        "Not included in the functions: delay of steer 30 ms. Pass them the command that acts at the time of the step."
    ]


OPERATIONS = {
    "tan": (cs.tan, np.tan, (-1.5, 1.5)),
    "atan": (cs.atan, np.arctan, (-1e3, 1e3)),
    "expm1": (cs.expm1, np.expm1, (-40.0, 40.0)),
    "tanh": (cs.tanh, np.tanh, (-20.0, 20.0)),
    "sqrt": (cs.sqrt, np.sqrt, (0.0, 1e3)),
    "power": (lambda x: x**2.5, lambda x: x**2.5, (0.0, 1e3)),
    "exp": (cs.exp, np.exp, (-40.0, 40.0)),
    "floor": (cs.floor, np.floor, (-9.0, 9.0)),
    "between": (
        lambda x: cs.if_else(cs.logic_or(cs.logic_and(x > -1, x <= 1), x == 3), x + 2, 5),
        lambda x: np.where(((x > -1) & (x <= 1)) | (x == 3), x + 2, 5),
        (-3.0, 3.0),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", OPERATIONS)
def test_an_operation_is_exact_to_a_few_units_in_the_last_place(name):
    symbolic, numeric, (low, high) = OPERATIONS[name]
    size = 10.0 ** np.linspace(-12, 0, 2001)
    x = np.concatenate([low * size, [0.0], high * size])[:, None]
    symbol = cs.SX.sym("x")
    graph = graph_of(cs.Function("f", [symbol], [symbolic(symbol)], ["x"], ["y"]))
    found = ran(graph.model("f", 17, {"x": ("batch", 1)}, {"y": ("batch", 1)}, {}, {}).SerializeToString(), x=x)
    np.testing.assert_allclose(found, numeric(x), rtol=3e-15, atol=0)


def test_angles_are_right_in_every_quadrant():
    yx = cs.SX.sym("yx", 2)
    angles = np.concatenate([np.linspace(-np.pi, np.pi, 1001)[1:], [1e-9, -1e-9]])
    given = np.concatenate([np.column_stack([np.sin(angles), np.cos(angles)]) * 1e3, [[0.0, 0.0], [0.0, -1.0]]])
    graph = graph_of(cs.Function("f", [yx], [cs.atan2(yx[0], yx[1])], ["x"], ["y"]))
    found = ran(graph.model("f", 17, {"x": ("batch", 2)}, {"y": ("batch", 1)}, {}, {}).SerializeToString(), x=given)
    np.testing.assert_allclose(found[:, 0], np.arctan2(*given.T), rtol=3e-15, atol=0)


def test_an_operation_that_is_lacking_is_a_sentence():
    symbol = cs.SX.sym("x")
    with pytest.raises(BadInput, match="cannot be written as ONNX"):
        graph_of(cs.Function("f", [symbol], [cs.erf(symbol)], ["x"], ["y"]))


def test_without_the_package_there_is_a_sentence(monkeypatch):
    def without(name, *rest):
        if name == "onnx" or "onnx_graph" in (rest[2] or () if len(rest) > 2 else ()):
            raise ImportError(name)
        return genuine(name, *rest)

    genuine = builtins.__import__
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(BadInput, match=r"pip install 'greybox-id\[onnx\]'"):
        files(subject(motion("kinematic")))
