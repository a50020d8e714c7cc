"""A diagnosis of recordings from an independent simulator: what is there is found, and nothing where nothing is."""

import json
from dataclasses import replace
from math import nan
from types import SimpleNamespace

import numpy as np
import pytest
from calling import greybox
from driven import without, written
from gap_cases import (
    CAR,
    NOISE,
    NUMBERS,
    GivenBench,
    alone,
    axis,
    candidate,
    lap,
    lateral_lap,
    linear_bench,
    nominal,
    search_on,
    smooth_columns,
)  # fmt: skip
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from greybox_id.base.errors import BadInput
from greybox_id.gap import budget, diagnosis, judging
from greybox_id.gap.closed_model import HARMS
from greybox_id.gap.diagnosis import _ranking_keys, diagnose
from greybox_id.gap.estimation.calibration import CAL
from greybox_id.gap.estimation.constancy import Spread
from greybox_id.gap.estimation.hypothesis import Start
from greybox_id.gap.estimation.model_error import amplitude_prior
from greybox_id.gap.estimation.refit import refit
from greybox_id.gap.gap import Budget, Ranked, Share, Unnamed
from greybox_id.gap.judging import _beside_unknown, _strains, may_vary, misnamed_probability, unnamed_probability
from greybox_id.models.effects import EFFECTS, vocabulary
from greybox_id.models.parameter import Stated
from greybox_id.models.registry import build
from greybox_id.models.vehicle import Vehicle
from greybox_id.reports.gap.words import REGIMES, whether

TOLERANT = Vehicle("car", {**NUMBERS, "I_z": Stated(2274.0, 40.0), "B_f": Stated(9.3, 0.3), "B_r": Stated(10.5, 0.3),
                           "c_0": Stated(208.0, 20.0)}, {"steering_ratio": Stated(sd=0.01)}, NOISE)  # fmt: skip
WITHIN = {"I_z": 2310.0, "B_f": 9.5, "B_r": 10.3, "c_0": 225.0}
"""Off by about one standard deviation."""


def diagnosed(recordings, vehicle=CAR, model="single_track", **options):
    own = recordings if isinstance(recordings, list) else [recordings]
    return diagnose(nominal(model, vehicle=vehicle), own, vocabulary(), vehicle=vehicle, **options)


def told(gap, effect, truth, within=0.03):
    """The effect comes first, alone or with its aliases, at its magnitude."""
    assert gap.gap_detected
    first = gap.ranking[0]
    assert effect in (first.effect, *first.indistinguishable_from), gap.ranking[:3]
    own = next(each for each in gap.ranking if each.effect == effect)
    low, high = own.interval
    assert low <= own.magnitude <= high
    assert low <= truth <= high or own.magnitude == pytest.approx(truth, rel=within)
    return own


@pytest.fixture(scope="module")
def delayed():
    """A late steering, diagnosed once, with a lap held out."""
    return diagnosed(lap({"steering_delay": 0.05}, 20.0), held_out=[lap({"steering_delay": 0.05}, 10.0, seed=7)])


@pytest.fixture(scope="module")
def clean():
    """A vehicle that lacks nothing."""
    return diagnosed(lap(seconds=20.0))


# ---- one of each, in every run


def test_without_an_effect_there_is_no_gap(clean):
    assert not clean.gap_detected
    assert clean.held == ""
    assert clean.applied == ()
    assert clean.p_value > 0.01
    assert clean.unknown_probability < 0.1
    assert clean.where.channel == ""
    assert clean.gap.closed == 0.0
    assert clean.gap.after == pytest.approx(1.0, abs=0.05)
    assert all(own.probability < 0.3 for own in clean.ranking)


def test_what_a_recording_does_not_excite_is_told_with_its_unit(clean):
    for name, size in clean.not_excited.items():
        assert name in EFFECTS
        assert size.startswith("±")


def test_what_would_show_of_effects_is_told_the_least_visible_first(clean, delayed):
    assert len(clean.limits) > 25
    shares = [own.share for own in clean.limits.values()]
    assert shares == sorted(shares, reverse=True)
    for name, own in clean.limits.items():
        assert own.unit == EFFECTS[name].parameter.unit
        assert own.typical == EFFECTS[name].typical
        assert 0 <= own.told <= 1 + 1e-9
    bias = clean.limits["yaw_rate_bias"]
    assert bias.size == pytest.approx(bias.typical * bias.share)
    assert "steering_delay" not in delayed.limits


@pytest.mark.slow
def test_an_effect_shows_well_above_its_limit_and_hides_well_below(clean):
    limit = clean.limits["yaw_rate_bias"].size
    assert diagnosed(lap({"yaw_rate_bias": 5 * limit}, 20.0)).applied == ("yaw_rate_bias",)
    assert diagnosed(lap({"yaw_rate_bias": 0.2 * limit}, 20.0)).applied == ()


def test_a_late_steering_is_found_with_its_delay(delayed):
    own = told(delayed, "steering_delay", 0.05)
    assert delayed.ranking[0].effect == "steering_delay"
    assert own.probability > 0.9
    assert own.unit == "s"
    assert delayed.applied == ("steering_delay",)
    assert delayed.p_value < 1e-6
    assert delayed.unknown_probability < 0.5
    assert delayed.where.regime == "transient"
    assert max(delayed.where.equations, key=delayed.where.equations.get) == "steering"


