"""Faults with a size: offsets, scales, rotated sensors, a change of vehicle half-way; of time, see `clocks`.

Signs, axes and units are tested by undoing them (`mapping_faults`). Sizes are estimated instead: each relation between
channels is a linear sum of the motion and of terms that faults add. Least squares estimates the size of every fault,
with standard errors from the scatter between blocks of rows. The fault that explains most of a conflict is named first,
with its size, followed by those that would explain nearly as much.

    a_y = k v_x yaw_rate + b v_x + s dv_x/dt + c      b: offset of yaw_rate; s: a rotated IMU; c: offset, roll, a bank
    a_x = dv_x/dt + s v_x yaw_rate + c                s: a rotated IMU, with the opposite sign
    v_x steer = L yaw_rate + K v_x^2 yaw_rate + d v_x    d: offset of steer
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...base.numbers import number, percent, quantity, signed
from ...base.shorthands import Array
from ..recording import Recording
from ..repair import in_words
from .clocks import clocks
from .finding import Explanation, FaultCause, Finding, FoundAt, Severity, listed
from .frozen import check_frozen
from .pairs import SHARPEST, acceleration_ahead, acceleration_aside, course_and_speed, grounds, rate, smooth
from .relations import SMOOTHING, thinned

SLOW = 3.0
"""Smoothing time in s that averages out the rate of v_y: a steering oscillation takes a second or two."""
BLOCKS = 12
"""Number of blocks whose scatter gives the standard error of a size."""
SURE = 6.0
"""Standard errors for significance: many sizes are tested, and vehicles are not rigid bodies on flat roads."""
FITS = 0.9
"""Share of a relation's variance that must be explained before its coefficients are interpreted as sizes."""
ALSO = 0.6
"""Explanations with at least this share of the best one's gain are named as alternatives."""
TURN_RATE, ACCELERATION, ANGLE, SCALE, STEERING = 0.04, 0.8, 0.08, 0.12, 0.01
"""Smallest sizes reported: offsets of yaw_rate in rad/s and of an acceleration in m/s^2 (a bank of 5 degrees), rotation
of an IMU in rad (5 degrees), relative error of a scale, and offset of steer in rad; drives on usual roads with usual
sensors have less."""
LESS, ROLLS, SPEED = 0.05, 0.2, 0.03
"""Shares by which a_y may read less and more than the motion implies, and v_x may be off: a usual sensor's scale is
known to 3 %, and a rolling body reads gravity, up to 11 degrees per g."""
LONG = 4.0
"""Least chord in units of a receiver's shortest: noise of a metre then lengthens chords by a few thousandths."""
HELD_TOGETHER = 0.5
"""Share of v_x · steer that yaw_rate must explain before halves are compared."""
HALF_LEFT = 0.5
"""Share of a cause's acceleration at the usual speed that must not be cancelled by other terms."""
ONE_WAY = 0.2
"""Share of rows turning in the other direction required to report an offset of steer."""
GENTLE, HALF_GRIP = 5.0, 0.5
"""Lateral acceleration in m/s^2, and its share of the hardest turns, up to which tyres are about linear."""
HALF = 0.2
"""Relative change of v_x · steer / yaw_rate between halves that no load or tyre causes within a drive."""
NEAR_RIGHT = 8.0
"""Degrees around 90 within which the column map can correct the rotation of an IMU."""


def with_sizes(recording: Recording, findings: Sequence[Finding]) -> list[Finding]:
    """Findings plus faults with sizes, if signs, axes and units are right or the only fault is an IMU rotated by 90°.

    Since a map can only express rotations by 90°, an IMU rotated by another angle is first reported as one of these.
    """
    wrong = [finding for finding in findings if finding.kind in ("mapping", "sign", "unit")]
    if not wrong:
        return [*findings, *check_explanations(recording)]
    strange = [item for item in wrong if FaultCause.STRANGER in item.causes]
    if strange and len(strange) == len(wrong) and recording.has("v_x"):
        early = [clock for clock in clocks(recording) if clock.channel == strange[0].where.channel]
        return [
            *(_finding(recording, clock) for clock in early[:1]),
            *(finding for finding in findings if not early or finding not in wrong),
        ]
    turned = [item for item in wrong if FaultCause.TURN in item.causes]
    short = thinned(recording) if turned else recording
    if not turned or len(short) < 10 * BLOCKS or not short.has("v_x", "a_x", "a_y", "yaw_rate"):
        return list(findings)
    sized = [item for item in _turned(short, None) if abs(abs(item.value) - 90.0) > NEAR_RIGHT]
    if not sized:
        return list(findings)
    return [_finding(recording, sized[0]), *(finding for finding in findings if finding not in wrong)]


