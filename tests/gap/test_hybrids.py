"""Diagnoses of hybrids without a memory: what a network was not trained on is found, what it was is no gap."""

import numpy as np
import pytest
from calling import greybox, refused
from driven import driven, written

import greybox_id as gb
from greybox_id.api.diagnosing import must_have_gaps, of_fit
from greybox_id.base.errors import BadInput
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.saved_fit import load
from greybox_id.fitting.verb import fit
from greybox_id.gap.diagnosis import diagnose
from greybox_id.models.effects import EFFECTS
from greybox_id.models.registry import build, prepared


def trained_on(laps, name):
    model = prepared(name, laps, {"hidden": [8]})
    return fit(model, [laps], validate=driven("lateral", seed=30), how=FitOptions(seed=1))


@pytest.fixture(scope="module")
def network():
    return trained_on(driven("lateral", runs=5, seconds=6.0), "mlp_lateral")


def other(effects=None, seed=240):
    return driven("lateral", runs=2, seconds=8.0, seed=seed, effects=effects)


@pytest.mark.parametrize(
    ("effect", "value"), [("steering_delay", 0.06), ("steering_offset", 0.01), ("yaw_rate_bias", 0.02)]
)
def test_an_effect_that_was_not_in_its_training_is_found(network, effect, value):
    model, stated = of_fit(network, "net")
    found = diagnose(model, [other({effect: value})], EFFECTS, vehicle=stated, held_out=[other({effect: value}, 260)])
    assert found.applied == (effect,)
    assert found.ranking[0].effect == effect
    assert found.ranking[0].magnitude == pytest.approx(value, rel=0.1)
    assert found.ranking[0].interval[0] < value < found.ranking[0].interval[1]
    assert found.unknown_probability < 0.5
    assert found.held_out.closed > 0.8
    assert found.closed.effects == (effect,)
    assert found.unnamed is None  # its network took up what unknown forces stand for


@pytest.mark.parametrize("seed", [200, 210, 220])
def test_nothing_is_named_where_the_vehicle_is_as_in_training(network, seed):
    model, stated = of_fit(network, "net")
    found = diagnose(model, [other(seed=seed)], EFFECTS, vehicle=stated)
    assert not found.gap_detected
    assert found.applied == ()


def test_its_noise_is_what_training_left_and_no_vehicle_states_another(network):
    model, stated = of_fit(network, "net")
    assert model.learnt
    for output in model.outputs:
        assert stated.noise[output] == network.metrics["train"]["free run"][output]["rmse"]
    with pytest.raises(BadInput, match="mlp_lateral is a hybrid model, whose noise is known from its training"):
        of_fit(network, "net", stated)


@pytest.mark.slow
def test_a_number_of_its_physics_is_moved_and_not_added_again():
    """The lever arm of v_y is in the equations of the bicycle, and an effect."""
    model, stated = of_fit(trained_on(driven("lateral", runs=5, seconds=6.0), "bicycle_mlp"), "net")
    found = diagnose(model, [other({"velocity_lever_arm": 0.4})], EFFECTS, vehicle=stated)
    assert found.ranking[0].effect == "velocity_lever_arm"
    assert found.ranking[0].magnitude == pytest.approx(0.4, rel=0.15)
    assert float(found.closed["velocity_lever_arm"].array) == pytest.approx(found.ranking[0].magnitude, rel=0.01)
    assert found.closed.effects == ()


def test_recurrent_networks_and_weights_that_nobody_trained_are_refused():
    with pytest.raises(BadInput, match="hybrid_force has a recurrent network"):
        must_have_gaps(build("hybrid_force"))
    with pytest.raises(BadInput, match=r"mlp_lateral is a hybrid model, and no vehicle file holds its weights. Fit it"):
        gb.diagnose("mlp_lateral", other(), vehicle="full_size_car")


@pytest.mark.slow
def test_the_command_diagnoses_its_fit_and_has_no_vehicle_file_for_it(network, tmp_path):
    network.save(tmp_path / "net.json")
    lap = written(other({"steering_delay": 0.06}), tmp_path / "lap.csv")
    files = [lap, "--fit", tmp_path / "net.json"]
    no_place = "a vehicle file has no place for the weights of mlp_lateral"
    assert no_place in refused("gap", *files, "--apply", tmp_path / "car.toml")
    called = greybox("gap", *files, "--out", tmp_path / "gap", "--report", tmp_path / "gap.html")
    assert called.code == 0
    assert "steering_delay" in called.out
    assert no_place in " ".join(called.err.split())
    assert not list((tmp_path / "gap").glob("*.toml"))
    assert (tmp_path / "gap.html").is_file()
    again = gb.diagnose(load(tmp_path / "net.json", build), other({"steering_delay": 0.06}))
    assert again.applied == ("steering_delay",)
    assert np.isfinite(again.gap.closed)
