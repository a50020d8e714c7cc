"""Everything at once, on benches whose simulations are known in closed form."""

from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from gap_cases import GivenBench, axis, candidate, linear_bench, smooth_columns

from greybox_id.gap.estimation.calibration import CAL
from greybox_id.gap.estimation.causes import Form, PossibleCause
from greybox_id.gap.estimation.first_order import FirstOrder
from greybox_id.gap.estimation.model_error import amplitude_prior
from greybox_id.gap.estimation.problem import JointProblem
from greybox_id.gap.estimation.together import JointSearch, JointStage, JointWhitening
from greybox_id.gap.estimation.walks import walked

SD = np.array([0.1, 0.1])


def cause(index, gradual=True, **more):
    """An effect of one parameter; abrupt ones are looked at from three sizes."""
    own = replace(candidate(index, **more), gradual=gradual)
    starts = () if gradual else tuple((size,) for size in (0.2, 0.5, 1.2))
    return PossibleCause(own.effect, own.axes[0], (Form(own, (), starts),), 1.0, 0.01, gradual)


def together(bench, causes, tolerances=()):
    problem = JointProblem(bench, tolerances, causes, bench.counted)
    prior = amplitude_prior(SD, True, True, {})
    return JointSearch(problem, JointWhitening(problem, SD, prior, False, 1.0), lambda *_, **__: None)


def named(search):
    stage = search.explained(walked(search)[0])
    sizes = stage.sets.sizes(stage.included)[0]
    return {search.problem.causes[k].name: sizes[k] for k in np.flatnonzero(stage.included)}


@pytest.mark.parametrize("seed", range(3))
def test_many_that_act_are_found_and_nothing_else(seed):
    truth = np.zeros(14)
    truth[[1, 4, 6, 9, 13]] = [1.0, -0.6, 0.4, 0.8, -0.5]
    bench = linear_bench(smooth_columns(14, seed=seed), truth, SD, seed)
    found = named(together(bench, [cause(k) for k in range(14)]))
    assert set(found) == {"effect_1", "effect_4", "effect_6", "effect_9", "effect_13"}
    assert list(found.values()) == pytest.approx([1.0, -0.6, 0.4, 0.8, -0.5], abs=0.05)


def test_where_nothing_acts_nothing_is_named():
    bench = linear_bench(smooth_columns(14), np.zeros(14), SD)
    assert named(together(bench, [cause(k) for k in range(14)])) == {}


def test_what_a_tolerance_explains_has_no_name():
    X = smooth_columns(4)
    bench = linear_bench(X, [0.15, 0.0, 0.0, 0.0], SD)
    own = (axis(0, sd=0.1),)
    assert named(together(bench, [cause(k) for k in range(1, 4)], own)) == {}


def test_an_abrupt_effect_whose_derivative_vanishes_is_found_at_its_size():
    X = smooth_columns(3)

    def respond(p):  # the second acts with its square
        return X[:, :, 0] * p[0] + X[:, :, 1] * p[1] ** 2 + X[:, :, 2] * p[2]

    noise = SD * np.random.default_rng(1).standard_normal((400, 2))
    bench = GivenBench(respond, respond(np.array([0.7, 0.8, 0.0])) + noise, 3)
    found = named(together(bench, [cause(0), cause(1, gradual=False, low=0.0), cause(2)]))
    assert set(found) == {"effect_0", "effect_1"}
    assert found["effect_1"] == pytest.approx(0.8, abs=0.05)


def test_a_magnitude_stays_within_its_bounds():
    """Beyond them no model can hold it: what reaches one is a symptom of something else."""
    X = smooth_columns(2)
    search = together(linear_bench(X, [1.5, 0.0], SD), [cause(0, low=-1.0, high=1.0), cause(1)])
    assert all(abs(float(stage.state.m[0])) <= 1.0 for stage in search.annealed())


def test_where_forms_as_rough_as_what_is_left_spin_the_stage_before_stands(monkeypatch):
    X = smooth_columns(2)
    search = together(linear_bench(X, [1.0, 0.0], SD), [cause(0), cause(1)])
    monkeypatch.setattr(search, "_shown_error_scale", lambda stage: 5.0 * stage.error_scale)
    settled = search._settled_at
    monkeypatch.setattr(search, "_settled_at", lambda *given: replace(settled(*given), error_evidence=np.nan))
    stage = search.explained(walked(search)[0])
    assert np.isfinite(stage.evidence)
    assert list(stage.included) == [True, False]