def _finding(recording: Recording, one: Explanation, also: str = "") -> Finding:
    repair = {} if one.offset is None else {one.channel: (one.channel, float(one.sign), float(f"{one.offset:.3g}"))}
    changed = in_words(recording, repair)
    if one.offset is not None:
        unit = recording.unit(one.channel)
        turned = "turned, and then " if one.sign < 0 else ""
        remedy = changed or f"{one.channel}: {turned}offset = {number(one.offset, 3)} {unit} more"
        also = f" In the column map, {remedy}.{also}"
    severity = Severity.DISTRUST if one.witnessed else Severity.WARNING
    place, sentence = FoundAt(one.channel), one.sentence + also
    return Finding("explained", severity, place, sentence, one.value, one.error, one.unit, repair)


def check_explanations(recording: Recording) -> list[Finding]:
    """Faults with their sizes, the most plausible first."""
    result = check_frozen(recording)
    short = thinned(recording)
    if len(short) < 10 * BLOCKS or not short.has("v_x"):
        return result
    explained = [*_sideways(short), *_ahead(short)]
    if speed := _speed(short):  # an error of v_x also explains relative errors of the other channels
        explained = [*speed, *(item for item in explained if item.unit != "1")]
    offset = next((item.value for item in explained if item.channel == "yaw_rate" and item.unit == "rad/s"), 0.0)
    explained += _steered(short.with_signals(yaw_rate=short["yaw_rate"] - offset)) if "yaw_rate" in short else []
    explained = sorted(explained + clocks(recording), key=lambda item: -item.gain)
    findings = list(result)
    if explained:
        first, *others = explained
        near = [other.sentence.split(":")[0].split(" (")[0] for other in others if other.gain > ALSO * first.gain]
        findings.append(_finding(recording, first, f" Nearly as likely: {listed(near, 3)}." if near else ""))
        surer = [other for other in others if other.witnessed and other.channel != first.channel]
        if not first.witnessed and surer:
            findings.append(_finding(recording, surer[0]))
    return findings


@dataclass(frozen=True)
class _Regression:
    """Coefficients of a relation, their standard errors over blocks, and the share of variance explained."""

    values: Array
    errors: Array
    explained: float
    parts: Array

    def sure(self, k: int, least: float) -> bool:
        """Whether a coefficient exceeds `least`, and is significant."""
        return bool(abs(self.values[k]) > least and abs(self.values[k]) > SURE * self.errors[k])


def _regression(left: Array, columns: Sequence[Array]) -> _Regression | None:
    """Least squares with a block jackknife; None if the columns are too collinear or rows too few."""
    table = np.column_stack(columns)
    rows = np.isfinite(left) & np.all(np.isfinite(table), axis=1)
    y, X = left[rows], table[rows]
    if len(y) < 5 * BLOCKS:
        return None
    size = np.sqrt(np.mean(X**2, axis=0))
    if not np.all((size > 1e-9) & np.isfinite(size)) or np.linalg.cond(X / size) > 50.0:
        return None
    edges = np.linspace(0, len(y), BLOCKS + 1).astype(int)
    H = [X[a:b].T @ X[a:b] for a, b in zip(edges[:-1], edges[1:], strict=True)]
    g = [X[a:b].T @ y[a:b] for a, b in zip(edges[:-1], edges[1:], strict=True)]
    whole, pull = np.sum(H, axis=0), np.sum(g, axis=0)
    values = np.linalg.solve(whole, pull)
    left_out = np.array([np.linalg.lstsq(whole - h, pull - p, rcond=None)[0] for h, p in zip(H, g, strict=True)])
    errors = np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((left_out - left_out.mean(axis=0)) ** 2, axis=0))
    rest = y - X @ values
    explained = 1.0 - float(np.sum(rest**2) / max(float(np.sum((y - y.mean()) ** 2)), 1e-300))
    return _Regression(values, np.maximum(errors, 1e-12), explained, values**2 * np.mean(X**2, axis=0))


