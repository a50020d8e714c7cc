"""The graph of a file, evaluated here, gives what nnodely gives in double precision, whatever it is of."""

import numpy as np
import pytest
from networks import FOLDER, NAMES, body_of, stated, written

from greybox_id.base.errors import BadInput
from greybox_lab.nnodely.evaluation import evaluate
from greybox_lab.nnodely.network import read_network


@pytest.mark.parametrize("name", NAMES)
def test_every_output_is_that_of_nnodely(name):
    network, told = read_network(FOLDER / f"{name}.json"), stated(name)
    windows = {key: np.array(values)[:, :, None] for key, values in told["windows"].items()}
    assert set(told["double"]) == set(network.outputs)
    for output, values in told["double"].items():
        found = evaluate(network, network.outputs[output], windows).ravel()
        np.testing.assert_allclose(found, values, rtol=0, atol=1e-13 * max(np.max(np.abs(values)), 1.0))


def small(tmp_path, **relations):
    """A file of a window of four samples of x, and of some relations upon it."""
    functions = {
        "boxes": {"functions": "Rectangular", "centers": [0.0, 1.0, 3.0]},
        "tents": {"functions": "Triangular", "centers": [0.0, 1.0, 3.0]},
        "square": {"code": "def f(x, k):\n  return k * x**2", "params_and_consts": ["k"]},
    }
    body = body_of("lat_small") | {
        "Inputs": {"x": {"dim": 1, "sw": [-4, 0]}},
        "Parameters": {"k": {"dim": 1, "values": [2.0]}, "W": {"dim": 1, "sw": 4, "values": [[1.0]] * 4}},
        "Constants": {},
        "Minimizers": {},
        "Functions": functions,
        "Outputs": {"y": "y"},
        "Relations": {"w": ["SamplePart", ["x"], -1, [-4, 0]], **relations},
    }
    return read_network(written(tmp_path, body))


X = np.array([-1.0, 0.4, 1.5, 5.0]).reshape(1, 4, 1)


@pytest.mark.parametrize(
    ("relation", "wanted"),
    [
        (["Fuzzify", ["w"], "tents"], [[1, 0, 0], [0.6, 0.4, 0], [0, 0.75, 0.25], [0, 0, 1]]),
        (["Fuzzify", ["w"], "boxes"], [[1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
        (["ParamFun", ["w"], "square"], 2 * X[0] ** 2),
        (["Fir", ["w"], "W", None, 0], [[5.9]]),
        (["Relu", ["w"]], np.maximum(X[0], 0)),
        (["Sub", ["w", "k"]], X[0] - 2),
        (["SamplePart", ["x"], -1, [-1, 0]], [[5.0]]),
        (["TimePart", ["x"], -1, [-0.1, 0]], X[0, 2:]),
    ],
)
def test_operations_mean_what_they_mean_in_nnodely(tmp_path, relation, wanted):
    np.testing.assert_allclose(evaluate(small(tmp_path, y=relation), "y", {"x": X})[0], wanted, rtol=1e-14)


@pytest.mark.parametrize(
    ("relation", "word"),
    [
        (["Tanh", ["w", "w"]], "takes 2 inputs; it must take 1"),
        (["Sine", ["w"]], "'Sine' is not understood here"),
        (["Sin", ["x"]], "takes an input without a window"),
        (["Fuzzify", ["w"], "none"], "membership functions of its own"),
        (["ParamFun", ["w"], "none"], "must name a function of the file"),
        (["ParamFun", ["w", "w"], "square"], "takes 2 arguments, but the file passes 3"),
        (["Fir", ["w"], "nowhere", None, 0], "needs the numbers nowhere"),
        (["Fir", ["w"], "W", "k", 0.0, 1], None),
        (["SamplePart", ["x"], -1, [0, 1]], "only past samples can be imported"),
        (["SamplePart", ["x"], -1, [-4, 0], -1], "offsets"),
        (["SamplePart", ["x"], -1, [-5, 0]], "combines shapes that do not match"),
        (["Select", ["w"], 1, 1], "combines shapes that do not match"),
        (["Select", ["w"], 1, -1], "does not say which"),
    ],
)
def test_what_is_not_understood_is_named(tmp_path, relation, word):
    network = small(tmp_path, y=relation)
    if word is None:
        assert evaluate(network, "y", {"x": X}).ravel() == pytest.approx([7.9])
        return
    with pytest.raises(BadInput, match=word):
        evaluate(network, "y", {"x": X})
