"""What is drawn for an episode: of ranges, posteriors, fits and gaps."""

from types import SimpleNamespace

import numpy as np
import pytest

import greybox_id as gb
from greybox_id.base.errors import BadInput
from greybox_id.gap.gap import Limit, Ranked
from greybox_id.models.registry import with_effects
from greybox_lab.driving.racing.draws import of_fit, of_gap
from greybox_lab.driving.racing.worlds import world

CAR = gb.models.single_track(vehicle="roboracer")
CLOSED = with_effects(CAR, {"steering_lag": 0.05})


def told(probability=1.0, limits=()):
    """What of a gap is read."""
    lag = Ranked("steering_lag", probability, 0.05, "s", (0.04, 0.06))
    other = Ranked("mass_change", 0.8, 1.1, "", (1.0, 1.2))
    return SimpleNamespace(ranking=(lag, other), applied=("steering_lag",), closed=CLOSED, limits=dict(limits))


def drawn(found, name, times=400):
    return np.array([found.draw(np.random.default_rng(k))[name] for k in range(times)])


def test_what_was_applied_is_drawn_within_its_interval():
    found = of_gap(told())
    assert found.names == ("steering_lag",)
    lags = drawn(found, "steering_lag")
    assert np.mean(lags) == pytest.approx(0.05, abs=0.001)
    assert np.std(lags) == pytest.approx(0.0051, rel=0.2)
    assert np.min(lags) >= 0.0
    unlikely = drawn(of_gap(told(0.9)), "steering_lag")
    assert np.mean(unlikely == 0.0) == pytest.approx(0.1, abs=0.05)  # at its null: not there


def test_an_effect_that_has_no_finite_null_is_there_in_every_draw():
    closed = with_effects(CAR, {"steering_rate_limit": 2.0})
    limited = Ranked("steering_rate_limit", 0.8, 2.0, "rad/s", (1.8, 2.2))
    gap = SimpleNamespace(ranking=(limited,), applied=("steering_rate_limit",), closed=closed, limits={})
    assert np.all(np.isfinite(drawn(of_gap(gap), of_gap(gap).names[0])))


def test_what_would_not_have_shown_is_drawn_up_to_where_it_would():
    limits = {
        "steering_delay": Limit(0.05, 0.03, "s", 1.7, 0.9),  # usually less than would show
        "grip_scale": Limit(0.5, 0.8, "1", 2.5, 0.1),
        "mass_change": Limit(0.02, 1.1, "1", 0.2, 0.9),  # would have shown
        "steer_rate_limit": Limit(0.0, 3.0, "rad/s", 9.0, 0.9),  # nothing at infinity
    }
    found = of_gap(told(limits=limits))
    assert set(found.names) == {"steering_lag", "steering_delay", "grip_scale"}
    assert dict(found.effects) == {"steering_delay": 0.0, "grip_scale": 1.0}
    delays, grips = drawn(found, "steering_delay"), drawn(found, "grip_scale")
    assert np.min(delays) == 0.0
    assert 0.028 < np.max(delays) <= 0.03
    assert (np.min(grips), np.max(grips)) == pytest.approx((0.8, 1.2), abs=0.01)
    assert of_gap(told(limits=limits), unseen=False).names == ("steering_lag",)
    lanes = world(4, model=found.suited(CLOSED), action="speed")
    assert {"steering_delay", "grip_scale"} <= set(lanes.stage.equations.model.effects)


def test_a_fit_is_drawn_with_its_covariance():
    numbers = sum(parameter.array.size for parameter in CAR.parameters)
    at = {parameter.name: k for k, parameter in enumerate(CAR.parameters)}  # all of them are single numbers
    free = [parameter.name for parameter in CAR.parameters if not parameter.fixed][:2]
    covariance = np.full((numbers, numbers), np.nan)
    sd = [0.05 * abs(float(CAR[name].array)) for name in free]
    rows = [at[name] for name in free]
    covariance[np.ix_(rows, rows)] = np.outer(sd, sd) * [[1.0, -0.8], [-0.8, 1.0]]
    found = of_fit(SimpleNamespace(model=CAR, covariance=covariance))
    assert found.names == tuple(free)
    one, other = (drawn(found, name) for name in free)
    assert np.std(one) == pytest.approx(sd[0], rel=0.15)
    assert np.corrcoef(one, other)[0, 1] == pytest.approx(-0.8, abs=0.06)
    with pytest.raises(BadInput, match="keeps no covariance"):
        of_fit(SimpleNamespace(model=CAR, covariance=None))
