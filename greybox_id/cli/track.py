"""`greybox track`: sideslip, tyres and forces along a recording, estimated by an EKF or UKF."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import click

from .. import Fit, TrackOptions
from ..api.track_result import track_target
from ..api.tracking import follow, track_setup
from ..api.tracking import track as track_recording
from ..base.errors import BadInput
from ..base.units import number, pairs
from .defaults import command_line
from .options import (
    ABOVE_ZERO,
    COLUMNS,
    FILE,
    JSON_AND_OWN,
    MODEL,
    argument,
    command,
    fit_of,
    option,
    read_part,
    requested,
)
from .output import console, end_by, print_json, progress, show
from .terminal import tell

if TYPE_CHECKING:
    from ..fitting.requested_model import RequestedModel

FROM_STDIN = "-"


@command("track", more=MODEL)
def track(
    file: str | None = argument("RECORDING", type=FILE, required=False),
    fit_file: str | None = option(
        "Fit whose model is used, in place of --model and --vehicle.", "FIT", name="--fit", type=FILE
    ),
    columns: str = COLUMNS,
    parameters: Sequence[str] = option(
        "Parameters or forces that are tracked as random walks: C_alpha_f,C_alpha_r or F_yf,F_yr.", "NAMES"
    ),
    disturbances: Sequence[str] = option(
        "Parameters or effects that are tracked and return to their values in the model: road_bank,S_h_f.", "NAMES"
    ),
    readings: str = option("Measured signals that the filter uses.", "NAMES", default="v_x,yaw_rate,a_y"),
    coloured: str = option(
        "Measured signals whose error varies slowly (coloured noise), such as a_y.", "NAMES", default=""
    ),
    kind: Literal["ekf", "ukf"] = option("Extended or unscented Kalman filter.", name="--filter", default="ekf"),
    smooth: bool = option("Smooth the estimates: use later readings, too."),
    noise: Sequence[str] = option(
        "Standard deviation of a noise of the filter, such as noise_a_y=0.1; it is then not tuned.", "NAME=SIZE"
    ),
    tune: str = option(
        "The noise of the filter is tuned on the first SECONDS of the recording, except what --noise states; 0: no "
        "tuning.",
        "SECONDS",
        default="60s",
    ),
    calibrate: str = option(
        "Free parameters of the model are tuned together with the noise on the first SECONDS of the recording; 0: they "
        "are not tuned.",
        "SECONDS",
        default="0s",
    ),
    gate: float = option(
        "Readings further than SDS standard deviations from their prediction get a lower weight.",
        "SDS",
        type=ABOVE_ZERO,
        default=5.0,
    ),
    out: str = option(
        "Table of the estimates: .csv, .parquet, .mf4 or .mcap. A .json file for greybox report is written beside it.",
        "FILE",
        default="estimates.parquet",
    ),
    figures: str | None = option("Write the figures to this folder, as SVG.", "FOLDER"),
    apply: str | None = option("Write a vehicle file (.toml or .json) with the tuned values.", "FILE"),
    live: bool = option("Read CSV lines from standard input and write estimates line by line.", name="--follow"),
    as_json: bool = JSON_AND_OWN,
    **options: Any,
) -> None:
    """Estimate sideslip, cornering stiffness and tyre forces along RECORDING.

    \b
    greybox track --vehicle car.toml lap.csv --parameters C_alpha_f,C_alpha_r --smooth --out estimates.parquet
    greybox track --vehicle car.toml lap.csv --parameters F_yf,F_yr --filter ukf
    greybox track --vehicle car.toml lap.csv --calibrate 200s --apply car_calibrated.toml
    cat live.csv | greybox track --vehicle car.toml --columns canonical --follow

    Tracked forces, such as F_yf, replace the tyre model. An input that was not recorded, such as the driving force, is
    estimated from the readings. The uncertainty of parameters with a stated standard deviation widens the bands.

    Exit code 3: the estimates are written, but the filter no longer follows the vehicle; the verdict says where.
    """  # fmt: skip
    chosen = requested(**options)
    tracked = _tracked(chosen, fit_file)
    walking, others = _names(parameters), _names(disturbances)
    how = TrackOptions(
        filter=kind, smooth=smooth, readings=_names([readings]), coloured=_names([coloured]), gate=gate,
        noise=_noise(noise), known=track_setup(tracked).plan.noise, tune=_seconds(tune, "--tune"),
        calibrate=_seconds(calibrate, "--calibrate"),
    )  # fmt: skip
    if live:
        if file not in (None, FROM_STDIN) or smooth or how.calibrate or figures or apply:
            raise click.UsageError(
                "--follow reads standard input: omit RECORDING, --smooth, --calibrate, --figures or --apply."
            )
        judged = follow(tracked, sys.stdin, sys.stdout, walking, others, columns, how)
        tell(f"{judged.usability}: {' '.join(judged.reasons)}")
        end_by(judged)
        return
    if file is None:
        raise click.UsageError("Missing argument 'RECORDING'.")
    if apply is not None and chosen.vehicle is None:
        raise click.UsageError("--apply needs --vehicle, the file whose numbers it updates.")
    target, _ = track_target(out)
    recording = read_part(file, columns)
    with progress() as say:
        result = track_recording(tracked, recording, walking, disturbances=others, options=how, progress=say)
    vehicle = chosen.vehicle.name if chosen.vehicle is not None else ""
    result = replace(result, made=replace(result.made, vehicle=fit_file or vehicle, command=command_line()))
    written = [str(path) for path in result.save(target, figures=figures, vehicle=chosen.vehicle, to=apply)]
    if as_json:
        print_json(result.as_dict() | {"written": written})
    else:
        show(result.parts())
        for path in written:
            console().print(f"written  {path}")
    end_by(result.verdict)


def _tracked(chosen: RequestedModel, fit_file: str | None) -> Fit | RequestedModel:
    """A fit, or the model that the options request."""
    if fit_file is not None:
        if chosen.name is not None or chosen.vehicle is not None:
            raise click.UsageError("--fit replaces --model and --vehicle; omit one or the other.")
        return fit_of(fit_file)
    if chosen.name is None and (chosen.vehicle is None or chosen.vehicle.model is None):
        chosen = replace(chosen, name="single_track")
    return chosen


def _names(written: Sequence[str]) -> tuple[str, ...]:
    return tuple(name.strip() for text in written for name in text.split(",") if name.strip())


def _noise(written: Sequence[str]) -> dict[str, float]:
    sizes = pairs(written, "NAME=SIZE, as in --noise walk_v_y=0.05")
    return {name: number(text or "", "1", f"--noise {name}") for name, text in sizes.items()}


def _seconds(text: str, option: str) -> float:
    result = number(text, "s", option)
    if not 0 <= result < float("inf"):
        raise BadInput(f"{option} {text}: a duration is a number of seconds, zero or more.")
    return result
