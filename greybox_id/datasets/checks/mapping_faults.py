"""Faults of the column map: signs, axes, units and the clock, one fault at a time.

If relations between channels do not hold, each possible fault is undone in turn: a sign negated, two columns exchanged,
an IMU rotated back, a unit replaced. A fault is reported if undoing it makes a failed relation hold and none fail that
held. Without motion in the recording no relation is significant, and no fault is reported.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ...base.numbers import exact, number, percent, quantity, raised, signed
from ...base.signals import ANGLES_AROUND
from ..recording import Recording
from ..repair import in_words
from .finding import FaultCause, Finding, FoundAt, Severity, listed
from .pairs import CERTAIN, ENOUGH
from .relations import DRIVES, WHEELS, Relation, relations, thinned

HOLDS = 0.65
"""Agreement from which a relation holds."""
BETTER = 0.4
"""Least gain in a relation's agreement when the fault is undone."""
REVERSED = 0.5
"""A relation whose agreement changes from below minus this to above this had its sign reversed by the fault."""
WORSE, HELD = 0.2, 0.5
"""A fault is excluded if undoing it costs more than WORSE in a relation whose agreement exceeded HELD."""
MOST = 50.0
"""Largest number of independent samples credited to one relation: beyond it, model error of the relation dominates."""
AS_LIKELY = 0.9
"""Faults with at least this share of the best one's evidence are equally likely; among those that mend most relations,
the one with the fewest columns is named."""
EQUAL = 0.97
"""Faults with at least this share of the evidence and equally few columns are named as alternatives."""
STRANGE, WITNESS = 0.25, 0.85
"""Correlation below which a channel agrees with nothing, and above which those that should agree with it do so."""
SEEN, PUSHED = 20.0, 0.5
"""Independent samples, and lateral acceleration in m/s^2, required to report such a channel."""
GRAVITY, ABOUT, STEADILY = 9.81, 1.3, 2.5
"""m/s^2: gravity as read by an upward axis, and tolerances of its mean and of its variation."""
SIDEWAYS = 1.0
"""Median |v_y| over |v_x| in motion above which a vehicle moves sideways."""
REVERSING = 0.5
"""Share of rows with negative v_x from which its sign may be wrong."""
RPM = 30 / np.pi
SMALLEST_WHEEL = 0.025
"""Least wheel radius over apparent wheelbase: truly 0.09 to 0.18; understeer lengthens the latter threefold."""


@dataclass(frozen=True)
class Fault:
    """A possible fault of a column map.

    Attributes
    ----------
    what : description, as the beginning of a sentence.
    remedy : what to write in the column map.
    channels : signals whose columns it concerns.
    undo : returns the recording without the fault.
    scales : whether it changes sizes only: the shape of the series is then unaffected, so a relation that it mends must
        have had the right shape before.
    cause : category, for checks that take it into account.
    """

    what: str
    remedy: str
    channels: tuple[str, ...]
    undo: Callable[[Recording], Recording]
    scales: bool = False
    cause: FaultCause | None = None


@dataclass(frozen=True)
class Explained:
    """A fault with its evidence, the relation that it mends best (before and after), and the number of others."""

    fault: Fault
    evidence: float
    before: Relation
    after: Relation
    more: int


def check_mapping(recording: Recording) -> list[Finding]:
    """Findings about wrong columns, the most likely fault first; then a list of what could not be checked."""
    short = thinned(recording)
    if len(short) < 10 or not short.sample_time > 0:
        return []
    result = relations(short)
    named = _explained(short, result)
    findings = [_as_finding(named, recording)] if named else []
    plain = [*_upright(short), *_sideways(short), *_wheels(result), *_commanded(result), *_strange(result)]
    known = {name for item in named for name in item.fault.channels}
    findings += [finding for finding in plain if finding.where.channel not in known]
    return findings + _unchecked(short, result, findings)


