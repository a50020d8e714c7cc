"""Adapt models with memory, part by part: which parameters are free, with which prior, and whether time is aligned."""

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
from ...models.parameter import placed, unpack
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
from .choosing import (
    ADAPTING,
    COMPARED,
    FEW,
    AdaptedCandidate,
    Held,
    LinearisedPart,
    about_itself,
    between_runs,
    chosen,
    foretold,
    learnt,
    members,
    must_name_something,
    part_with_few,
    surely_better,
)
from .verb import Adaptation, AdaptTask, Outcome, adapted, moved_from, parted

STEPS = 12
"""Steps of the final fit, which starts near its optimum."""


@dataclass(frozen=True)
class _Way:
    """An adapted part: the candidate, and the part's model."""

    candidate: AdaptedCandidate
    model: MemoryModel
    sd: Mapping[str, Array]
    stage: Stage | None = None


def tuned_in_sample(fit: Fit, recording: Recording) -> dict[str, dict[str, float]]:
    """Pooled errors on a recording after tuning all weights on it, with the shapes of their priors only: no test.

    This is the content of the paper's table of adaptations: nothing is held out, and nothing of the old car is kept.
    """
    model = must_have_timing(fit.model)
    noise = residual_noise(fit, recording)
    result: dict[str, dict[str, float]] = {}
    for part in (about_itself(item) for item in parts_of(model)):
        linearised = LinearisedPart(part, recording, noise, np.zeros((part.size, part.size)))
        candidate = AdaptedCandidate("all", 0.0, False, np.ones(1))
        way = _way(candidate, linearised, fit)
        result |= _in_sample(_whole(model, [way]), [part], recording, {}, {part.outputs[0]: way})
    return result


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
    new_delays: dict[str, list[RunDelay]] = {}
    scatter: dict[str, float] = {}
    for part in parts:
        name = part.outputs[0]
        say(f"{name}: comparing sets of free parameters on {seconds:g} s")
        precision, scatter[name] = learnt(part, noise, fit.sd, trained), between_runs(part, trained)
        new_delays[name] = run_delays(part, new, noise)
        aligned_new = aligned(new, part.inputs, {item.run: item.delay for item in new_delays[name]})
        as_it_is, moved = (LinearisedPart(part, item, noise, precision) for item in (new, aligned_new))
        candidates = _candidates(as_it_is, moved, free)
        unchanged = candidates[0]
        best = chosen(candidates)
        other = chosen([item for item in candidates if item is not unchanged]) if len(candidates) > 1 else unchanged
        made = {id(item): _way(item, moved if item.timing else as_it_is, fit) for item in (unchanged, best, other)}
        ways["chosen"][name], ways["zero_shot"][name] = made[id(best)], made[id(unchanged)]
        ways["adapted"][name] = made[id(other)] if best is unchanged else made[id(best)]
        tried[name] = [(item.words, item.error) for item in candidates]
    models = {role: _whole(model, list(way.values())) for role, way in ways.items()}
    going_on = validate is None and _continues(recording, len(new))
    outcomes: dict[str, Outcome] = {}
    calibrated: dict[str, list[RunDelay]] = {}
    delays_of_way: dict[int, list[RunDelay]] = {}
    for role, item in ways.items():
        scored: dict[str, Error] = {}
        for part in parts:
            if rest is None:
                break
            way, name = item[part.outputs[0]], part.outputs[0]
            adapted_part = _part_of(models[role], part)
            if id(way) not in delays_of_way:
                last = new_delays[name][-1] if going_on else None
                delays_of_way[id(way)] = _rest_delays(adapted_part, rest, noise, calibrate, last, way.candidate.timing)
            delays = delays_of_way[id(way)]
            scored |= errors_after(adapted_part, rest, delays)
            if role == "chosen":
                calibrated[part.outputs[0]] = delays
        length = 0.0 if rest is None else rest.duration
        expected = {
            output: foretold(item[part.outputs[0]].candidate.pieces, length, noise[output], scatter[part.outputs[0]])
            for part in parts
            for output in part.outputs
        }
        name = " and ".join(dict.fromkeys(way.candidate.words for way in item.values()))
        outcomes[role] = Outcome(name, scored, expected)
    final = models["chosen"]
    sd = {
        parameter.name: fit.sd.get(parameter.name, np.full(parameter.shape, np.nan)) for parameter in final.parameters
    }
    for way in ways["chosen"].values():
        sd |= way.sd
    in_sample = _in_sample(final, parts, new, new_delays, ways["chosen"])
    stages = tuple(way.stage for way in ways["chosen"].values() if way.stage is not None)
    result = replace(
        fit, model=final, sd={item.name: np.broadcast_to(sd[item.name], item.shape) for item in final.parameters},
        stages=(*fit.stages, *stages), dof={}, covariance=None, per_run={}, verdict=None,
        metrics={"train": as_dict(score(final, new))},
        data=(data_record(new, "train"),),
        how={**fit.how, "adapted": {name: way.candidate.words for name, way in ways["chosen"].items()}},
    )  # fmt: skip
    return Adaptation(
        fit=result, chosen=outcomes["chosen"], zero_shot=outcomes["zero_shot"], adapted=outcomes["adapted"],
        choices={name: way.candidate.words for name, way in ways["chosen"].items()}, tried=tried,
        delays=_named({name: new_delays[name] for name, way in ways["chosen"].items() if way.candidate.timing}),
        calibrated=_named(calibrated), moved=moved_from(fit, final), seconds=float(seconds), in_sample=in_sample,
        cpu_seconds=time.process_time() - clock,
    )  # fmt: skip


