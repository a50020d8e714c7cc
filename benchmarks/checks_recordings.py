"""Recordings with nothing wrong, and faults to put into them: what benchmarks/checks.py counts on."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from greybox_id.base.shorthands import Array
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording
from greybox_id.datasets.shipped import shipped
from greybox_lab.virtual.virtual_vehicle import EFFECTS, MANOEUVRES, drive, random_vehicle, steered
from greybox_lab.virtual.virtual_vehicle.scale import Scale

RATES = (20.0, 25.0, 40.0, 50.0, 100.0, 125.0, 200.0)
SECONDS = (10.0, 120.0)
STYLES = {"virtual": 0.7, "gentle": 0.15, "straight": 0.1, "circle": 0.05}
EARTH = 6.371e6
DEGREE, G = 180 / np.pi, 9.80665
EXCEL_DAY = 45_000.0
EPOCH = 1.7e18
CORNERS = ("fl", "fr", "rl", "rr")
LATE_OR_LOST = ("dropped_samples",)
"""Effects that are faults of a recording themselves."""


def clean(seed: int) -> Recording:
    """A recording with nothing wrong: any vehicle, manoeuvre, length, rate, noise and choice of channels.

    In half of them the vehicle or a sensor has one effect of the vocabulary, such as a mounting angle, a bias or a
    latency of the size that real ones have.
    """
    rng = np.random.default_rng((seed, 611))
    car = random_vehicle(int(rng.integers(1_000_000)))
    rate = float(rng.choice(RATES))
    seconds = float(np.exp(rng.uniform(*np.log(SECONDS))))
    style = str(rng.choice(list(STYLES), p=list(STYLES.values())))
    noise, colour = float(np.exp(rng.uniform(np.log(0.3), np.log(2.0)))), float(rng.choice([0.0, 0.5]))
    effects = {}
    if rng.random() < 0.5:
        entry = EFFECTS[str(rng.choice([name for name in EFFECTS if name not in LATE_OR_LOST]))]
        effects = {entry.name: entry.draw(car.size, car.kind, rng)}
    own = {"effects": effects, "seed": seed, "noise": noise, "colour": colour}
    if style == "virtual":
        manoeuvre = str(rng.choice(MANOEUVRES))
        recording, truth = drive(car, manoeuvre, seconds, rate, **own)
    else:
        manoeuvre = style
        steer, speed = _calm(style, car.size, seconds, rate, rng)
        recording, truth = steered(car, style, steer, speed, rate, **own)
    found = _measured(recording, truth.states, car.noise["v_x"] * noise, rng)
    return replace(found, name=f"{car.kind}, {manoeuvre}, {seconds:.0f} s at {rate:g} Hz, seed {seed}")


def _calm(style: str, size: Scale, seconds: float, rate: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Steering and speed of gentle, straight or circular driving."""
    rows = int(seconds * rate)
    time, top = np.arange(rows) / rate, size.top_speed
    speed = top * rng.uniform(0.3, 0.8) * (1 + rng.choice([0.0, 0.05]) * np.sin(2 * np.pi * time / rng.uniform(8, 30)))
    if style == "straight":
        return np.zeros(rows), speed
    share = rng.uniform(0.02, 0.1) if style == "gentle" else rng.uniform(0.2, 0.5)
    most = share * G * size.length / speed**2
    if style == "circle":
        return rng.choice([-1.0, 1.0]) * most * np.minimum(time / 2.0, 1.0), speed
    waves = [np.sin(2 * np.pi * (f * time + rng.random())) for f in np.exp(rng.uniform(np.log(0.05), 0.0, 6))]
    return most * np.sum(waves, axis=0) / 2.0, speed


def _measured(r: Recording, states: Mapping[str, Array], speed_noise: float, rng: np.random.Generator) -> Recording:
    """The recording with further channels: pose, place on earth, wheel speeds, sideslip."""
    n, more = len(r), {}
    if rng.random() < 0.5:
        place, turn = rng.uniform(0.005, 0.05), rng.uniform(-np.pi, np.pi)
        c, s = np.cos(turn), np.sin(turn)
        x, y = c * states["x"] - s * states["y"], s * states["x"] + c * states["y"]
        more["x"], more["y"] = (own + place * rng.standard_normal(n) for own in (x, y))
        yaw = states["yaw"] + turn + 0.003 * rng.standard_normal(n)
        more["yaw"] = np.mod(yaw + np.pi, 2 * np.pi) - np.pi if rng.random() < 0.5 else yaw
    if rng.random() < 0.2:
        east, north = (states[name] + 0.3 * np.cumsum(rng.standard_normal(n)) / np.sqrt(n) for name in ("x", "y"))
        more["latitude"] = 47.5 + np.degrees(north / EARTH)
        more["longitude"] = 8.6 + np.degrees(east / EARTH) / np.cos(np.radians(47.5))
    if rng.random() < 0.3:
        for corner in CORNERS:
            spin = states[f"wheel_speed_{corner}"]
            more[f"wheel_speed_{corner}"] = spin * (1 + 0.005 * rng.standard_normal()) + 0.005 * np.abs(
                spin
            ).mean() * rng.standard_normal(n)
    if rng.random() < 0.1 and "v_y" in r:
        more["sideslip"] = np.arctan2(states["v_y"], states["v_x"]) + 0.003 * rng.standard_normal(n)
    return r.with_signals(**more)


