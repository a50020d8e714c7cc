"""Sentences on a diagnosis, for any numbers, shared by terminal and report."""

from __future__ import annotations

from dataclasses import dataclass
from math import fsum, inf, isfinite, sqrt

from ...base.numbers import (
    capital,
    interval,
    listed,
    number,
    percent,
    pretty_unit,
    short_with_sd,
    the_recordings,
    together,
    whole_percent,
)
from ...base.statistics import NORMAL
from ...fitting.scores.verdict import MANY
from ...gap.estimation.calibration import CAL
from ...gap.estimation.varying import PATH, MagnitudeCourse
from ...gap.gap import CauseClass, Closure, Gap, Ranked
from ...models.effects import EFFECTS

LOPSIDED = 1.3
"""Ratio of the two sides of an interval above which it is printed instead of the standard deviation."""
SMALLER = {"s": (1.0, "ms"), "rad": (0.1, "mrad"), "rad/s": (0.1, "mrad/s"), "m": (0.1, "mm")}
"""Unit -> size below which its thousandth is used instead, and name of that."""


@dataclass(frozen=True)
class Handy:
    """A unit suited to the size of a number.

    Attributes
    ----------
    factor : by which numbers in the SI unit are multiplied.
    unit : as printed; "" for pure numbers.
    """

    factor: float
    unit: str


def handy(unit: str, size: float) -> Handy:
    """The most readable unit for a number of this size, such as ms for s below one."""
    below, smaller = SMALLER.get(unit, (0.0, ""))
    if smaller and isfinite(size) and 0.0 < abs(size) < below:
        return Handy(1000.0, smaller)
    return Handy(1.0, "" if unit in ("", "1") else pretty_unit(unit))


def handy_of(ranked: Ranked) -> Handy:
    """The most readable unit for an effect's magnitude."""
    ends = [abs(end) for end in ranked.interval if isfinite(end)]
    return handy(ranked.unit, ranked.magnitude or max(ends, default=0.0))


def is_factor(effect: str) -> bool:
    """Whether an effect's magnitude is a factor, with 1 for the absent effect."""
    definition = EFFECTS.get(effect)
    return definition is not None and definition.parameter.unit == "1" and float(definition.parameter.array) == 1.0


def magnitude_words(ranked: Ranked) -> str:
    """Magnitude of an effect and when it acts, then its other parameters: "8 ± 1 m/s, wind_direction 1.0 rad"."""
    definition = EFFECTS.get(ranked.effect)
    units = {other.name: other.unit for other in definition.others} if definition is not None else {}
    behind = [
        f"{name} {number(value, 2)} {handy(units.get(name, ''), inf).unit}" for name, value in ranked.others.items()
    ]
    return ", ".join((main_words(ranked), *(item.strip() for item in behind)))


def main_words(ranked: Ranked) -> str:
    """Magnitude as "31 ± 3 ms", "× 0.84 ± 0.02 from 41 s on", or "18 ms [5, 60]" if the interval is asymmetric."""
    return " ".join(filter(None, (_size_words(ranked), when_words(ranked))))


def before_words(ranked: Ranked, mean: float) -> str:
    """Magnitude of an effect before, in the unit of its present magnitude."""
    handy_unit = handy_of(ranked)
    return f"{'× ' if is_factor(ranked.effect) else ''}{number(handy_unit.factor * mean, 2)} {handy_unit.unit}".strip()


def unchanged_words(name: str, size: float) -> str:
    """An effect that did not change, with the largest change not excluded; factors in per cent."""
    handy_unit = handy(EFFECTS[name].parameter.unit if name in EFFECTS else "", size)
    within = percent(size) if is_factor(name) else f"{number(handy_unit.factor * size, 2)} {handy_unit.unit}".strip()
    return f"{name} (± {within})"


def when_words(ranked: Ranked) -> str:
    """Time from which or until which an effect acts; "" if it acts all the time."""
    if ranked.since is not None:
        return f"from {number(ranked.since)} s on ({ranked.within})"
    return f"until {number(ranked.until)} s ({ranked.within})" if ranked.until is not None else ""


