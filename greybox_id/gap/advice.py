"""What a recording could not show: detection limits of effects, which are absorbed, and what to drive."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from math import inf, isfinite

from ..base.numbers import number
from ..models.effect import Effect
from .estimation.calibration import CAL
from .examining import TINY, Examined
from .gap import Limit

MANOEUVRES = {
    frozenset({"steering", "timing"}): "a step steer at constant speed",
    frozenset({"steering"}): "step steers of several sizes at constant speed",
    frozenset({"drive", "road"}): "the same straight in both directions, then a coast-down from top speed",
    frozenset({"drive"}): "full braking and full acceleration on a straight, then a coast-down from top speed",
    frozenset({"tyres", "body"}): "a slow spiral up to the limit, then a step steer",
    frozenset({"tyres", "steering"}): "a slow spiral up to the limit at two speeds",
    frozenset({"tyres"}): "a slow spiral up to the limit",
    frozenset({"body"}): "a sweep of steering frequencies, then braking in a turn",
    frozenset({"road", "sensors"}): "the same stretch in both directions, and half a minute at rest on level ground",
    frozenset({"sensors"}): "half a minute at rest on level ground, then steady circles to both sides",
    frozenset({"sensors", "steering"}): "steady circles to both sides, and half a minute at rest",
    frozenset({"timing"}): "step steers and hard brakings",
    frozenset({"road"}): "the same straight in both directions",
}
"""Groups of effects that were not distinguished -> the manoeuvre that distinguishes them."""


COMMAND = "greybox design gap.json"
"""Command that designs the manoeuvre, from the file that greybox gap --out leaves."""


def to_drive(names: Sequence[str], effects: Mapping[str, Effect]) -> str:
    """The manoeuvre that distinguishes effects."""
    groups = frozenset(effects[name].group for name in names if name in effects)
    return MANOEUVRES.get(groups, "a mixed manoeuvre with step steers, hard brakings and a spiral up to the limit")


def to_distinguish(names: Sequence[str]) -> str:
    """Beginning of a sentence on how to distinguish effects, the likeliest first."""
    return f"To distinguish {names[0]} from {', '.join(names[1:])}"


def advice(
    sets: Sequence[Sequence[str]],
    weak: Sequence[str],
    effects: Mapping[str, Effect],
    unread: Collection[str] = (),
    apart: float = 0.0,
) -> tuple[str, ...]:
    """Sentences on what would inform a diagnosis more.

    Parameters
    ----------
    sets : effects that were not distinguished, each set with the likeliest first.
    weak : effects this recording does not excite.
    effects : by name.
    unread : outputs that no recording holds.
    apart : log-likelihood by which two searches differ that disagree about causes.
    """
    one, known = list[str](), set[frozenset[str]]()
    if apart > CAL.walks_apart:
        one.append(
            "The vehicle differs so much from its file that two searches for causes gave different results. First fit "
            "the numbers of the file (greybox fit), then repeat the diagnosis."
        )
    for item in sets:
        if frozenset(item) in known:
            continue
        known.add(frozenset(item))
        first, *others = item
        if same_readings(item):
            one.append(
                f"{first} and {' and '.join(others)} produce the same readings in every manoeuvre. To distinguish "
                "them, measure the mounting angle of the sensor."
            )
        else:
            one.append(
                f"{to_distinguish(item)}: drive {to_drive(item, effects)}. {COMMAND} designs such a manoeuvre within "
                "the area that you can drive on."
            )
    blind = [name for name in weak if name in effects and set(effects[name].touches) <= set(unread)]
    shown = [name for name in weak if name not in blind]
    alike = [name for name in shown if to_drive([name], effects) == to_drive(shown[:1], effects)]
    if alike:
        one.append(f"To detect {', '.join(alike[:4])}: drive {to_drive(alike[:1], effects)}.")
    if blind:
        missing = dict.fromkeys(signal for name in blind for signal in effects[name].touches)
        one.append(f"To detect {', '.join(blind)}: record {' and '.join(missing)}.")
    return tuple(one)


def same_readings(names: Sequence[str]) -> bool:
    """Whether effects produce the same readings whatever is driven."""
    return set(names) in ({"accel_bias_x", "imu_mount_pitch"}, {"accel_bias_y", "imu_mount_roll"})


def detection_limits(examined: Examined) -> tuple[dict[str, Limit], dict[str, str], tuple[str, ...]]:
    """Detection limits of effects that were not applied.

    Effects whose limit only a refit gives are left out.

    Returns
    -------
    limits : the least detectable first.
    weak : in words, of effects that would not be detected at their usual size.
    absorbed : effects that would not be because tolerances absorb them.
    """
    result, weak, absorbed = dict[str, Limit](), dict[str, str](), list[str]()
    for entry in examined.selection.expected_gains:
        name, axis, reach = entry.candidate.effect, entry.candidate.axes[0], 2 * entry.sd
        if name in examined.best.names or not isfinite(entry.sd):
            continue
        typical, beyond = examined.effects[name].typical, reach > axis.high - axis.low
        usual = abs(axis.coordinate(typical) - axis.null)
        size = (0.0 if beyond else 1 / reach) if axis.inverse else (inf if beyond else reach)
        result[name] = Limit(size, typical, axis.unit, reach / max(usual, TINY), entry.remaining_information)
        if reach < usual:
            continue
        if entry.remaining_information < CAL.hidden:
            absorbed.append(name)
        elif beyond:
            weak[name] = "any size"
        elif not axis.inverse:
            weak[name] = f"±{number(reach, 2)} {axis.unit}".replace(" 1", "").strip()
    return dict(sorted(result.items(), key=lambda item: -item[1].share)), weak, tuple(absorbed)