def _sideways(r: Recording) -> list[Explanation]:
    """Faults in the relation of a_y to v_x · yaw_rate, and of a_x to dv_x/dt."""
    if not r.has("a_y", "yaw_rate"):
        return []
    v, turn = r["v_x"], r["yaw_rate"]
    dv = rate(r, v)
    aside = [v * turn, v, dv, np.ones(len(v))]
    aside[0] = aside[0] + rate(r, r["v_y"]) if r.has("v_y") else aside[0]
    smoothed = [smooth(r, item, SMOOTHING) for item in aside]
    a_y = smooth(r, r["a_y"], SMOOTHING)
    both = _regression(a_y, smoothed)
    steady = both is None
    if both is None:  # at constant speed, offsets of yaw_rate and a_y are indistinguishable
        both = _regression(a_y, [smoothed[0], smoothed[2], smoothed[3]])
        if both is None or both.explained < FITS:
            return []
        gain, turned, constant, bias = 0, 1, 2, -1
    else:
        gain, bias, turned, constant = 0, 1, 2, 3
    if both.explained < FITS:
        return []
    result = []
    strength: Callable[[int], float] = lambda k: float((both.values[k] / both.errors[k]) ** 2)  # noqa: E731
    scale = float(both.values[gain])
    usual = float(np.nanmean(v))
    by_bias = float(both.values[bias]) * usual if bias >= 0 else 0.0
    by_constant = float(both.values[constant])
    net = abs(by_bias + by_constant)  # of a single cause; two terms that cancel are a nonlinear effect of speed
    if bias >= 0 and both.sure(bias, TURN_RATE) and net > HALF_LEFT * abs(by_bias):
        size, error = -float(both.values[bias]) / scale, float(both.errors[bias])
        result.append(
            Explanation(
                f"yaw_rate has an offset of {signed(size, 2)} rad/s: a_y − v_x · yaw_rate grows with v_x.",
                "yaw_rate", size, error, "rad/s", strength(bias), offset=-size,
            )
        )  # fmt: skip
    if both.sure(constant, ACCELERATION) and net > HALF_LEFT * abs(by_constant):
        size = by_constant
        bank = np.degrees(np.arcsin(np.clip(size / 9.81, -1.0, 1.0)))
        also = f", or yaw_rate one of {signed(-size / usual, 2)} rad/s" if steady else ""
        result.append(
            Explanation(
                f"a_y contains a constant of {signed(size, 2)} m/s²: the road is banked, or the IMU rolled, by "
                f"{number(abs(float(bank)), 2)}°, or a_y has an offset{also}. Add the effect road_bank to the fit, "
                "or subtract the constant.",
                "a_y", size, float(both.errors[constant]), "m/s^2", strength(constant),
            )
        )  # fmt: skip
    result += _turned(r, float(both.values[turned]))
    relative = abs(np.log(max(scale, 1e-9)))
    turns, brakes = np.nanstd(smoothed[0]), np.nanstd(smoothed[2])
    gentle = SCALE * turns < ANGLE * brakes  # a slightly rotated IMU has the same effect
    far = (LESS if scale < 1 else ROLLS) < relative < 0.5 and abs(scale - 1.0) > SURE * both.errors[gain]
    if far and not gentle and not result and not _vanishes_slowly(r, scale):
        result.append(_scaled(r, scale, float(both.errors[gain]), strength(gain)))
    return result


def _vanishes_slowly(r: Recording, scale: float) -> bool:
    """Whether a scale error mostly vanishes at low frequencies: quick steering moves v_y, whose rate a_y contains."""
    if r.has("v_y"):
        return False
    left, right = (smooth(r, item, SLOW) for item in (r["a_y"], r["v_x"] * r["yaw_rate"]))
    slow = _regression(left, [right, np.ones(len(left))])
    return slow is not None and abs(np.log(max(float(slow.values[0]), 1e-9))) < 0.5 * abs(np.log(max(scale, 1e-9)))


def _ahead(r: Recording) -> list[Explanation]:
    """A constant in a_x: a pitched IMU, a road that climbs throughout, or an offset."""
    if not r.has("a_x"):
        return []
    columns = [rate(r, r["v_x"]), np.ones(len(r))]
    columns += [r["v_x"] * r["yaw_rate"]] if r.has("yaw_rate") and np.nanstd(r["yaw_rate"]) > 0 else []
    both = _regression(smooth(r, r["a_x"], SMOOTHING), [smooth(r, item, SMOOTHING) for item in columns])
    if both is None or both.explained < FITS or not both.sure(1, ACCELERATION):
        return []
    size = float(both.values[1])
    pitch = np.degrees(np.arcsin(np.clip(size / 9.81, -1.0, 1.0)))
    return [
        Explanation(
            f"a_x contains a constant of {signed(size, 2)} m/s²: the IMU is pitched, or the road climbs throughout, by "
            f"{number(abs(float(pitch)), 2)}°, or a_x has an offset. Subtract it.",
            "a_x", size, float(both.errors[1]), "m/s^2", float((both.values[1] / both.errors[1]) ** 2), offset=-size,
        )
    ]  # fmt: skip