@pytest.mark.parametrize("more", [-1.0, 1.0])
def test_a_scale_of_model_error_must_have_more_evidence(monkeypatch, more):
    X = smooth_columns(2)
    search = together(linear_bench(X, [1.0, 0.0], SD), [cause(0), cause(1)])
    before, settled = walked(search)[0], search._settled_at

    def at_scale(*given):
        stage = settled(*given)
        return replace(stage, error_evidence=before.evidence + more - stage.cause_evidence)

    monkeypatch.setattr(search, "_shown_error_scale", lambda stage: 2.0 * before.error_scale)
    monkeypatch.setattr(search, "_settled_at", at_scale)
    after = search.explained(before)
    assert after.error_scale == (2.0 if more > 0 else 1.0) * before.error_scale
    assert after.evidence == pytest.approx(before.evidence + max(more, 0.0))


def test_a_set_that_cannot_be_leaves_nothing_to_what_is_refitted_after_it():
    X = smooth_columns(2)
    bench = linear_bench(X, [1.5, 0.6], SD)
    search = together(bench, [cause(0, low=-1.0, high=1.0), cause(1)])
    both, second = np.array([True, True]), np.array([False, True])
    beyond = search.settled(search.problem.begin(), 1.0, search.variance(both), included=both)
    assert beyond.evidence == -np.inf  # the size of the first lies beyond its bound
    rest = search.refitted(beyond, second)
    assert np.isfinite(rest.evidence)
    assert rest.evidence == rest.error_evidence + rest.cause_evidence


def test_what_an_abrupt_cause_hid_is_refitted_once_it_is_taken_away():
    """The steering acts as late as the later of two says: beside one, the derivative by the other one is none."""
    X = smooth_columns(1)
    bench = GivenBench(lambda p: X[:, :, 0] * max(p[0], p[1]), X[:, :, 0] * 0.8, 2)
    search = together(bench, [cause(0, low=0.0), cause(1, gradual=False, low=0.0)])
    both, first = np.array([True, True]), np.array([True, False])
    state = replace(search.problem.begin(), m=np.array([0.3, 0.8]), on=np.array([False, True]))
    whitener = search.whitening.usual(None, 1.0)
    state, quadratic = search._linear(state, whitener, False, search.variance(both))
    stage = JointStage(1.0, state, both, whitener, quadratic, search._sets(quadratic), 0.0)
    assert search.refitted(stage, first).state.m[0] == pytest.approx(0.8, abs=0.01)


@pytest.mark.parametrize(("truth", "left"), [((0.0, 0.0, 0.7), {2}), ((1.0, 0.6, 0.7), {0, 1, 2})])
def test_two_that_undo_each_other_leave_together(truth, left):
    """Each of the two is needed beside the other, and neither where both are away."""
    X = smooth_columns(3)
    X[:, :, 1] = -(0.97 * X[:, :, 0] + 0.24 * X[:, :, 1])
    search = together(linear_bench(X, truth, SD), [cause(k) for k in range(3)])
    every = np.ones(3, dtype=bool)
    apart = replace(search.problem.begin(), m=np.array([truth[0] + 1.0, truth[1] + 1.0, truth[2]]))
    stage = search.settled(apart, 1.0, search.variance(every), included=every)
    without = search._without_both(stage, np.full(3, 8.0), set())
    assert set(np.flatnonzero((without or stage).included)) == left
    assert search._without_both(stage, np.full(3, 8.0), {(0, 1)}) is None


