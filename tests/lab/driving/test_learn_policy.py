"""`learn_policy`: policies from nothing, and tuned to another vehicle."""

import numpy as np
import pytest

import greybox_id as gb
from greybox_lab.driving.learn_policy import learn_policy
from greybox_lab.driving.racing.learner import shipped_learned

pytestmark = pytest.mark.usefixtures("_uncompiled")


def test_a_policy_is_learned_kept_and_tuned_to_a_vehicle_with_an_effect(tmp_path):
    told = []
    learned = learn_policy("roboracer", 1, lanes=2, say=told.append)
    assert "of 256 steps" in told[0]
    assert learned.policy.about["rules"]["usage"] == (0.4, 0.95)
    learned.save(tmp_path / "policy.json")
    tuned = learn_policy(
        "roboracer", 1, lanes=2, effects="grip_scale=0.8", start=tmp_path / "policy.json", like="roboracer",
        randomise="none",
    )  # fmt: skip
    assert tuned.policy.about["units"] == learned.policy.about["units"]
    assert not np.array_equal(tuned.policy.weights[0], learned.policy.weights[0])


def test_a_start_with_other_units_is_refused():
    with pytest.raises(gb.BadInput, match=r"7\.63108 as the unit of speed.* like="):
        learn_policy("roboracer", 1, lanes=2, effects="grip_scale=0.8", start=shipped_learned())


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"lanes": 0}, "lanes"),
        ({"start": 3}, "start"),
        ({"start": "nowhere.json"}, "nowhere.json"),
        ({"vehicle": "bicycle"}, "bicycle"),
        ({"model": "kinematic"}, "kinematic"),
        ({"model": "msnn_lat"}, "has no equations of motion"),
        ({"steps": 0}, "steps"),
        ({"rewards": "cth"}, "rewards"),
        ({"usage": "much"}, "usage"),
        ({"randomise": "paw"}, "paw"),
    ],
)
def test_what_cannot_be_driven_is_refused(wrong, said):
    with pytest.raises(gb.GreyboxError, match=said):
        learn_policy(**{"steps": 1, "lanes": 2, **wrong})
