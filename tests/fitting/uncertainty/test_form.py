"""What residuals depend on, what that costs the parameters, and fits that must never pass for usable."""

from dataclasses import replace

import numpy as np
import pytest
from driven import driven

import greybox_id as gb
from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import Recording, join
from greybox_id.fitting.fit import CLEARLY, NOT_USABLE
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.scores.misfit import must_tell
from greybox_id.fitting.uncertainty.evidence import Joint, StartEquations
from greybox_id.fitting.uncertainty.halves import prediction_limit
from greybox_id.fitting.verb import fit
from greybox_id.models.effects import EFFECTS
from greybox_id.models.parameter import Prior
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle

QUICK = FitOptions(solver="gauss-newton", horizon=1.0, start_from="measured")


def model(*free):
    """The full-size car's, a few numbers of it free."""
    found = build("lateral", None, {}, vehicle("full_size_car"))
    return found.with_parameters(*(replace(p, fixed=p.name not in free, prior=None) for p in found.parameters))


def changed(recording, **signals):
    return recording.with_signals(**{name: change(recording[name]) for name, change in signals.items()})


def truth(name):
    return float(model()[name].array)


def test_a_right_form_leaves_next_to_nothing_and_costs_no_width():
    found = fit(model("B_f", "I_z"), [driven(runs=1, seconds=20.0)], how=QUICK)
    outputs = found.how["form"]["outputs"]
    assert all(one["explained"] ** 0.5 * one["residual"] < 0.05 * one["spread"] for one in outputs.values())
    assert 0.95 * truth("B_f") < float(found.model["B_f"].array) < 1.05 * truth("B_f")
    assert float(found.sd["B_f"]) < 0.05 * truth("B_f")


@pytest.mark.parametrize(
    ("softer", "first", "apart"),
    [((4, 5, 6, 7), 4, True), ((5, 6, 7), 5, None), ((2, 3, 4, 5, 6, 7), 2, None), ((1, 3, 4, 6), 4, False)],
    ids=["in the second half", "in the last three eighths", "after the first quarter", "by turns"],
)
def test_two_vehicles_are_told_apart_where_a_later_part_gains_more_than_mixed_ones(softer, first, apart):
    blocks = [
        driven(runs=1, seconds=5.0, seed=k, noise=0.1, values={"B_f": (0.5 if k in softer else 1.0) * truth("B_f")})
        for k in range(8)
    ]
    form = fit(model("B_f", "I_z"), [join(blocks, "eight")], how=QUICK).how["form"]
    assert form["first"] == first
    assert apart is None or form["apart"] is apart
    assert form["halves_gain"] > CLEARLY or not apart


def test_a_steering_offset_is_named_and_counts_in_the_intervals():
    turned = changed(driven(runs=1, seconds=20.0), steer=lambda v: v + 0.03)
    found = fit(model("B_f", "I_z"), [turned], how=QUICK)
    low, high = found.interval("B_f")
    assert found.verdict.usability == NOT_USABLE or low < truth("B_f") < high
    (sentence,) = [own for own in found.verdict.reasons if "lacks an effect" in own]
    assert "an offset of the steer signal" in sentence
    assert "greybox gap" in sentence


def test_gains_that_change_with_the_steering_are_named_and_count():
    seen = changed(driven(runs=1, seconds=20.0), steer=lambda v: v * (1 + 60.0 * v**2))
    found = fit(model("B_f", "I_z"), [seen], how=QUICK)
    low, high = found.interval("B_f")
    assert found.verdict.usability == NOT_USABLE or low < truth("B_f") < high
    first = next(iter(found.how["form"]["outputs"]["yaw_rate"]["on"]))
    assert first == "a gain of the steer signal that varies with its size"


def shuffled(v):
    return np.random.default_rng(1).permutation(v)


def noise(sd):
    return lambda v: sd * np.random.default_rng(2).standard_normal(len(v))


LONG = {"runs": 1, "seconds": 20.0}
STANDING = {"v_x": noise(0.02), "v_y": noise(0.02), "yaw_rate": noise(0.005), "a_y": noise(0.1)}
UNEXCITED = STANDING | {"v_x": lambda v: np.full(len(v), 18.0), "steer": noise(1e-4)}


@pytest.mark.parametrize(
    ("recording", "why"),
    [
        (lambda: driven(**LONG).rows(20, 23), "too few"),
        (lambda: driven(**LONG).rows(20, 50), "too few"),
        pytest.param(lambda: changed(driven(**LONG), **UNEXCITED), "Nothing moves", marks=pytest.mark.slow),
        (lambda: changed(driven(**LONG), steer=shuffled), "unexplained"),
    ],
    ids=["3 rows", "30 rows", "unexcited", "shuffled"],
)
def test_poor_data_are_refused_with_their_reason_though_a_good_lap_was_held_out(recording, why):
    found = fit(model("B_f", "I_z"), [recording()], validate=driven(**LONG, seed=7), how=QUICK)
    assert found.verdict.usability == NOT_USABLE
    assert any(why in own for own in found.verdict.reasons)


@pytest.mark.parametrize(
    ("recording", "why"),
    [
        (lambda: driven(**LONG).rows(20, 23), r"3 rows \(.* too few"),
        (lambda: driven(**LONG).rows(20, 50), r"30 rows \(.* too few"),
        (lambda: changed(driven(**LONG), **UNEXCITED), "nothing moves. v_y, yaw_rate and a_y"),
        (lambda: changed(driven(**LONG), **STANDING), "nothing moves"),
        (lambda: changed(driven(**LONG), **dict.fromkeys(STANDING, np.zeros_like)), "nothing moves"),
    ],
    ids=["3 rows", "30 rows", "unexcited", "standing", "standing without noise"],
)
def test_what_can_carry_no_fit_is_refused_before_one_is_made(recording, why):
    with pytest.raises(BadInput, match=f"drive: {why}"):
        gb.fit(model("B_f", "I_z"), recording(), validation=driven(**LONG, seed=7), options=QUICK)


