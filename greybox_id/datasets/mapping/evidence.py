"""What the data say of units and signs: channels that must tell the same story do so in one set of units only."""

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
    """What a column is proposed to be.

    Attributes
    ----------
    signal : the signal it may hold.
    column : its full name in the file.
    unit : the file's unit; empty where nothing tells it.
    sign : -1 where it counts the other way round.
    divide_by : file units in one `unit`, for counts.
    decided : whether it may stand in the map as it is; otherwise the user is asked.
    reasons : what speaks for it, or why it is left open.
    units : what the unit may be, where that is open.
    otherwise : further names that the column has in other files.
    other_units : of these, where they are not `unit`.
    rest : of time: the column that holds what whole seconds leave; empty for none.
    rest_unit : of that column.
    sign_column, negative : of a magnitude, as of `Column`.
    missing : numbers of the file that stand for no reading.
    ends : of counts about a centre: least, centre and largest value in the file, whose angles the user writes.
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
        """The entry as a column map holds it; an unknown unit is taken as SI."""
        target = SIGNALS[self.signal].unit if self.signal in SIGNALS else "s"
        column = Column(self.signal, self.column, self.unit or target, target, 1 / self.divide_by, self.sign)
        return replace(
            column, otherwise=self.otherwise, other_units=self.other_units, rest=self.rest, rest_unit=self.rest_unit,
            sign_column=self.sign_column, negative=self.negative, missing=self.missing,
        )  # fmt: skip

    @property
    def factor(self) -> float:
        """SI value of one of the file's units, without the sign."""
        column = self.as_column()
        return to_si(column.unit, column.si_unit).factor * column.scale


USUAL = {"m/s": ("m/s", "km/h"), "rad/s": ("rad/s", "deg/s"), "rad": ("rad", "deg"), "m/s^2": ("m/s^2", "g")}
"""Units in which files hold a signal of this SI unit; any other has only its own."""
RATIOS = (7.0, 30.0)
"""Hand wheel over road wheel, from racing cars to trucks."""
HAND = 0.5
"""What it costs to take a steering column whose name does not say so as the hand wheel's: less than `MARGIN`, so that
no other unit is settled by the length of a vehicle with that wheel at its axle."""
MOST_TURNS = 4 * np.pi
"""Angle in rad that no hand wheel is turned to either side."""
ODD = {"mph": 0.44704, "knot": 0.514444}
"""Speeds that are recorded in these are asked about where the motion says so, in m/s."""
NEAR_ODD, FAR_OFF = 0.12, 0.35
"""Logarithm of the factor by which relations may be off in such a unit, and are at least in the usual one."""
FULL, PERCENT = 1.5, 100.5
"""A pedal's values up to here are shares, or percent."""
PEDALS = ("throttle", "brake")
MARGIN = 0.7
"""How much better, in the logarithm of a factor, a unit must explain the data than the next (a factor of two)."""
TOO_FAR = 4.0
LOST = 1.0
"""What a pair costs that agrees in other units only: an angle in wrong units jumps where it begins anew."""
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
"""Sizes (99th percentile, SI) beyond which a unit is improbable, though not impossible."""
MOST_ROWS = 20_000
WHEELBASES = {False: (0.12, 12.0), True: (1.0, 12.0)}
"""Lengths that v_x · steer / yaw_rate may have, in m: of any vehicle, and of one that is fast."""
FAST = 20.0
"""Speed in m/s that no small model drives."""
AXES = {"v_x": "x", "v_y": "y", "a_x": "x", "a_y": "y", "roll": "roll", "pitch": "pitch", "yaw": "yaw",
        "roll_rate": "x", "yaw_rate": "z"}  # fmt: skip
"""What tells a signal's name from its siblings'."""


@dataclass(frozen=True)
class Met:
    """A pair of channels and how far they agree."""

    pair: Pair
    agreed: Agreement

    @property
    def words(self) -> str:
        """For a person."""
        if self.pair.kinematic:
            return f"{self.pair.left} is {number(abs(self.agreed.gain), 2)} times {self.pair.right}"
        return f"{self.pair.right} over {self.pair.left} gives a wheelbase of {number(1 / abs(self.agreed.gain), 2)} m"