def test_the_gap_closes_on_a_lap_that_chose_nothing(delayed):
    held = delayed.held_out
    assert held.recordings == ("lap7",)
    assert held.closed == pytest.approx(1.0, abs=0.05)
    assert held.closed_interval[0] <= held.closed <= held.closed_interval[1]
    assert held.after == pytest.approx(1.0, abs=0.1)
    assert delayed.gap.closed == pytest.approx(1.0, abs=0.05)
    assert delayed.budget.unnamed.share == pytest.approx(1.0 - held.closed, abs=1e-9)  # one page, one answer


def test_the_closed_model_is_the_nominal_one_with_the_effect(delayed):
    model = delayed.closed
    assert model.effects == ("steering_delay",)
    assert float(model["steering_delay"].array) == pytest.approx(0.05, rel=0.03)
    before = nominal()
    for parameter in before.parameters:
        np.testing.assert_array_equal(model[parameter.name].array, parameter.array)


def test_where_free_runs_spin_it_is_said_what_was_looked_at_in_their_place():
    soft = Vehicle("car", {**NUMBERS, "B_r": Stated(2.0)}, noise=NOISE)
    names = ("steering_offset", "yaw_rate_bias", "wheel_speed_scale")
    found = diagnose(nominal(vehicle=soft), [lap(seconds=12.0)], {n: EFFECTS[n] for n in names}, vehicle=soft)
    assert "Free runs of this model spin" in found.held
    assert "within 0.12 s" in whether(found)


@pytest.mark.slow
def test_what_has_no_name_is_not_closed_by_its_neighbours():
    others = {name: own for name, own in vocabulary().items() if own.group != "steering"}
    there = {"steering_backlash": 0.02}
    gap = diagnose(nominal(), [lap(there, 20.0)], others, vehicle=CAR, held_out=[lap(there, 10.0, seed=7)])
    assert gap.gap_detected
    assert gap.unknown_probability > 0.5
    assert gap.applied == ()
    assert gap.ranking  # the nearest names are told, and why they are none
    assert max(own.probability for own in gap.ranking) < 0.5
    assert any("mimics" in own.reason or "differs between parts" in own.reason for own in gap.ranking)
    if gap.budget is not None:  # there is none where no name is left to share it out among
        assert gap.budget.held_out
        assert sum(own.share for own in gap.budget.shares) + gap.budget.unnamed.share == pytest.approx(1.0)
    assert gap.held_out.closed == 0.0
    assert gap.gap.closed == 0.0
    assert gap.gap.after == gap.gap.before > 1.0
    assert gap.closed.parameters == nominal().parameters


@pytest.mark.slow
def test_where_more_than_half_surely_stays_something_unknown_is_at_work(monkeypatch):
    late = {"steering_delay": 0.05}
    shares = Share("steering_delay", 0.3, 0.2, 0.4), Share("unnamed", 0.7, 0.6, 0.8)
    left = Budget(shares[:1], shares[1], ("lap",), True, beside=shares[:1])
    monkeypatch.setattr(diagnosis, "shared_out", lambda *_: left)
    gap = diagnosed(lap(late, 20.0), held_out=[lap(late, 10.0, seed=7)])
    assert gap.applied == ("steering_delay",)
    assert gap.unknown_probability >= CAL.nameless


@pytest.mark.slow
@pytest.mark.parametrize(("closed", "applied"), [(0.04, ()), (0.3, ("steering_delay",))])
def test_names_that_close_next_to_nothing_held_out_are_no_causes(monkeypatch, closed, applied):
    late = {"steering_delay": 0.05}
    share, rest = Share("steering_delay", closed, closed - 0.01, closed + 0.01), 1.0 - closed
    left = Budget((share,), Share("unexplained", rest, rest - 0.01, rest + 0.01), ("lap",), True, beside=(share,))
    monkeypatch.setattr(diagnosis, "shared_out", lambda *_: left)
    gap = diagnosed(lap(late, 20.0), held_out=[lap(late, 10.0, seed=7)])
    assert gap.applied == applied
    if not applied:
        assert "all named effects together remove 4 %" in gap.ranking[0].reason
        assert gap.budget is None


@pytest.mark.parametrize(
    ("held", "exact", "closed", "none"),
    [(True, False, 0.04, True), (False, True, 0.04, False), (False, True, 0.01, True), (False, False, -0.1, False)],
)
def test_how_little_names_may_close_depends_on_what_tells(held, exact, closed, none):
    rest = Share("unexplained", 1.0 - closed, 0.9, 1.0)
    assert bool(judging.closes_too_little(Budget((), rest, ("lap",), held), exact)) == none


@pytest.mark.slow
@pytest.mark.parametrize(
    ("vehicle", "held", "judged"),
    [(CAR, True, True), (TOLERANT, False, True), (CAR, False, False)],
    ids=["held out", "tolerances are stated", "every number is exact, nothing held out"],
)
def test_a_name_that_closes_nothing_leaves_before_the_others_are_judged(monkeypatch, vehicle, held, judged):
    lacks = {"steering_delay": 0.05, "yaw_rate_bias": 0.02}

    def shares(examined, best, *_):
        closes = {"yaw_rate_bias": -0.3} if len(best.names) == 2 else {}
        each = tuple(Share(name, own := closes.get(name, -0.05 if closes else 0.9), own - 0.1, own + 0.1)
                     for name in best.names)  # fmt: skip
        return Budget(each, Share("unnamed", 0.1, 0.0, 0.2), ("lap",), held, beside=each)

    monkeypatch.setattr(diagnosis, "shared_out", shares)
    gap = diagnosed(lap(lacks, 25.0), vehicle, held_out=[lap(lacks, 10.0, seed=7)] if held else ())
    assert set(gap.applied) == ({"steering_delay"} if judged else set(lacks))
    if judged:
        assert "−30 %" in next(each.reason for each in gap.ranking if each.effect == "yaw_rate_bias")


