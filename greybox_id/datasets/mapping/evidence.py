"""Evidence on units and signs from the data: pairs of channels agree only in the right units."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...base.numbers import number
from ...base.signals import SIGNALS
from ...base.units import to_si
from ..checks.consistency import GIVEN_WHEELBASE, LIMITS
from ..checks.pairs import Agreement, Pair, agreement, pairs, rate
from ..column_map import Column
from ..recording import Recording


@dataclass(frozen=True)
class MapEntry:
    """Proposed use of a column.

    Attributes
    ----------
    signal : the signal it may hold.
    column : its full name in the file.
    unit : the file's unit; empty if unknown.
    sign : -1 if the column has the opposite sign.
    divide_by : file units in one `unit`, for counts.
    decided : whether the entry may be used as it is; otherwise the user is asked.
    reasons : evidence for it, or why it is left open.
    units : possible units, if undecided.
    otherwise : alternative names of the column in other files.
    other_units : units under the alternative names, if not `unit`.
    rest : of time: the column with the fraction of the second; empty for none.
    rest_unit : of that column.
    sign_column, negative : of a magnitude, as in `Column`.
    missing : numbers in the file that mean "no reading".
    ends : of counts about a centre: least, centre and largest value in the file, whose angles the user states.
    """

    signal: str
    column: str
    unit: str
    sign: int = 1
    divide_by: float = 1.0
    decided: bool = True
    reasons: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    otherwise: tuple[str, ...] = ()
    other_units: tuple[str, ...] = ()
    rest: str = ""
    rest_unit: str = "ns"
    sign_column: str = ""
    negative: float | str = 1.0
    missing: tuple[float, ...] = ()
    ends: tuple[float, ...] = ()

    def as_column(self) -> Column:
        """The entry as a column of a map; an unknown unit is taken as SI."""
        target = SIGNALS[self.signal].unit if self.signal in SIGNALS else "s"
        column = Column(self.signal, self.column, self.unit or target, target, 1 / self.divide_by, self.sign)
        return replace(
            column, otherwise=self.otherwise, other_units=self.other_units, rest=self.rest, rest_unit=self.rest_unit,
            sign_column=self.sign_column, negative=self.negative, missing=self.missing,
        )  # fmt: skip

    @property
    def factor(self) -> float:
        """SI value of one file unit, without the sign."""
        column = self.as_column()
        return to_si(column.unit, column.si_unit).factor * column.scale


USUAL = {"m/s": ("m/s", "km/h"), "rad/s": ("rad/s", "deg/s"), "rad": ("rad", "deg"), "m/s^2": ("m/s^2", "g")}
"""SI unit of a signal -> units used in files; other signals occur in their SI unit only."""
RATIOS = (7.0, 30.0)
"""Range of steering ratios, from racing cars to trucks."""
HAND = 0.5
"""Cost of taking a steering column as the hand wheel's if its name does not say so: less than `MARGIN`, so that no
other unit is decided by the implausible length of a vehicle steered directly by that wheel."""
MOST_TURNS = 4 * np.pi
"""Angle in rad beyond which no hand wheel is turned."""
ODD = {"mph": 0.44704, "knot": 0.514444}
"""Unusual units of speed in m/s: if the motion suggests one, the user is asked."""
NEAR_ODD, FAR_OFF = 0.12, 0.35
"""Absolute log ratio of the relations: largest in such a unit, and smallest in the usual unit, to suggest it."""
FULL, PERCENT = 1.5, 100.5
"""Largest value of a pedal as a share, and in percent."""
PEDALS = ("throttle", "brake")
MARGIN = 0.7
"""Difference of misfits (logarithms of a factor) by which a unit must beat the next best: a factor of two."""
TOO_FAR = 4.0
LOST = 1.0
"""Cost of a pair that agrees in other units only: an angle in wrong units jumps where it wraps."""
RARE = {
    "a_x": 25.0,
    "a_y": 25.0,
    "yaw_rate": 6.0,
    "steer": 0.9,
    "roll": 1.0,
    "pitch": 1.0,
    "sideslip": 1.6,
    "yaw": 30.0,
}
"""Magnitudes (99th percentile, SI) beyond which a unit is improbable, though not impossible."""
MOST_ROWS = 20_000
WHEELBASES = {False: (0.12, 12.0), True: (1.0, 12.0)}
"""Range of v_x · steer / yaw_rate in m: of any vehicle (False), and of a fast one (True)."""
FAST = 20.0
"""Speed in m/s that no small model car reaches."""
AXES = {"v_x": "x", "v_y": "y", "a_x": "x", "a_y": "y", "roll": "roll", "pitch": "pitch", "yaw": "yaw",
        "roll_rate": "x", "yaw_rate": "z"}  # fmt: skip
"""Part of a column's name that distinguishes the axes of one sensor."""


