"""Magnitudes whose sign is in a separate column: 0 and 1, + and −, left and right, north and south."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...base.shorthands import Array
from ...base.signals import SIGNALS
from ...base.units import DEGREES_AND_MINUTES
from ..column_map import NOTHING
from ..formats import Contents
from ..raw_table import RawTable
from .evidence import MapEntry
from .names import NOISE, plain_words

WORDS = {"vz", "vorzeichen", "sign", "sgn", "signum", "dir", "direction", "richtung", "side", "seite", "sense", "neg",
         "hemisphere", "hemi", "ns", "ew"}  # fmt: skip
"""Words in the name of a sign column, in addition to those of the magnitude."""
OPPOSITE = {"+": "-", "n": "S", "e": "W", "o": "W", "l": "R", "left": "right", "links": "rechts"}
"""Texts for positive values, and the corresponding negative one: to the right, south, west."""
NEGATIVE = ("-", "−", "neg", "negative", "negativ", "south", "west", *(word.lower() for word in OPPOSITE.values()))
NO_SIDE = ("x", "y", "yaw")
"""Signals that may well have one sign throughout."""
PLACES = {"latitude": "ns", "longitude": "eow"}
"""First letters of texts in a hemisphere column."""
NUMBERS = {(-1.0, 1.0): -1.0, (-1.0, 0.0): -1.0, (-1.0,): -1.0, (0.0, 1.0): 1.0, (0.0,): 1.0}
"""Numbers in a sign column -> the negative one."""
MOST_DEGREES = 180.0
VANISHES, FLIPS = 0.3, 3
"""Size of a magnitude, over its median, below which its sign may flip; and the fewest flips to judge that."""
BOTH_WAYS, LIKE = 0.05, 0.5
"""Smallest share of rows on each side, and correlation of magnitudes, for another channel to show a missing sign."""


def with_sign_columns(
    entries: Sequence[MapEntry], result: Contents, numbers: Mapping[str, Array], labels: set[str]
) -> list[MapEntry]:
    """The entries, with magnitudes given their sign column if there is one, or else made a question.

    Parameters
    ----------
    entries : one per signal.
    result : the file.
    numbers, labels : its numeric columns, and the others.
    """
    magnitudes = [entry for entry in entries if _is_magnitude(entry, numbers)]
    taken = {entry.column for entry in entries}
    found = dict[str, MapEntry]()
    for group in result.groups:
        here = [entry for entry in magnitudes if entry.column in group.names]
        free = [name for name in group.names if name not in taken and (name in labels or name in numbers)]
        table = group.load(free) if here and free else None
        two = {name: cells for name in free if (cells := _two(table, name))} if table else {}
        found |= {entry.signal: _with_sign(entry, numbers[entry.column], two) for entry in here}
    signed = [_in_minutes(found.get(entry.signal, entry), numbers) for entry in entries]
    return [_in_doubt(entry, signed, numbers) if entry in magnitudes else entry for entry in signed]


def _is_magnitude(entry: MapEntry, numbers: Mapping[str, Array]) -> bool:
    values = numbers.get(entry.column, np.empty(0))
    values = values[np.isfinite(values)]
    signal = SIGNALS[entry.signal]
    signed = (signal.mirrors and entry.signal not in NO_SIDE) or entry.signal in PLACES
    return bool(signed and values.size and values.min() >= 0.0 and values.max() > 0.0)


def _two(table: RawTable, name: str) -> list[str]:
    """The cells of a column with at most two values; empty for more."""
    column = table.column(name)
    return table.labels(name) if len(column) and column.nunique() <= 2 else []


def _with_sign(entry: MapEntry, values: Array, two: Mapping[str, list[str]]) -> MapEntry:
    """A magnitude with the most likely sign column of those with two values, if any is likely."""
    known, ranked = _words(entry.column), []
    for name, cells in two.items():
        words = _words(name)
        shared, sign_word = len(words & known), bool(words & WORDS)
        negative, flips = _negative(cells), [k for k in range(1, len(cells)) if cells[k] != cells[k - 1]]
        if entry.signal in PLACES:
            likely = {cell.strip().lower()[:1] for cell in cells} <= {*PLACES[entry.signal]}
        elif len(flips) < FLIPS:
            likely = bool(shared and sign_word)
        else:
            least = np.minimum(values[flips], values[np.array(flips) - 1])
            vanishes = np.nanmedian(least) < VANISHES * np.nanmedian(values)
            likely = bool(vanishes and (shared or words <= WORDS))
        if likely and negative is not None:
            ranked.append((shared, sign_word, len(flips), name, negative))
    if not ranked:
        return entry
    *_, name, negative = max(ranked, key=lambda item: item[:3])
    why = f"its sign is in {name}, which is {negative if isinstance(negative, str) else f'{negative:g}'} where negative"
    return replace(entry, sign_column=name, negative=negative, reasons=(*entry.reasons, why))


def _in_minutes(entry: MapEntry, numbers: Mapping[str, Array]) -> MapEntry:
    """A latitude or longitude whose numbers cannot be degrees, as degrees and minutes in one number."""
    values = np.abs(numbers[entry.column])
    values = values[np.isfinite(values)]
    if entry.signal not in PLACES or entry.unit or not values.size or values.max() <= MOST_DEGREES:
        return entry
    if np.max(values % 100) >= 60 or values.max() >= 100 * (MOST_DEGREES + 1):
        why = "values are not in degrees: write divide_by, the number of units in one degree"
        return replace(entry, decided=False, reasons=(*entry.reasons, why))
    why = "unit: degrees and minutes, as NMEA writes 52 degrees and 24.5 minutes as 5224.5"
    asked = () if entry.sign_column else ("minutes alone are possible, too: divide_by = 60, unit deg",)
    reasons = (*entry.reasons, why, *asked)
    return replace(entry, unit=DEGREES_AND_MINUTES, decided=bool(entry.sign_column), reasons=reasons)


def _words(name: str) -> set[str]:
    return set(NOISE.sub("", plain_words(name.split("[")[0])).split())


def _negative(cells: Sequence[str]) -> float | str | None:
    """The negative one of a column's values; None if unknown."""
    texts = {cell.strip() for cell in cells} - {*NOTHING}
    try:
        return NUMBERS.get(tuple(sorted(map(float, texts))))
    except ValueError:
        named = [text for text in texts if text.lower() in NEGATIVE]
        others = [text for text in texts if text.lower() in OPPOSITE]
        return named[0] if len(named) == 1 else OPPOSITE.get(others[0].lower()) if len(others) == 1 else None


def _in_doubt(entry: MapEntry, entries: Sequence[MapEntry], numbers: Mapping[str, Array]) -> MapEntry:
    """A magnitude as a question, if another channel of similar magnitude has both signs."""
    sizes = numbers[entry.column]
    for other in entries if not entry.sign_column and entry.signal not in PLACES else ():
        values = numbers.get(other.column, sizes)
        rows = np.isfinite(sizes) & np.isfinite(values) if len(values) == len(sizes) else np.zeros(0, dtype=bool)
        if not SIGNALS[other.signal].mirrors or other.signal in NO_SIDE or not np.any(values[rows]):
            continue
        both_ways = min(np.mean(values[rows] > 0), np.mean(values[rows] < 0)) > BOTH_WAYS
        if both_ways and np.corrcoef(np.abs(values[rows]), sizes[rows])[0, 1] > LIKE:
            why = f"it is never negative, though {other.signal} is: if its sign is in another column, name that"
            return replace(entry, decided=False, reasons=(*entry.reasons, f"{why} (sign_column, negative)"))
    return entry
