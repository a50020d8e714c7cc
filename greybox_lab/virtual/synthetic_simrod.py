"""Generator of recordings of a synthetic SimRod, with tyre forces that no recording contains.

    for test in make(seed=0, part="train"):
        test.recording                      # recording of a test car, 100 Hz: all that an estimator may read
        test.truth.F_yf                     # readings of ideal wheel force transducers: for scoring only

Steps and sines of the steering wheel at several speeds, as on the proving ground of "Tire cornering stiffness
estimation using hybrid modeling" (Sec. 3.3). The car is the virtual vehicle with parameters of the SimRod: two tracks,
nonlinear tyres whose stiffness and friction grow less than their load, load transfer, rear drive; simulated at 1 kHz.
It shares no equations with the package's models.

`greybox datasets make simrod --seed 0 --out DIR` writes the recordings, and the truth to a separate folder. The paper
shows its profiles without numbers (Fig. 5); these reach from 1.4 to about 7 m/s^2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np
import pandas as pd

from greybox_id.base.files import at_once, write_atomically
from greybox_id.base.shorthands import Array
from greybox_id.datasets.recording import Recording
from greybox_id.models.vehicle import vehicle

from .virtual_vehicle import Forms, Truth, VirtualCar, steered
from .virtual_vehicle.scale import G

EFFECTS: Mapping[str, float] = MappingProxyType(
    {"load_sensitivity": 0.15, "longitudinal_load_transfer": 1.0, "combined_slip": 1.0}
)
"""Effects in addition to nonlinear tyres: friction falls with load; longitudinal load transfer; the driving force
reduces the rear tyres' lateral friction."""
FORMS = Forms(stiffness="degressive", geometry="each_wheel", wheels="rotating")
"""Each wheel has the slip at its own position; the outer wheel gains less stiffness than the inner one loses."""
_TOP_SPEED = 20.0
"""Brisk speed for this car, m/s."""


def simrod() -> VirtualCar:
    """The SimRod of its vehicle file: m 930 kg, I_z 700 kg m^2, l_f 1.175 m, wheelbase 2.346 m."""
    stated = vehicle("simrod")
    values = {name: value.value for name, value in stated.values.items() if value.value is not None}
    return VirtualCar(
        name="synthetic SimRod",
        kind="car",
        parameters=values,
        drive_channel="ax_cmd",
        noise=stated.noise,
        steer_max=stated.steer_max or 0.5,
        top_speed=_TOP_SPEED,
    )


Part = Literal["train", "held out"]
RATIO = 20.0
"""Ratio of the steering wheel's angle to that of the road wheels."""
FASTEST_HANDS = 6.0
"""Rate of the steering wheel in a step, rad/s."""
_STRAIGHT = 1.0
"""Duration of straight driving at the beginning and at the end, s."""


@dataclass(frozen=True)
class Manoeuvre:
    """One profile of the steering wheel at one speed.

    Attributes
    ----------
    kind : "step": to one side, held, to the other side, held; "sine": whole periods, from zero to zero.
    speed : kept by the driver, m/s.
    amplitude : at the steering wheel, rad; negative begins to the right.
    frequency : of a sine, Hz; of a step, 1 / (2 * duration of one side).
    duration : s.
    part : for training, or held out.
    """

    kind: Literal["step", "sine"]
    speed: float
    amplitude: float
    frequency: float
    duration: float = 10.0
    part: Part = "train"

    @property
    def name(self) -> str:
        """Name in tables, such as "step 14 m/s 60 deg"."""
        often = f" {self.frequency:g} Hz" if self.kind == "sine" else ""
        return f"{self.kind} {self.speed:g} m/s {round(float(np.degrees(self.amplitude)))} deg{often}"


def _train(kind: Literal["step", "sine"], *each: tuple[float, float, float]) -> tuple[Manoeuvre, ...]:
    return tuple(Manoeuvre(kind, speed, amplitude, frequency) for speed, amplitude, frequency in each)


