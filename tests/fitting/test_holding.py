"""Steering between rows: the likelier way is taken where no map says, and a map that is wrong is asked about."""

from dataclasses import replace

import pytest
from motion import FULL_SIZE_CAR, SHAPE, car, recorded

from greybox_id.datasets.recording import Source
from greybox_id.fitting.verb import fit


def drive(true, hold, stated):
    recording = recorded("lateral", hold=true, seconds=20.0, rate=25.0)
    return replace(recording, hold=hold, hold_stated=stated, source=Source(path="lap.csv"))


@pytest.mark.parametrize("true", ["zero", "linear"])
def test_the_likelier_way_is_taken_where_nobody_says(true):
    found = fit(car("lateral", held=SHAPE), [drive(true, "zero", False)])
    assert found.how["hold"]["taken"] == true
    low, high = found.interval("I_z")
    assert low < FULL_SIZE_CAR["I_z"] < high
    assert not any('hold = "' in reason for reason in found.verdict.reasons)


def test_a_map_that_is_wrong_is_asked_about_and_its_doubt_counted():
    wrong = fit(car("lateral", held=SHAPE), [drive("linear", "zero", True)])
    assert wrong.verdict.usability != "usable"
    assert any(
        'The column map says hold = "zero"' in reason and 'hold = "linear"' in reason
        for reason in wrong.verdict.reasons
    )
    low, high = wrong.interval("I_z")
    assert low < FULL_SIZE_CAR["I_z"] < high
    right = fit(car("lateral", held=SHAPE), [drive("linear", "linear", True)])
    assert not any('hold = "' in reason for reason in right.verdict.reasons)
    assert right.sd["I_z"] < 0.5 * wrong.sd["I_z"]
