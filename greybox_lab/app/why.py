"""What a diagnosis says, as a picture needs it: steps of a waterfall, a cause alone, what could not have been seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import greybox_id as gb

from .beneath import number, percent, pretty_unit, with_interval

UNNAMED = "unexplained"


@dataclass(frozen=True)
class Step:
    """One step of the waterfall.

    Attributes
    ----------
    name : an effect, or `UNNAMED`.
    share, low, high : of the excess error, with its 95 % interval.
    start : share that is left before it.
    words : its magnitude with interval and probability; "" of what is unexplained.
    applied : whether the closed model has it.
    """

    name: str
    share: float
    low: float
    high: float
    start: float
    words: str
    applied: bool


def steps(gap: Mapping[str, Any]) -> list[Step]:
    """The budget of `gap.json` as steps down from the whole excess."""
    ranked = {each["effect"]: each for each in gap["ranking"]}
    budget, left = [], 1.0
    for each in gap["budget"] or []:
        name = each.get("effect", UNNAMED)
        share = each["share"] if "effect" in each else each["unnamed"]
        words = cause_words(ranked[name]) if name in ranked else ""
        budget.append(Step(name, share, each["low"], each["high"], left, words, name in gap["applied"]))
        left -= share
    return budget


def cause_words(ranked: Mapping[str, Any]) -> str:
    """Magnitude with interval, and probability."""
    low, high = (end if end is not None else float("nan") for end in ranked["interval"])
    sd = (high - low) / 4
    size = with_interval(ranked["magnitude"], low, high, sd) if sd > 0 else number(ranked["magnitude"])
    unit = "" if ranked["unit"] == "1" else f" {pretty_unit(ranked['unit'])}"
    chance = ranked["probability"]
    return f"{size}{unit}, probability {'> 0.99' if chance > 0.99 else '< 0.01' if chance < 0.01 else f'{chance:.2f}'}"


def headline(gap: Mapping[str, Any]) -> str:
    """Whether, and why, in one sentence."""
    if gap.get("since"):
        names = [each["effect"] for each in gap["changed"]]
        since = f"since {', '.join(gap['since'])}"
        return f"{' and '.join(names)} changed {since}." if names else f"Nothing changed {since}, beyond their scatter."
    if not gap["gap_detected"]:
        return "No gap: the simulation deviates by no more than noise and stated tolerances."
    names = gap["applied"] or [each.name for each in steps(gap) if each.name != UNNAMED][:1]
    channel, where = gap["where"]["channel"], gap["where"]["channels"].get(gap["where"]["channel"])
    size = f"; {channel} is off by {number(where, 2)} times its noise" if where else ""
    if gap["applied"]:
        closure = gap["held_out"] or gap["gap"]
        on = "what was held out" if gap["held_out"] else "the same recordings"
        lacks, closed = " and ".join(names), percent(closure["closed"])
        return f"The simulation lacks {lacks}, which closes {closed} of the gap on {on}{size}."
    if names:
        return f"There is a gap, and no name is sure of it; {names[0]} comes nearest{size}."
    return f"There is a gap that no known effect explains{size}."


def unseen(gap: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Effects that could not have been seen, with why: too small for these recordings, or taken up by tolerances."""
    rows = {name: f"could be {size} without showing" for name, size in gap["not_excited"].items()}
    rows |= dict.fromkeys(gap["absorbed"], "absorbed by stated tolerances or free parameters")
    for name, limit in gap["limits"].items():
        if limit["share"] is not None and limit["share"] > 1 and name not in rows:
            size = (
                "none of any size"
                if limit["size"] is None
                else f"{number(limit['size'], 2)} {pretty_unit(limit['unit'])}"
            )
            usual = f"{number(limit['typical'], 2)} {pretty_unit(limit['unit'])}"
            rows[name] = f"would show from {size} on; {usual} is usual"
    return list(rows.items())


def alone(base: gb.Model, ranked: Sequence[Mapping[str, Any]], name: str) -> gb.Model:
    """The model with one cause, at the magnitude that the diagnosis gives it."""
    model = base
    for each in ranked:
        if each["effect"] == name and name not in model.effects:
            model = model + getattr(gb.effects, each["effect"]).at(float(each["magnitude"]))
            for name, value in (each.get("others") or {}).items():
                model = replace(
                    model,
                    parameters=tuple(
                        parameter.with_value(float(value)) if parameter.name == name else parameter
                        for parameter in model.parameters
                    ),
                )
    return model


def diagnosed_model(folder: Path, words: Sequence[str]) -> gb.Model:
    """The model that a command `greybox gap WORDS` diagnosed. Raises `BadInput`."""

    def after(option: str) -> str:
        return words[words.index(option) + 1] if option in words else ""

    if "--fit" in words:
        return gb.load(folder / after("--fit")).model
    model: gb.Model = getattr(gb.models, after("--model") or "single_track")(vehicle=after("--vehicle") or None)
    return model