MANOEUVRES: tuple[Manoeuvre, ...] = (
    *_train(
        "step", (8.0, 0.8, 0.16), (8.0, -3.0, 0.2), (10.0, 3.6, 0.16), (12.0, -0.6, 0.16), (12.0, 1.5, 0.2),
        (12.0, -2.7, 0.25), (14.0, 0.9, 0.16), (14.0, -2.0, 0.2), (16.0, 0.7, 0.2), (16.0, -1.6, 0.16),
    ),
    *_train(
        "sine", (8.0, 3.2, 0.3), (10.0, -1.2, 0.5), (10.0, 3.4, 0.8), (12.0, 0.9, 0.3), (12.0, -2.0, 1.0),
        (12.0, 2.8, 0.5), (14.0, -0.8, 0.6), (14.0, 2.0, 0.4), (16.0, -1.2, 0.8), (16.0, 1.5, 0.3),
    ),
    Manoeuvre("step", 9.0, 2.8, 0.2, part="held out"),
    Manoeuvre("step", 13.0, -1.8, 0.18, part="held out"),
    Manoeuvre("step", 15.0, 1.4, 0.16, part="held out"),
    Manoeuvre("sine", 11.0, 2.6, 0.4, part="held out"),
    Manoeuvre("sine", 13.0, -1.7, 0.7, part="held out"),
    Manoeuvre("sine", 15.0, 1.3, 0.5, part="held out"),
)  # fmt: skip
"""Speed, m/s, amplitude at the steering wheel, rad, and frequency, Hz. Speeds of held-out manoeuvres differ from those
for training."""


def steering(manoeuvre: Manoeuvre, rate: float) -> Array:
    """Road-wheel angle of every row, rad; (n,)."""
    n = int(round(manoeuvre.duration * rate))
    time = np.arange(n) / rate - _STRAIGHT
    lasts = manoeuvre.duration - 2.0 * _STRAIGHT
    if manoeuvre.kind == "sine":
        whole = max(np.floor(lasts * manoeuvre.frequency), 1.0) / manoeuvre.frequency
        wheel = np.where((time > 0.0) & (time < whole), np.sin(2.0 * np.pi * manoeuvre.frequency * time), 0.0)
        return np.asarray(manoeuvre.amplitude / RATIO * wheel, float)
    held = 0.5 / manoeuvre.frequency
    to, back, end = 0.0, min(held, 0.5 * lasts), min(2.0 * held, lasts)
    aim = np.select([time < to, time < back, time < end], [0.0, 1.0, -1.0], 0.0) * manoeuvre.amplitude
    wheel, most = np.zeros(n), FASTEST_HANDS / rate
    for k in range(1, n):
        wheel[k] = wheel[k - 1] + np.clip(aim[k] - wheel[k - 1], -most, most)
    return np.asarray(wheel / RATIO)


EXCITED = 0.01
"""Least slip angle of an axle, rad, for which its secant stiffness is defined."""


@dataclass(frozen=True)
class TyreTruth:
    """Forces and slips of the tyres just after each row's time, without noise; sums or means over both wheels.

    Signs as in ISO 8855: a positive slip angle makes a positive force, F_y = C_alpha alpha.

    Attributes
    ----------
    time : (n,) s.
    F_yf, F_yr : (n,) lateral forces across the wheels, N.
    alpha_f, alpha_r : (n,) slip angles at the middle of the axles, rad: steer - atan2(v_y + l_f yaw_rate, v_x) and
        -atan2(v_y - l_r yaw_rate, v_x).
    v_y, yaw_rate, a_y : (n,) motion of the centre of gravity, m/s, rad/s, m/s^2.
    C_0f, C_0r : slopes of F_y over alpha at zero slip and static load, N/rad.
    """

    time: Array
    F_yf: Array
    F_yr: Array
    alpha_f: Array
    alpha_r: Array
    v_y: Array
    yaw_rate: Array
    a_y: Array
    C_0f: float
    C_0r: float

    @property
    def C_alpha_f(self) -> Array:
        """Cornering stiffness F_y / alpha of the front axle, N/rad (secant); NaN below `EXCITED`."""
        return _secant(self.F_yf, self.alpha_f)

    @property
    def C_alpha_r(self) -> Array:
        """Cornering stiffness F_y / alpha of the rear axle, N/rad (secant); NaN below `EXCITED`."""
        return _secant(self.F_yr, self.alpha_r)

    def columns(self) -> dict[str, Array]:
        """All columns of the truth by name, with the prefix `true_`, so that none is read by mistake."""
        value = {field.name: getattr(self, field.name) for field in fields(self) if field.name[:2] != "C_"}
        every = {**value, "C_alpha_f": self.C_alpha_f, "C_alpha_r": self.C_alpha_r}
        return {name if name == "time" else f"true_{name}": values for name, values in every.items()}


