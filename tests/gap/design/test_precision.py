"""Manoeuvres for precise parameters: what they promise, what they keep to, what another car makes of them."""

import numpy as np
import pytest
from planned import drive_plan

import greybox_id as gb
from greybox_id.base.errors import BadInput
from greybox_id.gap.design.cma import CMA
from greybox_id.gap.design.course import AT, PlanCourse, strain, worst_strain
from greybox_id.gap.design.driver import driver_of, vehicle_of
from greybox_id.gap.design.limits import DriveLimits
from greybox_id.gap.design.precision import (
    Information,
    _exact,
    _hardly,
    criterion,
    draws,
    known_by,
    predicted_sd,
)
from greybox_id.gap.design.primitives import SHAPES, Phase, chained
from greybox_id.gap.design.search import BEYOND
from greybox_id.models.registry import build

FIVE = ("I_z", "B_f", "D_f", "B_r", "D_r")
LIMITS = DriveLimits(0.4, 0.7, 3.0, 5.0, 3.0, 20.0)


@pytest.fixture(scope="module")
def course(fit):
    return PlanCourse(fit.model, driver_of(fit.model, LIMITS), 50.0, LIMITS.speed_min)


def plan_of(course, fit, *phases, duration=8.0):
    return course.references([chained(phases, vehicle_of(fit.model), LIMITS, duration, 50.0)])[0]


@pytest.mark.parametrize("shape", SHAPES)
def test_every_primitive_keeps_actuators_within_their_limits(fit, shape):
    vehicle = vehicle_of(fit.model)
    own = chained(
        [Phase(shape, 1.1, 0.8, 12.0, 1.0, 0.3), Phase(shape, -0.9, 0.4, 18.0, 1.0)], vehicle, LIMITS, 9.0, 50.0
    )
    assert len(own.time) == 450
    assert np.abs(own.steer).max() <= LIMITS.steer_max
    assert np.abs(np.diff(own.steer)).max() * 50.0 <= LIMITS.steer_rate * 1.001
    change = np.diff(own.speed) * 50.0
    assert change.max() <= LIMITS.drive_max
    assert change.min() >= -LIMITS.brake_max
    assert own.speed.min() >= LIMITS.speed_min
    assert own.speed.max() <= LIMITS.speed_max
    assert abs(own.steer[-1]) < 0.02
    assert own.speed[-1] < own.speed.max()


def test_a_driver_brings_other_cars_back_to_the_path(fit, course):
    plan = plan_of(course, fit, Phase("sine", 0.5, 0.4, 12.0, 1.0), Phase("turn", 0.5, 0.0, 12.0, 1.0))
    same = course.driven(plan, fit.model.values, follow=True)[0]
    assert np.abs(same[:, AT["x"]] - plan.of("x")).max() < 0.1
    P = np.tile(fit.model.values, (2, 1))
    names = [p.name for p in fit.model.parameters]
    P[:, names.index("force_per_unit")] *= 1.1
    P[:, names.index("B_f")] *= 0.9
    off = [
        np.hypot(y[:, AT["x"]] - plan.of("x"), y[:, AT["y"]] - plan.of("y")).max()
        for y in (course.driven(plan, P, follow=True)[0], course.driven(plan, P, follow=False)[0])
    ]
    assert off[0] < 0.5 * off[1]


def test_strain_is_infinite_where_a_motion_is_not_finite(fit, course):
    plan = plan_of(course, fit, Phase("turn", 0.4, 0.0, 10.0, 1.0))
    assert worst_strain(plan.motion, LIMITS)[0] < 1.0
    broken = plan.motion.copy()
    broken[30, AT["v_y"]] = np.nan
    assert worst_strain(broken, LIMITS)[0] == np.inf


def test_information_of_a_plan_agrees_with_a_fit_of_what_it_gives(fit, course):
    """The curvature is that of a fit of the simulated recording with independent noise."""
    known = known_by(fit)
    plan = plan_of(course, fit, Phase("sweep", 0.7, 0.5, 14.0, 2.0), Phase("turn", 0.7, 0.0, 14.0, 1.0), duration=15.0)
    information = Information(fit, known)
    (F,), _ = information.scores([plan], fit.model.values)
    rng = np.random.default_rng(2)
    recording = information.recording(plan)
    y = gb.simulate(fit, recording)
    noise = {name: fit.how["counted"][name] for name in information.read}
    read = {n: y[n] + s * rng.standard_normal(len(plan.time)) for n, s in noise.items()}
    signals = {**recording.signals, **read}
    again = gb.fit(fit.model, gb.Recording("simulated", plan.time, signals))
    sd = np.sqrt(np.diag(np.linalg.inv(F)))
    ratios = [sd[known.names.index(n)] / float(again.sd[n]) for n in FIVE]
    assert 0.6 < np.median(ratios) < 1.6