@pytest.mark.slow
def test_of_many_names_what_is_left_is_shared_out_again(monkeypatch):
    """Where one has left, nothing was made of the others alone before."""
    lacks = {"steering_delay": 0.05, "yaw_rate_bias": 0.02}
    monkeypatch.setattr(budget, "CAL", replace(CAL, few=0))  # as where they are more than three
    plain = diagnosis.shared_out

    def shares(examined, best, *others):
        result = plain(examined, best, *others)
        if len(best.names) == 1:
            return result
        worse = {"yaw_rate_bias": -0.3, "steering_delay": -0.1}  # surely: intervals contain no effect that closes
        each = tuple(
            replace(share, share=worse[share.effect], high=worse[share.effect] + 0.05) for share in result.shares
        )
        return replace(result, shares=each, beside=each)

    monkeypatch.setattr(diagnosis, "shared_out", shares)
    gap = diagnosed(lap(lacks, 25.0), TOLERANT)
    assert gap.applied == ("steering_delay",)
    assert gap.budget.shares[0].share + gap.budget.unnamed.share == pytest.approx(1.0)
    assert gap.gap.closed == pytest.approx(gap.budget.shares[0].share, abs=0.01)  # of what is applied, not of both


@pytest.mark.slow
def test_what_harms_predictions_held_out_leaves_one_by_one_the_weakest_first(monkeypatch):
    lacks = {"steering_delay": 0.05, "yaw_rate_bias": 0.02}
    plain, tried = diagnosis.closed_model, []

    def closed_model(examined, best, *others):
        tried.append(best.names)
        closed, verified, worse = plain(examined, best, *others)
        return closed, verified, worse or (HARMS if len(best.names) == 2 else "")

    monkeypatch.setattr(diagnosis, "closed_model", closed_model)
    gap = diagnosed(lap(lacks, 20.0), held_out=[lap(lacks, 10.0, seed=7)])
    gains = {each.effect: each.gain for each in gap.ranking}
    assert [set(names) for names in tried] == [set(lacks), {max(lacks, key=gains.get)}]
    assert gap.applied == (max(lacks, key=gains.get),)
    assert next(each.reason for each in gap.ranking if each.effect not in gap.applied and each.effect in lacks)


@pytest.mark.slow
def test_what_is_there_rather_than_not_stays_while_causes_are_judged_and_is_no_part_of_what_closes(monkeypatch):
    lacks = {"steering_delay": 0.05, "yaw_rate_bias": 0.02}
    plain, shared = diagnosis.shared_out, []

    def shared_out(examined, best, *others):
        shared.append(set(best.names))
        return plain(examined, best, *others)

    def insignificant(examined, ways, level):
        return {"yaw_rate_bias": "its size may be none"} if level < 0.5 else {}, {}

    monkeypatch.setattr(diagnosis, "shared_out", shared_out)
    monkeypatch.setattr(diagnosis, "insignificant", insignificant)
    gap = diagnosed(lap(lacks, 20.0))
    assert gap.applied == ("steering_delay",)
    assert shared == [set(lacks), {"steering_delay"}]
    assert [share.effect for share in gap.budget.shares] == ["steering_delay"]
    assert next(each.reason for each in gap.ranking if each.effect == "yaw_rate_bias") == "its size may be none"


def test_a_size_must_surely_be_one_beside_all_others_and_without_those_that_leave(monkeypatch):
    """Of 40 absent effects, one reaches 3.23 sd in a twentieth of all cases, and 2.50 sd in half of them."""
    parts = [(candidate(k), slice(k, k + 1)) for k in range(3)]
    names = [each.effect for each, _ in parts]

    def left(m, V, count=40, gain=0.0, level=CAL.by_chance):
        monkeypatch.setattr(judging, "gain_of", lambda *_: gain)
        best = SimpleNamespace(parts=parts, m=np.array(m), names=tuple(names), candidates=[each for each, _ in parts])
        sizes = judging.KnownSizes(np.array(V), np.full(3, 2.0))
        prepared = SimpleNamespace(effects=dict.fromkeys(range(count)))
        return judging.insignificant(SimpleNamespace(prepared=prepared, best=best), sizes, level)[0]

    assert left([3.4, -3.3, 9.0], np.eye(3)) == {}
    assert left([3.4, -3.22, 9.0], np.eye(3)) == {}  # beside two that are sure
    assert list(left([3.4, -3.19, 9.0], np.eye(3))) == [names[1]]
    assert list(left([3.4, -3.4, 3.4], np.eye(3), count=80)) == names
    assert list(left([3.4, -2.3, 9.0], np.eye(3))) == [names[1]]
    assert left([2.0, -2.3, 9.0], np.eye(3), count=1) == {}
    assert left([3.4, -2.5, 9.0], np.eye(3), level=0.5) == {}  # rather there than not
    alike = [[1.0, 0.9, 0.0], [0.9, 1.0, 0.0], [0.0, 0.0, 1.0]]
    assert list(left([3.4, -1.0, 9.0], alike)) == [names[1]]
    assert list(left([2.0, -1.0, 9.0], alike)) == names[:2]  # without the one, the other does what that one did
    assert list(left([3.6, 3.1, 9.0], alike)) == [names[1], names[0]]  # 1.9 sd without the other
    parts[1] = replace(parts[1][0], gradual=False), parts[1][1]
    assert list(left([3.4, -1.0, 9.0], np.eye(3), gain=12.0)) == [names[1]]
    assert left([3.4, -1.0, 9.0], np.eye(3), gain=24.0) == {}  # a limit, to whose none no slope leads: sqrt(48) / 2
    assert left([3.4, -3.3, 9.0], np.eye(3)) == {}
    parts[1] = replace(parts[1][0], gradual=True), parts[1][1]
    assert list(left([3.4, -1.0, 9.0], np.eye(3), gain=24.0)) == [names[1]]
    parts[1] = replace(parts[1][0], axes=(*parts[1][0].axes, axis(9))), parts[1][1]
    assert left([3.4, -1.0, 9.0], np.eye(3), gain=24.0) == {}  # it acts through a second parameter