def test_what_is_not_simulated_makes_up_for_no_more_than_it_may_without_being_simulated():
    """At its best, a column that was taken elsewhere would pass for an explanation of any simulation."""
    X = smooth_columns(2)
    search = together(linear_bench(X, [0.0, 0.0], SD), [cause(0), cause(1, gradual=False)])
    problem, included = search.problem, np.array([True, False])
    whitener, variance = search.whitening.usual(None, 1.0), search.variance(included)
    _, quadratic = search._linear(problem.begin(), whitener, True, variance)
    prec, linear = quadratic.precision(variance), quadratic.about
    first = FirstOrder(quadratic, prec, search.steps.switched_at, np.zeros(2, dtype=bool))
    column = linear.A[:, linear.main][:, 1]
    (left,) = first.left((linear.r + 0.7 * column)[:, None])  # a simulation that is off by what 0.7 of it would explain
    sizes = np.linspace(-1.0, 1.0, 4001)[:, None] * search.steps.switched_at[1]
    best = np.min(np.sum((linear.r + (0.7 + sizes) * column) ** 2, axis=1) + prec[linear.main][1] * sizes[:, 0] ** 2)
    assert left == pytest.approx(best, rel=1e-6)
    assert left > 0.5 * np.sum((linear.r + 0.7 * column) ** 2)
    simulated = FirstOrder(quadratic, prec, search.steps.switched_at, np.array([False, True]))
    assert simulated.left(linear.r[:, None]) == pytest.approx([float(linear.r @ linear.r)])


def test_what_gained_far_more_than_it_must_is_asked_once_nothing_else_leaves(monkeypatch):
    X, every = smooth_columns(3), np.ones(3, dtype=bool)
    search = together(linear_bench(X, [1.0, 0.6, 0.0], SD), [cause(k) for k in range(3)])
    stage = search.settled(search.problem.begin(), 1.0, search.variance(every), included=every)
    asked, gained = [], search._gained
    monkeypatch.setattr(search, "_gained", lambda stage, k, price: asked.append(k) or gained(stage, k, price))
    prices, unsteady, nothing = np.full(3, 8.0), np.zeros(3), np.zeros(3)
    before = search._gains(stage, prices, unsteady, nothing)
    assert asked == [0, 1, 2]
    assert before[2] < 8.0 < before[1]
    asked.clear()
    assert search._gains(stage, prices, unsteady, before) == pytest.approx(before)
    assert asked == [2]
    asked.clear()
    rest = search.refitted(stage, before >= prices)
    search._gains(rest, prices, unsteady, before)
    assert asked == [0, 1]


def test_a_stage_whose_gains_are_known_is_not_refitted_to_learn_them_again(monkeypatch):
    X, nothing, prices = smooth_columns(3), np.zeros(3), np.full(3, 8.0)
    search = together(linear_bench(X, [1.0, 0.6, 0.5], SD), [cause(k) for k in range(3)])
    every = np.ones(3, dtype=bool)
    stage = search.settled(search.problem.begin(), 1.0, search.variance(every), included=every)
    stage, gains = search.pruned(stage, prices, nothing, nothing)
    assert np.all(gains > prices)
    before = search.problem.simulations
    again, same = search.pruned(stage, prices, nothing, gains)
    assert (again is stage, search.problem.simulations) == (True, before)
    np.testing.assert_array_equal(same, gains)
    unsteady = np.array([0.0, 0.0, 1.0])  # so that no gain is above a half
    later, _ = search.pruned(stage, prices, unsteady, gains)
    assert later.included.tolist() == [True, True, False]
    assert search._worth_adding(later, prices, nothing, np.zeros(3, dtype=bool)) == 2
    assert search._worth_adding(later, prices, unsteady, np.zeros(3, dtype=bool)) is None


@pytest.mark.parametrize(("off", "returns"), [(1e6, True), (0.0, False)])
def test_a_cause_returns_if_all_else_costs_less_without_it(monkeypatch, off, returns):
    """Beside too many causes, a refit ended far from its optimum, and a cause that was there seemed to gain nothing."""
    search = together(linear_bench(smooth_columns(3), [1.0, 0.6, 0.5], SD), [cause(k) for k in range(3)])
    every = np.ones(3, dtype=bool)
    stage = search.settled(search.problem.begin(), 1.0, search.variance(every), included=every)
    far, gained, asked = copy(stage.sets), search._gains, list[JointStage]()
    monkeypatch.setattr(far, "cost", lambda included: stage.sets.cost(included) + off, raising=False)

    def gains(stage, prices, unsteady, before):
        asked.append(stage)
        return np.array([50.0, 0.0, 50.0]) if len(asked) == 1 else gained(stage, prices, unsteady, before)

    monkeypatch.setattr(search, "_gains", gains)
    monkeypatch.setattr(search, "_converged", lambda stage: stage)
    found, _ = search.pruned(replace(stage, sets=far), np.full(3, 8.0), np.zeros(3), np.zeros(3))
    assert found.included.tolist() == [True, returns, True]


