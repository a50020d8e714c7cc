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
    fit, recording, seconds, validate = task.fit, task.recording, task.seconds, task.validate
    parts = [about_itself(part_with_few(part)) for part in parts_of(model)]
    if task.free != "auto":
        must_name_something(task.free, parts)
    new, rest = parted(recording, seconds)
    rest = rest if validate is None else validate
    if validate is not None:
        validate.must_run()
    noise = residual_noise(fit, new)
    compared = {part.outputs[0]: _compared(part, task, new, noise) for part in parts}
    models = {role: _whole(model, [each.ways[role] for each in compared.values()]) for role in ROLES}
    goes_on = validate is None and _continues(recording, len(new))
    scored = _Scored(task, rest, noise, goes_on)
    outcomes = {role: scored.outcome(models[role], parts, compared, role) for role in ROLES}
    final, ways = models["chosen"], {name: each.ways["chosen"] for name, each in compared.items()}
    delays = {name: each.delays for name, each in compared.items()}
    in_sample = _in_sample(final, parts, new, delays, ways)
    choices = {name: way.candidate.words for name, way in ways.items()}
    return Adaptation(
        fit=_fit(fit, final, new, ways, choices),
        chosen=outcomes["chosen"], zero_shot=outcomes["zero_shot"], adapted=outcomes["adapted"], choices=choices,
        tried={name: each.tried for name, each in compared.items()},
        delays=_named({name: delays[name] for name, way in ways.items() if way.candidate.timing}),
        calibrated=_named({name: scored.delays[id(way)] for name, way in ways.items()} if rest is not None else {}),
        moved=moved_from(fit, final), seconds=float(seconds), in_sample=in_sample,
        cpu_seconds=time.process_time() - clock,
    )  # fmt: skip


ROLES = ("chosen", "zero_shot", "adapted")


@dataclass(frozen=True)
class _Compared:
    """Adaptations of a part that were compared on the new seconds.

    Attributes
    ----------
    ways : role -> way.
    tried : words of each candidate, and its error.
    delays : of the runs of the new seconds.
    scatter : of the part between runs.
    """

    ways: Mapping[str, _Way]
    tried: list[tuple[str, float]]
    delays: list[RunDelay]
    scatter: float


def _compared(part: MemoryModel, task: AdaptTask, new: Recording, noise: Mapping[str, float]) -> _Compared:
    task.say(f"{part.outputs[0]}: comparing sets of free parameters on {task.seconds:g} s")
    precision, scatter = learnt(part, noise, task.fit.sd, task.trained), between_runs(part, task.trained)
    delays = run_delays(part, new, noise)
    aligned_new = aligned(new, part.inputs, {item.run: item.delay for item in delays})
    as_it_is, moved = (LinearisedPart(part, item, noise, precision) for item in (new, aligned_new))
    candidates = _candidates(as_it_is, moved, task.free)
    unchanged = candidates[0]
    best = chosen(candidates)
    other = chosen([item for item in candidates if item is not unchanged]) if len(candidates) > 1 else unchanged
    made = {id(item): _way(item, moved if item.timing else as_it_is, task.fit) for item in (unchanged, best, other)}
    adapted_most = other if best is unchanged else best
    ways = {"chosen": made[id(best)], "zero_shot": made[id(unchanged)], "adapted": made[id(adapted_most)]}
    return _Compared(ways, [(item.words, item.error) for item in candidates], delays, scatter)


class _Scored:
    """Errors of adapted models on what follows the new seconds, or on a recording to validate on; none without these.

    Parameters
    ----------
    task : of the adaptation.
    rest : what errors are computed on.
    noise : of each output.
    goes_on : whether the first run of the rest continues the new seconds.
    """

    def __init__(self, task: AdaptTask, rest: Recording | None, noise: Mapping[str, float], goes_on: bool) -> None:
        self.calibrate, self.rest, self.noise, self.goes_on = task.calibrate, rest, noise, goes_on
        self.delays: dict[int, list[RunDelay]] = {}

    def outcome(
        self, model: MemoryModel, parts: Sequence[MemoryModel], compared: Mapping[str, _Compared], role: str
    ) -> Outcome:
        """Errors, and those that were expected, of the model of one role."""
        scored, expected = dict[str, Error](), dict[str, tuple[float, float]]()
        length = 0.0 if self.rest is None else self.rest.duration
        for part in parts:
            each = compared[part.outputs[0]]
            way = each.ways[role]
            if self.rest is not None:
                adapted_part = _part_of(model, part)
                if id(way) not in self.delays:
                    last = each.delays[-1] if self.goes_on else None
                    self.delays[id(way)] = _rest_delays(
                        adapted_part, self.rest, self.noise, self.calibrate, last, way.candidate.timing
                    )
                scored |= errors_after(adapted_part, self.rest, self.delays[id(way)])
            for output in part.outputs:
                expected[output] = foretold(way.candidate.pieces, length, self.noise[output], each.scatter)
        name = " and ".join(dict.fromkeys(each.ways[role].candidate.words for each in compared.values()))
        return Outcome(name, scored, expected)


def _fit(fit: Fit, final: MemoryModel, new: Recording, ways: Mapping[str, _Way], choices: Mapping[str, str]) -> Fit:
    """The fit of the adapted model."""
    sd = {item.name: fit.sd.get(item.name, np.full(item.shape, np.nan)) for item in final.parameters}
    for way in ways.values():
        sd |= way.sd
    stages = tuple(way.stage for way in ways.values() if way.stage is not None)
    return replace(
        fit, model=final, sd={item.name: np.broadcast_to(sd[item.name], item.shape) for item in final.parameters},
        stages=(*fit.stages, *stages), dof={}, covariance=None, per_run={}, verdict=None,
        metrics={"train": as_dict(score(final, new))},
        data=(data_record(new, "train"),), how={**fit.how, "adapted": dict(choices)},
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
