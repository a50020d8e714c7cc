"""Checks that channels agree: in signs and units, with duplicate channels, and with standstill."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from ...base.numbers import exact, number, pretty_unit, quantity, short_with_sd, with_unit
from ...base.signals import DRIVE_SIGNALS, SIGNALS
from ...base.statistics import moving_mean
from ..recording import Recording
from .finding import Finding, FoundAt, Severity, listed, runs_words
from .pairs import Agreement, Pair, agreement, run_agreements

GAIN_RANGE = (0.5, 2.0)
"""Two measurements of a quantity agree within a factor of two despite noise, slip and slope; units differ by >= 3.6."""
WHEELBASE_RANGE = (0.06, 15.0)
"""v_x · steer / yaw_rate in m: from the smallest model car to an understeering coach. Degrees change it by 57."""
GIVEN_WHEELBASE = (0.4, 4.0)
"""The same as a share of the wheelbase, if that is given: understeer makes it larger, oversteer smaller."""
FACTORS = (
    (180 / np.pi, ("yaw_rate", "yaw", "steer", "sideslip"), "deg", "rad"),
    (9.80665, ("a_x", "a_y"), "g", "m/s²"),
    (3.6, ("v_x", "v_y"), "km/h", "m/s"),
    (1000.0, (), "a thousandth of the unit", "the unit"),
)
FACTOR_TOLERANCE = 1.5
"""A gain within this factor of a known unit factor is attributed to that unit."""
UNKNOWN = "check unit and scale of both in the column map."
"""Advice if the factor is not that of a known unit."""
LIMITS = {
    "steer": (1.3, "no road wheel turns so far; is it in degrees, or the hand wheel's angle?"),
    "yaw_rate": (15.0, "no vehicle turns so fast; is it in degrees per second?"),
    "a_x": (80.0, "no tyre can accelerate a vehicle so much; is the unit wrong?"),
    "a_y": (80.0, "no tyre can accelerate a vehicle so much; is the unit wrong?"),
    "v_x": (150.0, "no road vehicle is so fast; is it in km/h, rpm or raw counts?"),
}
"""Largest plausible magnitude (99th percentile) in SI units, for all vehicles from model car to race car."""


def check_consistency(recording: Recording, pairs: list[Pair], wheelbase: float | None = None) -> list[Finding]:
    """Sign and unit findings from pairs of channels that must agree.

    Parameters
    ----------
    recording : the recording to check.
    pairs : its pairs of channels.
    wheelbase : in m, if known; without it only gross errors of the steering's unit are detected.
    """
    measured = [(pair, agreement(recording, pair.left_values, pair.right_values, pair.smoothing)) for pair in pairs]
    certain = [(pair, agreed) for pair, agreed in measured if agreed.certain]
    return [
        *_signs(certain),
        *_lateral_velocity(recording),
        *_turned_runs(recording, pairs),
        *_units(certain, wheelbase, recording.sample_time),
        *_limits(recording),
    ]


def _signs(certain: list[tuple[Pair, Agreement]]) -> list[Finding]:
    against = [(pair, agreed) for pair, agreed in certain if agreed.correlation < 0]
    if not against:
        return []
    sides = _two_sides([(pair.nodes, agreed.correlation > 0) for pair, agreed in certain])
    findings = []
    for pair, agreed in against:
        sentence = (
            f"{pair.left} and {pair.right} have opposite signs (correlation {number(agreed.correlation, 2)}), so one "
            "of "
            "them does not follow ISO 8855 (positive to the left). "
        )
        left, right = (sides.get(node, [node]) for node in pair.nodes)
        ground = [side for side in (left, right) if any(node.startswith("course") for node in side)]
        if len(ground) == 1:
            wrong = right if ground[0] is left else left
            sentence += (
                f"The course does not depend on a sign convention, so {listed(wrong)} must be positive to the right: "
                f"in the column map, negate {'it' if len(wrong) == 1 else 'them'} (set sign = -1, or remove it)."
            )
        else:
            sentence += (
                f"In the column map, negate either {listed(left)} or {listed(right)} (set sign = -1, or remove it)."
            )
        findings.append(
            Finding("sign", Severity.DISTRUST, FoundAt(pair.nodes[0]), sentence, agreed.correlation,
                    1 / np.sqrt(agreed.independent - 3))
        )  # fmt: skip
    return findings


def _two_sides(edges: list[tuple[tuple[str, str], bool]]) -> dict[str, list[str]]:
    """For each channel, all channels that agree with it in sign, directly or through others."""
    side: dict[str, list[str]] = {}
    for (a, b), same in edges:
        left, right = side.setdefault(a, [a]), side.setdefault(b, [b])
        if same and left is not right:
            left += right
            for node in right:
                side[node] = left
    return side


def _lateral_velocity(recording: Recording) -> list[Finding]:
    """The sign of v_y against yaw_rate: v_y = (a - b v_x^2) yaw_rate, where a > 0 ahead of the rear axle and b > 0."""
    if not all(name in recording for name in ("v_x", "v_y", "yaw_rate")):
        return []
    slow = _slow_share(recording)
    if slow is None:
        return []
    left = np.where(slow, recording["v_y"], np.nan)
    agreed = agreement(recording, left, recording["yaw_rate"], 0.2)
    if not agreed.certain or agreed.correlation > 0:
        return []
    sentence = (
        f"v_y and yaw_rate have opposite signs in slow, gentle turns (correlation {number(agreed.correlation, 2)}), "
        "although a point ahead of the rear axle moves towards the inside of such a turn. One of the two signals does "
        "not follow ISO 8855 (positive to the left), or v_y was measured behind the rear axle."
    )
    error = 1 / np.sqrt(agreed.independent - 3)
    return [Finding("sign", Severity.WARNING, FoundAt("v_y"), sentence, agreed.correlation, error)]


def _slow_share(recording: Recording) -> NDArray[np.bool_] | None:
    """Rows slow enough that the rear axle has hardly any side slip; None if they are too few."""
    lateral = np.abs(recording["v_x"] * recording["yaw_rate"])
    speed = np.abs(recording["v_x"])
    # Slip angles grow with a_y, the kinematic part of v_y/v_x with path curvature: large curvature at small a_y.
    rows = (lateral < 2.0) & (speed > 1.0) & (np.abs(recording["yaw_rate"]) > 0.01 * speed)
    return rows if np.count_nonzero(rows) * recording.sample_time > 10.0 else None


def _turned_runs(recording: Recording, pairs: list[Pair]) -> list[Finding]:
    """Runs in which a sign differs from that of other runs."""
    findings = []
    for pair in pairs if len(recording.runs) > 1 else []:
        parts = run_agreements(recording, pair.left_values, pair.right_values, pair.smoothing)
        certain = {number: part.correlation < 0 for number, part in parts.items() if part.certain}
        turned = [number for number, negative in certain.items() if negative]
        if len(turned) == len(certain):
            continue  # all runs have the same sign: reported for the whole recording
        if turned:
            where = FoundAt(pair.nodes[0], turned[0] if len(turned) == 1 else None)
            sentence = (
                f"{pair.left} and {pair.right} have opposite signs in {runs_words(turned)}, but the same sign in the "
                "other runs: a sensor was mounted or wired the other way round."
            )
            findings.append(Finding("sign", Severity.DISTRUST, where, sentence, float(len(turned))))
    return findings


def _units(certain: list[tuple[Pair, Agreement]], wheelbase: float | None, step: float) -> list[Finding]:
    findings, (low, high) = [], GAIN_RANGE
    sound = {
        name for pair, agreed in certain if pair.kinematic and low < abs(agreed.gain) < high for name in pair.channels
    }
    for pair, agreed in certain:
        gain, error = abs(agreed.gain), abs(agreed.gain) / np.sqrt(agreed.independent)
        if pair.kinematic:
            if not low < gain < high:
                blame = _blame(pair, gain, sound=sound)
                if blame == UNKNOWN and pair.right.endswith("/dt"):
                    blame = (
                        f"the sampling rate or the unit of time is wrong (both would agree at {number(gain / step)} "
                        "rows "
                        "per second), or "
                    )
                    blame += UNKNOWN
                sentence = f"{pair.left} is {number(gain)} times {pair.right}, but should be equal to it: {blame}"
                place = FoundAt(pair.nodes[0])
                findings.append(Finding("unit", Severity.DISTRUST, place, sentence, gain, error))
        elif pair.nodes == ("yaw_rate", "steer"):
            length = 1 / gain
            shortest, longest = WHEELBASE_RANGE
            if wheelbase is not None:
                shortest, longest = (share * wheelbase for share in GIVEN_WHEELBASE)
            if not shortest < length < longest:
                likely = wheelbase or np.sqrt(shortest * longest)
                sentence = (
                    f"yaw_rate and v_x · steer give a wheelbase of {number(length)} m; {exact(shortest, 2)} to "
                    f"{exact(longest)} m would be plausible: {_blame(pair, gain * likely, wheelbase is None)}"
                )
                error = length / np.sqrt(agreed.independent)
                findings.append(Finding("unit", Severity.DISTRUST, FoundAt("steer"), sentence, length, error, "m"))
    return findings


def _blame(pair: Pair, gain: float, loosely: bool = False, sound: Collection[str] = ()) -> str:
    """Unit error that explains a gain near a known factor; `loosely` also accepts the nearest factor of the pair's
    kinds.

    `sound` are channels that agree with other channels and are not to blame.
    """
    for factor, kinds, foreign, ours in FACTORS:
        names = [name for name in pair.channels if name in kinds and name not in sound]

        ratio = abs(np.log(gain)) / np.log(factor)
        near = abs(abs(np.log(gain)) - np.log(factor)) < np.log(FACTOR_TOLERANCE)
        if names and (near or (loosely and ratio > 0.3)):
            first = names[:1] if pair.channels[0] in names else []  # the left side's channel
            rest = [name for name in names if name not in first]
            large = _slipped(first, foreign, ours) if gain >= 1 else _slipped(first, ours, foreign)
            small = _slipped(rest, ours, foreign) if gain >= 1 else _slipped(rest, foreign, ours)
            return (
                f"{', or '.join(filter(None, [large, small]))} (a factor of {exact(factor)}). "
                "Check these units in the column map."
            )
    return UNKNOWN


def _slipped(names: Sequence[str], looks: str, says: str) -> str:
    """Words for channels that may have one unit where another was assumed."""
    per = "/s" if list(names) == ["yaw_rate"] and "rad" in (looks, says) else ""
    return f"{listed(names)} may be in {looks}{per} instead of {says}{per}" if names else ""


def _limits(recording: Recording) -> list[Finding]:
    findings = []
    for name, (limit, why) in LIMITS.items():
        if recording.has(name):
            size = float(np.nanquantile(np.abs(recording[name]), 0.99))
            if size > limit:
                unit = recording.unit(name)
                sentence = f"{name} reaches {quantity(size, unit)} (99th percentile of its magnitude): {why}"
                findings.append(Finding("unit", Severity.DISTRUST, FoundAt(name), sentence, size, None, unit))
    return findings


REST_SHARE = 0.003
"""Share of the top speed below which the vehicle is at rest ..."""
REST_SECONDS = 1.0
"""... for at least this many s; a quarter is cut off at each end, where the vehicle settles."""
STANDS, STANDING_MEAN = 0.01, 0.5
"""Under the brake it stands if its mean speed over this many s (the second) is below this share of the top speed."""
CHANNELS = {"yaw_rate": 0.002, "a_x": 0.02, "a_y": 0.02}
"""Channels that read zero at rest on flat ground, and the offset below which none is reported (rad/s, m/s^2)."""


def check_rest(recording: Recording) -> list[Finding]:
    """Significant offsets of gyro and accelerometers at rest, one finding each."""
    if "v_x" not in recording:
        return []
    stretches = [np.arange(a, b) for a, b in _rests(recording)]
    findings = []
    for name, negligible in CHANNELS.items():
        means = [float(np.mean(recording[name][rows])) for rows in stretches] if name in recording else []
        if not means or not np.isfinite(means).all():
            continue
        weights = np.array([len(rows) for rows in stretches], dtype=float)
        offset = float(np.average(means, weights=weights))
        error = _uncertainty(recording, name, stretches, np.array(means), weights)
        if abs(offset) < max(negligible, 3 * error):
            continue
        unit, seconds = recording.unit(name), weights.sum() * recording.sample_time
        shown = f"{'+' if offset > 0.0 else ''}{short_with_sd(offset, error)}"
        cause = "the sensor has an offset" + (" or the ground slopes" if name != "yaw_rate" else "")
        sentence = (
            f"{name} reads {with_unit(shown, unit)} at rest ({seconds:.1f} s in {len(stretches)} "
            f"standstill{'s' if len(stretches) > 1 else ''}): {cause}."
        )
        findings.append(Finding("offset", Severity.WARNING, FoundAt(name), sentence, offset, error, unit))
    return findings


def standing(recording: Recording) -> NDArray[np.bool_]:
    """(n,) whether the vehicle stands under its brake for at least a second; False if that cannot be determined."""
    result = np.zeros(len(recording), dtype=bool)
    braked = np.zeros(len(recording), dtype=bool)
    for name in DRIVE_SIGNALS:
        braked |= recording[name] < 0 if recording.has(name) else False
    braked |= recording["brake"] > 0 if recording.has("brake") else False
    if not recording.has("v_x") or not braked.any():
        return result
    least = STANDS * float(np.nanquantile(np.abs(recording["v_x"]), 0.99))
    width = 2 * int(round(0.5 * STANDING_MEAN / recording.sample_time)) + 1
    shortest = int(round(REST_SECONDS / recording.sample_time))
    for start, stop in recording.runs:
        if stop - start <= max(width, shortest):
            continue
        pace = np.abs(moving_mean(recording["v_x"][start:stop], width))
        still = (pace <= least) & braked[start:stop]
        edges = np.flatnonzero(np.diff(still.astype(int), prepend=0, append=0)) + start
        for a, b in zip(edges[::2], edges[1::2], strict=True):
            result[a:b] = b - a >= shortest
    return result


def _rests(recording: Recording) -> list[tuple[int, int]]:
    speed = np.abs(recording["v_x"])
    top = float(np.nanquantile(speed, 0.99)) if np.isfinite(speed).any() else 0.0
    still: NDArray[np.bool_] = speed <= REST_SHARE * top
    if top == 0.0:
        return []
    shortest = max(6, int(round(REST_SECONDS / recording.sample_time)))
    rests = []
    for start, stop in recording.runs:
        edges = np.flatnonzero(np.diff(still[start:stop].astype(int), prepend=0, append=0)) + start
        for a, b in zip(edges[::2], edges[1::2], strict=True):
            if b - a >= shortest:
                settle = (b - a) // 4
                rests.append((int(a) + settle, int(b) - settle))
    return rests


def _uncertainty(
    recording: Recording,
    name: str,
    stretches: list[NDArray[np.int_]],
    means: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> float:
    """Standard error of the mean: from scatter between standstills, or within one if 5 samples count as one."""
    within = np.concatenate([recording[name][rows] - m for rows, m in zip(stretches, means, strict=True)])
    inside = float(np.std(within)) * np.sqrt(5.0 / len(within))
    if len(means) < 2:
        return float(inside)
    share = weights / weights.sum()
    centre = float(share @ means)
    between = np.sqrt(np.sum(share**2 * (means - centre) ** 2) * len(means) / (len(means) - 1))
    return float(max(inside, between))


SAME = 0.9
"""Correlation in at least one run from which a channel of the same unit counts as a duplicate of the signal."""
DIFFERENT = 0.7
"""Correlation below which the duplicate does not follow the signal in a run."""
CLOSE_GAINS = (0.7, 1.4)
"""Gains of a duplicate in the same unit, ideally 1; sensors at two places of a vehicle differ by a few per cent."""
LEAST_SAMPLES = 5
"""Fewest independent samples of a run to be compared."""
LEAST_SPREAD = 0.2
"""Runs in which the signal spreads by less than this share of its spread over all runs are not compared."""


def check_duplicates(recording: Recording) -> list[Finding]:
    """Findings about extra channels that duplicate a signal."""
    findings: list[Finding] = []
    for extra in recording.signals:
        if extra in SIGNALS:
            continue
        for signal in recording.signals:
            if signal in SIGNALS and recording.unit(signal) == recording.unit(extra):
                findings += _compare(recording, extra, signal)
    return findings


def _compare(recording: Recording, extra: str, signal: str) -> list[Finding]:
    spread = _spread(recording, signal, recording.runs)
    parts = run_agreements(recording, recording[extra], recording[signal], 0.2)
    each = {
        number: part
        for number, part in parts.items()
        if part.independent >= LEAST_SAMPLES
        and _spread(recording, signal, (recording.runs[number - 1],)) > LEAST_SPREAD * spread
    }
    whole = agreement(recording, recording[extra], recording[signal], 0.2)
    copies = [a.correlation for a in [*each.values(), whole] if a.beyond_chance and abs(a.correlation) > SAME]
    if not copies:
        return []
    unit = recording.unit(extra)
    findings = []
    turned = [n for n, a in each.items() if a.beyond_chance and a.correlation < 0]
    if whole.beyond_chance and whole.correlation < 0:
        by = number(whole.correlation, 2)
        sentence = f"{extra} is {signal} with the opposite sign (correlation {by}); set its sign = -1."
        findings.append(Finding("sign", Severity.WARNING, FoundAt(extra), sentence, whole.correlation))
    elif turned:
        sentence = f"{extra} has the opposite sign of {signal} in {runs_words(turned)}."
        findings.append(Finding("sign", Severity.WARNING, FoundAt(extra), sentence, float(len(turned))))
    off = [n for n, a in each.items() if abs(a.correlation) < DIFFERENT]
    if off:
        low = min(each[n].correlation for n in off)
        sentence = (
            f"{extra} follows {signal}, but not in {runs_words(off)} (correlation down to {number(low, 2)}): use one "
            "of "
            "them, not both."
        )
        findings.append(
            Finding("duplicate", Severity.WARNING, FoundAt(extra, off[0] if len(off) == 1 else None), sentence, low)
        )
    scales = {
        n: abs(a.gain) for n, a in each.items() if a.beyond_chance and not CLOSE_GAINS[0] < abs(a.gain) < CLOSE_GAINS[1]
    }
    if scales:
        worst = max(scales, key=lambda n: abs(np.log(scales[n])))
        sentence = (
            f"{extra} is {number(scales[worst])} times {signal} in {runs_words(scales)}; the factor should be 1: "
            f"check its unit (the column map says {pretty_unit(unit)}) or its calibration."
        )
        findings.append(Finding("unit", Severity.WARNING, FoundAt(extra), sentence, scales[worst]))
    return findings


def _spread(recording: Recording, name: str, runs: tuple[tuple[int, int], ...]) -> float:
    values = np.concatenate([recording[name][start:stop] for start, stop in runs])
    values = values[np.isfinite(values)]
    return float(np.subtract(*np.quantile(values, [0.95, 0.05]))) if values.size else 0.0
