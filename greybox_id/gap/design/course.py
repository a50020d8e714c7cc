"""Simulation of plans: motion, path and use of the tyres, for one set of parameters or many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.shorthands import Array, Index
from ...engine.motion.lanes import Interval, lay
from ...engine.motion.schedule import MotionRun, Schedule, longest_segment, schedule
from ...engine.motion.simulator import Simulator
from ...models.motion_model import MotionModel
from .driver import OUTPUTS, PATH, PLANNED, PlanDriver, driven
from .limits import DriveLimits, number
from .primitives import PlannedDrive

AT = {name: k for k, name in enumerate(OUTPUTS)}


@dataclass(frozen=True)
class PlannedMotion:
    """A plan with its motion under the nominal parameters.

    Attributes
    ----------
    time : (n,) s.
    steer, drive : (n,) commands, rad and the drive signal's unit.
    motion : (n, outputs) see `driver.OUTPUTS`.
    phase : (n,) index of the phase.
    """

    time: Array
    steer: Array
    drive: Array
    motion: Array
    phase: Index

    def of(self, name: str) -> Array:
        """(n,) one of `driver.OUTPUTS`."""
        return self.motion[:, AT[name]]


class PlanCourse:
    """Simulates plans with a driver.

    Parameters
    ----------
    model, driver : at its nominal values, and its driver.
    rate : rows a second.
    slowest : m/s, lowest speed of plans, which determines the integration step.
    """

    def __init__(self, model: MotionModel, driver: PlanDriver, rate: float, slowest: float) -> None:
        self.driver, self.rate = driver, rate
        self.model = driven(model, driver)
        self.simulator = Simulator(self.model)
        self.simulator.kernel.prepare()
        still = self._run(np.arange(4) / rate, np.zeros((4, len(self.model.inputs))), slowest)
        self.longest = longest_segment(self.simulator.trace, [still], self.model.values)

    def references(self, plans: Sequence[PlannedDrive]) -> list[PlannedMotion]:
        """Motions of plans with the nominal parameters, several at once; the driver keeps only the speed."""
        u = [
            np.column_stack([plan.steer, self._forward(plan), plan.speed, *[np.zeros(len(plan.time))] * 3])
            for plan in plans
        ]
        result = self._simulated([plan.time for plan in plans], u, self.model.values[None])
        per_unit = 1.0 / self.driver.force
        return [
            PlannedMotion(plan.time, plan.steer, y[:, AT["drive_force"]] * per_unit, y, plan.phase)
            for plan, y in zip(plans, result, strict=True)
        ]

    def driven(self, plan: PlannedMotion, P: Array, *, follow: bool) -> Array:
        """(K, n, outputs) motion with each of (K, parameters) of the undriven model, with or without a driver."""
        P = np.atleast_2d(P)
        u = np.column_stack([plan.steer, plan.drive, *(plan.of(name) for name in ("v_x", "x", "y", "yaw"))])
        of_driver = self.model.with_parameters(self.model[PATH].with_value(float(follow))).values[P.shape[1] :]
        full = np.column_stack([P, np.tile(of_driver, (len(P), 1))])
        return np.stack(self._simulated([plan.time] * len(P), [u] * len(P), full))

    def _forward(self, drive: PlannedDrive) -> Array:
        """Drive signal that keeps the planned speed on a straight."""
        c_0, c_1, c_2 = (number(self.model, name, 0.0) for name in ("c_0", "c_1", "c_2"))
        v = drive.speed
        force = self.driver.mass * np.gradient(v, drive.time) + c_0 + c_1 * v + c_2 * v**2
        return np.asarray(force / self.driver.force)

    def _run(self, time: Array, inputs: Array, v_x: float) -> MotionRun:
        measured = np.full((len(time), len(OUTPUTS)), np.nan)
        measured[:, AT["v_x"]] = v_x
        measured[:, [AT["v_y"], AT["yaw_rate"]]] = 0.0
        held = np.array([name in ("steer", "drive") for name in self.model.inputs])
        return MotionRun("plan", time, inputs, held, measured, range(len(time)))

    def _simulated(self, times: Sequence[Array], inputs: Sequence[Array], P: Array) -> list[Array]:
        """(n, outputs) of each run; its parameters are a row of P, or the only one."""
        P = np.broadcast_to(P, (len(inputs), P.shape[1]))
        order = [self.model.inputs.index(name) for name in ("steer", "drive", *PLANNED)]
        usual = [self.model.defaults.get(name, 0.0) for name in self.model.inputs]
        runs, z0, plans = list[MotionRun](), list[Array](), list[Schedule]()
        for time, u, p in zip(times, inputs, P, strict=True):
            table = np.tile(usual, (len(time), 1))
            table[:, order] = u
            run, v_x = self._run(time, table, float(u[0, 2])), u[:1, 2:3]
            runs.append(run)
            z0.append(self.simulator.start_states(("v_x",), v_x, run.inputs[:1], p[None]))
            plans.append(schedule(self.simulator.trace, run, self.simulator.shifts(p), self.longest))
        lanes = lay(plans, [Interval(k, 0, len(run)) for k, run in enumerate(runs)])
        with np.errstate(all="ignore"):
            _, y = self.simulator.kernel.simulate(np.vstack(z0), lanes.segments, np.ascontiguousarray(P), lanes.reads)
        return np.split(lanes.gathered(y), np.cumsum([len(run) for run in runs[:-1]]))


def strain(motion: Array, limits: DriveLimits) -> dict[str, Array]:
    """Use of limits by (K, n, outputs) motions, (K,) for each limit; above one it is broken.

    Largest use of an axle's friction over the share that may be used, sideslip and speed over their limits; infinite
    where a motion is not finite.
    """
    y = motion if motion.ndim == 3 else motion[None]
    with np.errstate(all="ignore"):
        along, across = (
            np.array([y[..., AT[f"{force}{axle}"]] / np.maximum(y[..., AT[f"peak_{axle}"]], 1e-9) for axle in "fr"])
            for force in ("F_x", "F_y")
        )
        # no tyre gives more than its peak: beyond is an error of the curve (`models.form`), with all friction used
        use = np.max(np.hypot(along, np.clip(across, -1.0, 1.0)), axis=0)
        slip = np.abs(np.arctan2(y[..., AT["v_y"]], np.maximum(y[..., AT["v_x"]], 1e-3)))
        backwards = y[..., AT["v_x"]] < 0.3 * limits.speed_min
        result = {
            "grip": np.max(use, axis=1) / limits.grip,
            "sideslip": np.max(np.where(backwards, np.inf, slip), axis=1) / limits.sideslip_max,
            "speed": np.max(y[..., AT["v_x"]], axis=1) / (1.03 * limits.speed_max),
        }
    finite = np.all(np.isfinite(y), axis=(1, 2))
    return {name: np.where(finite & np.isfinite(item), item, np.inf) for name, item in result.items()}


def worst_strain(motion: Array, limits: DriveLimits) -> Array:
    """(K,) the largest `strain`."""
    return np.asarray(np.max(list(strain(motion, limits).values()), axis=0))