def test_model_error_takes_information_away_and_a_few_rows_stand_for_all(fit, course):
    known = known_by(fit)
    information = Information(fit, known)
    plan = plan_of(course, fit, Phase("sine", 0.9, 0.5, 14.0, 1.0), Phase("turn", 0.9, 0.0, 14.0, 1.0))
    of_noise, _ = information.scores([plan], fit.model.values)
    every = (information.of([plan], fit.model.values, rough=rough)[0] for rough in (False, True))
    at = [known.names.index(name) for name in FIVE]
    alone, beside, few = (np.sqrt(np.diag(np.linalg.inv(F)))[at] for F in (of_noise[0], *every))
    assert np.all(beside > alone)
    assert few == pytest.approx(beside, rel=0.1)


@pytest.mark.parametrize("rough", [False, True])
def test_several_plans_at_once_tell_what_each_of_them_does(fit, course, rough):
    information = Information(fit, known_by(fit))
    plans = [
        plan_of(course, fit, Phase("sine", 0.9, 0.5, 14.0, 1.0)),
        plan_of(course, fit, Phase("turn", 0.7, 0.0, 12.0, 1.0), duration=7.0),
    ]
    H, S = information.scores(plans, fit.model.values, rough=rough)
    for k, plan in enumerate(plans):
        alone, scatter = information.scores([plan], fit.model.values, rough=rough)
        scale = np.sqrt(np.outer(np.diag(alone[0]), np.diag(alone[0])))
        assert H[k] / scale == pytest.approx(alone[0] / scale, abs=1e-3)
        assert S[k] / scale == pytest.approx(scatter[0] / scale, rel=1e-2, abs=1e-3)


def test_what_a_manoeuvre_adds_little_to_is_said_with_how_little(fit):
    (sentence,) = _hardly(fit.model, {"I_z": (13.8, 13.5), "B_f": (1.0, 0.5), "D_f": (np.inf, np.inf)})
    assert "little information on I_z: its standard deviation falls by 2.2 %" in sentence
    assert "no information on D_f" in sentence
    assert "B_f" not in sentence
    assert _hardly(fit.model, {"B_f": (1.0, 0.5)}) == ()


def test_a_curves_error_is_no_friction_and_a_force_along_is(fit, course):
    plan = plan_of(course, fit, Phase("turn", 0.7, 0.0, 14.0, 1.0))
    full = DriveLimits(0.4, 0.7, 3.0, 5.0, 3.0, 20.0, grip=1.0)
    beyond = plan.motion.copy()
    beyond[50, AT["F_yf"]] = 1.03 * beyond[50, AT["peak_f"]]
    beyond[50, AT["F_xf"]] = 0.0
    assert strain(beyond, full)["grip"][0] == pytest.approx(1.0)
    beyond[50, AT["F_xf"]] = 0.5 * beyond[50, AT["peak_f"]]
    assert strain(beyond, full)["grip"][0] == pytest.approx(np.hypot(1.0, 0.5))


def test_of_every_limit_that_a_motion_strains_it_is_said_what_exceeds_it(fit, course):
    plan = plan_of(course, fit, Phase("turn", 0.7, 0.0, 14.0, 1.0))
    assert set(strain(plan.motion, LIMITS)) == set(BEYOND)


def test_a_fit_that_takes_curves_for_exact_is_told_so(fit, design):
    assert any("form=uncertain" in line for line in design.said)
    assert _exact(build("single_track", {"form": "uncertain"})) == ()
    assert _exact(build("single_track", {"tyre": "linear"})) == ()


def test_more_information_is_worth_more_by_every_criterion(fit, course):
    known = known_by(fit)
    (F,) = Information(fit, known).of([plan_of(course, fit, Phase("turn", 0.7, 0.0, 14.0, 1.0))], fit.model.values)
    for kind in "daec":
        before, once, twice = (criterion(known.precision + k * F, known, FIVE, kind) for k in (0, 1, 2))
        assert before < once < twice
    told = predicted_sd(known, known.precision + F)
    assert all(after <= before * (1 + 1e-6) for before, after in told.values())


