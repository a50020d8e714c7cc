"""Search for a plan: many random chains of primitives, mended to fit, the best of them refined by CMA-ES.

A `Worth` rates plans; this module decides whether they can be driven: within the arena and all limits, with nominal
parameters and for draws of the uncertain ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from ...base.errors import BadInput
from ...base.shorthands import Array, Say
from ...models.motion_model import MotionModel
from .arena import NOWHERE, Placement
from .cma import CMA
from .course import AT, PlanCourse, PlannedMotion, strain, worst_strain
from .driver import driver_of, vehicle_of
from .limits import CAR
from .plan import Design
from .primitives import SHAPES, Phase, chained
from .task import NEEDED, DesignTask

Worth = Callable[[Sequence[PlannedMotion], bool], list[float]]
"""(plans, whether a coarse value suffices) -> value of each plan, in nats: more is better."""

SKETCHED, TRIED, MENDED = 2400, 240, 3
"""Chains drawn at random and sketched without tyre slip; those of them that are simulated, as they fit best into the
arena; rounds in which those that break limits are made gentler or slower."""
STANDARD: Sequence[tuple[tuple[str, float, float, float], ...]] = (
    (("straight", 0.0, 0.0, 0.5), ("straight", 0.0, 1.0, 1.5)),
    (("straight", 0.0, 1.0, 1.0), ("straight", 0.0, 0.0, 1.5), ("straight", 0.0, 1.0, 1.0)),
    (("steps", 0.6, 1.0, 1.0),),
    (("sweep", 0.7, 1.0, 1.0),),
    (("spiral", 1.0, 1.0, 1.0), ("spiral", -1.0, 1.0, 1.0)),
    (("straight", 0.0, 1.0, 1.0), ("turn", 0.7, 0.0, 1.0), ("turn", -0.7, 1.0, 1.0)),
)
"""Test manoeuvres (accelerating, braking and coasting, steps, a slalom of growing frequency, spirals, braking and
accelerating in turns), which random chains seldom hit: shape, amplitude, share of the fastest speed, duration."""
PACES = (0.35, 0.65, 1.0)
"""Shares of the fastest speed at which these are tried."""
SKETCH_RATE = 5.0
"""Rows a second of sketches."""
REFINED, GENERATIONS, HEAT = 3, 40, 10
"""Chains that are refined, generations for the best of them, and generations after which it is chosen."""
SETTLED = 0.1
"""Nats that the best plan must have gained in a heat to get another one: 1 % of each of five standard deviations; draws
of the same posterior differ by more."""
MOST_PHASES = 4
AT_ONCE = 8
"""Plans that are simulated at once: the lanes of the kernel."""
GENTLER = 20
"""Steps in which a plan is made gentler so that draws keep to limits: an eighth of its steering is left in the end."""
PENALTY = 30.0
"""Cost, in nats, of exceeding a limit by 100 %."""
SURE, HARDEST = 4, 4
"""Chains that are tested on draws beside the refined ones; draws that stand for all of them while a chain is
refined."""
SPARE = 0.97
"""Share of limits that the nominal motion may use: draws use the rest."""
BEYOND = {
    "grip": "an axle uses more of its friction than is allowed (grip)",
    "sideslip": "sideslip exceeds its limit (sideslip_max)",
    "speed": "speed exceeds its limit (speed_max)",
}
"""Which limit is exceeded, in words."""
BACKING = 0.5
"""Run-up to the first speed, at this share of the largest acceleration, counts as part of the path."""


@dataclass(frozen=True)
class FoundPlan:
    """A plan with its value.

    Attributes
    ----------
    phases : of the chain.
    duration : s.
    plan : motion with the nominal parameters.
    placement : in the arena.
    worth : nats.
    broken : largest relative excess over a limit; at most zero where all are kept.
    """

    phases: tuple[Phase, ...]
    duration: float
    plan: PlannedMotion
    placement: Placement
    worth: float
    broken: float


class PlanSearch:
    """Searches for a plan.

    Parameters
    ----------
    task : arena, limits and the like.
    model : of the vehicle.
    samples : of every explanation that may be true, (K, parameters) draws of what is uncertain; the plan is made with
        the first draw of the first one.
    worth : rates plans.
    enough : value beyond which no better plan is searched for.
    pairs : number of pairs that `worth` compares, to which its time is proportional.

    Raises
    ------
    BadInput : the model cannot predict manoeuvres, or nothing fits into the arena.
    """

    def __init__(
        self, task: DesignTask, model: MotionModel, samples: Sequence[Array], worth: Worth, *,
        enough: float = np.inf, pairs: int = 1,
    ) -> None:  # fmt: skip
        self.samples, self.worth, self.enough, self.effort = samples, worth, enough, task.effort / pairs
        self.task, self.vehicle = task.cautious(vehicle_of(model), model, samples[0])
        self.task.must_fit()
        self.limits, self.arena = self.task.limits, self.task.arena
        self.course = PlanCourse(model, driver_of(model, self.limits), task.rate, self.limits.speed_min)
        self.rng = np.random.default_rng((task.seed, 6143))
        self.speeds = (1.15 * self.limits.speed_min, self.limits.speed_max)
        self.pace = float(np.sqrt(self.vehicle.length / CAR))

    def best(self, say: Say) -> FoundPlan:
        """The best plan that keeps to all limits. Raises `BadInput` where none does."""
        drawn = self._random()
        inside = [item for item in drawn if item.broken <= 0]
        say(f"{len(drawn)} manoeuvres tried, {len(inside)} within the limits at the estimated parameters")
        if not inside:
            gentlest = min(drawn, key=lambda item: item.broken)
            inside = self._refined([gentlest])
            if not inside:
                raise self._no_room(gentlest)
        scored = sorted(self._scored(inside, rough=True), key=lambda item: -item.worth)
        by_length = {len(item.phases): item for item in reversed(scored)}  # the best one of each
        longer_first = [by_length[count] for count in sorted(by_length, reverse=True)]  # shorter ones are special cases
        refined = self._refined(longer_first[:REFINED])
        tried = sorted([*refined, *scored[:SURE]], key=lambda item: -item.worth)
        kept, most = list[FoundPlan](), -np.inf
        for item in tried:
            if kept and item.worth <= most:  # made gentler, it would be worth even less
                break
            made = self.within_limits(item)
            if made is not None:
                kept.append(made)
                most = max(most, self._scored([made], rough=True)[0].worth)
        if not kept:
            raise self._no_room(tried[0])
        return max(self._scored(kept), key=lambda item: item.worth)

    def _no_room(self, nearest: FoundPlan) -> BadInput:
        """The sentence on why no manoeuvre keeps to the limits."""
        out = nearest.placement.outside + self.limits.margin
        if out > 0 and np.isfinite(out):
            wide = self.arena.breadth + 2.0 * out
            return BadInput(
                f"‹arena› {self.arena.words} is too small: the best manoeuvre leaves the arena by {out:.1f} m. Use an "
                f"arena {wide:.0f} m wide, or a lower ‹speed_max›."
            )
        tight = strain(nearest.plan.motion, self.limits)
        worst = max(tight, key=lambda name: float(tight[name][0]))
        kept = self._kept_by(nearest, self.samples[0])[0]
        return BadInput(
            "The parameters are too uncertain for a plan: even the best manoeuvre keeps to the limits for only "
            f"{100 * kept:.0f} % of the plausible parameter values, and {100 * NEEDED:.0f} % are needed. For the other "
            f"{100 * (1 - kept):.0f} %, {BEYOND[worst]}. Raise this limit (‹limits›), or first drive a gentle "
            "manoeuvre "
            "and fit again."
        )

    def design(self, goal: str, found_plan: FoundPlan, **more: Any) -> Design:
        """The design of a found plan, with its corridor, the limits that it reaches, and further attributes."""
        course, samples = self.course, self.samples[0]
        motion = course.driven(found_plan.plan, samples, follow=self.task.follow)
        good = motion[np.all(np.isfinite(motion), axis=(1, 2))]
        return Design(
            goal, course.model.name, self.arena, self.limits, phases=found_plan.phases, plan=found_plan.plan,
            corridor=np.quantile(good, [0.025, 0.975], axis=0), placement=found_plan.placement, driver=course.driver,
            active_limits=self._used_up(found_plan, good), kept=self._kept_by(found_plan, samples)[0],
            repeat=self.task.repeat, **more,
        )  # fmt: skip

    def _used_up(self, found_plan: FoundPlan, motion: Array) -> tuple[str, ...]:
        """Limits of which a plan uses more than 95 %, for the worst of the draws."""
        limits, plan, tight = self.limits, found_plan.plan, strain(motion, self.limits)
        step = plan.time[1] - plan.time[0]
        change = np.diff(plan.of("v_x")) / step
        shares = {
            "grip": np.quantile(tight["grip"], 0.95),
            "sideslip": np.quantile(tight["sideslip"], 0.95),
            "speed_max": np.max(plan.of("v_x")) / limits.speed_max,
            "steer_max": np.max(np.abs(plan.steer)) / limits.steer_max,
            "steer_rate": np.max(np.abs(np.diff(plan.steer))) / step / limits.steer_rate,
            "drive_max": np.max(change) / (0.9 * limits.drive_max),
            "brake_max": -np.min(change) / (0.9 * limits.brake_max),
            "arena": 1.0 + (found_plan.placement.outside + limits.margin) / (0.5 * self.arena.breadth),
            "duration": found_plan.duration / self.task.duration,
        }
        return tuple(name for name, share in shares.items() if share >= 0.95)

    def within_limits(self, result: FoundPlan) -> FoundPlan | None:
        """The plan, made gentler until enough of the draws keep to the limits; None if they never do."""
        for _ in range(GENTLER):
            kept, guilty = self._kept_by(result, self.samples[0], NEEDED)
            if result.broken <= 0 and kept >= NEEDED:
                return result
            calmer = tuple(
                self._eased(phase, 0.9, 0.93, 0.97) if result.broken > 0 or k in guilty else phase
                for k, phase in enumerate(result.phases)
            )
            result = self._made([(calmer, result.duration)])[0]
        return None

    def _kept_by(self, found_plan: FoundPlan, P: Array, least: float = 0.0) -> tuple[float, frozenset[int]]:
        """Share of the draws that keep to all limits, and the phases in which others break one first.

        All phases are blamed where the arena is left. Below `least`, the exact share does not matter.
        """
        shares, guilty, last = [], set[int](), len(found_plan.phases) - 1  # the stop counts as part of the last phase
        each = [found_plan.plan.phase == k for k in np.unique(found_plan.plan.phase)]
        for item in (P, *(other[: len(P)] for other in self.samples[1:])):
            held = 0
            for a in range(0, len(item), AT_ONCE):
                y = self.course.driven(found_plan.plan, item[a : a + AT_ONCE], follow=self.task.follow)
                out = np.array([self._outside(found_plan.placement, motion) for motion in y])
                broken = np.array([worst_strain(y[:, rows], self.limits) > 1.0 for rows in each])
                within = ~np.any(broken, axis=0)
                held += int(np.sum(within & (out <= 0.0)))
                first = np.argmax(broken[:, ~within], axis=0)
                guilty |= {min(int(found_plan.plan.phase[np.argmax(each[k])]), last) for k in first}
                if np.any(within & (out > 0.0)):
                    guilty |= set(range(last + 1))
                if held + len(item[a + AT_ONCE :]) < least * len(item):
                    return held / len(item), frozenset(guilty)
            shares.append(held / len(item))
        return min(shares), frozenset(guilty)

    def _outside(self, placement: Placement, motion: Array) -> float:
        """By how much a path leaves the arena with the plan's placement, m; infinite where it is not finite."""
        x, y = motion[::5, AT["x"]], motion[::5, AT["y"]]
        if not np.all(np.isfinite(motion[:, [AT["x"], AT["y"]]])):
            return np.inf
        return self.arena.outside(*placement.placed(x, y)) + self.limits.margin

    def _random(self) -> list[FoundPlan]:
        drawn = [self._chain() for _ in range(self._times(SKETCHED))]
        room = np.array([self._sketched(*item) for item in drawn])
        counts = np.array([len(phases) for phases, _ in drawn])
        chosen = list[int]()
        most = self._times(TRIED // MOST_PHASES)
        for count in range(1, MOST_PHASES + 1):  # as many of each length, as short chains fit more easily
            of_length = np.flatnonzero(counts == count)
            inside = of_length[room[of_length] <= 0]
            nearest = of_length[np.argsort(room[of_length], kind="stable")]
            chosen += (inside if len(inside) >= most else nearest)[:most].tolist()
        result = self._made([*(drawn[k] for k in chosen), *self._standard()])
        for _ in range(MENDED):
            wrong = [k for k, item in enumerate(result) if item.broken > 0]
            mended = self._made([self._mended(result[k]) for k in wrong])
            for k, other in zip(wrong, mended, strict=True):
                if other.broken < result[k].broken:
                    result[k] = other
        return result

    def _standard(self) -> list[tuple[tuple[Phase, ...], float]]:
        slow, fast = self.speeds
        result = []
        for chain, pace in product(STANDARD, PACES):
            phases = [
                Phase(shape, amplitude, 0.3 / self.pace, slow + (fast - slow) * share * pace, duration)
                for shape, amplitude, share, duration in chain
            ]
            result.append((tuple(phases), self.task.duration))
        return result

    def _times(self, usual: int) -> int:
        return max(2, round(usual * self.effort))

    def _chain(self) -> tuple[tuple[Phase, ...], float]:
        rng, (slow, fast) = self.rng, self.speeds
        count = int(rng.integers(1, MOST_PHASES + 1))
        speed = slow + (fast - slow) * rng.random() ** 0.7
        phases = []
        for _ in range(count):
            speed = float(np.clip(speed * np.exp(0.25 * rng.standard_normal()), slow, fast))
            shape = str(rng.choice([*SHAPES, "turn", "steps"]))
            amplitude = float(rng.uniform(0.35, 1.05) * rng.choice([-1.0, 1.0]))
            frequency = float(np.exp(rng.uniform(np.log(0.15), np.log(1.2)))) / self.pace
            lean = float(rng.uniform(-0.6, 0.6)) if rng.random() < 0.6 else 0.0
            amplitude *= 1.0 - 0.7 * abs(lean)
            phases.append(Phase(shape, amplitude, frequency, speed, float(rng.uniform(0.5, 1.5)), lean))
        return tuple(phases), self.task.duration * float(rng.choice([1.0, 1.0, rng.uniform(0.4, 1.0)]))

    def _sketched(self, phases: tuple[Phase, ...], duration: float) -> float:
        """By how much a chain would leave the arena, m, if tyres did not slip."""
        drive = chained(phases, self.vehicle, self.limits, duration, SKETCH_RATE)
        v = drive.speed
        yaw_rate = v * drive.steer / (self.vehicle.length + max(self.vehicle.understeer, 0.0) * v**2)
        yaw = np.cumsum(yaw_rate) / SKETCH_RATE
        x, y = np.cumsum(v * np.cos(yaw)) / SKETCH_RATE, np.cumsum(v * np.sin(yaw)) / SKETCH_RATE
        run_up = -(v[0] ** 2) / (2.0 * BACKING * self.limits.drive_max)
        placed = self.arena.place(np.concatenate(([run_up, 0.0], x)), np.concatenate(([0.0, 0.0], y)))
        return placed.outside + self.limits.margin

    def _mended(self, found_plan: FoundPlan) -> tuple[tuple[Phase, ...], float]:
        """The chain gentler where tyres are overused, slower or shorter where the arena is left."""
        worst = float(worst_strain(found_plan.plan.motion, self.limits)[0])
        gentler = 0.95 * SPARE / worst if np.isfinite(worst) and worst > SPARE else (1.0 if worst <= SPARE else 0.6)
        too_far, gentler = found_plan.placement.outside + self.limits.margin > 0, max(gentler, 0.4)
        phases = tuple(self._eased(p, gentler, gentler, 0.8 if too_far else 1.0) for p in found_plan.phases)
        duration = found_plan.duration
        if too_far and self.rng.random() < 0.5:
            duration = max(0.75 * duration, 0.25 * self.task.duration)
        return phases, duration

    def _eased(self, phase: Phase, amplitude: float, lean: float, speed: float) -> Phase:
        """A phase with its numbers multiplied by these, no slower than plans may be."""
        slower = max(speed * phase.speed, self.speeds[0])
        return replace(phase, amplitude=amplitude * phase.amplitude, lean=lean * phase.lean, speed=slower)

    def _made(self, chains: Sequence[tuple[tuple[Phase, ...], float]]) -> list[FoundPlan]:
        """Plans of chains, several simulated at once, with their excess over limits."""
        plans = [chained(phases, self.vehicle, self.limits, duration, self.course.rate) for phases, duration in chains]
        order = sorted(range(len(plans)), key=lambda k: len(plans[k].time))
        result: dict[int, FoundPlan] = {}
        for first in range(0, len(order), AT_ONCE):
            batch = order[first : first + AT_ONCE]
            for k, plan in zip(batch, self.course.references([plans[k] for k in batch]), strict=True):
                phases, duration = chains[k]
                placement, broken = self._placed(plan)
                result[k] = FoundPlan(phases, duration, plan, placement, -np.inf, broken)
        return [result[k] for k in range(len(plans))]

    def _placed(self, plan: PlannedMotion) -> tuple[Placement, float]:
        x, y, v = plan.of("x"), plan.of("y"), plan.of("v_x")
        worst = float(worst_strain(plan.motion, self.limits)[0]) / SPARE - 1.0
        if not np.all(np.isfinite(plan.motion)):
            return NOWHERE, np.inf
        before = v[0] ** 2 / (2.0 * BACKING * self.limits.drive_max)
        after = v[-1] ** 2 / (2.0 * self.limits.brake_max)
        end = plan.of("yaw")[-1]
        xs = np.concatenate(([-before], x[::5], [x[-1], x[-1] + after * np.cos(end)]))
        ys = np.concatenate(([0.0], y[::5], [y[-1], y[-1] + after * np.sin(end)]))
        placement = self.arena.place(xs, ys)
        spare = self.limits.margin + 0.02 * float(v.max())
        out = (placement.outside + spare) / (0.5 * self.arena.breadth)
        steered = np.max(np.abs(plan.steer)) / self.limits.steer_max - 1.0001
        return placement, max(worst, out, float(steered))

    def _scored(self, found_plans: Sequence[FoundPlan], *, rough: bool = False) -> list[FoundPlan]:
        result = list[FoundPlan]()
        for first in range(0, len(found_plans), AT_ONCE):
            some = found_plans[first : first + AT_ONCE]
            worth = self.worth([one.plan for one in some], rough)
            result += [replace(one, worth=value) for one, value in zip(some, worth, strict=True)]
        return result

    def _refined(self, starts: Sequence[FoundPlan]) -> list[FoundPlan]:
        """Chains refined by CMA-ES: each for a heat, the best of them on; only those that keep to limits."""
        each = [_Refinement(self, start) for start in starts]
        heat, most = self._times(HEAT), self._times(GENERATIONS)
        for item in each:
            item.go(heat)
            if item.worth >= self.enough:
                break
        leading, before = max(each, key=lambda item: item.worth), -np.inf
        for _ in range(heat, most, heat):
            if leading.worth < before + SETTLED:
                break
            before = leading.worth
            leading.go(heat)
        return [item.best for item in each if item.best is not None]

    def _hardest(self, found_plan: FoundPlan) -> Array:
        """The hardest draws for a plan that have to keep to limits: if these do, enough of all draws do."""
        y = self.course.driven(found_plan.plan, self.samples[0], follow=self.task.follow)
        order = np.argsort(worst_strain(y, self.limits), kind="stable")
        last = int(np.ceil(NEEDED * len(order)))
        return np.asarray(self.samples[0][order[max(last - HARDEST, 0) : last]])

    def _coded(self, found_plan: FoundPlan) -> Array:
        (slow, fast) = self.speeds
        numbers = [
            (p.amplitude * 2.0, np.log(p.frequency * self.pace), 2.0 * (p.speed - slow) / (fast - slow),
             np.log(p.duration), 2.0 * p.lean)
            for p in found_plan.phases
        ]  # fmt: skip
        return np.array([*np.ravel(numbers), 3.0 * found_plan.duration / self.task.duration])

    def _decoded(self, start: FoundPlan, x: Array) -> tuple[tuple[Phase, ...], float]:
        (slow, fast) = self.speeds
        phases = []
        for phase, (a, f, v, d, lean) in zip(start.phases, x[:-1].reshape(-1, 5), strict=True):
            phases.append(
                Phase(
                    phase.shape, float(np.clip(a / 2.0, -1.2, 1.2)),
                    float(np.exp(np.clip(f, np.log(0.1), np.log(2.0)))) / self.pace,
                    float(np.clip(slow + (fast - slow) * v / 2.0, slow, fast)), float(np.exp(np.clip(d, -2.5, 2.5))),
                    float(np.clip(lean / 2.0, -1.0, 1.0)),
                )
            )  # fmt: skip
        return tuple(phases), self.task.duration * float(np.clip(x[-1] / 3.0, 0.25, 1.0))


class _Refinement:
    """A chain that is being refined; `best` is None until limits are kept."""

    def __init__(self, search: PlanSearch, start: FoundPlan) -> None:
        self.search, self.start = search, start
        self.best = search._scored([start], rough=True)[0] if start.broken <= 0 else None
        self.few = search._hardest(start)
        self.cma = CMA(search._coded(start), 0.25, search.rng)

    @property
    def worth(self) -> float:
        """Value of the best plan that keeps to all limits."""
        return -np.inf if self.best is None else self.best.worth

    def go(self, generations: int) -> None:
        """Refine the chain for some generations, or until its value is enough."""
        for _ in range(generations):
            if self.worth >= self.search.enough:
                return
            made = self.search._made([self.search._decoded(self.start, x) for x in self.cma.ask()])
            self.cma.tell(self._costs(made))

    def _costs(self, made: Sequence[FoundPlan]) -> list[float]:
        inside = iter(self.search._scored([item for item in made if item.broken <= 0], rough=True))
        result = []
        for item in made:
            if item.broken > 0:
                result.append(1e3 + PENALTY * min(item.broken, 100.0))
                continue
            scored, broken = next(inside), 0.0
            if not np.isfinite(self.worth) or scored.worth > self.worth - 0.5:
                broken = 1.0 - self.search._kept_by(scored, self.few)[0]
                if broken <= 0.0 and scored.worth > self.worth:
                    self.best = scored
            result.append(-scored.worth + PENALTY * broken)
        return result
