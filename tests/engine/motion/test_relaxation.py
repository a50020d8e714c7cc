"""Quantities that follow with a lag, against exact solutions of linear equations."""

import numpy as np
import pytest
from scipy.linalg import expm

from greybox_id.engine.motion.quantities import JUST_AFTER
from greybox_id.engine.motion.trace import MotionTrace
from greybox_id.motion_model import MotionModel, State
from greybox_id.parameter import Parameter

RATE = 8.0
"""Of the state, 1/s."""


def relaxed(T):
    """x' = RATE w, where w follows u - x with the time constant T."""

    def dynamics(x, u, p, q):
        q.w = u.u - x.x
        return {"x": RATE * q.w}

    model = MotionModel(
        name="relaxed", about="", states=(State("x", "1"),), inputs=("u",), commands=("u",), outputs=("x", "w"),
        quantities=("w",), parameters=(Parameter("T", "s", T, (0.0, 1.0)),), dynamics=dynamics,
    )  # fmt: skip
    return MotionTrace(model.relaxed(lambda q: q.p.T, "w"))


def exactly(T, commands, h):
    """x and what follows w after commands that are held for h each, both from zero."""
    A, z = np.zeros((3, 3)), np.zeros(3)
    A[:2] = [[0, RATE, 0], [-1 / T, -1 / T, 1 / T]] if T else [[-RATE, 0, RATE], [0, 0, 0]]
    for u in commands:
        z[2] = u
        z = expm(A * h) @ z
    return z[:2] if T else np.array([z[0], z[2] - z[0]])


def followed(T, commands, h, parts=1):
    trace, z = relaxed(T), np.zeros(2)
    for u in np.repeat(commands, parts):
        z = np.asarray(trace.step(z, [h / parts, u, 0.0], [T])).ravel()
    return z


COMMANDS = np.random.default_rng(0).standard_normal(40)


@pytest.mark.parametrize(("T", "close"), [(0.001, 0.03), (0.003, 0.01), (0.01, 0.003), (0.03, 1e-3), (0.3, 1e-3)])
def test_a_lag_of_any_length_against_a_segment_is_followed(T, close):
    """Within the share stated of what the lag changes, in segments of 10 ms."""
    bare, truth = exactly(0.0, COMMANDS, 0.01), exactly(T, COMMANDS, 0.01)
    error = np.abs(followed(T, COMMANDS, 0.01) - truth)
    assert error[0] < close * np.abs(truth - bare)[0] + 1e-6
    assert error[1] < 0.003


def test_no_lag_is_no_lag():
    found = followed(0.0, COMMANDS, 0.01)
    assert found[0] == pytest.approx(exactly(0.0, COMMANDS, 0.01)[0], abs=1e-6)
    assert found[1] == pytest.approx(COMMANDS[-1] - found[0], abs=1e-9)


def test_halved_segments_leave_a_seventh_of_the_error_or_less():
    truth = exactly(0.05, COMMANDS, 0.02)
    errors = [np.max(np.abs(followed(0.05, COMMANDS, 0.02, parts) - truth)) for parts in (1, 2, 4)]
    assert errors[0] > 7 * errors[1] > 49 * errors[2]


def test_the_derivative_at_no_lag_sees_commands_that_jump():
    """Short of T squared, x' = RATE (w - T w'), and w' is a pulse where the command jumps."""
    z, s = np.zeros(2), [0.01, 1.0, 0.0]
    step, h = relaxed(0.0).step, 1e-9
    found = float((step(z, s, [h]) - step(z, s, [0.0]))[0]) / h
    assert found == pytest.approx(-RATE * (1 - RATE * 0.01) * np.exp(-RATE * 0.01), rel=5e-3)


def test_readings_are_taken_just_after_the_segment_began():
    trace = relaxed(0.002)
    read = np.asarray(trace.output([0.5, 0.1], [0.01, 1.0, 0.0], [0.002])).ravel()
    assert read[0] == 0.5
    assert read[1] == pytest.approx(0.5 + (0.1 - 0.5) * np.exp(-JUST_AFTER / 0.002), abs=1e-12)


def test_time_constants_that_change_are_taken_halfway():
    """T = 0.1 / v with v rising: what follows a held command knows where v was."""

    def dynamics(x, u, p, q):
        q.w = u.u
        return {"v": 5.0, "x": q.w}

    model = MotionModel(
        name="speeding", about="", states=(State("v", "m/s"), State("x", "1")), inputs=("u",), commands=("u",),
        outputs=("x",), quantities=("w",), parameters=(), dynamics=dynamics,
    ).relaxed(lambda q: 0.1 / q.x.v, "w")  # fmt: skip
    z = np.asarray(MotionTrace(model).step([1.0, 0.0, 0.0], [0.1, 1.0, 0.0], [])).ravel()
    assert z[2] == pytest.approx(1 - np.exp(-(0.1 + 5.0 * 0.1**2 / 2) / 0.1), rel=1e-6)
