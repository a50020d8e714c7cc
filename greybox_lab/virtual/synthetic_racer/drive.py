"""Runs of the synthetic racer: simulation with a driver, measurement at 20 Hz, and files."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from scipy import constants
from scipy.signal import butter, lfilter

from greybox_id.base.files import write_atomically
from greybox_id.base.shorthands import Array

from .car import GRAVITY, STEP, Car, CarMotion, advance
from .driver import PERIOD, Circuit, Driver, Pid, PurePursuit, Stanley, Steering, raceline, smooth_speeds

SAMPLE_TIME = 0.05
"""Sample time of the files, s."""

RPM_PER_SPEED = 4244.0
"""Electrical revolutions per minute for 1 m/s."""

COLUMNS = ("t", "Speed", "accx", "accy", "yaw_rate", "steering_angle", "current", "pose_x", "pose_y", "yaw")
"""Columns of the files: s, electrical rpm, g, g, deg/s, rad, A, m, m, rad."""


@dataclass(frozen=True)
class Sensors:
    """Faults of the sensors in one run.

    Attributes
    ----------
    x_imu : distance of the IMU ahead of the centre of gravity, m.
    gyro_bias, offset_x, offset_y : rad/s; m/s^2.
    gyro_noise, accelerometer_noise : standard deviation at rest, rad/s and m/s^2.
    gyro_vibration, vibration_x, vibration_y : standard deviation that driving adds, rad/s and m/s^2.
    imu_cutoff, imu_delay : low-pass, Hz, and dead time, s.
    speed_cutoff, current_cutoff : low-pass, Hz.
    speed_noise : m/s, while the motor turns.
    current_noise, current_ripple : A, and per ampere, while current flows.
    pose_noise, yaw_noise, pose_delay : m, rad and s.
    """

    x_imu: float = -0.07
    gyro_bias: float = 0.027
    offset_x: float = -0.24
    offset_y: float = -0.15
    gyro_noise: float = 0.0015
    accelerometer_noise: float = 0.012
    gyro_vibration: float = 0.012
    vibration_x: float = 0.22
    vibration_y: float = 0.26
    imu_cutoff: float = 5.5
    imu_delay: float = 0.01
    speed_cutoff: float = 6.0
    current_cutoff: float = 25.0
    current_noise: float = 0.01
    current_ripple: float = 0.06
    speed_noise: float = 0.006
    pose_noise: float = 0.002
    yaw_noise: float = 0.003
    pose_delay: float = 0.03


def measure(truth: Mapping[str, Array], sensors: Sensors | None, rng: np.random.Generator) -> dict[str, Array]:
    """Sample a simulated drive as the car's electronics would.

    Parameters
    ----------
    truth : signals at every `STEP` from `simulate`, SI units.
    sensors : faults; None samples the truth itself, at the centre of gravity.
    rng : random generator of the noise.

    Returns
    -------
    The columns of `COLUMNS` in the file's units, each (n,), time from 0 in steps of `SAMPLE_TIME`.
    """
    time = truth["time"]
    n = int(np.floor(time[-1] / SAMPLE_TIME + 1e-6)) + 1
    t = np.arange(n) * SAMPLE_TIME

    def sampled(name: str, delay: float = 0.0) -> Array:
        return np.asarray(np.interp(t - delay, time, truth[name]), dtype=float)

    if sensors is None:
        v, a_x, a_y, r = (sampled(k) for k in ("wheel_speed", "a_x", "a_y", "yaw_rate"))
        current, x, y, yaw = (sampled(k) for k in ("current", "x", "y", "yaw"))
    else:
        moving = np.tanh(np.abs(truth["v_x"]) / 0.4)
        roll, pitch, yaw_rate = truth["roll"], truth["pitch"], truth["yaw_rate"]
        # An accelerometer rolls and pitches with the body and measures gravity's components along its axes.
        f_x = (truth["a_x"] - sensors.x_imu * yaw_rate**2) * np.cos(pitch) - GRAVITY * np.sin(pitch)
        f_y = (truth["a_y"] + sensors.x_imu * truth["yaw_acceleration"]) * np.cos(roll) + GRAVITY * np.sin(roll)

        def imu(value: Array, offset: float, noise: float, vibration: float) -> Array:
            shaken = value + vibration * moving * _coloured(rng, len(value), 3.0)
            late = _low_pass(shaken, sensors.imu_cutoff, 2)
            read = np.interp(t - sensors.imu_delay, time, late, left=late[0])
            return np.asarray(read + offset + rng.normal(0.0, noise, n), dtype=float)

        a_x = imu(f_x, sensors.offset_x, sensors.accelerometer_noise, sensors.vibration_x)
        a_y = imu(f_y, sensors.offset_y, sensors.accelerometer_noise, sensors.vibration_y)
        r = imu(yaw_rate, sensors.gyro_bias, sensors.gyro_noise, sensors.gyro_vibration)
        v = np.interp(t, time, _low_pass(truth["wheel_speed"], sensors.speed_cutoff, 1))
        v = v + np.where(np.abs(v) > 0.02, rng.normal(0.0, sensors.speed_noise, n), 0.0)
        # Below this the speed estimator of a sensorless motor reports zero.
        v = np.where(np.abs(v) < 0.01, 0.0, v)
        current = np.interp(t, time, _low_pass(truth["current"], sensors.current_cutoff, 1))
        flows, ripple = np.abs(current) > 0.02, sensors.current_noise + sensors.current_ripple * np.abs(current)
        current = np.where(flows, current + rng.normal(0.0, 1.0, n) * ripple, 0.0)
        x = sampled("x", sensors.pose_delay) + rng.normal(0.0, sensors.pose_noise, n)
        y = sampled("y", sensors.pose_delay) + rng.normal(0.0, sensors.pose_noise, n)
        yaw = sampled("yaw", sensors.pose_delay) + rng.normal(0.0, sensors.yaw_noise, n)
    values = (
        t,
        v * RPM_PER_SPEED,
        a_x / constants.g,
        a_y / constants.g,
        np.rad2deg(r),
        sampled("steer_command"),
        current,
        x,
        y,
        np.arctan2(np.sin(yaw), np.cos(yaw)),
    )
    return dict(zip(COLUMNS, values, strict=True))


def _low_pass(values: Array, cutoff: float, order: int) -> Array:
    """Causal Butterworth filter at the simulation's rate, started at rest on the first value; cutoff in Hz."""
    b, a = butter(order, 2.0 * cutoff * STEP)
    return np.asarray(lfilter(b, a, values - values[0]) + values[0], dtype=float)


