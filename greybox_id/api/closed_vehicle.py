"""A diagnosis as a vehicle, whose file includes the effects that close the gap, as input for all commands."""

from __future__ import annotations

from dataclasses import replace
from math import isfinite

import numpy as np

from ..base.errors import BadInput
from ..base.statistics import NORMAL
from ..fitting.fit import FREE_RUN, Fit
from ..gap.gap import Gap, Ranked
from ..models.hybrid_model import HybridModel
from ..models.memory_model import MemoryModel
from ..models.model import Model
from ..models.parameter import Parameter, Stated
from ..models.registry import build
from ..models.vehicle import ChosenModel, Vehicle

CLOSED = ", gap closed"
"""Suffix of the vehicle's name."""
BY, FITTED = "greybox gap", "greybox fit"
"""Source of numbers from a diagnosis, and from a fit."""


def closed_vehicle(vehicle: Vehicle, gap: Gap) -> Vehicle:
    """The vehicle of the closed model: nominal model, applied effects, and parameters that moved with them.

    Parameters
    ----------
    vehicle : as stated before the diagnosis.
    gap : the diagnosis; without a closed model, magnitudes are those of its ranking.

    Returns
    -------
    Vehicle
        `model_of` builds the closed model from it. An applied effect has its magnitude, and the standard deviation of
        its interval, which is its tolerance in a further diagnosis. Numbers that differ in the closed model are
        replaced, but keep what else was stated for them.

    Raises
    ------
    BadInput : if the model contains a network, whose weights a vehicle file cannot contain.
    """
    if gap.closed is not None and gap.closed.learnt:
        raise BadInput(f"{gap.model} closed: {no_place(gap.model)}")
    model = vehicle.model
    closed = gap.closed
    before = model.effects if model is not None else {}
    ranked = {one.effect: one for one in gap.ranking}
    if closed is None:
        settings = model.settings if model is not None and model.name == gap.model else {}
        stated_effects = before if model is not None and model.name == gap.model else {}
        added = {name: _magnitude(ranked[name]) for name in gap.applied if name in ranked and ranked[name].lasts}
        chosen = ChosenModel(gap.model, settings, {**stated_effects, **added})
        values = dict(vehicle.values)
    else:
        added = {}
        for name in closed.effects:
            value = float(closed[name].array)
            if not isfinite(value):  # at its neutral value, as a limit that the fit to free runs has taken away
                continue
            if name in gap.applied and name in ranked and ranked[name].lasts:
                added[name] = replace(_magnitude(ranked[name]), value=value)
            else:
                added[name] = replace(before.get(name, Stated(source=BY)), value=value)
        chosen = ChosenModel(closed.name, closed.settings, added)
        values = {**vehicle.values, **_moved(vehicle, closed)}
    tolerated = {name: effect for name, effect in vehicle.effects.items() if name not in chosen.effects}
    return replace(
        vehicle,
        name=f"{vehicle.name.removesuffix(CLOSED)}{CLOSED}" if gap.applied else vehicle.name,
        values=values,
        effects=tolerated,
        model=chosen,
        path=None,
    )


def no_place(model: str) -> str:
    """Why a model with a network has no closed vehicle, and what to use instead."""
    return f"a vehicle file has no place for the weights of {model}; use the closed model that gb.diagnose returns."


def fitted_vehicle(fit: Fit, name: str) -> Vehicle:
    """A fit as a vehicle: estimates with their standard deviations, and its effects as part of its model.

    Each standard deviation combines that of the fit with the distance of the estimate from the prior's mean: a
    parameter that compensated for a missing effect can then move back when that effect is added.

    Residuals of a fit include model error, so the sensors' noise is not set. For a model with memory, a gap is what
    exceeds the error of its training: its weights are fixed, and its errors in free run on the training data count as
    noise.

    Parameters
    ----------
    fit : of either kind of model.
    name : of the vehicle.
    """
    model = fit.model
    about = f"Estimates of {model.name}, fitted to {', '.join(record.name for record in fit.data)}."
    if isinstance(model, MemoryModel | HybridModel):
        effects = {effect: Stated(float(model[effect].array), source=FITTED) for effect in model.effects}
        chosen = ChosenModel(model.name, model.settings, effects)
        return Vehicle(name, noise=_left(fit, model), model=chosen, about=about)
    usual = build(model.name, model.settings)

    def stated(parameter: Parameter) -> Stated:
        sd = float(fit.sd[parameter.name]) if parameter.name in fit.sd and not parameter.fixed else 0.0
        if sd > 0 and parameter.prior is not None and parameter.prior.mean is not None:
            sd = float(np.hypot(sd, float(parameter.array) - float(np.asarray(parameter.prior.mean))))
        low, high = parameter.bounds if parameter.name in usual else (None, None)
        same = parameter.name not in usual or usual[parameter.name].bounds == parameter.bounds
        limits = (None, None) if same else (low, high)
        return Stated(float(parameter.array), sd if isfinite(sd) and sd > 0 else None, *limits, source=FITTED)

    return Vehicle(
        name=name,
        values={number.name: stated(number) for number in _numbers(model)},
        model=ChosenModel(model.name, model.settings, {effect: stated(model[effect]) for effect in model.effects}),
        about=about,
    )


def with_sensors(fitted: Vehicle, stated: Vehicle) -> Vehicle:
    """A vehicle from a fit, with noise, steering range, model error and tolerances of a stated one.

    Its numbers and the effects of its model remain those of the fit.
    """
    effects = fitted.model.effects if fitted.model is not None else {}
    return replace(
        fitted,
        noise=stated.noise,
        effects={name: tolerance for name, tolerance in stated.effects.items() if name not in effects},
        steer_max=stated.steer_max,
        model_error=stated.model_error,
    )


def _left(fit: Fit, model: MemoryModel | HybridModel) -> dict[str, float]:
    """Output -> root mean square of the errors on the fit's training data, if known."""
    protocol = FREE_RUN
    if isinstance(model, MemoryModel):
        protocol = "honest" if model.feedback is None else "closed_loop"
    errors = fit.metrics.get("train", {}).get(protocol, {})
    left = {output: float(errors[output]["rmse"]) for output in model.outputs if output in errors}
    return {output: rmse for output, rmse in left.items() if isfinite(rmse) and rmse > 0}


def _numbers(model: Model) -> list[Parameter]:
    """The model's parameters without magnitudes of effects; other parameters of effects are numbers of the vehicle."""
    return [
        parameter for parameter in model.parameters if parameter.shape == () and parameter.name not in model.effects
    ]


def _moved(vehicle: Vehicle, closed: Model) -> dict[str, Stated]:
    """Parameters of the closed model, without magnitudes, that differ from stated numbers or defaults."""
    nominal = build(closed.name, closed.settings, dict.fromkeys(closed.effects), vehicle)
    result = {}
    for parameter in _numbers(closed):
        value = float(parameter.array)
        if parameter.name in nominal and value != float(nominal[parameter.name].array):
            result[parameter.name] = replace(vehicle.values.get(parameter.name, Stated()), value=value, source=BY)
    return result


def _magnitude(ranked: Ranked) -> Stated:
    """Magnitude of an effect, with its standard deviation if its interval is finite."""
    low, high = ranked.interval
    sd = (high - low) / (2 * NORMAL)
    return Stated(ranked.magnitude, sd if isfinite(sd) and sd > 0 else None, source=BY)
