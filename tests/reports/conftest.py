"""Small fits, shared by all tests of reports: of a map with memory, and of equations of motion."""

from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from driven import driven, without

from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording
from greybox_id.datasets.shipped import shipped
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.verb import fit
from greybox_id.models.msnn_lat import LateralSettings, covering_lat, msnn_lat
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle
from greybox_id.reports.recordings import driven as seen_driven
from greybox_id.reports.report import prepared, seen


@pytest.fixture(scope="session")
def train():
    return read(shipped("racer_train"), "roboracer").rows(0, 900)


@pytest.fixture(scope="session")
def validate():
    return read(shipped("racer_valid"), "roboracer").rows(0, 600)


@pytest.fixture(scope="session")
def small_fit(train, validate):
    model = msnn_lat(covering_lat(LateralSettings(n_delta=3, q=5), train))
    return fit(model, [train], validate=validate, how=FitOptions(strengths=1.0, solver="gauss-newton"), command="test")


@pytest.fixture(scope="session")
def found(small_fit, train, validate):
    return seen(small_fit.model, small_fit, [validate, train])


@pytest.fixture(scope="session")
def made(small_fit, train, validate):
    return prepared(small_fit, [train, validate]).drawings


@pytest.fixture(scope="session")
def simple():
    """Makes a recording of one run at 20 Hz from named signals."""

    def simple(**signals):
        n = len(next(iter(signals.values())))
        return Recording("made", 0.05 * np.arange(n), signals)

    return simple


@contextmanager
def uncompiled():
    """Small problems are solved sooner than C is compiled; what a session keeps lets go of the environment at once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GREYBOX_COMPILE", "0")
        yield


@pytest.fixture(scope="session")
@uncompiled()
def laps():
    """A car whose steering is later than stated, driven twice to fit it and once to judge; it has no gyro bias."""

    def lap(number, **kind):
        drive = driven("lateral", effects={"steering_delay": 0.06}, seed=10 * number, **kind)
        return replace(drive, name=f"lap {number}")

    late = lap(3)
    return [lap(1), without(lap(2, runs=1), "v_y"), late.with_signals(a_y=sparse(late["a_y"]))]


def sparse(values, every=4):
    """The values, most of them missing."""
    return np.where(np.arange(len(values)) % every == 0, values, np.nan)


@pytest.fixture(scope="session")
@uncompiled()
def motion_fit(laps):
    effects = {"steering_delay": None, "yaw_rate_bias": None}
    model = build("lateral", None, effects, vehicle("full_size_car"))
    model = model.with_parameters(*(replace(model[name], fixed=True) for name in ("m", "C_f", "C_r")))
    how = FitOptions(horizon=2.0, start_from="measured", starts=2)
    return fit(model, laps[:2], validate=laps[2], how=how, command="greybox fit laps")


@pytest.fixture(scope="session")
@uncompiled()
def motion_found(motion_fit, laps):
    return seen_driven(motion_fit.model, motion_fit, laps)


@pytest.fixture(scope="session")
@uncompiled()
def motion_report(motion_fit, laps):
    return prepared(motion_fit, laps)


@pytest.fixture(scope="session")
def motion_made(motion_report):
    return motion_report.drawings
