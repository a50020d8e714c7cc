"""Maps with memory as step and output, against the engine's own closed loop."""

import numpy as np
import pytest
from exported import MEMORY, memory, subject
from toys import drive, linear_toy

from greybox_id.base.errors import BadInput
from greybox_id.engine.elements import Actuation
from greybox_id.engine.trace import Trace
from greybox_id.export.equations import Equations
from greybox_id.export.memory_equations import MemoryEquations, equations_of
from greybox_id.fitting.scores.memory import predictions
from greybox_id.models.effects import EFFECTS
from greybox_id.models.registry import build

CLOSED = ("msnn_full", "msnn_full_plus")


def rows_of(model, recording):
    """Inputs as recorded, as the equations see them where readings are fed back, and outputs, by name."""
    columns = [recording[n] if n in recording else np.zeros(len(recording)) for n in model.inputs]
    recorded = np.column_stack(columns)
    seen, _ = Actuation(model, ())(recorded, model.values, [slice(0, len(recording))])
    u, seen = (dict(zip(model.inputs, own.T, strict=True)) for own in (recorded, seen))
    if model.feedback is not None:
        seen |= {"a_x": recording["a_x"], "a_y": recording["yaw_rate"] * recording["v_x"]}
    return u, seen, {name: recording[name] for name in model.outputs}


def state_at(equations, row, seen, outputs):
    """x at a row whose past is as recorded."""
    found = []
    for state in equations.states:
        name, _, rest = (
            state.name.partition("_ago")[0].rpartition("_") if state.name.endswith("_ago") else (state.name, "", "0")
        )
        then = row - int(rest)
        if "_actuator_" in name:
            found.append(seen[name.partition("_actuator_")[0]][row - 1])
        elif name.startswith("predicted_"):
            found.append(outputs[name.removeprefix("predicted_")][then])
        else:
            found.append(seen[name][then])
    return np.array(found)


def driven(equations, recording):
    """(rows, outputs) what the exported functions make of a recording from row `memory - 1` on, by their own loop."""
    model = equations.model
    first = Trace(model).memory
    recorded, seen, outputs = rows_of(model, recording)
    x, found = state_at(equations, first - 1, seen, outputs), []
    for row in range(first - 1, len(recording) - 1):
        u = np.array([recorded[signal.name][row] for signal in equations.inputs])
        x = np.array(equations.step(x, u, model.values)).ravel()
        found.append(np.array(equations.output(x, u, model.values)).ravel())
    return np.array(found)


@pytest.mark.parametrize("name", CLOSED)
def test_the_loop_is_the_engines(name):
    model, recording = memory(name), drive(80, 5)
    found = predictions(model, recording, "closed_loop")
    np.testing.assert_allclose(driven(MemoryEquations(model), recording), found.predicted, rtol=1e-10, atol=1e-12)


def test_sensors_that_read_late_see_the_predictions_of_before():
    model, recording = EFFECTS["sensor_latency_imu"].at(0.07)(memory("msnn_full")), drive(80, 5)
    found = predictions(model, recording, "closed_loop").predicted
    own = driven(MemoryEquations(model), recording)
    np.testing.assert_allclose(own[4:], found[4:], rtol=1e-10, atol=1e-12)  # before, the engine holds its first one
    assert np.abs(own - driven(MemoryEquations(memory("msnn_full")), recording)).max() > 1e-3


@pytest.mark.parametrize("name", ["msnn_lat", "msnn_long"])
def test_a_map_without_a_loop_predicts_from_measured_inputs(name):
    model, recording = memory(name), drive(60, 2)
    found = predictions(model, recording)
    np.testing.assert_allclose(driven(MemoryEquations(model), recording), found.predicted, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("name", CLOSED)
def test_pushing_readings_fills_the_window(name):
    equations = MemoryEquations(memory(name))
    recording = drive(60, 3)
    recorded, seen, outputs = rows_of(equations.model, recording)
    x = np.zeros(len(equations.states))
    for row in range(59):
        u = [recorded[signal.name][row] for signal in equations.inputs]
        y = [outputs[output.name][row + 1] for output in equations.outputs]
        x = equations.push(x, u, y, equations.model.values)
    np.testing.assert_allclose(np.array(x).ravel(), state_at(equations, 59, seen, outputs), rtol=1e-12, atol=1e-12)


def test_only_what_the_equations_look_at_is_remembered():
    equations = MemoryEquations(linear_toy(4))
    assert [state.name for state in equations.states] == [
        "predicted_yaw_rate",
        "steer_3_ago",
        "steer_2_ago",
        "steer_1_ago",
    ]
    assert {state.unit for state in equations.states[1:]} == {"rad"}


@pytest.mark.parametrize("name", MEMORY)
def test_inputs_that_are_fed_back_are_no_inputs(name):
    equations = MemoryEquations(memory(name))
    fed = Trace(equations.model).fed_back
    assert {signal.name for signal in equations.inputs} == set(equations.model.inputs) - set(fed)


def test_every_kind_of_model_has_its_functions_or_a_sentence():
    assert isinstance(equations_of(subject(build("kinematic"))), Equations)
    assert isinstance(equations_of(subject(memory("msnn_lat"))), MemoryEquations)
    with pytest.raises(BadInput, match="recurrent network, and equations of motion have no place for its memory"):
        equations_of(subject(build("hybrid_force")))
