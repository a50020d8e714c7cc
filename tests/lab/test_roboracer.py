"""What the networks reach on the real recordings of a 1:10 car, beside what was published.

Nothing here is chosen on the validation recording: priors are taken as stated.
Published figures: Mungiello et al., Tables 1 and 2.
"""

import pytest

import greybox_id as gb
from greybox_id.datasets.read import read
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.verb import fit
from greybox_id.models.registry import prepared


@pytest.fixture
def recordings(real_data):
    folder = real_data / "roboracer"
    return read(folder / "train.csv", "roboracer"), read(folder / "valid.csv", "roboracer")


def test_the_lateral_network_predicts_the_yaw_rate_as_well_as_the_authors_with_their_protocol(recordings):
    train, valid = recordings
    found = fit(prepared("msnn_lat", train), [train], validate=valid, how=FitOptions(strengths=1.0))
    errors = found.metrics["validate"]
    assert found.model.size == 160
    assert errors["published"]["yaw_rate"]["rmse"] <= 0.109
    assert errors["honest"]["yaw_rate"]["rmse"] <= 0.0995


def test_sixty_percent_of_the_training_data_are_enough_for_the_published_error_of_all_of_them(recordings):
    train, valid = recordings
    part = train.rows(0, round(0.6 * len(train)))
    found = fit(prepared("msnn_lat", part), [part], validate=valid, how=FitOptions(strengths=1.0))
    assert found.metrics["validate"]["published"]["yaw_rate"]["rmse"] <= 0.137


@pytest.mark.slow
def test_the_closed_loop_costs_the_yaw_rate_less_than_three_percent(recordings):
    train, valid = recordings
    found = fit(prepared("msnn_full", train), [train], validate=valid, how=FitOptions(strengths=1.0))
    errors = found.metrics["validate"]
    assert found.model.size == 544
    assert errors["published"]["yaw_rate"]["rmse"] <= 0.109
    assert errors["closed_loop"]["yaw_rate"]["rmse"] <= 1.03 * errors["honest"]["yaw_rate"]["rmse"]
    assert errors["published"]["a_x"]["rmse"] <= 0.55


@pytest.mark.examination
@pytest.mark.slow
def test_additions_beyond_the_paper_help_where_they_should(recordings):
    train, valid = recordings
    settings = {"lat": {"n_delta": 5}, "steering_rate_limit": 3.5, "symmetric": False}
    found = fit(prepared("msnn_full_plus", train, settings), [train], validate=valid, how=FitOptions(strengths=1.0))
    errors = found.metrics["validate"]
    assert errors["honest"]["yaw_rate"]["rmse"] <= 0.0945
    assert errors["published"]["a_x"]["rmse"] <= 0.50


@pytest.mark.slow
@pytest.mark.parametrize("quarters", [1, pytest.param(4, marks=pytest.mark.examination)])
def test_a_car_of_guesses_has_an_answer_and_nothing_is_applied_that_closes_nothing(recordings, quarters):
    """Its tyres are guesses, and a search passes by cars that spin."""
    train, valid = recordings
    part = train.rows(0, round(quarters / 4 * len(train)))
    gap = gb.diagnose("single_track", part, vehicle="roboracer", held_out=valid)
    assert gap.gap_detected
    assert gap.unknown_probability > 0.9
    assert not gap.applied or gap.held_out.closed > 0.1
