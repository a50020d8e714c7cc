"""Models of a stated vehicle: its numbers in place of a model's own, its tolerances as effects.

A number stated alone is known where it is geometry or mass, and held; anywhere else it is where a fit starts. A number
stated with an sd is free, with that belief; one stated with limits is free within them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import hypot

from ..effect import AnyModel, Effect
from ..errors import BadInput
from ..memory_model import MemoryModel
from ..parameter import Parameter, Prior
from ..vehicle import Stated, Vehicle
from .single_track import G

MEASURED = ("m", "l_f", "l_r", "h_cg", "track_f", "track_r", "wheel_radius", "I_w")
"""Geometry and mass: held when a number is stated alone."""


def with_vehicle(model: AnyModel, vehicle: Vehicle) -> AnyModel:
    """The model with what is stated of a vehicle; what is not stated stays as it is.

    Cornering stiffness, friction and understeer gradient follow from Pacejka's B, C, D where the model asks for those
    and the vehicle states these. Numbers the model does not know are left out: a vehicle is more than one model.

    Raises
    ------
    BadInput : a value lies outside what the model takes for it.
    """
    stated = {**derived(vehicle), **vehicle.values}
    new = (_parameter(model[name], own, vehicle) for name, own in stated.items() if name in model)
    changed = model.with_parameters(*new)
    if isinstance(changed, MemoryModel):
        return replace(changed, parts=tuple(with_vehicle(part, vehicle) for part in changed.parts))
    return changed


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

    C_alpha = B C D F_z with the static load of the axle, mu = D, and the understeer gradient K_us.
    """
    stated, found = vehicle.values, {}
    if not {"m", "l_f", "l_r"} <= stated.keys():
        return {}
    m, l_f, l_r = (_value(stated, name) for name in ("m", "l_f", "l_r"))
    for suffix, other in (("f", l_r), ("r", l_f)):
        if {f"{letter}_{suffix}" for letter in "BCD"} <= stated.keys():
            factors = [stated[f"{letter}_{suffix}"] for letter in "BCD"]
            B, C, D = (_value(stated, f"{letter}_{suffix}") for letter in "BCD")
            C_alpha = B * C * D * m * G * other / (l_f + l_r)
            relative = hypot(*((own.sd or 0.0) / (own.value or 1.0) for own in factors))
            by = f"B_{suffix} C_{suffix} D_{suffix} F_z"
            found[f"C_alpha_{suffix}"] = Stated(C_alpha, abs(C_alpha) * relative or None, source=by)
            found[f"mu_{suffix}"] = replace(factors[2], source=f"D_{suffix}")
    slopes = {**found, **stated}
    if {"C_alpha_f", "C_alpha_r"} <= slopes.keys():
        C_f, C_r = (_value(slopes, name) for name in ("C_alpha_f", "C_alpha_r"))
        by_f, by_r = m / (l_f + l_r) * l_r / C_f, m / (l_f + l_r) * l_f / C_r
        sd = hypot(by_f * (slopes["C_alpha_f"].sd or 0.0) / C_f, by_r * (slopes["C_alpha_r"].sd or 0.0) / C_r)
        found["K_us"] = Stated(by_f - by_r, sd or None, source="m / L (l_r / C_alpha_f - l_f / C_alpha_r)")
    return found


def _value(stated: Mapping[str, Stated], name: str) -> float:
    value = stated[name].value
    assert value is not None  # of a parameter something is always stated
    return value


def _parameter(parameter: Parameter, stated: Stated, vehicle: Vehicle) -> Parameter:
    new = _bounded(parameter, stated, str(vehicle.path or vehicle.name))
    return replace(new, fixed=parameter.fixed or parameter.name in MEASURED) if stated.plain else new


def _bounded(parameter: Parameter, stated: Stated, where: str) -> Parameter:
    """The parameter free, at the value, with the limits and the belief that are stated."""
    low = parameter.bounds[0] if stated.min is None else stated.min
    high = parameter.bounds[1] if stated.max is None else stated.max
    value = float(parameter.array) if stated.value is None else stated.value
    if not low <= value <= high:
        raise BadInput(
            f"{where}: {parameter.name} = {value:g} {parameter.unit} is outside what models take for it, {low:g} to "
            f"{high:g}. Mend it, or state min and max with it."
        )
    prior = Prior(stated.sd, mean=value) if stated.sd is not None else parameter.prior
    if prior is not None and stated.sd is None and stated.value is not None:
        prior = replace(prior, mean=None)  # a belief of the model's own is about the number that is now stated
    source = stated.source or (parameter.source if stated.value is None else where)
    return replace(parameter, value=value, bounds=(low, high), prior=prior, fixed=False, source=source)
