"""Interpretation of column names: possible signal and unit."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...base.errors import BadInput
from ...base.numbers import exact, number
from ...base.shorthands import Array
from ...base.signals import SIGNALS
from ...base.units import known_unit, to_si
from ..formats import Group
from ..instants import EPOCHS, SERIAL, newest_first
from .evidence import MapEntry

TIME, RUN, HAND_WHEEL = "time", "run", "hand wheel"
"""Meanings other than signals; a hand wheel's angle is the steering angle times a ratio that is not in the file."""

_TABLES = tomllib.loads(Path(__file__).parents[1].joinpath("names.toml").read_text("utf-8"))
_PARTS = {part: f"({names})" for part, names in _TABLES["parts"].items()}
RULES: dict[str, tuple[str, ...]] = {
    signal: tuple("|".join(names).format(**_PARTS) for names in ranks) for signal, ranks in _TABLES["signals"].items()
}
"""Signal -> patterns of names in plain words, most specific first."""
AMBIGUOUS: dict[str, str] = {name: other for other, names in _TABLES["ambiguous"].items() for name in names}
"""Names with a second usual meaning: such a column is never mapped without a question, unless another column has the
other meaning by name."""
PLACES = ("lat", "long")
"""Name endings that mean an acceleration or a speed more often than a place."""
WISHES, NOISE = (re.compile(rf"\b({'|'.join(_TABLES['words'][kind])})\b") for kind in ("wishes", "noise"))
"""Words of commands and references, which mark a column as not measured; words without a meaning."""
WORDS_OF_UNITS: dict[str, str] = {words: unit for unit, ends in _TABLES["units"].items() for words in ends}
"""Unit suffixes of names."""
RATES = {"yaw": "yaw_rate", "roll": "roll_rate"}
"""Angle -> its rate, which is meant if the unit is that of a rate."""
_BRACKETS = re.compile(r"\s*[\[({<]\s*([^\])}>]*)\s*[\])}>]\s*$")
_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")


@dataclass(frozen=True)
class Guess:
    """Interpretation of a name.

    Attributes
    ----------
    signal : a signal, or TIME, RUN or HAND_WHEEL.
    unit : stated in the name; empty if none.
    rank : distance of the name from an unambiguous one; 0 is best.
    wish : whether it is a command or reference rather than a measurement.
    else_ : other usual meaning of the name; empty if none.
    """

    signal: str
    unit: str
    rank: int
    wish: bool = False
    else_: str = ""


def guess_in(group: Group, column: str) -> Guess | None:
    """Interpretation of a column of a group; the group's name may mark it as a command, such as `commands/v`."""
    result = guess(column.removeprefix(group.prefix)) or guess(column)
    return replace(result, wish=result.wish or bool(WISHES.search(plain_words(group.name)))) if result else None


def guess(column: str) -> Guess | None:
    """The best interpretation of a column's name; None if the name is unknown."""
    bare, stated = _bracketed(column)
    bare = bare.partition("\\")[0]  # a device name follows the backslash
    if stated and not NOISE.sub("", plain_words(stated)).strip():  # the source, as in "acc x (IMU)"
        bare, stated = f"{bare} {stated}", ""
    stated = known_unit(stated) or stated
    words = plain_words(bare)
    attempts = [(words, stated)]
    parts = words.split()
    attempts += [(" ".join(parts[:-n]), WORDS_OF_UNITS.get(" ".join(parts[-n:]), "")) for n in (1, 2, 3)]
    result = [item for text, unit in attempts if text and (unit or text == words) for item in _read(text, unit)]
    return min(result, key=lambda item: (item.rank, item.signal)) if result else None


def fits(unit: str, signal: str) -> bool:
    """Whether the unit is possible for the signal."""
    target = {TIME: "s", RUN: "1", HAND_WHEEL: "rad"}.get(signal) or SIGNALS[signal].unit
    try:
        to_si(unit, target)
    except BadInput:
        return False
    return True


