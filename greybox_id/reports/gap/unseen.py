"""What a diagnosis cannot see, and what it looked at: sizes that would show, regimes driven, errors beside noise."""

from __future__ import annotations

from math import isfinite, isnan

import numpy as np

from ...gap import Gap, Limit
from ...models.effects import EFFECTS
from ..document import Table
from ..numbers import listed, number, percent, pretty_unit, signal_words, with_sd
from .content import Made
from .quantities import handy
from .words import REGIMES

HARDLY = 0.05
"""Regimes with a smaller share of the time are hardly driven."""
LEAST = 0.01
"""Of shares that are told."""


def limits(gap: Gap) -> Table:
    """What would show of every effect that was not applied, the least visible first."""
    rows = tuple(
        (name, _about(name), _size(name, own), _usual(name, own), _times(own), _told(own))
        for name, own in gap.limits.items()
    )
    return Table(("effect", "meaning", "would show from", "usual size", "in usual sizes", "told"), rows, "lLrrrr")


def _about(name: str) -> str:
    return EFFECTS[name].parameter.about if name in EFFECTS else ""


def _size(name: str, own: Limit) -> str:
    lowers = name in EFFECTS and not isfinite(float(EFFECTS[name].parameter.array))
    if not isfinite(own.size) or (lowers and own.size == 0.0):
        return "at no size"
    unit = handy(own.unit, own.size)
    return f"{'below ' if lowers else '± '}{number(unit.factor * own.size, 2)} {unit.unit}".strip()


def _usual(name: str, own: Limit) -> str:
    unit = handy(own.unit, own.typical)
    factor = name in EFFECTS and own.unit in ("", "1") and float(EFFECTS[name].parameter.array) == 1.0
    return f"{'× ' if factor else ''}{number(unit.factor * own.typical, 2)} {unit.unit}".strip()


def _told(own: Limit) -> str:
    return percent(own.told) if own.told >= LEAST else f"below {percent(LEAST)}"


def _times(own: Limit) -> str:
    return number(own.share, 2) if own.share < 1000.0 else "above 1000"


def sentences(gap: Gap) -> list[str]:
    """What is not told, in sentences."""
    return [sentence for sentence in (_could_be(gap), _hardly_driven(gap)) if sentence]


def _could_be(gap: Gap) -> str:
    """Which effects of their usual size is below the detection limit, in a sentence."""
    if not gap.limits:
        return ""
    unseen = [name for name, own in gap.limits.items() if own.share >= 1.0]
    if not unseen:
        return f"Each of {len(gap.limits)} effects would show here if it had its usual size."
    return (
        f"Of {len(gap.limits)} effects, {len(unseen)} could be there in their usual size and not show here: "
        f"{listed(unseen)}."
    )


def _hardly_driven(gap: Gap) -> str:
    """Regimes that the recordings hardly hold, in a sentence."""
    shares = {REGIMES.get(name, name): time for name, (time, _) in gap.where.regimes.items()}
    rare = [f"{place} ({percent(time)} of the time)" for place, time in shares.items() if time < HARDLY]
    if not rare:
        return ""
    return f"Hardly driven: {listed(rare)}. What only shows there could be there unseen."


def channels(gap: Gap) -> Table:
    """Errors beside noise, channel by channel, and the frequency at which they exceed it most."""
    rows = []
    for name, ratio in gap.where.channels.items():
        rows.append((signal_words(name), number(ratio, 2), *_loudest(gap, name)))
    head = ("channel", "error over noise in free run", "most at", "there, density over noise's")
    return Table(head, tuple(rows), "lRRR")


def _loudest(gap: Gap, channel: str) -> tuple[str, str]:
    strip = gap.strip
    density = None if strip is None else strip.spectrum_before.get(channel)
    if strip is None or density is None or len(density) < 2 or not np.any(np.isfinite(density[1:])):
        return "–", "–"
    k = 1 + int(np.nanargmax(density[1:]))
    return f"{number(float(strip.frequency[k]), 2)} Hz", number(float(density[k]), 2)


def stated(made: Made) -> Table:
    """The numbers that the simulation went by, and what each may be off by."""
    rows = tuple(
        (
            own.name, _number(own.value, own.sd), pretty_unit(own.unit), "exact" if own.sd is None else "tolerance",
            own.source,
        )
        for own in made.stated
    )  # fmt: skip
    return Table(("number", "value ± sd", "unit", "counts as", "source"), rows, "lrllL")


def _number(value: float | None, sd: float | None) -> str:
    if value is None:
        return f"± {number(sd if sd is not None else float('nan'), 2)}"
    return number(value) if sd is None or isnan(sd) else with_sd(value, sd)