@dataclass(frozen=True)
class Fault:
    """Something done wrong on the way from the sensor to the recording.

    Attributes
    ----------
    about : what.
    needs : channels that it spoils; where one is missing it cannot happen.
    apply : the recording with the fault.
    says : what a sentence that names it holds; `about` if empty.
    """

    about: str
    needs: tuple[str, ...]
    apply: Callable[[Recording], Recording]
    says: str = ""

    def named(self, sentence: str) -> bool:
        """Whether a sentence says what was done."""
        return (self.says or self.about) in sentence


def _by(**made: Callable[[Recording], Array]) -> Callable[[Recording], Recording]:
    return lambda r: r.with_signals(**{name: own(r) for name, own in made.items()})


def _scaled(factor: float, *names: str) -> Callable[[Recording], Recording]:
    return lambda r: r.with_signals(**{name: factor * r[name] for name in names})


def _clocked(factor: float, offset: float = 0.0) -> Callable[[Recording], Recording]:
    def apply(r: Recording) -> Recording:
        return replace(r, time=factor * r.time + offset)  # runs stay as they were read

    return apply


def _drive(r: Recording) -> str:
    return next(name for name in ("drive_force", "ax_cmd", "motor_current") if name in r)


def _upright(r: Recording) -> Array:
    """What an accelerometer that points up reads."""
    return np.asarray(G + 0.3 * np.random.default_rng(3).standard_normal(len(r)))


def _rolling(r: Recording) -> Array:
    """What a gyro about an axis that lies reads."""
    return np.asarray(0.02 * np.random.default_rng(4).standard_normal(len(r)))


IMU = ("a_x", "a_y")
FAULTS: dict[str, Fault] = {
    own.about: own
    for own in (
        Fault("the columns of a_x and a_y are exchanged", IMU, _by(a_x=lambda r: r["a_y"], a_y=lambda r: r["a_x"])),
        Fault("the IMU is turned by 90° to the left", IMU, _by(a_x=lambda r: r["a_y"], a_y=lambda r: -r["a_x"])),
        Fault("the IMU is turned by 90° to the right", IMU, _by(a_x=lambda r: -r["a_y"], a_y=lambda r: r["a_x"])),
        Fault("the IMU is turned by 180° about z", IMU, _scaled(-1.0, *IMU)),
        Fault("the IMU is upside down (turned about x)", ("a_y", "yaw_rate"), _scaled(-1.0, "a_y", "yaw_rate")),
        Fault("the IMU is upside down (turned about y)", ("a_x", "yaw_rate"), _scaled(-1.0, "a_x", "yaw_rate")),
        Fault("the IMU is upside down with x and y exchanged", (*IMU, "yaw_rate"),
              _by(a_x=lambda r: r["a_y"], a_y=lambda r: r["a_x"], yaw_rate=lambda r: -r["yaw_rate"])),
        Fault("a_x reads gravity", (*IMU, "yaw_rate"), _by(a_x=_upright, yaw_rate=_rolling), "a_x reads +9.8"),
        Fault("a_y reads gravity", (*IMU, "yaw_rate"), _by(a_y=_upright, yaw_rate=_rolling), "a_y reads +9.8"),
        Fault("a_x has the wrong sign", ("a_x",), _scaled(-1.0, "a_x")),
        Fault("a_y has the wrong sign", ("a_y",), _scaled(-1.0, "a_y")),
        Fault("yaw_rate has the wrong sign", ("yaw_rate",), _scaled(-1.0, "yaw_rate")),
        Fault("steer has the wrong sign", ("steer",), _scaled(-1.0, "steer")),
        Fault("v_y has the wrong sign", ("v_y",), _scaled(-1.0, "v_y")),
        Fault("v_x has the wrong sign", ("v_x",), _scaled(-1.0, "v_x")),
        Fault("yaw has the wrong sign", ("yaw", "yaw_rate"), _scaled(-1.0, "yaw")),
        Fault("sideslip has the wrong sign", ("sideslip", "v_y"), _scaled(-1.0, "sideslip")),
        Fault("the columns of v_x and v_y are exchanged", ("v_x", "v_y"),
              _by(v_x=lambda r: r["v_y"], v_y=lambda r: r["v_x"])),
        Fault("the positions are mirrored", ("x", "y"), _scaled(-1.0, "y")),
        Fault("v_x is in km/h but called m/s", ("v_x",), _scaled(3.6, "v_x")),
        Fault("v_x is in m/s but called km/h", ("v_x",), _scaled(1 / 3.6, "v_x")),
        Fault("yaw_rate is in deg/s but called rad/s", ("yaw_rate",), _scaled(DEGREE, "yaw_rate")),
        Fault("steer is in deg but called rad", ("steer",), _scaled(DEGREE, "steer")),
        Fault("a_x and a_y are in g but called m/s²", IMU, _scaled(1 / G, *IMU)),
        Fault("a_x and a_y are in m/s² but called g", IMU, _scaled(G, *IMU)),
        Fault("a_y is in g but called m/s²", ("a_y",), _scaled(1 / G, "a_y")),
        Fault("yaw is in deg but called rad", ("yaw", "yaw_rate"), _scaled(DEGREE, "yaw")),
        Fault("time is 2 times as long as it should be", (), _clocked(2.0)),
        Fault("time is 0.5 times as long as it should be", (), _clocked(0.5)),
        Fault("time is in ms but called s", (), _clocked(1000.0), "in ms"),
        Fault("time is in ns since 1970 but called s", (), _clocked(1e9, EPOCH), "in ns"),
        Fault("time is in days but called s", (), _clocked(1 / 86_400, EXCEL_DAY), "in day"),
        Fault("drive has the wrong sign", (), lambda r: _scaled(-1.0, _drive(r))(r), " has the wrong sign"),
        Fault("ax_cmd is ten times too large", ("ax_cmd",), _scaled(10.0, "ax_cmd"), "times ax_cmd"),
        Fault("the wheel speeds are in rpm but called rad/s", ("wheel_speed_fl",),
              _scaled(30 / np.pi, *(f"wheel_speed_{c}" for c in CORNERS)), "rpm but called rad/s"),
        Fault("wheel_speed_fl is in rpm but called rad/s", ("wheel_speed_fl",), _scaled(30 / np.pi, "wheel_speed_fl")),
    )
}  # fmt: skip