def test_a_drive_straight_on_tells_of_what_moves_in_it():
    must_tell(model("B_f", "I_z"), [changed(driven(**LONG), v_y=noise(0.02), a_y=noise(0.1))])


def test_standing_under_the_brake_is_named_and_left_out():
    rng, m = np.random.default_rng(3), 35e3
    force = np.tile(np.repeat([3e4, 0.0, -4e4], [150, 100, 400]), 3)
    speed = np.zeros(len(force))
    for k, pull in enumerate(force[:-1]):
        speed[k + 1] = max(0.0, speed[k] + 0.1 * (pull - 1500.0 * (speed[k] > 0)) / m)
    noisy = speed + 0.03 * rng.standard_normal(len(speed))
    tram = Recording("tram", 0.1 * np.arange(len(force)), {"v_x": noisy, "drive_force": force})
    free = ("m", "c_0")
    nominal = build("longitudinal")
    start = {"force_per_unit": 1.0, "m": 30e3, "c_0": 1000.0, "I_w": 0.0, "c_2": 0.0, "drive_lag": 0.0}
    nominal = nominal.with_parameters(*(nominal[name].with_value(value) for name, value in start.items()))
    nominal = nominal.with_parameters(*(replace(p, fixed=p.name not in free, prior=None) for p in nominal.parameters))
    lines = []
    found = fit(
        nominal, [tram], how=FitOptions(solver="gauss-newton"), say=lambda line, passing=False: lines.append(line)
    )
    assert any("stood still with its brake on are left out" in line for line in lines)
    assert found.how["stood"] > 60.0
    low, high = found.interval("m")
    assert low < m < high
    assert float(found.sd["m"]) < 0.01 * m


def test_a_stated_number_that_is_wrong_widens_intervals_or_refuses():
    nominal = model("m", "I_z")  # lateral motion tells their ratio alone
    off = {"m": 0.91 * truth("m"), "I_z": truth("I_z")}
    stated = [replace(nominal[n].with_value(v), prior=Prior(mean=v, sd=0.01 * v)) for n, v in off.items()]
    found = fit(nominal.with_parameters(*stated), [driven(runs=1, seconds=20.0)], how=QUICK)
    inside = [low < truth(name) < high for name in off for low, high in [found.interval(name)]]
    assert found.verdict.usability == NOT_USABLE or all(inside)
    assert any("conflict with their priors" in reason for reason in found.verdict.reasons)


def test_residuals_are_judged_by_the_noise_that_the_vehicle_states():
    turned = changed(driven(runs=1, seconds=20.0), steer=lambda v: v + 0.03)
    found = fit(model("B_f", "I_z"), [turned], how=QUICK, sensors={"yaw_rate": 1e-4, "a_y": 1e-3, "v_y": 1e-4})
    assert any("times the stated noise" in reason for reason in found.verdict.reasons)


def test_an_effect_that_makes_what_was_held_out_worse_is_refused():
    nominal = model("B_f", "I_z") + EFFECTS["steering_offset"].free(0.01)
    turned = changed(driven(runs=1, seconds=20.0), steer=lambda v: v + 0.02)
    found = fit(nominal, [turned], validate=driven(**LONG, seed=7), how=QUICK)
    assert found.verdict.usability == NOT_USABLE
    assert any("of the same fit without steering_offset" in reason for reason in found.verdict.reasons)
    right = fit(nominal, [turned], validate=changed(driven(**LONG, seed=7), steer=lambda v: v + 0.02), how=QUICK)
    assert not any("without steering_offset" in reason for reason in right.verdict.reasons)


def test_a_parameter_of_which_nothing_moves_everything_leaves_the_others_as_they_are():
    """A lag of microseconds: its curvature is 1e18 times that of the others, and rounding must not reach these."""
    rng = np.random.default_rng(3)
    columns, residuals = rng.standard_normal((200, 7)), rng.standard_normal(200)
    variances = np.array([0.1, 0.2, 0.05, 0.1])
    found = []
    for steep in (1.0, 1e9):
        table = columns * np.array([steep, *np.ones(6)])
        wider, moved, sizes = Joint(table.T @ table, table.T @ residuals, 3).beside(variances)
        found.append((wider[1:, 1:], moved[1:], sizes))
    for plain, beside in zip(*found, strict=True):
        np.testing.assert_allclose(beside, plain, rtol=1e-6)


def test_a_further_number_exceeds_the_prediction_limit_once_in_a_hundred():
    draws = np.random.default_rng(4).standard_normal((20_000, 19))
    beyond = [own[-1] > prediction_limit(own[:-1]) for own in draws]
    assert 0.008 < np.mean(beyond) < 0.012


def test_a_start_that_no_reading_shows_takes_nothing_from_the_others():
    rng = np.random.default_rng(5)
    wide, residuals, J = rng.standard_normal((40, 4)), rng.standard_normal(40), rng.standard_normal((40, 2))
    taken = []
    for by in (J, np.column_stack([J, np.zeros(40)])):
        starts = StartEquations.of(by.shape[1], 4)
        starts.add(by, wide, residuals)
        H, g = wide.T @ wide, wide.T @ residuals
        starts.eliminate_from(H, g)
        taken.append((H, g))
    for plain, beside in zip(*taken, strict=True):
        np.testing.assert_allclose(beside, plain, rtol=1e-9)
