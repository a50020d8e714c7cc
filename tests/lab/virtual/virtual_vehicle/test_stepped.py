"""A vehicle that is commanded step by step goes where the same commands lead at once."""

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import Recording
from greybox_lab.virtual.virtual_vehicle import SteppedCar, random_vehicle, replay

RATE, ROWS = 50.0, 60


@pytest.mark.parametrize("forms", ["nominal", "other"])
def test_steps_add_up_to_a_replay(forms):
    car, effects = random_vehicle(3, "racer"), {"steering_delay": 0.033, "tyre_relaxation": 0.1}
    k = np.arange(ROWS)
    steer, drive = 0.1 * np.sin(0.2 * k), 3.0 * np.cos(0.1 * k)
    steer[0] = drive[0] = 0.0  # the first commands were in force for ever before
    commands = Recording("told", k / RATE, {"steer": steer, car.drive_channel: drive})
    _, truth = replay(car, commands, {"v_x": 4.0}, effects, forms, seed=5)
    ride = SteppedCar(car, 4.0, ROWS / RATE, RATE, effects, forms, seed=5)
    for row in range(ROWS):
        seen = ride.motion
        for name in ("v_x", "v_y", "yaw_rate", "x", "y", "yaw"):
            assert seen[name] == pytest.approx(truth.states[name][row], abs=1e-12)
        ride.step(steer[row], drive[row])
    assert ride.time == pytest.approx(ROWS / RATE)
    np.testing.assert_array_equal(ride.truth()["F_yf"], truth.states["F_yf"])


def test_a_drive_that_is_over_says_so():
    ride = SteppedCar(random_vehicle(3, "racer"), 4.0, 0.1, RATE)
    for _ in range(5):
        ride.step(0.0, 0.0)
    with pytest.raises(BadInput, match=r"drive ended after 0\.1 s"):
        ride.step(0.0, 0.0)