def _explained(short: Recording, result: Sequence[Relation]) -> list[Explained]:
    """Faults that explain the failed relations, the most likely first, followed by equally likely ones."""
    doubtful = {name for item in result if item.agreement < HOLDS for name in item.channels}
    explained = []
    for fault in _faults(short):
        if not fault.channels or doubtful & set(fault.channels):
            one = _judged(fault, result, relations(fault.undo(short), fault.channels))
            explained += [one] if one else []
    if not explained:
        return []
    ahead = [item for item in explained if _reverses(short) and not _reverses(item.fault.undo(short))]
    explained = ahead or explained
    top = max(item.evidence for item in explained)
    close = [item for item in explained if item.evidence >= AS_LIKELY * top]
    most = max(item.more for item in close)
    close = [item for item in close if item.more == most]
    fewest = min(_sensors(item.fault) for item in close)
    close = sorted((item for item in close if _sensors(item.fault) == fewest), key=lambda item: -item.evidence)
    return [item for item in close if item.evidence >= EQUAL * close[0].evidence]


AT_LEAST = 0.5
"""Share of a fault's gains in evidence that must remain after its losses."""


def _sensors(fault: Fault) -> int:
    """Number of sensors at fault: yaw and yaw_rate come from one sensor."""
    return len(fault.channels) - ({"yaw", "yaw_rate"} <= set(fault.channels))


def _judged(fault: Fault, before: Sequence[Relation], after: Sequence[Relation]) -> Explained | None:
    changed = {(item.left, item.right): item for item in after}
    mended: list[tuple[float, Relation, Relation]] = []
    evidence = gained = 0.0
    for old in before:
        new = changed.get((old.left, old.right))
        if new is None:
            continue
        better, weight = new.agreement - old.agreement, min(old.independent, new.independent, MOST)
        if better < -WORSE and old.agreement > HELD and _certain(old):
            return None
        turned = min(-old.agreement, new.agreement) > REVERSED
        if better > BETTER and (new.agreement > HOLDS or turned) and _certain(new):
            mended.append((better * weight, old, new))
        evidence += better * weight
        gained += max(better, 0.0) * weight
    shaped = any(old.correlation > HOLDS for _, old, _ in mended)
    if not mended or evidence <= AT_LEAST * gained or (fault.scales and not shaped):
        return None
    _, old, new = max(mended, key=lambda item: item[0])
    return Explained(fault, evidence, old, new, len(mended) - 1)


def _certain(relation: Relation) -> bool:
    """Whether the agreement is significant."""
    n, c = relation.independent, min(abs(relation.correlation), 1 - 1e-12)
    return n >= ENOUGH and bool(np.arctanh(c) * np.sqrt(n - 3) > CERTAIN)


def _as_finding(named: Sequence[Explained], recording: Recording) -> Finding:
    first, others = named[0], [item.fault.what for item in named[1:]]
    old, new = first.before, first.after
    repair = _repair(first.fault) if not others else {}
    more = (
        f", and {first.more} other relation{'s' if first.more > 1 else ''} between channels "
        f"agree{'' if first.more > 1 else 's'}, too"
    )
    sentence = (
        f"{first.fault.what}: with the present column map, {old.left} and {old.right} have {_numbers(old)}. After "
        f"correction they have {_numbers(new)}{more if first.more else ''}. {_remedy(first.fault, recording, repair)}"
    )
    if others:
        sentence += f" Equally likely: {listed(others, 3)}."
    error = 1 / np.sqrt(max(old.independent - 3, 1.0))
    channel = ", ".join(first.fault.channels) or "time"
    causes = frozenset(item.fault.cause for item in named if item.fault.cause is not None)
    return Finding(
        "mapping", Severity.DISTRUST, FoundAt(channel), sentence, old.correlation, error, repair=repair, causes=causes
    )


def _remedy(fault: Fault, recording: Recording, repair: Mapping[str, tuple[str, float, float]]) -> str:
    """What to do about a fault: the remedy, or the remaining scale if the map already states that unit."""
    changed = in_words(recording, repair) if fault.scales else ""
    return fault.remedy if not changed or "unit =" in changed else f"In the column map, {changed}."


IMU = ("a_x", "a_y", "yaw_rate")
"""Channels read when a rotation of the IMU is undone, whichever of them it changes."""


