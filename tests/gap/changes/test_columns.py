"""What the commanded and the measured steering angle tell of a steering that changed."""

import numpy as np
import pytest

from greybox_id.datasets.recording import Recording
from greybox_id.gap.changes.columns import EFFECTS, steering_changes


def slalom(ratio=1.0, offset=0.0, delay=0.04, seed=0, measured=True, amplitude=0.1):
    rng, time = np.random.default_rng(seed), np.arange(0.0, 25.0, 0.02)
    command = amplitude * np.sin(0.9 * time + seed) + 0.4 * amplitude * np.sin(2.1 * time)
    late = np.interp(time - delay, time, command)
    read = ratio * late + offset + 1e-3 * rng.standard_normal(len(time))
    signals = {"steer": command, "v_x": np.full(len(time), 8.0)}
    return Recording(f"slalom{seed}", time, signals | ({"steer_measured": read} if measured else {}))


BEFORE = [slalom(seed=1), slalom(1.001, seed=2)]


@pytest.mark.parametrize(
    ("changed", "effect", "shift"),
    [({"ratio": 1.05}, "steering_ratio", np.log(1.05)), ({"offset": 0.005}, "steering_offset", 0.005),
     ({"delay": 0.09}, "steering_delay", 0.05)],
)  # fmt: skip
def test_what_changed_between_command_and_wheel_is_told_with_its_size(changed, effect, shift):
    (own,) = steering_changes([slalom(**changed, seed=3)], BEFORE)
    assert own.effect == effect
    assert own.shift == pytest.approx(shift, abs=4 * own.sd)
    assert own.sd < 0.1 * abs(shift)
    assert own.probability > 0.999


def test_several_may_have_changed_at_once():
    told = steering_changes([slalom(0.9, 0.01, 0.1, seed=4)], BEFORE)
    assert [own.effect for own in told] == list(EFFECTS)


def test_where_nothing_changed_or_one_column_is_there_alone_nothing_is_told():
    assert [steering_changes([slalom(1.0005, seed=k)], BEFORE) for k in range(5, 25)] == [()] * 20
    assert steering_changes([slalom(1.2, seed=3, measured=False)], BEFORE) == ()
    assert steering_changes([slalom(1.2, seed=3)], [slalom(seed=1, measured=False)]) == ()
    assert steering_changes([slalom(1.2, seed=3, amplitude=1e-6)], BEFORE) == ()


def test_a_ratio_that_differed_before_is_no_change():
    scattered = [slalom(ratio, seed=k) for k, ratio in enumerate((0.95, 1.0, 1.05), 30)]
    assert steering_changes([slalom(1.06, seed=40)], scattered) == ()
