"""Training hybrid models: known stiffnesses come back, seeds repeat, files hold all of it."""

from dataclasses import replace

import numpy as np
import pytest
from linear_bicycle import NOISE, VEHICLE, manoeuvres, recorded, sine, steps
from windows_of import window_error

from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import join
from greybox_id.engine.hybrid.stretches import stretches
from greybox_id.fitting.adaptation.verb import adapt
from greybox_id.fitting.how import FitOptions, quiet
from greybox_id.fitting.saved_fit import load
from greybox_id.fitting.scores.estimates import apply_hybrid
from greybox_id.fitting.training import mirrored, update_hybrid
from greybox_id.fitting.verb import fit
from greybox_id.models.registry import build, prepared

SMALL = {"hidden": [6, 4], "window": 50, "warm_up": 15}
C_F, C_R = 48e3, 66e3


@pytest.fixture(autouse=True, scope="module")
def _brief():
    """Small networks need fewer steps."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("greybox_id.fitting.training.STEPS", 120)
        patch.setattr("greybox_id.fitting.training.PATIENCE", 30)
        yield


def trained(name, recordings, seed=0, settings=SMALL, **more):
    model = prepared(name, join(recordings, "training"), settings, vehicle=VEHICLE)
    model = model.with_parameters(replace(model["I_z"], fixed=True))
    return fit(model, recordings, how=FitOptions(seed=seed, **more))


@pytest.fixture(scope="module")
def stiffness():
    return trained("hybrid_stiffness", manoeuvres(C_F, C_R))


@pytest.mark.parametrize(("seed", "within"), [(None, 0.02), (0, 0.08)], ids=["generated", "noisy"])
def test_constant_stiffnesses_are_found(seed, within):
    noise = {"a_y": 0.2, "yaw_rate": 0.01, "sideslip": 0.004}
    other = recorded(steps(-0.025), 13.0, C_F, C_R)
    found = apply_hybrid(trained("hybrid_stiffness", manoeuvres(C_F, C_R, seed), noise=noise), other)
    for name, true in (("C_alpha_f", C_F), ("C_alpha_r", C_R)):
        told = found[name][np.isfinite(found[name])]
        assert len(told) > 50
        assert np.max(np.abs(told - true)) < within * true


def test_forces_are_found_without_having_been_measured():
    found = apply_hybrid(trained("hybrid_force", manoeuvres(C_F, C_R)), recorded(sine(0.03, 0.6), 13.0, C_F, C_R))
    other = recorded(sine(0.03, 0.6), 13.0, C_F, C_R)
    across = 930.0 * other["a_y"]
    turning = 700.0 * np.gradient(other["yaw_rate"], other.time)
    F_yf = (turning + 1.171 * across) / 2.346
    assert np.sqrt(np.mean((found["F_yf"] - F_yf) ** 2)) < 0.03 * np.max(np.abs(F_yf))


def test_the_fit_tells_what_stopped_it_and_how_far_off_it_is(stiffness):
    assert len(stiffness.how["stopped_by"]) == 1
    trained_on, held_out = stiffness.how["errors_over_windows"]
    assert trained_on == pytest.approx(1.0, abs=0.1)
    assert held_out == pytest.approx(1.0, abs=0.15)
    assert stiffness.metrics["train"]["free run"]["yaw_rate"]["rmse"] == pytest.approx(0.01, rel=0.1)


def test_training_is_carried_on_with_other_tyres_and_without_the_old_drives(stiffness):
    new = [recorded(steps(0.02), 14.0, 0.8 * C_F, 0.8 * C_R), recorded(sine(0.03, 0.5), 12.0, 0.8 * C_F, 0.8 * C_R)]
    sensors = {"a_y": 0.2, "yaw_rate": 0.01, "sideslip": 0.004}  # the network's own errors are no smaller
    told = update_hybrid(stiffness.model, new, FitOptions(noise=sensors), quiet)
    other = recorded(steps(-0.025), 13.0, 0.8 * C_F, 0.8 * C_R)
    before, after = (apply_hybrid(replace(stiffness, model=m), other) for m in (stiffness.model, told.model))
    usual = apply_hybrid(stiffness, recorded(steps(-0.025), 13.0, C_F, C_R))
    for name, true in (("C_alpha_f", C_F), ("C_alpha_r", C_R)):
        off, now, on_old = (
            np.sqrt(np.nanmean((own[name] / (scale * true) - 1) ** 2))
            for own, scale in ((before, 0.8), (after, 0.8), (usual, 1.0))
        )
        assert now < 0.03 < 0.19 < off
        assert now < on_old  # as good as on the tyres that it was trained on
    noise = np.array([stiffness.stages[0].noise[name] for name in stiffness.model.outputs])
    assert window_error(told.model, other, noise) < 0.5 * window_error(stiffness.model, other, noise)


def test_where_nothing_changed_training_goes_nowhere(stiffness):
    same = [recorded(steps(0.02), 14.0, C_F, C_R), recorded(sine(0.03, 0.5), 12.0, C_F, C_R)]
    told = update_hybrid(stiffness.model, same, FitOptions(), quiet)
    held_out = told.stage.history
    assert held_out[told.stage.steps] <= held_out[0]
    found = apply_hybrid(replace(stiffness, model=told.model), recorded(steps(-0.025), 13.0, C_F, C_R))
    assert np.nanmax(np.abs(found["C_alpha_f"] / C_F - 1)) < 0.03
    with pytest.raises(BadInput, match="needs 5 pieces of 85 unbroken rows; there are 2"):
        update_hybrid(stiffness.model, [same[0].rows(0, 180)], FitOptions(), quiet)


@pytest.mark.slow
def test_a_hybrid_is_adapted_to_other_tyres_and_left_alone_where_nothing_changed(stiffness):
    for scale, moves in ((0.75, True), (1.0, False)):
        runs = [(steps(0.02, 1100), 14.0), (sine(0.03, 0.5, 1100), 12.0), (steps(-0.025, 600), 13.0)]
        new = join([recorded(steer, v, scale * C_F, scale * C_R, seed=40) for steer, v in runs], "new")
        found = adapt(stiffness, new, seconds=22.0)
        assert (found.chosen.name == "zero-shot") != moves
        assert found.chosen.rest.keys() == set(stiffness.model.outputs)
        for name, own in found.chosen.rest.items():
            low, high = found.chosen.interval[name]
            assert low < own.rmse < high
            if moves:
                assert own.rmse < 0.8 * found.zero_shot.rest[name].rmse or own.rmse < 1.1 * NOISE.get(name, 0.004)
        if moves:
            assert found.fit.model["stiffness_scale_f"].value == pytest.approx(scale, abs=0.03)
            assert found.fit.model.carried_on == stiffness.model.carried_on
    with pytest.raises(BadInput, match="not a parameter of this fit of hybrid_stiffness that may change"):
        adapt(stiffness, new, free="W_1")


def test_a_fit_is_the_same_after_being_saved(stiffness, tmp_path):
    again = load(stiffness.save(tmp_path / "fit.json"), build)
    other = recorded(sine(0.03, 0.6), 13.0, C_F, C_R)
    before, after = apply_hybrid(stiffness, other), apply_hybrid(again, other)
    assert np.array_equal(before["F_yf"], after["F_yf"])
    assert np.array_equal(again.model.values, stiffness.model.values)


def test_the_same_seed_trains_the_same():
    recordings, brief = manoeuvres(C_F, C_R)[:2], {"hidden": [3], "window": 40, "warm_up": 10}
    one, two, other = (trained("hybrid_force", recordings, seed, brief) for seed in (1, 1, 2))
    assert np.array_equal(one.model.values, two.model.values)
    assert not np.array_equal(one.model.values, other.model.values)


def test_in_a_mirror_a_stretch_is_that_of_the_mirrored_recording():
    model, one = build("hybrid_force"), manoeuvres(C_F, C_R)[0]
    (own,), (other,) = stretches(model, one), stretches(model, one.mirrored())
    for name in ("inputs", "outputs", "states"):
        assert np.allclose(getattr(mirrored(model, own), name), getattr(other, name))


def test_an_ensemble_has_a_spread(stiffness):
    other = recorded(steps(0.02), 12.0, C_F, C_R)
    alike = apply_hybrid([stiffness, stiffness], other)
    assert np.all(alike["F_yf_sd"] == 0.0)
    assert alike.units["F_yf_sd"] == "N"
    assert list(alike.table()[["time", "F_yf"]].columns) == ["time", "F_yf"]


def test_progress_is_told_and_an_interruption_keeps_the_best():
    heard = []

    def say(line, passing=False):
        heard.append(line)
        if len(heard) == 8:
            raise KeyboardInterrupt

    recordings = manoeuvres(C_F, C_R)[:3]
    model = prepared("hybrid_force", join(recordings, "training"), {"hidden": [3]}, vehicle=VEHICLE)
    found = fit(model, recordings, how=FitOptions(), say=say)
    assert found.stages[0].status == "interrupted"
    assert "held-out error" in heard[0]


def test_one_short_recording_is_refused_in_a_sentence():
    short = [recorded(sine(0.02, 0.5, 100), 12.0, C_F, C_R)]
    with pytest.raises(BadInput, match="Name more recordings"):
        trained("hybrid_force", short)


def test_ipopt_is_refused_in_a_sentence():
    with pytest.raises(BadInput, match="omit solver"):
        trained("hybrid_force", manoeuvres(C_F, C_R)[:2], solver="ipopt")


def test_a_fit_of_another_kind_is_refused_in_a_sentence(stiffness):
    with pytest.raises(BadInput, match="No fit was given"):
        apply_hybrid([], recorded(steps(0.02), 12.0, C_F, C_R))
    other = trained("hybrid_force", manoeuvres(C_F, C_R)[:2], 0, {"hidden": [2], "window": 20, "warm_up": 5})
    with pytest.raises(BadInput, match="one hybrid model"):
        apply_hybrid([stiffness, other], recorded(steps(0.02), 12.0, C_F, C_R))