def tyre_truth(truth: Truth, time: Array) -> TyreTruth:
    """The truth about the tyres from that of a recording."""
    p, states = truth.car.parameters, truth.states
    v_x, v_y, r = states["v_x"], states["v_y"], states["yaw_rate"]
    L = p["l_f"] + p["l_r"]
    slopes = {axle: p[f"B_{axle}"] * p[f"C_{axle}"] * p[f"D_{axle}"] * p["m"] * G / L for axle in "fr"}
    return TyreTruth(
        time=np.asarray(time),
        F_yf=states["F_yf"],
        F_yr=states["F_yr"],
        alpha_f=states["steer"] - np.arctan2(v_y + p["l_f"] * r, v_x),
        alpha_r=-np.arctan2(v_y - p["l_r"] * r, v_x),
        v_y=v_y,
        yaw_rate=r,
        a_y=states["a_y"],
        C_0f=slopes["f"] * p["l_r"],
        C_0r=slopes["r"] * p["l_f"],
    )


def _secant(force: Array, slip: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(np.abs(slip) >= EXCITED, force / slip, np.nan))


RATE = 100.0
"""Rows per second."""


@dataclass(frozen=True)
class Test:
    """A driven manoeuvre.

    Attributes
    ----------
    manoeuvre : as requested.
    recording : time, v_x, v_y, yaw_rate, a_x, a_y, steer and ax_cmd: all that an estimator may read.
    truth : forces and slips of the tyres; for scoring only.
    """

    __test__ = False  # not a test class for pytest

    manoeuvre: Manoeuvre
    recording: Recording
    truth: TyreTruth


def make(seed: int = 0, part: Part | None = None, noise: float = 1.0) -> tuple[Test, ...]:
    """All manoeuvres, or those of one part, each as a recording.

    Parameters
    ----------
    seed : of sensor noise; the manoeuvres are always the same.
    part : "train" or "held out"; None for both.
    noise : sd of the sensors relative to that in the vehicle file.
    """
    chosen = [k for k, manoeuvre in enumerate(MANOEUVRES) if part in (None, manoeuvre.part)]
    seeds = [int(np.random.SeedSequence((seed, k)).generate_state(1)[0]) for k in chosen]
    return drive([MANOEUVRES[k] for k in chosen], seeds, noise)


def drive(manoeuvres: Sequence[Manoeuvre], seeds: Sequence[int], noise: float = 1.0) -> tuple[Test, ...]:
    """Drive manoeuvres with seeds of their noise, whose sd is `noise` times that in the vehicle file."""
    car, result = simrod(), []
    for manoeuvre, seed in zip(manoeuvres, seeds, strict=True):
        steer = steering(manoeuvre, RATE)
        speed = np.full(len(steer), manoeuvre.speed)
        recording, truth = steered(car, manoeuvre.name, steer, speed, RATE, EFFECTS, FORMS, seed, noise=noise)
        result.append(Test(manoeuvre, recording, tyre_truth(truth, recording.time)))
    return tuple(result)


TRUTH = "truth"


def write(folder: str | Path, seed: int = 0) -> tuple[Path, ...]:
    """Write a recording per manoeuvre, and its truth under the same name to the folder `truth` within.

    The recordings have the columns of the column map "canonical".

    Parameters
    ----------
    folder : where to write; created if necessary.
    seed : of sensor noise.

    Returns
    -------
    Paths of the recordings.
    The recordings' paths.
    """
    target, written = Path(folder), []
    (target / TRUTH).mkdir(parents=True, exist_ok=True)
    with at_once():
        for number, test in enumerate(make(seed), 1):
            part = test.manoeuvre.part.replace(" ", "_")
            name = f"{part}_{number:02d}_{test.manoeuvre.kind}.csv"
            recorded = {"time": test.recording.time, **test.recording.signals}
            written.append(write_atomically(target / name, _csv(recorded)))
            write_atomically(target / TRUTH / name, _csv(test.truth.columns()))
    return tuple(written)


def _csv(columns: Mapping[str, Array]) -> str:
    return str(pd.DataFrame(dict(columns)).to_csv(index=False, float_format="%.8g", lineterminator="\n"))
