"""How certain sizes of changes are, and which are doubted, beside a search whose result is given."""

from types import SimpleNamespace

import numpy as np
import pytest

from greybox_id.gap.changes.between_runs import VaryingNumber
from greybox_id.gap.changes.comparison import ChangeComparison
from greybox_id.gap.changes.search import NONE, Change
from greybox_id.gap.estimation.calibration import CAL
from greybox_id.gap.gap import Closure
from greybox_id.models.effects import EFFECTS

ARM, OFFSET, GAIN = "velocity_lever_arm", "steering_offset", "yaw_rate_scale"
SHIFT, SD = 0.5, 0.01


def compared(named=NONE, gain=1.0, probabilities=(0.9, 0.9), alike=()):
    shown = Change(SD, 1.0, 20.0, 5.0)
    names = {ARM: 0.0, OFFSET: 0.0, GAIN: np.log(gain)}
    numbers = tuple(VaryingNumber(name, name == GAIN, 0.0, 1.0, 1e-3, -4.0, 4.0, 0.01, 1.0) for name in names)
    known = SimpleNamespace(numbers=numbers, x=np.array([*names.values()]), scatter=np.zeros(3), varying=(0, 1, 2))
    search = SimpleNamespace(
        best=lambda of=None: named if of is None else NONE, tried=[0, 1], likeliest=lambda place: frozenset({place}),
        change=lambda places, place: shown, alike=lambda places, place: alike,
        probability=lambda *places: sum(probabilities[k] for k in places) if alike else probabilities[places[0]],
        sizes=lambda places: np.array([SHIFT * (k in places) for k in range(3)]),
    )  # fmt: skip
    possible = {name: EFFECTS[name] for name in names}
    return ChangeComparison(possible, known, [], [], ((), ()), [], {}, search)


def sds(comparison, louder=1.0):
    return {one.effect: (one.interval[1] - one.interval[0]) / 2 / 1.96 for one in comparison.ranking(louder)}


def test_a_size_is_as_uncertain_as_form_makes_it_and_an_arm_as_the_yaw_rate_is():
    form = CAL.form_of_size * SHIFT
    assert sds(compared()) == pytest.approx(dict.fromkeys((ARM, OFFSET), np.hypot(SD, form)))
    found = sds(compared(gain=0.8))
    assert found[OFFSET] == pytest.approx(np.hypot(SD, form))
    assert found[ARM] == pytest.approx(np.hypot(SD, SHIFT * abs(np.log(0.8))))


def test_where_errors_are_larger_than_before_sizes_are_less_certain():
    form = CAL.form_of_size * SHIFT
    assert sds(compared(), 3.0)[OFFSET] == pytest.approx(np.hypot(3.0 * SD, form))
    assert sds(compared(), 0.5) == sds(compared())


@pytest.mark.parametrize(("closed", "doubted"), [(0.15, False), (-0.08, True)])
def test_a_change_is_refused_where_errors_held_out_are_no_smaller_with_it(monkeypatch, closed, doubted):
    said = Closure(1.8, 1.7, 1.0, closed, (-0.1, 0.6), ())
    monkeypatch.setattr(ChangeComparison, "_closure", lambda *given: said)
    found = compared(frozenset({0}))
    assert found.places == (NONE if doubted else frozenset({0}))
    assert bool(found.doubted) is doubted


@pytest.mark.parametrize(
    ("probabilities", "alike", "doubted"),
    [((0.4, 0.3), (1,), False), ((0.4, 0.3), (), True), ((0.3, 0.1), (1,), True)],
    ids=["a class that is sure", "alone", "a class that is not"],
)
def test_the_best_of_a_class_of_changes_stands_for_it(monkeypatch, probabilities, alike, doubted):
    closes = Closure(1.8, 1.7, 1.0, 0.5, (0.4, 0.6), ())
    monkeypatch.setattr(ChangeComparison, "_closure", lambda *given: closes)
    found = compared(frozenset({0}), probabilities=probabilities, alike=alike)
    assert found.places == (NONE if doubted else frozenset({0}))
    if doubted and alike:
        ((_, reason),) = found.doubted.values()
        assert reason == (
            "the probability of one of velocity_lever_arm and steering_offset is 0.40, not more than one half"
        )