@dataclass(frozen=True)
class Met:
    """A pair of channels and its agreement."""

    pair: Pair
    agreed: Agreement

    @property
    def words(self) -> str:
        """The agreement as a sentence."""
        if self.pair.kinematic:
            return f"{self.pair.left} is {number(abs(self.agreed.gain), 2)} times {self.pair.right}"
        return f"{self.pair.right} over {self.pair.left} gives a wheelbase of {number(1 / abs(self.agreed.gain), 2)} m"


def pairs_of(recording: Recording) -> list[Pair]:
    """All pairs of a recording whose time advances; without a yaw rate, the heading's rate replaces it."""
    return [*pairs(recording), *_of_heading(recording)] if recording.sample_time > 0 else []


def _of_heading(r: Recording) -> list[Pair]:
    """Pairs of the heading's rate with lateral acceleration and steering, if no yaw rate is recorded."""
    if "yaw_rate" in r or not r.has("yaw", "v_x"):
        return []
    turn, result = rate(r, r["yaw"], True), []
    if "a_y" in r:
        sides, nodes = ("a_y", "v_x · d(yaw)/dt"), ("a_y", "yaw")
        result.append(Pair(*sides, nodes, (*nodes, "v_x"), r["a_y"], r["v_x"] * turn, lag_smoothing=None))
    if "steer" in r:
        sides, nodes = ("d(yaw)/dt", "v_x · steer"), ("yaw", "steer")
        right = r["v_x"] * r["steer"]
        result.append(Pair(*sides, nodes, (*nodes, "v_x"), turn, right, kinematic=False, lag_smoothing=None))
    return result


def met(recording: Recording) -> list[Met]:
    """All pairs whose correlation, positive or negative, is significant."""
    result = [Met(p, agreement(recording, p.left_values, p.right_values, p.smoothing)) for p in pairs_of(recording)]
    return [item for item in result if item.agreed.beyond_chance]


def sizes_of(recording: Recording) -> dict[str, float]:
    """99th percentile of every signal's magnitude; 0 without finite values."""
    finite = {name: values[np.isfinite(values)] for name, values in recording.signals.items()}
    return {name: float(np.quantile(np.abs(v), 0.99)) if v.size else 0.0 for name, v in finite.items()}