def _repair(fault: Fault) -> dict[str, tuple[str, float, float]]:
    """Column map repair for each signal: (source column's signal, factor, offset); empty if undoing mixes columns.

    Undoing is linear, so its matrix is found by applying it to unit signals, one after the other.
    """
    names = tuple(dict.fromkeys((*fault.channels, *IMU))) if fault.channels else ()
    repair: dict[str, tuple[str, float]] = {}
    for source in names:
        unit = Recording("unit", np.arange(3.0), {name: np.full(3, float(name == source)) for name in names})
        for name, values in fault.undo(unit).signals.items():
            factor = float(values[0])
            if factor and name in repair:
                return {}
            if factor:
                repair[name] = (source, factor)
    slowed = float(fault.undo(Recording("unit", np.arange(3.0), {})).time[1]) if not names else 1.0
    moved = {name: (*changed, 0.0) for name, changed in repair.items() if changed != (name, 1.0)}
    return moved | ({"time": ("time", slowed, 0.0)} if slowed != 1.0 else {})


def _numbers(relation: Relation) -> str:
    gain = f" and gain {number(np.copysign(relation.gain, relation.correlation))}" if relation.known else ""
    return f"correlation {number(relation.correlation, 2)}{gain}"


# ---- faults tested by undoing them


def _faults(r: Recording) -> Iterator[Fault]:
    """Every fault that is possible with the channels of a recording."""
    yield from _imu(r)
    yield from _velocities(r)
    for names in (
        ("steer",),
        ("yaw",),
        ("yaw_rate", "yaw"),
        ("sideslip",),
        ("yaw_rate", "steer"),
        *((name,) for name in DRIVES),
    ):
        if r.has(*names):
            yield _wrong_sign(*names)
    if r.has("x", "y"):
        yield Fault("the positions are mirrored", "Negate y (or x) in the column map.", ("y",), _scaled(-1.0, "y"))
    yield from _units(r)
    for factor in (2.0, 0.5, 10.0, 0.1, 60.0, 1 / 60, 1000.0, 0.001):
        yield Fault(
            f"time is {exact(factor)} times as long as it should be",
            f"Check the unit of time in the column map, or divide time by {factor:g}.",
            (), _slowed(1 / factor),
        )  # fmt: skip


def _imu(r: Recording) -> Iterator[Fault]:
    """The four rotations and four reflections of a pair of accelerometers, each with and without the gyro's sign."""
    if r.has("a_x", "a_y"):
        for exchanged, along, across, turn in product((False, True), (1, -1), (1, -1), (1, -1)):
            if (exchanged, along, across, turn) != (False, 1, 1, 1) and (turn == 1 or r.has("yaw_rate")):
                yield _mounted(exchanged, along, across, turn)
        return
    for name in ("a_x", "a_y", "yaw_rate"):
        if r.has(name):
            yield _wrong_sign(name)
    if r.has("a_y", "yaw_rate"):
        both = ("a_y", "yaw_rate")
        yield Fault("the IMU is upside down (turned about x)", _turn(both), both, _scaled(-1.0, *both))


def _mounted(exchanged: bool, along: int, across: int, turn: int) -> Fault:
    """The true a_x is `along` times the column of a_x (of a_y if exchanged), the true a_y `across` times the other."""
    first, second = ("a_y", "a_x") if exchanged else ("a_x", "a_y")

    def undo(r: Recording) -> Recording:
        made = {"a_x": along * r[first], "a_y": across * r[second]}
        return r.with_signals(**made, **({"yaw_rate": -r["yaw_rate"]} if turn < 0 else {}))

    wrong = [name for name, sign in (("a_x", along), ("a_y", across), ("yaw_rate", turn)) if sign < 0]
    if not exchanged:
        kinds: dict[tuple[str, ...], str] = {
            ("a_x", "a_y"): "the IMU is turned by 180° about z",
            ("a_y", "yaw_rate"): "the IMU is upside down (turned about x)",
            ("a_x", "yaw_rate"): "the IMU is upside down (turned about y)",
        }
        names = tuple(wrong)
        if names not in kinds:
            return replace(_wrong_sign(*names), undo=undo)
        return Fault(kinds[names], _turn(names), names, undo)
    if turn * along * across < 0:  # the exchange has determinant -1: a rotation in space preserves handedness
        sense = "to the left" if along < 0 else "to the right"
        what = f"the IMU is turned by 90° {sense}" if turn > 0 else "the IMU is upside down with x and y exchanged"
    else:
        what = "the columns of a_x and a_y are exchanged"
    remedy = "In the column map, swap the columns of a_x and a_y" + (
        f", then negate {listed(wrong)}." if wrong else "."
    )
    by_90 = FaultCause.TURN if turn * along * across < 0 < turn else None
    return Fault(what, remedy, ("a_x", "a_y") if turn > 0 else ("a_x", "a_y", "yaw_rate"), undo, cause=by_90)


