"""Lag, rate limit and play against simulations in numpy at steps of a two-thousandth of a segment."""

from types import SimpleNamespace

import casadi as cs
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from greybox_id.models.effects.elements import PLAY_WIDTH, lag, play, rate_limit
from greybox_id.models.smooth import CORNER

H = 0.01
FINE = 2_000
ELEMENTS = {"lag": (lag, 0.0), "rate_limit": (rate_limit, np.inf), "play": (play, 0.0)}


def traced(kind):
    """(state, begin, end, h, magnitude) -> [state after h, begin and end of what is seen], and its derivatives."""
    element, _ = ELEMENTS[kind]
    actuator = element("steer", "position", lambda p: p.magnitude)
    state, begin, end, h, magnitude = symbols = [cs.SX.sym(name) for name in ("state", "begin", "end", "h", "m")]
    after, line = actuator.segment(state, (begin, end), SimpleNamespace(magnitude=magnitude), h)
    found = cs.vertcat(after, *line)
    return cs.Function("f", symbols, [found]), cs.Function("J", symbols, [cs.jacobian(found, cs.vertcat(*symbols))])


TRACED = {kind: traced(kind) for kind in ELEMENTS}


def moved(kind, y, command, dt, magnitude):
    """The element a little later."""
    if kind == "lag":
        return command + (y - command) * np.exp(-dt / magnitude)
    if kind == "rate_limit":
        return y + np.clip(command - y, -magnitude * dt, magnitude * dt)
    return np.clip(y, command - magnitude, command + magnitude)


def fine(kind, state, begin, end, magnitude):
    """Where the element ends, and the line of the mean and first moment of what it did."""
    y, path = state, []
    for k in range(FINE):
        share = (k + (0.5 if kind == "lag" else 1.0)) / FINE
        after = moved(kind, y, begin + (end - begin) * share, H / FINE, magnitude)
        path.append((y + after) / 2)
        y = after
    centre, slope = np.mean(path), 12 * np.mean(((np.arange(FINE) + 0.5) / FINE - 0.5) * path)
    return np.array([y, centre - slope / 2, centre + slope / 2])


angles = st.floats(-0.3, 0.3)
MAGNITUDES = {
    "lag": st.floats(5e-4, 0.3),
    "rate_limit": st.floats(0.3, 30.0),
    "play": st.floats(0.002, 0.1),
}


@pytest.mark.parametrize("kind", ELEMENTS)
@given(data=st.data())
@settings(max_examples=100)
def test_an_element_is_its_fine_simulation(kind, data):
    state, begin, end, magnitude = (data.draw(own) for own in (angles, angles, angles, MAGNITUDES[kind]))
    if data.draw(st.booleans()):
        end = begin  # a command that is held
    if data.draw(st.booleans()) and kind != "play":
        begin = state  # one that has been reached
    found = np.asarray(TRACED[kind][0](state, begin, end, H, magnitude)).ravel()
    size = abs(begin - state) + abs(end - begin)
    rounded = {"lag": 0.0, "rate_limit": np.sqrt(CORNER) * min(size, magnitude * H), "play": 4 * PLAY_WIDTH}[kind]
    discrete = 12 * size / FINE if kind != "play" else 20 * size / FINE
    np.testing.assert_allclose(found, fine(kind, state, begin, end, magnitude), atol=rounded + discrete + 1e-12)


@pytest.mark.parametrize("kind", ELEMENTS)
@given(state=angles, begin=angles, end=angles)
@settings(max_examples=50)
def test_an_element_at_its_null_hands_the_command_on(kind, state, begin, end):
    found, J = (np.asarray(f(state, begin, end, H, ELEMENTS[kind][1])) for f in TRACED[kind])
    np.testing.assert_allclose(found.ravel(), [end, begin, end], atol=5e-13)
    assert np.all(np.isfinite(J))


@pytest.mark.parametrize("kind", ELEMENTS)
@given(state=angles, begin=angles, end=angles, data=st.data())
@settings(max_examples=50)
def test_the_derivative_of_an_element_is_that_of_differences(kind, state, begin, end, data):
    magnitude = data.draw(MAGNITUDES[kind])
    assume(min(abs(begin - state), abs(end - begin), abs(end - state)) > 1e-3)
    f, J = TRACED[kind]
    at = np.array([state, begin, end, H, magnitude])
    found = np.asarray(J(*at))
    for k in range(5):
        for h in (1e-7, 3e-8):  # a kink between two points is not straddled by both
            step = h * at[4] * (np.arange(5) == k) if k == 4 else h * H * (np.arange(5) == k)
            values = [np.asarray(f(*(at + own))).ravel() for own in (-step, 0 * step, step)]
            sides = np.diff(values, axis=0) / np.max(step)  # one figure where the function is smooth
            room = 1e-3 * (1 + np.max(np.abs(sides)))
            if np.all((np.min(sides, axis=0) - room <= found[:, k]) & (found[:, k] <= np.max(sides, axis=0) + room)):
                break
        else:
            raise AssertionError((k, found[:, k], sides))


@pytest.mark.parametrize("kind", ELEMENTS)
def test_segments_without_length_change_nothing_that_moves_and_have_finite_derivatives(kind):
    _, null = ELEMENTS[kind]
    for magnitude in (null, {"lag": 0.02, "rate_limit": 0.5, "play": 0.01}[kind]):
        for state, begin in ((0.1, 0.1), (0.1, 0.2), (0.0, 0.0)):
            found, J = (np.asarray(f(state, begin, begin, 0.0, magnitude)) for f in TRACED[kind])
            assert np.all(np.isfinite(found))
            assert np.all(np.isfinite(J))
            if magnitude != null and kind != "play":
                np.testing.assert_allclose(found[0], state, atol=1e-9)


def test_play_at_rest_does_not_creep():
    f, _ = TRACED["play"]
    y = 0.0
    for _ in range(2000):
        y = float(f(y, 0.02, 0.02, H, 0.0200001)[0])
    assert abs(y) <= PLAY_WIDTH


def test_play_takes_up_its_gap_on_the_way_back():
    f, _ = TRACED["play"]
    y, seen = 0.0, []
    commands = 0.1 * np.concatenate([np.linspace(0, 1, 50), np.linspace(1, -1, 100), np.linspace(-1, 0, 50)])
    for command in commands:
        y = float(f(y, command, command, H, 0.02)[0])
        seen.append(y)
    assert max(seen) == pytest.approx(0.08, abs=2 * PLAY_WIDTH)
    assert min(seen) == pytest.approx(-0.08, abs=2 * PLAY_WIDTH)
    assert seen[-1] == pytest.approx(-0.02, abs=2 * PLAY_WIDTH)
