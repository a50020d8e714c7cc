"""`greybox models` and `greybox effects`: descriptions of models and effects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from ..base.errors import BadInput, near_or_all
from ..base.files import write_atomically
from ..base.numbers import pretty_unit, with_unit
from ..fitting.requested_model import named_vehicle
from ..models.effect import Effect
from ..models.effects import EFFECTS
from ..models.model import Model
from ..models.parameter import Parameter, Stated
from ..models.registry import MODELS, build
from ..models.vehicle import ChosenModel, Vehicle, vehicle_text
from ..reports.text.screen import plain, plain_table
from .options import JSON, VEHICLES, argument, command, named_effect, named_model, names, option, settings_of
from .output import console, print_json


@command("models")
def models(
    name: str | None = argument("[NAME]", required=False, shell_complete=names(MODELS), callback=named_model),
    vehicle: str | None = option(
        "Show the model with the values of this vehicle: a shipped name or a file.", "VEHICLE", shell_complete=VEHICLES
    ),
    settings: Sequence[str] = option("Setting of the model, such as tyre=brush.", "NAME=VALUE", name="--set"),
    out: str | None = option("Write these values to a vehicle file (.toml), which you can edit.", "FILE"),
    as_json: bool = JSON,
) -> None:
    """List the models; with NAME, show inputs, outputs, parameters, settings and possible effects of this model.

    \b
    greybox models single_track --set tyre=brush --vehicle full_size_car
    greybox models single_track --vehicle roboracer --out car.toml
    """
    if out is not None and name is None:
        raise BadInput(f"‹out›: which model is {out} for? Name it: greybox models single_track --out {out}.")
    if name is not None:
        like = named_vehicle(vehicle)
        model = build(name, settings_of(settings), vehicle=like)
        if out is not None:
            _write_vehicle(model, like, Path(out))
        if as_json:
            print_json(_described(model))
        elif out is not None:
            console().print(f"written  {out}; replace its numbers by yours, then: greybox fit lap.csv --vehicle {out}")
        else:
            _show_model(model)
        return
    built = {known: build(known) for known in MODELS}
    if as_json:
        print_json(
            {
                "models": {known: _in_short(model) for known, model in built.items()},
                "effects": {known: _effect(effect) for known, effect in EFFECTS.items()},
            }
        )
        return
    table = plain_table("model", "parameters", "inputs", "outputs", "about")
    for known, model in built.items():
        table.add_row(known, str(model.size), " ".join(model.inputs), " ".join(model.outputs), model.about)
    console().print(table)
    console().print(
        "\ngreybox models NAME shows the parameters of a model, their bounds, and the effects that can be added to it."
    )


@command("effects")
def effects(
    name: str | None = argument("[NAME]", required=False, shell_complete=names(EFFECTS), callback=named_effect),
    as_json: bool = JSON,
) -> None:
    """List the effects that can be added to models; with NAME, show unit, bounds and models of this effect.

    \b
    greybox effects steering_delay
    """  # fmt: skip
    if name is not None and name not in EFFECTS:
        raise BadInput(f"There is no effect {name!r}.{near_or_all(name, EFFECTS)}")
    if name is not None:
        result = _effect(EFFECTS[name]) | {"models": _applies_to(EFFECTS[name])}
        if as_json:
            print_json({"name": name} | result)
        else:
            _show_effect(EFFECTS[name], result["models"])
        return
    if as_json:
        print_json({"effects": {known: _effect(e) | {"models": _applies_to(e)} for known, e in EFFECTS.items()}})
        return
    table = plain_table("effect", "no effect", "unit", "group", "what its magnitude is")
    for known, effect in EFFECTS.items():
        parameter = effect.parameter
        table.add_row(known, plain(float(parameter.array)), pretty_unit(parameter.unit), effect.group, parameter.about)
    console().print(table)
    console().print(
        "\nno effect: the magnitude with which the effect changes nothing\n"
        "greybox effects NAME shows to which models an effect can be added, its bounds and its typical magnitude."
    )


def _show_model(model: Model) -> None:
    out = console()
    out.print(f"{model.name}: {model.about}\n")
    rows = [("inputs", ", ".join(_input(model, name) for name in model.inputs))]
    rows.append(("outputs", ", ".join(f"{name} [{pretty_unit(model.unit(name))}]" for name in model.outputs)))
    if states := getattr(model, "states", ()):
        rows.append(("states", ", ".join(f"{s.name} [{pretty_unit(s.unit)}]" for s in states)))
    if model.settings:
        rows.append(("settings", ", ".join(f"{key}={value}" for key, value in model.settings.items())))
    rows.append(("effects", ", ".join(name for name, effect in EFFECTS.items() if effect.concerns(model)) or "none"))
    head = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, show_header=False)
    for title, item in rows:
        head.add_row(title, item)
    out.print(head)
    out.print()
    table = plain_table("parameter", "value", "unit", "bounds", "prior", "", "about")
    for p in model.parameters:
        value = plain(float(p.array)) if p.shape == () else " × ".join(map(str, p.shape))
        bounds = f"[{plain(p.bounds[0])}, {plain(p.bounds[1])}]"
        table.add_row(p.name, value, pretty_unit(p.unit), bounds, _prior(p), "fixed" if p.fixed else "free", p.about)
    out.print(table)


def _write_vehicle(model: Model, like: Vehicle | None, out: Path) -> None:
    """Write a vehicle file with a model's parameters, each with its meaning as a comment."""
    numbers = [p for p in model.parameters if p.shape == () and not (p.fixed and float(p.array) == 0.0)]
    values = {
        p.name: Stated(float(p.array), None if p.prior is None else float(np.asarray(p.prior.sd))) for p in numbers
    }
    comments = {p.name: p.about if p.unit == "1" else f"{p.unit}: {p.about}" for p in numbers}
    comments |= {
        "parameters": "values in SI units; a fit uses sd, the standard deviation of a value, as the width of its prior",
        "effects": "how large each effect may be without counting as a gap",
        "noise": "standard deviations of the sensors",
    }
    chosen = ChosenModel(model.name, dict(model.settings))
    vehicle = Vehicle(out.stem, values, like.effects if like else {}, like.noise if like else {}, model=chosen)
    if out.suffix.lower() != ".toml":
        raise BadInput(f"‹out› {out}: a vehicle file that is to be edited ends in .toml; name it so.")
    write_atomically(out, vehicle_text(vehicle, comments))


