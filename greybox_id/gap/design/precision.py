"""Designing for precise parameters: the determinant of their covariance, averaged over what is not known yet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...base.errors import BadInput
from ...base.shorthands import Array, Say
from ...fitting.fit import Fit
from ...models.model import Model, must_be
from ...models.motion_model import MotionModel
from .arena import Arena, Placement
from .course import AT, PlanCourse, PlannedMotion, strain
from .driver import driver_of, vehicle_of
from .information import Information, criterion, draws, known_by, predicted_sd, wanted_names
from .limits import DriveLimits, G
from .plan import Design, Separation
from .primitives import Handling
from .search import NEEDED, FoundPlan, PlanSearch

DRAWS, AVERAGED = 40, 3
"""Draws of the posterior that must keep to limits; those over which the criterion's median is taken."""
SHORTEST, LONGEST = 2.0, 300.0
"""Durations of plans, s."""
MOST_ROWS = 12_000
ONE_AXLE, BOTH_AXLES = 0.4, 0.7
"""Share of the friction that driving, by one axle, and braking, by both, use at most in plans."""
CRITERIA = ("d", "a", "e", "c")
LITTLE = 0.05
"""Share of a standard deviation that is little to gain: twenty such drives would not halve it."""


@dataclass(frozen=True)
class DesignTask:
    """What is asked of a design beside its goal.

    Attributes
    ----------
    arena, limits : where, and within what.
    duration, rate : s at most, rows a second.
    repeat : how often it is going to be driven.
    seed : of everything random.
    follow : whether a driver keeps the path; else commands are given as they stand.
    effort : of the search, over what is usual.
    """

    arena: Arena
    limits: DriveLimits
    duration: float
    rate: float
    repeat: int
    seed: int
    follow: bool
    effort: float = 1.0


def must_move(model: Model, do: str = "Fit") -> MotionModel:
    """The model, where manoeuvres are designed with it. Raises `BadInput` where it is none of motion."""
    none = f"A manoeuvre is designed with equations of motion; {model.name} has none. {do} single_track."
    return must_be(MotionModel, model, none)


def precise(fit: Fit, names: Sequence[str], kind: str, design_task: DesignTask, say: Say) -> Design:
    """The manoeuvre that makes parameters of a fit precise.

    Parameters
    ----------
    fit : of equations of motion.
    names : of the parameters that count; all free ones unless any is named.
    kind : one of `CRITERIA`, see `information.criterion`.
    design_task : arena, limits and the like.

    Raises
    ------
    BadInput : the model cannot say what a manoeuvre leads to, a name is none of its free parameters, or no manoeuvre
        fits into the arena and the limits.
    """
    model = must_move(fit.model)
    vehicle, known = vehicle_of(model), known_by(fit)
    target = wanted_names(fit, known, names)
    samples = draws(fit, known, DRAWS, design_task.seed)
    slower, vehicle = cautious(design_task.limits, vehicle, model, samples)
    design_task = replace(design_task, limits=slower)
    course = PlanCourse(model, driver_of(model, design_task.limits), design_task.rate, design_task.limits.speed_min)
    information = Information(fit, known, target)

    def worth(plans: Sequence[PlannedMotion], rough: bool) -> list[float]:
        entry = [
            [
                criterion(known.precision + design_task.repeat * item.information, known, target, kind)
                for item in information.told(plans, p, rough=rough)
            ]
            for p in samples[: 1 if rough else AVERAGED]
        ]
        return [float(value) for value in np.median(entry, axis=0)]

    must_fit(design_task)
    search = PlanSearch(
        course,
        vehicle,
        design_task.limits,
        design_task.arena,
        design_task.duration,
        samples,
        worth,
        design_task.seed,
        follow=design_task.follow,
        effort=design_task.effort,
    )
    result, nearest = search.best(say)
    if result is None:
        raise no_room(nearest, design_task, search)
    after = known.precision + design_task.repeat * information.of(result.plan, samples[:1])[0]
    value = {"before": criterion(known.precision, known, target, kind), "after": criterion(after, known, target, kind)}
    every = predicted_sd(known, after)
    entry = {name: every[name] for name in target}
    return finished(
        "precision", course, result, search, design_task, samples,
        criterion={"name": kind, "parameters": list(target), **value}, drive=drive_signal(fit, model),
        predicted=entry, impossible=_hardly(model, entry), said=_exact(model),
    )  # fmt: skip


def cautious(
    limits: DriveLimits, vehicle: Handling, model: MotionModel, samples: Array
) -> tuple[DriveLimits, Handling]:
    """Limits and grip that plans are made with: where friction is hardly known, they start gentler.

    Parameters
    ----------
    samples : (K, parameters) draws of what is uncertain.
    """
    names = [name for parameter in model.parameters for name in (parameter.name,) * parameter.size]
    friction = [samples[:, names.index(name)] for name in ("D_f", "D_r", "mu_f", "mu_r") if name in names]
    if not friction:
        return limits, vehicle
    low = G * float(np.quantile(np.min(friction, axis=0), 1.0 - NEEDED))
    most = limits.grip * low
    slower = replace(
        limits, drive_max=min(limits.drive_max, ONE_AXLE * most), brake_max=min(limits.brake_max, BOTH_AXLES * most)
    )
    return slower, replace(vehicle, grip=min(vehicle.grip, low))


def _exact(model: MotionModel) -> tuple[str, ...]:
    """That a fit takes its equations for exact, which no tyre's curve is."""
    if model.settings.get("tyre", "linear") == "linear" or "form" in model.settings:
        return ()
    return ("The fit treats its tyre curves as exact; with the setting form=uncertain, sd includes their error.",)


