"""A fit to be made more precise, and a diagnosis that could not tell two effects apart; small ones."""

import pytest

import greybox_id as gb
from greybox_lab.virtual.virtual_vehicle import drive, random_vehicle, toleranced

SEED = 8001
FIVE = ("I_z", "B_f", "D_f", "B_r", "D_r")


@pytest.fixture(scope="session")
def car():
    """A car as it is stated."""
    return random_vehicle(SEED, "car")


@pytest.fixture(scope="session")
def fit(car):
    """A fit of a short mixed drive of a true car within the stated one's tolerances, of other forms."""
    import numpy as np

    true = toleranced(car, np.random.default_rng(SEED))
    lap, _ = drive(true, "mixed", 12.0, 50.0, forms="other", seed=SEED, colour=0.3)
    stated = gb.Vehicle(car.name, values={name: gb.models.Stated(value) for name, value in car.parameters.items()})
    return gb.fit("single_track", lap, vehicle=stated, fix=["C_f", "C_r"])


@pytest.fixture(scope="session")
def limits(car):
    """Its limits."""
    return {"steer_max": car.steer_max, "speed_max": 20.0, "grip": 0.9}


@pytest.fixture(scope="session")
def design(fit, limits):
    """A manoeuvre designed with little effort."""
    return gb.design(fit, arena="disc:60", parameters=FIVE, duration=8.0, rate=25.0, limits=limits, effort=0.1)
