"""Models of a stated vehicle."""

import control
import numpy as np
import pytest
from linearised import matrices

from greybox_id.base.errors import BadInput, BadModel
from greybox_id.fitting.requested_model import Choices, RequestedModel
from greybox_id.models.effects import EFFECTS
from greybox_id.models.parameter import Stated
from greybox_id.models.registry import build, model_of, vehicle_parameters
from greybox_id.models.tyres import TYRES
from greybox_id.models.vehicle import ChosenModel, Vehicle, shipped_vehicles, vehicle
from greybox_id.models.vehicles import derived, stated_effect, with_tolerances, with_vehicle

GEOMETRY = {"m": Stated(1500.0), "l_f": Stated(1.2), "l_r": Stated(1.5)}
PACEJKA = {"B_f": Stated(10.0, 1.0), "C_f": Stated(1.4), "D_f": Stated(0.9, 0.18)}
PACEJKA |= {"B_r": Stated(12.0), "C_r": Stated(1.3), "D_r": Stated(1.0)}
MODELS = [(name, {"tyre": tyre}) for name in ("single_track", "lateral") for tyre in TYRES]
MODELS += [("longitudinal", {}), ("kinematic", {})]


def car(**values):
    return Vehicle("car", {**GEOMETRY, **values})


def test_a_number_alone_is_held_where_it_is_geometry_or_mass_and_a_start_elsewhere():
    model = with_vehicle(build("single_track"), car(I_z=Stated(2400.0), B_f=Stated(11.0), E_f=Stated(-0.5)))
    for name, value, fixed in (("m", 1500, True), ("l_f", 1.2, True), ("I_z", 2400, False), ("B_f", 11, False)):
        assert float(model[name].array) == value
        assert model[name].fixed is fixed
        assert model[name].prior is None
    assert model["E_f"].fixed, "what a model holds by itself stays held"
    assert model["C_f"] == build("single_track")["C_f"], "what is not stated and has no size stays as it is"


def test_what_is_not_stated_is_scaled_with_mass_and_size():
    small = Vehicle(
        "1:10", {"m": Stated(1.58), "l_f": Stated(0.082), "l_r": Stated(0.093), "wheel_radius": Stated(0.036)}
    )
    model = with_vehicle(build("longitudinal"), small)
    wheels = 4 * float(model["I_w"].array) / 0.036**2
    assert wheels == pytest.approx(4 / 0.32**2 / 1450 * 1.58), "they add as large a share to it as to a car's mass"
    assert float(model["c_0"].array) == pytest.approx(200 / 1450 * 1.58)
    assert float(model["force_per_unit"].array) == pytest.approx(1.58)
    of_car = with_vehicle(build("single_track"), car())
    assert float(of_car["h_cg"].array) == pytest.approx(0.55 * 2.7 / 2.76)
    assert float(of_car["I_z"].array) == pytest.approx(2270 * 1500 / 1450 * (2.7 / 2.76) ** 2)
    assert not of_car["I_z"].fixed
    unstated = with_vehicle(build("single_track"), Vehicle("nothing stated", {}))
    assert unstated.parameters == build("single_track").parameters


def test_what_is_said_of_mass_scales_what_nothing_is_said_of():
    chosen = RequestedModel(
        "longitudinal", choices=Choices(fix={"m": "1.58kg", "wheel_radius": "36mm"}, start={"c_0": "0.5N"})
    ).model()
    assert float(chosen["I_w"].array) == pytest.approx(1.58 / 1450 * (0.036 / 0.32) ** 2)
    assert float(chosen["c_0"].array) == 0.5
    assert RequestedModel("longitudinal", choices=Choices(fix={"c_1": None})).model()["I_w"].array == 1.0


def test_a_number_with_an_sd_is_free_with_that_belief():
    model = with_vehicle(build("single_track"), car(m=Stated(1500.0, 5.0, source="scale"), E_f=Stated(0.1, 0.3)))
    for name, mean, sd in (("m", 1500.0, 5.0), ("E_f", 0.1, 0.3)):
        assert not model[name].fixed
        assert (model[name].prior.mean, model[name].prior.sd) == (mean, sd)
    assert model["m"].source == "scale"


def test_limits_stated_replace_the_models_own():
    model = with_vehicle(build("single_track"), car(l_f=Stated(1.2, min=1.1, max=1.3), I_z=Stated(9e5, max=1e6)))
    assert model["l_f"].bounds == (1.1, 1.3)
    assert not model["l_f"].fixed
    assert model["I_z"].bounds == (build("single_track")["I_z"].bounds[0], 1e6)


def test_a_number_no_model_takes_is_refused_in_a_sentence():
    with pytest.raises(BadInput, match=r"car: h_cg = 55 m is outside the range that models accept, 0.01 to 2.5"):
        with_vehicle(build("single_track"), car(h_cg=Stated(55.0)))


