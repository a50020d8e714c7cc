"""What a filter sees of a model: what walks, how noise joins, derivatives."""

import casadi as cs
import numpy as np
import pytest
from filter_cases import LinearCase, car, driven_space, driving

from greybox_id.base.errors import BadModel
from greybox_id.filters.state_space import StateSpace, Tracked, walking
from greybox_id.models.effects import EFFECTS

RICH = {"steering_lag": 0.05, "tyre_relaxation": 0.4}


@pytest.fixture(scope="module")
def rich():
    space, p = driven_space(
        parameters=("C_alpha_f", "C_alpha_r"), disturbances=("road_bank",), effects=RICH, coloured=("a_y",)
    )
    x, _, s, _ = driving(space, p, rows=20)
    return space, p, x[0], s[11]


def numbers(function, *arguments):
    return [np.asarray(cs.densify(value)) for value in function(*arguments)]


def test_states_come_first_then_what_they_carry_then_what_walks_then_colour(rich):
    space, *_ = rich
    states, carried = ("v_x", "v_y", "yaw_rate"), space.carried
    assert space.names == (*states, *carried, "stiffness_f", "stiffness_r", "road_bank", "a_y_colour")
    assert carried[1:] == ("alpha_f", "alpha_r")
    assert space.size == space.step.numel_in(0) == 10
    assert space.noises == (
        *(f"walk_{name}" for name in (*states, "stiffness_f", "stiffness_r", "road_bank")), "memory_road_bank",
        *(f"noise_{name}" for name in space.model.outputs), "colour_a_y", "memory_a_y",
    )  # fmt: skip


@pytest.mark.parametrize("which", ["step", "output"])
def test_derivatives_are_those_of_differences(rich, which):
    space, p, x, s = rich
    function, at = getattr(space, which), 1e-5
    *_, J = numbers(function, x, s, p)
    ahead, behind = (
        np.column_stack([numbers(function, x + sign * at * e, s, p)[0].ravel() for e in np.eye(len(x))])
        for sign in (1, -1)
    )
    np.testing.assert_allclose(J, (ahead - behind) / (2 * at), rtol=1e-6, atol=1e-6 * np.abs(J).max(axis=1).min())


def test_derivatives_of_what_is_seen_are_those_of_differences(rich):
    space, p, x, s = rich
    names = ("sideslip", "C_alpha_f", "F_yf", "alpha_r", "stiffness_r", "yaw_rate")
    seen, at = space.seen(names), 1e-5
    found = seen(x[None], s[None], p)[0]
    ahead, behind = (seen(x + sign * at * np.eye(len(x)), s[None].repeat(len(x), 0), p)[:, :6] for sign in (1, -1))
    J = found[6:].reshape(6, -1)
    np.testing.assert_allclose(J, (ahead - behind).T / (2 * at), rtol=1e-6, atol=1e-6 * np.abs(J).max(axis=1).min())
    assert found[0] == pytest.approx(np.arctan2(x[1], x[0]), rel=1e-12)
    assert found[4] == pytest.approx(np.exp(x[space.names.index("stiffness_r")]), rel=1e-12)


def test_what_nobody_knows_of_cannot_be_seen(rich):
    with pytest.raises(BadModel, match="no F_yq"):
        rich[0].seen(("F_yq",))


def test_a_step_is_the_model_s_own_with_what_walks_in_place(rich):
    space, p, x, s = rich
    found = numbers(space.step, x, s, p)[0].ravel()
    own = space.model.with_parameters(
        space.model["stiffness_f"].with_value(np.exp(x[6])), space.model["stiffness_r"].with_value(np.exp(x[7])),
        space.model["road_bank"].with_value(x[8]),
    )  # fmt: skip
    expected = np.asarray(space.trace.step(x[:6], s, own.values)).ravel()
    np.testing.assert_allclose(found[:6], expected, rtol=1e-13)
    np.testing.assert_array_equal(found[6:8], x[6:8])


