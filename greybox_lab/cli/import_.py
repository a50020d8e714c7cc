"""`greybox import`: a network that nnodely saved becomes a fit, a vehicle of another tool a vehicle file."""

from __future__ import annotations

from pathlib import Path

import click

from greybox_id.base.errors import BadInput
from greybox_id.base.files import ensure_writable
from greybox_id.base.guard import claim
from greybox_id.base.numbers import counted, number, pretty_unit
from greybox_id.base.signals import unit_of
from greybox_id.cli.defaults import command_line
from greybox_id.cli.options import FILE, JSON, argument, command, option
from greybox_id.cli.output import console, print_json
from greybox_id.fitting.fit import Fit
from greybox_id.models.vehicle import as_plain, write_vehicle

from ..nnodely import Imported, ImportedVehicle, import_network, import_vehicle
from ..nnodely.vehicles import SUFFIXES


@command("import")
def import_(
    network: str = argument("NETWORK", type=FILE),
    inputs: str = option(
        "Which signal each input of the network is, if its name does not show it.", "SIGNAL=INPUT,...", default=""
    ),
    sample_time: float | None = option(
        "Sample time with which the network was trained; default: the one in the file.",
        "SECONDS",
        type=click.FloatRange(min=1e-4, max=10.0),
    ),
    out: str | None = option(
        "File to write: .json for a network (default: MODEL/fit.json), .toml for a vehicle.",
        "FILE",
    ),
    as_json: bool = JSON,
) -> None:
    """Import NETWORK, a model-structured network saved by nnodely (saveModel), as a fit.

    A parameter file of another tool is imported as a vehicle file: a .tir file, Autoware's vehicle_info.param.yaml,
    and parameter files of f1tenth_gym and of CommonRoad. No code in the file is executed.

    \b
    greybox import trained/net.json --sample-time 0.05 --out run/fit.json
    greybox import trained/net.json --inputs v_x=omega,steer=handwheel,a_x=imu
    greybox import vehicle_info.param.yaml --out car.toml
    """  # fmt: skip
    if Path(network).suffix.lower() in SUFFIXES:
        if inputs or sample_time is not None:
            raise click.UsageError("--inputs and --sample-time belong to networks; a vehicle has none.")
        _vehicle(network, out, as_json)
        return
    if out is not None and Path(out).suffix != ".json":
        raise BadInput(f"{out}: a fit is a .json file; name one with --out.")
    command = command_line()
    pairs = [pair.strip() for pair in inputs.split(",") if pair.strip()]
    result = import_network(network, pairs, sample_time, command)
    target = Path(out) if out is not None else Path(result.fit.model.name) / "fit.json"
    claim(target, becomes=f"a fit of {result.fit.model.name}")
    ensure_writable(target.parent)
    path = result.fit.save(target)
    if as_json:
        print_json(_summary(result) | {"written": str(path)})
    else:
        _show(result, path)


def _vehicle(file: str, out: str | None, as_json: bool) -> None:
    """Make a vehicle file of another tool's file."""
    if out is not None and Path(out).suffix.lower() not in (".toml", ".json"):
        raise BadInput(f"{out}: a vehicle file ends in .toml or .json; name one with --out.")
    result = import_vehicle(file)
    target = claim(Path(out) if out is not None else Path(f"{Path(file).name.partition('.')[0]}.toml"))
    ensure_writable(target.parent)
    path = write_vehicle(result.vehicle, target)
    if as_json:
        print_json(
            {"kind": result.kind, "vehicle": as_plain(result.vehicle), "notes": result.notes, "written": str(path)}
        )
        return
    _show_vehicle(result, path)


def _show_vehicle(vehicle: ImportedVehicle, path: Path) -> None:
    out = console()
    out.print(f"vehicle  {vehicle.kind}: {', '.join(vehicle.vehicle.values) or 'nothing but limits'}")
    for note in vehicle.notes:
        out.print(f"note     {note}")
    out.print(f"\nwritten  {path}   to use it: greybox fit --model single_track --vehicle {path} RECORDING")


def _show(imported: Imported, path: Path) -> None:
    out, fit = console(), imported.fit
    out.print(f"network  {fit.how['imported']}: {fit.model.name}, {fit.model.size} numbers, {fit.model.about}")
    for title, names in (("inputs", imported.roles), ("outputs", imported.outputs)):
        words = [f"{signal} [{pretty_unit(unit_of(signal))}] from {name}" for name, signal in names.items()]
        out.print(f"{title:8} {', '.join(words)}")
    for line in _structure(fit):
        out.print(f"         {line}")
    nearness = f"to {imported.error:.0e} of the largest prediction"
    out.print(f"checked  on random windows: the model predicts the same as the file's graph, {nearness}")
    for note in imported.notes:
        out.print(f"note     {note}")
    out.print("fixed    all numbers: the file does not state their uncertainty, so there are no intervals")
    out.print(f"\nwritten  {path}   against a recording: greybox validate {path} RECORDING")


def _structure(fit: Fit) -> list[str]:
    """Local models, windows and centres, a line each."""
    settings = dict(fit.model.settings)
    lines = []
    for name, item in settings.items() if "lat" in settings else ((fit.model.name.removeprefix("msnn_"), settings),):
        if not isinstance(item, dict):
            continue
        step = item["sample_time"]
        samples = 1 + int(item["q"] if "q" in item else item["gamma"])
        neurons = f", {counted(item['eta'], 'neuron')} each for traction and braking" if "eta" in item else ""
        lines.append(f"{name}: windows of {counted(samples, 'sample')} of {step:g} s{neurons}")
        for signal in ("v_x", "steer", "a_x", "a_y"):
            if item.get(signal) is not None:
                centres = ", ".join(number(centre, 3) for centre in item[signal])
                lines.append(f"{name}: centres over {signal} at {centres} {pretty_unit(unit_of(signal))}")
    return lines


def _summary(imported: Imported) -> dict[str, object]:
    model = imported.fit.model
    return {
        "model": {"name": model.name, "settings": dict(model.settings), "numbers": model.size},
        "inputs": dict(imported.roles),
        "outputs": dict(imported.outputs),
        "difference": imported.error,
        "uncertainty": None,
        "notes": list(imported.notes),
    }
