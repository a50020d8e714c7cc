"""What a report of equations of motion says is what the fit and its recordings hold."""

import re
from dataclasses import replace

import numpy as np
import pytest
from report_parts import below

from greybox_id.base.numbers import interval
from greybox_id.fitting.scores.metrics import FREE_RUN, ahead, prediction_errors, score_with_persistence
from greybox_id.reports.document import Table, Text
from greybox_id.reports.recordings import held_errors
from greybox_id.reports.report import prepared


def rows(document, title):
    """The rows of the first table below a heading."""
    return next(part.rows for part in below(document, title) if isinstance(part, Table))


def three(document):
    """The sentences of the verdict behind the first, on whether the fit can be used."""
    return [sentence for lead, sentence in document.verdict if lead != "Verdict"]


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
    _, held = score_with_persistence(motion_fit.model, motion_found[-1].recording)
    own = held_errors(motion_found)["validate"]
    for protocol, errors in held.items():
        for name, error in errors.items():
            assert own[protocol][name].rmse == pytest.approx(error.rmse, rel=1e-12)


def test_only_what_was_recorded_is_reported(motion_report, motion_found):
    assert motion_found[1].outputs == ("yaw_rate", "a_y")
    errors = rows(motion_report, "Errors by horizon")
    outputs = [row[0] for row in errors if "[" in row[0]]
    assert outputs == ["v_y [m/s]", "yaw rate [rad/s]", "a_y [m/s²]"]
    predicted = [row[1] for row in errors]
    assert predicted.count("model, training") == 2  # a lap without v_y: it cannot be pooled
    assert predicted.count("persistence, validation") == 3


def test_the_verdict_names_free_run_and_half_a_second_with_units(motion_report, motion_fit):
    good, against, sure = three(motion_report)
    assert good.startswith("On the held-out recording lap 3 (15.9 s), the RMSE of lateral in free run (and 0.5 s")
    assert re.search(r"\S+ ± \S+ \(\S+ ± \S+\) rad/s in yaw rate", good)
    assert f"{motion_fit.metrics['validate'][FREE_RUN]['yaw_rate']['rmse']:.5f}" in good
    assert against.startswith("Over 0.5 s, the RMSE of persistence")
    assert "times the standard deviation of the fit's residuals in v_y" in against
    assert "converged" in sure
    assert "Ipopt confirmed" in sure
    assert "yaw_rate_bias" in sure


def test_ipopt_s_doubt_is_passed_on(motion_fit, laps):
    doubted = judged(motion_fit, confirmed=False, status="Maximum Iterations Exceeded")
    sure = three(prepared(doubted, laps))[2]
    assert "Ipopt did not confirm the optimum: it ended with “Maximum Iterations Exceeded”" in sure


def test_intervals_are_those_of_the_fit(motion_report, motion_fit):
    row = next(row for row in rows(motion_report, "Parameters") if row[0] == "B_f")
    low, high = motion_fit.interval("B_f")
    assert row[3] == interval(float(low), float(high), float(motion_fit.sd["B_f"]))
    assert float(high - low) > 2 * 1.96 * float(motion_fit.sd["B_f"])  # Student's t


def test_effects_have_a_table_of_their_own_that_says_what_may_be_absent(motion_report):
    delay, bias = rows(motion_report, "Effects")
    assert delay[0] == "steering_delay"
    assert float(delay[2].split(" ")[0]) == pytest.approx(0.06, abs=0.01)
    assert "may be absent" not in delay[6]
    assert bias[6].endswith("may be absent: the interval holds 0")
    assert not {"steering_delay", "m"} & {row[0] for row in rows(motion_report, "Parameters")}
    assert any("m = 1457 kg" in part.words for part in below(motion_report, "Parameters") if isinstance(part, Text))


def test_what_is_told_together_is_said(motion_report):
    told = rows(motion_report, "Identifiable in combination")
    names = [row[0] for row in told]
    assert "C_alpha_f" in names
    assert all("%" in row[5] for row in told)


def test_a_fit_without_validation_says_so(motion_fit, laps):
    alone = replace(motion_fit, metrics={"train": motion_fit.metrics["train"]}, data=motion_fit.data[:2])
    said = three(prepared(alone, laps[:2]))
    assert "no recording was held out" in said[0]
    assert "training data" not in said[1]


def test_a_fit_without_covariance_says_that_this_is_not_known(motion_fit, laps):
    document = prepared(replace(motion_fit, covariance=None), laps)
    assert "is not known" in three(document)[2]
    assert below(document, "Identifiable in combination") == []
    assert not any(isinstance(part, Text) and part.lead == "Not determined" for part in document.flat)


def test_slip_angles_are_kept_along_the_drive(motion_found):
    for one in motion_found:
        assert len(one.quantities["alpha_f"]) == len(one.predicted[ahead(0.1)].rows)
        assert 0.01 < np.max(np.abs(one.quantities["alpha_f"])) < 0.2