@pytest.mark.parametrize("h", [0.0, 1e-6, 0.01, 3.0])
def test_what_returns_decays_and_scatters_as_ornstein_and_uhlenbeck_have_it(h):
    T, q = 0.8, 0.2
    case = LinearCase(T)
    x, s = np.array([0.0, 0.0, 0.35, 0.0]), np.array([h, 0.0, 0.0])
    ahead, variance, F = numbers(case.space.step, x, s, case.p)
    assert ahead[2, 0] == pytest.approx(0.05 + np.exp(-h / T) * 0.3, rel=1e-12)
    assert F[2, 2] == pytest.approx(np.exp(-h / T), rel=1e-12)
    assert variance[2, 0] == pytest.approx(q**2 * T / 2 * -np.expm1(-2 * h / T), rel=1e-8, abs=1e-30)


def test_two_halves_of_a_segment_add_up_to_the_whole():
    """In what joins: a walk, what returns and colour are processes in time, not sequences of numbers."""
    case = LinearCase(0.8)
    x, whole, half = np.zeros(4), np.array([0.3, 0.0, 0.0]), np.array([0.15, 0.0, 0.0])
    _, Q, _ = numbers(case.space.step, x, whole, case.p)
    _, Q_half, F_half = numbers(case.space.step, x, half, case.p)
    np.testing.assert_allclose((np.diag(F_half) ** 2 * Q_half.ravel() + Q_half.ravel())[2:], Q.ravel()[2:], rtol=1e-12)
    walking = LinearCase(None)
    (_, Q, _), (_, Q_half, _) = (numbers(walking.space.step, x, own, walking.p) for own in (whole, half))
    np.testing.assert_allclose(2 * Q_half.ravel()[:3], Q.ravel()[:3], rtol=1e-12)


def test_colour_keeps_its_size_and_joins_its_reading_alone():
    case = LinearCase()
    x, s = np.array([0.0, 0.0, 0.0, 0.6]), np.array([0.2, 0.0, 0.0])
    ahead, variance, F = numbers(case.space.step, x, s, case.p)
    assert ahead[3, 0] == pytest.approx(0.6 * np.exp(-0.2 / 0.7), rel=1e-12)
    assert F[3, 3] ** 2 * 0.4**2 + variance[3, 0] == pytest.approx(0.4**2, rel=1e-12)
    read, noise, H = numbers(case.space.output, x, s, case.p)
    np.testing.assert_allclose(read.ravel(), [0.0, 0.6], atol=1e-15)
    np.testing.assert_allclose(noise.ravel(), [0.05**2, 0.2**2], rtol=1e-12)
    np.testing.assert_array_equal(H[:, 3], [0.0, 1.0])


def test_what_is_positive_walks_in_its_logarithm_and_stays_positive():
    tracked = Tracked("I_z", "kg m^2", 2000.0, 400.0, logarithmic=True)
    assert tracked.start == pytest.approx(np.log(2000.0))
    assert tracked.start_sd == pytest.approx(0.2)
    space = StateSpace(car(), (tracked,))
    p = np.concatenate([space.model.values, np.ones(len(space.noises))])
    seen = space.seen(("I_z",))
    for at in (-30.0, 0.0, 30.0):
        x = np.array([20.0, 0.0, 0.0, at])
        assert seen(x[None], np.zeros((1, space.trace.segment_size)), p)[0, 0] == pytest.approx(np.exp(at))


def test_the_effect_of_what_walks_is_where_its_parameter_is():
    """Whichever of the parameters walks, it is that one and no other that is taken from x."""
    for name in ("m", "I_z", "D_r", "c_2"):
        model, tracked = walking(car(), (name,), (), EFFECTS)
        space = StateSpace(model, tracked)
        p = np.concatenate([model.values, np.ones(len(space.noises))])
        s = np.zeros(space.trace.segment_size)
        s[:3] = [0.02, 0.05, 1.0]
        z, value = [20.0, 0.3, 0.2], 1.1 * float(model[name].array)
        found = numbers(space.step, [*z, np.log(value)], s, p)[0].ravel()
        other = model.with_parameters(model[name].with_value(value))
        np.testing.assert_allclose(found[:3], np.asarray(space.trace.step(z, s, other.values)).ravel(), rtol=1e-13)


def test_a_vehicle_that_stands_has_no_sideslip(rich):
    space, p, x, s = rich
    rows = np.tile(x, (2, 1))
    rows[0, 0] = 0.1
    found = space.seen(("sideslip",))(rows, np.tile(s, (2, 1)), p)
    assert np.isnan(found[0, 0])
    assert found[1, 0] == pytest.approx(np.arctan2(x[1], x[0]))
