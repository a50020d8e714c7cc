"""Runs of the synthetic racer: who drives where and how fast, and the simulation of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from .car import STEP, Car, CarMotion, advance
from .driver import PERIOD, Driver, Pid, PurePursuit, Stanley, Steering
from .sensors import SAMPLE_TIME, Sensors, measure
from .track import Array, Circuit, raceline, speed_profile

Command = Callable[[float, CarMotion, float], tuple[float, float]]
"""(time, state, measured speed) -> commanded steering angle, rad, and motor current, A."""

_TRACES = (
    *("x", "y", "yaw", "v_x", "v_y", "yaw_rate", "a_x", "a_y", "yaw_acceleration", "roll", "pitch", "steer"),
    *("drive_speed", "drive_force"),
)


@dataclass(frozen=True)
class DrivenRun:
    """One unbroken piece of a recording.

    Attributes
    ----------
    steering : lateral controller, made anew for the run.
    duration : recorded, s.
    v_max, a_y_max, a_x_max : limits of the raceline, m/s and m/s^2.
    lead : time driven before the recording starts, s; 0 is a recording that starts at rest.
    pauses : intervals in which the car shall stand, s from the start of the recording.
    clockwise : drive the track the other way round: mostly right turns.
    slalom : displacement to either side of the line, m.
    steer_delay : dead time of the steering command in this run, s.
    """

    steering: Callable[[], Steering]
    duration: float
    v_max: float
    a_y_max: float
    a_x_max: float
    lead: float = 0.0
    pauses: tuple[tuple[float, float], ...] = ()
    clockwise: bool = False
    slalom: float = 0.0
    steer_delay: float = 0.01

    @property
    def rows(self) -> int:
        """Number of samples."""
        return round(self.duration / SAMPLE_TIME)


RUNS: Mapping[str, tuple[DrivenRun, ...]] = MappingProxyType(
    {
        "racer_train": (
            DrivenRun(Pid, 35.0, 3.6, 4.7, 3.2, pauses=((0.0, 1.6),), steer_delay=0.005),
            DrivenRun(Stanley, 44.0, 2.4, 1.9, 1.6, lead=3.0, pauses=((18.0, 21.5), (41.0, 60.0)), steer_delay=0.02),
            DrivenRun(
                PurePursuit, 22.0, 1.45, 4.0, 3.0, pauses=((0.0, 2.0),), clockwise=True, slalom=0.07, steer_delay=0.01
            ),
            DrivenRun(
                PurePursuit, 21.0, 1.55, 4.0, 3.0, lead=4.0, pauses=((18.5, 60.0),), slalom=0.07, steer_delay=0.02
            ),
        ),
        "racer_valid": (
            DrivenRun(Stanley, 23.0, 2.4, 1.9, 1.6, pauses=((0.0, 1.2), (3.2, 6.0)), steer_delay=0.0),
            DrivenRun(Pid, 16.0, 3.6, 4.7, 3.2, lead=5.0, pauses=((13.5, 60.0),), steer_delay=0.005),
            DrivenRun(PurePursuit, 11.5, 1.45, 4.0, 3.0, pauses=((0.0, 1.5),), slalom=0.07, steer_delay=0.01),
            DrivenRun(
                PurePursuit,
                9.5,
                1.5,
                4.0,
                3.0,
                lead=3.5,
                pauses=((8.0, 60.0),),
                clockwise=True,
                slalom=0.07,
                steer_delay=0.025,
            ),
        ),
    }
)
"""The runs of each recording, in order; time restarts with each."""


def simulate(car: Car, command: Command, duration: float, start: CarMotion | None = None) -> dict[str, Array]:
    """Drive the car from a state.

    Parameters
    ----------
    car : constants.
    command : asked every `driver.PERIOD`; its answer is held until the next time.
    duration : s.
    start : state at time 0; at rest in the origin by default. It is advanced in place.

    Returns
    -------
    Signals at every `STEP`, each (n,), SI units: the state's own names, `time`, `wheel_speed` (of the driveline at the
    wheels' radius, m/s), `steer_command` (rad) and `current` (A).
    """
    state = start if start is not None else CarMotion()
    n, hold = round(duration / STEP), round(PERIOD / STEP)
    traces = np.empty((n, len(_TRACES)))
    commands = np.empty((n, 2))
    steer = current = 0.0
    for k in range(n):
        if k % hold == 0:
            steer, current = command(k * STEP, state, car.R * state.drive_speed)
            steer = max(-car.steer_max, min(car.steer_max, steer))
        traces[k] = [getattr(state, name) for name in _TRACES]
        commands[k] = steer, current
        advance(car, state, steer, current)
    signals: dict[str, Array] = {name: traces[:, i].copy() for i, name in enumerate(_TRACES)}
    signals["time"] = np.arange(n, dtype=np.float64) * STEP
    signals["wheel_speed"] = car.R * signals["drive_speed"]
    signals["steer_command"], signals["current"] = commands[:, 0].copy(), commands[:, 1].copy()
    return signals


def drive(run: DrivenRun, rng: np.random.Generator) -> dict[str, Array]:
    """Simulate one run and measure it.

    Parameters
    ----------
    run : what to drive.
    rng : source of everything that differs from run to run.

    Returns
    -------
    Columns of `sensors.COLUMNS` in the file's units, each (run.rows,).
    """
    car = replace(Car(), steer_delay=run.steer_delay)
    track = raceline(rng, run.clockwise)
    speeds = speed_profile(track, run.v_max, run.a_y_max, run.a_x_max)
    driver = Driver(
        track=track,
        speeds=speeds,
        steering=run.steering(),
        pauses=tuple((a + run.lead if a > 0.0 else a, b + run.lead) for a, b in run.pauses),
        wheelbase=car.wheelbase,
        l_r=car.l_r,
        offsets=slalom(track, run.slalom, rng),
        rng=rng,
    )
    start = CarMotion(x=float(track.x[0]), y=float(track.y[0]), yaw=float(track.yaw[0]))
    # The last sample needs a row of truth beyond it.
    truth = simulate(car, driver, run.lead + run.duration + SAMPLE_TIME, start)
    first = round(run.lead / STEP)
    recorded = {name: values[first:] for name, values in truth.items()} | {"time": truth["time"][first:] - run.lead}
    faults = Sensors(
        gyro_bias=0.027 + rng.normal(0.0, 0.0004),
        offset_x=-0.24 + rng.normal(0.0, 0.05),
        offset_y=-0.15 + rng.normal(0.0, 0.03),
        imu_delay=rng.uniform(0.0, 0.015),
    )
    return {name: values[: run.rows] for name, values in measure(recorded, faults, rng).items()}


def slalom(track: Circuit, width: float, rng: np.random.Generator) -> Array:
    """Lateral displacement of the line, m: a square wave of irregular length; zero for no width."""
    offsets = np.zeros(len(track.s))
    if width > 0.0:
        edges = np.cumsum(rng.uniform(0.5, 1.9, 64))
        offsets = np.where(np.searchsorted(edges, track.s) % 2 == 0, width, -width)
    return offsets
