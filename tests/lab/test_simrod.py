"""What hybrid models reach on the synthetic SimRod, on manoeuvres they were not trained on."""

import numpy as np
import pytest

from greybox_id.datasets.recording import join
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.scores.estimates import apply_hybrid
from greybox_id.fitting.verb import fit
from greybox_id.models.registry import prepared
from greybox_id.models.vehicle import vehicle
from greybox_lab.virtual.synthetic_simrod import make


@pytest.mark.examination
@pytest.mark.slow
@pytest.mark.parametrize("name", ["hybrid_stiffness", "hybrid_force"])
def test_forces_and_stiffnesses_of_held_out_manoeuvres_are_within_the_bars(name):
    recordings = [test.recording for test in make(0, "train")]
    model = prepared(name, join(recordings, "training"), vehicle=vehicle("simrod"))
    found = fit(model, recordings, how=FitOptions())
    relative = []
    for test in make(0, "held out"):
        estimates = apply_hybrid(found, test.recording)
        for axle in "fr":
            true = getattr(test.truth, f"F_y{axle}")
            off = estimates[f"F_y{axle}"] - true
            assert np.sqrt(np.mean(off**2)) < 0.04 * np.max(np.abs(true))
            relative.append(estimates[f"C_alpha_{axle}"] / getattr(test.truth, f"C_alpha_{axle}") - 1.0)
    told = np.concatenate(relative)
    assert np.sqrt(np.nanmean(told**2)) < 0.05