def test_a_refit_on_trial_ends_once_its_scores_decide():
    X, every = smooth_columns(2), np.ones(2, dtype=bool)
    search = together(linear_bench(X, [1.0, 0.6], SD), [cause(0), cause(1, gradual=False)])
    stage = search.settled(search.problem.begin(), 1.0, search.variance(every), included=every)
    asked, without = list[float](), np.array([True, False])

    def decided(sets):
        asked.append(sets.cost(without))
        return True

    tried = search.refitted(stage, without, trial=True, decided=decided)
    assert asked == [tried.sets.cost(without)]


def test_a_step_that_gains_next_to_nothing_is_neither_taken_nor_linearised_about(monkeypatch):
    X, every = smooth_columns(2), np.ones(2, dtype=bool)
    search = together(linear_bench(X, [1.0, 0.6], SD), [cause(0), cause(1)])
    stage = search.settled(search.problem.begin(), 1.0, search.variance(every), included=every)
    about, linearise = [], search.problem.linearise
    monkeypatch.setattr(
        search.problem, "linearise", lambda state, *more: about.append(state) or linearise(state, *more)
    )
    without = search.refitted(stage, np.array([True, False]), CAL.exchange_steps)
    assert about == [without.state]  # the first step leads to the optimum of what is linear
    again = search.refitted(without, without.included, CAL.exchange_steps)
    assert about[1:] == [again.state]  # what is not simulated is looked at anew


def test_what_gains_too_little_is_refitted_to_the_end(monkeypatch):
    """How far causes are from their prices says which of them leave first."""
    X, every = smooth_columns(2), np.ones(2, dtype=bool)
    search = together(linear_bench(X, [1.0, 0.6], SD), [cause(0), cause(1, gradual=False)])
    stage = search.settled(search.problem.begin(), 1.0, search.variance(every), included=every)
    here, asked = stage.sets.cost(every), list[bool]()

    def refitted(stage, included, *, trial, decided):
        for gain in (3.0, 2.5, 9.0, 60.0, 60.0):
            asked.append(decided(SimpleNamespace(cost=lambda _, gain=gain: here + gain)))
        return stage

    monkeypatch.setattr(search, "refitted", refitted)
    search._gained(replace(stage, state=replace(stage.state, m=np.array([1.0, 0.6]))), 1, 8.0)
    assert asked == [False, False, False, False, True]


def test_a_cause_is_worth_adding_whatever_size_it_was_looked_at():
    """Where it was looked at, a size is bounded; refits say what it is beyond."""
    X = smooth_columns(2)
    small = replace(
        cause(1, gradual=False, low=0.0), forms=(Form(cause(1, low=0.0).forms[0].candidate, (), ((0.1,),)),)
    )
    search = together(linear_bench(X, [1.0, 0.9], SD), [cause(0), small])
    first = np.array([True, False])
    stage = search.settled(search.problem.begin(), 1.0, search.variance(first), included=first)
    assert stage.sets.score(np.ones(2, dtype=bool)) == -np.inf
    assert search._worth_adding(stage, np.full(2, 8.0), np.zeros(2), np.zeros(2, dtype=bool)) == 1


@pytest.mark.parametrize(("size", "slope"), [(0.6, 1.2), (0.4, 0.8), (0.2, 0.4)])
def test_the_derivative_of_a_delay_is_of_both_sides(size, slope):
    """One to its one side tells what it does a row later, and may lead uphill; at none readings jump."""
    X = smooth_columns(1)

    def respond(p):  # with its square, and with a jump where there is one at all
        return X[:, :, 0] * (p[0] ** 2 + (5.0 if p[0] > 0 else 0.0))

    bench = GivenBench(respond, respond([0.5]), 1, dt=0.5)
    search = together(bench, [cause(0, gradual=False, low=0.0, high=0.7, shift=True)])
    state = replace(search.problem.begin(), m=np.array([size]), on=np.array([True]))
    whitener = search.whitening.usual(None, 1.0)
    _, linear = search.problem.linearise(state, whitener, False, np.ones(1))
    width = min(0.25, 0.9 * size)
    beyond = max(size + width - 0.7, 0.0)  # one side ends at the bound
    column = whitener.white(X).reshape(-1)
    assert linear.A[:, 0] == pytest.approx(column * (slope - beyond), rel=1e-9)