def _hardly(model: MotionModel, known: Mapping[str, tuple[float, float]]) -> tuple[str, ...]:
    """What the manoeuvre adds little to, and how little."""
    parts = []
    for name, (before, after) in known.items():
        if not np.isfinite(after):
            parts.append(f"no information on {name}, which stays unknown")
        elif np.isfinite(before) and after > (1.0 - LITTLE) * before:
            parts.append(
                f"little information on {name}: its standard deviation falls by {100 * (1 - after / before):.1f} %"
            )
    if not parts:
        return ()
    return (f"Of {model.name}, the best manoeuvre that was found here adds {'; '.join(parts)}.",)


def drive_signal(fit: Fit, model: MotionModel) -> str:
    """The signal of the drive command."""
    return str(fit.how.get("inputs", {}).get("drive", model.aliases.get("drive", ("drive",))[0]))


def must_fit(design_task: DesignTask) -> None:
    """Raise `BadInput` where not even a straight drive at the lowest speed fits in."""
    limits, arena = design_task.limits, design_task.arena
    if arena.breadth <= 2.0 * limits.margin:
        raise BadInput(
            f"‹arena› {arena.words} is too small: the vehicle with its margin is {2.0 * limits.margin:.2g} m wide, the "
            f"arena {arena.breadth:.2g} m. Name one of at least {3.0 * limits.margin:.2g} m, or state a smaller margin "
            "(‹limits›)."
        )
    v = 1.15 * limits.speed_min
    straight = v**2 / limits.drive_max + v * SHORTEST + v**2 / (2.0 * limits.brake_max) + 2.0 * limits.margin
    turning = 2.0 * (v**2 / (0.5 * limits.grip * 9.81) + limits.margin)
    if arena.length < straight and arena.breadth < turning:
        raise BadInput(
            f"‹arena› {arena.words} is too small: at {v:.2g} m/s, the lowest speed, the vehicle needs {straight:.0f} m "
            f"straight on or a circle of {turning:.0f} m. Name a larger one, or lower speed_min (‹limits›)."
        )


def no_room(nearest: FoundPlan, task: DesignTask, search: PlanSearch) -> BadInput:
    """The sentence on why no manoeuvre keeps to the limits."""
    out = nearest.placement.outside + task.limits.margin
    if out > 0 and np.isfinite(out):
        wide = task.arena.breadth + 2.0 * out
        return BadInput(
            f"‹arena› {task.arena.words} is too small: the best manoeuvre leaves it by {out:.1f} m. Use an arena "
            f"{wide:.0f} m wide, or a lower ‹speed_max›."
        )
    tight = strain(nearest.plan.motion, task.limits)
    worst = max(("grip", "sideslip", "speed"), key=lambda name: float(getattr(tight, name)[0]))
    kept = search.kept(nearest, search.samples)
    return BadInput(
        f"The parameters are too uncertain for a plan: a manoeuvre must keep to the limits for {100 * NEEDED:.0f} % "
        f"of the plausible parameter values, and the best that was found does so for {100 * kept:.0f} %; for the "
        f"other values, {worst} exceeds its limit. Raise that limit (‹limits›), or drive something gentle first and "
        "fit again."
    )


def finished(
    goal: str, course: PlanCourse, plan: FoundPlan, search: PlanSearch, task: DesignTask, samples: Array, *,
    criterion: dict[str, object], drive: str, predicted: dict[str, tuple[float, float]] | None = None,
    impossible: tuple[str, ...] = (), separation: tuple[Separation, ...] = (), said: tuple[str, ...] = (),
) -> Design:  # fmt: skip
    """A found plan with its corridor and the limits it uses up."""
    motion = course.driven(plan.plan, samples, follow=task.follow)
    good = np.all(np.isfinite(motion), axis=(1, 2))
    corridor = np.quantile(motion[good], [0.025, 0.975], axis=0)
    return Design(
        goal, course.model.name, drive, criterion, plan.phases, plan.plan, corridor, plan.placement, task.arena,
        task.limits, course.driver, predicted or {}, active_limits=used_up(plan, motion[good], task),
        impossible=impossible, kept=search.kept(plan, samples), repeat=task.repeat, separation=separation, said=said,
    )  # fmt: skip


def used_up(found_plan: FoundPlan, motion: Array, design_task: DesignTask) -> tuple[str, ...]:
    """Limits of which a plan leaves less than a twentieth, to the worst of the draws."""
    limits, plan, tight = design_task.limits, found_plan.plan, strain(motion, design_task.limits)
    rate = np.max(np.abs(np.diff(plan.steer))) / (plan.time[1] - plan.time[0])
    change = np.diff(plan.motion[:, AT["v_x"]]) / (plan.time[1] - plan.time[0])
    shares = {
        "grip": np.quantile(tight.grip, 0.95),
        "sideslip": np.quantile(tight.sideslip, 0.95),
        "speed_max": np.max(plan.motion[:, AT["v_x"]]) / limits.speed_max,
        "steer_max": np.max(np.abs(plan.steer)) / limits.steer_max,
        "steer_rate": rate / limits.steer_rate,
        "drive_max": np.max(change) / (0.9 * limits.drive_max),
        "brake_max": -np.min(change) / (0.9 * limits.brake_max),
        "arena": 1.0 + (found_plan.placement.outside + limits.margin) / (0.5 * design_task.arena.breadth),
        "duration": found_plan.duration / design_task.duration,
    }
    return tuple(name for name, share in shares.items() if share >= 0.95)


def nowhere() -> Placement:
    """The placement of no plan."""
    return Placement(0.0, 0.0, 0.0, 0.0)