def carried_over(gap: Gap) -> list[str]:
    """What the closed model, which is constant in time, includes of effects that begin or end within a recording."""
    sentences = []
    for one in gap.ranking:
        if one.effect in gap.applied and one.since is not None:
            sentences.append(
                f"the effect {one.effect} begins in {one.within} at {number(one.since)} s: the closed model includes "
                "it, and "
                "describes the vehicle only from then on"
            )
        elif one.effect in gap.applied and one.until is not None:
            sentences.append(
                f"the effect {one.effect} ends in {one.within} at {number(one.until)} s: the closed model omits it, "
                "and "
                "describes the vehicle only from then on"
            )
    return sentences


def _size_words(ranked: Ranked) -> str:
    handy_unit, (low, high) = handy_of(ranked), ranked.interval
    value = handy_unit.factor * ranked.magnitude
    before, behind = ("× " if is_factor(ranked.effect) else ""), (f" {handy_unit.unit}" if handy_unit.unit else "")
    arms = (high - ranked.magnitude, ranked.magnitude - low)
    if not any(isfinite(arm) for arm in arms):
        return f"{before}{number(value)}{behind}"  # no interval is known
    if not all(isfinite(arm) for arm in arms) or high <= low:
        return f"{before}{number(value)}{behind} {interval_words(ranked, unit=False)}"
    if min(arms) <= 0.0 or max(arms) > LOPSIDED * min(arms):
        digits = together(value, by=handy_unit.factor * (high - low) / 4)
        shown = digits.words[0] if not digits.power else number(value)
        return f"{before}{shown}{behind} {interval_words(ranked, unit=False)}"
    return f"{before}{short_with_sd(value, handy_unit.factor * sum(arms) / (2 * NORMAL))}{behind}"


def interval_words(ranked: Ranked, unit: bool = True) -> str:
    """Interval such as "[25, 37] ms", to the digits of its width; an end that is not finite as ∞."""
    handy_unit = handy_of(ranked)
    low, high = (handy_unit.factor * end for end in ranked.interval)
    behind = f" {handy_unit.unit}" if handy_unit.unit and unit else ""
    if not (isfinite(low) and isfinite(high) and high > low):
        return f"[{number(low)}, {number(high)}]{behind}"
    return f"{interval(low, high, (high - low) / 4)}{behind}"


REGIMES = {
    "any": "evenly spread over the drive",
    "straight": "driving straight on",
    "lateral": "in turns",
    "high_lateral": "in hard turns",
    "transient": "while the steering moves",
    "acceleration": "while accelerating",
    "braking": "while braking",
    "combined": "turning while braking or accelerating",
    "high_speed": "at high speed",
    "time_drift": "late in the drive",
}
"""Regime -> phrase at the end of a sentence."""
MOST_SHARES = 3
"""Most equations named as location of the gap, and most parameters named that left their tolerances."""
LEAST_SHARE = 0.1
"""Smallest share of the gap that is named."""
MOST_DOUBTS = 3
"""Most doubts listed before the results; the others are counted."""
SLIGHT = 1.05
"""Ratio of error to noise up to which an excess, a tenth of the mean square, need not be detected (`CAL.shows`)."""
CONCENTRATED = 1.2
"""Least ratio of a regime's share of the gap to its share of the time for which both are named."""


def p_words(p: float) -> str:
    """The p-value in words: probability of such errors by noise alone."""
    if not isfinite(p):
        return "p not known"
    return "p\u00a0<\u00a00.001" if p < 0.001 else f"p\u00a0=\u00a0{number(p, 2)}"


def whether(gap: Gap) -> str:
    """Whether there is a gap; if free runs spin, also what was used instead."""
    return f"{_whether(gap)} {gap.held}." if gap.held else _whether(gap)


