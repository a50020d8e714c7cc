"""The verb `fit`: from recordings to a Fit, whatever they are like."""

import importlib
from dataclasses import replace

import numpy as np
import pytest
from toys import DT, drive, joined, linear_toy, looping, obeying_toy, speed_toy, tiny, without

from greybox_id.base.errors import BadInput
from greybox_id.engine.solvers.gauss_newton import Status
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.saved_fit import load
from greybox_id.fitting.verb import fit
from greybox_id.models.effects import sensor_latency_imu, steering_rate_limit
from greybox_id.models.parameter import Parameter, Prior
from greybox_id.models.registry import build

QUICK = FitOptions(1.0, "gauss-newton")


def silent_toy():
    """A model with a parameter that nothing tells."""
    model = linear_toy(2)
    return replace(model, parameters=(*model.parameters, Parameter("silent", "1", 1.0)))


@pytest.mark.parametrize("solver", ["auto", "gauss-newton", "ipopt"])
def test_every_solver_finds_what_the_recording_tells(solver):
    found = fit(linear_toy(2), [obeying_toy(np.array([0.5, 1.0]), noise=0.02)], how=FitOptions(1.0, solver))
    np.testing.assert_allclose(found.model["F"].array, [0.5, 1.0], atol=5 * np.max(found.sd["F"]))
    assert found.stages[0].noise["yaw_rate"] == pytest.approx(0.02, rel=0.1)


def test_a_certified_fit_is_confirmed_by_ipopt():
    certificate = fit(linear_toy(2), [obeying_toy(np.ones(2), noise=0.02)], how=FitOptions(1.0)).stages[0].certificate
    assert certificate.confirmed
    assert certificate.status == "Solve Succeeded"
    assert certificate.objective_after <= certificate.objective_before


def test_a_model_with_parts_is_fitted_in_two_steps_and_better_in_closed_loop_for_the_second():
    recording = joined(150, 120)
    stages = fit(tiny("msnn_full"), [recording], how=QUICK).stages
    assert [(s.model, s.closed_loop) for s in stages] == [
        ("msnn_lat", False), ("msnn_long", False), ("msnn_full", True)
    ]  # fmt: skip
    assert stages[2].history[-1] < stages[2].history[0]


def test_a_fit_of_a_loop_says_what_it_saw_and_comes_back_from_disk(tmp_path):
    validate = drive(80, 9, name="other")
    found = fit(tiny("msnn_full"), [joined(150, 100)], validate=validate, how=QUICK, command="greybox fit")
    assert set(found.metrics["train"]) == {"honest", "published", "closed_loop"}
    assert [(r.role, r.name, r.samples, r.runs) for r in found.data] == [
        ("train", "joined", 250, 2), ("validate", "other", 80, 1)
    ]  # fmt: skip
    again = load(found.save(tmp_path / "fit.json"), build)
    assert again.as_dict() == found.as_dict()


def test_held_parameters_stay():
    model = tiny("msnn_full")
    model = model.with_parameters(replace(model["m"], fixed=True))
    model = replace(model, parts=(model.parts[0], model.parts[1].with_parameters(model["m"])))
    found = fit(model, [drive()], how=QUICK)
    assert np.array_equal(found.model["m"].array, model["m"].array)
    assert found.sd["m"] == 0.0
    assert found.notes()["m"] == "held"


def test_the_same_seed_gives_the_same_fit_and_more_starts_are_never_worse():
    one, three, again = (
        fit(tiny("msnn_lat"), [drive()], how=replace(QUICK, starts=n, seed=5)) for n in (1, 3, 3)
    )  # fmt: skip
    assert np.array_equal(three.model.values, again.model.values)
    assert len(three.stages[0].starts) == 3
    assert three.stages[0].starts[0] == min(three.stages[0].starts) <= one.stages[0].starts[0]


def test_ctrl_c_keeps_the_best_point_and_says_so():
    def say(line, passing=False):
        if "msnn_lat: step 2" in line:
            raise KeyboardInterrupt

    found = fit(tiny("msnn_full"), [drive()], how=QUICK, say=say)
    assert [s.status for s in found.stages] == [Status.INTERRUPTED.value] * 2
    assert found.stages[1].steps == 0
    assert found.stages[0].steps == 2
    assert found.stages[0].history[-1] < found.stages[0].history[0]
    assert not np.array_equal(found.model["F"].array, tiny("msnn_full")["F"].array)


