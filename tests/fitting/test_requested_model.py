"""What is said of a model's parameters on the command line."""

from dataclasses import replace

import pytest
from driven import driven

from greybox_id.base.errors import BadInput
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.requested_model import Choices, RequestedModel, doubts, magnitudes, with_choices
from greybox_id.models.parameter import Stated
from greybox_id.models.registry import build
from greybox_id.models.vehicle import ChosenModel, vehicle


@pytest.fixture(scope="module")
def car():
    return build("single_track", vehicle=vehicle("full_size_car"))


def test_a_fixed_parameter_is_held_where_it_stands_or_where_it_is_put(car):
    model = with_choices(car, Choices(fix={"I_z": None, "m": "1.5 t"}))
    assert model["I_z"].fixed
    assert model["I_z"].array == car["I_z"].array
    assert model["m"].fixed
    assert model["m"].array == 1500.0


def test_a_freed_parameter_is_estimated(car):
    assert car["l_f"].fixed
    assert not with_choices(car, Choices(free=["l_f"]))["l_f"].fixed


def test_a_prior_frees_its_parameter_and_moves_it_to_its_mean(car):
    model = with_choices(car, Choices(prior={"l_f": "1.2±0.05m"}))
    own = model["l_f"]
    assert (own.fixed, float(own.array), own.prior.mean, own.prior.sd) == (False, 1.2, 1.2, 0.05)


def test_a_start_leaves_the_belief_where_it_was(car):
    model = with_choices(car, Choices(start={"I_z": "2000"}))
    assert model["I_z"].array == 2000.0
    assert model["I_z"].prior == car["I_z"].prior


def test_a_parameter_per_run_has_that_scope(car):
    assert with_choices(car, Choices(per_run=["c_0"]))["c_0"].scope == "run"


def test_choices_reach_the_parts_of_a_model_with_memory():
    model = with_choices(build("msnn_full"), Choices(fix={"m": None}))
    assert model["m"].fixed
    assert all(part["m"].fixed for part in model.parts if "m" in part)


@pytest.mark.parametrize(
    ("choices", "says"),
    [
        (Choices(fix={"masss": "3"}), "no parameter masss"),
        (Choices(fix={"I_zz": "3"}), "Did you mean I_z?"),
        (Choices(fix={"m": "3.5m"}), "fix m: unit"),
        (Choices(fix={"m": "0.1kg"}), "0.1 kg is outside the range that models accept, 0.5 to 60000 kg"),
        (Choices(free=["steering_delay"]), "effects steering_delay"),
        (Choices(prior={"B_f": "6"}), "MEAN±SD"),
        (Choices(prior={"B_f": (6.0, -1.0)}), "must be a number above zero"),
        (Choices(prior={"B_f": [6.0]}), "mean, sd"),
        (Choices(fix={"m": True}), "a number or a text"),
        (Choices(start={"l_f": "1.4"}), "free l_f"),
        (Choices(fix={"B_f": None}, free=["B_f"]), "fix B_f and free B_f exclude each other"),
        (Choices(fix={"B_f": None}, prior={"B_f": "6±1"}), "exclude each other"),
        (Choices(per_run=["l_f"]), "free l_f"),
    ],
)  # fmt: skip
def test_what_cannot_be_said_of_a_parameter_is_a_sentence(car, choices, says):
    with pytest.raises(BadInput, match=says.replace("?", r"\?")):
        with_choices(car, choices)


def test_an_array_cannot_be_replaced_by_a_number():
    with pytest.raises(BadInput, match="array of"):
        with_choices(build("msnn_lat"), Choices(fix={"F": "1"}))


def test_effects_are_free_held_or_believed():
    found = magnitudes(["steering_lag", "steering_delay=30ms", "yaw_rate_bias=0±1 deg/s"])
    assert found["steering_lag"] is None
    assert found["steering_delay"] == pytest.approx(0.03)
    told = found["yaw_rate_bias"]
    assert isinstance(told, Stated)
    assert (told.value, told.sd) == pytest.approx((0.0, 0.0174533))


@pytest.mark.parametrize(
    ("written", "says"),
    [
        (["stering_lag"], "Did you mean steering_lag?"),
        (["steering_lag=3kg"], "effects steering_lag: unit"),
        (["steering_lag", "steering_lag=1"], "there twice"),
    ],
)
def test_what_is_no_effect_is_a_sentence(written, says):
    with pytest.raises(BadInput, match=says.replace("?", r"\?")):
        magnitudes(written)


def test_a_free_effect_takes_what_the_vehicle_states_of_it_and_starts_where_it_is_plainly_there():
    wanted = RequestedModel("lateral", vehicle("full_size_car"), effects=magnitudes(["steering_lag"]))
    own = wanted.model()["steering_lag"]
    assert not own.fixed
    assert own.prior is not None
    assert (own.prior.mean, own.prior.sd) == (0.0, 0.003)
    assert own.array > 0


def test_effects_of_models_with_memory_need_a_magnitude():
    with pytest.raises(BadInput, match="effects steering_rate_limit=VALUE"):
        RequestedModel("msnn_lat", effects=magnitudes(["steering_rate_limit"])).model()
    held = RequestedModel("msnn_lat", effects=magnitudes(["steering_rate_limit=2"])).model()
    assert held["steering_rate_limit"].array == 2.0


def test_an_effect_that_does_not_apply_is_a_sentence():
    with pytest.raises(Exception, match="motor_lag acts on drive"):
        RequestedModel("lateral", effects=magnitudes(["motor_lag"])).model()


def test_noise_is_read_in_the_signals_unit(car):
    assert FitOptions(noise={"yaw_rate": "1 deg/s"}).noise == pytest.approx({"yaw_rate": 0.0174533})
    with pytest.raises(BadInput, match="Did you mean yaw_rate"):
        FitOptions(noise={"yawrate": 1.0}).must_suit(car)
    with pytest.raises(BadInput, match="above zero"):
        FitOptions(noise={"yaw_rate": 0.0})


def test_numbers_and_texts_say_the_same(car):
    texts = Choices(fix={"m": "1500 kg"}, prior={"l_f": "1.2±0.05"}, start={"I_z": "2000"})
    numbers = Choices(fix={"m": 1500}, prior={"l_f": (1.2, 0.05)}, start={"I_z": 2000.0})
    assert with_choices(car, texts).parameters == with_choices(car, numbers).parameters


def test_a_model_is_the_vehicles_own_where_none_is_named():
    with pytest.raises(BadInput, match="names no model; add model"):
        RequestedModel(None, vehicle("full_size_car")).model()


def test_an_effect_stated_at_its_null_is_simulated_there_and_fitted_from_where_it_shows():
    own = vehicle("full_size_car")
    chosen = ChosenModel("single_track", effects={"steering_offset": Stated(0.0, 0.001)})
    asked = RequestedModel(None, replace(own, model=chosen))
    assert asked.model()["steering_offset"].array == 0.0
    assert asked.models(driven("single_track"))[0]["steering_offset"].array > 0.0


def test_a_vehicle_ten_times_too_large_is_doubted():
    small = driven("lateral")
    small = small.with_signals(yaw_rate=8 * small["yaw_rate"])
    (first, second) = doubts(build("lateral"), None, [small])
    assert "No vehicle is named" in first
    assert "wheelbase of 0.4 m" in second
    assert doubts(build("lateral"), vehicle("full_size_car"), [driven("lateral")]) == []


def test_an_actuator_asks_for_no_vehicle():
    assert doubts(build("steering"), None, [driven("lateral")]) == []
