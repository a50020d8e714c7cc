"""Free runs with tolerances refitted: what that costs, and that a vehicle's form passes for no gap."""

import numpy as np
import pytest
from driven import driven
from gap_cases import CAR, alone, axis, candidate, linear_bench, search_on, smooth_columns
from scipy.optimize import minimize

from greybox_id.gap.estimation import preparing
from greybox_id.gap.estimation.free_runs import misfit, of_subsets, refitted_tolerances
from greybox_id.gap.estimation.refit import refit
from greybox_id.models.effects import EFFECTS
from greybox_id.models.parameter import Stated
from greybox_id.models.registry import build, model_of
from greybox_id.models.vehicle import Vehicle, vehicle
from greybox_lab.virtual.virtual_vehicle import Forms, drive, random_vehicle
from greybox_lab.virtual.virtual_vehicle.car import tolerances, vehicle_file_text

NOISE = {"v_y": 0.02, "yaw_rate": 0.005, "a_y": 0.1}
SD = np.array([0.1, 1.0])


def test_a_nuisance_that_was_fitted_costs_what_is_believed_of_it():
    X = np.random.default_rng(0).standard_normal((500, 2, 1))
    search = search_on(linear_bench(X, [0.4], SD), SD, [axis(0, sd=0.14)])
    (found,) = refit(search, [search.start_of(search.at_means())])
    own = misfit(search, found)
    assert own.charge == pytest.approx((found.theta[0] / 0.14) ** 2)
    assert own.charge > 5
    np.testing.assert_array_equal(own.e, found.e)


def test_without_an_effect_tolerances_do_what_they_can_within_their_bounds():
    X = smooth_columns(3)
    X[:, :, 2] = 3.0 * X[:, :, 0] + X[:, :, 1]  # the effect does what both tolerances do; the first reaches not far
    search = search_on(linear_bench(X, [0.0, 0.0, 1.0], SD), SD, [axis(k, sd=0.5, low=-1.0, high=1.0) for k in (0, 1)])
    (whole,) = refit(search, [alone(search, candidate(2), 1.0)])
    found = of_subsets(search, whole, {"effect_2": {2: 0.0}}, {})[frozenset()]
    inner = X[:, :, :2].reshape(-1, 2) / np.tile(SD, len(X))[:, None]
    wanted = -X[:, :, 2].ravel() / np.tile(SD, len(X))
    best = minimize(
        lambda u: np.sum((inner @ u + wanted) ** 2) + np.sum((u / 0.5) ** 2), np.zeros(2), bounds=[(-1, 1)] * 2
    )
    assert best.x[0] == 1.0
    assert np.sum((found.e / SD) ** 2) + found.charge == pytest.approx(best.fun, rel=0.05)


@pytest.mark.usefixtures("_uncompiled")
def test_what_noise_does_not_explain_does_not_press_tolerances_to_where_they_reach():
    exact = {name: own.value for name, own in CAR.values.items()}
    known = {p.name: exact[p.name] for p in build("lateral", None, {}, CAR).parameters if p.name in exact}
    own = [driven("lateral", 1, 12.0, 0, {"steering_lag": 0.15, "tyre_relaxation": 0.8}, values=known)]
    tolerant = Vehicle(
        "car", CAR.values, {name: Stated(sd=0.01) for name in ("steering_ratio", "yaw_rate_scale")}, NOISE
    )
    model = build("lateral", None, {}, tolerant)
    found, _, _ = refitted_tolerances(model, own, tolerant, EFFECTS)
    trusting, _, _ = refitted_tolerances(model, own, tolerant, EFFECTS, trust=1.0)
    assert found.trust < 0.2
    assert found.charge < 0.2 * trusting.charge
    assert np.sum(trusting.e**2) <= np.sum(found.e**2)
    true = build("lateral", None, {"steering_lag": 0.15, "tyre_relaxation": 0.8}, tolerant)
    assert refitted_tolerances(true, own, tolerant, EFFECTS)[0].trust > 0.8


@pytest.mark.slow
@pytest.mark.parametrize(
    ("form", "channel"), [({"geometry": "each_wheel"}, "yaw_rate"), ({"drag": "other_powers"}, "v_x")]
)
def test_forms_of_a_vehicle_are_within_what_its_model_leaves_out(form, channel, tmp_path, monkeypatch):
    car = random_vehicle(100, "racer")
    path = tmp_path / "car.toml"
    path.write_text(vehicle_file_text(car, tolerances(car)))
    stated = vehicle(path)
    recording, _ = drive(car, "mixed", 40.0, seed=100, forms=Forms(**form))

    def left():
        found, search, _ = refitted_tolerances(model_of(stated), [recording], stated, EFFECTS)
        return np.sum((found.e[:, search.bench.channels.index(channel)] / stated.noise[channel]) ** 2), found.charge

    misfit, charge = left()
    monkeypatch.setattr(preparing, "with_roughness", lambda model, *_: model)
    bare_misfit, bare_charge = left()
    assert misfit < 1.08 * len(recording)
    assert misfit + charge < bare_misfit + bare_charge - 10.0
