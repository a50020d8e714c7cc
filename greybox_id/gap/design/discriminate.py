"""Design for explanations that recordings could not distinguish, and for effects that they could not show.

For every pair of rivals, a plan is rated by the log-likelihood that the wrong one loses on the readings that the other
one would give, after all that is uncertain has adapted by Gauss-Newton: its own magnitude and the vehicle's tolerances.
The rating of a plan is that of its worst pair (T-optimality: Atkinson & Fedorov, Biometrika 62, 1975, with priors).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations
from math import inf, isfinite

import numpy as np

from ...base.errors import BadInput, near_or_all
from ...base.shorthands import Array, Say
from ...datasets.recording import Recording
from ...engine.motion.shooting import MotionProblem
from ...engine.motion.simulator import Simulator
from ...models.effect import Effect
from ...models.motion_model import MotionModel
from ...models.vehicle import StatedModelError
from ..advice import same_readings
from ..estimation.axes import scalars
from ..estimation.model_error import Amplitudes, amplitude_prior
from ..gap import Gap
from .course import PlannedMotion
from .plan import Design, Separation
from .scatter import ROUGH_RATE, ExpectedErrors, Rough
from .search import FoundPlan, PlanSearch
from .task import FARTHEST, DesignTask

ENOUGH = 12.0
"""Separation, in nats, at which explanations count as distinguished: the wrong one has a posterior probability of 6e-6,
without tempering."""
HOPELESS = 3.0
"""Nats below which the best manoeuvre does not distinguish explanations."""
CLEARLY = 3.0 * ENOUGH
"""Nats at which a search ends: draws and coarse simulation may overrate a plan."""
MOST_RIVALS = 4
DRAWS, AVERAGED = 24, 8
"""Draws of what is uncertain that must keep to limits, of each rival; those over which separations are averaged."""
LATE = 0.5
"""s at the beginning, in which a late sensor may have no reading yet."""
STEPS, SETTLED = 16, 0.1
"""Most Gauss-Newton steps (damped where one is too long) in which an explanation adapts, and nats below which another
step is not taken; one step while searching."""
NORMAL_95 = 1.96
LIKELY = 0.05
"""Explanations that are less probable are no rivals."""


@dataclass(frozen=True)
class Rival:
    """One explanation.

    Attributes
    ----------
    name : its effect.
    model : with the effect and all stated tolerances free; it has the effects of all rivals.
    sd : of the effect's magnitude, as far as the diagnosis determines it.
    """

    name: str
    model: MotionModel
    sd: float = 0.0


def ambiguous(gap: Gap) -> tuple[str, ...]:
    """The likeliest set of effects that a diagnosis could not distinguish, the likeliest first; empty if there is none.

    These are effects with the same readings on such recordings, and those that remain likely beside an uncertain one.
    """
    for item in gap.ranking if gap.gap_detected else ():
        if item.probability < LIKELY:
            continue
        alike = [name for name in item.indistinguishable_from if name != item.effect]
        likely = [
            other.effect
            for other in gap.ranking
            if other.effect != item.effect and other.probability >= LIKELY
            and max(item.probability, other.probability) < 1.0 - LIKELY
            and not {item.effect, other.effect} <= set(gap.applied)
        ]  # fmt: skip
        if others := tuple(dict.fromkeys([*likely, *alike])):
            return (item.effect, *others)
    return ()


def distinguishable_effects(names: Sequence[str]) -> tuple[tuple[str, ...], tuple[tuple[str, str], ...]]:
    """Effects that some manoeuvre may distinguish, and pairs with the same readings whatever is driven.

    Of such a pair, the first effect stays and stands for both.
    """
    pairs = tuple(pair for pair in combinations(names, 2) if same_readings(pair))
    stood_for = {other for _, other in pairs}
    return tuple(name for name in names if name not in stood_for), pairs


def discriminating(
    gap: Gap, model: MotionModel, effects: Mapping[str, Effect], design_task: DesignTask, say: Say
) -> Design:
    """The manoeuvre that distinguishes the explanations of a gap.

    Parameters
    ----------
    gap : the diagnosis.
    model : that was diagnosed, with its vehicle's tolerances.
    effects : by name.

    Raises
    ------
    BadInput : the model cannot predict manoeuvres, or none fits into the arena and the limits.
    """
    names = ambiguous(gap)
    if not names:
        return _nothing("discriminate", model, design_task, f"There is nothing to distinguish: {_alone(gap)}.")
    distinguishable, alike = distinguishable_effects(names)
    impossible = [
        f"{one} and {other} produce the same readings in every manoeuvre, so no manoeuvre distinguishes them: measure "
        "the mounting angle of the sensor."
        for one, other in alike
    ]
    known = tuple(name for name in distinguishable if name in effects and effects[name].concerns(model))
    if unheld := [name for name in distinguishable if name not in known]:
        impossible.append(f"{', '.join(unheld)}: left out, since this model has no equations for it.")
    if len(known) < 2:
        why = "No manoeuvre distinguishes them." if alike else "There is nothing to distinguish."
        return _nothing("discriminate", model, design_task, why, impossible)
    chosen = known[:MOST_RIVALS]
    rivals = _Rivals(gap, _explanations(gap, model, effects, chosen), design_task)
    found_plan, separation = rivals.separated(say)
    impossible += [
        f"No manoeuvre that was found in {design_task.arena.words} distinguishes {item.pair[0]} from {item.pair[1]} "
        f"(separation {item.nats:.1f} nats; {ENOUGH:g} are needed)."
        for item in separation
        if item.nats < HOPELESS
    ]
    sentences = [f"Purpose: to distinguish {chosen[0]} from {', '.join(chosen[1:])}."]
    worst = min(item.nats for item in separation)
    if HOPELESS <= worst < ENOUGH:
        sentences.append(
            f"The separation in one drive is {worst:.1f} nats, but {ENOUGH:g} are needed: drive the manoeuvre "
            "several times, or use a larger arena."
        )
    return rivals.design("discriminate", chosen, found_plan, separation, impossible, sentences)


def _alone(gap: Gap) -> str:
    """Why a diagnosis leaves no two effects to distinguish."""
    if not gap.gap_detected:
        return "no gap was detected"
    if gap.applied or gap.unknown_probability <= LIKELY:
        return "the diagnosis already distinguishes its explanations"
    return (
        "no two named effects are similarly likely, and an unmodelled effect is present with probability "
        f"{min(gap.unknown_probability, 0.99):.2f}"
    )


def detecting(
    gap: Gap, model: MotionModel, effects: Mapping[str, Effect], names: Sequence[str], design_task: DesignTask, say: Say
) -> Design:
    """The manoeuvre that shows effects that recordings could not: each at its usual size against none.

    Parameters
    ----------
    names : effects; none: those that the diagnosis calls not excited.

    Raises
    ------
    BadInput : a name is no effect that the model may have, or no manoeuvre fits into the arena and the limits.
    """
    for name in names:
        if name not in effects or not effects[name].concerns(model):
            raise BadInput(f"‹parameters› {name}: no effect of {model.name}.{near_or_all(name, tuple(effects))}")
    unseen = [*gap.not_excited, *(name for name, limit in gap.limits.items() if limit.share > 1)]
    target = tuple(dict.fromkeys(names or unseen))
    target = tuple(name for name in target if name in effects and effects[name].concerns(model))
    if not target:
        why = "There is nothing to detect: at their usual sizes, all effects would have shown."
        return _nothing("detect", model, design_task, why)
    chosen = target[:MOST_RIVALS]
    shown = _explanations(gap, model, effects, chosen, typical=True)
    rivals = _Rivals(gap, [_without(shown[0]), *shown], design_task, detect=True)
    found_plan, separation = rivals.separated(say)
    impossible = [
        f"No manoeuvre was found in {design_task.arena.words} that shows {item.pair[0]} at its usual size "
        f"(separation {item.nats:.1f} nats)."
        for item in separation
        if item.nats < HOPELESS
    ]
    sentences = [f"Purpose: to detect {', '.join(chosen)} at usual sizes."]
    if len(target) > len(chosen):
        sentences.append(f"Left out: {', '.join(target[len(chosen) :])}; name them as parameters.")
    return rivals.design("detect", chosen, found_plan, separation, impossible, sentences)


class _Rivals:
    """Rival explanations, and how far a plan separates them.

    To detect effects, each is only compared with the first one, no effect; else all pairs are.
    """

    def __init__(self, gap: Gap, rivals: Sequence[Rival], design_task: DesignTask, *, detect: bool = False) -> None:
        first, every = rivals[0].model, range(len(rivals))
        self.rivals, self.task, self.detect = rivals, design_task, detect
        self.pairs = [(k, 0) for k in every[1:]] if detect else list(combinations(every, 2))
        self.ways = self.pairs if detect else list(permutations(every, 2))
        self.samples = [_drawn(rival, DRAWS, design_task.seed) for rival in rivals]
        self.drive = _drive_of(first)
        self.read, amplitudes = _amplitudes(gap, first)
        self.errors = ExpectedErrors(first, amplitudes)
        names = [rival.name for rival in rivals]
        self.held = [Rough(rival.model, names) for rival in rivals]  # other delays fixed: readings jump at rows
        simulator = Simulator(self.held[0].model)
        simulator.kernel.prepare()
        self.simulators = [simulator.of(item.model) for item in self.held]
        self.shared = np.array([p.name not in names for p in first.parameters for _ in range(p.size)])
        count = len(rivals)
        self.search = PlanSearch(
            design_task, first, self.samples, self.worth, enough=ENOUGH if detect else CLEARLY,
            pairs=max(1, count * (count - 1) // 2),
        )  # fmt: skip

    def separated(self, say: Say) -> tuple[FoundPlan, tuple[Separation, ...]]:
        """The best plan, or one that is good enough, and the separation of each pair: mean and 10 % quantile of draws.

        Of a pair, either explanation may be true: the smaller separation counts.
        """
        found_plan = self.search.best(say)
        each = [self._losses_by_pair(found_plan.plan, k, self.ways) for k in range(AVERAGED)]
        separation = []
        for a, b in self.pairs:
            ways = [[self.task.repeat * lost[way] for lost in each] for way in ((a, b), (b, a)) if way in each[0]]
            nats = min(ways, key=np.mean)
            pair = (self.rivals[a].name, self.rivals[b].name)
            separation.append(Separation(pair, float(np.mean(nats)), float(np.quantile(nats, 0.1))))
        return found_plan, tuple(separation)

    def design(
        self, goal: str, names: Sequence[str], found_plan: FoundPlan, separation: tuple[Separation, ...],
        impossible: Sequence[str], sentences: Sequence[str],
    ) -> Design:  # fmt: skip
        """The design of a plan."""
        after = min(item.nats for item in separation)
        return self.search.design(
            goal, found_plan, criterion={"name": "t", "parameters": list(names), "before": 0.0, "after": after},
            drive=self.drive, impossible=tuple(impossible), separation=separation, said=tuple(sentences),
        )  # fmt: skip

    def worth(self, plans: Sequence[PlannedMotion], rough: bool) -> list[float]:
        """Nats by which each plan separates its worst pair, and a little for others; to detect, mean over effects.

        More than is needed does not count.
        """
        result = []
        for plan in plans:
            lost = self._losses_by_pair(plan, 0, self.pairs if rough else self.ways, rough=rough)
            nats = np.array([min(lost[pair], lost.get(pair[::-1], inf)) for pair in self.pairs])
            if self.detect:
                result.append(float(np.mean(np.minimum(nats, ENOUGH))))
            else:  # the others count a little, so that a search makes progress on them
                nats = np.minimum(nats, CLEARLY)
                result.append(float(np.min(nats) + 0.05 * np.mean(nats)))
        return result

    def _losses_by_pair(
        self, plan: PlannedMotion, draw: int, ways: Sequence[tuple[int, int]], *, rough: bool = False
    ) -> dict[tuple[int, int], float]:
        """(true, wrong) -> nats that the wrong one loses on readings of the true one at a draw, after both adapted.

        Roughly with only some of the rows, no delays but those of rivals, and a single step.
        """
        every, steps = (max(1, round(self.task.rate / ROUGH_RATE)), 1) if rough else (1, STEPS)
        result = dict.fromkeys(ways, 0.0)
        for true in {true for true, _ in ways}:
            p = self.samples[true][draw]
            p = self.held[true].of(p) if rough else p
            recording = self._readings(plan, true, p, every)
            if recording is None:
                continue
            drawn = not np.array_equal(p[self.shared], self.rivals[true].model.values[self.shared])
            true_cost = self._cost(recording, true, p, steps, every) if drawn else 0.0
            for wrong in (other for one, other in ways if one == true):
                wide = np.where(self.shared, p, self.rivals[wrong].model.values)
                result[true, wrong] = max(self._cost(recording, wrong, wide, steps, every) - true_cost, 0.0)
        return result

    def _cost(self, recording: Recording, rival: int, p: Array, steps: int, every: int) -> float:
        """Cost, in nats, of readings and tolerances for a rival that adapts from p on; zero where it is not finite."""
        ones = np.ones(len(self.rivals[rival].model.outputs))
        problem = MotionProblem(self.simulators[rival], [recording], noise=ones, starts="free", about=p)
        white = self.errors.whitener(recording, p, every)
        low, high = problem.bounds
        x = at = problem.unknowns(p)
        best, known, damping = inf, inf, 0.0
        H, g, scale, moving = np.zeros((0, 0)), np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.intp)
        for _ in range(steps + 1):
            nodes = problem.simulated_nodes(x)
            (rows,), ((own_e, own_J),) = problem.rows_of_intervals(nodes), problem.residuals(x, nodes)
            cost = inf
            if np.all(np.isfinite(own_e)) and np.all(np.isfinite(own_J)):
                there = np.flatnonzero(problem.free & np.any(own_J != 0, axis=(0, 1)))
                e = np.zeros((len(recording), len(ones), 1 + len(there)))
                e[rows, :, 0], e[rows, :, 1:] = own_e, own_J[:, :, there]
                both = white(e).reshape(-1, 1 + len(there))
                cost = 0.5 * float(both[:, 0] @ both[:, 0]) + 0.5 * float(np.sum(problem.prior_residuals(x) ** 2))
            if isfinite(cost) and cost < best:
                settled = best - cost < SETTLED
                best, at, moving, damping = cost, x, there, 0.1 * damping
                W = both[:, 1:]
                H = W.T @ W + problem.prior_curvature[np.ix_(moving, moving)]
                g = W.T @ both[:, 0] + problem.prior_gradient(x)[moving]
                scale = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-300))
                if settled:
                    break
            elif best < inf:  # too far: the linearisation does not hold there (Levenberg's damping)
                damping = max(10.0 * damping, 0.1)
            else:
                break
            damped = H * np.outer(scale, scale) + damping * np.eye(len(H))
            step = np.zeros(len(x))
            step[moving] = -scale * np.linalg.lstsq(damped, scale * g, rcond=1e-11)[0]
            known = max(best + 0.5 * float(g @ step[moving]), 0.0) if damping == 0.0 else best
            if damping == 0.0 and best - known < SETTLED:
                break
            x = np.clip(at + step, low, high)
        return min(known, best) if isfinite(best) else 0.0

    def _readings(self, plan: PlannedMotion, true: int, p: Array, every: int) -> Recording | None:
        """The readings if a rival were true, with commands as planned; one row of `every`."""
        time, outputs = plan.time[::every], self.rivals[true].model.outputs
        commands = {"steer": plan.steer[::every], self.drive: plan.drive[::every]}
        planned = {name: plan.of(name)[::every] if name in ("v_x", "v_y", "yaw_rate") else np.zeros(len(time))
                   for name in self.read}  # fmt: skip
        recording, ones = Recording("plan", time, commands | planned), np.ones(len(outputs))
        problem = MotionProblem(self.simulators[true], [recording], noise=ones, starts="measured", about=p)
        y = problem.simulated_nodes(problem.unknowns(p)).y[:, [outputs.index(name) for name in self.read]]
        if not np.all(np.isfinite(y[time >= LATE])):
            return None
        return Recording("plan", time, commands | dict(zip(self.read, y.T, strict=True)))


def _explanations(
    gap: Gap, model: MotionModel, effects: Mapping[str, Effect], names: Sequence[str], *, typical: bool = False
) -> list[Rival]:
    """Each of some effects at its magnitude, or its usual one: all others of them are at their null.

    Further effects that a diagnosis applied are at their magnitudes.
    """
    ranked = {item.effect: item for item in gap.ranking}
    for other in gap.applied:
        if other not in names and other in effects and other not in model.effects and other in ranked:
            model = model + effects[other].at(ranked[other].magnitude)
    for name in names:
        if name not in model.effects:
            model = model + effects[name].at(float(effects[name].parameter.array))
    model = model.with_parameters(
        *(replace(p, fixed=True) for p in model.parameters if not p.fixed and p.prior is None)
    )
    result = []
    for name in names:
        effect, item, sd = effects[name], ranked.get(name), 0.0
        size = effect.typical
        if item is not None and not typical:
            size, sd = item.magnitude, (item.interval[1] - item.interval[0]) / (2.0 * NORMAL_95)
        value = np.clip(size, *effect.parameter.bounds)
        free = replace(model[effect.parameter.name], value=np.asarray(value), fixed=False, prior=None)
        result.append(Rival(free.name, model.with_parameters(free), sd if isfinite(sd) else 0.0))
    return result


def _without(rival: Rival) -> Rival:
    """The same model without the rival's effect."""
    parameter = rival.model[rival.name]
    assert parameter.null is not None
    parameter = replace(parameter, value=np.asarray(parameter.null), fixed=True)
    return Rival("nothing", rival.model.with_parameters(parameter))