def test_pictures_show_the_errors_that_the_closure_counts(monkeypatch):
    """They once showed errors before tolerances were refitted to free runs: larger with the causes than without."""
    drawn, plain = [], diagnosis.Examined.at_its_best

    def at_its_best(examined, hypothesis):
        return replace(plain(examined, hypothesis), e=np.full_like(hypothesis.e, 2.0 if hypothesis.names else 3.0))

    def strip(bench, before, after, *_):
        drawn.extend(set(np.unique(each)) - {0.0} for each in (before, after))

    monkeypatch.setattr(diagnosis.Examined, "at_its_best", at_its_best)
    monkeypatch.setattr(diagnosis, "strip", strip)
    assert diagnosed(lap({"steering_delay": 0.04}, 20.0)).applied == ("steering_delay",)
    assert drawn == [{3.0}, {2.0}]


def once_one_has_left(*truth):
    """What is examined, with a best explanation by three effects, and the same without the third, refitted."""
    sd = np.array([0.1, 0.4])
    search = search_on(linear_bench(smooth_columns(3), [*truth], sd), sd)
    base, effects = search.at_means(), tuple(candidate(k) for k in range(3))
    whole, part = refit(search, [Start(effects[:n], np.zeros(n), base.theta, base.linear) for n in (3, 2)])
    offered = [SimpleNamespace(candidate=each) for each in effects]
    selection = SimpleNamespace(search=search, expected_gains=offered, base=base)
    return SimpleNamespace(selection=selection, best=whole, unnamed=None), part


def test_a_cause_that_was_needed_beside_those_that_left_leaves_with_them():
    """A limit took back what a gain beside it did: once the gain was refused, the limit had nothing to explain."""
    examined, part = once_one_has_left(0.8, 0.0, 0.0)
    search, whole = examined.selection.search, examined.best
    best, reasons = judging.superfluous(examined, part)
    assert best.names == ("effect_0",)
    assert best.cost == pytest.approx(refit(search, [alone(search, candidate(0))])[0].cost)
    assert list(reasons) == ["effect_1"]
    assert reasons["effect_1"].startswith("without effect_2, it raises the log-likelihood by ")
    assert judging.superfluous(examined, whole) == (whole, {})  # none has left


def test_without_some_effects_refits_begin_where_the_car_does_not_spin_either():
    """Beside all effects, tolerances stood where the car spins without one of these: a true cause came out as none."""
    X, sd = smooth_columns(3), np.array([0.1, 0.4])

    def respond(p):
        y = X @ np.array([p[0], p[1], 0.01 * p[2]])
        return y if p[2] < 1.0 + 10.0 * p[1] else np.full_like(y, 1e6)

    bench = GivenBench(respond, X @ np.array([0.8, 0.0, 0.0]), 3)
    search = search_on(bench, sd, (axis(2, sd=1.0),))
    base, effects = search.at_means(), (candidate(0), candidate(1))
    (whole,) = refit(search, [Start(effects, np.array([0.8, 0.5]), np.array([3.0]), base.linear)])
    far = replace(whole, m=np.array([0.8, 0.5]), theta=np.array([3.0]))
    examined = SimpleNamespace(selection=SimpleNamespace(search=search, base=base), best=far)
    best = judging.restricted_to(examined, {"effect_0"})
    assert best.m[0] == pytest.approx(0.8, abs=1e-3)
    assert best.cost == pytest.approx(refit(search, [alone(search, candidate(0))])[0].cost)


def test_a_refit_that_ends_above_one_with_fewer_effects_begins_again_from_there():
    examined, part = once_one_has_left(0.8, 0.5, 0.0)
    best, reasons = judging.superfluous(examined, replace(part, cost=part.cost + 1e6))
    assert (best.names, reasons) == (("effect_0", "effect_1"), {})
    assert best.cost == pytest.approx(part.cost, abs=CAL.settled)


