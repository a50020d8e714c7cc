"""Models laid over runs: windows, joins, missing values, causality, derivatives. Windows against loops."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toys import TINY, drive, joined, linear_toy, scattered, speed_toy, tiny, without

from greybox_id.base.errors import BadInput
from greybox_id.engine.series import runs
from greybox_id.engine.trace import Trace
from greybox_id.engine.windows import weighted_windows, windows
from greybox_id.models.effects import sensor_latency_imu, steering_rate_limit
from greybox_id.models.parameter import Parameter, placed


def predicted(model, recording, across_joins=False):
    """Row of the recording -> prediction, over all runs."""
    found = {}
    for run in runs(Trace(model), recording, across_joins):
        for row, y in zip(run.rows[run.first :], run.predict(model.values), strict=True):
            found[row] = y
    return found


@given(st.lists(st.integers(1, 30), min_size=1, max_size=4), st.sets(st.integers(0, 60), max_size=4), st.integers(1, 6))
@settings(max_examples=30)
def test_a_row_is_predicted_exactly_where_a_whole_window_lies_before_it(lengths, missing, memory):
    recording = joined(*lengths)
    steer = recording["steer"].copy()
    steer[[row for row in missing if row < len(steer)]] = np.nan
    recording = recording.with_signals(steer=steer)
    allowed = {
        row
        for start, stop in recording.runs
        for row in range(start + memory, stop)
        if np.all(np.isfinite(steer[row - memory : row + 1]))
    }
    model = linear_toy(memory)
    if allowed:
        assert set(predicted(model, recording)) == allowed
    else:
        with pytest.raises(BadInput, match="no unbroken run"):
            predicted(model, recording)


@pytest.mark.parametrize("name", TINY)
def test_no_window_crosses_a_join(name):
    model = scattered(tiny(name))
    whole = predicted(model, joined(40, 30))
    first = predicted(model, joined(40))
    for row, y in first.items():
        np.testing.assert_allclose(whole[row], y, atol=1e-12)
    second = joined(40, 30).rows(40, 70)
    for row, y in predicted(model, second).items():
        np.testing.assert_allclose(whole[row + 40], y, atol=1e-12)
    assert len(whole) == len(first) + len(predicted(model, second))


@pytest.mark.parametrize("name", TINY)
def test_no_window_crosses_a_missing_value(name):
    model = scattered(tiny(name))
    recording, signal = drive(70), "steer" if "steer" in model.inputs else "v_x"
    values = recording[signal].copy()
    values[30] = np.nan
    found = predicted(model, recording.with_signals(**{signal: values}))
    cut = predicted(model, recording.rows(0, 30)) | {
        row + 31: y for row, y in predicted(model, recording.rows(31, 70)).items()
    }
    assert set(found) == set(cut)
    for row, y in found.items():
        np.testing.assert_allclose(y, cut[row], atol=1e-12)


def test_across_joins_windows_are_laid_as_if_there_were_none():
    model = scattered(tiny("msnn_lat"))
    recording = joined(40, 30)
    as_one = type(recording)("one", 0.05 * np.arange(70), recording.signals)
    across, one = predicted(model, recording, across_joins=True), predicted(model, as_one)
    assert set(across) == set(one) == set(range(5, 70))
    np.testing.assert_array_equal(np.array(list(across.values())), np.array(list(one.values())))


@pytest.mark.parametrize("signal", ["v_x", "steer", "a_x", "a_y", "motor_current"])
@pytest.mark.parametrize("name", TINY)
def test_an_input_changes_no_prediction_of_its_own_row_or_before(name, signal):
    model, row = scattered(tiny(name)), 30
    plain = drive(50)
    moved = plain[signal].copy()
    moved[row] += 0.3
    (before,), (after,) = (runs(Trace(model), r) for r in (plain, plain.with_signals(**{signal: moved})))
    p = model.values
    first = before.first
    assert np.array_equal(before.predict(p)[: row + 1 - first], after.predict(p)[: row + 1 - first])
    assert np.array_equal(before.simulate(p)[first : row + 1], after.simulate(p)[first : row + 1])


@pytest.mark.parametrize("name", TINY)
def test_an_input_does_change_the_prediction_of_the_next_row(name):
    model, row = scattered(tiny(name)), 30
    signal = model.inputs[0]
    moved = drive(50)[signal].copy()
    moved[row] += 0.3
    (before,), (after,) = (runs(Trace(model), r) for r in (drive(50), drive(50).with_signals(**{signal: moved})))
    change = after.predict(model.values) - before.predict(model.values)
    assert np.all(np.abs(change[row + 1 - before.first]) > 1e-9)


def variants(name):
    """A model bare, with a rate limit free and held, and with late sensors."""
    model = tiny(name)
    yield "bare", model
    yield "late sensor", model + sensor_latency_imu
    if "steer" in model.inputs and "steering_rate_limit" not in model.effects:
        limited = model + steering_rate_limit.at(1.7)
        yield "limit held", limited
        yield "limit free", limited.with_parameters(Parameter("steering_rate_limit", "rad/s", 1.7, (0.1, 10.0)))


def sharing():
    """A parameter that weighs several samples, one that weighs two windows, and weights laid out backwards."""
    return replace(linear_toy(3), equations=lambda u, p, past: {
        "yaw_rate": past(u.steer, [p.F[2], p.F[0] ** 2, p.F[2]]) * past(u.steer**2, p.F[::-1]) + past(u.steer, [p.F[0]])
    })  # fmt: skip


CASES = [pytest.param(model, id=f"{name}, {word}") for name in TINY for word, model in variants(name)] + [
    pytest.param(sharing(), id="shared weights")
]


@pytest.mark.parametrize("nodes", ["recorded", "simulated"])
@pytest.mark.parametrize("model", CASES)
def test_derivatives_are_those_of_finite_differences(model, nodes):
    model = scattered(model, 2)
    (run,) = runs(Trace(model), drive(40, 4))
    p, h = model.values, 1e-6
    held = None if nodes == "recorded" else run.simulate(p)
    lines = run.linearise(p, held)
    np.testing.assert_allclose(lines.y, run.predict(p, held), atol=1e-12)
    for parameter, place in placed(model.parameters):
        for k in range(place.start, place.stop):
            if parameter.fixed:
                continue
            step = h * max(1e-3, abs(p[k]))
            up, down = (run.predict(p + sign * step * np.eye(len(p))[k], held) for sign in (1, -1))
            slope = (up - down) / (2 * step)
            size = np.max(np.abs(slope)) + 1e-3
            np.testing.assert_allclose(lines.by_p[:, :, k], slope, atol=1e-4 * size, err_msg=parameter.name)


@pytest.mark.parametrize("model", [tiny("msnn_full"), tiny("msnn_full_plus"), speed_toy()], ids=lambda m: m.name)
def test_derivatives_by_the_nodes_are_those_of_finite_differences(model):
    model = scattered(model, 2)
    trace = Trace(model)
    (run,) = runs(trace, drive(40, 4))
    p, nodes, h = model.values, run.simulate(model.values), 1e-6
    by_nodes = run.linearise(p, nodes).by_nodes
    for row in range(run.first, len(run) - 1):
        for output in range(nodes.shape[1]):
            moved = [nodes.copy(), nodes.copy()]
            moved[0][row, output] += h
            moved[1][row, output] -= h
            slope = (run.predict(p, moved[0]) - run.predict(p, moved[1])) / (2 * h)
            for target in range(run.first, len(run)):
                lag = trace.memory - (target - row)
                expected = by_nodes[target - run.first, :, lag, output] if 0 <= lag < trace.memory else 0.0
                np.testing.assert_allclose(slope[target - run.first], expected, atol=1e-6)


def test_a_recording_that_lacks_a_signal_is_refused_and_the_signal_named():
    with pytest.raises(BadInput, match="lacks motor_current"):
        runs(Trace(tiny("msnn_full")), without(drive(), "motor_current"))


def test_a_fed_back_input_may_be_missing():
    (run,) = runs(Trace(tiny("msnn_full")), without(drive(), "a_y"))
    assert not run.complete
    p = run.trace.model.values
    assert np.all(np.isfinite(run.simulate(p)))
    assert np.all(np.isfinite(run.predict(p, run.measured)))


@pytest.mark.parametrize("dt", [0.02, 0.1, 0.052])
def test_another_sample_time_is_refused_in_a_sentence(dt):
    recording = type(drive())("fast", dt * np.arange(150), drive().signals)
    with pytest.raises(BadInput, match="Resample"):
        runs(Trace(tiny("msnn_lat")), recording)


@pytest.mark.parametrize("rows", [0, 1, 5])
def test_a_recording_shorter_than_a_window_is_refused_in_a_sentence(rows):
    with pytest.raises(BadInput, match="no unbroken run"):
        runs(Trace(tiny("msnn_lat")), drive().rows(0, rows))


def test_a_recording_without_a_single_value_is_refused_in_a_sentence():
    with pytest.raises(BadInput, match="no unbroken run"):
        runs(Trace(tiny("msnn_lat")), drive().with_signals(v_x=np.full(150, np.nan)))


sizes = st.tuples(st.integers(1, 130), st.integers(1, 5), st.integers(1, 25), st.integers(0, 999)).filter(
    lambda s: s[0] >= s[2]
)


@given(sizes, st.booleans())
@settings(max_examples=80)
def test_weighted_windows_are_the_naive_loop(size, strided):
    rows, columns, length, seed = size
    rng = np.random.default_rng(seed)
    values = rng.standard_normal((rows, 2 * columns))[:, ::2] if strided else rng.standard_normal((rows, columns))
    weights = rng.standard_normal(length)
    naive = [
        [sum(weights[k] * values[row + k, column] for k in range(length)) for column in range(columns)]
        for row in range(rows - length + 1)
    ]
    np.testing.assert_allclose(weighted_windows(values, weights), naive, atol=1e-12)


@given(sizes)
@settings(max_examples=30)
def test_windows_are_oldest_first(size):
    rows, columns, length, _ = size
    values = np.arange(rows * columns, dtype=float).reshape(rows, columns)
    found = windows(values, length)
    assert found.shape == (rows - length + 1, columns, length)
    for row in range(rows - length + 1):
        assert np.array_equal(found[row], values[row : row + length].T)
