"""Weights add to one, aliases share, and gains count as much as the equations are exact."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from gap_cases import axis
from hypothesis import given
from hypothesis import strategies as st

from greybox_id.gap.estimation.axes import Candidate
from greybox_id.gap.estimation.calibration import CAL
from greybox_id.gap.estimation.hypothesis import Hypothesis
from greybox_id.gap.estimation.noise import AutoregressiveNoise
from greybox_id.gap.evidence import (
    by_chance,
    by_plain_errors,
    costs,
    evidence,
    heaviest,
    p_value,
    price,
    probability,
    tempering,
)
from greybox_id.gap.selection import Selection, cost_without

NOTHING = np.empty(0)


def hypothesis(cost, *names, axes=1):
    own = tuple(Candidate(name, tuple(axis(k) for k in range(axes))) for name in names)
    m = np.ones(axes * len(names))
    return Hypothesis(own, m, NOTHING, NOTHING, cost, np.zeros((0, 1)), np.zeros((0, 1, len(m))))


def selected(base, tried, readings=5000, trust=1.0):
    search = SimpleNamespace(whitener=SimpleNamespace(readings=readings), trust=trust)
    return Selection(search, hypothesis(base), tuple(tried), ())


def weighed(base, tried, readings=5000, inexact=False, trust=1.0):
    return evidence(selected(base, tried, readings, trust), inexact, costs(forces=False))


def test_an_effect_gains_no_more_than_fewer_effects_without_it_leave():
    """An exchanged cause was in the best explanation, which had not been tried without each of its effects."""
    tried = [hypothesis(10.0, "a", "b", "c"), hypothesis(25.0, "a", "b", "d"), hypothesis(30.0, "a", "b"),
             hypothesis(50.0, "b")]  # fmt: skip
    known = selected(900.0, tried)
    assert cost_without(known, tried[0], "c") == 30.0
    assert cost_without(known, tried[0], "a") == 50.0
    assert cost_without(known, tried[0], "b") == 900.0  # what "d" does is no share of the others
    assert cost_without(selected(40.0, tried), tried[0], "a") == 40.0


amounts = st.floats(0.0, 1e7, allow_nan=False)


@given(base=amounts, tried=st.lists(amounts, max_size=6), inexact=st.booleans())
def test_weights_add_to_one_and_the_least_cost_weighs_most(base, tried, inexact):
    own = [hypothesis(cost, f"effect_{k}") for k, cost in enumerate(sorted(tried))]
    found = weighed(base, own, inexact=inexact)
    assert sum(found.weights) == pytest.approx(1.0)
    assert len(found.weights) == len(own) + 1
    assert all(0 <= weight <= 1 for weight in found.weights)
    assert list(found.scores) == sorted(found.scores, reverse=True)
    shares = [probability(found, own, each.names[0]) for each in own]
    assert sum(shares) <= 1 + 1e-9
    assert probability(found, own, "another") == 0.0


def test_exact_aliases_share_their_probability():
    own = [hypothesis(900.0, "accel_bias_y"), hypothesis(900.0, "imu_mount_roll"), hypothesis(990.0, "other")]
    found = weighed(1000.0, own)
    assert probability(found, own, "accel_bias_y") == probability(found, own, "imu_mount_roll")
    assert probability(found, own, "accel_bias_y") == pytest.approx(0.5, abs=1e-6)
    assert probability(found, own, "accel_bias_y", "imu_mount_roll") == pytest.approx(1.0, abs=1e-6)


def test_an_effect_of_a_pair_and_of_a_single_has_the_weight_of_both():
    own = [hypothesis(890.0, "a", "b"), hypothesis(899.0, "a"), hypothesis(903.0, "c")]
    found = weighed(1000.0, own)
    assert probability(found, own, "a") == pytest.approx(found.weights[0] + found.weights[1])
    assert probability(found, own, "b") == pytest.approx(found.weights[0])


def test_without_a_gain_nothing_is_present():
    own = [hypothesis(999.0, "a"), hypothesis(1000.0, "b")]
    found = weighed(1000.0, own)
    assert max(found.scores) < 0
    assert found.weights[-1] > 0.98
    assert weighed(1000.0, []).weights == (1.0,)


@pytest.mark.parametrize(
    ("gain", "there"), [(CAL.cost_without_forces - 1.0, False), (CAL.cost_without_forces - 0.4, True)]
)
def test_aliases_outweigh_nothing_together(gain, there):
    own = [hypothesis(1000.0 - gain, "accel_bias_y"), hypothesis(1000.0 - gain, "imu_mount_roll")]
    found = weighed(1000.0, own)
    assert max(found.scores) < 0
    assert bool(heaviest(selected(1000.0, own), found).candidates) == there
    assert heaviest(selected(1000.0, []), weighed(1000.0, [])).candidates == ()


def test_every_further_effect_and_second_parameter_costs():
    usual = costs(forces=False)
    assert price(hypothesis(0.0), usual) == 0.0
    assert price(hypothesis(0.0, "a"), usual) == CAL.cost_without_forces
    assert price(hypothesis(0.0, "a", "b"), usual) == 2 * CAL.cost_without_forces
    assert price(hypothesis(0.0, "wind", axes=2), usual) == CAL.cost_without_forces + CAL.second_parameter
    own_costs = {"a": 6.0, "b": 12.0}
    assert price(hypothesis(0.0, "a", "b"), own_costs.__getitem__) == 18.0
    own = [hypothesis(900.0, "a"), hypothesis(900.0 - 0.9 * CAL.cost_without_forces, "a", "b")]
    found = weighed(1000.0, own)
    assert found.weights[0] > found.weights[1]


def test_gains_are_tempered_where_equations_are_rough_the_more_was_read():
    assert [tempering(n, inexact=False) for n in (0, 100, 10**6)] == [1.0, 1.0, 1.0]
    tempers = [tempering(n, inexact=True) for n in (0, 1000, 10_000, 10**6)]
    assert tempers[0] == 1.0
    assert all(a > b > 0 for a, b in zip(tempers, tempers[1:], strict=False))
    own = [hypothesis(970.0, "a")]
    assert weighed(1000.0, own, 100_000, inexact=True).weights[0] < weighed(1000.0, own, 100_000).weights[0]
    assert weighed(1000.0, own, 100_000, inexact=True).temper == tempering(100_000, inexact=True)


@given(gain=st.floats(-1e3, 1e5), axes=st.integers(0, 3), candidates=st.integers(1, 60))
def test_a_p_value_is_one(gain, axes, candidates):
    own = p_value(gain, axes, candidates)
    assert 0.0 <= own <= 1.0
    assert p_value(gain + 1.0, axes, candidates) <= own
    assert p_value(gain, axes, candidates + 1) >= own


def test_what_costs_say_is_rare_is_as_rare():
    assert by_chance(0.0) == pytest.approx(CAL.rare)  # exactly worth its cost
    assert by_chance(1.0) == pytest.approx(CAL.rare / np.e)
    assert by_chance(-50.0) == pytest.approx(1.0)


def test_p_values_of_noise_alone_are_not_too_small():
    gains = 0.5 * np.max(np.random.default_rng(0).chisquare(1, (4000, 40)), axis=1)
    found = np.array([p_value(gain, 1, 40) for gain in gains])
    for level in (0.01, 0.05):
        assert np.mean(found < level) == pytest.approx(level, rel=0.4)


def test_gains_of_readings_that_counted_for_less_are_not_tempered_twice():
    full = weighed(100.0, [hypothesis(0.0, "one")], inexact=True)
    trust = tempering(5000, True)
    less = weighed(100.0 * trust, [hypothesis(0.0, "one")], inexact=True, trust=trust)
    assert less.scores == pytest.approx(full.scores)


def test_an_effect_costs_what_the_best_of_all_rarely_gains_by_chance():
    many = [replace(Candidate("gradual", (axis(0),)), effect=f"gradual_{k}") for k in range(39)]
    own = costs(True, [*many, Candidate("abrupt", (axis(0),), gradual=False)])
    assert own("abrupt") == own("one that is no candidate") == CAL.cost
    gains = 0.5 * np.max(np.random.default_rng(0).chisquare(1, (50_000, 40)), axis=1)
    assert np.mean(gains > own("gradual_0")) == pytest.approx(CAL.rare, rel=0.3)
    assert costs(False, many)("gradual_0") == CAL.cost_without_forces


def test_an_effect_whose_magnitude_differs_costs_more_where_it_would_be_there():
    looked_at = []
    usual = costs(forces=False)
    gain = 2.5 * CAL.cost_without_forces

    def unsteady(each):  # so that its cost grows threefold
        looked_at.append(each.names)
        return [1.0 / gain if name == "varies" else 0.0 for name in each.names]

    tried = [hypothesis(1000.0 - gain, "varies"), hypothesis(1001.0 - gain, "constant"), hypothesis(999.0, "hardly")]
    weighed = evidence(selected(1000.0, tried), False, usual, unsteady=unsteady)
    assert sorted(looked_at) == [("constant",), ("varies",)]  # of what is not worth its least cost nothing is asked
    assert weighed.scores[0] == pytest.approx(gain - 3.0 * CAL.cost_without_forces)
    assert weighed.scores[1] == pytest.approx(gain - 1.0 - CAL.cost_without_forces)
    assert heaviest(selected(1000.0, tried), weighed).names == ("constant",)
    assert weighed.outdone == {"varies": pytest.approx(3.0)}
    assert weighed.even == evidence(selected(1000.0, tried), False, usual).weights  # nearest if it is none
    assert price(hypothesis(0.0, "a", "b"), usual, {"a": 2.0}) == 3 * CAL.cost_without_forces


def test_a_partner_gains_nothing_by_making_another_effect_more_constant():
    gain = 25.0 * CAL.cost_without_forces
    tried = [hypothesis(1000.0 - gain, "large", "partner"), hypothesis(1004.0 - gain, "large")]

    def unsteady(each):
        return [0.03 / len(each.names), 0.0][: len(each.names)]

    weighed = evidence(selected(1000.0, tried), False, costs(forces=False), unsteady=unsteady)
    assert heaviest(selected(1000.0, tried), weighed).names == ("large",)
    assert weighed.scores[1] - weighed.scores[0] == pytest.approx(CAL.cost_without_forces - 4.0)


def test_how_an_effect_varies_beside_an_alias_of_another_says_nothing_about_it():
    """Aliases may be refitted only as far as tells that they are: the best explanation says how an effect varies."""
    prices = {"true": 12.0, "alias": 8.0, "steady": 8.0}.__getitem__
    tried = [hypothesis(900.0, "true", "steady"), hypothesis(900.0, "steady", "alias"), hypothesis(950.0, "true")]
    weighed = evidence(
        selected(1000.0, tried), False, prices,
        unsteady=lambda each: [2.0 if name == "steady" and "alias" in each.names else 0.0 for name in each.names],
    )  # fmt: skip
    assert weighed.scores[0] == pytest.approx(100.0 - 12.0 - 8.0)
    assert weighed.outdone == {}


def test_what_is_surely_there_is_told_from_its_rivals_by_what_it_gains():
    tried = [hypothesis(0.0, "true"), hypothesis(5.0, "rival")]
    weighed = evidence(
        selected(1000.0, tried), False, costs(forces=False),
        unsteady=lambda each: [1e-3 if "true" in each.names else 0.0],
    )  # fmt: skip
    assert weighed.scores[0] - weighed.scores[1] == pytest.approx(5.0)
    assert weighed.outdone == {}


def test_two_names_of_one_cause_cost_the_same():
    own = {"cheap": 8.0, "dear": 12.0, "other": 12.0}.__getitem__
    tried = [hypothesis(900.0, "cheap"), hypothesis(900.0 + 0.5 * CAL.twins, "dear"), hypothesis(980.0, "other")]
    found = evidence(selected(1000.0, tried), False, own)
    assert probability(found, tried, "cheap") == pytest.approx(0.5, abs=0.1)
    alone = evidence(selected(1000.0, [tried[0], tried[2]]), False, own)
    assert alone.scores[0] == 100.0 - 8.0


@pytest.mark.parametrize(("ar", "lasting"), [((), 1.0), ((0.5,), 3.0)])
def test_an_effect_gains_no_more_than_plain_errors_say(ar, lasting):
    rng, rows = np.random.default_rng(0), (slice(0, 300),)
    good = np.ones((300, 1), dtype=bool)
    sd = np.array([0.5])
    search = SimpleNamespace(whitener=AutoregressiveNoise(sd, (np.array(ar),), rows, good), trust=1.0)
    nothing = np.empty(0)

    def of(share, cost):
        e = share * np.sqrt(1000.0) * base
        return Hypothesis((), nothing, nothing, nothing, cost, e, np.zeros((300, 1, 0)))

    base = rng.standard_normal((300, 1))
    base /= np.sqrt(np.sum(base**2))
    tried = (of(1.1, 0.0), of(0.8, 1.0), of(0.99, 2.0), of(0.5, 99.0))
    found = by_plain_errors(Selection(search, of(1.0, 100.0), tried, ()), sd, good)
    costs = {round(float(np.sum(own.e**2)) / 1000.0, 4): own.cost for own in found.tried}
    assert [own.cost for own in found.tried] == sorted(own.cost for own in found.tried)
    assert costs[1.21] > 100.0  # whitened it gained, plainly it lost
    assert costs[0.64] == pytest.approx(max(1.0, 100.0 - 0.5 * 360.0 / 0.25 / lasting))
    assert costs[0.9801] == pytest.approx(100.0 - 0.5 * 19.9 / 0.25 / lasting)
    assert costs[0.25] == 99.0
