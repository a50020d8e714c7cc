"""Once around the track: the virtual vehicle, commanded by a controller, and what came of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from greybox_lab.driving.racing.track import RaceTrack
from greybox_lab.virtual.virtual_vehicle import SteppedCar, VirtualCar

Row = NDArray[np.float64]

LOST = 4.0
"""Half widths from the middle line at which a lap is given up."""
MEASURED = ("v_x", "v_y", "yaw_rate")


class Driver(Protocol):
    """Whatever commands a vehicle: the controller in Python, or the one in C.

    Attributes
    ----------
    seconds : processor time of every decision, s.
    failures : decisions for which there was no solution.
    """

    seconds: list[float]
    failures: int

    def decide(self, measured: Mapping[str, float], s: float, e_y: float, e_psi: float) -> Row:
        """Commands of the next period from measured states and the place on the path, m, m and rad."""


@dataclass(frozen=True)
class Lap:
    """What came of a lap.

    Attributes
    ----------
    time : s; of what was driven, where it was not finished.
    finished : whether it was.
    s, x, y, e_y, speed_error : (n,) at every command: distance along the track, place, lateral error [m], and speed
        over the one wanted [m/s].
    commands : (n, 2) steering [rad] and drive [in its unit].
    use : (n,) force of the axle that uses more of its grip, over that grip.
    beyond_track, beyond_grip, beyond_steering : shares of the time that the centre of gravity is beyond the track's
        edge, an axle beyond its grip, the road wheels beyond their largest angle.
    solve : median, 95 % quantile and maximum of the processor time of a decision, s.
    failures : decisions for which there was no solution.
    """

    time: float
    finished: bool
    s: Row
    x: Row
    y: Row
    e_y: Row
    speed_error: Row
    commands: Row
    use: Row
    beyond_track: float
    beyond_grip: float
    beyond_steering: float
    solve: tuple[float, float, float]
    failures: int

    @property
    def rms(self) -> float:
        """Root mean square of the lateral error, m."""
        return float(np.sqrt(np.mean(self.e_y**2)))

    @property
    def p95(self) -> float:
        """95 % quantile of the lateral error's size, m."""
        return float(np.quantile(np.abs(self.e_y), 0.95))


def lap(
    car: VirtualCar, effects: Mapping[str, float], forms: str, seed: int, track: RaceTrack, driver: Driver,
    period: float, until: float = np.inf,
) -> Lap:  # fmt: skip
    """Drive a lap, or until a distance along it; states and place are measured without noise.

    Parameters
    ----------
    car, effects, forms, seed : what really drives, as `SteppedCar` takes it.
    track, driver : where, and who commands it.
    period : s, between commands.
    until : m.
    """
    end, pace = min(until, track.length), float(np.min(track.speed))
    ride = SteppedCar(car, float(track.speed[0]), 1.5 * end / pace, 1.0 / period, effects, forms, seed)
    rows, s, e_y = [], 0.0, 0.0
    while s < end and abs(e_y) < LOST * track.half_width:
        now = ride.motion
        s, e_y, e_psi = track.project(now["x"], now["y"], now["yaw"], s)
        commands = driver.decide({name: now[name] for name in MEASURED}, s, e_y, e_psi)
        ride.step(*commands)
        wanted = track.line("speed", np.array([s]))[0][0]
        rows.append((s, now["x"], now["y"], e_y, now["v_x"] - wanted, *commands))
    columns, truth = np.array(rows).T, ride.truth()
    use = np.maximum(*(_use(truth, axle, car.parameters[f"D_{axle}"]) for axle in "fr"))
    median, p95 = np.quantile(driver.seconds, (0.5, 0.95))
    return Lap(
        ride.time,
        bool(s >= end),
        *columns[:5],
        columns[5:].T,
        use,
        beyond_track=float(np.mean(np.abs(columns[3]) > track.half_width)),
        beyond_grip=float(np.mean(use > 1.0)),
        beyond_steering=float(np.mean(np.abs(truth["steer"]) > car.steer_max + 1e-9)),
        solve=(float(median), float(p95), max(driver.seconds)),
        failures=driver.failures,
    )


def _use(truth: Mapping[str, Row], axle: str, friction: float) -> Row:
    """Force of an axle over its friction, both as they really are."""
    along, across, load = (truth[f"{what}_{axle}l"] + truth[f"{what}_{axle}r"] for what in ("F_x", "F_y", "F_z"))
    return np.hypot(along, across) / (friction * truth["friction"] * load)