def test_a_step_goes_no_further_than_what_is_usual():
    """Steps of many usual sizes lead to where simulations are nothing like what they are to first order."""
    X = smooth_columns(2)
    search = together(linear_bench(X, [5.0, 0.0], SD), [cause(0), cause(1)], (axis(1, sd=0.3),))
    problem, every = search.problem, np.ones(2, dtype=bool)
    whitener, variance = search.whitening.usual(None, 1.0), search.variance(every)
    state, far = problem.begin(), []
    for _ in range(8):
        state, quadratic = search._linear(state, whitener, False, variance)
        step = search.steps.taken(state, quadratic, variance, whitener, every)
        state = step.state
        far.append(step.length)
    assert max(far) == pytest.approx(CAL.strides[0])
    assert far[-1] < CAL.still
    assert state.m[0] == pytest.approx(5.0, abs=0.1)


def stepped(search, state, variance, included):
    """The state after a step."""
    whitener = search.whitening.usual(None, 1.0)
    state, quadratic = search._linear(state, whitener, True, variance)
    return search.steps.taken(state, quadratic, variance, whitener, included).state


def bent_bench(at):
    """The second coordinate acts with its exponential, and its columns are nearly those of the first."""
    X = smooth_columns(3)
    X[:, :, 1] = 0.98 * X[:, :, 0] + 0.02 * X[:, :, 1]

    def respond(p):
        return X[:, :, 0] * p[0] + X[:, :, 1] * np.expm1(np.minimum(6 * p[1], 30.0)) / 6 + X[:, :, 2] * p[2]

    return GivenBench(respond, respond(np.array(at)) + SD * np.random.default_rng(3).standard_normal((400, 2)), 3)


def test_where_a_whole_step_overshoots_a_damped_one_still_gains():
    """Of what two coordinates do alike, a whole Gauss-Newton step makes much of both; that is nothing like it."""
    search = together(bent_bench([0.4, 0.0, 0.3]), [cause(k) for k in range(3)])
    search = search.by_steps(50.0)
    begin = replace(search.problem.begin(), m=np.array([0.0, -0.6, 0.0]))
    every = np.ones(3, dtype=bool)
    variance = np.full(3, 1e4)
    state, costs = begin, []
    for _ in range(12):
        (e,) = search.problem.residuals([search.problem.vector(state)])
        costs.append(0.5 * float(np.sum((e / SD) ** 2)))
        state = stepped(search, state, variance, every)
    assert all(b <= a + 1e-6 for a, b in zip(costs, costs[1:], strict=False))
    assert costs[-1] == pytest.approx(400.0, rel=0.1)  # what noise alone leaves of 800 readings


def test_a_step_goes_where_all_is_best_beside_as_little_of_what_is_not_simulated_as_there_may_be():
    X = smooth_columns(2)
    X[:, :, 1] = 0.95 * X[:, :, 0] + 0.3 * X[:, :, 1]
    search = together(linear_bench(X, [0.5, 1.0], SD), [cause(0), cause(1, gradual=False)])
    begin, first = replace(search.problem.begin(), m=np.array([1.2, 0.0])), np.array([True, False])
    state = stepped(search, begin, np.ones(2), first)
    at, rest = X[:, :, 0].ravel(), X[:, :, 1].ravel() * (1.0 - search.steps.switched_at[1])
    assert state.m[0] == pytest.approx(0.5 + float(at @ rest) / float(at @ at), abs=0.05)


@pytest.mark.parametrize(("gain", "simulated"), [(1.0, True), (-1.0, False)])
def test_what_a_known_set_has_is_simulated_as_soon_as_that_lowers_its_own_objective(gain, simulated, monkeypatch):
    """Not simulated it is as large as is best to first order, which may explain more than it can."""
    search = together(linear_bench(smooth_columns(2), [0.5, 1.0], SD), [cause(0), cause(1, gradual=False)])
    steps = len(CAL.dampings)
    objectives = iter([[10.0, *[10.0 - gain] * steps], [5.0, *[3.0] * steps]])
    monkeypatch.setattr(search.steps, "_objectives", lambda *_: next(objectives))
    state = stepped(search, search.problem.begin(), np.ones(2), np.ones(2, dtype=bool))
    assert state.on[1] == simulated