def _turned(r: Recording, aside: float | None) -> list[Explanation]:
    """An IMU rotated about its vertical axis: each accelerometer reads a share of the other axis.

    `aside` : coefficient of dv_x/dt in a_y; None if it is not to be compared.
    """
    if not r.has("a_x"):
        return []
    v, turn = r["v_x"], r["yaw_rate"]
    ahead = _regression(
        smooth(r, r["a_x"], SMOOTHING),
        [smooth(r, item, SMOOTHING) for item in (rate(r, v), v * turn, np.ones(len(v)))],
    )
    if ahead is None:
        return []
    angle = float(np.arctan2(ahead.values[1], ahead.values[0]))
    other = np.sin(angle) if aside is None else -aside
    if not ahead.sure(1, ANGLE) or not abs(other - np.sin(angle)) < max(0.5 * abs(np.sin(angle)), 0.1):
        return []
    degrees = float(np.degrees(angle))
    side = "left" if degrees < 0 else "right"
    return [
        Explanation(
            f"The IMU is turned by {number(abs(degrees), 3)}° to the {side}: a_x contains "
            f"{percent(abs(np.sin(angle)))} of v_x · yaw_rate, and a_y the same share of dv_x/dt. Rotate a_x and a_y "
            "back, or add the effect imu_mount_yaw to the fit.",
            "a_x, a_y", degrees, float(np.degrees(ahead.errors[1])), "deg",
            float((ahead.values[1] / ahead.errors[1]) ** 2),
        )
    ]  # fmt: skip


def _scaled(r: Recording, scale: float, error: float, strength: float) -> Explanation:
    """Find which of a_y, yaw_rate and v_x has the wrong scale: the one that other channels contradict as well."""
    blamed = {"a_y": scale}
    witnesses = []
    for place in grounds(r):
        witnesses.append(("yaw_rate", place.turning(r), course_and_speed(r, place)[0]))
    if r.has("yaw"):
        right = smooth(r, rate(r, r["yaw"], True), SMOOTHING)
        witnesses.append(("yaw_rate", smooth(r, r["yaw_rate"], SMOOTHING), right))
    for name, left, right in witnesses:
        result = _regression(left, [right])
        least = 0.5 * abs(np.log(scale))  # a channel that explains less is not the cause
        if result is not None and result.explained > FITS and abs(np.log(abs(result.values[0]))) > least:
            blamed = {name: float(result.values[0])}
    surely = bool(witnesses) and (blamed != {"a_y": scale} or abs(np.log(scale)) > SCALE)
    (name, by), *_ = blamed.items()
    others = [item for item in ("a_y", "yaw_rate", "v_x") if item != name]
    banked = ", or the road is banked in its turns" if scale < 1 else ""
    doubt = (
        "" if surely else (f" (or {listed(others)} by the same factor too {'large' if scale < 1 else 'small'}{banked})")
    )
    return Explanation(
        f"{name} is {number(by, 3)} times what the other channels imply{doubt}: a_y against v_x · yaw_rate has gain "
        f"{number(scale, 3)}. Check its scale in the column map.",
        name, by, error, "1", strength, surely,
    )  # fmt: skip


def _speed(r: Recording) -> list[Explanation]:
    """A scale error of v_x: by positions, else by both accelerometers, if they deviate by the same factor.

    Roll and pitch of the body add gravity to both and never reduce it; the sensors' scales may be too small as well.
    """
    for place in grounds(r):
        turned = 0.5 * place.seconds * np.abs(smooth(r, r["yaw_rate"], place.seconds)) if r.has("yaw_rate") else 0.0
        pace, speed = smooth(r, np.abs(r["v_x"]), place.seconds), course_and_speed(r, place)[1]
        sound = (turned < SHARPEST / 2) & (speed * place.seconds > LONG * place.shortest)
        over_ground = _regression(np.where(sound, pace, np.nan), [speed / np.sinc(turned / np.pi)])  # arc length
        if over_ground is not None:
            other = f"the speed over ground ({place.words})"
            scale, error = float(over_ground.values[0]), float(over_ground.errors[0])
            return [_of_speed(scale, error, other, True)] if _is_off(scale, error) else []
    if not r.has("a_x", "a_y", "yaw_rate"):
        return []
    seconds = SMOOTHING if r.has("v_y") else SLOW  # averages out the rate of v_y
    gains = []
    sides = ("a_x", acceleration_ahead(r)[1], SMOOTHING), ("a_y", acceleration_aside(r)[1], seconds)
    for name, values, over in sides:
        one = _regression(smooth(r, r[name], over), [smooth(r, values, over), np.ones(len(r))])
        if one is None or one.explained < FITS or not _is_off(float(one.values[0]), float(one.errors[0])):
            return []
        gains.append(one)
    ahead, aside = (float(one.values[0]) for one in gains)
    if abs(np.log(aside / ahead)) > 0.5 * abs(np.log(ahead)):
        return []
    scale, error = 1.0 / float(np.sqrt(ahead * aside)), float(max(one.errors[0] for one in gains))
    rolls = ", or the body rolls and pitches as much" if scale < 1.0 else ""
    return [_of_speed(scale, error, f"what both accelerometers imply{rolls}", scale * (1.0 - LESS) > 1.0)]


