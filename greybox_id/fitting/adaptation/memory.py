"""Adapting models with memory: what moves, how strongly it is held, and whether time is aligned, part by part."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la

from ...base.shorthands import Array
from ...base.statistics import correlation_time
from ...datasets.recording import Recording
from ...engine.solvers.gauss_newton import Status, gauss_newton
from ...models.effects import EFFECTS
from ...models.memory_model import MemoryModel
from ...models.parameter import unpack
from ..fit import Fit
from ..provenance import Stage, data_record
from ..scores.memory import errors
from ..scores.metrics import Error, as_dict, score
from ..scores.timing import (
    RunDelay,
    aligned,
    errors_after,
    must_have_timing,
    parts_of,
    residual_noise,
    run_delays,
    timed,
)
from .choosing import AdaptedCandidate, LinearisedPart, between_runs, chosen, foretold, surely_better
from .outcome import Adaptation, Outcome, moved_from, parted
from .subsets import ADAPTING, COMPARED, FEW, Held, about_itself, learnt, members, must_name_something, part_with_few
from .verb import AdaptTask, adapted

STEPS = 12
"""Steps of the final fit: it starts where it nearly is."""


@dataclass(frozen=True)
class _Way:
    """What is done to a part: the candidate, and the part's model after it."""

    candidate: AdaptedCandidate
    model: MemoryModel
    sd: Mapping[str, Array]
    stage: Stage | None = None


def tuned_in_sample(fit: Fit, recording: Recording) -> dict[str, dict[str, float]]:
    """Pooled errors on a recording after all weights were tuned on it, by the shapes of their priors alone: no test.

    That is what the paper's table of adaptations holds: nothing is held out, and nothing of the old car is kept.
    """
    model = must_have_timing(fit.model)
    noise = residual_noise(fit, recording)
    found: dict[str, dict[str, float]] = {}
    for part in (about_itself(own) for own in parts_of(model)):
        linearised = LinearisedPart(part, recording, noise, np.zeros((part.size, part.size)))
        candidate = AdaptedCandidate("all", 0.0, False, np.ones(1))
        way = _way(candidate, linearised, fit)
        found |= _in_sample(_whole(model, [way]), [part], recording, {}, {part.outputs[0]: way})
    return found