def _wrong_sign(*names: str) -> Fault:
    what = f"{listed(names)} {'have' if len(names) > 1 else 'has'} the wrong sign"
    return Fault(what, _turn(names), names, _scaled(-1.0, *names), cause=FaultCause.SIGN)


def _velocities(r: Recording) -> Iterator[Fault]:
    backwards = _reverses(r)
    if backwards:
        for names in (("v_x",), ("v_x", "steer")):
            if r.has(*names):
                yield _wrong_sign(*names)
    if not r.has("v_x", "v_y"):
        return
    yield _wrong_sign("v_y")
    both = ("v_x", "v_y")
    if backwards:
        yield _wrong_sign(*both)
    for along, across in product((1, -1), (1, -1)):
        wrong = [name for name, sign in (("v_x", along), ("v_y", across)) if sign < 0]
        remedy = (
            f"In the column map, swap the columns of v_x and v_y{f', then negate {listed(wrong)}' if wrong else ''}."
        )
        yield Fault("the columns of v_x and v_y are exchanged", remedy, both, _exchanged(along, across))


def _reverses(r: Recording) -> bool:
    """Whether v_x is negative most of the time: nobody reverses for a whole drive."""
    return r.has("v_x") and float(np.nanmean(r["v_x"] < 0.0)) > REVERSING


def _exchanged(along: int, across: int) -> Callable[[Recording], Recording]:
    return lambda r: r.with_signals(v_x=along * r["v_y"], v_y=across * r["v_x"])


def _units(r: Recording) -> Iterator[Fault]:
    """Units that are commonly mistaken for each other."""
    degrees, g, kmh = 180 / np.pi, 9.80665, 3.6
    kinds: tuple[tuple[tuple[str, ...], float, str, str], ...] = (
        (("v_x",), kmh, "km/h", "m/s"),
        (("v_y",), kmh, "km/h", "m/s"),
        (("v_x", "v_y"), kmh, "km/h", "m/s"),
        (("yaw_rate",), degrees, "deg/s", "rad/s"),
        (("yaw",), degrees, "deg", "rad"),
        (("steer",), degrees, "deg", "rad"),
        (("sideslip",), degrees, "deg", "rad"),
        (("a_x",), g, "m/s^2", "g"),
        (("a_y",), g, "m/s^2", "g"),
        (("a_x", "a_y"), g, "m/s^2", "g"),
        (("x", "y"), 1000.0, "mm", "m"),
        *(((name,), RPM, "rpm", "rad/s") for name in WHEELS),
    )
    for names, factor, small, large in kinds:
        if r.has(*names):
            for by, is_in, called in ((factor, small, large), (1 / factor, large, small)):
                verb = "are" if len(names) > 1 else "is"
                what = f"{listed(names)} {verb} in {raised(is_in)} but called {raised(called)}"
                remedy = f'Set unit = "{is_in}" in the column map (a factor of {exact(factor)}).'
                around = any(name in ANGLES_AROUND for name in names)
                yield Fault(what, remedy, names, _scaled(1 / by, *names), scales=not around)


def _scaled(factor: float, *names: str) -> Callable[[Recording], Recording]:
    return lambda r: r.with_signals(**{name: factor * r[name] for name in names})


def _slowed(factor: float) -> Callable[[Recording], Recording]:
    return lambda r: replace(r, time=factor * r.time)


def _turn(names: Sequence[str]) -> str:
    return f"Negate {listed(names)} in the column map (sign = -1, or remove sign = -1)."