def test_stiffness_and_friction_follow_from_pacejkas_parameters():
    found = derived(car(**PACEJKA))
    load = 1500 * 9.81 * 1.5 / 2.7
    assert found["C_alpha_f"].value == pytest.approx(10 * 1.4 * 0.9 * load)
    assert found["C_alpha_f"].sd == pytest.approx(np.hypot(0.1, 0.2) * found["C_alpha_f"].value)
    assert (found["mu_f"].value, found["mu_f"].sd) == (0.9, 0.18)
    assert (found["C_alpha_r"].sd, found["mu_r"].sd) == (None, None)
    assert found["C_alpha_f"].source == "B_f C_f D_f F_z"


def test_what_is_stated_comes_before_what_follows():
    model = with_vehicle(build("lateral", {"tyre": "brush"}), car(**PACEJKA, C_alpha_f=Stated(8e4, 1e3)))
    assert float(model["C_alpha_f"].array) == 8e4
    assert float(model["mu_f"].array) == 0.9


def test_nothing_follows_from_half_of_it():
    assert derived(Vehicle("car", PACEJKA)) == {}
    assert set(derived(car(B_f=Stated(10.0), C_f=Stated(1.4)))) == set()
    found = derived(car(B_f=Stated(10.0), C_f=Stated(1.4), D_f=Stated(1.0)))
    assert set(found) == {"C_alpha_f", "curve_slip_f", "mu_f"}


@pytest.mark.parametrize("tyre", TYRES)
def test_all_models_of_a_vehicle_turn_alike(tyre):
    stated = car(**PACEJKA)
    v = 15.0
    gains = [
        control.ss(*matrices(model, [0.0] * len(model.states), "steer", v_x=v)).dcgain().ravel()[-2]  # yaw rate
        for model in (build("lateral", {"tyre": tyre}, vehicle=stated), build("kinematic", vehicle=stated))
    ]
    assert gains[0] == pytest.approx(gains[1], rel=1e-9)


@pytest.mark.parametrize("name", shipped_vehicles())
@pytest.mark.parametrize(("model", "settings"), MODELS)
def test_every_model_takes_every_shipped_vehicle(name, model, settings):
    stated = vehicle(name, vehicle_parameters(), tuple(EFFECTS))
    made = with_tolerances(build(model, settings, vehicle=stated), stated, EFFECTS)
    assert all(parameter.source for parameter in made.parameters if parameter.name in stated.values)
    assert set(made.effects) <= set(stated.effects)


def test_tolerances_become_effects_free_about_their_null():
    stated = Vehicle("car", effects={"steering_lag": Stated(sd=0.003), "accel_bias_x": Stated(0.1, 0.01)})
    model = with_tolerances(build("single_track"), stated, EFFECTS)
    for name, mean, sd in (("steering_lag", 0.0, 0.003), ("accel_bias_x", 0.1, 0.01)):
        assert float(model[name].array) == mean
        assert (model[name].prior.mean, model[name].prior.sd, model[name].fixed) == (mean, sd, False)
    assert with_tolerances(build("lateral"), stated, EFFECTS).effects == ("steering_lag",), "it has no a_x"
    assert with_tolerances(model, stated, EFFECTS).effects == model.effects, "none is there twice"


def test_an_effect_stated_with_a_number_alone_is_held_there():
    held = stated_effect(EFFECTS["steering_delay"], Stated(0.03)).parameter
    assert (float(held.array), held.fixed) == (0.03, True)


def test_a_vehicle_names_the_model_that_describes_it_best():
    chosen = ChosenModel("lateral", {"tyre": "brush"}, {"steering_delay": Stated(0.03, 0.002)})
    model = model_of(Vehicle("car", {**GEOMETRY, **PACEJKA}, model=chosen))
    assert (model.name, model.settings["tyre"], model.effects) == ("lateral", "brush", ("steering_delay",))
    assert float(model["steering_delay"].array) == 0.03
    assert not model["steering_delay"].fixed
    assert float(model["l_f"].array) == 1.2
    assert model_of(car()).name == "single_track"


def test_a_vehicle_whose_model_cannot_be_is_refused_in_a_sentence():
    for chosen, says in (
        (ChosenModel("single_trak"), "Did you mean single_track"),
        (ChosenModel("lateral", {"tire": "brush"}), "Did you mean tyre"),
        (ChosenModel("lateral", {"tyre": "brushes"}), "Did you mean brush"),
        (ChosenModel("lateral", effects={"steering_dely": Stated(0.1)}), "Did you mean steering_delay"),
    ):
        with pytest.raises(BadInput, match=says):
            model_of(Vehicle("car", model=chosen))
    with pytest.raises(BadModel, match="motor_lag acts on drive"):
        model_of(Vehicle("car", model=ChosenModel("lateral", effects={"motor_lag": Stated(0.1)})))
