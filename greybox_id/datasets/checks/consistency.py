"""Do the channels agree with each other: signs, units, a second copy of the same quantity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...base.numbers import exact, number, quantity
from ..recording import Recording
from .finding import Finding, FoundAt, Severity, listed, runs_words
from .pairs import Agreement, Pair, agreement, run_agreements

GAIN_RANGE = (0.5, 2.0)
"""Two ways to one quantity agree within a factor of two, whatever noise, slip and slope do; units by 3.6 or more."""
WHEELBASE_RANGE = (0.06, 15.0)
"""v_x · steer / yaw_rate in m: from the smallest model car to an understeering coach. Degrees shift it by 57."""
GIVEN_WHEELBASE = (0.4, 4.0)
"""The same as a share of the wheelbase, if that is given: understeer makes it longer, oversteer shorter."""
FACTORS = (
    (180 / np.pi, ("yaw_rate", "yaw", "steer", "sideslip"), "deg", "rad"),
    (9.80665, ("a_x", "a_y"), "g", "m/s²"),
    (3.6, ("v_x", "v_y"), "km/h", "m/s"),
    (1000.0, (), "a thousandth of the unit", "the unit"),
)
FACTOR_TOLERANCE = 1.5
"""A gain within this factor of a known unit factor is put down to that unit."""
LIMITS = {
    "steer": (1.3, "no road wheel turns so far; degrees, or the hand wheel's angle?"),
    "yaw_rate": (15.0, "no vehicle turns so fast; degrees per second?"),
    "a_x": (80.0, "no tyre pulls so hard; wrong unit?"),
    "a_y": (80.0, "no tyre pulls so hard; wrong unit?"),
    "v_x": (150.0, "faster than any road vehicle; km/h, rpm or raw counts?"),
}
"""Largest believable size (99th percentile) in SI units, for all vehicles from model car to race car."""


def check_consistency(recording: Recording, pairs: list[Pair], wheelbase: float | None = None) -> list[Finding]:
    """Sign and unit findings from the pairs of channels that must agree.

    Parameters
    ----------
    recording : what is checked.
    pairs : its pairs.
    wheelbase : in m, if known; without it only gross errors of the steering's unit show.
    """
    measured = [(pair, agreement(recording, pair.left_values, pair.right_values, pair.smoothing)) for pair in pairs]
    certain = [(pair, agreed) for pair, agreed in measured if agreed.certain]
    return [
        *_signs(certain),
        *_lateral_velocity(recording),
        *_turned_runs(recording, pairs),
        *_units(certain, wheelbase),
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
            f"{pair.left} and {pair.right} contradict each other in sign (correlation "
            f"{number(agreed.correlation, 2)}): one of them is not ISO 8855. "
        )
        left, right = (sides.get(node, [node]) for node in pair.nodes)
        ground = [side for side in (left, right) if any(node.startswith("course") for node in side)]
        if len(ground) == 1:
            wrong = right if ground[0] is left else left
            sentence += f"A course has no sign convention, so {listed(wrong)} must be clockwise-positive: turn the"
            sentence += " sign in the column map (sign = -1, or remove sign = -1)."
        else:
            sentence += (
                f"On one side stand {listed(left)}, on the other {listed(right)}; negate the "
                "wrong side (sign = -1, or remove sign = -1)."
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
        "v_y and yaw_rate contradict each other in sign in slow, gentle turns (correlation "
        f"{number(agreed.correlation, 2)}), "
        "where a point ahead of the rear axle moves towards the inside of the turn: one of them is not ISO 8855, "
        "or v_y was measured behind the rear axle."
    )
    error = 1 / np.sqrt(agreed.independent - 3)
    return [Finding("sign", Severity.WARNING, FoundAt("v_y"), sentence, agreed.correlation, error)]


def _slow_share(recording: Recording) -> NDArray[np.bool_] | None:
    """Rows slow enough that the rear axle hardly slips sideways; None where there are too few."""
    lateral = np.abs(recording["v_x"] * recording["yaw_rate"])
    speed = np.abs(recording["v_x"])
    # Slip angles grow with a_y, the rolling part of v_y/v_x with path curvature: large curvature at little a_y.
    rows = (lateral < 2.0) & (speed > 1.0) & (np.abs(recording["yaw_rate"]) > 0.01 * speed)
    return rows if np.count_nonzero(rows) * recording.sample_time > 10.0 else None


def _turned_runs(recording: Recording, pairs: list[Pair]) -> list[Finding]:
    """Runs whose sign differs from that of other runs."""
    findings = []
    for pair in pairs if len(recording.runs) > 1 else []:
        parts = run_agreements(recording, pair.left_values, pair.right_values, pair.smoothing)
        certain = {number: part.correlation < 0 for number, part in parts.items() if part.certain}
        turned = [number for number, negative in certain.items() if negative]
        if len(turned) == len(certain):
            continue  # all alike: told for the whole recording
        if turned:
            where = FoundAt(pair.nodes[0], turned[0] if len(turned) == 1 else None)
            sentence = (
                f"{pair.left} and {pair.right} contradict each other in sign in {runs_words(turned)}, "
                "though they agree elsewhere: a sensor was mounted or wired the other way round."
            )
            findings.append(Finding("sign", Severity.DISTRUST, where, sentence, float(len(turned))))
    return findings


def _units(certain: list[tuple[Pair, Agreement]], wheelbase: float | None) -> list[Finding]:
    findings = []
    for pair, agreed in certain:
        gain, error = abs(agreed.gain), abs(agreed.gain) / np.sqrt(agreed.independent)
        if pair.kinematic:
            low, high = GAIN_RANGE
            if not low < gain < high:
                sentence = (
                    f"{pair.left} is {number(gain)} times {pair.right}, where 1 is expected: {_blame(pair, gain)}"
                )
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
                    f"yaw_rate and v_x · steer give a wheelbase of {number(length)} m, where {exact(shortest, 2)} to "
                    f"{exact(longest)} m is plausible: {_blame(pair, gain * likely, wheelbase is None)}"
                )
                error = length / np.sqrt(agreed.independent)
                findings.append(Finding("unit", Severity.DISTRUST, FoundAt("steer"), sentence, length, error, "m"))
    return findings


def _blame(pair: Pair, gain: float, loosely: bool = False) -> str:
    """Which unit slipped, if the gain is near a known factor; `loosely` takes the nearest of the pair's own kinds."""
    for factor, kinds, foreign, ours in FACTORS:
        names = [name for name in pair.channels if name in kinds]
        ratio = abs(np.log(gain)) / np.log(factor)
        near = abs(abs(np.log(gain)) - np.log(factor)) < np.log(FACTOR_TOLERANCE)
        if names and (near or (loosely and ratio > 0.3)):
            upper = pair.channels[0] in names  # the left side's own channel
            large = f"{pair.channels[0]} as if in {foreign} and called {ours}" if upper else ""
            rest = [name for name in names if name != pair.channels[0]]
            small = f"{listed(rest)} as if in {ours} and called {foreign}" if rest else ""
            if gain < 1:
                large = f"{pair.channels[0]} as if in {ours} and called {foreign}" if upper else ""
                small = f"{listed(rest)} as if in {foreign} and called {ours}" if rest else ""
            return (
                f"{' or '.join(filter(None, [large, small]))} (factor {exact(factor)}). "
                "Check the unit in the column map."
            )
    return "check unit and scale of both in the column map."


def _limits(recording: Recording) -> list[Finding]:
    findings = []
    for name, (limit, why) in LIMITS.items():
        if recording.has(name):
            size = float(np.nanquantile(np.abs(recording[name]), 0.99))
            if size > limit:
                unit = recording.unit(name)
                sentence = f"{name} reaches {quantity(size, unit)} (99th percentile of its size): {why}"
                findings.append(Finding("unit", Severity.DISTRUST, FoundAt(name), sentence, size, None, unit))
    return findings