def _is_off(scale: float, error: float) -> bool:
    """Whether a scale differs from one by more than a sensor's tolerance, significantly."""
    return bool(scale > 0.0 and abs(np.log(scale)) > SPEED and abs(scale - 1.0) > SURE * error)


def _of_speed(scale: float, error: float, other: str, witnessed: bool) -> Explanation:
    return Explanation(
        f"v_x is {number(scale, 3)} times {other}. Check its scale in the column map.",
        "v_x", scale, error, "1", ((scale - 1.0) / error) ** 2, witnessed,
    )  # fmt: skip


def _steered(r: Recording) -> list[Explanation]:
    """Faults in the relation of yaw_rate to v_x · steer: an offset of steer, another vehicle in the second half."""
    if not r.has("steer", "yaw_rate"):
        return []
    v, turn, steer = (smooth(r, r[name], SMOOTHING) for name in ("v_x", "yaw_rate", "steer"))
    if not np.any(np.isfinite(v)) or not np.any(np.isfinite(v * turn)):
        return []
    moving = np.abs(v) > 0.2 * float(np.nanquantile(np.abs(v), 0.9))
    pushed = np.abs(v * turn)
    gentle = moving & (pushed < min(GENTLE, HALF_GRIP * float(np.nanquantile(pushed, 0.99))))
    columns = [turn, v**2 * turn, v]
    left = np.where(gentle, v * steer, np.nan)
    result: list[Explanation] = []
    whole = _regression(left, columns)
    left_turns = float(np.mean(turn[gentle & np.isfinite(turn)] > 0.0)) if np.any(gentle) else 0.0
    both_ways = ONE_WAY < left_turns < 1.0 - ONE_WAY  # in turns one way, nonlinear tyres look like an offset
    explained = whole is not None and whole.explained > HELD_TOGETHER and whole.values[0] > 0
    against = whole is not None and whole.explained > FITS and whole.values[0] < 0 and whole.sure(0, 0.0)
    if whole is not None and against and both_ways:
        size, strength = float(whole.values[2]), float((whole.values[0] / whole.errors[0]) ** 2)
        result.append(
            Explanation(
                f"steer has the wrong sign, hidden by an offset of {signed(size, 2)} rad: v_x · (steer − offset) "
                "falls as yaw_rate grows.",
                "steer", size, float(whole.errors[2]), "rad", strength, offset=size, sign=-1,
            )
        )  # fmt: skip
    if whole is not None and explained and both_ways and whole.sure(2, STEERING):
        size = float(whole.values[2])
        result.append(
            Explanation(
                f"steer has an offset of {signed(1000 * size, 2)} mrad: where yaw_rate is zero, v_x · steer is "
                f"{signed(size, 2)} v_x. Add the effect steering_offset to the fit, or correct the signal.",
                "steer", size, float(whole.errors[2]), "rad", float((whole.values[2] / whole.errors[2]) ** 2),
                offset=-size,
            )
        )  # fmt: skip
    second = np.arange(len(v)) >= len(v) // 2
    halves = _regression(left, [turn, turn * second, v**2 * turn, v * ~second, v * second])
    if halves is not None and halves.explained > HELD_TOGETHER and halves.values[0] > 0:
        pace = float(np.nanmedian(np.abs(v[gentle])))
        apart, error = float(halves.values[1]), float(halves.errors[1])
        lengths = [float(halves.values[0] + halves.values[2] * pace**2) + item for item in (0.0, apart)]
        if min(lengths) > 0 and abs(np.log(lengths[1] / lengths[0])) > HALF and abs(apart) > SURE * error:
            result.append(
                Explanation(
                    "The second half was recorded with another car, or steer has another scale there: v_x · steer / "
                    "yaw_rate is "
                    f"{quantity(lengths[0], 'm')} in the first half and {quantity(lengths[1], 'm')} in the second, "
                    f"at a speed of {quantity(pace, 'm/s')}. Fit each half on its own.",
                    "steer", apart, error, "m", (apart / error) ** 2,
                )
            )  # fmt: skip
    return result