def _drawn(rival: Rival, count: int, seed: int) -> Array:
    """(count, parameters) draws of the parameters with tolerances and of the effect's magnitude, nominal first."""
    rng = np.random.default_rng((seed, 907))
    result = np.tile(rival.model.values, (count, 1))
    for k, parameter in scalars(rival.model):
        if not parameter.fixed and (parameter.prior is not None or parameter.name == rival.name):
            sd = rival.sd if parameter.prior is None else float(np.max(np.asarray(parameter.prior.sd)))
            moved = result[1:, k] + sd * np.clip(rng.standard_normal(count - 1), -FARTHEST, FARTHEST)
            result[1:, k] = np.clip(moved, *parameter.bounds)
    return result


def _amplitudes(gap: Gap, model: MotionModel) -> tuple[tuple[str, ...], Amplitudes]:
    """Outputs that were read, and sizes of model error and noise by the diagnosis; `BadInput` where it has none."""
    floors: dict[str, float] = {}
    for error in (*gap.gap.errors, *(gap.held_out.errors if gap.held_out is not None else ())):
        if error.channel in model.outputs and isfinite(error.floor) and error.floor > 0:
            floors[error.channel] = min(error.floor, floors.get(error.channel, inf))
    if not floors:
        raise BadInput("The diagnosis holds no noise levels: write its file (gap.json) anew with greybox gap, ‹out›.")
    result, stated = gap.unnamed, dict[str, StatedModelError]()
    if result is not None:
        stated["F_y"] = StatedModelError(result.share_y, result.floor_y, result.memory_y)
        stated["F_x"] = StatedModelError(result.share_x, result.floor_x, result.memory_x)
    usual = amplitude_prior(np.array([floors.get(name, 1.0) for name in model.outputs]), True, False, stated).median
    return tuple(name for name in model.outputs if name in floors), usual


def _drive_of(model: MotionModel) -> str:
    """The signal of the drive command: of newtons, amperes and accelerations, the one that force_per_unit suits."""
    names = model.aliases.get("drive", ("drive",))
    if "force_per_unit" not in model:  # its speed is an input, not simulated
        return names[0]
    per_unit, m = float(model["force_per_unit"].array), float(model["m"].array)
    if abs(per_unit - 1.0) < 0.05 and "drive_force" in names:
        return "drive_force"
    if abs(per_unit / m - 1.0) < 0.3 and "ax_cmd" in names:
        return "ax_cmd"
    return "motor_current" if "motor_current" in names else names[0]


def _nothing(
    goal: str, model: MotionModel, design_task: DesignTask, why: str, impossible: Sequence[str] = ()
) -> Design:
    """A design without a manoeuvre, and why."""
    criterion = {"name": "t", "parameters": [], "before": 0.0, "after": 0.0}
    return Design(
        goal, model.name, design_task.arena, design_task.limits, _drive_of(model), criterion,
        impossible=tuple(impossible), said=(why,),
    )  # fmt: skip