def with_units(
    entries: Sequence[MapEntry], raw: Recording, wheelbase: float | None, hand_wheel: bool = False
) -> list[MapEntry]:
    """The entries with their units decided or left open.

    Parameters
    ----------
    entries : one per signal; stated units are only checked.
    raw : the signals in the file's units, with factor 1.
    wheelbase : in m, if known.
    hand_wheel : whether the name of the steering column means the hand wheel's angle.
    """
    short = raw.rows(0, MOST_ROWS)
    sizes = sizes_of(short)
    options = [_options(entry, short, sizes) for entry in entries]
    counts = {option[0].signal for option in options if not option[0].decided}
    short = replace(short, signals={name: values for name, values in short.signals.items() if name not in counts})
    paired = {name for item in pairs_of(short) for name in item.channels}
    open_ones = [k for k, option in enumerate(options) if len(option) > 1 and entries[k].signal in paired]
    costs = _costs(options, open_ones, short, sizes, wheelbase, hand_wheel)
    best = min(costs, key=lambda choice: costs[choice])
    picked = [option[0] for option in options]
    for k, n in zip(open_ones, best, strict=True):
        picked[k] = options[k][n]
    agreed = met(_scaled(short, picked))
    decided = []
    for k, entry in enumerate(picked):
        if not entry.decided:
            decided.append(entry)
        elif entry.signal in PEDALS and not entries[k].unit:
            decided.append(_pedal(entries[k], sizes[entry.signal]))
        elif entry.divide_by != 1.0:
            decided.append(replace(entry, decided=False))
        elif len(options[k]) == 1:
            decided.append(_stated(entries[k], entry, agreed, wheelbase))
        elif k in open_ones:
            place = open_ones.index(k)
            margin = min(costs[c] for c in costs if c[place] != best[place]) - costs[best]
            decided.append(_by_margin(_odd(entry, agreed), margin, agreed, options[k], sizes))
        else:
            odds = [_improbable(option, sizes) for option in options[k]]
            margin = max(odds) - min(odds)
            decided.append(_by_margin(options[k][int(np.argmin(odds))], margin, agreed, options[k], sizes))
    return like_siblings(decided)


def like_siblings(entries: Sequence[MapEntry]) -> list[MapEntry]:
    """Open units of columns whose names differ only in the axis (vx and vy), taken from a decided one of them."""
    families = {_family(e): e for e in entries if e.decided and e.unit and _family(e)}
    result = []
    for entry in entries:
        known = families.get(_family(entry))
        if entry.units and known:
            why = f"unit: that of {known.column}, whose name differs only in the axis"
            entry = replace(entry, unit=known.unit, decided=True, units=(), reasons=(*entry.reasons[:-1], why))
        result.append(entry)
    return result


def _family(entry: MapEntry) -> tuple[str, str] | None:
    axis = AXES.get(entry.signal)
    before, result, after = entry.column.lower().rpartition(axis or " ")
    return (SIGNALS[entry.signal].unit, f"{before}*{after}") if axis and result else None


def _options(entry: MapEntry, raw: Recording, sizes: Mapping[str, float]) -> list[MapEntry]:
    """An entry in every possible unit."""
    counted = _counted(entry, raw, sizes)
    if counted:
        return counted
    unit = SIGNALS[entry.signal].unit
    if entry.unit:
        return [entry if entry.signal == "steer" else _beyond_belief(entry, sizes)]
    usual = [replace(entry, unit=item) for item in USUAL.get(unit, (unit,))]
    if entry.signal != "steer" and all(_impossible(option, sizes) for option in usual):
        why = (
            f"values up to {number(sizes[entry.signal])} fit no usual unit of {entry.signal}. If they are counts, set "
            "divide_by: how"
        )
        return [replace(entry, unit=unit, decided=False, reasons=(*entry.reasons, f"{why} many make one {unit}"))]
    return usual


def _beyond_belief(entry: MapEntry, sizes: Mapping[str, float]) -> MapEntry:
    """An entry whose stated unit is impossible, as a question with a possible usual unit."""
    others = [replace(entry, unit=item) for item in USUAL.get(SIGNALS[entry.signal].unit, ()) if item != entry.unit]
    possible = [option for option in others if not _impossible(option, sizes)]
    if not possible or not _impossible(entry, sizes):
        return entry
    why = f"the file says {entry.unit}, but no vehicle reaches {number(sizes[entry.signal])} {entry.unit}"
    return replace(possible[0], decided=False, reasons=(*entry.reasons, why))


