"""What other fits of the same model say of a fit: another vehicle than stated, and two vehicles in one recording."""

from dataclasses import replace
from itertools import cycle

import numpy as np
import pytest
from driven import driven

from greybox_id.datasets.recording import join
from greybox_id.fitting import carrying
from greybox_id.fitting.carrying import _stands_out, withstands
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.verb import fit
from greybox_id.models.parameter import Prior
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle

QUICK = FitOptions(solver="gauss-newton", horizon=1.0, start_from="measured")


def stated(**values):
    """The full-size car's, B_f and I_z stated to 2 %, at other values where they are given."""
    car = build("lateral", None, {}, vehicle("full_size_car"))
    known = {name: values.get(name, float(car[name].array)) for name in ("B_f", "I_z")}
    fixed = car.with_parameters(*(replace(p, fixed=p.name not in known, prior=None) for p in car.parameters))
    return fixed.with_parameters(
        *(
            replace(fixed[n].with_value(v), prior=Prior(sd=np.asarray(0.02 * v), mean=np.asarray(v)))
            for n, v in known.items()
        )
    )


def against(model, recording, gain=0.0, apart=False, odd=(), **form):
    found = fit(model, [recording], how=QUICK)
    found = replace(found, how={**found.how, "form": {"halves_gain": gain, "apart": apart, "odd": odd, **form}})
    return [reason.sentence for reason in withstands(found.model, found, recording)]


def test_nothing_is_said_against_the_right_vehicle():
    assert against(stated(), driven(runs=2, seconds=8.0), gain=100.0) == []


def test_another_vehicle_than_stated_is_told_by_what_wider_tolerances_gain():
    right = float(stated()["B_f"].array)
    (sentence,) = against(stated(B_f=0.4 * right), driven(runs=1, seconds=8.0, noise=0.1))
    assert "times those of the same model with tolerances 10 times as wide" in sentence


@pytest.mark.slow
def test_two_vehicles_in_one_recording_are_told_by_the_fit_to_one_on_the_other():
    right = float(stated()["B_f"].array)
    halves = [driven(runs=1, seconds=8.0, noise=0.1, values={"B_f": times * right}) for times in (1.0, 0.5)]
    sentences = against(stated(), join(halves, "halves"), gain=100.0)
    assert any("A fit to one half of the data" in one for one in sentences)


@pytest.mark.parametrize(
    ("of_stated", "reason"),
    [
        (1.39, "on both), or the vehicle has changed"),
        (2.1, "the vehicle has changed, or each half is of another vehicle"),
    ],
)
def test_halves_that_the_stated_vehicle_fits_tell_too_little_rather_than_of_a_change(monkeypatch, of_stated, reason):
    monkeypatch.setattr(carrying._Compared, "apart", lambda self, one, other: 4.1)
    monkeypatch.setattr(carrying._Compared, "worst", lambda self, p, parts: of_stated)
    sentences = against(stated(), driven(runs=2, seconds=4.0), gain=100.0, apart=True)
    (sentence,) = (one for one in sentences if "4.1 times the errors" in one)
    assert reason in sentence


@pytest.mark.slow
def test_refits_that_scatter_widely_excuse_no_halves_that_residuals_tell_apart(monkeypatch):
    monkeypatch.setattr(carrying, "_stands_out", lambda times, mixed: False)
    right = float(stated()["B_f"].array)
    halves = [driven(runs=1, seconds=8.0, noise=0.1, values={"B_f": times * right}) for times in (1.0, 0.5)]
    both, one = join(halves, "halves"), join([halves[0], halves[0]], "one vehicle")
    assert any("A fit to one half" in sentence for sentence in against(stated(), both, gain=100.0, apart=True))
    assert not any("A fit to one half" in sentence for sentence in against(stated(), one, gain=100.0, apart=True))


