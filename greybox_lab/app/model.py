"""The model as the page handles it: sliders, and a trace simulated anew while one is dragged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

import greybox_id as gb

from .beneath import free_runs, sentence
from .charts import UNNAMED, PlottedTrace, Step, StripChart
from .traces import Array, Shown

if TYPE_CHECKING:
    from greybox_id.gap.gap import Gap, Ranked

MODELS = ("single_track", "lateral", "longitudinal", "kinematic")
"""Models with a page: equations of motion whose parameters mean something one by one."""
TYRES = ("pacejka", "linear", "dugoff", "brush")
MOST_ROWS = 4000
"""Rows that are simulated anew while a slider is dragged."""
MOST_TRIED = 1200
"""Rows on which shipped vehicles are compared."""
WIDE = 4.0
"""A slider spans so many standard deviations of the prior, and a factor of so much where there is none."""


def nominal(chosen: Mapping[str, Any]) -> gb.models.MotionModel:
    """The model that is chosen, at its nominal values. Raises `BadInput`."""
    settings = dict(chosen["settings"])
    model: gb.models.MotionModel = getattr(gb.models, chosen["name"])(vehicle=chosen["vehicle"] or None, **settings)
    for name in chosen["effects"]:
        model = model + getattr(gb.effects, name).free()
    return model


def moved(model: gb.models.MotionModel, values: Mapping[str, float]) -> gb.models.MotionModel:
    """The model with some parameters elsewhere."""
    return model.with_parameters(*(model[name].with_value(value) for name, value in values.items() if name in model))


def lacking(name: str, recording: gb.Recording) -> str:
    """Why a model cannot be simulated on a recording, as a sentence; "" where it can."""
    try:
        gb.simulate(name, recording.rows(0, min(len(recording), 60)))
    except gb.GreyboxError as error:
        return sentence(error)
    return ""


def nearest_vehicle(name: str, recording: gb.Recording) -> str:
    """The shipped vehicle whose simulation is nearest to what was recorded, over outputs in units of their spread."""
    part = recording.rows(0, min(len(recording), MOST_TRIED))

    def error(vehicle: str) -> float:
        try:
            model = getattr(gb.models, name)(vehicle=vehicle)
            run = gb.simulate(model, part)
        except gb.GreyboxError:
            return np.inf
        known = [output for output in model.outputs if part.has(output)]
        squares = [np.nanmean((run[output] - part[output]) ** 2) / np.nanvar(part[output]) for output in known]
        return float(np.nan_to_num(np.mean(squares), nan=np.inf))

    return min(gb.models.vehicles(), key=error)


def span_of(parameter: gb.models.Parameter) -> tuple[float, float] | None:
    """Where a slider of a parameter goes from and to; None for what is no single number, or has no room to move."""
    if parameter.shape != () or not np.isfinite(value := float(parameter.array)):
        return None
    if (prior := prior_of(parameter)) is not None:
        low, high = prior[0] - WIDE * prior[1], prior[0] + WIDE * prior[1]
    else:
        low, high = sorted((value / WIDE, value * WIDE)) if value != 0.0 else (-0.1, 0.1)
    low, high = max(min(low, value), parameter.bounds[0]), min(max(high, value), parameter.bounds[1])
    return (low, high) if high > low else None


def prior_of(parameter: gb.models.Parameter) -> tuple[float, float] | None:
    """Mean and standard deviation of what is known of a parameter beforehand."""
    prior = parameter.prior
    if prior is None or prior.mean is None or np.ndim(prior.mean) != 0:
        return None
    return float(np.asarray(prior.mean)), float(np.asarray(prior.sd))


def longest(recording: gb.Recording) -> gb.Recording:
    """The longest run of a recording, `MOST_ROWS` rows of it at most."""
    start, stop = max(recording.runs, key=lambda run: run[1] - run[0])
    return recording.rows(start, min(stop, start + MOST_ROWS))


def effects_of(chosen: Mapping[str, Any]) -> list[str]:
    """Names of effects that a model may have."""
    model = getattr(gb.models, chosen["name"])()
    return [name for name in gb.effects.names() if getattr(gb.effects, name).concerns(model)]


def stated_effects(name: str, vehicle: str) -> list[str]:
    """Effects of sensors and servo that a vehicle's file states tolerances of, those that a model may have."""
    if not vehicle:
        return []
    stated = gb.Vehicle.load(vehicle).effects
    return [effect for effect in effects_of({"name": name}) if effect in stated]


class Playground:
    """A model over the longest run of a recording, simulated anew as often as one likes."""

    def __init__(self, model: gb.models.MotionModel, recording: gb.Recording) -> None:
        self.recording, self.model = longest(recording), model
        self.over = Shown(self.recording)
        self.outputs = [name for name in model.outputs if self.recording.has(name)]
        self._runs = free_runs(model, self.recording)

    def simulate(self, values: Mapping[str, float]) -> dict[str, Array]:
        """Output -> (n,) what the model makes of the recording's inputs; NaN where that is not finite."""
        traces = self._runs(moved(self.model, values))
        return {name: traces[name] for name in self.outputs}

    def curves(self, traces: Mapping[str, Array], called: str) -> dict[str, Array]:
        """Points of traces, by the id of their curve."""
        return {f"{name}/{called}": self.over.points(trace) for name, trace in traces.items()}

    def strips(self, runs: Mapping[str, Mapping[str, Array]]) -> list[StripChart]:
        """Each output as measured and in simulations by their names; the last one is what it is about."""
        looks = ["measured", *["before"] * (len(runs) - 1), "simulated"]
        every = {"measured": {name: np.asarray(self.recording[name]) for name in self.outputs}, **runs}

        def curves(name: str) -> list[PlottedTrace]:
            named = zip(every.items(), looks, strict=True)
            return [PlottedTrace(called, self.over.points(run[name]), look) for (called, run), look in named]

        return [StripChart(name, self.recording.unit(name), curves(name)) for name in self.outputs]

    def errors(self, traces: Mapping[str, Array]) -> dict[str, float]:
        """Output -> root mean square of simulated less measured, in its unit."""
        return {name: float(np.sqrt(np.nanmean((trace - self.recording[name]) ** 2))) for name, trace in traces.items()}


def steps(gap: Gap) -> list[Step]:
    """The budget of a diagnosis as steps down from the whole excess."""
    budget, left = list[Step](), 1.0
    shares = [] if gap.budget is None else [*gap.budget.shares, replace(gap.budget.unnamed, effect=UNNAMED)]
    for each in shares:
        budget.append(Step(each.effect, each.share, each.low, each.high, left, each.effect in gap.applied))
        left -= each.share
    return budget


def alone(base: gb.models.MotionModel, causes: Sequence[Ranked], name: str) -> gb.models.MotionModel:
    """The model with one cause, at the magnitude that the diagnosis gives it."""
    for cause in causes:
        if cause.effect == name and name not in base.effects:
            return moved(base + getattr(gb.effects, name).at(float(cause.magnitude)), cause.others)
    return base


def diagnosed_model(folder: Path, words: Sequence[str]) -> gb.models.MotionModel:
    """The model that a command `greybox gap WORDS` diagnosed. Raises `BadInput`."""

    def after(option: str) -> str:
        return words[words.index(option) + 1] if option in words else ""

    if "--fit" in words:
        return cast(gb.models.MotionModel, gb.load(folder / after("--fit")).model)  # the page fits no other kind
    made = getattr(gb.models, after("--model") or "single_track")
    return cast(gb.models.MotionModel, made(vehicle=after("--vehicle") or None))
