"""Manoeuvres that tell explanations of a gap apart, and those that nothing tells apart."""

from dataclasses import replace
from functools import partial

import pytest
from made_gaps import clear, none

import greybox_id as gb
from greybox_id.api import designing
from greybox_id.api.designing import nominal_of
from greybox_id.api.gap_result import GapResult
from greybox_id.fitting.provenance import DataRecord
from greybox_id.gap.advice import advice
from greybox_id.gap.design import discriminate
from greybox_id.gap.design.discriminate import ENOUGH, ambiguous, distinguishable_effects
from greybox_id.gap.gap import Ranked
from greybox_id.models.effects import EFFECTS
from greybox_id.reports.gap.saved import Made, as_text, stated_numbers
from greybox_lab.exam.aliases import ALWAYS_ALIKE

LIMITS = {"speed_max": 18.0}


@pytest.fixture(scope="module")
def made():
    vehicle = gb.Vehicle.load("full_size_car")
    model = gb.models.single_track(vehicle=vehicle)
    data = (DataRecord("train", "lap7", "lap7.csv", "0" * 64, "canonical", 4000, 1, 40.0),)
    return Made(vehicle.name, "greybox gap", 0, "0.1.0", data, {"tyre": "pacejka"}, {}, stated_numbers(vehicle, model))


@pytest.fixture
def saved(made, tmp_path):
    """(gap) -> its file."""

    def written(gap):
        file = tmp_path / "gap.json"
        file.write_text(as_text(gap, made))
        return file

    return written


def unsure(first, second, sizes):
    pair = (
        Ranked(first, 0.5, sizes[0], "s", (0.0, 0.1), (second,), 100.0),
        Ranked(second, 0.48, sizes[1], "s", (0.0, 0.1), (first,), 99.0),
    )
    return clear(ranking=pair, applied=(first,))


def test_the_model_of_a_diagnosis_is_built_from_its_file_alone(made):
    model = nominal_of(clear(), made)
    stated = gb.Vehicle.load("full_size_car")
    assert float(model["m"].array) == stated.values["m"].value
    priors = [p.name for p in model.parameters if p.prior is not None and not p.fixed]
    assert set(priors) >= {name for name, own in stated.values.items() if own.sd is not None and name in model}
    assert set(stated.effects) & set(gb.models.single_track().names) <= set(model.effects) | set(stated.effects)


@pytest.mark.parametrize("pair", ALWAYS_ALIKE)
@pytest.mark.parametrize("turned", [False, True])
def test_exact_aliases_are_called_impossible(saved, pair, turned):
    first, second = pair[::-1] if turned else pair
    assert distinguishable_effects((first, second))[1] == ((first, second),)
    design = gb.design(saved(unsure(first, second, (0.02, 0.02))), arena="disc:60")
    assert design.plan is None
    assert len(design.impossible) == 1
    assert "no manoeuvre distinguishes them" in design.impossible[0]
    assert first in design.impossible[0]
    assert second in design.impossible[0]


def test_where_nothing_is_ambiguous_that_is_said(saved):
    design = gb.design(saved(clear()), arena="disc:60")
    assert design.said == ("There is nothing to distinguish: the diagnosis already distinguishes its explanations.",)
    assert gb.design(saved(none()), arena="disc:60").said[0].endswith("no gap was detected.")
    assert design.plan is None
    assert ambiguous(clear()) == ()
    nameless = replace(clear(), applied=(), unknown_probability=0.97)
    (said,) = gb.design(saved(nameless), arena="disc:60").said
    assert said.endswith("an unmodelled effect is present with probability 0.97.")


def test_a_model_whose_speed_is_read_has_no_drive_to_scale():
    assert discriminate._drive_of(gb.models.lateral()) == "drive"


def test_what_stays_likely_beside_what_is_not_sure_is_not_told_apart():
    first = Ranked("steering_delay", 0.6, 0.06, "s", (0.05, 0.07), (), 100.0)
    second = Ranked("steering_lag", 0.3, 0.06, "s", (0.05, 0.07), (), 99.0)
    assert ambiguous(clear(ranking=(first, second), applied=("steering_delay",))) == ("steering_delay", "steering_lag")
    assert ambiguous(clear(ranking=(first, second), applied=("steering_delay", "steering_lag"))) == ()
    sure = replace(first, probability=0.97)
    assert ambiguous(clear(ranking=(sure, second), applied=("steering_delay",))) == ()
    unlikely = replace(second, probability=0.01)
    assert ambiguous(clear(ranking=(first, unlikely), applied=("steering_delay",))) == ()