def plain_words(name: str) -> str:
    """A name in lower case, split into words."""
    return " ".join(re.split(r"[\s_\-./:|\\]+", _CAMEL.sub(" ", name))).lower().strip()


def of_a_tyre_rig(columns: Iterable[str]) -> bool:
    """Whether columns are those of a tyre test rig: slip angle, load and side force."""
    words = {_bracketed(column)[0] for column in columns}
    words = {plain_words(word).replace(" ", "") for word in words}
    slip = words & {"sa", "slipangle", "alpha"}
    return bool(slip and words & {"fz", "normalload", "verticalload"} and words & {"fy", "lateralforce", "sideforce"})


def counts_clockwise(column: str) -> bool:
    """Whether a column is named like the angles of a compass."""
    return bool(re.search(r"\b(heading|bearing|course|cog|track angle)\b", plain_words(column)))


def is_north_of(x: str, y: str) -> bool:
    """Whether two columns are named east and north."""
    east, north = r"\b(easting|east|utm e)\b", r"\b(northing|north|utm n)\b"
    return bool(re.search(east, plain_words(x)) and re.search(north, plain_words(y)))


def _bracketed(column: str) -> tuple[str, str]:
    match = _BRACKETS.search(column)
    if not match or match.start() == 0:
        return column, ""
    return column[: match.start()], match.group(1).strip()


def _read(words: str, unit: str) -> list[Guess]:
    """All rules that match the words, or their last ones."""
    result = []
    quiet = " ".join(NOISE.sub(" ", words).split())
    parts = quiet.split()
    tails = [(words, 0), (quiet, 1), *((" ".join(parts[n:]), 1 + 2 * n) for n in range(1, len(parts)))]
    for text, cost in tails:
        if cost > 1 and (len(text) < 4 or text in PLACES):  # a last letter alone means nothing, nor does "long"
            continue
        for signal, patterns in RULES.items():
            for order, pattern in enumerate(patterns):
                if re.fullmatch(pattern, text):
                    signal = RATES[signal] if unit and signal in RATES and fits(unit, RATES[signal]) else signal
                    stated = "ms" if signal == TIME and unit == "m/s" else unit
                    rim = signal.startswith("wheel_speed") and stated and fits(stated, "v_x")
                    if not stated or signal == "v_x" or rim or fits(stated, signal):  # a motor's speed is one in rpm
                        wish = bool(WISHES.search(words))
                        result.append(Guess(signal, stated, cost + order, wish, AMBIGUOUS.get(text, "")))
    return result


SLOWEST, FASTEST = 1.0, 2e4
"""Range of sample rates of vehicle recordings in Hz."""


def time_of(
    group: Group, guesses: Mapping[str, Guess], numbers: Mapping[str, Array], texts: Set[str] = frozenset()
) -> MapEntry | None:
    """The time of a table, by its name or as the only column with even increasing steps; None if there is none.

    Parameters
    ----------
    group, guesses, numbers : the table, the interpretations of its names, and its numeric columns.
    texts : columns of dates or clock times; a numeric column takes precedence.
    """
    numbers = {name: values for name, values in numbers.items() if name in group.names}
    numbers = {name: values[::-1] if newest_first(values) else values for name, values in numbers.items()}
    named = sorted(
        (name in texts, g.rank, name)
        for name, g in guesses.items()
        if g.signal == TIME and name in group.names and (name in numbers or name in texts)
    )
    if group.clock and group.clock_unit:
        return MapEntry(TIME, group.clock, group.clock_unit, reasons=("the file's own clock",))
    split = _split(group, numbers)
    if split:
        return split
    if named:
        name = named[0][2]
        if name in texts:
            return MapEntry(
                TIME, name, "s", reasons=("a usual name of time", "it holds dates, or the times of a clock")
            )
        return _in_unit(name, guesses[name].unit or group.units.get(name, ""), numbers[name], "a usual name of time")
    unnamed = [name for name in group.names if name in texts]
    if unnamed:
        return MapEntry(TIME, unnamed[0], "s", reasons=("it holds dates, or the times of a clock",))
    even = [name for name, values in numbers.items() if _runs_on(values)]
    why = "the only column that runs on in even steps"
    return _in_unit(even[0], "", numbers[even[0]], why) if len(even) == 1 else None