# ---- faults visible without undoing anything


def _upright(r: Recording) -> list[Finding]:
    """Accelerometer axes that read gravity."""
    findings = []
    expected = {"a_x": np.zeros(len(r)), "a_y": r["v_x"] * r["yaw_rate"] if r.has("v_x", "yaw_rate") else None}
    for name, due in expected.items():
        if due is None or not r.has(name):
            continue
        reads = r[name][np.isfinite(r[name])]
        deviation = (r[name] - due)[np.isfinite(r[name] - due)]
        usual = float(np.median(reads))
        low, high = np.quantile(deviation, [0.1, 0.9]) if deviation.size else (0.0, np.inf)
        away = abs(float(np.median(deviation)) - np.sign(usual) * GRAVITY) if deviation.size else np.inf
        if abs(abs(usual) - GRAVITY) < ABOUT and away < ABOUT and high - low < STEADILY:
            sentence = (
                f"{name} reads {signed(usual)} m/s² all the time, which is gravity: this axis of the IMU points "
                f"{'up' if usual > 0 else 'down'}, and its gyro about z does not read the yaw rate either. Map "
                f"{name} to the "
                f"column of the axis that points {'forward' if name == 'a_x' else 'to the left'}."
            )
            findings.append(Finding("mapping", Severity.DISTRUST, FoundAt(name), sentence, usual, None, "m/s^2"))
    return findings


def _sideways(r: Recording) -> list[Finding]:
    """Vehicles that move sideways more than ahead."""
    if not r.has("v_x", "v_y"):
        return []
    ahead, aside = np.abs(r["v_x"]), np.abs(r["v_y"])
    pace = np.hypot(ahead, aside)
    moving = pace > 0.3 * float(np.nanquantile(pace, 0.95))
    if np.count_nonzero(moving) < 20 or not np.nanquantile(pace, 0.95) > 0.5:
        return []
    share = float(np.median(aside[moving])) / max(float(np.median(ahead[moving])), 1e-9)
    if share < SIDEWAYS:
        return []
    sentence = (
        f"|v_y| is usually {number(share)} times |v_x|: no vehicle moves sideways for most of the time. The columns of "
        "v_x and v_y are exchanged, or the column of v_x holds something else than the speed: swap the columns of "
        "v_x and v_y."
    )
    return [Finding("mapping", Severity.DISTRUST, FoundAt("v_x"), sentence, share)]


def _wheels(result: Sequence[Relation]) -> list[Finding]:
    """Wheels that would be too small for the vehicle, or turn too fast."""
    rolling = next((item for item in result if item.right == "the wheel speeds"), None)
    turning = next((item for item in result if item.right == "v_x · steer" and _certain(item)), None)
    if rolling is None or not rolling.agreement > HOLDS or turning is None or not turning.agreement > HOLDS:
        return []
    share = rolling.gain * turning.gain  # radius over v_x · steer / yaw_rate
    if share > SMALLEST_WHEEL:
        return []
    sentence = (
        f"v_x and the wheel speeds give a wheel radius of {quantity(rolling.gain, 'm', 2)}, {percent(share)} of the "
        f"wheelbase that yaw_rate and v_x · steer give; 9 to 18 % is usual. Either the wheel speeds are in rpm but "
        f'called rad/s (a factor of {number(RPM)}): set unit = "rpm"; or v_x is in another unit.'
    )
    return [Finding("mapping", Severity.DISTRUST, FoundAt("wheel_speed_fl"), sentence, rolling.gain, None, "m")]


def _commanded(result: Sequence[Relation]) -> list[Finding]:
    """Accelerations that follow their command in shape, but not in size."""
    one = next((item for item in result if item.right == "ax_cmd"), None)
    if one is None or one.correlation < WITNESS or not _certain(one) or one.agreement > 1 - WITNESS:
        return []
    sentence = (
        f"dv_x/dt is {number(one.gain, 2)} times ax_cmd, where about 1 is expected (correlation "
        f"{number(one.correlation, 2)}): check unit and scale of ax_cmd in the column map."
    )
    return [Finding("mapping", Severity.DISTRUST, FoundAt("ax_cmd"), sentence, one.gain)]