@pytest.mark.slow
def test_what_is_predicted_is_what_is_left_when_explanations_have_adapted(saved, monkeypatch):
    """More steps than are usual change no separation: what adapts slowly would pass for what is told apart."""
    told = []
    for steps in (discriminate.STEPS, 4 * discriminate.STEPS):
        monkeypatch.setattr(discriminate, "STEPS", steps)
        gap = unsure("motor_gain", "mass_change", (1.1, 0.91))
        design = gb.design(saved(gap), arena="disc:80", duration=5.0, rate=25.0, limits=LIMITS, effort=0.01)
        told.append(design.separation[0])
    assert told[0].nats == pytest.approx(told[1].nats, abs=1.0)
    assert told[0].p10 == pytest.approx(told[1].p10, abs=1.0)


@pytest.mark.slow
def test_a_delay_and_a_lag_are_told_apart(saved):
    gap = unsure("steering_delay", "steering_lag", (0.06, 0.06))
    design = gb.design(saved(gap), arena="disc:80", duration=6.0, rate=50.0, limits=LIMITS, effort=0.03)
    (own,) = design.separation
    assert own.pair == ("steering_delay", "steering_lag")
    assert own.nats > ENOUGH
    assert own.p10 <= own.nats
    assert design.impossible == ()
    assert design.kept >= 0.95


def test_advice_is_the_manoeuvre_that_is_computed(made, monkeypatch):
    quick = partial(designing.design, duration=6.0, limits=LIMITS, effort=0.03)
    monkeypatch.setattr(designing, "design", quick)
    gap = unsure("steering_delay", "steering_lag", (0.06, 0.06))
    fixed, *_ = advice([(gap.ranking[0].effect, *gap.ranking[0].indistinguishable_from)], [], EFFECTS)
    gap = replace(gap, advice=(fixed, "To detect roll: drive."))
    first, second = designing.quoted(GapResult.of(gap, made), "disc:80").advice
    assert first.startswith("To distinguish steering_delay from steering_lag, drive from ")
    assert "are expected to distinguish steering_delay or steering_lag by " in first
    assert second == "To detect roll: drive."
    assert "too small" in designing.quoted(GapResult.of(gap, made), "disc:2").advice[0]
    sure = clear()
    sure = GapResult.of(sure, made)
    assert designing.quoted(sure, "disc:80") is sure


@pytest.mark.slow
def test_what_noise_hides_is_called_impossible_here(saved):
    gap = unsure("steering_delay", "steering_lag", (0.002, 0.002))
    loud = replace(gap.gap, errors=tuple(replace(own, floor=20 * own.floor) for own in gap.gap.errors))
    gap = replace(gap, gap=loud, held_out=None)
    design = gb.design(saved(gap), arena="disc:80", duration=5.0, rate=50.0, limits=LIMITS, effort=0.02)
    assert design.separation[0].nats < 3.0
    assert "distinguishes steering_delay from steering_lag" in design.impossible[0]


@pytest.mark.slow
def test_tolerances_that_are_there_anyway_do_not_tell_a_motor_gain_from_a_mass(saved):
    """Whatever delays and masses within their tolerances a car has, both explanations have them."""
    gap = unsure("motor_gain", "mass_change", (1.1, 0.91))
    design = gb.design(saved(gap), arena="disc:80", duration=6.0, rate=50.0, limits=LIMITS, effort=0.03)
    (own,) = design.separation
    assert 0.0 < own.nats < 60.0  # resistance and axle loads alone tell one from the other
    assert own.p10 < own.nats


def test_effects_that_did_not_show_are_shown(saved):
    design = gb.design(
        saved(clear(not_excited={"steering_rate_limit": "1.9 rad/s"}, limits={})), "detect", arena="disc:80",
        parameters=["steering_delay"], duration=6.0, limits=LIMITS, effort=0.02,
    )  # fmt: skip
    (own,) = design.separation
    assert own.pair == ("steering_delay", "nothing")
    assert own.nats > ENOUGH


def test_wrong_files_and_goals_are_sentences(saved, tmp_path, made):
    gap = saved(clear())
    with pytest.raises(gb.BadInput, match="needs a fit"):
        gb.design(gap, "precision", arena="disc:60")
    with pytest.raises(gb.BadInput, match="no effect of"):
        gb.design(gap, "detect", arena="disc:60", parameters=["steering_dealy"])
    other = tmp_path / "notes.json"
    other.write_text('{"format": "greybox-track"}')
    with pytest.raises(gb.BadInput, match="neither a fit nor a gap"):
        gb.design(other, arena="disc:60")
    other.write_text("[1, 2")
    with pytest.raises(gb.BadInput):
        gb.design(other, arena="disc:60")
    silent = replace(clear().gap, errors=())
    quiet = replace(unsure("steering_delay", "steering_lag", (0.06, 0.06)), gap=silent, held_out=None)
    with pytest.raises(gb.BadInput, match="holds no noise levels"):
        gb.design(saved(quiet), arena="disc:60", effort=0.02)