SECONDS = ("s", "sec", "secs", "seconds", "stamp sec", "stamp secs", "tv sec")
FRACTIONS = {
    "ns": "ns nsec nsecs nanosec nanosecs nanoseconds nanos",
    "us": "us usec usecs microsec microsecs microseconds micros",
    "ms": "ms msec msecs millisec millisecs milliseconds millis",
}
"""Unit -> names of columns with the fraction of a second."""


def _split(group: Group, numbers: Mapping[str, Array]) -> MapEntry | None:
    """Time in two columns, whole seconds and fraction; None if there are no such columns."""
    words = {name: plain_words(name.removeprefix(group.prefix)) for name in numbers}
    tails = {
        name: {word, " ".join(word.split()[-2:]), word.split()[-1] if word else ""} for name, word in words.items()
    }
    seconds = next(
        (name for name, tail in tails.items() if tail & set(SECONDS) and _whole(numbers[name], np.inf)), None
    )
    for unit, known in FRACTIONS.items() if seconds else ():
        called = (name for name, tail in tails.items() if tail & set(known.split()))
        rest = next((name for name in called if _whole(numbers[name], 1 / to_si(unit, "s").factor)), None)
        if seconds and rest:
            why = f'its name; "{rest}" holds the {known.split()[-2]}'
            return MapEntry(TIME, seconds, "s", reasons=(why,), rest=rest, rest_unit=unit)
    return None


def _whole(values: Array, below: float) -> bool:
    finite = values[np.isfinite(values)]
    return bool(finite.size and np.all(finite % 1 == 0) and np.all(finite >= 0) and np.all(finite < below))


def _in_unit(name: str, stated: str, values: Array, why: str) -> MapEntry:
    if stated:
        return MapEntry(TIME, name, stated, reasons=(why, "unit: stated in the file"))
    steps = np.diff(values[np.isfinite(values)])
    step = float(np.median(steps[steps > 0])) if np.any(steps > 0) else float("nan")
    if steps.size and np.mean(steps == 0) > 0.5 and np.sum(steps) > 0:  # whole seconds, each for many rows
        step = float(np.mean(steps))
    first = float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0
    for unit, size in EPOCHS:
        if first > size:
            return MapEntry(TIME, name, unit, reasons=(why, f"unit: {number(first)} counts {unit} since 1970"))
    if SERIAL[0] < first < SERIAL[1] and step < 1e-3:
        return MapEntry(TIME, name, "d", reasons=(why, "unit: days since 1899, as spreadsheets count them"))
    units = [
        u for u, second in (("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)) if SLOWEST <= second / step <= FASTEST
    ]
    integers = bool(np.all(values[np.isfinite(values)] % 1 == 0))
    if not integers and "s" in units:
        units = ["s"]  # fractions of a millisecond are rarely recorded
    if step == 1 and integers:
        reason = "it counts rows; write the unit of one step, and divide_by if one step is not exactly one such unit"
        return MapEntry(TIME, name, "", decided=False, units=("s", "ms"), reasons=(why, reason))
    if units:
        likely = units[0] if len(units) == 1 or not integers else units[-1] if step >= 1e4 else units[0]
        return MapEntry(
            TIME,
            name,
            likely,
            reasons=(why, f"unit: {likely} is plausible, since the usual time step is {exact(step)}"),
        )
    return MapEntry(
        TIME, name, "", decided=False, units=("s", "ms"), reasons=(why, f"a step of {exact(step)} is no sample time")
    )


def _runs_on(values: Array) -> bool:
    """Whether a column increases in nearly even steps, except for a few restarts."""
    if len(values) < 10 or not np.isfinite(values).all():
        return False
    steps = np.diff(values)
    usual = float(np.median(steps))
    return usual > 0 and float(np.mean(np.abs(steps - usual) < 0.2 * usual)) > 0.95
