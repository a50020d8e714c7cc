"""`greybox/Track-v0` as Gymnasium has it."""

import subprocess
import sys

import numpy as np
import pytest

import greybox_lab  # noqa: F401 - makes the environments known

gymnasium = pytest.importorskip("gymnasium")
pytestmark = pytest.mark.usefixtures("_uncompiled")


@pytest.mark.parametrize("options", [{}, {"action": "speed", "reward": "cth", "randomise": "hand", "noise": True}])
def test_gymnasiums_own_check_finds_nothing(options, recwarn):
    from gymnasium.utils.env_checker import check_env

    check_env(gymnasium.make("greybox/Track-v0", vehicle="roboracer", **options).unwrapped, skip_render_check=True)
    assert [str(own.message) for own in recwarn if "gymnasium" in str(own.filename)] == []


@pytest.mark.parametrize("order", ["gymnasium, greybox_lab", "greybox_lab, gymnasium"])
def test_it_is_known_whichever_is_imported_first(order):
    told = f"import {order}; print(gymnasium.spec('greybox/Track-v0').id)"
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True)
    assert done.stdout.strip() == "greybox/Track-v0", done.stderr


def test_many_begin_anew_with_the_next_step():
    many = gymnasium.make_vec("greybox/Track-v0", num_envs=3, vehicle="roboracer")
    many.reset(seed=5)
    ended = np.zeros(3, dtype=bool)
    for _ in range(400):
        before = ended
        seen, reward, over, cut, _ = many.step(np.tile(np.float32([0.0, 0.7]), (3, 1)))
        assert np.all(reward[before] == 0.0)
        assert np.all(seen[before, 5:7] == 0.0)  # no command was given yet
        assert not np.any((over | cut)[before])
        ended = over | cut
    assert many.unwrapped.metadata["autoreset_mode"] is gymnasium.vector.AutoresetMode.NEXT_STEP


def test_one_vehicle_is_a_lane_of_many():
    many = gymnasium.make_vec("greybox/Track-v0", num_envs=3, vehicle="roboracer", randomise="hand")
    one = gymnasium.make("greybox/Track-v0", vehicle="roboracer", randomise="hand")
    seen, own = many.reset(seed=7)[0], one.reset(seed=9)[0]
    assert np.array_equal(seen[2], own)
    for _ in range(50):
        action = np.float32([0.1, 0.2])
        stepped, alone = many.step(np.tile(action, (3, 1))), one.step(action)
        assert np.array_equal(stepped[0][2], alone[0])
        assert stepped[1][2] == alone[1]
