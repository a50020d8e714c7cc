"""Profiles and draws count what the fit's intervals count: the same width, and the truth within."""

from dataclasses import replace

import numpy as np
import pytest
from driven import driven
from scipy.stats import binom

import greybox_id as gb
from greybox_id.api.profiles import profiles
from greybox_id.fitting.uncertainty.beyond_noise import wider
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle

QUICK = gb.FitOptions(solver="gauss-newton", horizon=1.0, start_from="measured")
FREE = ("B_f", "I_z")


def lacking(seed=0):
    """A fit to a drive whose rack has a gain that grows with its angle, which the model lacks."""
    model = build("lateral", None, {}, vehicle("full_size_car"))
    model = model.with_parameters(*(replace(p, fixed=p.name not in FREE, prior=None) for p in model.parameters))
    lap = driven(runs=1, seconds=12.0, seed=seed)
    growth = float(np.random.default_rng(seed).uniform(20.0, 60.0))
    lap = lap.with_signals(steer=lap["steer"] * (1 + growth * lap["steer"] ** 2))
    return gb.fit(model, lap, options=QUICK), {name: float(model[name].array) for name in FREE}


@pytest.fixture(scope="module")
def fitted():
    return lacking()[0]


def test_a_profile_that_is_nearly_a_parabola_has_the_fits_interval(fitted):
    for name, one in profiles(fitted, FREE, fitted.seen("train")).found.items():
        low, high = map(float, fitted.interval(name))
        assert one.wald == pytest.approx((low, high), rel=1e-6)
        assert one.sd == pytest.approx(float(fitted.sd[name]), rel=1e-6)
        np.testing.assert_allclose(one.profile.interval, (low, high), atol=0.03 * (high - low))
        alone = one.profile.noise_alone.interval
        np.testing.assert_allclose(alone, one.noise_wald, atol=0.03 * (alone[1] - alone[0]))
        assert low < alone[0] < alone[1] < high


def test_draws_are_as_wide_as_the_fit_says(fitted):
    drawn = gb.sample(fitted, method="laplace", draws=2000)
    for name in FREE:
        assert drawn.table["sd"][name] == pytest.approx(float(fitted.sd[name]), rel=0.1)
        assert drawn.table["sd_noise_alone"][name] < 0.9 * float(fitted.sd[name])


def test_draws_of_a_width_far_beyond_the_estimate_end_at_the_bounds(fitted):
    scale = 3000.0
    sd = {name: scale * one for name, one in fitted.sd.items()}
    drawn = gb.sample(replace(fitted, sd=sd, covariance=scale**2 * fitted.covariance), method="laplace", draws=500)
    for name in FREE:
        low, high = fitted.model[name].bounds
        assert drawn.frame[name].between(low, high).all()
        assert (drawn.table["low"][name], drawn.table["high"][name]) == pytest.approx((low, high))
    again = gb.sample(fitted, method="laplace", draws=500)
    np.testing.assert_allclose(drawn.noise_alone, again.noise_alone, rtol=1e-9)


def test_a_fit_that_states_no_width_or_less_than_the_noise_leaves_the_noise(fitted):
    sd = float(fitted.sd["B_f"])
    assert wider(fitted, "B_f", 0.5 * sd) == pytest.approx(2.0)
    assert wider(fitted, "B_f", 2.0 * sd) == 1.0
    assert wider(replace(fitted, sd={}), "B_f", sd) == 1.0
    assert wider(fitted, "B_f", 0.0) == wider(fitted, "B_f", np.inf) == 1.0


@pytest.mark.slow
def test_where_an_effect_is_left_out_intervals_hold_the_truth():
    """Of 80 intervals that hold the truth with 95 %, fewer than 70 do once in a thousand times."""
    held = {"profile": [], "profile alone": [], "draws": [], "draws alone": []}
    for seed in range(40):
        fit, truth = lacking(seed)
        table = gb.sample(fit, method="laplace", draws=1000, seed=seed).table
        for name, one in profiles(fit, FREE, fit.seen("train")).found.items():
            row, value = table.loc[name], truth[name]
            ends = {
                "profile": one.profile.interval, "profile alone": one.profile.noise_alone.interval,
                "draws": (row["low"], row["high"]), "draws alone": (row["low_noise_alone"], row["high_noise_alone"]),
            }  # fmt: skip
            for kind, (low, high) in ends.items():
                held[kind].append(low <= value <= high)
    shares = {kind: float(np.mean(one)) for kind, one in held.items()}
    enough = float(binom.ppf(1e-3, 80, 0.95)) / 80
    assert min(shares["profile"], shares["draws"]) > enough > max(shares["profile alone"], shares["draws alone"])
