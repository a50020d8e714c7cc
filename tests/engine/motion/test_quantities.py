"""Named quantities: what effects do to them and in which order; those that follow with a lag."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

from greybox_id.engine.motion.trace import JUST_AFTER, MotionTrace, NamedQuantities
from greybox_id.models.motion_model import MotionModel, Relaxation, State
from greybox_id.models.parameter import Parameter

MODEL = MotionModel(
    name="toy", about="", inputs=("steer",), outputs=("speed",), parameters=(Parameter("m", "kg", 2.0),),
    states=(State("speed", "m/s"),), quantities=("force",), dynamics=lambda x, u, p, q: {"speed": 0.0},
)  # fmt: skip


def quantities(model, relax=lambda name, value, q: value, before=None):
    x, u, p = SimpleNamespace(speed=3.0), SimpleNamespace(steer=0.1), SimpleNamespace(m=2.0)
    return NamedQuantities(model, x, u, p, relax, before)


def test_what_is_assigned_is_read_back():
    q = quantities(MODEL)
    q.force = 5.0
    assert q.force == 5.0
    assert (q.x.speed, q.u.steer, q.p.m) == (3.0, 0.1, 2.0)


def test_an_alteration_acts_before_anything_reads_the_quantity_back():
    q = quantities(MODEL.altered(force=lambda force, q: force + q.p.m))
    q.force = 5.0
    assert q.force == 7.0


def test_alterations_act_in_the_order_in_which_they_were_added():
    model = MODEL.altered(force=lambda force, q: force + 1).altered(force=lambda force, q: force * 10)
    q = quantities(model)
    q.force = 5.0
    assert q.force == 60.0


def test_parameters_and_inputs_are_altered_at_once_and_the_caller_keeps_his():
    model = MODEL.altered(m=lambda m, q: m * 2, steer=lambda steer, q: steer + q.x.speed)
    p = SimpleNamespace(m=2.0)
    q = NamedQuantities(model, SimpleNamespace(speed=3.0), SimpleNamespace(steer=0.1), p, lambda n, v, q: v)
    assert (q.p.m, q.u.steer, p.m) == (4.0, 3.1, 2.0)


def test_only_relaxed_quantities_follow_with_a_lag_and_they_do_so_after_alterations():
    model = MODEL.altered(force=lambda force, q: force + 1)
    model = replace(model, quantities=("force", "moment"), relaxations=(Relaxation("force", lambda q: 0.1),))
    q = quantities(model, relax=lambda name, value, q: 100 * value)
    q.force, q.moment = 1.0, 1.0
    assert (q.force, q.moment) == (200.0, 1.0)


def test_before_the_first_pass_everything_is_zero_and_then_it_is_the_pass_before():
    first = quantities(MODEL)
    assert first.before.a_y == 0.0
    first.force = 5.0
    assert quantities(MODEL, before=first).before.force == 5.0


def test_a_quantity_that_is_not_there_yet_is_a_sentence():
    with pytest.raises(AttributeError, match="The dynamics read F_z before"):
        _ = quantities(MODEL).F_z


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