@pytest.mark.parametrize(
    ("where", "what", "status"),
    [
        ("greybox_id.fitting.memory", "Trace", Status.INTERRUPTED),
        ("greybox_id.fitting.steps", "certified", Status.INTERRUPTED),
        ("greybox_id.fitting.memory", "uncertainty", Status.INTERRUPTED),
        ("greybox_id.fitting.verb", "judgement", Status.CONVERGED),
    ],
)
def test_ctrl_c_after_the_first_part_keeps_the_fit(where, what, status, monkeypatch):
    once, module = [], importlib.import_module(where)
    before = getattr(module, what)

    def interrupted(*args, **kwargs):
        if not once and ready:
            once.append(what)
            raise KeyboardInterrupt
        return before(*args, **kwargs)

    ready = []
    monkeypatch.setattr(module, what, interrupted)

    def say(line, passing=False):
        if line.startswith("msnn_long"):
            ready.append(line)

    result = fit(tiny("msnn_full"), [drive()], how=FitOptions(1.0), say=say)
    assert once == [what]
    assert result.stages[-1].model == "msnn_full"
    assert result.stages[-1].status == status.value
    assert result.verdict is not None
    assert result.verdict.usability in ("usable with care", "not usable")
    assert ("Interrupted" in " ".join(result.verdict.reasons)) == (what == "judgement")
    assert set(result.metrics) == {"train"}


def test_ctrl_c_during_cross_validation_ends_the_search_and_says_so():
    pressed = []

    def say(line, passing=False):
        if "cross-validation" in line and not pressed:
            pressed.append(line)
            raise KeyboardInterrupt

    found = fit(tiny("msnn_lat"), [drive(400)], how=FitOptions(solver="gauss-newton"), say=say)
    assert found.stages[0].strengths_from == "cross-validation, interrupted"
    assert found.stages[0].steps > 0
    assert len(found.stages[0].tried) == 1


def test_early_stopping_keeps_the_step_that_is_best_on_the_validation_recording():
    F = np.array([0.2, 1.0])
    train, validate = obeying_toy(F, 60, 1, noise=0.3), obeying_toy(F, 400, 2, noise=0.3)
    found = fit(linear_toy(2), [train], validate=validate, how=FitOptions("early stopping"))
    assert found.mode == "early stopping"
    assert found.stages[0].status == Status.EARLY.value
    assert found.stages[0].certificate is None  # Ipopt would carry on to where it was stopped from going
    with pytest.raises(BadInput, match="name one with validation"):
        fit(linear_toy(2), [train], how=FitOptions("early stopping"))


def test_a_run_scoped_parameter_is_told_per_run():
    rng = np.random.default_rng(0)
    parts = []
    for samples in (0.5, 1.5):
        steer = np.convolve(0.3 * rng.standard_normal(419), np.ones(20) / 5, "valid")
        time = np.arange(400)
        parts.append(np.interp(time - 1 - samples, time, steer) + 0.01 * rng.standard_normal(400))
        parts.append(steer)
    recording = joined(400, 400)
    recording = recording.with_signals(yaw_rate=np.append(parts[0], parts[2]), steer=np.append(parts[1], parts[3]))
    model = linear_toy(1).with_values(np.ones(1)) + sensor_latency_imu
    found = fit(model, [recording], how=QUICK)
    np.testing.assert_allclose(found.per_run["sensor_latency_imu"], [0.5 * DT, 1.5 * DT], atol=0.004)


def test_a_symmetric_model_tells_one_value_per_run():
    model = replace(linear_toy(1), symmetric=True).with_values(np.ones(1)) + sensor_latency_imu
    assert fit(model, [joined(60, 60)], how=QUICK).per_run["sensor_latency_imu"].shape == (2,)


@pytest.mark.parametrize(
    ("recordings", "says"),
    [
        ([], "no recording"),
        ([without(drive(), "steer")], "lacks steer"),
        ([without(drive(), "yaw_rate")], "yaw_rate"),
        ([drive(5)], "no unbroken run"),
        ([drive(), drive(3)], "no unbroken run"),
        ([drive().with_signals(steer=np.full(150, np.nan))], "no unbroken run"),
        ([drive().with_signals(yaw_rate=np.full(150, np.nan))], "no unbroken run"),
        ([type(drive())("fast", 0.01 * np.arange(150), drive().signals)], "Resample"),
    ],
)
@pytest.mark.filterwarnings("ignore:Degrees of freedom")
def test_recordings_that_cannot_be_fitted_are_refused_in_a_sentence(recordings, says):
    with pytest.raises(BadInput, match=says):
        fit(tiny("msnn_lat"), recordings, how=QUICK)