@pytest.mark.slow
def test_halves_that_differ_no_more_than_mixed_ones_tell_of_no_other_vehicle():
    right = float(stated()["B_f"].array)
    blocks = [driven(runs=1, seconds=4.0, seed=k, noise=0.1, values={"B_f": times * right})
              for k, times in enumerate((1.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.5, 1.0))]  # fmt: skip
    sentences = against(stated(), join(blocks, "by turns"), gain=100.0)
    assert not any("A fit to one half of the data" in one for one in sentences)


def pieces(factors):
    """Eight short drives, B_f so many times the stated one in each."""
    right = float(stated()["B_f"].array)
    return join(
        [
            driven(runs=1, seconds=4.0, seed=k, noise=0.1, values={"B_f": times * right})
            for k, times in enumerate(factors)
        ],
        "eight",
    )


@pytest.mark.slow
def test_a_piece_of_another_vehicle_is_told_where_residuals_say_so_though_no_halves_are():
    drive = pieces([0.4 if k == 4 else 1.0 for k in range(8)])
    (sentence,) = against(stated(), drive, odd=(4,))
    assert "In part 5 of 8 equal parts of the data" in sentence


@pytest.mark.parametrize(
    ("times", "told"),
    [
        ([1.0, 1.0, 1.0, 1.0, 1.9, 1.0, 1.0, 1.0], "In part 5 of 8 equal parts"),
        ([1.0, 1.0, 1.0, 1.0, 1.7, 1.0, 1.0, 1.0], ""),
        ([1.9, 1.0, 1.9, 1.0, 1.9, 1.0, 1.9, 1.0], "In 8 equal parts"),
    ],
)
def test_a_piece_that_is_far_off_is_told_whatever_residuals_say(monkeypatch, times, told):
    ratios = cycle(times)
    monkeypatch.setattr(carrying._Compared, "worst", lambda self, p, parts: next(ratios))
    monkeypatch.setattr(carrying, "REDUCTION", 0.0)
    sentences = against(stated(), driven(runs=8, seconds=4.0))
    assert [one for one in sentences if told and told in one] == sentences[: bool(told)]
    assert bool(told) == any("equal parts of the data" in one for one in sentences)


def test_pieces_whose_predicted_reduction_is_small_are_not_refitted(monkeypatch):
    monkeypatch.setattr(carrying, "_refitted", lambda *_: pytest.fail("refitted"))
    assert against(stated(), driven(runs=8, seconds=4.0)) == []


@pytest.mark.slow
def test_two_vehicles_that_take_turns_are_told_though_neither_halves_nor_a_piece_stands_out():
    sentences = against(stated(), pieces([0.4, 1.0] * 4))
    assert any("In 8 equal parts of the data, errors are" in one for one in sentences)


@pytest.mark.parametrize(
    ("form", "times", "told"),
    [
        ({"apart": True}, 1.2, True),
        ({"mixed": True}, 1.2, False),
        ({"mixed": True}, 1.4, True),
        ({}, 1.4, False),
        ({"apart": True, "first": 3}, 1.2, False),
        ({"apart": True, "first": 3}, 1.4, True),
    ],
)
def test_refits_of_parts_need_not_differ_as_much_where_residuals_tell_them_apart(monkeypatch, form, times, told):
    monkeypatch.setattr(carrying._Compared, "apart", lambda self, one, other: times)
    monkeypatch.setattr(carrying._Compared, "worst", lambda self, p, parts: 1.0)
    sentences = against(stated(), driven(runs=2, seconds=4.0), gain=100.0, **form)
    assert any(f"{times} times the errors of a fit to" in one for one in sentences) is told


@pytest.mark.parametrize(
    ("times", "mixed", "out"),
    [
        (1.43, (1.05, 1.05, 1.07, 1.06, 1.12, 1.13, 1.12, 1.07, 1.03), True),
        (1.52, (1.4, 1.2, 1.14, 1.29, 1.07, 1.08, 1.37, 1.1, 1.12), False),
        (1.5, (1.57, 1.56, 1.37), False),
    ],
)
def test_a_ratio_stands_out_beyond_the_scatter_of_others(times, mixed, out):
    assert _stands_out(times, mixed) is out