def test_sizes_are_known_less_well_the_more_free_runs_err():
    """Model errors that last are no scatter between blocks: by four times the variance of noise, sds are doubled.

    What tolerances leave open is as they state.
    """
    by_readings, by_tolerances = 0.15**2 * np.eye(1), 0.2**2 * np.eye(1)
    search = SimpleNamespace(covariance=lambda _: 0.05 * np.eye(1), scatter=lambda _: (by_readings, by_tolerances))
    hypothesis = SimpleNamespace(m=np.array([1.2]), axes=[SimpleNamespace(null=1.0)])

    def sd(left, inexact=True, unnamed=True):
        examined = SimpleNamespace(
            selection=SimpleNamespace(search=search), inexact=inexact, closed=SimpleNamespace(after=left),
            unnamed=unnamed or None,
        )  # fmt: skip
        sizes = judging.known_sizes(examined, hypothesis)
        off = CAL.form_of_size * 0.2 if inexact else 0.0
        assert sizes.widening[0] == pytest.approx(np.sqrt((sizes.covariance[0, 0] - off**2) / 0.05))
        return float(np.sqrt(sizes.covariance[0, 0]))

    form = CAL.form_of_size * 0.2
    assert sd(1.0) == sd(0.8) == pytest.approx(np.linalg.norm([CAL.wider * 0.15, 0.2, form]))
    assert sd(4.0) == pytest.approx(np.linalg.norm([2.0 * CAL.wider * 0.15, 0.2, form]))
    assert sd(4.0, unnamed=False) == sd(1.0)
    assert sd(4.0, inexact=False) == pytest.approx(0.25)


@given(st.lists(st.floats(0.0, 6.0), min_size=1, max_size=8), st.integers(8, 60))
def test_as_many_effects_are_significant_as_holm_rejects(sizes, offered):
    """Step by step, the surest effect first: each must pass beside those that are left."""
    z = np.array(sizes)
    levels = judging._least_levels(z, offered)
    for level in (0.01, 0.05, 0.5):
        rejected, left = set(), offered
        for k in sorted(range(len(z)), key=lambda k: -z[k]):
            if 2 * stats.norm.sf(z[k]) > level / left:
                break
            rejected, left = rejected | {k}, left - 1
        assert set(np.flatnonzero(levels <= level)) == rejected


def test_chance_is_small_for_sure_effects_and_a_twentieth_for_the_least_sure_one():
    z = np.array([6.0, 3.22])
    sure, unsure = judging._least_levels(z, 40)
    assert sure < 1e-6
    assert unsure == pytest.approx(39 * 2 * stats.norm.sf(3.22))
    assert unsure == pytest.approx(0.05, abs=1e-3)


@pytest.mark.parametrize(("share", "low", "applied"), [(0.14, -0.02, True), (0.14, -0.6, True), (0.01, -0.02, False)])
def test_of_what_was_held_out_a_cause_is_expected_to_close_a_share(monkeypatch, share, low, applied):
    own = candidate(0)
    best = SimpleNamespace(names=(own.effect,), at_bounds=frozenset())
    nothing = SimpleNamespace(names=())
    selection = SimpleNamespace(tried=[], base=nothing, search=None)
    found = SimpleNamespace(
        best=best, unnamed=None, evidence=None, selection=selection, varying={}, stands=True, inexact=False
    )
    monkeypatch.setattr(judging, "probability", lambda *_: 0.999)
    monkeypatch.setattr(judging, "alike_of", lambda *_: ())
    closes = Share(own.effect, share, low, 2 * share - low)
    shared = Budget((closes,), Share("unnamed", 1 - share, 0.0, 1.0), ("lap",), True, beside=(closes,))
    assert (judging.refused(found, best.names, shared) == {}) == applied


def test_unknown_forces_over_their_usual_size_are_something_unnamed():
    left = Unnamed(0.08, 0.01, 0.02, 0.02, 0.5, 0.5, 0.0, ("I_z", 0.0), {"yaw_rate": 1.0}, over_usual=4.0)
    assert unnamed_probability(SimpleNamespace(unnamed=left, noise_stated=True)) > 0.9
    usual = SimpleNamespace(unnamed=replace(left, over_usual=1.0), noise_stated=True)
    assert unnamed_probability(usual) < 0.15


def test_tolerances_that_are_further_off_than_usual_tell_of_something_unnamed_and_of_a_mimic():
    usual = amplitude_prior(np.ones(1), noise_stated=True, exact=False, stated={})
    calm = Unnamed(0.01, 0.01, 0.02, 0.02, 0.5, 0.5, 44.0, ("I_z", 0.0), {"yaw_rate": 1.0}, 32.0, over_usual=1.0)
    strained = replace(calm, tolerances=96.0)
    assert calm.strain == 0.0  # within two standard deviations, 8 each
    assert strained.strain == pytest.approx((96.0 - 32.0 - 16.0) / 2.0)
    assert replace(strained, expected=nan).strain == 0.0  # written before it was known

    def unnamed(own):
        return unnamed_probability(SimpleNamespace(unnamed=own, noise_stated=True, expected=usual))

    assert unnamed(calm) < 0.15 < 0.7 < unnamed(strained)

    def mimics(own, gain, of_it=1.0):
        tried = [SimpleNamespace(names=("lag",), cost=-gain)]
        selection = SimpleNamespace(base=SimpleNamespace(names=(), cost=0.0), tried=tried)
        found = SimpleNamespace(unnamed=own, selection=selection, strained_shares={"lag": of_it})
        return _strains(found, tried[0], "lag")

    assert mimics(calm, 30.0) == 0.0
    assert mimics(strained, 30.0) > 0.9
    assert mimics(strained, 3000.0) < 0.01
    assert mimics(strained, 30.0, of_it=0.05) < 0.05  # what is strained acts on other channels