def _rotated(degrees: float) -> Callable[[Recording], Recording]:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return _by(a_x=lambda r: c * r["a_x"] + s * r["a_y"], a_y=lambda r: c * r["a_y"] - s * r["a_x"])


def _raised(name: str, by: float) -> Callable[[Recording], Recording]:
    return lambda r: r.with_signals(**{name: r[name] + by})


def _at(name: str, instants: Callable[[Array], Array]) -> Callable[[Recording], Recording]:
    """A channel read at other instants than its stamps, in s from the start."""
    return lambda r: r.with_signals(**{name: np.interp(r.time[0] + instants(r.time - r.time[0]), r.time, r[name])})


def _frozen(name: str, begin: float, seconds: float) -> Callable[[Recording], Recording]:
    def apply(r: Recording) -> Recording:
        values, since = r[name].copy(), r.time - r.time[0]
        rows = (since > begin) & (since < begin + seconds)
        values[rows] = values[np.argmax(rows)]
        return r.with_signals(**{name: values})

    return apply


def _second_half(name: str, factor: float) -> Callable[[Recording], Recording]:
    return lambda r: r.with_signals(**{name: r[name] * np.where(np.arange(len(r)) < len(r) // 2, 1.0, factor)})


SIZED: dict[str, Fault] = {
    own.about: own
    for own in (
        Fault("yaw_rate 0.15 rad/s too high", ("yaw_rate",), _raised("yaw_rate", 0.15), "yaw_rate has an offset"),
        Fault("yaw_rate 0.08 rad/s too low", ("yaw_rate",), _raised("yaw_rate", -0.08), "yaw_rate has an offset"),
        Fault("IMU turned by 15 degrees", IMU, _rotated(15.0), "The IMU is turned by"),
        Fault("IMU turned by -25 degrees", IMU, _rotated(-25.0), "The IMU is turned by"),
        Fault("a_y times 0.8", ("a_y",), _scaled(0.8, "a_y"), "a_y is 0."),
        Fault("a_y times 1.4", ("a_y",), _scaled(1.4, "a_y"), "a_y is 1."),
        Fault("yaw_rate times 0.75", ("yaw_rate", "yaw"), _scaled(0.75, "yaw_rate"), "yaw_rate is 0."),
        Fault("bank of 7 degrees", ("a_y",), _raised("a_y", 9.81 * np.sin(np.radians(7.0))), "banked"),
        Fault("steer 0.3 s early", ("steer",), _at("steer", lambda t: t + 0.3), "steer is early"),
        Fault("steer 0.3 s late", ("steer",), _at("steer", lambda t: t - 0.3), "steer is late"),
        Fault("yaw_rate 0.3 s late", ("yaw_rate",), _at("yaw_rate", lambda t: t - 0.3), "yaw_rate is late"),
        Fault("a_y 0.25 s early", ("a_y",), _at("a_y", lambda t: t + 0.25), "a_y "),
        Fault("clock of a_y 2 % fast", ("a_y",), _at("a_y", lambda t: 0.98 * t), "clock of a_y"),
        Fault("clock of a_x 1 % slow", ("a_x",), _at("a_x", lambda t: 1.01 * t), "clock of a_x"),
        Fault("gyro frozen for 30 s", ("yaw_rate",), _frozen("yaw_rate", 20.0, 30.0), "yaw_rate is stuck"),
        Fault("v_x frozen for 10 s", ("v_x",), _frozen("v_x", 20.0, 10.0), "v_x is stuck"),
        Fault("steer frozen for 8 s", ("steer",), _frozen("steer", 20.0, 8.0), "steer is stuck"),
        Fault("steer of another scale in the second half", ("steer",), _second_half("steer", 1.5), "another car"),
        Fault("steer 0.03 rad too high", ("steer",), _raised("steer", 0.03), "steer has an offset"),
        Fault("gyro without readings for 10 s", ("yaw_rate",), lambda r: r.with_signals(
              yaw_rate=np.where(np.abs(r.time - r.time[0] - 35.0) < 5.0, np.nan, r["yaw_rate"])), "missing"),
    )
}  # fmt: skip
"""Faults of a size, as sensors, clocks and loggers make them."""
MAPPED = (
    "the columns of a_x and a_y are exchanged", "the IMU is turned by 90° to the left",
    "the IMU is turned by 180° about z", "the IMU is upside down (turned about x)", "yaw_rate has the wrong sign",
    "steer has the wrong sign", "yaw_rate is in deg/s but called rad/s", "steer is in deg but called rad",
    "v_x is in km/h but called m/s", "a_y is in g but called m/s²", "time is 2 times as long as it should be",
)  # fmt: skip
PLANTED = {**SIZED, **{name: FAULTS[name] for name in MAPPED}}
"""The 31 faults of the examination of one drive."""


def with_heading(kind: str, seed: int) -> Recording:
    """Ninety seconds of mixed driving with heading, to plant faults in."""
    recording, truth = drive(random_vehicle(seed, kind), "mixed", 90.0, 50.0, seed=seed)
    noise = 0.002 * np.random.default_rng((seed, 611)).standard_normal(len(recording))
    return recording.with_signals(yaw=truth.states["yaw"] + noise)


def possible(fault: Fault, recording: Recording) -> bool:
    """Whether a recording has what the fault spoils."""
    drives = any(name in recording for name in ("drive_force", "ax_cmd", "motor_current"))
    return all(name in recording for name in fault.needs) and (drives or not fault.about.startswith("drive"))


def twelve() -> list[Recording]:
    """Twelve recordings as they are shipped: those under GREYBOX_DATA, and synthetic ones."""
    found: list[Recording] = []
    if data := os.environ.get("GREYBOX_DATA"):
        folder = Path(data)
        for file in ("train", "valid", "tire_set_1", "single_mass"):
            found.append(read(folder / "roboracer" / f"{file}.csv", "roboracer"))
        truck = read(folder / "truck" / "train.parquet", "truck")
        half = truck.runs[len(truck.runs) // 2][0]
        found += [replace(truck.rows(0, half), name="truck, first half"), replace(truck.rows(half, len(truck)),
                  name="truck, second half"), read(folder / "truck" / "val.parquet", "truck")]  # fmt: skip
        ferrari = read(folder / "revs_250lm" / "run1_first400s.csv.gz", "revs_250lm")
        found += [replace(ferrari.rows(0, 20_000), name="250 LM, first 200 s"),
                  replace(ferrari.rows(20_000, 40_000), name="250 LM, next 200 s")]  # fmt: skip
    found.append(read(shipped("racer_valid"), "roboracer"))
    for seed, car in ((71, random_vehicle(71, "car")), (72, random_vehicle(72, "truck"))):
        recording, truth = drive(car, "mixed", 90.0, 50.0, seed=seed)
        rng = np.random.default_rng((seed, 611))
        more = {"v_y": truth.states["v_y"] + 0.03 * rng.standard_normal(len(recording))}
        more |= {name: truth.states[name] + 0.01 * rng.standard_normal(len(recording)) for name in ("x", "y")}
        more["yaw"] = truth.states["yaw"] + 0.002 * rng.standard_normal(len(recording))
        more |= {f"wheel_speed_{c}": truth.states[f"wheel_speed_{c}"] for c in CORNERS}
        found.append(replace(recording.with_signals(**more), name=f"virtual {car.kind}"))
    return found