def _whether(gap: Gap) -> str:
    if not gap.gap_detected and not gap.noise_stated:
        return (
            f"No named effect explains this recording better than the model alone ({p_words(gap.p_value)}). "
            "The vehicle file states no sensor noise, so the residuals were taken as noise: whether there is a gap is "
            "unknown."
        )
    beyond = [item for item in gap.moved if item.far > CAL.tolerated_sd]
    suffices = ["noise", *([] if beyond else ["stated tolerances"]), *_unknown_forces(gap)]
    if not gap.gap_detected and beyond:
        far = listed([f"{item.name} is {number(item.far, 2)}" for item in beyond[:MOST_SHARES]])
        return (
            f"No named effect is needed ({p_words(gap.p_value)}). Simulation and vehicle agree within "
            f"{listed(suffices)} if {far} standard deviations from its stated value{_largest(gap)}. A wrong tyre "
            "model or an unmodelled effect would have the same symptoms."
        )
    if not gap.gap_detected:
        return (
            f"No gap: simulation and vehicle agree within {listed(suffices)} ({p_words(gap.p_value)})"
            f"{' if parameters are re-estimated within their tolerances' if gap.moved else ''}{_largest(gap)}."
        )
    return f"The simulation deviates from the vehicle{_largest(gap)} ({p_words(gap.p_value)})."


def _unknown_forces(gap: Gap) -> list[str]:
    """Unknown forces that explain errors beyond noise in free run, if there is no gap."""
    most = max((ratio for ratio in gap.where.channels.values() if isfinite(ratio)), default=1.0)
    if gap.unnamed is None or most < SLIGHT:
        return []
    sizes = [size for size in gap.unnamed.sizes if isfinite(size)] or [gap.unnamed.share_y, gap.unnamed.share_x]
    return [f"unknown forces of {percent(max(sizes))} of the modelled forces (their effects add up along a free run)"]


def _largest(gap: Gap) -> str:
    """The channel with the largest deviation, as the end of a sentence."""
    channels = {name: ratio for name, ratio in gap.where.channels.items() if isfinite(ratio)}
    if not channels:
        size = sqrt(gap.gap.before) if gap.gap.before > 0 else float("nan")
        return f": its errors are {number(size, 2)} times the noise" if isfinite(size) else ""
    name = gap.where.channel if gap.where.channel in channels else max(channels, key=lambda item: channels[item])
    times = f"{number(channels[name], 2) if channels[name] < MANY else f'over {MANY}'} times its noise"
    if gap.gap_detected and channels[name] < SLIGHT and gap.applied:
        return f"; in free run it hardly does: the largest error, that of {name}, is {times}"
    if gap.gap_detected:
        refitted = ", with tolerances refitted," if gap.moved else ""
        return f": in free run{refitted} the error of {name} is {times}"
    return f"; the largest error in free run, that of {name}, is {times}"


def where(gap: Gap) -> list[str]:
    """Location of the gap by equation, regime and time; empty if there is none."""
    if not gap.gap_detected:
        return []
    places = (("By equation", _equations(gap)), ("By driving", _regime(gap)), ("By time", _time(gap)))
    return [f"{lead}: {clause}" for lead, clause in places if clause]


def _equations(gap: Gap) -> str:
    shares = sorted(gap.where.equations.items(), key=lambda item: -item[1])
    named = [f"{percent(share)} of the gap in {name}" for name, share in shares[:MOST_SHARES] if share >= LEAST_SHARE]
    return listed(named) or f"mostly in {gap.where.channel}"


def _regime(gap: Gap) -> str:
    where = gap.where
    time, share = where.regimes.get(where.regime, (float("nan"), float("nan")))
    if where.regime == "any":
        return REGIMES["any"]
    place = REGIMES.get(where.regime, where.regime)
    if isfinite(time) and isfinite(share) and share > CONCENTRATED * time:
        return f"{percent(share)} of the gap {place}, in {percent(time)} of the time"
    return f"mostly {place}"


def _time(gap: Gap) -> str:
    time = gap.where.time
    if not {"from", "to"} <= time.keys():
        return ""
    share = f" ({percent(time['share'])} of the time)" if isfinite(time.get("share", float("nan"))) else ""
    return f"50 % of the gap lies between {time['from']:.1f} and {time['to']:.1f} s{share}"


def told_apart(gap: Gap, ranked: Ranked) -> str:
    """Effects that one cannot be distinguished from, by rank, or by name if they are not ranked."""
    if not ranked.indistinguishable_from:
        return ""
    place = {item.effect: k for k, item in enumerate(gap.ranking, 1)}
    ranked_as = [f"number {k}" for k in sorted(place[name] for name in ranked.indistinguishable_from if name in place)]
    names = [name for name in ranked.indistinguishable_from if name not in place]
    return f"cannot be distinguished from {listed([*ranked_as, *names])} on {on_these(gap.recordings)}"