@adapted.register(MemoryModel)
def _adapted(model: MemoryModel, task: AdaptTask) -> Adaptation:
    clock = time.process_time()
    fit, recording, seconds, free, validate = task.fit, task.recording, task.seconds, task.free, task.validate
    trained, calibrate, say = task.trained, task.calibrate, task.say
    parts = [about_itself(part_with_few(part)) for part in parts_of(model)]
    if free != "auto":
        must_name_something(free, parts)
    new, rest = parted(recording, seconds)
    rest = rest if validate is None else validate
    if validate is not None:
        validate.must_run()
    noise = residual_noise(fit, new)
    ways: dict[str, dict[str, _Way]] = {"chosen": {}, "zero_shot": {}, "adapted": {}}
    tried: dict[str, list[tuple[str, float]]] = {}
    found: dict[str, list[RunDelay]] = {}
    scatter: dict[str, float] = {}
    for part in parts:
        name = part.outputs[0]
        say(f"{name}: what may move, compared on {seconds:g} s")
        known, scatter[name] = learnt(part, noise, fit.sd, trained), between_runs(part, trained)
        found[name] = run_delays(part, new, noise)
        straight = aligned(new, part.inputs, {own.run: own.delay for own in found[name]})
        as_it_is, moved = (LinearisedPart(part, own, noise, known) for own in (new, straight))
        several = _candidates(as_it_is, moved, free)
        zero = several[0]
        best = chosen(several)
        other = chosen([own for own in several if own is not zero]) if len(several) > 1 else zero
        made = {id(own): _way(own, moved if own.timing else as_it_is, fit) for own in (zero, best, other)}
        ways["chosen"][name], ways["zero_shot"][name] = made[id(best)], made[id(zero)]
        ways["adapted"][name] = made[id(other)] if best is zero else made[id(best)]
        tried[name] = [(own.words, own.error) for own in several]
    models = {role: _whole(model, list(own.values())) for role, own in ways.items()}
    going_on = validate is None and _continues(recording, len(new))
    outcomes: dict[str, Outcome] = {}
    calibrated: dict[str, list[RunDelay]] = {}
    known_delays: dict[int, list[RunDelay]] = {}
    for role, own in ways.items():
        scored: dict[str, Error] = {}
        for part in parts:
            if rest is None:
                break
            way, name = own[part.outputs[0]], part.outputs[0]
            model_of = _part_of(models[role], part)
            if id(way) not in known_delays:
                last = found[name][-1] if going_on else None
                known_delays[id(way)] = _rest_delays(model_of, rest, noise, calibrate, last, way.candidate.timing)
            told = known_delays[id(way)]
            scored |= errors_after(model_of, rest, told)
            if role == "chosen":
                calibrated[part.outputs[0]] = told
        length = 0.0 if rest is None else rest.duration
        expected = {
            output: foretold(own[part.outputs[0]].candidate.pieces, length, noise[output], scatter[part.outputs[0]])
            for part in parts
            for output in part.outputs
        }
        name = " and ".join(dict.fromkeys(way.candidate.words for way in own.values()))
        outcomes[role] = Outcome(name, scored, expected)
    final = models["chosen"]
    sd = {own.name: fit.sd.get(own.name, np.full(own.shape, np.nan)) for own in final.parameters}
    for way in ways["chosen"].values():
        sd |= way.sd
    in_sample = _in_sample(final, parts, new, found, ways["chosen"])
    stages = tuple(own.stage for own in ways["chosen"].values() if own.stage is not None)
    result = replace(
        fit, model=final, sd={own.name: np.broadcast_to(sd[own.name], own.shape) for own in final.parameters},
        stages=(*fit.stages, *stages), dof={}, covariance=None, per_run={}, verdict=None,
        metrics={"train": as_dict(score(final, new))},
        data=(data_record(new, "train"),),
        how={**fit.how, "adapted": {name: own.candidate.words for name, own in ways["chosen"].items()}},
    )  # fmt: skip
    return Adaptation(
        fit=result, chosen=outcomes["chosen"], zero_shot=outcomes["zero_shot"], adapted=outcomes["adapted"],
        choices={name: own.candidate.words for name, own in ways["chosen"].items()}, tried=tried,
        delays=_named({name: found[name] for name, own in ways["chosen"].items() if own.candidate.timing}),
        calibrated=_named(calibrated), moved=moved_from(fit, final), seconds=float(seconds), in_sample=in_sample,
        cpu_seconds=time.process_time() - clock,
    )  # fmt: skip


def _candidates(as_it_is: LinearisedPart, moved: LinearisedPart, free: str) -> list[AdaptedCandidate]:
    """Zero-shot first, then timing if it helps surely, then sets of parameters on top of that."""
    (zero,) = as_it_is.candidates("", timing=False)
    (timing,) = moved.candidates("", timing=True)
    helps = surely_better(_common(timing, zero), _common(zero, timing))
    about = moved if helps else as_it_is
    sets = COMPARED if free == "auto" else (free,)
    found = [own for each in sets for own in about.candidates(each, timing=helps)]
    return [zero, timing, *found] if free == "auto" else [zero, *found]


def _common(one: AdaptedCandidate, other: AdaptedCandidate) -> Array:
    """The pieces of a candidate that both have: aligned readings end a little earlier."""
    return one.pieces[: min(len(one.pieces), len(other.pieces))]


