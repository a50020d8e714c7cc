"""A small fit to a slice of a shipped recording, shared by all tests of reports."""

import numpy as np
import pytest

from greybox_id.datasets.read import read
from greybox_id.datasets.shipped import shipped
from greybox_id.fitting import How, fit
from greybox_id.models.msnn_lat import LateralSettings, covering_lat, msnn_lat
from greybox_id.recording import Recording
from greybox_id.reports.drawings import drawings
from greybox_id.reports.noise import noise
from greybox_id.reports.recordings import seen


@pytest.fixture(scope="session")
def train():
    return read(shipped("racer_train"), "roboracer").rows(0, 900)


@pytest.fixture(scope="session")
def validate():
    return read(shipped("racer_valid"), "roboracer").rows(0, 600)


@pytest.fixture(scope="session")
def small_fit(train, validate):
    model = msnn_lat(covering_lat(LateralSettings(n_delta=3, q=5), train))
    return fit(model, [train], validate=validate, how=How(strengths=1.0, solver="gauss-newton"), command="test")


@pytest.fixture(scope="session")
def found(small_fit, train, validate):
    return seen(small_fit, [validate, train])


@pytest.fixture(scope="session")
def made(small_fit, found):
    return drawings(small_fit, found, noise([one.recording for one in found]))


@pytest.fixture(scope="session")
def simple():
    """Makes a recording of one run at 20 Hz from named signals."""

    def simple(**signals):
        n = len(next(iter(signals.values())))
        return Recording("made", 0.05 * np.arange(n), signals)

    return simple
