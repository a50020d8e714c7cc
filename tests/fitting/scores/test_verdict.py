"""Verdicts: what is said of good fits, and of those that must not be used."""

from dataclasses import replace

import numpy as np
import pytest
from driven import driven

from greybox_id.base.errors import BadInput
from greybox_id.fitting.fit import NOT_USABLE, USABLE, WITH_CARE, Reason, weighed
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.requested_model import must_be_recorded
from greybox_id.fitting.saved_fit import load
from greybox_id.fitting.scores.metrics import Divergence, Error, prediction_errors, score_with_persistence
from greybox_id.fitting.scores.misfit import foreign_form, misfit
from greybox_id.fitting.scores.verdict import distrust, judged
from greybox_id.fitting.verb import carried, fit
from greybox_id.models.effects import EFFECTS
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle

QUICK = FitOptions(horizon=1.0, start_from="measured")


def model():
    """The full-size car's, but for its front tyres; few numbers are free."""
    found = build("lateral", None, {}, vehicle("full_size_car"))
    held = [replace(p, fixed=True, prior=None) for p in found.parameters if p.name not in ("I_z", "B_f")]
    slope = replace(found["B_f"], prior=None, value=0.6 * float(found["B_f"].array))
    return found.with_parameters(*held, replace(found["I_z"], prior=None), slope)


def lap(seed, **signals):
    recording = driven("lateral", runs=1, seed=seed, noise=0.3)
    return recording.with_signals(**{n: change(recording[n]) for n, change in signals.items()})


@pytest.fixture(scope="module")
def good():
    return fit(model(), [lap(0)], validate=lap(3), how=QUICK)


def test_a_good_fit_that_was_validated_is_usable_and_says_why(good):
    assert good.verdict.usability == USABLE
    assert good.verdict.reasons[0] == "The optimum is confirmed."
    assert "On held-out data, predictions 0.5 s ahead reach a fit of" in good.verdict.reasons[1]
    told = good.verdict.comparison["validate"]["1 s ahead"]["yaw_rate"]
    assert told["rmse"] < 0.5 * told["persistence"]
    assert told["rmse"] < 0.7 * told["unfitted"]
    assert 80 < told["fit_percent"] <= 100


def test_without_validation_a_fit_is_to_be_used_with_care():
    found = fit(model(), [lap(0)], how=QUICK)
    assert found.verdict.usability == WITH_CARE
    assert "no recording was held out" in found.verdict.reasons[0]
    assert "proportional to m" in found.verdict.reasons[1]


def test_a_verdict_is_kept_in_the_file(good, tmp_path):
    assert load(good.save(tmp_path / "fit.json"), build).verdict == good.verdict


@pytest.mark.parametrize(
    "spoilt",
    [
        {"yaw_rate": lambda v: np.full_like(v, 0.3)},
        {"steer": lambda v: 0.05 * np.random.default_rng(0).standard_normal(len(v))},
    ],
    ids=["constant yaw rate", "steering that is noise"],
)
def test_nonsense_is_never_usable(spoilt):
    found = fit(model(), [lap(0, **spoilt)], validate=lap(3, **spoilt), how=QUICK)
    assert found.verdict.usability != USABLE


def test_what_the_checks_distrust_makes_a_fit_not_usable():
    wrong = driven("lateral", runs=1, seconds=40.0, noise=0.3)
    wrong = wrong.with_signals(a_y=wrong["a_y"] / 9.81)
    found = fit(model(), [wrong], validate=lap(3), how=QUICK)
    assert found.verdict.usability == NOT_USABLE
    assert found.verdict.reasons[0].startswith("Data check: a_y is")


def test_a_fault_of_some_size_that_nothing_else_witnesses_leaves_care():
    wrong = driven("lateral", runs=1, seconds=40.0, noise=0.3)
    wrong = wrong.with_signals(a_y=0.85 * wrong["a_y"])
    (finding,) = distrust(("v_x", "a_y"), wrong, faults=True)
    assert not distrust(("v_x", "a_y"), wrong)
    found = fit(model(), [wrong], validate=lap(3), how=QUICK)
    assert found.verdict.usability != USABLE
    assert f"Data check: {finding.sentence}" in found.verdict.reasons