def _strange(result: Sequence[Relation]) -> list[Finding]:
    """Channels that agree with nothing, although the channels they should agree with agree with each other."""
    findings = []
    for name, others in (("yaw_rate", {"a_y", "steer", "v_x"}), ("a_y", {"yaw_rate", "steer", "v_x"})):
        matching = [r for r in result if name in r.channels and r.left in (name, "a_y") and r.independent > SEEN]
        sides = [r for r in result if name not in r.channels and r.agreement > WITNESS and r.independent > ENOUGH]
        sides = [r for r in sides if len(others & set(r.channels)) >= 2 and "steer" in r.channels]
        low = [r for r in matching if abs(r.correlation) < STRANGE and (name != "a_y" or r.right_size > PUSHED)]
        if len(matching) >= 2 and len(low) == len(matching) and sides:
            sentence = (
                f"{name} follows neither {listed((r.right for r in low), 3).replace(' and ', ' nor ')} (correlation "
                f"{number(low[0].correlation, 2)}), though {sides[0].left} follows {sides[0].right} "
                f"({number(sides[0].correlation, 2)}): its column holds something else, such as another axis. "
                f"Map {name} to the right column."
            )
            finding = Finding("mapping", Severity.DISTRUST, FoundAt(name), sentence, low[0].correlation)
            findings.append(replace(finding, causes=frozenset({FaultCause.STRANGER})))
    return findings


# ---- checks that could not be done

CLOCKED = ("a_x", "yaw_rate", "|v_x|")
"""Left sides of relations with a time derivative and a known gain, which check the scale of time."""
CHECKS: tuple[tuple[str, str, Callable[[Relation], bool], str], ...] = (
    ("steer", "the sign of steer", lambda item: "steer" in item.channels, "v_x and one of yaw_rate, a_y or positions"),
    ("yaw_rate", "the sign of yaw_rate", lambda item: "yaw_rate" in item.channels and item.left != "v_y",
     "yaw, or positions, or v_x with steer or a_y"),
    ("a_x", "axis and sign of a_x", lambda item: item.left == "a_x", "v_x"),
    ("a_y", "axis and sign of a_y", lambda item: item.left == "a_y", "v_x and one of yaw_rate, steer or positions"),
    ("v_x", "the scale of v_x", lambda one: "v_x" in one.channels and one.known and one.left in ("a_x", "a_y", "|v_x|"),
     "positions, or a_x, or a_y with yaw_rate"),
    ("v_y", "the sign of v_y", lambda item: item.left in ("v_y", "sideslip"),
     "x, y and yaw, or yaw_rate at several speeds"),
    ("yaw", "the sign of yaw", lambda item: "yaw" in item.channels, "yaw_rate or positions"),
    ("time", "the scale of time", lambda one: one.left in CLOCKED and ("/dt" in one.right or "ground" in one.right),
     "a_x and v_x, yaw_rate and yaw, or positions"),
    *((name, f"the sign of {name}", lambda item, name=name: item.right == name, "v_x") for name in DRIVES),
)  # fmt: skip
"""(channel, what is checked, predicate for the relations that check it, channels needed)."""


def _unchecked(r: Recording, result: Sequence[Relation], findings: Sequence[Finding]) -> list[Finding]:
    """Notes on checks that lack channels or motion."""
    if findings:
        return []  # one fault at a time: the rest is checked once it is corrected
    lacking, still = [], []
    for name, what, does, needs in CHECKS:
        if name != "time" and not r.has(name):
            continue
        witnesses = [relation for relation in result if does(relation)]
        if not witnesses:
            lacking.append(f"{what} (needs {needs})")
        elif not any(relation.agreement > HOLDS and _certain(relation) for relation in witnesses):
            still.append(what)
    sentences = [f"not clear from the motion in this recording: {'; '.join(still)}."] if still else []
    if lacking:
        why = "could not be checked, because a channel is missing, constant or has gaps"
        sentences.insert(0, f"{listed(lacking, len(lacking))} {why}.")
    return [Finding("unchecked", Severity.NOTE, FoundAt("map"), sentence) for sentence in sentences]
