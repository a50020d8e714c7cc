"""The Ferrari 250 LM of the REVS recordings: its measured sideslip scores and never enters."""

from dataclasses import replace

import numpy as np
import pytest
from compiled import needs_compiler

from greybox_id.datasets.read import read
from greybox_id.filters.how import TrackOptions
from greybox_id.filters.verb import track
from greybox_id.fitting.requested_model import RequestedModel, named_vehicle
from greybox_id.models.effects import EFFECTS

pytestmark = [needs_compiler, pytest.mark.slow]


@pytest.fixture
def halves(real_data):
    whole = read(real_data / "revs_250lm" / "run1_first400s.csv.gz", "revs_250lm")
    half = int(np.searchsorted(whole.time, whole.time[0] + 200.0))
    return whole.rows(0, half), whole.rows(half, len(whole))


def tracked(recording, kind="ekf", smooth=False):
    vehicle = named_vehicle("ferrari_250lm")
    plan = vehicle.tracking
    how = TrackOptions(kind, smooth, known=plan.noise)
    model = RequestedModel(None, vehicle).model()
    return track(model, recording, plan.parameters, disturbances=plan.disturbances, effects=EFFECTS, how=how)


def blind(recording):
    return replace(recording, signals={n: recording[n] for n in ("v_x", "steer", "yaw_rate", "a_y")})


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
@pytest.mark.parametrize(("smooth", "rmse", "most"), [(False, 0.40, 2.2), (True, 0.32, 1.6)])
def test_sideslip_is_as_near_as_wanted_on_both_halves(halves, kind, smooth, rmse, most):
    for recording in halves:
        found = tracked(blind(recording), kind, smooth)
        late = recording.time - recording.time[0] >= 2.0
        error = np.degrees(found.values["sideslip"] - recording["sideslip"])[late]
        assert np.sqrt(np.mean(error**2)) <= rmse
        assert np.max(np.abs(error)) <= most
        covered = np.mean(np.abs(error) < 2 * np.degrees(found.sds["sideslip"])[late])
    assert covered >= 0.85  # of the second half


def test_three_spikes_of_the_steering_are_reported(halves):
    said = [
        sentence for half in halves for sentence in tracked(blind(half)).sentences if sentence.startswith("steer: ")
    ]
    assert len(said) == 2
    assert "0.1356 rad at t = 207.27 s" in said[0]
    assert "0.1496 rad at t = 503.49 s" in said[1]
    assert "0.2366 rad at t = 524.85 s" in said[1]


def test_measured_sideslip_and_v_y_are_not_used(halves):
    recording = halves[1].rows(0, 3000)
    found, other = tracked(recording), tracked(blind(recording))
    for name in found.values:
        np.testing.assert_array_equal(found.values[name], other.values[name])
        np.testing.assert_array_equal(found.sds[name], other.sds[name])
