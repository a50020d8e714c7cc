"""A slider shows what `gb.simulate` says; a bench holds the equations so that it may be dragged."""

import numpy as np
import pytest

import greybox_id as gb
from greybox_lab.app.model import Playground, lacking, moved, nominal, prior_of, span_of, stated_effects

CHOSEN = {"name": "lateral", "vehicle": "roboracer", "settings": {}, "effects": ["steering_delay"], "start": {}}
pytestmark = pytest.mark.usefixtures("_uncompiled")


@pytest.fixture(scope="module")
def lap():
    return gb.read(gb.datasets.shipped("racer_train"), columns="roboracer")


def test_a_bench_simulates_what_the_library_does(lap):
    bench = Playground(nominal(CHOSEN), lap)
    assert len(bench.recording) == max(stop - start for start, stop in lap.runs)
    for values in ({}, {"m": 2.5, "steering_delay": 0.08}):
        whole = gb.simulate(moved(nominal(CHOSEN), values), bench.recording)
        for name, trace in bench.simulate(values).items():
            np.testing.assert_allclose(trace, whole[name], rtol=1e-9, atol=1e-9)


def test_sliders_hold_value_and_prior_within_bounds():
    parameters = nominal(CHOSEN).parameters
    spans = {each.name: span for each in parameters if (span := span_of(each)) is not None}
    assert {"m", "I_z", "steering_delay"} <= spans.keys()
    for each in parameters:
        if each.name in spans:
            low, high = spans[each.name]
            assert each.bounds[0] <= low <= float(each.array) <= high <= each.bounds[1]
            prior = prior_of(each)
            assert prior is None or low <= prior[0] <= high


def test_what_a_recording_lacks_is_a_sentence(lap):
    assert lacking("lateral", lap) == ""
    without = gb.Recording("b", lap.time, {"yaw_rate": lap["yaw_rate"]}, lap.runs)
    assert "lacks" in lacking("lateral", without)


def test_effects_that_the_vehicle_file_states_are_proposed():
    assert stated_effects("lateral", "roboracer") == ["steering_lag", "yaw_rate_bias", "accel_bias_y"]
    assert stated_effects("longitudinal", "roboracer") == ["accel_bias_x"]
    assert stated_effects("lateral", "") == []
