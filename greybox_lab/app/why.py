"""What a diagnosis says, as a picture needs it: steps of a waterfall, a cause alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, cast

import greybox_id as gb

from .charts import UNNAMED
from .model import moved

if TYPE_CHECKING:
    from greybox_id.gap.gap import Gap, Ranked


@dataclass(frozen=True)
class Step:
    """One step of the waterfall.

    Attributes
    ----------
    name : an effect, or `UNNAMED`.
    share, low, high : of the excess error, with its 95 % interval.
    start : share that is left before it.
    applied : whether the closed model has it.
    """

    name: str
    share: float
    low: float
    high: float
    start: float
    applied: bool


def steps(gap: Gap) -> list[Step]:
    """The budget of a diagnosis as steps down from the whole excess."""
    budget, left = list[Step](), 1.0
    shares = [] if gap.budget is None else [*gap.budget.shares, replace(gap.budget.unnamed, effect=UNNAMED)]
    for each in shares:
        budget.append(Step(each.effect, each.share, each.low, each.high, left, each.effect in gap.applied))
        left -= each.share
    return budget


def alone(base: gb.MotionModel, causes: Sequence[Ranked], name: str) -> gb.MotionModel:
    """The model with one cause, at the magnitude that the diagnosis gives it."""
    for cause in causes:
        if cause.effect == name and name not in base.effects:
            return moved(base + getattr(gb.effects, name).at(float(cause.magnitude)), cause.others)
    return base


def diagnosed_model(folder: Path, words: Sequence[str]) -> gb.MotionModel:
    """The model that a command `greybox gap WORDS` diagnosed. Raises `BadInput`."""

    def after(option: str) -> str:
        return words[words.index(option) + 1] if option in words else ""

    if "--fit" in words:
        return cast(gb.MotionModel, gb.load(folder / after("--fit")).model)  # the page fits no other kind
    model: gb.MotionModel = getattr(gb.models, after("--model") or "single_track")(vehicle=after("--vehicle") or None)
    return model
