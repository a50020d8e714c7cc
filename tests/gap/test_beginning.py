"""Effects that begin within a recording, or end: named with the instant; what acts all the time does not begin."""

from dataclasses import replace

import numpy as np
import pytest
from gap_cases import CAR, FULL_SIZE_CAR, NOISE, lap, nominal
from made_gaps import clear as made_gap
from reference_manoeuvres import manoeuvre
from reference_vehicle import simulate

from greybox_id.api.closed_vehicle import closed_vehicle
from greybox_id.datasets.recording import Recording
from greybox_id.gap.diagnosis import diagnose
from greybox_id.gap.estimation.axes import ActingRows
from greybox_id.models.effects import vocabulary
from greybox_id.reports.gap.saved import as_plain_data, from_plain_data
from greybox_id.reports.gap.words import carried_over, magnitude_words, verdict

AT = 12.0


def changing(before, after, seconds=30.0, seed=0):
    """A recording of the independent simulator, whose effects are others from `AT` on; the motion carries on."""
    given = manoeuvre("mixed", FULL_SIZE_CAR, seed=seed, duration=seconds, rate=50.0)
    row, parts, start = round(AT * 50), [], (given["v_x"][0], 0.0, 0.0)
    for effects, rows in ((before, slice(0, row + 1)), (after, slice(row, None))):
        own = {name: values[rows] for name, values in given.items() if np.ndim(values)}
        parts.append(simulate(FULL_SIZE_CAR, own, effects, start=start, fine=1e-3))
        start = tuple(parts[-1][f"true_{name}"][-1] for name in ("v_x", "v_y", "yaw_rate"))
    rng = np.random.default_rng(1000 + seed)
    read = {name: np.concatenate([parts[0][name][:-1], parts[1][name]]) for name in NOISE}
    noisy = {name: read[name] + sd * rng.standard_normal(len(read[name])) for name, sd in NOISE.items()}
    return Recording("lap", given["time"], {"steer": given["steer"], "ax_cmd": given["drive"], **noisy})


def diagnosed(recording):
    return diagnose(nominal(), [recording], vocabulary(), vehicle=CAR)


@pytest.fixture(scope="module")
def rain():
    """Grip that goes within a lap, diagnosed once."""
    return diagnosed(changing({}, {"grip_scale": 0.8}))


@pytest.mark.slow
def test_grip_that_goes_within_a_lap_is_told_from_when_on(rain):
    first = rain.ranking[0]
    assert rain.applied == ("grip_scale",)
    assert first.since == pytest.approx(AT, abs=0.5)
    assert (first.until, first.within) == (None, "lap")
    assert first.magnitude == pytest.approx(0.8, abs=0.02)
    assert rain.gap.closed > 0.9
    assert magnitude_words(first).endswith("from 12.0 s on (lap)")


@pytest.mark.slow
def test_the_closed_vehicle_is_the_one_at_the_end_and_that_is_said(rain):
    assert float(rain.closed["grip_scale"].array) == pytest.approx(0.8, abs=0.03)
    assert closed_vehicle(CAR, rain).model.effects["grip_scale"].value == pytest.approx(0.8, abs=0.03)
    (sentence,) = carried_over(rain)
    assert "includes it, and describes the vehicle only from then on" in sentence
    assert any(sentence[1:] in words for _, words in verdict(rain))


@pytest.mark.slow
def test_a_diagnosis_with_an_instant_is_read_back_as_it_was_written(rain):
    again = from_plain_data(as_plain_data(rain))
    assert again.ranking == rain.ranking
    body = as_plain_data(rain)
    for own in body["ranking"]:  # as files of before are
        for name in ("since", "until", "within"):
            del own[name]
    assert from_plain_data(body).ranking[0].since is None


@pytest.mark.slow
def test_grip_that_is_less_all_the_time_does_not_begin():
    first = diagnosed(lap({"grip_scale": 0.8}, 30.0)).ranking[0]
    assert (first.effect, first.since, first.until) == ("grip_scale", None, None)


@pytest.mark.slow
def test_nothing_begins_where_nothing_is():
    found = diagnosed(lap(seconds=30.0))
    assert not found.gap_detected
    assert all(own.since is None and own.until is None for own in found.ranking)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "value"),
    [("mass_change", 1.15), ("yaw_rate_bias", 0.02), ("motor_gain", 0.85), ("front_stiffness", 0.8)],
)
def test_what_ends_within_a_lap_is_told_until_when(effect, value):
    found = diagnosed(changing({effect: value}, {}))
    first = found.ranking[0]
    assert effect in (first.effect, *first.indistinguishable_from)
    assert first.until == pytest.approx(AT, abs=0.6)
    own = next(each for each in found.ranking if each.effect == effect)
    assert own.interval[0] <= value <= own.interval[1]


def test_what_ended_is_not_carried_over():
    gap = made_gap()
    ended = replace(gap.ranking[0], until=12.0, within="lap7")
    gap = replace(gap, ranking=(ended, *gap.ranking[1:]), applied=(ended.effect,), closed=None)
    (sentence,) = carried_over(gap)
    assert "omits it, and describes the vehicle only from then on" in sentence
    assert not ended.lasts
    assert ended.effect not in closed_vehicle(CAR, gap).model.effects
    assert not ActingRows(slice(0, 5), "lap7", until=12.0).lasts
