"""`greybox track`: sideslip, tyres and forces along a recording, by an EKF or UKF."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import click
import numpy as np
from rich.table import Table

from .. import __version__
from ..choices.quantity import named, number
from ..choices.wanted import Wanted
from ..datasets.column_map import column_map
from ..datasets.read import read
from ..datasets.vehicle_text import write_vehicle
from ..errors import BadInput
from ..files import write_atomically
from ..filters import How, Track
from ..filters import track as track_recording
from ..filters.applied import tracked_vehicle
from ..fit import load
from ..memory_model import MemoryModel
from ..model import Model
from ..models.effects import EFFECTS
from ..models.registry import build
from ..motion_model import MotionModel
from ..parameter import Array
from ..reports.numbers import counted, pretty_unit
from ..reports.track.digest import Made
from ..reports.track.digesting import digest
from ..reports.track.saved import as_text, is_track
from ..signals import unit_of
from ..vehicle import TrackingPlan
from .defaults import command_line
from .model_options import model_options, wanted
from .options import columns_option, json_option
from .output import console, print_json, progress
from .predict import target_of, write

FROM_STDIN = "-"


@click.command(name="track")
@click.argument("file", metavar="RECORDING", required=False, type=click.Path())
@model_options
@click.option("--fit", "fit_file", metavar="FIT", type=click.Path(), help="In place of a vehicle or model, a fit.")
@columns_option
@click.option("--parameters", multiple=True, metavar="NAMES", help="What walks: C_alpha_f,C_alpha_r or F_yf,F_yr.")
@click.option("--disturbances", multiple=True, metavar="NAMES", help="What comes and goes: road_bank,S_h_f.")
@click.option(
    "--readings", default="v_x,yaw_rate,a_y", show_default=True, metavar="NAMES", help="Readings that are taken."
)
@click.option("--coloured", default="", metavar="NAMES", help="Readings whose error has a slow part: a_y.")
@click.option("--filter", "kind", type=click.Choice(["ekf", "ukf"]), default="ekf", show_default=True)
@click.option("--smooth", is_flag=True, help="Let later readings count as well.")
@click.option("--noise", multiple=True, metavar="NAME=SIZE", help="Size of a noise, such as walk_v_y=0.05.")
@click.option(
    "--tune",
    default="60s",
    show_default=True,
    metavar="SECONDS",
    help="Beginning of the recording on which noise that is not stated is tuned; 0 leaves it as guessed.",
)
@click.option(
    "--calibrate",
    default="0s",
    show_default=True,
    metavar="SECONDS",
    help="Beginning of the recording on which the model's free parameters are tuned along.",
)
@click.option(
    "--gate",
    default=5.0,
    show_default=True,
    type=click.FloatRange(min=0, min_open=True),
    metavar="SDS",
    help="Readings further off count as noisier.",
)
@click.option("--out", default="estimates.parquet", show_default=True, metavar="FILE", help="A .csv or .parquet file.")
@click.option("--figures", metavar="FOLDER", help="Write pictures there, as SVG.")
@click.option("--apply", metavar="FILE", help="Vehicle file (.toml or .json) with what was tuned.")
@click.option("--follow", is_flag=True, help="Read CSV lines from standard input and write estimates line by line.")
@json_option
def track(
    file: str | None, fit_file: str | None, columns: str, parameters: Sequence[str], disturbances: Sequence[str],
    readings: str, coloured: str, kind: Literal["ekf", "ukf"], smooth: bool, noise: Sequence[str], tune: str,
    calibrate: str, gate: float, out: str, figures: str | None, apply: str | None, follow: bool, as_json: bool,
    **asked: Any,
) -> None:  # fmt: skip
    """Estimate sideslip, cornering stiffness and tyre forces along RECORDING.

    \b
    greybox track --vehicle car.toml lap.csv --parameters C_alpha_f,C_alpha_r --smooth --out estimates.parquet
    greybox track --vehicle car.toml lap.csv --parameters F_yf,F_yr --filter ukf
    greybox track --vehicle car.toml lap.csv --calibrate 200s --apply car_calibrated.toml
    cat live.csv | greybox track --vehicle car.toml --columns canonical --follow

    Forces named as parameters replace the tyre model. An input that was not recorded, such as the driving force,
    follows from the readings. What is free with a stated belief (sd) is uncertain, and widens the bands.

    Beside the table a .json of the same name is left, of which greybox report makes a report.
    """  # fmt: skip
    chosen = wanted(**asked)
    model, plan, uncertain = _model(chosen, fit_file)
    own = _names(parameters) or plan.parameters
    others = _names(disturbances) or tuple(name for name in plan.disturbances if name not in own)
    how = How(
        filter=kind, smooth=smooth, readings=_names([readings]), coloured=_names([coloured]), gate=gate,
        noise=_noise(noise), known=plan.noise, tune=_seconds(tune, "--tune"),
        calibrate=_seconds(calibrate, "--calibrate"),
    )  # fmt: skip
    if follow:
        if file not in (None, FROM_STDIN) or smooth or how.calibrate or figures or apply:
            raise click.UsageError(
                "--follow reads standard input: no RECORDING, --smooth, --calibrate, --figures or --apply."
            )
        from ..filters.follow import follow as follow_lines

        follow_lines(model, own, others, EFFECTS, how, column_map(columns), sys.stdin, sys.stdout, uncertain)
        return
    if file is None:
        raise click.UsageError("Missing argument 'RECORDING'.")
    if apply is not None and chosen.vehicle is None:
        raise click.UsageError("--apply needs --vehicle, the file that it continues.")
    target = target_of(out)
    kept = beside(target, [file, fit_file, apply, chosen.vehicle.path if chosen.vehicle is not None else None])
    recording = read(file, columns)
    with progress() as say:
        found = track_recording(
            model, recording, own, disturbances=others, effects=EFFECTS, how=how, uncertain=uncertain, say=say
        )
    write(found.table(), target)
    told = digest(found, recording, _made(chosen, fit_file, how))
    written = [str(target), str(write_atomically(kept, as_text(told)))]
    if apply is not None and chosen.vehicle is not None:
        written.append(str(write_vehicle(tracked_vehicle(chosen.vehicle, found, own, others, EFFECTS), apply)))
    if figures is not None:
        from ..reports.drawing import write_drawings
        from ..reports.track.drawings import drawings

        written += [str(path) for path in write_drawings(drawings(told), figures)]
    if as_json:
        print_json(summary(found) | {"written": written})
        return
    _show(found, written)


def summary(found: Track) -> dict[str, Any]:
    """A track as plain data."""
    return {
        "filter": found.kind,
        "smoothed": found.smoothed,
        "rows": len(found.rows),
        "runs": len(np.unique(found.run)),
        "estimates": {
            name: {
                "unit": found.units[name],
                "mean": float(np.nanmean(values)),
                "sd_median": float(np.nanmedian(found.sds[name])),
                **({"told_in": found.told[name]} if name in found.told else {}),
            }
            for name, values in found.values.items()
        },
        "noise": dict(found.noise),
        "innovations": {name: vars(own) for name, own in found.consistency.items()},
        "widened": found.widened,
        "log_likelihood": found.log_likelihood,
        "findings": list(found.sentences),
        "filter_seconds": found.seconds,
    }


def _model(chosen: Wanted, fit_file: str | None) -> tuple[MotionModel, TrackingPlan, Array | None]:
    """The model to track with, what is tracked of it, and what is uncertain of it where a fit says so."""
    plan = chosen.vehicle.tracking if chosen.vehicle is not None else None
    if fit_file is not None:
        if chosen.name is not None or chosen.vehicle is not None:
            raise click.UsageError("--fit stands in place of --model and --vehicle; leave one of them away.")
        fit = load(fit_file, build)
        if not isinstance(fit.model, MotionModel):
            raise BadInput(f"{fit_file}: {_no_motion(fit.model)}")
        return fit.model, TrackingPlan(), _principal(fit.covariance)
    if chosen.name is None and (chosen.vehicle is None or chosen.vehicle.model is None):
        chosen = replace(chosen, name="single_track")
    model = chosen.model()
    if not isinstance(model, MotionModel):
        raise BadInput(_no_motion(model))
    return model, plan or TrackingPlan(parameters=_stiffness(model)), None


def _no_motion(model: Model) -> str:
    kind = "a map with memory" if isinstance(model, MemoryModel) else "a hybrid, whose network has a state of its own"
    return f"{model.name} is {kind}; filters track equations of motion, such as single_track or lateral."


def _stiffness(model: MotionModel) -> tuple[str, ...]:
    """The cornering stiffnesses a model has: what is tracked where nothing else is asked for."""
    known = {*(own.name for own in model.combinations), *(own.name for own in model.parameters)}
    return tuple(name for name in ("C_alpha_f", "C_alpha_r") if name in known)


def _principal(covariance: Array | None) -> Array | None:
    if covariance is None:
        return None
    values, vectors = np.linalg.eigh(np.nan_to_num(covariance))
    kept = values > 1e-12 * max(values[-1], 1e-300)
    return np.asarray((vectors[:, kept] * np.sqrt(values[kept])).T)


def _made(chosen: Wanted, fit_file: str | None, how: How) -> Made:
    """What a track is made with, for its report."""
    vehicle = chosen.vehicle.name if chosen.vehicle is not None else ""
    return Made(fit_file or vehicle, command_line(), __version__, how.tune, how.calibrate)


def beside(table: Path, read_or_written: Sequence[str | Path | None]) -> Path:
    """The file that a track leaves beside its table. Raises `BadInput` where another file has its place."""
    target = table.with_suffix(".json")
    others = {Path(file).resolve() for file in read_or_written if file is not None}
    if target.resolve() in others or (target.exists() and not is_track(target)):
        raise BadInput(
            f"{target} is another file than a track, and greybox track leaves one of that name beside {table.name}; "
            "name another table with --out."
        )
    return target


def _names(written: Sequence[str]) -> tuple[str, ...]:
    return tuple(name.strip() for text in written for name in text.split(",") if name.strip())


def _noise(written: Sequence[str]) -> dict[str, float]:
    found = {}
    for pair in written:
        name, text = named(pair, "NAME=SIZE, as in --noise walk_v_y=0.05")
        found[name] = number(text, "1", f"--noise {name}")
    return found


def _seconds(text: str, option: str) -> float:
    found = number(text, "s", option)
    if not 0 <= found < float("inf"):
        raise BadInput(f"{option} {text}: a duration is a number of seconds, zero or more.")
    return found


def _show(found: Track, written: Sequence[str]) -> None:
    out = console()
    how = f"{found.kind.upper()}{' and smoother' if found.smoothed else ''}"
    out.print(f"{how}: {counted(len(found.rows), 'row')} in {counted(len(np.unique(found.run)), 'run')}\n")
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    for title in ("estimate", "5 %", "median", "95 %", "± median sd", "unit", "told in"):
        justify: Literal["left", "right"] = "left" if title in ("estimate", "unit") else "right"
        table.add_column(title, header_style="dim", justify=justify)
    for name, values in found.values.items():
        low, middle, high = np.nanquantile(values, [0.05, 0.5, 0.95])
        told = f"{100 * found.told[name]:.0f} % of rows" if name in found.told else ""
        numbers = [f"{value:.4g}".replace("-", "−") for value in (low, middle, high)]
        table.add_row(name, *numbers, f"{np.nanmedian(found.sds[name]):.2g}", pretty_unit(found.units[name]), told)
    out.print(table)
    out.print()
    checks = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    for title in (
        "reading",
        "taken",
        "innovation rms",
        "unit",
        "NIS (1)",
        "windows within 95 %",
        "next to next",
        "gated",
    ):
        checks.add_column(title, header_style="dim", justify="left" if title in ("reading", "unit") else "right")
    for name, own in found.consistency.items():
        checks.add_row(
            name, str(own.count), f"{own.rms:.3g}", pretty_unit(unit_of(name)), f"{own.nis:.2f}",
            f"{100 * own.inside:.0f} %", f"{own.correlation:+.2f}", str(own.gated),
        )  # fmt: skip
    out.print(checks)
    out.print("\nA better likelihood is not always a better sideslip; nothing here measures the sideslip itself.")
    for sentence in found.sentences:
        out.print(f"mind     {sentence}")
    for path in written:
        out.print(f"written  {path}")