def test_a_fault_whose_effect_is_fitted_is_not_held_against_the_fit():
    banked, new = (lap(seed).with_signals(a_y=lap(seed)["a_y"] + 1.2) for seed in (0, 3))
    plain = fit(model(), [banked], validate=new, how=QUICK)
    assert any("the road is banked" in reason for reason in plain.verdict.reasons)
    found = fit(model() + EFFECTS["road_bank"].free(0.1), [banked], validate=new, how=QUICK)
    assert not any("the road is banked" in reason for reason in found.verdict.reasons)


def test_parameters_that_do_not_carry_over_are_said(good):
    assert carried(good.model, good, lap(3)) == []
    wrong = good.model.with_parameters(good.model["B_f"].with_value(0.7 * float(good.model["B_f"].array)))
    (why,) = carried(wrong, replace(good, model=wrong), lap(3))
    assert why.at_best == WITH_CARE
    assert "do not carry over" in why.sentence


def test_an_optimum_that_is_not_confirmed_leaves_no_intervals_and_care(good):
    stage = good.stages[-1]
    unconfirmed = replace(stage, certificate=replace(stage.certificate, confirmed=False))
    found = replace(good, stages=(unconfirmed,))
    assert not found.confirmed
    own, held = score_with_persistence(found.model, lap(3))
    said = judged(found, {"validate": own}, persistence={"validate": held})
    assert said.usability == WITH_CARE
    assert "not confirmed" in said.reasons[0]
    stuck = replace(found, stages=(replace(unconfirmed, steps=0),))  # shorter horizons had moved its numbers
    assert judged(stuck, {"validate": own}, persistence={"validate": held}).usability == WITH_CARE
    where_it_is = {p.name: float(p.array) for p in good.model.parameters if not p.fixed}
    stuck = replace(stuck, how={**stuck.how, "unfitted": where_it_is})
    assert judged(stuck, {"validate": own}, persistence={"validate": held}).usability == NOT_USABLE


def test_a_fit_that_made_the_model_worse_is_not_usable(good):
    own, held = score_with_persistence(good.model, lap(3))
    better = {name: {o: replace(e, rmse=0.3 * e.rmse) for o, e in errors.items()} for name, errors in own.items()}
    said = judged(good, {"validate": own}, persistence={"validate": held}, unfitted={"validate": better})
    assert said.usability == NOT_USABLE
    assert "3.3 times those of the unfitted model" in said.reasons[0]


def test_errors_that_are_larger_in_one_stretch_alone_do_not_refute_a_fit(good):
    own, held = score_with_persistence(good.model, lap(3))

    def worse_in(stretches):
        def changed(error):
            blocks = np.ones(len(error.blocks))
            blocks[:stretches] += 3.0 * len(blocks) / stretches
            return replace(error, rmse=2.0 * error.rmse, blocks=blocks / np.mean(blocks))

        even = {
            n: {o: replace(e, blocks=np.ones(len(e.blocks))) for o, e in errors.items()} for n, errors in own.items()
        }
        value = {name: {o: changed(e) for o, e in errors.items()} for name, errors in own.items()}
        return judged(good, {"validate": value}, persistence={"validate": held}, unfitted={"validate": even})

    once = worse_in(1)
    assert once.usability == WITH_CARE
    assert any("those of the unfitted model. This may be chance" in r for r in once.reasons), once
    throughout = worse_in(min(len(e.blocks) for errors in own.values() for e in errors.values()))
    assert throughout.usability == NOT_USABLE
    assert "times those of the unfitted model." in throughout.reasons[0]


def test_one_output_that_was_made_worse_is_said(good):
    own, held = score_with_persistence(good.model, lap(3))
    before = {
        name: {o: replace(e, rmse=e.rmse * (0.4 if o == "v_y" else 3.0)) for o, e in errors.items()}
        for name, errors in own.items()
    }
    said = judged(good, {"validate": own}, persistence={"validate": held}, unfitted={"validate": before})
    assert said.usability == WITH_CARE
    assert "the RMSE of v_y is 2.5 times that of the unfitted model" in said.reasons[0]


