"""A weak observer: nothing at rate zero, near its reading otherwise, and no pull where model and vehicle agree."""

import numpy as np
import pytest
from driven import driven
from gap_cases import CAR, lap, nominal

from greybox_id.datasets.recording import Recording, join
from greybox_id.gap.estimation.bench import Bench
from greybox_id.gap.estimation.observer import PULLED, SEEN, observed, with_seen
from greybox_id.models.registry import build

pytestmark = pytest.mark.usefixtures("_uncompiled")


def predicted(model, recordings, *observers):
    """Readings of a model with observers of these states at these rates."""
    for state, rate in observers:
        model = observed(model, state, rate)
        recordings = [with_seen(own, state) for own in recordings]
    bench = Bench(model, recordings)
    return bench.simulate(bench.model.values[None])[0], bench


@pytest.mark.parametrize("state", ["v_x", "yaw_rate"])
def test_at_rate_zero_nothing_changes(state):
    own = [lap(seconds=6.0)]
    np.testing.assert_allclose(
        predicted(nominal(), own, (state, 0.0))[0], predicted(nominal(), own)[0], rtol=1e-10, atol=1e-10
    )


def test_a_pulled_state_stays_near_its_reading():
    own = [lap({"road_slope": 0.03}, seconds=15.0)]
    free, bench = predicted(nominal(), own)
    off = [np.abs(y[:, 0] - bench.measured[:, 0]) for y in (free, predicted(nominal(), own, ("v_x", 0.5))[0])]
    slowing = 9.81 * np.sin(0.03)
    assert off[0][-1] > 10 * slowing * 0.3
    assert np.mean(off[1][-250:]) == pytest.approx(slowing / 0.5, rel=0.1)  # what slows it, over the rate


@pytest.mark.parametrize(
    "effects",
    [
        {}, {"wheel_speed_scale": 1.06}, {"sensor_latency_vx": 0.037},
        {"wheel_speed_scale": 0.95, "sensor_latency_vx": 0.1},
    ],
)  # fmt: skip
def test_the_pull_is_zero_where_model_and_vehicle_agree(effects):
    drive = driven("single_track", runs=1, seconds=8.0, effects=effects, noise=0.0)
    drive = drive.rows(5, len(drive))  # a latency has passed
    pulled, bench = predicted(build("single_track", None, effects, CAR), [drive], ("v_x", 2.0))
    np.testing.assert_allclose(pulled[100:, 0], bench.measured[100:, 0], atol=1e-3)


def test_two_states_can_be_observed_at_once():
    own = [lap({"grip_scale": 0.8}, seconds=8.0)]
    free, bench = predicted(nominal(), own)
    pulled, _ = predicted(nominal(), own, ("v_x", 0.3), ("yaw_rate", 3.0))
    off = [np.sqrt(np.mean((y[:, 2] - bench.measured[:, 2]) ** 2)) for y in (free, pulled)]
    assert off[1] < 0.9 * off[0]


def test_the_rate_is_a_parameter_that_is_held():
    model = observed(nominal(), "v_x", 0.3)
    assert model[PULLED.format("v_x")].fixed
    assert float(model[PULLED.format("v_x")].array) == 0.3
    assert model.inputs[-1] == SEEN.format("v_x")


def test_what_the_observer_reads_runs_straight_over_rows_without_a_reading_but_not_from_run_to_run():
    time = np.arange(5.0)
    first = Recording("a", time, {"v_x": np.array([1.0, np.nan, 3.0, np.nan, np.nan])})
    second = Recording("b", time, {"v_x": np.array([np.nan, 20.0, np.nan, 40.0, 50.0])})
    seen = with_seen(join([first, second], "both"), "v_x")[SEEN.format("v_x")]
    np.testing.assert_array_equal(seen, [1, 2, 3, 3, 3, 20, 20, 30, 40, 50])