def _way(candidate: AdaptedCandidate, linearised: LinearisedPart, fit: Fit) -> _Way:
    """The part adapted as a candidate says, now without linearising."""
    part = linearised.part
    if not candidate.free:
        return _Way(candidate, part, {})
    clock = time.process_time()
    names = members(candidate.free, part)
    held = part.with_parameters(*(replace(own, fixed=own.name not in names) for own in part.parameters))
    free, precision = linearised.mask(candidate.free), candidate.strength**2 * linearised.learnt
    precision = precision * np.outer(free, free)
    problem = Held(held, linearised.recording, linearised.problem.noise, precision)
    solution = gauss_newton(problem, problem.start, max_steps=STEPS, tolerance=1e-5)
    if solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    adapted = held.with_parameters(*unpack(held.parameters, problem.shared(solution.x)))
    H = problem.normal_equations(solution.x, solution.nodes).H[np.ix_(free, free)]
    spread = np.zeros(part.size)
    spread[free] = np.sqrt(np.maximum(np.diag(la.pinvh(H)), 0.0) * correlation_time(linearised.r))
    sd, start = {}, 0
    for own in held.parameters:
        if own.name in names:
            sd[own.name] = spread[start : start + own.size].reshape(own.shape)
        start += own.size
    stage = Stage(
        model=f"{part.name}, adapted", closed_loop=False, status=solution.status.value,
        converged=solution.status is Status.CONVERGED, steps=solution.steps, history=solution.history,
        starts=(solution.objective,), strengths={ADAPTING: candidate.strength}, strengths_from="cross-validation",
        tried=(),
        noise=dict(zip(part.outputs, problem.noise.tolist(), strict=True)),
        cpu_seconds=time.process_time() - clock, cross_validation_seconds=0.0, certificate=None,
    )  # fmt: skip
    return _Way(candidate, adapted, sd, stage)


def _continues(recording: Recording, cut: int) -> bool:
    """Whether a run goes on across a row."""
    return any(start < cut < stop for start, stop in recording.runs)


def _rest_delays(
    part: MemoryModel,
    rest: Recording,
    noise: Mapping[str, float],
    calibrate: float | None,
    going_on: RunDelay | None,
    timing: bool,
) -> list[RunDelay]:
    """Delays of the rest's runs.

    The run that goes on keeps the delay that the new seconds told, where it is used; other runs have none, or tell
    theirs in their own first seconds, which are then not scored.
    """
    delays = [] if calibrate is None else run_delays(part, rest, noise, calibrate)
    if going_on is None or not (calibrate is not None or timing):
        return delays
    return [replace(going_on, run=0, stop=0), *(own for own in delays if own.run > 0)]


def _named(delays: Mapping[str, Sequence[RunDelay]]) -> dict[str, dict[str, float]]:
    """Run, from 1 -> output -> delay."""
    found: dict[str, dict[str, float]] = {}
    for output, several in delays.items():
        for own in several:
            found.setdefault(str(own.run + 1), {})[output] = own.delay
    return found


def _in_sample(
    model: MemoryModel,
    parts: Sequence[MemoryModel],
    new: Recording,
    delays: Mapping[str, Sequence[RunDelay]],
    ways: Mapping[str, _Way],
) -> dict[str, dict[str, float]]:
    """Pooled errors on what was adapted to, with the paper's fraction of variance unexplained for that."""
    found: dict[str, dict[str, float]] = {}
    for part in parts:
        name, own = part.outputs[0], _part_of(model, part)
        seen = timed(own, new, {o.run: o.delay for o in delays[name]} if ways[name].candidate.timing else {})
        pooled, published = errors(own, seen, "honest"), errors(own, seen, "published")
        found |= {o: {"rmse": pooled[o].rmse, "fvu_pooled": published[o].fvu_pooled} for o in own.outputs}
    return found


def _part_of(model: MemoryModel, part: MemoryModel) -> MemoryModel:
    """The part of a whole that predicts what a part does, at the whole's values."""
    return next(own for own in parts_of(model) if own.outputs == part.outputs)


def _whole(model: MemoryModel, ways: Sequence[_Way]) -> MemoryModel:
    """The whole model at the values of its parts, with the effects that moved."""
    values = {own.name: own for way in ways for own in way.model.parameters if way.candidate.free}
    for name in FEW:
        if name in values and name not in model and float(values[name].array) != values[name].null:
            model = model + EFFECTS[name].at(float(values[name].array))
    return model.with_parameters(
        *(own.with_value(values[own.name].array) for own in model.parameters if own.name in values)
    )
