"""`greybox gap`: where a simulation departs from the vehicle, which effect causes it, how much of it closes."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click

from .. import __version__
from ..choices.parameters import wanted_vehicle
from ..choices.wanted import doubts, must_be_recorded
from ..datasets.read import read
from ..errors import BadInput
from ..fit import load
from ..fitting import Say
from ..gap import Gap
from ..gap.closed_vehicle import closed_vehicle, fitted_vehicle
from ..gap.diagnosis import diagnose
from ..gap.kinds import Diagnosed
from ..gap.memory_bench import must_suit
from ..hybrid_model import HybridModel
from ..memory_model import MemoryModel
from ..model import Model
from ..models.effects import EFFECTS
from ..models.registry import MODELS, build, model_of
from ..motion_model import MotionModel
from ..provenance import data_record
from ..recording import Recording
from ..reports.gap.content import Made
from ..vehicle import Vehicle
from .completion import names
from .defaults import command_line
from .gap_files import stated_numbers, targets_of, warnings_of, without_vehicle, write
from .gap_output import as_json_text, show
from .options import VEHICLES, columns_option, json_option
from .output import console, progress


@click.command(name="gap")
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...", type=click.Path())
@click.option(
    "--vehicle",
    metavar="VEHICLE",
    shell_complete=VEHICLES,
    help="What is stated of the vehicle: a shipped one or a file.",
)
@click.option("--fit", "fit_file", metavar="FIT", type=click.Path(), help="In place of a vehicle, a fit.")
@click.option(
    "--model",
    metavar="NAME",
    shell_complete=names(MODELS),
    help="With --vehicle; default: the vehicle's own, else single_track.",
)
@columns_option
@click.option(
    "--held-out",
    multiple=True,
    metavar="RECORDING",
    type=click.Path(),
    help="A recording that chooses nothing, to say on how far the gap closes; repeatable.",
)
@click.option("--out", metavar="FOLDER", help="Folder for gap.json, gap.png, gap.pdf and closed.toml.")
@click.option("--report", metavar="FILE", help="Report, .pdf or .html; with --out, FOLDER/gap.pdf unless given.")
@click.option("--apply", metavar="FILE", help="Vehicle file (.toml or .json) with the effects that close the gap.")
@click.option("--check", is_flag=True, help="Exit with 1 where a gap is detected.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of everything random.")
@json_option
def gap(
    recordings: Sequence[str],
    vehicle: str | None,
    fit_file: str | None,
    model: str | None,
    columns: str,
    held_out: Sequence[str],
    out: str | None,
    report: str | None,
    apply: str | None,
    check: bool,
    seed: int,
    as_json: bool,
) -> None:
    """Say where the simulation of each RECORDING departs from the vehicle, why, and how much of that closes.

    \b
    greybox gap lap7.csv --vehicle car.toml --held-out lap8.csv
    greybox gap lap7.csv --fit run/fit.json --columns roboracer --report gap.pdf
    greybox gap lap7.csv --vehicle car.toml --apply car_closed.toml
    greybox simulate lap9.csv --vehicle car_closed.toml

    How far the gap closes is only known on recordings that chose nothing: name some with --held-out.
    """  # fmt: skip
    targets = targets_of(out, report, apply, kept=[*recordings, *held_out, *filter(None, (vehicle, fit_file))])
    asked = _asked(recordings, vehicle, fit_file, held_out, columns, model)
    held_by_file = isinstance(asked.model, MotionModel)
    if not held_by_file:
        targets = without_vehicle(targets, asked.model.name, apply)
    with progress() as say:
        found = _found(asked, seed, say, horizons=bool(targets) or not as_json)
    made = Made(
        vehicle=asked.vehicle.name,
        command=command_line(),
        seed=seed,
        version=__version__,
        data=(
            *(data_record(own, "train") for own in asked.recordings),
            *(data_record(own, "validate") for own in asked.held_out),
        ),
        settings=dict(asked.model.settings),
        effects={name: float(asked.model[name].array) for name in asked.model.effects},
        stated=stated_numbers(asked.vehicle, asked.model),
    )
    closed = closed_vehicle(asked.vehicle, found) if held_by_file else None
    for warning in warnings_of(closed, found, apply, out):
        click.echo(f"warning: {warning}", err=True)
    if as_json:
        sys.stdout.write(as_json_text(found, made, [target for _, target in targets]))
    else:
        show(console(), found)
    for kind, target in targets:
        write(kind, target, found, closed, made)
        if not as_json:
            console().print(f"written  {target}")
    if check and found.gap_detected:
        sys.exit(1)


def diagnosed(
    recordings: Sequence[str | Path],
    vehicle: str | Path | Vehicle | None = None,
    fit: str | Path | None = None,
    held_out: Sequence[str | Path] = (),
    columns: str | Path | None = None,
    say: Say | None = None,
    *,
    model: str | None = None,
    seed: int = 0,
) -> Gap:
    """What `greybox gap` finds, without its printing.

    Parameters
    ----------
    recordings, held_out : files that are diagnosed, and files that choose nothing.
    vehicle, fit : a shipped vehicle, a vehicle file or a vehicle; or the file of a fit: one of them.
    columns : column map; canonical names unless given.
    say : told of progress.
    model : with a vehicle, in place of its own.
    seed : of everything random.

    Raises
    ------
    BadInput : a file, or what is asked of it, cannot be used.
    """
    return _found(_asked(recordings, vehicle, fit, held_out, columns, model), seed, say or _silent)


@dataclass(frozen=True)
class _Asked:
    """What is diagnosed: the nominal model, what is stated of the vehicle, recordings."""

    model: Diagnosed
    vehicle: Vehicle
    recordings: list[Recording]
    held_out: list[Recording]


def _asked(
    recordings: Sequence[str | Path],
    vehicle: str | Path | Vehicle | None,
    fit: str | Path | None,
    held_out: Sequence[str | Path],
    columns: str | Path | None,
    model: str | None,
) -> _Asked:
    """Everything that was named, read and found fit to be diagnosed."""
    nominal, stated = _nominal(vehicle, fit, model)
    if not recordings:
        raise BadInput("There is no recording to diagnose; name at least one file.")
    own, others = ([read(file, columns or "canonical") for file in files] for files in (recordings, held_out))
    must_be_recorded(nominal, [*own, *others])
    if isinstance(nominal, MemoryModel):
        must_suit(nominal, [*own, *others])
    for recording in (*own, *others):
        if not any(name in recording for name in nominal.outputs):
            raise BadInput(
                f"{recording.name} has none of {', '.join(nominal.outputs)}, which {nominal.name} predicts; "
                "map the columns that hold them in the column map (--columns)."
            )
    seen = {recording.source.sha256: recording.source.path for recording in own}
    for source in (recording.source for recording in others):
        if source.sha256 in seen:
            raise BadInput(
                f"{source.path} is held out, but it is the same data as {seen[source.sha256]}, which is diagnosed; "
                "hold another one out."
            )
    return _Asked(nominal, stated, own, others)


def _nominal(
    vehicle: str | Path | Vehicle | None, fit: str | Path | None, model: str | None
) -> tuple[Diagnosed, Vehicle]:
    """The model that is diagnosed, and what is stated of its vehicle."""
    if (vehicle is None) == (fit is None):
        more = "." if vehicle is None else "; not both."
        raise BadInput(f"Which simulation? Name the vehicle with --vehicle, or a fit with --fit{more}")
    nominal: Model
    if fit is not None:
        if model is not None:
            raise BadInput(f"--model {model}: a fit brings its own model; leave --model away, or name --vehicle.")
        loaded = load(fit, build)
        if isinstance(loaded.model, HybridModel):
            raise BadInput(
                f"{fit} is a fit of {loaded.model.name}; the gap of hybrid models is not looked for: their "
                "network takes up what the equations lack. Name equations of motion or a model with memory."
            )
        nominal, stated = loaded.model, fitted_vehicle(loaded, str(fit))
        assert isinstance(nominal, MotionModel | MemoryModel)
        return nominal, stated
    found = vehicle if isinstance(vehicle, Vehicle) else wanted_vehicle(str(vehicle))
    assert found is not None
    own = found.model is not None and model in (None, found.model.name)
    nominal = model_of(found) if own or model is None else build(model, vehicle=found)
    if not isinstance(nominal, MotionModel):
        raise BadInput(
            f"{nominal.name} is a model with memory, whose weights no vehicle states: fit it, and name the fit with "
            "--fit; or name equations of motion with --model: single_track or lateral."
        )
    return nominal, found


def _found(asked: _Asked, seed: int, say: Say, horizons: bool = False) -> Gap:
    """The diagnosis, with doubts on whether the vehicle is the one that was recorded."""
    options: dict[str, Any] = {"horizons": horizons} | ({"seed": seed} if seed else {})
    found = diagnose(
        asked.model, asked.recordings, EFFECTS, vehicle=asked.vehicle, held_out=asked.held_out, say=say, **options
    )
    more = doubts(asked.model, asked.vehicle, asked.recordings)
    return replace(found, doubts=(*found.doubts, *(sentence for sentence in more if sentence not in found.doubts)))


def _silent(line: str, passing: bool = False) -> None:
    del line, passing
