"""From everything at once to hypotheses: each cause is taken away again, and what acts alike is tried in its place."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from gap_cases import GivenBench, axis, candidate, linear_bench, smooth_columns

from greybox_id.gap import selection
from greybox_id.gap.estimation.axes import Candidate
from greybox_id.gap.estimation.causes import Form, PossibleCause
from greybox_id.gap.estimation.model_error import amplitude_prior
from greybox_id.gap.estimation.problem import JointProblem
from greybox_id.gap.estimation.together import JointSearch, JointWhitening
from greybox_id.gap.evidence import evidence, heaviest
from greybox_id.gap.selection import cost_without, select

SD, WORTH = np.array([0.1, 0.1]), 7.0


def cause(index, **more):
    own = candidate(index, **more)
    return PossibleCause(own.effect, own.axes[0], (Form(own, (), ()),), 1.0, 0.0, True)


def selected(
    bench, count, nuisances=(), costs=lambda name: WORTH, unsteady=lambda search, each: [0.0] * len(each.names),
    stands=lambda p: True, bounds=(),
):  # fmt: skip
    causes = [cause(k, **dict(bounds).get(k, {})) for k in range(count)]
    problem = JointProblem(bench, nuisances, causes, bench.counted)
    search = JointSearch(
        problem, JointWhitening(problem, SD, amplitude_prior(SD, True, True, {}), False, 1.0), lambda *_, **__: None
    )
    return select(search, nuisances, costs, unsteady, 1.0, stands)


def of_effects(*numbers):
    return {f"effect_{k}" for k in numbers}


@pytest.mark.parametrize("seed", range(3))
def test_the_best_of_all_holds_every_cause_and_nothing_else(seed):
    truth = np.array([0, 1.0, 0, 0.4, -0.6, 0, 0.5, 0])
    found = selected(linear_bench(smooth_columns(8, seed=seed), truth, SD, seed), 8)
    best = found.tried[0]
    assert set(best.names) == of_effects(1, 3, 4, 6)
    without = [own for own in found.tried if len(own.names) == 3]
    assert {frozenset(own.names) for own in without} >= {frozenset(set(best.names) - {name}) for name in best.names}
    assert all(own.cost > best.cost + WORTH for own in without)


def test_what_gains_less_than_its_price_goes_and_the_rest_is_refitted():
    X = smooth_columns(5)
    bench = linear_bench(X, [0, 1.0, 0, 0.3, 0], SD)
    plainly = selected(bench, 5)
    weakest = min(own.cost for own in plainly.tried[1:] if len(own.names) == 1) - plainly.tried[0].cost

    def dear(name):
        return 2 * weakest if name == "effect_3" else WORTH

    def differs(search, own):
        return [1 / WORTH if name == "effect_3" else 0.0 for name in own.names]

    assert set(plainly.tried[0].names) == of_effects(1, 3)
    of_dear = selected(bench, 5, costs=dear)
    assert "effect_3" not in heaviest(of_dear, evidence(of_dear, False, dear)).names
    differing = selected(bench, 5, unsteady=differs)
    weighed = evidence(differing, False, lambda name: WORTH, unsteady=lambda each: differs(None, each))
    assert "effect_3" not in heaviest(differing, weighed).names


def test_nuisances_are_linearised_beside_the_causes():
    """About the base, a tolerance acts otherwise than beside causes: sds were half of what tolerances alone leave."""
    X = smooth_columns(2)
    bench = GivenBench(lambda p: p[1] * X[:, :, 1] + p[0] * (1 + 4 * p[1]) * X[:, :, 0], np.zeros((400, 2)), 2)
    bench.measured = bench.respond(np.array([0.05, 0.8])) + SD * np.random.default_rng(0).standard_normal((400, 2))
    problem = JointProblem(bench, [axis(0, sd=0.1)], [cause(1)], bench.counted)
    search = JointSearch(
        problem, JointWhitening(problem, SD, amplitude_prior(SD, True, True, {}), False, 1.0), lambda *_, **__: None
    )
    result = select(
        search, [axis(0, sd=0.1)], lambda name: WORTH, lambda _, each: [0.0] * len(each.names), 1.0, lambda p: True
    )
    (m,) = result.tried[0].m
    assert m == pytest.approx(0.8, abs=0.05)
    np.testing.assert_allclose(result.search.moved_by(np.array([1.0])), (1 + 4 * m) * X[:, :, 0], rtol=1e-4)


def test_what_acts_alike_is_among_what_was_tried_and_costs_the_same():
    X = smooth_columns(4)
    X[:, :, 2] = X[:, :, 0]
    found = selected(linear_bench(X, [0.8, 0.5, 0.0, 0.0], SD), 4)
    costs = {frozenset(own.names): own.cost for own in found.tried}
    assert costs[frozenset(of_effects(0, 1))] == pytest.approx(costs[frozenset(of_effects(2, 1))], abs=1e-3)


def test_another_cause_is_an_alias_as_far_as_nothing_is_gained_beside_it(monkeypatch):
    """A cause that explains something else, and was too dear, is none; nor one as far as simulations say otherwise."""
    called, plain = [], selection._exchanged
    monkeypatch.setattr(selection, "_exchanged", lambda *given: called.append(given) or plain(*given))
    X = smooth_columns(4)
    basis = np.linalg.qr(X.reshape(-1, 4))[0].reshape(X.shape)  # nothing stands for another but as said
    X = basis * np.linalg.norm(X[:, :, 0])
    X[:, :, 2] = X[:, :, 0] + 0.01 * X[:, :, 2]
    selected(linear_bench(X, [0.4, 0.0, 0.0, 0.8], SD), 4, costs=lambda name: 1e6 if name == "effect_3" else WORTH)
    *others, best, gains = called[0]
    assert set(best.names) == of_effects(0)

    def aliases(gains):
        return {name for each in plain(*others, best, gains) for name in each.names}

    assert aliases(gains) == of_effects(2)
    assert aliases(100.0 * gains) == set()  # each nat to first order is a hundred


@pytest.mark.parametrize(("bound", "alike"), [(1.2, True), (0.3, False)])
def test_what_acts_alike_only_beyond_its_bound_stands_for_nothing(bound, alike):
    X = smooth_columns(4)
    X[:, :, 2] = 1.01 * X[:, :, 0]
    result = selected(
        linear_bench(X, [0.8, 0.5, 0.0, 0.0], SD), 4, bounds={2: {"low": -bound, "high": bound}}
    )  # fmt: skip
    assert ({"effect_1", "effect_2"} in [set(each.names) for each in result.tried]) == alike


def test_what_reaches_its_bound_only_once_it_is_refitted_stands_for_nothing():
    """To first order it would do the same within its bounds; it does less, the larger it is."""
    X = smooth_columns(3)

    def respond(p):
        return X[:, :, 0] * (p[0] + 0.9 * np.tanh(p[2])) + X[:, :, 1] * p[1]

    measured = respond(np.array([0.8, 0.5, 0.0])) + SD * np.random.default_rng(0).standard_normal((400, 2))
    result = selected(GivenBench(respond, measured, 3), 3, bounds={2: {"low": -1.0, "high": 1.0}})
    assert {"effect_1", "effect_2"} not in [set(each.names) for each in result.tried]


def test_effects_at_their_bounds_leave_and_the_rest_is_searched_again(monkeypatch):
    """They are symptoms of other causes, in whose place they stand."""
    X = smooth_columns(4)
    X[:, :, 2] = X[:, :, 0] + 0.3 * X[:, :, 2]
    bench = linear_bench(X, [0.8, 0.5, 0.0, 0.0], SD)
    assert set(selected(bench, 4).tried[0].names) == of_effects(0, 1)
    bounded = property(lambda each: frozenset({"effect_0"} & set(each.names)))
    monkeypatch.setattr(selection.Hypothesis, "at_bounds", bounded)
    assert set(selected(bench, 4).tried[0].names) >= of_effects(1, 2)


def test_an_exchanged_explanation_is_known_without_each_of_its_effects(monkeypatch):
    """Where it was the best, its effects seemed to gain what they gain beside nothing."""

    def exchanged(search, together, stage, best, gains):
        other = Candidate("effect_0", (axis(0),))
        swapped = tuple(other if each.effect == "effect_1" else each for each in best.candidates)
        return [replace(best, candidates=swapped, cost=best.cost - 0.5)]

    monkeypatch.setattr(selection, "_exchanged", exchanged)
    selection_of_all = selected(linear_bench(smooth_columns(4), [0.0, 0.6, 0.5, 0.4], SD), 4)
    top, costs = selection_of_all.tried[0], {frozenset(each.names): each.cost for each in selection_of_all.tried}
    assert set(top.names) == of_effects(0, 2, 3)
    for gone in (2, 3):
        gain = costs[frozenset(of_effects(1, 2, 3) - of_effects(gone))] - costs[frozenset(of_effects(1, 2, 3))]
        assert costs[frozenset(of_effects(0, 2, 3) - of_effects(gone))] == pytest.approx(top.cost + gain)
        assert cost_without(selection_of_all, top, f"effect_{gone}") == pytest.approx(top.cost + gain)
    assert cost_without(selection_of_all, top, "effect_0") == costs[frozenset(of_effects(2, 3))]


def test_where_nothing_acts_the_base_is_all_there_is():
    found = selected(linear_bench(smooth_columns(6), np.zeros(6), SD), 6)
    assert all(own.cost > found.base.cost - WORTH for own in found.tried)


def test_a_tolerance_is_no_cause():
    found = selected(linear_bench(smooth_columns(3), [0.0, 0.0, 0.15], SD), 2, (axis(2, sd=0.1),))
    assert all(own.cost > found.base.cost - WORTH for own in found.tried)
    assert found.base.theta == pytest.approx([0.15], abs=0.05)


def test_of_every_effect_is_said_what_it_would_gain_and_how_well_it_would_show():
    X = smooth_columns(3)
    X[:, :, 2] = 0.0  # what is not excited
    found = selected(linear_bench(X, [0.8, 0.0, 0.0], SD), 3)
    promised = {own.candidate.effect: own for own in found.expected_gains}
    assert promised["effect_0"].gain > 10 * promised["effect_1"].gain
    assert promised["effect_1"].sd < 0.05
    assert promised["effect_2"].sd == pytest.approx(1.0)  # its usual size: nothing was read of it


def test_a_bench_that_leaves_the_range_of_numbers_is_said():
    from greybox_id.base.errors import BadInput

    bench = GivenBench(lambda p: np.full((60, 2), np.nan), np.zeros((60, 2)), 2)
    with pytest.raises(BadInput, match="Simulations overflow"):
        selected(bench, 2)


def test_where_no_start_stays_within_numbers_the_search_begins_again_from_the_priors(monkeypatch):
    about = []
    search = SimpleNamespace(about=about.append, at_means=lambda: "priors", start_of=lambda item: item)
    monkeypatch.setattr(selection, "refit", lambda search, starts: list(starts) if about else [])
    assert selection._within_numbers(search, ["where it was"]) == ["priors"]
    assert about == [None]


def test_where_model_error_beside_nothing_leaves_the_range_of_numbers_the_base_stays_as_it_was(monkeypatch):
    """About a simulation that spins no filter holds; there still is an answer."""

    class Lost(JointWhitening):
        def left(self, about, e, least=True):
            told = super().left(about, e, least)
            return told if least else replace(told, sd=told.sd * np.nan)

    bench = linear_bench(smooth_columns(4), np.zeros(4), SD)
    usual = selected(bench, 4)
    monkeypatch.setitem(globals(), "JointWhitening", Lost)
    kept = selected(bench, 4)
    assert kept.base.names == usual.base.names == ()
    assert np.isfinite(kept.base.cost)
    np.testing.assert_allclose(kept.base.e, usual.base.e)