def test_an_effect_that_gains_little_more_than_what_is_left_where_it_acts_is_a_mimic():
    def mimics(gain, left, rough=False):
        tried = [SimpleNamespace(names=("lag",), cost=-gain)]
        selection = SimpleNamespace(base=SimpleNamespace(names=(), cost=0.0), tried=tried)
        found = SimpleNamespace(unnamed=object(), selection=selection, driving_gains={"lag": left}, inexact=rough)
        return _beside_unknown(found, tried[0], "lag")

    assert mimics(30.0, 0.0) == 0.0
    assert mimics(30.0, 30.0) > 0.9
    assert mimics(CAL.mimic * 30.0, 30.0) == pytest.approx(0.5)
    assert mimics(30.0, 30.0, rough=True) == 0.0  # whose form leaves as much
    assert mimics(3000.0, 30.0) < 0.01


def test_a_size_may_vary_less_beside_something_unnamed():
    usual = amplitude_prior(np.ones(1), noise_stated=True, exact=False, stated={})
    calm = Unnamed(0.01, 0.01, 0.02, 0.02, 0.5, 0.5, 44.0, ("I_z", 0.0), {"yaw_rate": 1.0}, 32.0, over_usual=1.0)
    limits = [
        may_vary(
            SimpleNamespace(
                unnamed=replace(calm, over_usual=times),
                noise_stated=True,
                expected=usual,
                inexact=False,
            )
        )
        for times in (0.5, 20.0)
    ]
    assert limits == pytest.approx([CAL.varies, CAL.varies_beside_unknown], abs=0.01)
    assert may_vary(SimpleNamespace(unnamed=None, inexact=False)) == CAL.varies
    assert may_vary(SimpleNamespace(unnamed=calm, inexact=True)) == CAL.varies_inexact  # errors of form move sizes, too


def test_what_a_refused_name_explains_is_unnamed():
    """Nothing contradicts itself: a gap whose only name is a mimic's is there by no name."""
    usual = amplitude_prior(np.ones(1), noise_stated=True, exact=False, stated={})
    calm = Unnamed(0.01, 0.01, 0.02, 0.02, 0.5, 0.5, 44.0, ("I_z", 0.0), {"yaw_rate": 1.0}, 32.0, over_usual=1.0)
    best = SimpleNamespace(names=("lag",), cost=-30.0)
    selection = SimpleNamespace(base=SimpleNamespace(names=(), cost=0.0), tried=[best])

    def unnamed(varying, own=calm, sure=0.98):
        evidence = SimpleNamespace(weights=(sure, 1.0 - sure))
        return misnamed_probability(
            SimpleNamespace(
                varying=varying,
                unnamed=own,
                best=best,
                selection=selection,
                evidence=evidence,
                stands=True,
                strained_shares={},
                driving_gains={},
                noise_stated=True,
                expected=usual,
                inexact=True,
            )
        )

    differs = Spread("along speed", 3 * CAL.varies, 1e-6, (1.0, 2.0, 3.0))
    assert unnamed({}) == 0.0
    assert unnamed({"lag": differs}) > 0.9
    assert unnamed({"lag": differs}, sure=0.3) < 0.3
    assert unnamed({}, replace(calm, tolerances=96.0)) > 0.9


def test_the_picture_covers_the_lap(delayed):
    strip = delayed.strip
    assert len(strip.time) == len(strip.before) == len(strip.after) == len(strip.x) == 20
    assert np.sum(strip.map["time"]) == pytest.approx(1.0, abs=0.01)
    np.testing.assert_array_equal(strip.map["time"] > 0, np.isfinite(strip.map["gap"]))
    assert np.mean(strip.before) > 2 * np.mean(strip.after)
    assert set(strip.spectrum_before) == set(NOISE)


def test_an_answer_is_plain_data(delayed, clean):
    for gap in (delayed, clean):
        body = json.loads(json.dumps(gap.to_json(), default=float))
        assert set(body) >= {
            "model", "recordings", "gap_detected", "p_value", "unknown_probability", "where", "ranking", "applied",
            "gap", "held_out", "not_excited", "absorbed", "advice", "doubts",
        }  # fmt: skip
        assert set(body["where"]) >= {"channel", "regime", "equations", "time", "channels", "regimes"}
        assert body["where"]["channel"] in (*NOISE, "")
        assert body["where"]["regime"] in REGIMES
        assert set(body["gap"]) >= {"before", "after", "floor", "closed", "closed_interval", "recordings", "errors"}
        assert 0 < len(body["ranking"]) <= 8
        for own in body["ranking"]:
            assert set(own) >= {
                "effect",
                "probability",
                "magnitude",
                "unit",
                "interval",
                "indistinguishable_from",
                "gain",
            }
            assert 0.0 <= own["probability"] <= 1.0
        probabilities = [own["probability"] for own in body["ranking"]]
        assert probabilities == sorted(probabilities, reverse=True)
        assert 0.0 <= body["p_value"] <= 1.0
        assert 0.0 <= body["unknown_probability"] <= 1.0


def test_a_recording_that_lacks_steer_is_refused_in_a_sentence():
    with pytest.raises(BadInput, match=r"steer.*") as refused:
        diagnosed(without(lap(seconds=5.0), "steer"))
    assert str(refused.value).endswith(".")


def test_without_effects_that_act_on_the_model_there_is_nothing_to_say():
    with pytest.raises(BadInput, match="No effect acts on"):
        diagnose(nominal(), [lap(seconds=5.0)], {}, vehicle=CAR)