def _coloured(rng: np.random.Generator, n: int, cutoff: float) -> Array:
    """Noise of unit standard deviation below a cutoff, Hz: vibrations by road and driveline."""
    b, a = butter(2, 2.0 * cutoff * STEP)
    # Noise bandwidth of a second-order Butterworth filter, in units of its cutoff.
    gain = np.sqrt(np.pi / (2.0 * np.sqrt(2.0)) * 2.0 * cutoff * STEP)
    return np.asarray(lfilter(b, a, rng.normal(0.0, 1.0, n)) / gain, dtype=float)


Command = Callable[[float, CarMotion, float], tuple[float, float]]
"""(time, state, measured speed) -> commanded steering angle, rad, and motor current, A."""

_TRACES = (
    *("x", "y", "yaw", "v_x", "v_y", "yaw_rate", "a_x", "a_y", "yaw_acceleration", "roll", "pitch", "steer"),
    *("drive_speed", "drive_force"),
)


@dataclass(frozen=True)
class DrivenRun:
    """One run of a recording.

    Attributes
    ----------
    steering : makes a lateral controller for the run.
    duration : recorded, s.
    v_max, a_y_max, a_x_max : limits of the raceline, m/s and m/s^2.
    lead : time driven before the recording starts, s; 0 is a recording that starts at rest.
    pauses : intervals in which the car should stand, s from the start of the recording.
    clockwise : whether the direction is reversed, with mostly right turns.
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


_CAR = Car()


def simulate(car: Car, command: Command, duration: float, start: CarMotion | None = None) -> dict[str, Array]:
    """Drive the car from a state.

    Parameters
    ----------
    car : constants.
    command : called every `driver.PERIOD`; its result is held until the next call.
    duration : s.
    start : state at time 0; at rest in the origin by default. It is modified in place.

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


def drive(run: DrivenRun, rng: np.random.Generator, car: Car = _CAR) -> dict[str, Array]:
    """Simulate one run and measure it.

    Parameters
    ----------
    run : what to drive.
    rng : random generator of everything that differs between runs.
    car : the car, except for the run's own dead time of the steering.

    Returns
    -------
    Columns of `COLUMNS` in the file's units, each (run.rows,).
    """
    car = replace(car, steer_delay=run.steer_delay)
    track = raceline(rng, run.clockwise)
    speeds = smooth_speeds(track, run.v_max, run.a_y_max, run.a_x_max)
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
    # The last sample needs a row of truth after it.
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


SEED = 20240
"""Seed of the recordings in the package."""

FORMATS = ("%.2f", "%.1f", "%.5f", "%.5f", "%.3f", "%.5f", "%.4f", "%.4f", "%.4f", "%.5f")
"""Format of each column: a few more digits than its noise."""


def run_table(name: str, number: int, seed: int = SEED) -> dict[str, np.ndarray]:
    """Columns of one run of a recording, unrounded, in the file's units.

    Parameters
    ----------
    name : of the recording, a key of `RUNS`.
    number : of the run, from 0. Each run has its own random numbers, so that it can be made alone.
    seed : of the recordings.
    """
    rng = np.random.default_rng([seed, list(RUNS).index(name), number])
    return drive(RUNS[name][number], rng)


def make(folder: str | os.PathLike[str], seed: int = SEED) -> tuple[Path, ...]:
    """Write `racer_train.csv` (about 2 min) and `racer_valid.csv` (about 1 min), 20 Hz.

    The same seed writes the same bytes on the same machine. A file is complete or does not exist.

    Parameters
    ----------
    folder : where to write; created if necessary.
    seed : of lines, noise and sensor faults.

    Returns
    -------
    The files' paths.
    """
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    return tuple(_write(target / f"{name}.csv", name, seed) for name in RUNS)


def _write(path: Path, name: str, seed: int) -> Path:
    lines = [",".join(COLUMNS)]
    for number in range(len(RUNS[name])):
        table = run_table(name, number, seed)
        for row in zip(*(table[column].tolist() for column in COLUMNS), strict=True):
            # Adding zero turns the -0.0 of rounding into 0.0.
            lines.append(",".join(f % (round(v, int(f[2])) + 0.0) for f, v in zip(FORMATS, row, strict=True)))
    return write_atomically(path, "\n".join(lines) + "\n")
