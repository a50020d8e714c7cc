"""What a report says is true whatever the numbers are."""

from dataclasses import replace

import numpy as np
import pytest
from report_parts import below

from greybox_id.base.numbers import (
    alike,
    exact,
    interval,
    number,
    percent,
    pretty_unit,
    quantity,
    signed,
    with_interval,
    with_sd,
)  # fmt: skip
from greybox_id.fitting.provenance import Certificate
from greybox_id.models.parameter import Parameter, Prior
from greybox_id.reports.content import scalars
from greybox_id.reports.memory import persistence_errors, verdict
from greybox_id.reports.report import prepared


@pytest.fixture
def sentences(found):
    return lambda fit: verdict(fit.model, fit, found, persistence_errors(fit, found))


def certified(fit, **changes):
    word = Certificate("Maximum Iterations Exceeded", False, 8, 100.0, 99.0, 1.0, 0.0, 2.0)
    return replace(fit, stages=(*fit.stages[:-1], replace(fit.stages[-1], certificate=replace(word, **changes))))


def test_the_verdict_is_three_sentences(small_fit, sentences):
    assert len(sentences(small_fit)) == 3
    assert all(sentence.endswith(".") for sentence in sentences(small_fit))


def test_ipopt_s_word_is_passed_on_as_it_was(small_fit, sentences):
    assert "Ipopt was not asked" in sentences(small_fit)[2]
    assert "did not confirm" in sentences(certified(small_fit))[2]
    assert "with an objective 1.0 % lower than before" in sentences(certified(small_fit))[2]
    confirmed = sentences(certified(small_fit, status="Solve Succeeded", confirmed=True, objective_after=100.0))[2]
    assert "Ipopt confirmed" in confirmed


def test_a_recording_that_chose_when_to_stop_is_not_called_unseen(small_fit, sentences):
    assert "held-out" in sentences(small_fit)[0]
    stopped = sentences(replace(small_fit, mode="early stopping"))
    assert "held-out" not in stopped[0]
    assert "determined when to stop" in stopped[0]


def test_a_fit_without_validation_says_so(small_fit, found, train):
    alone = replace(small_fit, metrics={"train": small_fit.metrics["train"]}, data=small_fit.data[:1])
    words = verdict(alone.model, alone, found[:1], persistence_errors(alone, found[:1]))
    assert "no recording was held out" in words[0]
    assert "not known" in words[1]
    assert len(below(prepared(alone, [train]), "Errors")[0].head) == 4


def test_a_model_worse_than_the_mean_is_called_so(small_fit, sentences):
    worse = {"yaw_rate": {"rmse": 2.0, "rmse_sd": 0.1, "fvu": 1.4, "samples": 10}}
    metrics = {**small_fit.metrics, "validate": {"honest": worse, "published": worse}}
    assert "no better than the signal's mean" in sentences(replace(small_fit, metrics=metrics))[0]


def test_scalars_have_an_interval_within_their_bounds_and_their_prior(small_fit):
    m = Parameter("m", "kg", 3.5, (0.5, 10.0), Prior(0.1), about="vehicle mass").with_value(0.6)
    g = Parameter("g", "m/s^2", 9.81, fixed=True)
    one = replace(small_fit, model=small_fit.model.with_parameters(m, g), sd={**small_fit.sd, "m": np.array(0.09)})
    mass, gravity = scalars(one).rows
    assert mass[2:6] == ("0.600 ± 0.090", "[0.500, 0.776]", "kg", "3.50 ± 0.10")
    assert mass[6].startswith("conflicts with the prior (29.0 sd)")
    assert gravity[3:6] == ("–", "m/s²", "held")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (with_sd(0.0955, 0.0072), "0.0955 ± 0.0072"),
        (with_sd(1.8e-5, 2.0e-5), "(1.8 ± 2.0)·10⁻⁵"),
        (with_sd(1234.5, 250.0), "1230 ± 250"),
        (with_sd(-0.00001, 0.1), "0.00 ± 0.10"),
        (with_sd(3.0, 0.0), "3.00"),
        (interval(0.5, 0.776, 0.09), "[0.500, 0.776]"),
        (number(float("nan")), "–"),
        (number(-0.25), "−0.250"),
        (number(0.001), "0.00100"),
        (number(9.997), "10.0"),
        (number(99_990.0), "1.00·10⁵"),
        (exact(0.001), "0.001"),
        (exact(1000.0), "1000"),
        (exact(1.2e-4), "1.2·10⁻⁴"),
        (signed(-9.81), "−9.81"),
        (signed(0.2, 2), "+0.20"),
        (percent(0.0216), "2.2 %"),
        (percent(1.4), "140 %"),
        (pretty_unit("N s^2/m^2"), "N s²/m²"),
        (pretty_unit("1"), "–"),
    ],
)
def test_numbers_show_the_digits_their_uncertainty_allows(words, expected):
    assert words == expected


def test_numbers_of_a_row_are_alike():
    assert alike(1.195e-8, 1.784, 3.502, 0.0016, by=0.0016) == ("0.0000", "1.7840", "3.5020", "0.0016")
    assert alike(0.0203, 1.2e-4, by=1.2e-4) == ("0.02030", "0.00012")
    assert alike(2.0e-5, 1.2e-6, by=1.2e-6) == ("2.00·10⁻⁵", "0.12·10⁻⁵")
    assert alike(1.0, np.nan, by=0.1) == ("1.00", "–")
    assert alike(1.0, 2.0, by=0.0) == ("1.00", "2.00")


def test_an_interval_over_powers_of_ten_shows_its_estimate():
    assert with_interval(1.0, 0.5, 1.5, 0.25) == "1.00 [0.50, 1.50]"
    assert with_interval(7.1e3, 1.2e-5, 5.9e12, 1.5e12) == "7100 [1.2·10⁻⁵, 5.9·10¹²]"
    assert quantity(0.0016, "kg", 2) == "0.0016 kg"
