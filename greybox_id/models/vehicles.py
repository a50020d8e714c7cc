"""Models of a stated vehicle: its values replace a model's defaults, its tolerances become effects.

A plain number is held if it is geometry or mass; otherwise it is the initial value of a fit. A number with an sd is
free with that prior; a number with limits is free within them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from math import hypot

from ..base.errors import BadInput
from .effect import AnyModel, Effect
from .longitudinal import WHEELS
from .parameter import Parameter, Prior, Stated
from .single_track import BODY, DRIVE, G
from .vehicle import Vehicle

MEASURED = ("m", "l_f", "l_r", "h_cg", "track_f", "track_r", "wheel_radius", "I_w")
"""Geometry and mass: held if stated as a plain number."""


def with_vehicle(model: AnyModel, vehicle: Vehicle) -> AnyModel:
    """The model with a vehicle's stated values; others are scaled with its mass and size, or keep their defaults.

    Cornering stiffness, friction and understeer gradient follow from Pacejka's B, C, D if the model has the former and
    the vehicle states the latter. Values that the model does not have are ignored: they serve other models.

    Raises
    ------
    BadInput : a value is outside the bounds of the model.
    """
    stated = {**derived(vehicle), **vehicle.values}
    new = (_parameter(model[name], item, vehicle) for name, item in stated.items() if name in model)
    usual = (_scaled(model[name], item) for name, item in scaled(vehicle).items() if name in model)
    changed = model.with_parameters(*usual, *new)
    return replace(changed, parts=tuple(with_vehicle(part, vehicle) for part in changed.parts))


def scaled(vehicle: Vehicle) -> dict[str, Stated]:
    """Values that a vehicle does not state, scaled from its mass and size if stated.

    Models' defaults are those of a car of 1450 kg: a wheel of 1 kg m^2 in a car of 1.6 kg would weigh a thousand times
    as much as the car. Inertias scale with mass and length squared, heights and tracks with length, rolling resistance
    and force per unit of a commanded acceleration with mass, drag with length squared, as for a geometrically similar
    car.
    """
    stated, default = vehicle.values, {p.name: float(p.array) for p in (*BODY, *DRIVE, *WHEELS)}
    stated_values = {name: _value(stated, name) for name in ("m", "l_f", "l_r", "wheel_radius") if name in stated}
    if "m" not in stated_values:
        return {}
    mass = stated_values["m"] / default["m"]
    sized = {"l_f", "l_r"} <= stated_values.keys()
    length = (
        (stated_values["l_f"] + stated_values["l_r"]) / (default["l_f"] + default["l_r"]) if sized else mass ** (1 / 3)
    )
    radius = stated_values.get("wheel_radius", length * default["wheel_radius"]) / default["wheel_radius"]
    factors = {
        "l_f": length, "l_r": length, "h_cg": length, "track_f": length, "track_r": length, "wheel_radius": radius,
        "I_z": mass * length**2, "I_w": mass * radius**2, "c_0": mass, "c_2": length**2, "force_per_unit": mass,
    }  # fmt: skip
    by = "a car of 1450 kg, scaled with mass and size"
    return {name: Stated(default[name] * factor, source=by) for name, factor in factors.items() if name not in stated}


def with_size(model: AnyModel, stated: Collection[str]) -> AnyModel:
    """The model with its defaults scaled to the stated mass and size, except for the stated parameters."""
    values = {name: Stated(float(model[name].array)) for name in stated if name in model and model[name].shape == ()}
    usual = scaled(Vehicle("", values))
    return model.with_parameters(*(_scaled(model[name], item) for name, item in usual.items() if name in model))


def with_tolerances(model: AnyModel, vehicle: Vehicle, effects: Mapping[str, Effect]) -> AnyModel:
    """The model with the vehicle's tolerances as effects, free with their priors; those it cannot have are ignored."""
    for name, tolerance in vehicle.effects.items():
        if name in effects and name not in model.effects and effects[name].concerns(model):
            model = model + stated_effect(effects[name], tolerance)
    return model


def stated_effect(effect: Effect, stated: Stated) -> Effect:
    """The effect as stated: held at a plain number; free with a prior if an sd is stated, by default about its null."""
    if stated.value is not None and stated.plain:
        return effect.at(stated.value)

    def free(parameter: Parameter) -> Parameter:
        return _bounded(parameter, stated, f"effect {effect.name}")

    return replace(
        effect,
        parameter=free(effect.parameter),
        memory_parameter=effect.memory_parameter and free(effect.memory_parameter),
    )