def _candidates(as_it_is: LinearisedPart, moved: LinearisedPart, free: str) -> list[AdaptedCandidate]:
    """Zero-shot first, then timing, then sets of parameters, on aligned readings if timing helps significantly."""
    (zero,) = as_it_is.candidates("", timing=False)
    (timing,) = moved.candidates("", timing=True)
    helps = surely_better(_common(timing, zero), _common(zero, timing))
    about = moved if helps else as_it_is
    sets = COMPARED if free == "auto" else (free,)
    result = [candidate for each in sets for candidate in about.candidates(each, timing=helps)]
    return [zero, timing, *result] if free == "auto" else [zero, *result]


def _common(one: AdaptedCandidate, other: AdaptedCandidate) -> Array:
    """The pieces of a candidate that both have: aligned readings end a little earlier."""
    return one.pieces[: min(len(one.pieces), len(other.pieces))]


def _way(candidate: AdaptedCandidate, linearised: LinearisedPart, fit: Fit) -> _Way:
    """The part adapted as a candidate describes, without linearisation."""
    part = linearised.part
    if not candidate.free:
        return _Way(candidate, part, {})
    clock = time.process_time()
    names = members(candidate.free, part)
    part_with_free = part.with_parameters(
        *(replace(parameter, fixed=parameter.name not in names) for parameter in part.parameters)
    )
    free, precision = linearised.mask(candidate.free), candidate.strength**2 * linearised.learnt
    precision = precision * np.outer(free, free)
    problem = Held(part_with_free, linearised.recording, linearised.problem.noise, precision)
    solution = gauss_newton(problem, problem.start, max_steps=STEPS, tolerance=1e-5)
    if solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    adapted_part = part_with_free.with_parameters(*unpack(part_with_free.parameters, problem.shared(solution.x)))
    H = problem.normal_equations(solution.x, solution.nodes).H[np.ix_(free, free)]
    spread = np.zeros(part.size)
    spread[free] = np.sqrt(np.maximum(np.diag(la.pinvh(H)), 0.0) * correlation_time(linearised.r))
    sd = {
        item.name: spread[place].reshape(item.shape)
        for item, place in placed(part_with_free.parameters)
        if item.name in names
    }
    stage = Stage(
        model=f"{part.name}, adapted", closed_loop=False, status=solution.status.value,
        converged=solution.status is Status.CONVERGED, steps=solution.steps, history=solution.history,
        starts=(solution.objective,), strengths={ADAPTING: candidate.strength}, strengths_from="cross-validation",
        tried=(),
        noise=dict(zip(part.outputs, problem.noise.tolist(), strict=True)),
        cpu_seconds=time.process_time() - clock, cross_validation_seconds=0.0, certificate=None,
    )  # fmt: skip
    return _Way(candidate, adapted_part, sd, stage)


def _continues(recording: Recording, cut: int) -> bool:
    """Whether a run continues across a row."""
    return any(start < cut < stop for start, stop in recording.runs)


def _rest_delays(
    part: MemoryModel,
    rest: Recording,
    noise: Mapping[str, float],
    calibrate: float | None,
    going_on: RunDelay | None,
    timing: bool,
) -> list[RunDelay]:
    """Delays of the runs after the new seconds.

    The run that continues keeps the delay estimated from the new seconds, if it is used; other runs have none, or
    one estimated from their own first seconds, which are then not scored.
    """
    delays = [] if calibrate is None else run_delays(part, rest, noise, calibrate)
    if going_on is None or not (calibrate is not None or timing):
        return delays
    return [replace(going_on, run=0, stop=0), *(delay for delay in delays if delay.run > 0)]


def _named(delays: Mapping[str, Sequence[RunDelay]]) -> dict[str, dict[str, float]]:
    """Run, from 1 -> output -> delay."""
    result: dict[str, dict[str, float]] = {}
    for output, several in delays.items():
        for item in several:
            result.setdefault(str(item.run + 1), {})[output] = item.delay
    return result


def _in_sample(
    model: MemoryModel,
    parts: Sequence[MemoryModel],
    new: Recording,
    delays: Mapping[str, Sequence[RunDelay]],
    ways: Mapping[str, _Way],
) -> dict[str, dict[str, float]]:
    """Pooled errors on the data of the adaptation, with the fraction of variance unexplained as in the paper."""
    result: dict[str, dict[str, float]] = {}
    for part in parts:
        name, adapted_part = part.outputs[0], _part_of(model, part)
        prediction = timed(
            adapted_part, new, {o.run: o.delay for o in delays[name]} if ways[name].candidate.timing else {}
        )
        pooled, published = errors(adapted_part, prediction, "honest"), errors(adapted_part, prediction, "published")
        result |= {o: {"rmse": pooled[o].rmse, "fvu_pooled": published[o].fvu_pooled} for o in adapted_part.outputs}
    return result


def _part_of(model: MemoryModel, part: MemoryModel) -> MemoryModel:
    """The whole model's part with the outputs of `part`, at the whole model's values."""
    return next(item for item in parts_of(model) if item.outputs == part.outputs)


def _whole(model: MemoryModel, ways: Sequence[_Way]) -> MemoryModel:
    """The whole model at the values of its parts, with the effects that changed."""
    values = {parameter.name: parameter for way in ways for parameter in way.model.parameters if way.candidate.free}
    for name in FEW:
        if name in values and name not in model and float(values[name].array) != values[name].null:
            model = model + EFFECTS[name].at(float(values[name].array))
    return model.with_parameters(
        *(
            parameter.with_value(values[parameter.name].array)
            for parameter in model.parameters
            if parameter.name in values
        )
    )
