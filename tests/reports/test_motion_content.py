"""What a report of equations of motion says is what the fit and its recordings hold."""

from dataclasses import replace

import numpy as np
import pytest

from greybox_id.reports.driven import driven, held_errors
from greybox_id.reports.motion.content import motion_content
from greybox_id.reports.numbers import interval
from greybox_id.scores.metrics import FREE_RUN, ahead, prediction_errors, score_beside_hold


@pytest.fixture(scope="module")
def said(motion_fit, motion_found):
    return motion_content(motion_fit, motion_found, None)


def judged(fit, **changes):
    """The fit with another word of Ipopt's."""
    stage = fit.stages[-1]
    return replace(fit, stages=(replace(stage, certificate=replace(stage.certificate, **changes)),))


def test_predictions_are_those_that_the_fit_was_scored_on(motion_fit, motion_found):
    held_out = motion_found[-1]
    for protocol, prediction in held_out.predicted.items():
        found = prediction_errors(held_out.outputs, prediction, held_out.recording.sample_time)
        for name, error in motion_fit.metrics["validate"][protocol].items():
            assert found[name].rmse == pytest.approx(error["rmse"], rel=1e-9)


def test_holding_is_scored_as_by_the_baseline(motion_fit, motion_found):
    _, held = score_beside_hold(motion_fit.model, motion_found[-1].recording)
    own = held_errors(motion_found)["validate"]
    for protocol, errors in held.items():
        for name, error in errors.items():
            assert own[protocol][name].rmse == pytest.approx(error.rmse, rel=1e-12)


def test_only_what_was_recorded_is_reported(said, motion_found):
    assert motion_found[1].outputs == ("yaw_rate", "a_y")
    rows = [row[1] for row in said.errors.rows]
    outputs = [row[0] for row in said.errors.rows if "[" in row[0]]
    assert outputs == ["v_y [m/s]", "yaw rate [rad/s]", "a_y [m/s²]"]
    assert rows.count("model, training") == 2  # a lap without v_y: it cannot be pooled
    assert rows.count("held, validation") == 3


def test_the_verdict_names_free_run_and_half_a_second_with_units(said, motion_fit):
    good, against, sure = said.verdict
    assert good.startswith("On lap 3, 15.9 s that it has not seen, lateral errs in free run (0.5 s ahead)")
    assert "rad/s in yaw rate" in good
    assert f"{motion_fit.metrics['validate'][FREE_RUN]['yaw_rate']['rmse']:.5f}" in good
    assert against.startswith("Holding the last reading for 0.5 s errs")
    assert "times the residuals of the fit in v_y" in against
    assert "converged" in sure
    assert "Ipopt confirmed" in sure
    assert "yaw_rate_bias" in sure


def test_ipopt_s_doubt_is_passed_on(motion_fit, motion_found):
    doubted = judged(motion_fit, confirmed=False, status="Maximum Iterations Exceeded")
    sure = motion_content(doubted, motion_found, None).verdict[2]
    assert "Ipopt did not confirm the optimum: it ended with “Maximum Iterations Exceeded”" in sure


def test_intervals_are_those_of_the_fit(said, motion_fit):
    row = next(row for row in said.parameters.rows if row[0] == "B_f")
    low, high = motion_fit.interval("B_f")
    assert row[3] == interval(float(low), float(high), float(motion_fit.sd["B_f"]))
    assert float(high - low) > 2 * 1.96 * float(motion_fit.sd["B_f"])  # Student's t


def test_effects_have_a_table_of_their_own_that_says_what_may_be_absent(said):
    delay, bias = said.effects.rows
    assert delay[0] == "steering_delay"
    assert float(delay[2].split(" ")[0]) == pytest.approx(0.06, abs=0.01)
    assert "may be absent" not in delay[6]
    assert bias[6].endswith("may be absent: the interval holds 0")
    assert not {"steering_delay", "m"} & {row[0] for row in said.parameters.rows}
    assert "m = 1457 kg" in said.held[0]


def test_what_is_told_together_is_said(said):
    names = [row[0] for row in said.combinations.rows]
    assert "C_alpha_f" in names
    assert all("%" in row[5] for row in said.combinations.rows)


def test_a_fit_without_validation_says_so(motion_fit, laps):
    alone = replace(motion_fit, metrics={"train": motion_fit.metrics["train"]}, data=motion_fit.data[:2])
    said = motion_content(alone, driven(alone, laps[:2]), None)
    assert "no recording was held back" in said.verdict[0]
    assert "training data" not in said.verdict[1]


def test_a_fit_without_covariance_says_that_this_is_not_known(motion_fit, motion_found):
    said = motion_content(replace(motion_fit, covariance=None), motion_found, None)
    assert "is not known" in said.verdict[2]
    assert said.combinations.rows == ()
    assert said.open == ()


def test_slip_angles_are_kept_along_the_drive(motion_found):
    for one in motion_found:
        assert len(one.quantities["alpha_f"]) == len(one.predicted[ahead(0.1)].rows)
        assert 0.01 < np.max(np.abs(one.quantities["alpha_f"])) < 0.2