def on_these(recordings: tuple[str, ...]) -> str:
    """One recording or several, as the end of a sentence."""
    return "this recording" if len(recordings) < 2 else "these recordings"


def which(gap: Gap) -> str:
    """The most probable effects in a sentence; "" if there is no gap."""
    if not gap.gap_detected:
        return ""
    if not gap.ranking:
        return "no named effect stands out"
    first = [item for item in gap.ranking if item.effect in gap.applied] or [gap.ranking[0]]
    classes = {item.applied: item for item in gap.classes if item.applied and len(item.members) > 1}
    named = [_named(item, classes.get(item.effect)) for item in first]
    others = dict.fromkeys(name for item in first if item.effect not in classes for name in item.indistinguishable_from)
    apart = f"; cannot be distinguished from {listed([*others])} on {on_these(gap.recordings)}" if others else ""
    return f"{'' if gap.applied else 'nothing applied; most probable '}{listed(named)}{apart}"


def _named(ranked: Ranked, alike: CauseClass | None) -> str:
    """An effect with its probability, or with that of its class of similar effects and of each member."""
    if alike is None:
        return f"{ranked.effect}, {magnitude_words(ranked)} (probability {probability_words(ranked.probability)})"
    each = ", ".join(f"{name} {probability_words(p)}" for name, p in alike.each.items())
    return (
        f"one of {listed([*alike.members])} (probability {probability_words(alike.probability)}; {each}), of which "
        f"{ranked.effect}, {magnitude_words(ranked)}, fits best and is applied"
    )


def verdict(gap: Gap) -> list[tuple[str, str]]:
    """The whole result as pairs of lead and sentence; doubts about the data come first."""
    closure, held_out = judged(gap)
    pairs = [
        *(("Doubt", doubt) for doubt in gap.doubts[:MOST_DOUBTS]),
        ("", f"and {more} more doubts" if (more := len(gap.doubts) - MOST_DOUBTS) > 0 else ""),
        ("Gap", whether(gap)),
        ("Where", ". ".join(where(gap))),
        ("Cause", which(gap)),
        ("Budget", budget(gap)),
        (
            "Errors",
            ". ".join(
                capital(words)
                for words in (
                    how_far(gap, closure, held_out),
                    levels(closure),
                    as_it_stands(gap, closure),
                    *carried_over(gap),
                )
                if words
            ),
        ),
        ("Remains", left(gap)),
    ]
    return [(lead, sentence) for lead, sentence in pairs if sentence]


def budget(gap: Gap) -> str:
    """Share of the excess error that each effect closes, in a sentence; "" if there is no budget."""
    if gap.budget is None:
        return ""
    shares = [
        f"{share.effect} {whole_percent(share.share)} % [{whole_percent(share.low)}, {whole_percent(share.high)}]"
        for share in (*gap.budget.shares, gap.budget.unnamed)
    ]
    place = "held out" if gap.budget.held_out else "from which the effects were chosen"
    return (
        f"shares of the excess error (the error beyond noise) on {the_recordings(gap.budget.recordings)} ({place}): "
        f"{listed(shares)}"
    )


def judged(gap: Gap) -> tuple[Closure, bool]:
    """The closure on held-out recordings, or on the diagnosed ones if none, and whether it is held out."""
    return (gap.held_out, True) if gap.held_out is not None else (gap.gap, False)