def test_draws_have_the_fits_covariance_and_stay_within_bounds(fit):
    known = known_by(fit)
    P = draws(fit, known, 400, 1)
    assert np.array_equal(P[0], fit.model.values)
    names = [p.name for p in fit.model.parameters]
    own = P[1:, names.index("force_per_unit")]
    assert np.std(own) == pytest.approx(float(fit.sd["force_per_unit"]), rel=0.15)
    for name, place in zip(known.names, known.places, strict=True):
        low, high = fit.model[name].bounds
        assert np.all((P[:, place] >= low) & (P[:, place] <= high))


def test_cma_finds_the_bottom_of_a_bent_valley():
    def cost(X):
        return [(1 - x[0]) ** 2 + 20 * (x[1] - x[0] ** 2) ** 2 for x in X]

    found = CMA(np.array([-1.0, 1.0]), 0.4, np.random.default_rng(3))
    for _ in range(120):
        found.tell(cost(found.ask()))
    assert found.mean == pytest.approx([1.0, 1.0], abs=0.05)


def test_a_design_promises_more_than_there_is_and_keeps_to_its_limits(design):
    assert set(design.predicted_sd) == set(FIVE)
    assert all(after < before for before, after in design.predicted_sd.values())
    assert design.criterion["after"] > design.criterion["before"]
    assert design.kept >= 0.95
    table = design.table()
    assert design.arena.outside(table["x"].to_numpy(), table["y"].to_numpy()) < -design.limits.margin + 0.05
    assert (table["v_x"] <= 1.03 * design.limits.speed_max).all()
    assert (table["x_low"] <= table["x"] + 1e-6).all()
    assert (table["x"] <= table["x_high"] + 1e-6).all()
    assert "straight ahead:" in design.sentence
    assert design.sentence.endswith("m/s.")


def test_the_steering_stops_where_the_vehicle_says(fit, limits):
    narrow = gb.Vehicle("narrow", steer_max=0.06)
    more = {"arena": "disc:60", "parameters": FIVE, "duration": 4.0, "rate": 25.0, "effort": 0.03}
    design = gb.design(fit, vehicle=narrow, speed_max=20.0, **more)
    assert design.limits.steer_max == 0.06
    assert design.table()["steer"].abs().max() <= 0.06
    with pytest.raises(BadInput, match=r"^vehicle: steer_max"):
        gb.design(fit, vehicle=gb.Vehicle("endless", steer_max=9.0), **more)


def test_the_same_seed_designs_the_same_manoeuvre(design, fit, limits):
    again = gb.design(fit, arena="disc:60", parameters=FIVE, duration=8.0, rate=25.0, limits=limits, effort=0.1)
    assert again.text() == design.text()


def test_a_car_that_shares_no_code_drives_it_within_the_arena(design, car):
    path, sideslip = drive_plan(design, car)
    assert design.arena.outside(path[:, 0], path[:, 1]) < 0
    assert sideslip < 0.3
    planned = design.table()[["x", "y"]].to_numpy()
    assert np.hypot(*(path - planned).T).max() < 3.0


def test_what_cannot_be_designed_for_is_a_sentence(fit):
    for words, more in (
        ("is too small", {"arena": "disc:1"}),
        ("is too small", {"arena": "straight:10x3"}),
        ("contradict", {"arena": "disc:60", "limits": {"speed_min": 9.0}, "speed_max": 5.0}),
        ("there is no limit", {"arena": "disc:60", "limits": {"gripp": 0.5}}),
        ("must be a number between", {"arena": "disc:60", "limits": {"grip": 3.0}}),
        ("no parameter", {"arena": "disc:60", "parameters": ["I_zz"]}),
        ("fixed in this fit", {"arena": "disc:60", "parameters": ["m"]}),
        ("goal discriminate needs a gap", {"arena": "disc:60", "goal": "discriminate"}),
        ("^duration", {"arena": "disc:60", "duration": -1.0}),
        ("^duration", {"arena": "disc:60", "duration": float("nan")}),
        ("^criterion", {"arena": "disc:60", "criterion": "x"}),
    ):
        with pytest.raises(BadInput, match=words):
            gb.design(fit, **more, effort=0.02)


def test_a_model_without_speed_is_a_sentence():
    lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 200)
    with pytest.raises(BadInput, match="Fit single_track"):
        gb.design(gb.fit("kinematic", lap, vehicle="roboracer"), arena="disc:10")