# ---- the others, with --slow


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "truth"),
    [
        ("tyre_relaxation", 0.4), ("mass_change", 1.08), ("sensor_latency_yaw", 0.03), ("accel_bias_y", 0.3),
        ("road_slope", 0.03), ("motor_gain", 0.9), ("grip_scale", 0.85), ("steering_offset", 0.01),
        ("yaw_inertia", 1.15), ("steering_lag", 0.06), ("wheel_speed_scale", 1.03), ("cog_shift", 0.08),
    ],
)  # fmt: skip
def test_a_single_effect_is_named_with_its_magnitude(effect, truth):
    gap = diagnosed(lap({effect: truth}))
    told(gap, effect, truth)
    assert gap.gap.closed == pytest.approx(1.0, abs=0.05)
    assert gap.unknown_probability < 0.5


@pytest.mark.slow
def test_aliases_are_named_together_and_share():
    gap = diagnosed(lap({"accel_bias_y": 0.3}))
    first, second = gap.ranking[:2]
    assert {first.effect, second.effect} == {"accel_bias_y", "imu_mount_roll"}
    assert second.effect in first.indistinguishable_from
    assert first.probability == pytest.approx(second.probability, abs=0.1)
    assert any("the same readings" in sentence for sentence in gap.advice)
    assert gap.where.channel == "a_y"
    assert gap.applied == (first.effect,) or gap.applied == (second.effect,)  # one cause, whichever it is called