def test_a_fit_of_which_most_outputs_are_lost_one_way_or_another_is_not_usable(good):
    """One no better than its mean, one beaten by persistence: neither is most of three, but both are."""
    own, held = score_with_persistence(good.model, lap(3))
    worse = {"v_y": lambda e: 1.3 * e.spread, "a_y": lambda e: 1.3 * e.spread}
    lost = {n: {o: replace(e, rmse=worse[o](e) if o in worse else e.rmse) for o, e in errors.items()}
            for n, errors in own.items()}  # fmt: skip
    hold = {n: {o: replace(e, rmse=(0.9 if o == "a_y" else 5.0) * e.spread) for o, e in errors.items()}
            for n, errors in held.items()}  # fmt: skip
    verdict = judged(good, {"validate": lost}, persistence={"validate": hold})
    assert verdict.usability == NOT_USABLE


def test_a_fit_that_determines_nothing_is_not_usable(good):
    own, held = score_with_persistence(good.model, lap(3))
    vague = replace(good, sd={p.name: np.asarray(abs(2.0 * p.array)) for p in good.model.parameters})
    verdict = judged(vague, {"validate": own}, persistence={"validate": held})
    assert verdict.usability == NOT_USABLE
    assert "determines none of the 2 estimates" in verdict.reasons[0]


def test_errors_that_do_not_carry_over_are_said(good):
    own, held = score_with_persistence(good.model, lap(3))
    trained = {name: {o: replace(e, rmse=e.rmse / 3) for o, e in errors.items()} for name, errors in own.items()}
    said = judged(good, {"train": trained, "validate": own}, persistence={"validate": held})
    assert said.usability == WITH_CARE
    assert "does not carry over" in said.reasons[0]


def test_a_far_estimate_and_one_at_its_bound_are_said(good):
    from greybox_id.models.parameter import Prior

    far = replace(good.model["I_z"], prior=Prior(1.0, mean=float(good.model["I_z"].array) - 4.5))
    own, held = score_with_persistence(good.model, lap(3))
    changed = replace(good, model=good.model.with_parameters(far))
    said = judged(changed, {"validate": own}, persistence={"validate": held})
    assert said.usability == WITH_CARE
    assert "I_z by 4.5 sd" in said.reasons[0]
    value = float(good.model["I_z"].array)
    bound = replace(good, model=good.model.with_parameters(replace(good.model["I_z"], bounds=(value, 2 * value))))
    assert "I_z is at a bound." in judged(bound, {"validate": own}, persistence={"validate": held}).reasons


def test_a_simulation_that_diverges_is_said_in_words_and_never_as_a_number():
    time = np.arange(100)
    predicted = np.where(time < 40, 0.0, 10.0 ** (time - 40.0))[:, None]
    measured = np.sin(0.3 * time)[:, None]
    from greybox_id.engine.simulation import Prediction

    found = Prediction(time, predicted, measured, np.where(time < 10, 0, 1))
    error = prediction_errors(["v_y"], found, 0.1)["v_y"]
    assert error.diverges == Divergence(2, pytest.approx(3.2, abs=0.11), 0.5, True)
    assert error.rmse == np.inf
    assert error.diverges.words == f"diverges after {error.diverges.after:.3g} s in run 2"
    soon = prediction_errors(["v_y"], found, 0.1, 0.5)["v_y"]
    assert soon.diverges.words == "diverges in 58 % of the predictions 0.5 s ahead"


def test_a_fit_whose_predictions_diverge_is_not_usable(good):
    own, held = score_with_persistence(good.model, lap(3))
    astray = Divergence(2, 0.5, 0.6, False)
    lost = {**own, "0.5 s ahead": {o: replace(e, rmse=np.inf, diverges=astray) for o, e in own["0.5 s ahead"].items()}}
    said = judged(good, {"validate": lost}, persistence={"validate": held})
    assert said.usability == NOT_USABLE
    assert "diverges in 60 % of the predictions 0.5 s ahead" in said.reasons[0]


def test_the_gravest_reason_decides():
    reasons = [Reason(USABLE, "a"), Reason(NOT_USABLE, "c"), Reason(WITH_CARE, "b")]
    assert weighed(reasons, {}).reasons == ("c", "b")
    assert weighed(reasons, {}).usability == NOT_USABLE
    assert weighed(reasons[:1], {}) == weighed([Reason(USABLE, "a")], {})


