"""Models of a stated vehicle: its numbers in place of a model's own, its tolerances as effects.

A number stated alone is known where it is geometry or mass, and held; anywhere else it is where a fit starts. A number
stated with an sd is free, with that belief; one stated with limits is free within them.
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
"""Geometry and mass: held when a number is stated alone."""


def with_vehicle(model: AnyModel, vehicle: Vehicle) -> AnyModel:
    """The model with what is stated of a vehicle; what is not is scaled with its mass and size, or stays as it is.

    Cornering stiffness, friction and understeer gradient follow from Pacejka's B, C, D where the model asks for those
    and the vehicle states these. Numbers the model does not know are left out: a vehicle is more than one model.

    Raises
    ------
    BadInput : a value lies outside what the model takes for it.
    """
    stated = {**derived(vehicle), **vehicle.values}
    new = (_parameter(model[name], item, vehicle) for name, item in stated.items() if name in model)
    usual = (_scaled(model[name], item) for name, item in scaled(vehicle).items() if name in model)
    changed = model.with_parameters(*usual, *new)
    return replace(changed, parts=tuple(with_vehicle(part, vehicle) for part in changed.parts))


def scaled(vehicle: Vehicle) -> dict[str, Stated]:
    """What models take for a number that a vehicle does not state, from its mass and size where it states these.

    Models' own numbers are those of a car of 1450 kg: a wheel of 1 kg m^2 in a car of 1.6 kg would weigh a thousand
    times as much as the car. Inertias grow with mass and length squared, heights and tracks with length, resistance to
    rolling and the force per unit of a commanded acceleration with mass, drag with length squared, as in a car that is
    built the same way at another size.
    """
    stated, value = vehicle.values, {p.name: float(p.array) for p in (*BODY, *DRIVE, *WHEELS)}
    known = {name: _value(stated, name) for name in ("m", "l_f", "l_r", "wheel_radius") if name in stated}
    if "m" not in known:
        return {}
    mass = known["m"] / value["m"]
    sized = {"l_f", "l_r"} <= known.keys()
    length = (known["l_f"] + known["l_r"]) / (value["l_f"] + value["l_r"]) if sized else mass ** (1 / 3)
    radius = known.get("wheel_radius", length * value["wheel_radius"]) / value["wheel_radius"]
    factors = {
        "l_f": length, "l_r": length, "h_cg": length, "track_f": length, "track_r": length, "wheel_radius": radius,
        "I_z": mass * length**2, "I_w": mass * radius**2, "c_0": mass, "c_2": length**2, "force_per_unit": mass,
    }  # fmt: skip
    by = "a car of 1450 kg, scaled with mass and size"
    return {name: Stated(value[name] * factor, source=by) for name, factor in factors.items() if name not in stated}


def with_size(model: AnyModel, stated: Collection[str]) -> AnyModel:
    """The model with numbers that nobody said anything of scaled to the mass and size that were said."""
    values = {name: Stated(float(model[name].array)) for name in stated if name in model and model[name].shape == ()}
    usual = scaled(Vehicle("", values))
    return model.with_parameters(*(_scaled(model[name], item) for name, item in usual.items() if name in model))


def with_tolerances(model: AnyModel, vehicle: Vehicle, effects: Mapping[str, Effect]) -> AnyModel:
    """The model with the vehicle's tolerances as effects, free with their belief; those it cannot have are left out."""
    for name, tolerance in vehicle.effects.items():
        if name in effects and name not in model.effects and effects[name].concerns(model):
            model = model + stated_effect(effects[name], tolerance)
    return model


def stated_effect(effect: Effect, stated: Stated) -> Effect:
    """The effect as stated: held at a number alone; with an sd free, with that belief, about its null by default."""
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
    """What follows from Pacejka's parameters, mass and geometry, where a vehicle states these.

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
    assert value is not None  # of a parameter something is always stated
    return value


def _parameter(parameter: Parameter, stated: Stated, vehicle: Vehicle) -> Parameter:
    new = _bounded(parameter, stated, str(vehicle.path or vehicle.name))
    return replace(new, fixed=parameter.fixed or parameter.name in MEASURED) if stated.plain else new


def _scaled(parameter: Parameter, stated: Stated) -> Parameter:
    """The parameter at its usual value for such a size, free or held as the model has it."""
    if parameter.shape or stated.value is None or parameter.prior is not None:
        return parameter
    return replace(
        parameter, value=min(max(stated.value, parameter.bounds[0]), parameter.bounds[1]), source=stated.source
    )


def _bounded(parameter: Parameter, stated: Stated, where: str) -> Parameter:
    """The parameter free, at the value, with the limits and the belief that are stated."""
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
        prior = replace(prior, mean=None)  # a belief of the model's own is about the number that is now stated
    source = stated.source or (parameter.source if stated.value is None else where)
    return replace(parameter, value=value, bounds=(low, high), prior=prior, fixed=False, source=source)