def pairs_of(recording: Recording) -> list[Pair]:
    """All pairs of a recording that runs on at all; without a yaw rate the heading stands in for it."""
    return [*pairs(recording), *_of_heading(recording)] if recording.sample_time > 0 else []


def _of_heading(r: Recording) -> list[Pair]:
    """What the heading's rate says of lateral acceleration and steering, where no yaw rate is recorded."""
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
    """All pairs that agree, or contradict each other, beyond chance."""
    result = [Met(p, agreement(recording, p.left_values, p.right_values, p.smoothing)) for p in pairs_of(recording)]
    return [item for item in result if item.agreed.beyond_chance]


def sizes_of(recording: Recording) -> dict[str, float]:
    """99th percentile of every signal's size; 0 where nothing is finite."""
    finite = {name: values[np.isfinite(values)] for name, values in recording.signals.items()}
    return {name: float(np.quantile(np.abs(v), 0.99)) if v.size else 0.0 for name, v in finite.items()}


def with_units(
    entries: Sequence[MapEntry], raw: Recording, wheelbase: float | None, hand_wheel: bool = False
) -> list[MapEntry]:
    """The entries with their units decided or left open.

    Parameters
    ----------
    entries : one for each signal; a unit that is stated is only checked.
    raw : the signals as the file holds them, with factor 1.
    wheelbase : in m, if known.
    hand_wheel : whether the name of the steering column says that it is the hand wheel's angle.
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
    """Open units of columns whose names differ by the axis alone (vx and vy) become those of the decided one."""
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
    """An entry in every unit that it may have."""
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
    """An entry whose unit, as the file states it, cannot be: asked about, in the usual one that can be."""
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
    """A pedal without a unit: a share, percent, or something that only who wired it knows."""
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
    """A speed as a question, where all that it takes part in says that it is in miles or knots."""
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
    """A unit that is stated, or the only one there is, beside what the data say; of a hand wheel `steering` asks."""
    met = [item for item in agreed if entry.signal == item.pair.nodes[0]]
    off = [item.words for item in met if min(misfit(item, wheelbase, hand=hand) for hand in (np.inf, 0.0)) > MARGIN]
    how = "unit: stated in the file" if before.unit else "unit: assumed, since nothing in the file checks it"
    return replace(entry, reasons=(*entry.reasons, how, *(f"but {words}: check" for words in off)))


def _counted(entry: MapEntry, raw: Recording, sizes: Mapping[str, float]) -> list[MapEntry]:
    """A speed that is none in any usual unit: counts, whose number in 1 m/s the other channels tell; else nothing."""
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
    """How badly each choice of units explains the data; a pair that agrees in other units only counts too."""
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
    """How far a pair is from what is due, as the logarithm of a factor.

    Parameters
    ----------
    met : the pair.
    wheelbase : in m, if known.
    speed : m/s, the largest.
    hand : what it costs that steering is the hand wheel's angle; 0 where its name says so.
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
    """What the size of a signal costs in a unit; steering may be the hand wheel's angle at the cost `hand`."""
    size = sizes[entry.signal] * entry.factor
    cost = TOO_FAR * _impossible(entry, sizes) + 1.0 * (size > RARE.get(entry.signal, np.inf))
    return min(cost, hand) if entry.signal == "steer" and size < MOST_TURNS else cost


ANCHORS = ("course over ground (latitude, longitude)", "v_x")
"""What has its sign from elsewhere: a course from north and east, and a vehicle that drives forward."""
EASTING = "course over ground (x, y)"
CLEAR = 3
"""So many channels on one side against a single one settle which is wrong."""


def with_signs(
    entries: Sequence[MapEntry], agreed: Sequence[Met], compass: bool = False, easting: bool = False
) -> list[MapEntry]:
    """The entries with signs that agree with each other, or left open where two sides are as likely.

    Parameters
    ----------
    entries : the signals.
    agreed : pairs of them.
    compass : whether the heading is called as a compass's, which counts clockwise.
    easting : whether x and y are called east and north, so that their course is anchored as a geographic one is.
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
            if name not in result:  # the course of x and y: one of them is mirrored, or all the rest is
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
    """Channels that are tied to each other, each with its side, 1 or -1; the strongest ties decide."""
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
    """The channels that are right, those that are wrong, and whether that is certain."""
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