TOLERATED = (axis(0, sd=0.1),)


def searched(tolerances=TOLERATED, off=0.15):
    bench = linear_bench(smooth_columns(4), [off, 1.0, -0.6, 0.0], SD)
    return together(bench, [cause(k) for k in range(1, 4)], tolerances)


def test_walks_that_end_in_the_same_place_dispute_nothing():
    stage, disputed = walked(searched())
    assert list(stage.included) == [True, True, False]
    assert list(disputed) == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("far", [(), (0,), (1, 2)])
def test_a_cause_that_is_not_alike_in_both_must_gain_what_they_differ_by(far, monkeypatch):
    """The first walk ends 40 nats below, with other causes, or with one of another size: the second one counts."""
    search = searched()
    walk = JointSearch.annealed

    def annealed(walker):
        stages = walk(walker)
        if walker.steps.stride != CAL.strides[0]:
            return stages
        included = stages[-1].included.copy()
        included[list(far)] = ~included[list(far)]
        sets = stages[-1].sets
        lower = sets.base + sets.score(stages[-1].included) - 40.0 - sets.score(included)
        monkeypatch.setattr(sets, "base", lower)
        return [replace(stages[-1], included=included)]

    monkeypatch.setattr(JointSearch, "annealed", annealed)
    stage, disputed = walked(search)
    assert list(stage.included) == [True, True, False]
    assert list(np.flatnonzero(disputed)) == list(far)
    assert disputed[list(far)] == pytest.approx(40.0, abs=0.5)


@pytest.mark.parametrize(("further", "disputed"), [(0.02, []), (0.1, []), (0.5, [0])])
def test_a_size_that_is_another_one_is_disputed(further, disputed, monkeypatch):
    """Sizes may differ as they may between parts of a drive, however surely each is known."""
    search = searched()
    walk = JointSearch.annealed

    def annealed(walker):
        stages = walk(walker)
        if walker.steps.stride == CAL.strides[0]:
            return stages
        sets, included = stages[-1].sets, stages[-1].included
        sizes, sds = sets.sizes(included)
        monkeypatch.setattr(sets, "base", sets.base - 7.0)
        monkeypatch.setattr(sets, "sizes", lambda _: (sizes + np.array([further, 0.0, 0.0]), sds))
        return stages[-1:]

    monkeypatch.setattr(JointSearch, "annealed", annealed)
    assert list(np.flatnonzero(walked(search)[1])) == disputed


@pytest.mark.parametrize(("tolerances", "off", "walks"), [((), 0.15, 1), (TOLERATED, 0.05, 1), (TOLERATED, 0.15, 2)])
def test_a_second_walk_is_for_tolerances_that_are_further_off_than_stated(tolerances, off, walks, monkeypatch):
    search = searched(tolerances, off)
    walk, strides = JointSearch.annealed, []
    monkeypatch.setattr(JointSearch, "annealed", lambda self: strides.append(self.steps.stride) or walk(self))
    _, disputed = walked(search)
    assert strides == list(CAL.strides[:walks])
    assert not np.any(disputed)


def test_latencies_of_the_same_readings_are_never_there_together():
    """They are one, and would share its size; of other readings they may be two."""
    bench = linear_bench(smooth_columns(3), np.zeros(3), SD)

    def latency(k, *reads):
        plain = cause(k, gradual=False, shift=True)
        late = replace(plain.forms[0].candidate, reads=frozenset(reads))
        return replace(plain, forms=(replace(plain.forms[0], candidate=late),))

    def alike(*of_each):
        return together(bench, [latency(k, *map(bench.channels.__getitem__, of)) for k, of in enumerate(of_each)])

    assert alike([0], [1]).late_alike == []
    assert alike([0], [0, 1]).late_alike == []
    assert alike([0, 1], [0], [0, 1]).never == [(0, 2)]
    bench.measured[:, 1], bench.counted[:, 1] = np.nan, False  # nobody reads what else one of them delays
    assert alike([0], [0, 1]).late_alike == [(0, 1)]
