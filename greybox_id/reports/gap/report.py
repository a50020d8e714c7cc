"""The report of a diagnosis, section by section.

Also the section on changes between recordings of one vehicle.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import inf, isfinite, isnan
from pathlib import Path
from typing import Any

import numpy as np

from ...base.numbers import capital, listed, number, percent, pretty_unit, rmse, signal_words, whole_percent, with_sd
from ...fitting.scores.horizons import Errors
from ...gap.gap import Closure, Gap, Limit, Ranked
from ...models.effects import EFFECTS
from ...models.motion_model import MotionModel
from ...models.registry import build
from ..content import heading, recorded_in, written_down
from ..document import Document, Formulas, Pairs, Part, Points, Table, Text, Together, VerdictBox, titled
from ..equations.expression import readable
from ..equations.motion import motion_equations
from ..equations.tracing import traced
from ..report import write
from .page import after_words, drawings
from .saved import Made
from .words import (
    REGIMES,
    before_words,
    carried_over,
    handy,
    how_far,
    interval_words,
    is_factor,
    magnitude_words,
    on_these,
    probability_words,
    unchanged_words,
    verdict,
)

DESCRIBED_FROM, FIRST = 0.05, 2
"""Least probability of effects that are described, unless they are applied or among this many first ones."""
MOST_EVIDENCE, MOST_RANKED = 5, 12
"""Most effects that are described, and most that are listed in the table."""
RARELY = 0.05
"""Share of the time below which a regime counts as hardly driven."""
LEAST_SHOWN = 0.01
"""Smallest share with a number; smaller ones are shown as below it."""
ROLES = {"train": "diagnosed", "validate": "held out"}
DOUBTS = "Errors in the data look like a gap; correct them before looking for effects."
RANKING = (
    "Probability: that the effect is present. Gain: how much higher the log-likelihood is with the effect than without "
    "it, while the other applied effects stay in the model. Add the probabilities of effects that cannot "
    "be distinguished: the sum is the probability that one of them is present."
)
CLOSURE = (
    "The table gives mean square errors, divided by the mean square of the noise; every channel has the same weight. "
    "The floor is the error that noise alone leaves, and the excess is the error above the floor. The 95 % intervals "
    "come from blocks of time; errors before and after are compared in the same blocks."
)
MATHEMATICS = (
    "Only the equations that an effect changes are shown. A dot is a time derivative; w1, w2 and so "
    "on stand for repeated terms. A prime marks a quantity that an effect alters; “late” marks a delayed quantity, and "
    "“read” the reading of a sensor."
)
METHOD = (
    (
        "Gap",
        "Every run is simulated freely from its first readings. A p-value is the probability of errors as large as "
        "these if only noise and the stated tolerances cause errors.",
    ),
    (
        "Cause",
        "Each effect is added to the model, alone and with others, and estimated together with all numbers that "
        "have a tolerance. Unknown forces and coloured sensor noise are estimated with every set of effects. The "
        "probability of an effect follows from the gain of log-likelihood minus a cost for every effect. Sets of "
        "effects that explain the recordings equally well share the probability.",
    ),
    (
        "Errors",
        "Parameters with tolerances are refitted without the effects and with them. The effects were chosen on the "
        "diagnosed recordings, so the share of the excess error that they remove is overestimated there. On held-out "
        "recordings it is not.",
    ),
    (
        "Remains",
        "An unmodelled effect is reported if the unknown forces that remain are larger than those that models usually "
        "leave if no effect is missing, or if readings scatter by more than the stated noise.",
    ),
)
ERRORS = (
    "RMSE before → after; in brackets, the RMSE that noise alone leaves. Predictions over a horizon start from "
    "measured states."
)
ERRORS_ALONE = (
    "RMSE; in brackets, the RMSE that noise alone leaves. Predictions over a horizon start from measured states."
)
LIMITS = (
    "Detection limit: the smallest size of an effect that would be detected here. It is twice the standard deviation "
    "that an estimate of the effect would have (to first order) if all parameters with a tolerance were refitted. Not "
    "absorbed: the share of the information on the effect that remains when these parameters are refitted."
)
CHANNELS = (
    "A ratio of error to noise of 1 means that only noise is left. “Largest at” is the frequency at which the errors "
    "of "
    "the original model exceed noise most; PSD is the power spectral density."
)
STATED = (
    "Exact numbers keep their values. Numbers with a tolerance are refitted within the tolerance, and errors that this "
    "removes do not count as a gap."
)
EQUATIONS = "Equations of the simulation that was compared with the recordings. They include the effects of the model."


def write_report(gap: Gap, made: Made, out: str | Path) -> Path:
    """Write the report of a diagnosis as PDF or HTML, by the suffix. Raises `BadInput` if that is not possible."""
    return write(gap_report(gap, made), out)


def gap_report(gap: Gap, made: Made) -> Document:
    """The report of a diagnosis."""
    apart, ranking = not gap.gap_detected, ranked(gap)
    parts = (
        VerdictBox(tuple(verdict(gap))),
        *drawings(gap),
        *_data(gap),
        *(() if apart else _which(gap, ranking)),
        *(() if apart else _mathematics(gap, made)),
        *titled(
            "What could be present undetected", Text(" ".join(unseen(gap)), small=False), Points(gap.advice),
            limits_table(gap), Text(LIMITS if gap.limits else ""), Text(_absorbed(gap)),
        ),
        *_how_far(gap),
        *titled("Where the vehicle was driven" if apart else "Where the gap lies", _equations(gap), _regimes(gap)),
        *(titled("Which effects were tried", ranking, Text(RANKING)) if ranking.rows and apart else ()),
        *_simulated(made, gap),
        *titled("How the diagnosis was made", *(Text(words, lead=f"{lead}:") for lead, words in METHOD)),
        *titled("How to repeat the diagnosis", recorded_in(made.data, ROLES), Pairs(_provenance(made))),
    )  # fmt: skip
    about = f"Where the simulation of {made.vehicle} deviates from {listed([*gap.recordings])}, and why"
    title = heading("Gap", made.vehicle, [one for one in made.data if one.role == "train"])
    return Document(title, about, "a gap", f"greybox-id {made.version}", parts)


def _data(gap: Gap) -> tuple[Part, ...]:
    """Whether the data can be trusted."""
    if gap.doubts:
        return titled("Doubts about the data", Text(DOUBTS, small=False), Points(gap.doubts))
    noise = (
        "The vehicle file states the noise of the sensors, so an unmodelled effect can be distinguished from noise."
        if gap.noise_stated
        else "The vehicle file states no sensor noise. The residuals of the best explanation are therefore taken as "
        "noise, so an unmodelled effect may pass for noise."
    )
    words = f"Units, signs, time and delays of {listed([*gap.recordings])} raise no doubts. {noise}"
    return titled("Can the data be trusted?", Text(words, small=False))


def ranked(gap: Gap) -> Table:
    """A row for each of the most probable effects."""
    rows = tuple(
        (
            str(k), item.effect, magnitude_words(item), interval_words(item), probability_words(item.probability),
            number(item.gain), "yes" if item.effect in gap.applied else "",
        )
        for k, item in enumerate(gap.ranking[:MOST_RANKED], 1)
    )  # fmt: skip
    return Table(("", "effect", "magnitude ± sd", "95 % interval", "probability", "gain", "applied"), rows, "rLLLrrl")


def _which(gap: Gap, ranking: Table) -> tuple[Part, ...]:
    if not ranking.rows:
        return titled("Which effect", Text("No named effect stands out.", small=False))
    likely = (Text(words, lead=f"{effect.replace('_', ' ')}:") for effect, words in evidence(gap))
    runner_up = (Text(words, lead="Runner-up:"),) if (words := _runner_up(gap)) else ()
    return titled("Which effect", ranking, Text(RANKING), *likely, *runner_up)


def _likely(gap: Gap) -> list[Ranked]:
    """The effects that are described."""
    return [
        item
        for k, item in enumerate(gap.ranking)
        if k < FIRST or item.probability >= DESCRIBED_FROM or item.effect in gap.applied
    ][:MOST_EVIDENCE]


def evidence(gap: Gap) -> list[tuple[str, str]]:
    """The likely effects, each with its description."""
    best = max((item.gain for item in gap.ranking), default=0.0)
    return [(item.effect, " ".join(_sentences(gap, item, best))) for item in _likely(gap)]


def _sentences(gap: Gap, value: Ranked, best: float) -> list[str]:
    effect = EFFECTS.get(value.effect)
    about = effect.parameter.about if effect is not None else ""
    sentences = [
        f"{capital(about)}: {magnitude_words(value)}." if about else f"{magnitude_words(value)}.",
        f"It belongs to the group “{effect.group}” and acts on {listed([*effect.touches])}."
        if effect is not None
        else "",
        f"It is present with probability {probability_words(value.probability)}"
        + (" and was applied." if value.effect in gap.applied else "."),
        f"It raises the log-likelihood by {number(value.gain)}"
        + (
            f", {number(best - value.gain)} less than the effect with the largest gain does."
            if value.gain < best
            else "."
        ),
    ]
    sentences = [sentence for sentence in sentences if sentence]
    if _touches_null(value):
        sentences.append("The interval of its magnitude includes the value at which the effect is absent.")
    if value.indistinguishable_from:
        sentences.append(
            f"It cannot be distinguished from {listed([*value.indistinguishable_from])} on {on_these(gap.recordings)}."
        )
    return sentences


def _touches_null(ranked: Ranked) -> bool:
    effect = EFFECTS.get(ranked.effect)
    return effect is not None and ranked.interval[0] <= float(effect.parameter.array) <= ranked.interval[1]


def _runner_up(gap: Gap) -> str:
    """The most probable effect that was not applied, compared with the most probable one that was."""
    others = [item for item in gap.ranking if item.effect not in gap.applied]
    first = next((item for item in gap.ranking if item.effect in gap.applied), None)
    if not others or first is None:
        return ""
    second = others[0]
    less = first.gain - second.gain
    how = f"{number(less)} less than" if less > 0 else "no less than"
    return (
        f"{second.effect} ({magnitude_words(second)}), with probability {probability_words(second.probability)}. It "
        "would "
        f"raise the log-likelihood by {number(second.gain)}, {how} {first.effect}."
    )


def _mathematics(gap: Gap, made: Made) -> tuple[Part, ...]:
    """The equations that each likely effect changes in the model."""
    model = build(gap.model, made.settings, made.effects)
    if not isinstance(model, MotionModel):
        return ()
    before = set(motion_equations(model))
    parts: list[Part] = []
    for item in _likely(gap):
        effect = EFFECTS.get(item.effect)
        if effect is None or item.effect in model.effects or not effect.concerns(model):
            continue
        changed = [line for line in motion_equations(model + effect.starting_at(effect.typical)) if line not in before]
        shown, _ = readable(changed)
        lead = f"{item.effect.replace('_', ' ')}:"
        if shown:
            parts.append(Together((Text("", lead=lead), Formulas(shown))))
        else:
            words = "the effect alters inputs or outputs of the equations of motion, not the equations themselves"
            parts.append(Text(f"{words}: {listed([*effect.touches])}.", lead=lead))
    return titled("What these effects do to the equations", Text(MATHEMATICS if parts else ""), *parts)


def _absorbed(gap: Gap) -> str:
    if not gap.absorbed:
        return ""
    place = "its" if len(gap.absorbed) == 1 else "their"
    names, parameters = listed([*gap.absorbed]), "parameters that are free or have a tolerance"
    return f"{names} cannot be detected here, since {parameters} would change in {place} place."


def unseen(gap: Gap) -> list[str]:
    """What could be present undetected, in sentences."""
    return [sentence for sentence in (_could_be(gap), _hardly_driven(gap)) if sentence]


def _could_be(gap: Gap) -> str:
    """Effects that would not be detected at their usual size, in a sentence."""
    if not gap.limits:
        return ""
    unseen = [name for name, limit in gap.limits.items() if limit.share >= 1.0]
    if not unseen:
        return f"Each of {len(gap.limits)} effects would be detected here at its usual size."
    return (
        f"{len(unseen)} of {len(gap.limits)} effects would not be detected here at their usual size: {listed(unseen)}."
    )


def _hardly_driven(gap: Gap) -> str:
    """Regimes that were hardly driven, in a sentence."""
    shares = {REGIMES.get(name, name): time for name, (time, _) in gap.where.regimes.items()}
    rare = [f"{place} ({percent(time)} of the time)" for place, time in shares.items() if time < RARELY]
    if not rare:
        return ""
    return f"These regimes were hardly driven: {listed(rare)}. Effects that act only there could go undetected."


def limits_table(gap: Gap) -> Table:
    """Detection limits of the effects that were not applied, the largest relative to the usual size first."""
    rows = tuple(
        (name, _about(name), _size(name, limit), _usual(name, limit), _times(limit), _not_absorbed(limit))
        for name, limit in gap.limits.items()
    )
    return Table(
        ("effect", "meaning", "detection limit", "usual size", "limit / usual size", "not absorbed"), rows, "lLrrrr"
    )


def _about(name: str) -> str:
    return EFFECTS[name].parameter.about if name in EFFECTS else ""


def _size(name: str, limit: Limit) -> str:
    lowers = name in EFFECTS and not isfinite(float(EFFECTS[name].parameter.array))
    if not isfinite(limit.size) or (lowers and limit.size == 0.0):
        return "at no size"
    unit = handy(limit.unit, limit.size)
    return f"{'below ' if lowers else '± '}{number(unit.factor * limit.size, 2)} {unit.unit}".strip()


def _usual(name: str, limit: Limit) -> str:
    unit = handy(limit.unit, limit.typical)
    return f"{'× ' if is_factor(name) else ''}{number(unit.factor * limit.typical, 2)} {unit.unit}".strip()


def _not_absorbed(limit: Limit) -> str:
    return percent(limit.told) if limit.told >= LEAST_SHOWN else f"below {percent(LEAST_SHOWN)}"


def _times(limit: Limit) -> str:
    return number(limit.share, 2) if limit.share < 1000.0 else "above 1000"


def _how_far(gap: Gap) -> tuple[Part, ...]:
    """How far the effects close the gap, or how large the errors are if there is none."""
    both = [(gap.gap, False), *([(gap.held_out, True)] if gap.held_out is not None else [])]
    title = "Errors before and after" if gap.gap_detected else "How large the errors are"
    judged = " ".join(f"{capital(words)}." for words in (*(how_far(gap, *one) for one in both), *carried_over(gap)))
    after = any(after_words(one, bool(gap.applied)) for one, _ in both)
    errors = [
        (f"{'Held out' if held_out else 'Diagnosed'}: {listed([*one.recordings])}", _errors(one, after))
        for one, held_out in reversed(both)
        if one.errors
    ]
    explanation = (ERRORS if after else ERRORS_ALONE) if errors else ""
    return (
        *titled(title, Text(judged, small=False), closures(both), Text(CLOSURE)),
        *(part for title, table in errors for part in titled(title, table, level=2)),
        Text(explanation),
        *titled("Errors compared with the noise", channels(gap), Text(CHANNELS), level=2),
    )


def closures(of: Iterable[tuple[Closure, bool]]) -> Table:
    """How far the effects close the gap, a row per closure, marked as held out or diagnosed."""
    rows = []
    for closure, held_out in of:
        names = f"{listed([*closure.recordings])} ({'held out' if held_out else 'diagnosed'})"
        low, high = (whole_percent(end) for end in closure.closed_interval)
        share = f"{whole_percent(closure.closed)} % [{low}, {high}]" if isfinite(closure.closed) else "–"
        rows.append((names, number(closure.before), number(closure.after), number(closure.floor), share))
    return Table(("recordings", "before", "after", "floor", "closes by"), tuple(rows), "Lrrrr")


def _errors(closure: Closure, applied: bool) -> Table:
    """Before → after (noise), a row per channel and a column per horizon; without effects, no errors after."""
    horizons = sorted({error.horizon for error in closure.errors}, key=lambda h: inf if h is None else h)
    by = {(error.channel, error.horizon): error for error in closure.errors}
    rows = []
    for channel in dict.fromkeys(error.channel for error in closure.errors):
        row = [by.get((channel, horizon)) for horizon in horizons]
        unit = next(item.unit for item in row if item is not None)
        cells = ("–" if e is None else _cell(e, applied) for e in row)
        rows.append((f"{signal_words(channel)} [{pretty_unit(unit)}]", *cells))
    return Table(
        ("channel", *("free run" if h is None else f"{h:g} s" for h in horizons)),
        tuple(rows),
        "l" + "R" * len(horizons),
    )


def _cell(error: Errors, applied: bool) -> str:
    after = f" → {rmse(error.after)}" if applied else ""
    return f"{rmse(error.before)}{after} ({number(error.floor, 2)})"


def channels(gap: Gap) -> Table:
    """Ratio of error to noise per channel, and the frequency at which the errors exceed noise most."""
    rows = []
    for name, ratio in gap.where.channels.items():
        rows.append((signal_words(name), number(ratio, 2), *_loudest(gap, name)))
    head = ("channel", "error / noise in free run", "largest at", "PSD there / PSD of the noise")
    return Table(head, tuple(rows), "lRRR")


def _loudest(gap: Gap, channel: str) -> tuple[str, str]:
    strip = gap.strip
    density = None if strip is None else strip.spectrum_before.get(channel)
    if strip is None or density is None or len(density) < 2 or not np.any(np.isfinite(density[1:])):
        return "–", "–"
    k = 1 + int(np.nanargmax(density[1:]))
    return f"{number(float(strip.frequency[k]), 2)} Hz", number(float(density[k]), 2)


def _equations(gap: Gap) -> Table:
    shares = gap.where.equations if gap.gap_detected else {}
    return Table(("equation", "share of the gap"), tuple((k, percent(v)) for k, v in shares.items()), "lr")


def _regimes(gap: Gap) -> Table:
    """Shares of the time, and of the gap if there is one."""
    head = ("regime", "share of the time", *(("share of the gap",) if gap.gap_detected else ()))
    rows = tuple(
        (REGIMES.get(k, k), percent(t), *((percent(g),) if gap.gap_detected else ()))
        for k, (t, g) in gap.where.regimes.items()
    )
    return Table(head, rows, "lrr"[: len(head)])


def _simulated(made: Made, gap: Gap) -> tuple[Part, ...]:
    """The model that was compared, and the stated numbers of its vehicle."""
    model, table = build(gap.model, made.settings, made.effects), stated(made)
    words = Text(STATED if table.rows else "")
    return titled("What was simulated", table, words, *written_down(traced(model), EQUATIONS))


def stated(made: Made) -> Table:
    """The stated numbers of the simulation, with their tolerances."""
    rows = tuple(
        (
            one.name, _number(one.value, one.sd), pretty_unit(one.unit), "exact" if one.sd is None else "tolerance",
            one.source,
        )
        for one in made.stated
    )  # fmt: skip
    return Table(("number", "value ± sd", "unit", "counts as", "source"), rows, "lrllL")


def _number(value: float | None, sd: float | None) -> str:
    if value is None:
        return f"± {number(sd if sd is not None else float('nan'), 2)}"
    return number(value) if sd is None or isnan(sd) else with_sd(value, sd)


def _provenance(made: Made) -> tuple[tuple[str, str], ...]:
    return (
        ("version", f"greybox-id {made.version}"),
        ("command", made.command or "not recorded (diagnosed from Python)"),
        ("seed", str(made.seed)),
    )


def what_changed(gap: Gap, answer: Mapping[str, Any]) -> tuple[Part, ...]:
    """What changed, what did not, and for which effects this is unknown.

    Parameters
    ----------
    gap : the diagnosis of the changes.
    answer : `since`, `changed`, `not_changed` and `not_seen` from `Changed.to_json`.
    """
    of, changed = {each.effect: each for each in gap.ranking}, answer["changed"]
    rows = tuple(
        (cause.effect, before_words(cause, mean), magnitude_words(cause), probability_words(cause.probability))
        for cause, mean in ((of[each["effect"]], each["before"]) for each in changed)
    )
    same = [unchanged_words(each["effect"], each["within"]) for each in answer["not_changed"]]
    others = (
        ("Unchanged within two standard deviations:", same),
        ("Unknown, since a change of usual size is below the detection limit:", answer["not_seen"]),
    )
    return titled(
        f"Changed since {listed(answer['since'])}",
        Table(("effect", "before", "after", "probability"), rows, "LLLL"),
        Text("" if rows else "No change exceeds the scatter between the earlier drives.", small=False),
        *(Text(f"{listed(names)}.", lead=lead, small=False) for lead, names in others if names),
        level=2,
    )