def _by_margin(
    entry: MapEntry, margin: float, agreed: Sequence[Met], options: Sequence[MapEntry], sizes: Mapping[str, float]
) -> MapEntry:
    alike = [item.words for item in agreed if entry.signal in item.pair.channels]
    if not entry.decided:
        return entry
    if margin >= MARGIN:
        size = sizes[entry.signal]
        why = "; ".join(alike[:2]) or f"values up to {number(size)} are too large for the other units"
        return replace(entry, reasons=(*entry.reasons, f"unit: {entry.unit} is plausible, since {why}"))
    names = tuple(option.unit for option in options)
    below = number(sizes[entry.signal])
    why = f"unit: nothing in the file distinguishes {' from '.join(names)} (99 % of values are below {below})"
    return replace(entry, decided=False, units=names, reasons=(*entry.reasons, why))


def _pedal(entry: MapEntry, size: float) -> MapEntry:
    """A pedal without a unit: a share, percent, or counts that only the user can interpret."""
    if size <= FULL:
        return replace(entry, unit="1", reasons=(*entry.reasons, "unit: assumed, since nothing in the file checks it"))
    upto = f"values up to {number(size, 3)}"
    if size <= PERCENT and entry.signal == "throttle":
        return replace(entry, unit="%", reasons=(*entry.reasons, f"unit: {upto} are percent"))
    if size <= PERCENT:
        why = (
            f"unit: {upto} are percent or a pressure; for a pressure, set unit = 1 and divide_by to the reading at "
            "full "
            f"braking"
        )
        return replace(entry, unit="%", decided=False, reasons=(*entry.reasons, why))
    why = f"{upto} are counts: set divide_by to the reading with the pedal fully down"
    full = float(f"{size:.3g}")
    return replace(entry, unit="1", divide_by=full, decided=False, reasons=(*entry.reasons, why))


def _odd(entry: MapEntry, agreed: Sequence[Met]) -> MapEntry:
    """A speed as a question, if all relations with it suggest miles per hour or knots."""
    if entry.signal != "v_x":
        return entry
    paired = [item for item in agreed if item.pair.kinematic and "v_x" in item.pair.channels and item.agreed.gain]
    times = [np.log(abs(item.agreed.gain)) * (1 if item.pair.nodes[0] == "v_x" else -1) for item in paired]
    if not times or min(map(abs, times)) < FAR_OFF:
        return entry
    for unit, size in ODD.items():
        if max(abs(factor - np.log(entry.factor / size)) for factor in times) < NEAR_ODD:
            why = f"unit: {'; '.join(item.words for item in paired[:2])}, as expected in {unit}"
            return replace(entry, unit=unit, decided=False, reasons=(*entry.reasons, why))
    return entry


def _stated(before: MapEntry, entry: MapEntry, agreed: Sequence[Met], wheelbase: float | None) -> MapEntry:
    """A stated or the only possible unit, with contradicting evidence; `steering` handles hand-wheel angles."""
    met = [item for item in agreed if entry.signal == item.pair.nodes[0]]
    off = [item.words for item in met if min(misfit(item, wheelbase, hand=hand) for hand in (np.inf, 0.0)) > MARGIN]
    how = "unit: stated in the file" if before.unit else "unit: assumed, since nothing in the file checks it"
    return replace(entry, reasons=(*entry.reasons, how, *(f"but {words}: check" for words in off)))