def test_a_channel_that_never_moves_can_be_fitted():
    still = drive().with_signals(steer=np.zeros(150), yaw_rate=np.zeros(150))
    assert np.all(np.isfinite(fit(tiny("msnn_lat"), [still], how=QUICK).model.values))


def test_a_parameter_that_nothing_tells_is_infinitely_uncertain_and_stops_nothing(tmp_path):
    found = fit(silent_toy(), [obeying_toy(np.ones(2), noise=0.1)], how=QUICK)
    assert np.isinf(found.sd["silent"])
    assert np.all(np.isfinite(found.sd["F"]))
    found.save(tmp_path / "fit.json")


def test_an_effect_that_is_free_at_its_infinite_null_can_be_fitted_and_saved(tmp_path):
    found = fit(tiny("msnn_lat") + steering_rate_limit, [drive()], how=QUICK)
    bare = fit(tiny("msnn_lat"), [drive()], how=QUICK)
    assert found.stages[0].history[-1] == pytest.approx(bare.stages[0].history[-1], rel=1e-2)
    assert np.isinf(load(found.save(tmp_path / "fit.json"), build).model["steering_rate_limit"].array)


def test_random_starts_are_finite_beside_an_effect_at_its_infinite_null():
    found = fit(tiny("msnn_lat") + steering_rate_limit.at(np.inf), [drive()], how=replace(QUICK, starts=3))
    assert np.all(np.isfinite(found.stages[0].starts))


def test_an_effect_held_at_its_infinite_null_can_be_certified():
    fit(tiny("msnn_lat") + steering_rate_limit.at(np.inf), [drive()], how=FitOptions(1.0))


def test_a_recording_that_the_start_explains_exactly_can_be_fitted():
    model = linear_toy(1).with_values(np.array([2.0]))
    steer = drive()["steer"]
    fit(model, [drive().with_signals(yaw_rate=np.append(0.0, 2.0 * steer[:-1]))], how=FitOptions(1.0))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_model_that_is_not_finite_at_its_start_is_refused_in_a_sentence():
    model = replace(speed_toy(), equations=lambda u, p, past: {"a_x": past(u.a_x, [p.gain]) / (p.pole - 0.6)})
    with pytest.raises(BadInput):
        fit(model, [drive()], how=FitOptions(1.0, "gauss-newton"))


def test_a_validation_recording_without_a_fed_back_input_is_scored_and_saved(tmp_path):
    found = fit(tiny("msnn_full"), [drive()], validate=without(drive(80, 2), "a_y"), how=QUICK)
    assert np.isfinite(found.metrics["validate"]["published"]["a_x"]["rmse"])
    found.save(tmp_path / "fit.json")


def test_cross_validation_is_on_record():
    model = linear_toy(3, Prior(0.5, strength="s"))
    stage = fit(model, [obeying_toy(np.ones(3), 500, noise=0.2)], how=FitOptions(solver="gauss-newton")).stages[0]
    assert stage.strengths_from == "cross-validation"
    assert len(stage.tried) >= 4
    assert min(error for _, error in stage.tried) == pytest.approx(1.0, rel=0.2)


def test_a_loop_is_told_by_its_own_predictions_where_there_are_no_parts():
    recording = looping(drive(400), 0.7, 0.9, noise=0.3)
    found = fit(speed_toy(), [recording], how=QUICK)
    np.testing.assert_allclose([found.model["pole"].array, found.model["gain"].array], [0.7, 0.9], atol=0.05)


def test_early_stopping_keeps_the_start_where_every_step_is_worse_on_the_validation_recording():
    train, validate = obeying_toy(np.array([5.0, -5.0]), 60, 1), obeying_toy(np.zeros(2), 400, 2)
    model = linear_toy(2)
    start = model.with_parameters(*(p.with_value(np.zeros(p.shape)) for p in model.parameters))
    found = fit(start, [train], validate=validate, how=FitOptions("early stopping"))
    assert np.all(found.model.values == 0.0)