def how_far(gap: Gap, closure: Closure, held_out: bool) -> str:
    """Share of the gap that the effects close on some recordings, with its interval, also if it is negative."""
    chose = f", from which the effect{'s were' if gap.applied[1:] else ' was'} chosen" if gap.applied else ""
    place = f"on {the_recordings(closure.recordings or gap.recordings)}{' (held out)' if held_out else chose}"
    if not gap.applied:
        if not gap.gap_detected and not gap.moved:
            return f"there is no error beyond noise {place}"
        if not gap.gap_detected:
            return (
                "no effect was applied, but parameters were re-estimated within their tolerances; errors are those "
                f"{place}"
            )
        if gap.moved:
            return f"no effect was applied, but parameters were re-estimated; errors are those {place}"
        return f"no effect was applied, so the error stays as it is {place}"
    share, (low, high) = closure.closed, closure.closed_interval
    if not isfinite(share):
        return f"with {listed([*gap.applied])}, there is no error beyond noise {place}"
    if not tells(closure):
        over = percent(max(closure.before - closure.floor, 0.0))
        return (
            f"with parameters refitted within their tolerances, the mean square error in free run exceeds that of the "
            f"noise by {over} {place}; the gap is too small to state which share of it {listed([*gap.applied])} closes"
        )
    bounds = f"[{whole_percent(low)}, {whole_percent(high)}]"
    if share < 0:
        caveat = "" if high < 0 else "; the interval includes zero"
        return (
            f"adding {listed([*gap.applied])} increases the excess error by {whole_percent(-share)} % "
            f"[{whole_percent(-high)}, {whole_percent(-low)}] {place}{caveat}"
        )
    caveat = "" if not low <= 0 else "; the interval includes zero, so the gap may not close"
    return f"with {listed([*gap.applied])}, the excess error falls by {whole_percent(share)} % {bounds} {place}{caveat}"


def tells(closure: Closure) -> bool:
    """Whether the closed share is meaningful: the gap is detectable, or the share is significantly above zero."""
    return closure.shows or closure.closed_interval[0] > 0


def levels(closure: Closure) -> str:
    """Mean squares relative to noise, with equal weight of all channels."""
    before, after = number(closure.before), number(closure.after)
    change = f"{before} before, {after} after"
    if before == after:
        change = f"{before} before and after"
    return f"mean square error divided by that of the noise: {change}; the noise alone leaves {number(closure.floor)}"


def as_it_stands(gap: Gap, closure: Closure) -> str:
    """Error of the closed model in free run with its estimated parameters; "" if the shares are sufficient.

    A closure refits parameters within their tolerances before and after, but simulations with the closed model use the
    parameters that were found. If these moved far, they may cause most of the stated model's error. An increase of the
    error is stated as a warning.
    """
    free = [error for error in closure.errors if error.horizon is None and error.floor > 0]
    if not free:
        return ""
    before, after = (
        fsum((getattr(item, of) / item.floor) ** 2 for item in free) / len(free) for of in ("before", "after")
    )
    if after <= before:
        what = "re-estimated parameters" + (f" and {listed([*gap.applied])}" if gap.applied else "")
        square = f"the mean square error in free run falls from {number(before)} to {number(after)} times that of noise"
        return f"with {what}, {square}" if gap.moved else ""
    if not closure.closed > 0:
        return ""
    return (
        "the closed model, which has these effects, has a larger mean square error in free run than the model before: "
        f"{number(after)} instead of {number(before)} times that of noise. Fit the closed model before you use it"
    )


def left(gap: Gap) -> str:
    """What remains unexplained."""
    closure, _ = judged(gap)
    clauses = []
    if gap.gap_detected and gap.applied and isfinite(closure.closed) and tells(closure):
        share = f"{whole_percent(1 - closure.closed)} %" if closure.closed > 0 else "all"
        clauses.append(f"{share} of the excess error is unexplained")
    if gap.unknown:
        clauses.append(gap.unknown.rstrip("."))
    clauses += [course_words(course) for course in gap.courses]
    probability = probability_words(gap.unknown_probability)
    return "; ".join([*clauses, f"an unmodelled effect is present with probability {probability}"])


def course_words(course: MagnitudeCourse) -> str:
    """What varies, by how much, and what its course closes."""
    unit, (low, high) = handy(course.unit, course.sd), course.closed_interval
    size, path = f"{number(unit.factor * course.sd, 2)} {unit.unit}".strip(), course.along == PATH
    on = the_recordings([*course.recordings], "held-out" if course.held_out else "")
    return (
        f"with a course of {course.effect} {'along the path' if path else 'over time'} (± {size} within "
        f"{number(course.reach, 2)} {'m' if path else 's'}), {whole_percent(course.closed)} % [{whole_percent(low)}, "
        f"{whole_percent(high)}] of the remaining excess error would close on {on}"
        + ("" if course.held_out else ", from which it was estimated")
    )


def probability_words(value: float) -> str:
    """A probability to two decimals, never 0 or 1."""
    if not isfinite(value):
        return "not known"
    return "above 0.99" if value > 0.99 else "below 0.01" if value < 0.01 else f"{value:.2f}"