def derived(vehicle: Vehicle) -> dict[str, Stated]:
    """Parameters that follow from Pacejka's parameters, mass and geometry, if a vehicle states these.

    C_alpha = B C D F_z with the static load of the axle, mu = D, the slip curve_slip = 1 / (B C) at which that slope
    alone would give the peak, and the understeer gradient K_us.
    """
    stated, result = vehicle.values, {}
    if not {"m", "l_f", "l_r"} <= stated.keys():
        return {}
    m, l_f, l_r = (_value(stated, name) for name in ("m", "l_f", "l_r"))
    for suffix, other in (("f", l_r), ("r", l_f)):
        if {f"{letter}_{suffix}" for letter in "BCD"} <= stated.keys():
            factors = [stated[f"{letter}_{suffix}"] for letter in "BCD"]
            B, C, D = (_value(stated, f"{letter}_{suffix}") for letter in "BCD")
            C_alpha = B * C * D * m * G * other / (l_f + l_r)
            relative = hypot(*((factor.sd or 0.0) / (factor.value or 1.0) for factor in factors))
            by = f"B_{suffix} C_{suffix} D_{suffix} F_z"
            result[f"C_alpha_{suffix}"] = Stated(C_alpha, abs(C_alpha) * relative or None, source=by)
            result[f"mu_{suffix}"] = replace(factors[2], source=f"D_{suffix}")
            result[f"curve_slip_{suffix}"] = Stated(1.0 / (B * C), source=f"1 / (B_{suffix} C_{suffix})")
    slopes = {**result, **stated}
    if {"C_alpha_f", "C_alpha_r"} <= slopes.keys():
        C_f, C_r = (_value(slopes, name) for name in ("C_alpha_f", "C_alpha_r"))
        by_f, by_r = m / (l_f + l_r) * l_r / C_f, m / (l_f + l_r) * l_f / C_r
        sd = hypot(by_f * (slopes["C_alpha_f"].sd or 0.0) / C_f, by_r * (slopes["C_alpha_r"].sd or 0.0) / C_r)
        result["K_us"] = Stated(by_f - by_r, sd or None, source="m / L (l_r / C_alpha_f - l_f / C_alpha_r)")
    return result


def _value(stated: Mapping[str, Stated], name: str) -> float:
    value = stated[name].value
    assert value is not None  # a parameter is never stated without a value
    return value


def _parameter(parameter: Parameter, stated: Stated, vehicle: Vehicle) -> Parameter:
    new = _bounded(parameter, stated, str(vehicle.path or vehicle.name))
    return replace(new, fixed=parameter.fixed or parameter.name in MEASURED) if stated.plain else new


def _scaled(parameter: Parameter, stated: Stated) -> Parameter:
    """The parameter at its scaled value, free or held as in the model."""
    if parameter.shape or stated.value is None or parameter.prior is not None:
        return parameter
    return replace(
        parameter, value=min(max(stated.value, parameter.bounds[0]), parameter.bounds[1]), source=stated.source
    )


def _bounded(parameter: Parameter, stated: Stated, where: str) -> Parameter:
    """The parameter, free, with the stated value, limits and prior."""
    low = parameter.bounds[0] if stated.min is None else stated.min
    high = parameter.bounds[1] if stated.max is None else stated.max
    value = float(parameter.array) if stated.value is None else stated.value
    if not low <= value <= high:
        unit = "" if parameter.unit == "1" else f" {parameter.unit}"
        raise BadInput(
            f"{where}: {parameter.name} = {value:g}{unit} is outside the range that models accept, {low:g} to "
            f"{high:g}. Correct the value, or state min and max with it."
        )
    prior = Prior(stated.sd, mean=value) if stated.sd is not None else parameter.prior
    if prior is not None and stated.sd is None and stated.value is not None:
        prior = replace(prior, mean=None)  # centre the model's prior on the stated value
    source = stated.source or (parameter.source if stated.value is None else where)
    return replace(parameter, value=value, bounds=(low, high), prior=prior, fixed=False, source=source)
