"""Fits that used to end badly, from standstill at a low rate, and what is tried where one does."""

from dataclasses import replace

import numpy as np
import pytest
from driven import driven
from verdicts import racing

from greybox_id.datasets.read import read
from greybox_id.datasets.shipped import shipped
from greybox_id.engine.solvers.gauss_newton import Status
from greybox_id.fitting import attempt as attempts
from greybox_id.fitting import motion as motion_fits
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.verb import fit
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle
from greybox_lab.virtual.virtual_vehicle import steered, vehicle_file_text


@pytest.mark.slow
def test_a_race_from_standstill_at_25_hz_has_its_optimum():
    case = racing(1)
    assert np.mean(np.abs(case.train["v_x"]) < 0.3) > 0.03, "it stands for a while"
    found = fit(build("lateral", None, {}, case.vehicle), [case.train], validate=case.held_out)
    assert found.confirmed
    assert found.verdict.usability != "not usable"
    assert float(found.model["I_z"].array) == pytest.approx(1000.0, rel=0.1)
    told = found.verdict.comparison["validate"]["1 s ahead"]["yaw_rate"]
    assert told["fit_percent"] > 80


def quick():
    found = build("lateral", {"tyre": "linear"}, {}, vehicle("full_size_car"))
    return found.with_parameters(replace(found["m"], fixed=True, prior=None))


def test_where_no_step_is_taken_other_ways_are_tried_and_said(monkeypatch):
    monkeypatch.setenv("GREYBOX_COMPILE", "0")
    true, calls = attempts.gauss_newton, []

    def stuck(problem, x, **options):
        calls.append(x)
        solution = true(problem, x, **options)
        if len(calls) > 8:  # the first attempt has ended by then
            return solution
        return replace(true(problem, x, **{**options, "max_steps": 0}), status=Status.STALLED, x=x)

    monkeypatch.setattr(attempts, "gauss_newton", stuck)
    how = FitOptions(horizon=1.0, start_from="measured", solver="gauss-newton")
    said = []
    found = fit(quick(), [driven("lateral", runs=1)], how=how, say=lambda line, passing=False: said.append(line))
    assert any("no step was taken; trying other starting point 1" in line for line in said)
    assert found.stages[0].fallbacks[0].startswith("other starting point 1: ")
    assert found.stages[0].fallbacks[-1].endswith("% lower than the best before")
    assert found.stages[0].converged


def test_a_fit_that_ends_well_tries_nothing_else(monkeypatch):
    monkeypatch.setenv("GREYBOX_COMPILE", "0")
    found = fit(quick(), [driven("lateral", runs=1)], how=FitOptions(horizon=1.0, start_from="measured"))
    assert found.stages[0].fallbacks == ()
    assert found.how["unfitted"]["I_z"] == float(quick()["I_z"].array)


@pytest.mark.slow
def test_a_race_that_begins_at_rest_is_confirmed_without_fallbacks():
    lap, other = (read(shipped(name), "roboracer") for name in ("racer_train", "racer_valid"))
    found = fit(build("lateral", None, {}, vehicle("roboracer")), [lap], validate=other)
    assert found.confirmed
    assert found.stages[0].fallbacks == ()


@pytest.fixture(scope="module")
def poorly_excited():
    """A recording whose noisy readings, predicted a few rows ahead, look like an inertia of next to none."""
    from fleet import RATE, class_of, made_vehicle, manoeuvre

    rng, base = np.random.default_rng(13), class_of(13)
    for v in range(3):  # the second recording of the third vehicle of the benchmark of fleets
        car, truth = made_vehicle(base, rng)
        for r in range(8):
            (steer, speed), seed = manoeuvre(rng, 30.0, r % 2 == 1), int(rng.integers(1 << 31))
            if (v, r) == (2, 1):
                return base, truth, steered(car, "poor", steer, speed, RATE, seed=seed)[0]
    raise AssertionError


def of_class(base, folder):
    (folder / "class.toml").write_text(vehicle_file_text(base))
    found = build("lateral", None, {}, vehicle(str(folder / "class.toml")))
    held = [replace(found[name], fixed=True, prior=None) for name in ("m", "C_f", "C_r", "D_f", "D_r")]
    return found.with_parameters(*held)


def test_an_inertia_of_next_to_none_is_left_for_the_optimum(poorly_excited, tmp_path):
    base, truth, recording = poorly_excited
    found = fit(of_class(base, tmp_path), [recording])
    assert found.confirmed
    low, high = found.interval("I_z")
    assert low < truth["I_z"] < high
    assert (
        found.stages[0]
        .fallbacks[0]
        .startswith("the original starting point, without first fitting short predictions: objective ")
    )


@pytest.mark.slow
def test_where_nothing_better_is_found_it_is_no_optimum(poorly_excited, tmp_path, monkeypatch):
    base, truth, recording = poorly_excited
    monkeypatch.setattr(motion_fits, "_fallbacks", lambda *_: iter(()))
    found = fit(of_class(base, tmp_path), [recording])
    assert float(found.model["I_z"].array) < 0.01 * truth["I_z"]
    assert not found.confirmed
    assert not np.isfinite(found.interval("I_z")[0])
    assert any("too fast for the sample time" in words for words in found.verdict.reasons)