def _show_effect(effect: Effect, applies_to: Sequence[str]) -> None:
    parameter = effect.parameter
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, show_header=False)
    table.add_row("magnitude", parameter.about)
    table.add_row("unit", pretty_unit(parameter.unit))
    table.add_row("neutral", f"{plain(float(parameter.array))}: with this magnitude the effect changes nothing")
    table.add_row("bounds", f"{plain(parameter.bounds[0])} to {plain(parameter.bounds[1])}")
    table.add_row("typical", f"{with_unit(plain(effect.typical), parameter.unit)}: a fit starts from this magnitude")
    table.add_row("group", effect.group)
    for other in effect.others:
        table.add_row("parameter", f"{other.name} = {with_unit(plain(float(other.array)), other.unit)}: {other.about}")
    table.add_row("models", ", ".join(applies_to) or "none")
    console().print(f"{effect.name}\n")
    console().print(table)


def _in_short(model: Model) -> dict[str, Any]:
    return {
        "about": model.about,
        "inputs": model.inputs,
        "outputs": model.outputs,
        "parameters": model.size,
        "settings": dict(model.settings),
    }


def _described(model: Model) -> dict[str, Any]:
    states = [{"name": s.name, "unit": s.unit} for s in getattr(model, "states", ())]
    return {
        "name": model.name,
        **_in_short(model),
        "inputs": {name: {"unit": model.unit(name), "any_of": list(_aliases(model, name))} for name in model.inputs},
        "outputs": {name: {"unit": model.unit(name)} for name in model.outputs},
        "states": states,
        "parameters": {
            p.name: {
                "unit": p.unit,
                "value": p.array.tolist(),
                "bounds": list(p.bounds),
                "prior_sd": None if p.prior is None or p.shape != () else float(np.asarray(p.prior.sd)),
                "free": not p.fixed,
                "about": p.about,
            }
            for p in model.parameters
        },
        "effects": [name for name, effect in EFFECTS.items() if effect.concerns(model)],
    }


def _effect(effect: Effect) -> dict[str, Any]:
    parameter = effect.parameter
    return {
        "unit": parameter.unit,
        "null": float(parameter.array) if abs(float(parameter.array)) < float("inf") else str(float(parameter.array)),
        "about": parameter.about,
        "bounds": list(parameter.bounds),
        "typical": effect.typical,
        "group": effect.group,
        "touches": effect.touches,
        "needs": effect.needs,
    }


def _applies_to(effect: Effect) -> list[str]:
    return [name for name in MODELS if effect.concerns(build(name))]


def _aliases(model: Model, name: str) -> tuple[str, ...]:
    return model.aliases.get(name, (name,))


def _input(model: Model, name: str) -> str:
    names_with_units = [f"{alias} [{pretty_unit(model.unit(alias))}]" for alias in _aliases(model, name)]
    entry = names_with_units[0] if len(names_with_units) == 1 else f"{name}: {' or '.join(names_with_units)}"
    return f"{entry} (otherwise {model.defaults[name]:g})" if name in model.defaults else entry


def _prior(parameter: Parameter) -> str:
    if parameter.prior is None:
        return ""
    return f"± {plain(float(np.asarray(parameter.prior.sd)))}" if parameter.shape == () else "yes"