@pytest.mark.slow
@pytest.mark.parametrize(
    "effects",
    [
        {"steering_delay": 0.05, "mass_change": 1.08}, {"tyre_relaxation": 0.4, "road_slope": 0.03},
        {"motor_gain": 0.9, "sensor_latency_yaw": 0.03},
    ],
    ids=" and ".join,
)  # fmt: skip
def test_two_effects_are_found_together(effects):
    gap = diagnosed(lap(effects))
    assert set(effects) <= set(gap.applied)
    for name, truth in effects.items():
        own = next(each for each in gap.ranking if each.effect == name)
        assert own.interval[0] <= truth <= own.interval[1] or own.magnitude == pytest.approx(truth, rel=0.03)
    assert gap.gap.closed == pytest.approx(1.0, abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("effects", [{"steering_delay": 0.04}, {"steering_delay": 0.04, "mass_change": 1.08}])
def test_a_delay_of_whole_rows_is_one_too(effects):
    gap = diagnosed(lap(effects))
    assert set(effects) == set(gap.applied)


@pytest.mark.slow
def test_parameters_within_their_tolerances_are_no_gap():
    gap = diagnosed(lap(vehicle=WITHIN), TOLERANT)
    assert not gap.gap_detected, gap.ranking[:3]
    assert diagnosed(lap(vehicle=WITHIN), CAR).gap_detected  # stated exactly, they are


@pytest.mark.slow
def test_an_effect_is_found_beside_tolerances():
    gap = diagnosed(lap({"steering_delay": 0.05}, vehicle=WITHIN), TOLERANT)
    for name in ("I_z", "B_f"):  # the closed model has them where the delay was found
        stated, found = TOLERANT.values[name].value, float(gap.closed[name].array)
        assert 0 < (found - stated) / (WITHIN[name] - stated) < 2
    told(gap, "steering_delay", 0.05, within=0.1)
    low, high = gap.ranking[0].interval
    rough = CAL.form_of_size * gap.ranking[0].magnitude  # the delay's own equation is rough as well
    assert (high - low) / 2 >= 1.96 * rough


@pytest.mark.slow
def test_v_y_is_not_needed():
    gap = diagnosed(without(lap({"tyre_relaxation": 0.4}), "v_y"))
    told(gap, "tyre_relaxation", 0.4)
    assert "v_y" not in gap.where.channels


@pytest.mark.slow
def test_a_few_missing_readings_and_spikes_do_no_harm():
    own = lap({"mass_change": 1.08})
    a_y, yaw_rate = np.array(own["a_y"]), np.array(own["yaw_rate"])
    a_y[500:560] = np.nan
    a_y[[100, 900, 1500]] += 60.0
    yaw_rate[[333, 1234]] -= 4.0
    told(diagnosed(own.with_signals(a_y=a_y, yaw_rate=yaw_rate)), "mass_change", 1.08)


@pytest.mark.slow
def test_the_lateral_model_is_diagnosed_at_the_recorded_speed():
    gap = diagnosed(lateral_lap({"yaw_inertia": 1.2}), model="lateral")
    told(gap, "yaw_inertia", 1.2)
    assert gap.model == "lateral"
    assert set(gap.where.channels) <= {"v_y", "yaw_rate", "a_y"}
    assert not diagnosed(lateral_lap(), model="lateral").gap_detected


@pytest.mark.slow
def test_rows_held_stale_are_found_and_counted():
    gap = diagnosed(lap(dropped=0.06))
    first = gap.ranking[0]
    assert gap.gap_detected
    assert first.effect == "dropped_samples"
    assert first.probability > 0.9
    assert first.interval[0] <= 0.06 <= first.interval[1]
    assert gap.applied == ()
    assert "does not change a simulation" in first.reason


@pytest.mark.slow
def test_jitter_of_the_sampling_instant_is_found_where_commands_jump():
    gap = diagnosed(lap({"timestamp_jitter": 0.003}))
    told(gap, "timestamp_jitter", 0.003, within=0.15)
    assert gap.applied == ()
    assert "does not change a simulation" in gap.ranking[0].reason


@pytest.mark.slow
def test_several_recordings_tell_of_one_cause():
    laps = [lap({"mass_change": 1.05}, 20.0, seed) for seed in (1, 2)]
    gap = diagnosed(laps)
    told(gap, "mass_change", 1.05)
    assert gap.recordings == ("lap1", "lap2")


@pytest.mark.slow
def test_an_effect_the_model_has_already_is_no_gap():
    model = build("single_track", None, {"steering_delay": 0.05}, CAR)
    gap = diagnose(model, [lap({"steering_delay": 0.05})], vocabulary(), vehicle=CAR)
    assert not gap.gap_detected
    assert gap.closed.effects == ("steering_delay",)


@pytest.mark.slow
def test_the_same_recording_gives_the_same_answer():
    own = lap({"mass_change": 1.05}, 15.0)
    first, again = (json.dumps(diagnosed(own).to_json(), default=float) for _ in range(2))
    assert first == again


@pytest.mark.slow
def test_noise_that_is_not_stated_is_told_by_the_readings():
    silent = replace(CAR, noise={})
    told(diagnosed(lap({"mass_change": 1.08}), silent), "mass_change", 1.08)


@pytest.mark.slow
def test_the_command_says_it_in_json(tmp_path):
    file = written(lap({"mass_change": 1.08}, 20.0), tmp_path / "lap.csv")
    car = tmp_path / "car.toml"
    numbers = "\n".join(f"{name} = {own.value}" for name, own in NUMBERS.items())
    noise = "\n".join(f"{name} = {sd}" for name, sd in NOISE.items())
    car.write_text(f'name = "car"\n[parameters]\n{numbers}\n[noise]\n{noise}\n')
    called = greybox("gap", file, "--vehicle", car, "--json")
    assert called.code == 0, called.err
    body = called.told
    assert body["gap_detected"] is True
    assert body["ranking"][0]["effect"] == "mass_change"
    assert body["ranking"][0]["interval"][0] < body["ranking"][0]["magnitude"] < body["ranking"][0]["interval"][1]
    assert set(body["gap"]) >= {"before", "after", "floor", "closed", "closed_interval"}
    assert greybox("gap", file, "--vehicle", car, "--check").code == 1


def test_what_cannot_be_told_apart_is_ranked_by_what_is_sure_of_it_together():
    def ranked(effect, probability, *others):
        return Ranked(effect, probability, 0.1, "1", (0.0, 0.2), others, 10.0)

    tried = [SimpleNamespace(names=names) for names in (("pitch", "grip"), ("bias", "grip"), ("pitch",), ("bias",))]
    found = SimpleNamespace(
        evidence=SimpleNamespace(weights=(0.4, 0.4, 0.1, 0.1, 0.0)), selection=SimpleNamespace(tried=tried)
    )
    listed = [ranked("grip", 0.72), ranked("pitch", 0.45, "bias"), ranked("bias", 0.45, "pitch")]
    assert _ranking_keys(found, listed, 0.9) == pytest.approx({"pitch": 0.9, "grip": 0.72, "bias": 0.45})


def test_doubts_that_together_are_more_than_one_half_keep_a_name_out(monkeypatch):
    own = candidate(0)
    best = SimpleNamespace(names=(own.effect,), at_bounds=frozenset())
    nothing = SimpleNamespace(names=())
    selection = SimpleNamespace(tried=[], base=nothing, search=None)
    found = SimpleNamespace(
        best=best, unnamed=None, evidence=None, selection=selection, varying={}, stands=True, inexact=False
    )
    monkeypatch.setattr(judging, "probability", lambda *_: 0.9)
    monkeypatch.setattr(judging, "alike_of", lambda *_: ())
    assert judging.refused(found, best.names, None) == {}
    spread = Spread("along speed", CAL.varies - 1e-6, 0.0, ())  # one half, and 0.9 of that
    found.varying = {own.effect: spread}
    assert judging.refused(found, best.names, None) == {own.effect: "its probability is 0.45, not more than one half"}


@pytest.mark.slow
def test_a_gyro_that_is_very_late_beside_a_sensor_of_v_y_that_is_elsewhere_and_turned():
    """Without accelerations, latencies of a gyro and of a whole unit are one; a turned sensor is a tolerance."""
    lacks = {"velocity_lever_arm": 1.0, "velocity_mount_yaw": -0.006, "sensor_latency_yaw": 0.28}
    laps = [without(lateral_lap(lacks, seconds, seed), "a_y") for seconds, seed in ((40.0, 3), (20.0, 53))]
    gap = diagnosed(laps[0], TOLERANT, "lateral", held_out=laps[1:])
    late = ("sensor_latency_yaw", "sensor_latency_imu")
    assert len(gap.applied) == 2
    assert "velocity_lever_arm" in gap.applied
    assert set(gap.applied) & {*late}
    assert any(set(each.members) == {*late} and each.probability > 0.9 for each in gap.classes)
    sizes = {each.effect: each.magnitude for each in gap.ranking}
    assert [sizes[name] for name in late] == pytest.approx([0.28, 0.28], abs=0.01)
    assert sizes["velocity_lever_arm"] == pytest.approx(1.0, abs=0.1)
    assert gap.held_out.closed > 0.95