def test_fit_percent_is_that_of_system_identification():
    assert Error(0.5, 0.0, 0.25, 10, 2.0).fit_percent == pytest.approx(75.0)


@pytest.mark.parametrize("rows", [slice(0, 1), slice(None, None, -1), None], ids=["one row", "reversed", "standing"])
def test_a_recording_in_which_time_does_not_run_is_a_sentence(rows):
    from greybox_id.datasets.recording import Recording

    whole = lap(0)
    if rows is None:
        broken = Recording("r", np.ones(len(whole)), dict(whole.signals))
    else:
        broken = Recording("r", whole.time[rows], {n: v[rows] for n, v in whole.signals.items()})
    with pytest.raises(BadInput, match="Its time may be reversed"):
        fit(model(), [broken], how=QUICK)
    with pytest.raises(BadInput, match="Its time may be reversed"):
        must_be_recorded(model(), [broken])


def test_many_missing_readings_are_no_traceback():
    rng = np.random.default_rng(0)
    holes = {n: (lambda v: np.where(rng.random(len(v)) < 0.4, np.nan, v)) for n in ("v_y", "yaw_rate", "a_y", "v_x")}
    found = fit(model(), [lap(0, **holes)], how=QUICK)
    assert found.verdict.usability == NOT_USABLE


@pytest.mark.parametrize(("by_drive", "first"), [(0.5, "the sign of drive"), (0.1, "second half of the data")])
def test_what_explains_most_of_the_residuals_is_named_first(good, by_drive, first):
    one = {"residual": 0.2, "spread": 1.0, "noise": 0.02, "explained": 0.6, "on": {"the sign of drive": by_drive}}
    form = {"outputs": {"a_x": one}, "halves": 0.3, "halves_gain": 40.0, "apart": True}
    sentences = [reason.sentence for reason in misfit(replace(good, how={**good.how, "form": form}))]
    assert len(sentences) == 2
    assert first in sentences[0]


@pytest.mark.parametrize(
    ("form", "words"),
    [
        ({"mixed": True}, "Other parameters fit the second half of the data better"),
        (
            {"apart": True, "first": 3},
            "Other parameters fit the rest of the drive better than those of its first three eighths",
        ),
        ({}, "early and late parts alike. The model lacks an effect"),
    ],
)
def test_a_change_is_spoken_of_where_early_and_late_parts_differ_by_more_than_others(good, form, words):
    one = {"residual": 0.2, "spread": 1.0, "noise": 0.02, "explained": 0.6, "on": {}}
    form = {"outputs": {"a_x": one}, "halves": 0.3, "halves_gain": 40.0, **form}
    sentences = [reason.sentence for reason in misfit(replace(good, how={**good.how, "form": form}))]
    assert any(words in sentence for sentence in sentences)
    assert any("vehicle may have changed" in sentence for sentence in sentences) is (len(form) > 3)


def test_a_recording_is_not_blamed_for_what_the_model_lacks(good):
    one = {"residual": 0.4, "spread": 1.0, "noise": 0.02, "explained": 0.6, "on": {"steer": 0.5}}
    lacks = replace(good, how={**good.how, "form": {"outputs": {"a_y": one}}})
    untold = {name: np.asarray(10.0 * float(good.model[name].array)) for name in good.sd}
    sentences = {case: judged(replace(case_fit, sd=untold), {}).reasons
                 for case, case_fit in {"lacks": lacks, "short": replace(good, how={})}.items()}  # fmt: skip
    assert foreign_form(lacks)
    assert not foreign_form(good)
    assert not any("determines none" in one for one in sentences["lacks"])
    assert any("determines none" in one for one in sentences["short"])


def test_an_error_that_varies_with_nothing_is_a_sentence_all_the_same(good):
    one = {"residual": 0.2, "spread": 1.0, "noise": 0.02, "explained": 0.6, "on": {}}
    (reason,) = misfit(replace(good, how={**good.how, "form": {"outputs": {"a_x": one}}}))
    assert "times the noise between rows. The model lacks an effect" in reason.sentence