def _counted(entry: MapEntry, raw: Recording, sizes: Mapping[str, float]) -> list[MapEntry]:
    """A speed impossible in any usual unit: counts, with their number per m/s from other channels; else empty."""
    if entry.signal != "v_x" or sizes["v_x"] <= 3.6 * LIMITS["v_x"][0]:
        return []
    why = (
        f"values up to {number(sizes['v_x'])} are not a speed in m/s or km/h; they may be counts, such as a motor's rpm"
    )
    counts = []
    for item in met(raw):
        if item.pair.nodes[0] == "v_x":
            counts.append(abs(item.agreed.gain))
        elif item.pair.nodes == ("a_x", "v_x"):
            counts += [1 / abs(item.agreed.gain) / to_si(unit, "m/s^2").factor for unit in USUAL["m/s^2"]]
    known = f"{why}; the other channels suggest about {{:g}} per m/s (± 20 %): write the true number"
    rounded = [float(f"{count:.3g}") for count in counts]
    return [replace(entry, unit="m/s", divide_by=n, reasons=(*entry.reasons, known.format(n))) for n in rounded] or [
        replace(
            entry,
            unit="m/s",
            divide_by=sizes["v_x"] / 10,
            reasons=(*entry.reasons, f"{why}; state how many make 1 m/s"),
        )
    ]


def _costs(
    options: Sequence[Sequence[MapEntry]],
    open_ones: Sequence[int],
    raw: Recording,
    sizes: Mapping[str, float],
    wheelbase: float | None,
    hand_wheel: bool,
) -> dict[tuple[int, ...], float]:
    """Cost of each choice of units; pairs that agree in other units only add `LOST`."""
    known: dict[tuple[object, ...], Met] = {}
    misfits: dict[tuple[int, ...], dict[str, float]] = {}
    costs: dict[tuple[int, ...], float] = {}
    for choice in itertools.product(*(range(len(options[k])) for k in open_ones)):
        chosen = [option[0] for option in options]
        for k, n in zip(open_ones, choice, strict=True):
            chosen[k] = options[k][n]
        factors = {entry.signal: entry.factor for entry in chosen}
        misfits[choice] = {}
        for pair in pairs_of(_scaled(raw, chosen)):
            key = (pair.left, pair.right, *(factors.get(name) for name in pair.channels))
            if key not in known:
                known[key] = Met(pair, agreement(raw, pair.left_values, pair.right_values, pair.smoothing))
            if known[key].agreed.beyond_chance:
                speed = sizes.get("v_x", 0.0) * factors.get("v_x", 1.0)
                misfits[choice][pair.left + pair.right] = misfit(
                    known[key], wheelbase, speed, 0.0 if hand_wheel else HAND
                )
        costs[choice] = sum(_improbable(entry, sizes, 0.0 if hand_wheel else HAND) for entry in chosen)
    agreeing = {name for misfit in misfits.values() for name in misfit}
    return {
        choice: costs[choice] + sum(misfit.get(name, LOST) for name in agreeing) for choice, misfit in misfits.items()
    }


def _scaled(raw: Recording, entries: Sequence[MapEntry]) -> Recording:
    return raw.with_signals(
        **{entry.signal: raw[entry.signal] * entry.factor for entry in entries if entry.signal in raw}
    )


def misfit(met: Met, wheelbase: float | None = None, speed: float = 0.0, hand: float = np.inf) -> float:
    """Deviation of a pair's gain from the expected value, as the logarithm of a factor.

    Parameters
    ----------
    met : the pair.
    wheelbase : in m, if known.
    speed : largest speed, m/s.
    hand : cost of taking steering as the hand wheel's angle; 0 if its name says so.
    """
    if met.pair.kinematic:
        return float(min(abs(np.log(abs(met.agreed.gain))), TOO_FAR))
    length = 1 / abs(met.agreed.gain)
    low, high = WHEELBASES[speed > FAST]
    if wheelbase is not None:
        low, high = (share * wheelbase for share in GIVEN_WHEELBASE)
    road = max(np.log(low / length), np.log(length / high), 0.0)
    wheel = hand + max(np.log(RATIOS[0] * low / length), np.log(length / (RATIOS[1] * high)), 0.0)
    return float(min(wheel if hand == 0 else min(road, wheel), TOO_FAR))


def _impossible(entry: MapEntry, sizes: Mapping[str, float]) -> bool:
    return sizes[entry.signal] * entry.factor > LIMITS.get(entry.signal, (np.inf,))[0]


