"""Innovations tell a vehicle that is another one, and do not where it is the same."""

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.models.registry import motion_model_of
from greybox_lab.driving.loop.adapting import world_of
from greybox_lab.driving.loop.arms import oracle
from greybox_lab.driving.loop.scene import Hands, Scene, driven
from greybox_lab.driving.loop.triggers import InnovationBand, _freedom
from greybox_lab.driving.racing.learner import shipped_learned

SCENE = Scene(1)
ROWS = 2000


class Changed(Scene):
    """The same vehicle, after something happened to it."""

    def __init__(self, **by):
        super().__init__(1)
        object.__setattr__(self, "by", by)

    @property
    def effects(self):
        """What was there, and what came."""
        nulls = {"steering_delay": 0.0}
        had = SCENE.effects
        return had | {name: had.get(name, nulls.get(name, 1.0)) + more for name, more in self.by.items()}


def rows(scene, seed, cap=0.6, number=ROWS):
    units = world_of(motion_model_of(scene.vehicle), scene.vehicle, 1, cap)
    return driven(scene, Hands(units, shipped_learned().policy.act), number, seed).recordings


@pytest.fixture(scope="module")
def band():
    return InnovationBand.of(oracle(SCENE.vehicle, SCENE.effects).model, rows(SCENE, 3))


def test_freedom_is_that_of_correlated_values():
    generator = np.random.default_rng(0)
    noise = generator.standard_normal((3, 40_000))
    alone = np.mean(noise**2, axis=0)
    assert _freedom([alone[:20_000], alone[20_000:]]) == pytest.approx(3.0, rel=0.1)
    assert _freedom([np.repeat(alone, 4)]) == pytest.approx(0.75, rel=0.15)


def test_the_same_vehicle_is_within_the_band_and_another_one_beyond(band):
    assert band.channels == (0, 1, 2)
    assert band.beyond(rows(SCENE, 100)) == ""
    assert "squared innovations" in band.beyond(rows(Changed(grip_scale=-0.15), 100))
    assert band.beyond(rows(Changed(grip_scale=-0.15), 100, number=300)) == ""  # too few to say
    with pytest.raises(BadInput, match="too little"):
        InnovationBand.of(band.model, rows(SCENE, 3, number=300))


@pytest.mark.examination
@pytest.mark.slow
def test_false_alarms_are_rare_and_changes_are_told(band):
    false = sum(bool(band.beyond(rows(SCENE, 200 + k, cap))) for k in range(6) for cap in (0.6, 0.66))
    assert false <= 1
    changes = (
        {"grip_scale": -0.1}, {"grip_scale": -0.15}, {"mass_change": 0.1}, {"steering_ratio": 0.05},
        {"steering_ratio": -0.05}, {"steering_delay": 0.03}, {"motor_gain": -0.1}, {"steering_lag": 0.04},
    )  # fmt: skip
    told = [bool(band.beyond(rows(Changed(**by), 300))) for by in changes]
    assert np.mean(told) >= 0.75
