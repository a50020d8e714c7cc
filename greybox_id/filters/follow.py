"""Live use: lines of a CSV come in, lines of estimates go out."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TextIO

import numpy as np

from ..datasets.column_map import ColumnMap
from ..effect import Effect
from ..errors import BadInput
from ..motion_model import MotionModel
from ..parameter import Array
from ..recording import Recording
from .how import How
from .live import LiveFilter, as_row
from .noise import start_levels
from .verb import Tracker


def follow(
    model: MotionModel, parameters: Sequence[str], disturbances: Sequence[str], effects: Mapping[str, Effect], how: How,
    columns: ColumnMap, lines: TextIO, out: TextIO, uncertain: Array | None = None,
) -> None:  # fmt: skip
    """Follow a vehicle.

    Parameters
    ----------
    model, parameters, disturbances, effects, how, uncertain : as for `track`; noise is as stated, nothing is tuned.
    columns : of the lines; their first one names the columns.
    lines : comma-separated text, line by line.
    out : takes a header line, then for every line time, each estimate and its standard deviation, and the names of
        inputs that were held back as glitches; flushed line by line.

    Raises
    ------
    BadInput : a column is missing, a line cannot be read, or the noise of a reading is not stated.
    """
    rows = csv.reader(lines, delimiter=columns.separator)
    header = next(rows, None)
    if header is None:
        raise BadInput("Standard input is empty: send a line with the names of the columns first.")
    place = {name.strip(): k for k, name in enumerate(header)}
    if columns.time.column not in place:
        raise BadInput(f'Standard input has no column "{columns.time.column}" for time; it has {", ".join(place)}.')
    channels = [own for own in columns.signals.values() if own.column in place]
    one = np.zeros(1)
    example = Recording("standard input", one, {own.signal: one for own in channels}, hold=columns.hold)
    tracker = Tracker(model, example, parameters, disturbances, effects, replace(how, tune=0.0), uncertain)
    live = _live(tracker, columns.hold)
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["time", *(f"{name}{end}" for name in live.names for end in ("", "_sd")), "held_back"])
    aliases = tracker.space.model.aliases
    for number, row in enumerate(rows, 2):
        if not row:
            continue
        time = float(columns.time.convert(np.array([_number(row, place[columns.time.column], number)]))[0])
        if not np.isfinite(time):
            raise BadInput(f"Line {number} of standard input has no time; every row needs one.")
        signals = {
            own.signal: float(own.convert(np.array([_number(row, place[own.column], number)]))[0]) for own in channels
        }
        given = {
            name: signals[s] for name in tracker.space.model.inputs for s in aliases.get(name, (name,)) if s in signals
        }
        defaults = tracker.space.model.defaults
        inputs = as_row({**defaults, **given}, tracker.space.model.inputs)
        readings = as_row({name: signals[name] for name in tracker.readings}, tracker.space.model.outputs)
        values, sds, held = live.push(time, inputs, readings)
        told = [f"{number:.9g}" for pair in zip(values, sds, strict=True) for number in pair]
        writer.writerow([f"{time:.9g}", *told, " ".join(held)])
        out.flush()


def _live(tracker: Tracker, hold: str) -> LiveFilter:
    stated = tracker.stated_noise
    lacking = [f"noise_{name}" for name in tracker.readings if f"noise_{name}" not in stated]
    if lacking:
        raise BadInput(
            f"How noisy readings are must be stated to follow a vehicle: {', '.join(lacking)} (‹noise› NAME=SIZE, or "
            "track a recording once, ‹apply› FILE, and take that FILE as ‹vehicle›)."
        )
    levels = start_levels(tracker.space, {}, tracker.readings, stated)
    p = np.concatenate([tracker.space.model.values, levels.values])
    return LiveFilter(tracker.filtering, tracker.reported, p, tracker.stated_moves(len(p)), hold)


def _number(row: Sequence[str], place: int, line: int) -> float:
    text = row[place].strip() if place < len(row) else ""
    if not text:
        return np.nan
    try:
        found = float(text)
    except ValueError as error:
        raise BadInput(f"Line {line} of standard input: {text!r} is no number.") from error
    if np.isinf(found):
        raise BadInput(f"Line {line} of standard input: {text!r} is not finite; leave empty what is missing.")
    return found