def _improbable(entry: MapEntry, sizes: Mapping[str, float], hand: float = HAND) -> float:
    """Cost of a signal's magnitude in a unit; steering may be the hand wheel's angle at the cost `hand`."""
    size = sizes[entry.signal] * entry.factor
    cost = TOO_FAR * _impossible(entry, sizes) + 1.0 * (size > RARE.get(entry.signal, np.inf))
    return min(cost, hand) if entry.signal == "steer" and size < MOST_TURNS else cost


ANCHORS = ("course over ground (latitude, longitude)", "v_x")
"""Signals of known sign: a course from north and east, and the speed of a vehicle driving forward."""
EASTING = "course over ground (x, y)"
CLEAR = 3
"""Number of channels of one sign against a single other one that decides which is wrong."""


def with_signs(
    entries: Sequence[MapEntry], agreed: Sequence[Met], compass: bool = False, easting: bool = False
) -> list[MapEntry]:
    """The entries with consistent signs; left open if two alternatives are equally likely.

    Parameters
    ----------
    entries : the signals.
    agreed : pairs of them.
    compass : whether the heading's name is a compass's, which counts clockwise.
    easting : whether x and y are named east and north, so that their course has a known sign like a geographic one.
    """
    anchors = (*ANCHORS, EASTING) if easting else ANCHORS
    result = {entry.signal: entry for entry in entries}
    for sides in _components(agreed):
        words = [
            f"{one.pair.left} and {one.pair.right} have {'equal' if one.agreed.correlation > 0 else 'opposite'} signs"
            for one in agreed
            if one.pair.nodes[0] in sides
        ]
        right, wrong, sure = _judged(sides, anchors, compass)
        for name in wrong:
            if name not in result:  # the course from x and y: one of them is mirrored, or all other signals are
                name = "y"
            if name in result:
                why = "; ".join(word for word in words if name in word) or "; ".join(words)
                of_course = name == "y" and "y" not in wrong
                sure_of_it = sure and not of_course
                others = f"{' and '.join(right)} {'have' if len(right) > 1 else 'has'}"
                requested = "" if sure_of_it else f"; either this column or {others} the wrong sign"
                result[name] = replace(
                    result[name], sign=-result[name].sign, decided=result[name].decided and sure_of_it,
                    reasons=(*result[name].reasons, f"sign: {why}{requested}"),
                )  # fmt: skip
    return list(result.values())


def _components(agreed: Sequence[Met]) -> list[dict[str, int]]:
    """Connected groups of channels, each with its relative sign, 1 or -1; stronger correlations take precedence."""
    groups: list[dict[str, int]] = []
    for item in sorted(agreed, key=lambda m: -abs(m.agreed.correlation)):
        a, b = item.pair.nodes
        same = 1 if item.agreed.correlation > 0 else -1
        left = next((g for g in groups if a in g), None)
        right = next((g for g in groups if b in g), None)
        if left is None:
            left = {a: 1}
            groups.append(left)
        if right is None:
            left[b] = left[a] * same
        elif right is not left:
            turn = left[a] * same * right[b]
            left.update({name: side * turn for name, side in right.items()})
            groups.remove(right)
    return groups


def _judged(sides: dict[str, int], anchors: Sequence[str], compass: bool) -> tuple[list[str], list[str], bool]:
    """The channels with the right sign, those with the wrong one, and whether that is certain."""
    anchor = next((name for name in anchors if name in sides), None)
    if anchor:
        right = [name for name, side in sides.items() if side == sides[anchor]]
        return right, [name for name in sides if name not in right], True
    first = [name for name, side in sides.items() if side == 1]
    second = [name for name, side in sides.items() if side == -1]
    right, wrong = sorted(
        (first, second), key=lambda item: (-len(item), compass and "yaw" in item, "yaw_rate" not in item)
    )
    return right, wrong, len(wrong) == 0 or (len(wrong) == 1 and len(right) >= CLEAR)
