"""A vehicle to drive in simulation that has what its file does not state, and what came of driving it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from greybox_id.base.errors import BadInput
from greybox_id.base.numbers import quantity
from greybox_id.base.shorthands import Array
from greybox_id.datasets.recording import Recording
from greybox_id.models.vehicle import Vehicle, parse_vehicle

from ...virtual.virtual_vehicle import (
    EFFECTS,
    OUTSIDE,
    SteppedCar,
    VirtualCar,
    random_vehicle,
    replay,
    toleranced,
    tolerances,
    vehicle_file_text,
)
from ..racing.world import HALTED, HALTED_FOR, SPUN, Observations, World
from .adapting import SETTLED

CASES: tuple[Mapping[str, int], ...] = (
    {"steering_delay": 1, "front_stiffness": -1},
    {"steering_lag": 1, "grip_scale": -1},
    {"mass_change": 1, "steering_ratio": -1},
    {"motor_lag": 1, "motor_gain": -1},
    {"steering_offset": 1, "rear_stiffness": -1},
    {"tyre_relaxation": 1, "grip_scale": -1},
    {"variable_ratio": 1},
    {"rear_steer": 1},
)
"""What is the matter, and on which side of its null each effect lies: six pairs of what `greybox gap` knows, and two
effects that it does not know."""
SIZE = 1.0
"""Effects are as large as the virtual vehicle holds for plausible at most."""
LEFT_OUT = 0.5
"""s before a crash that are not diagnosed: tyres slide there as no model of a drive says."""
SHORTEST = 2.0
"""s of an episode that are diagnosed at least."""
START = 0.7
"""Share of the speed wanted at the start with which a vehicle begins."""


def effect_words(effects: Mapping[str, float]) -> str:
    """Effects with their magnitudes and units, for people."""
    known = {**EFFECTS, **OUTSIDE}
    units = {name: known[name].unit if name in known else "" for name in effects}
    return ", ".join(f"{name} {quantity(value, units[name])}" for name, value in effects.items()) or "nothing"


class Hands:
    """Whatever commands a vehicle.

    Parameters
    ----------
    world : of the vehicle as its file states it, one lane: its track, and the units of what is seen and done.
    act : what is seen, (1, size), becomes actions, (1, 2).
    """

    def __init__(self, world: World, act: Callable[[Observations], Array]) -> None:
        self.world, self.act = world, act

    def acted(self, seen: Observations) -> Array:
        """(1, 2) actions."""
        return self.act(seen)

    def limited(self, command: Array) -> Array:
        """What is given, (2,) steer and drive, of what is wanted."""
        return command

    def watch(self, row: Mapping[str, float]) -> None:
        """Be told readings, place and commands of every period."""


@dataclass(frozen=True)
class Scene:
    """A vehicle in simulation, and what its file says of it.

    Attributes
    ----------
    case : number of one of `CASES`.
    seed : says which vehicle.
    forms : "nominal": mathematical forms as in the models; "other": others.
    exact : whether it is what its file states; else its parameters lie within the tolerances that the file states.
    """

    case: int = 0
    seed: int = 3
    forms: str = "nominal"
    exact: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.case < len(CASES):
            raise BadInput(f"‹case›: there are cases 0 to {len(CASES) - 1}, not {self.case}.")

    @cached_property
    def stated(self) -> VirtualCar:
        """The vehicle as its file states it; v_y, which drivers see, is read as well as the speed is."""
        drawn = random_vehicle(self.seed, "racer")
        return replace(drawn, noise={**drawn.noise, "v_y": drawn.noise["v_x"]})

    @cached_property
    def car(self) -> VirtualCar:
        """The vehicle that drives."""
        return self.stated if self.exact else toleranced(self.stated, np.random.default_rng(self.seed))

    @cached_property
    def effects(self) -> dict[str, float]:
        """What is the matter with it."""
        known, size, kind = {**EFFECTS, **OUTSIDE}, self.stated.size, self.stated.kind
        sides = CASES[self.case]
        return {name: known[name].at(side * SIZE * known[name].sizes(size, kind)[1]) for name, side in sides.items()}

    @cached_property
    def text(self) -> str:
        """Its vehicle file."""
        return vehicle_file_text(self.stated, None if self.exact else tolerances(self.stated))

    @cached_property
    def vehicle(self) -> Vehicle:
        """What its file states."""
        return parse_vehicle(self.text, Path("vehicle.toml"))


@dataclass(frozen=True)
class Episode:
    """From a start to a crash, or to the end.

    Attributes
    ----------
    time, s, e_y : (n,) s since the start, m along and beside the path, at every command.
    laps : s of each that was driven to its end, the first one from standing out of place.
    crashed : whether it left the track, spun, or halted.
    recording : what its sensors read, less the moments before a crash; None where little is left.
    """

    time: Array
    s: Array
    e_y: Array
    laps: tuple[float, ...]
    crashed: bool
    recording: Recording | None


@dataclass(frozen=True)
class DrivenRows:
    """Episodes, one after the other.

    Attributes
    ----------
    episodes : with their recordings.
    """

    episodes: tuple[Episode, ...]

    @property
    def rows(self) -> int:
        """Commands that were given."""
        return sum(len(episode.time) for episode in self.episodes)

    @property
    def crashes(self) -> int:
        """Episodes that ended so."""
        return sum(episode.crashed for episode in self.episodes)

    @property
    def recordings(self) -> list[Recording]:
        """What is diagnosed."""
        return [episode.recording for episode in self.episodes if episode.recording is not None]

    @property
    def path_error(self) -> float:
        """Root mean square of the lateral error, m, but for the first second of every episode."""
        kept = np.concatenate([episode.e_y[episode.time >= SETTLED] for episode in self.episodes])
        return float(np.sqrt(np.mean(kept**2))) if len(kept) else float("nan")

    @property
    def lap_time(self) -> float:
        """Median of flying laps, s; of the first ones where there is no other; NaN without any."""
        flying = [lap for episode in self.episodes for lap in episode.laps[1:]]
        laps = flying or [lap for episode in self.episodes for lap in episode.laps]
        return float(np.median(laps)) if laps else float("nan")


def driven(scene: Scene, hands: Hands, rows: int, seed: int) -> DrivenRows:
    """Let a vehicle be driven; after a crash it is put back to the start.

    Parameters
    ----------
    scene : whose vehicle.
    hands : what drives it.
    rows : commands in all.
    seed : of the noise that the driver's readings have, and of what is random in the vehicle.
    """
    result, left = list[Episode](), rows
    while left > 0:
        episode = _episode(scene, hands, left, seed + len(result))
        left -= len(episode.time)
        result.append(episode)
    return DrivenRows(tuple(result))


def _episode(scene: Scene, hands: Hands, rows: int, seed: int) -> Episode:
    period, track = hands.world.rules.period, hands.world.track
    v_x = START * float(track.speed[0])
    ride = SteppedCar(scene.car, v_x, rows * period, 1.0 / period, scene.effects, scene.forms, seed)
    sd = np.array([scene.car.noise[name] for name in ("v_x", "v_y", "yaw_rate")])
    noise = sd * np.random.default_rng((seed, 11)).standard_normal((rows, 3))
    places, commands, laps = np.zeros((rows, 2)), np.zeros((rows, 2)), list[float]()
    last, s, halted, crashed, done = np.zeros((1, 2)), 0.0, 0.0, False, 0
    while done < rows and not crashed:
        now, world = ride.motion, hands.world
        s, e_y, e_psi = track.project(now["x"], now["y"], now["yaw"], s)
        motion = np.array([[now["v_x"], now["v_y"], now["yaw_rate"]]]) + noise[done]
        if done:  # with commands of zero it began, as `replay` takes it
            last = np.clip(hands.acted(world.seen(motion, np.array([[s, e_y, e_psi]]), last)), -1.0, 1.0)
            command = world.commanded(last, motion[:, 0], np.array([s]))[0][list(world.inputs)]
            commands[done] = hands.limited(command)
        places[done] = s, e_y
        v, v_y, yaw_rate = motion[0].tolist()
        steer, drive = commands[done].tolist()
        hands.watch({"time": done * period, "v_x": v, "v_y": v_y, "yaw_rate": yaw_rate, "steer": steer,
                     scene.car.drive_channel: drive, "s": s, "e_y": e_y})  # fmt: skip
        if s >= (len(laps) + 1) * track.length:
            laps.append(done * period - sum(laps))
        halted = halted + period if now["v_x"] < HALTED else 0.0
        slipping = abs(np.arctan2(now["v_y"], max(now["v_x"], 1e-3))) > SPUN
        crashed = abs(e_y) > world.edge or slipping or halted >= HALTED_FOR
        try:
            ride.step(steer, drive)
        except BadInput:  # the motion blew up
            crashed = True
        done += 1
    kept = done - int(LEFT_OUT / period) if crashed else done
    recording = _recorded(scene, commands[:kept], v_x, period, seed) if kept * period >= SHORTEST else None
    times = np.asarray(period * np.arange(done), dtype=np.float64)
    return Episode(times, places[:done, 0], places[:done, 1], tuple(laps), bool(crashed), recording)


def _recorded(scene: Scene, commands: Array, v_x: float, period: float, seed: int) -> Recording:
    """What all of the vehicle's sensors read on the same drive: commands are carried out once more."""
    signals = {"steer": commands[:, 0], scene.car.drive_channel: commands[:, 1]}
    times = np.asarray(period * np.arange(len(commands)), dtype=np.float64)
    given = Recording(f"drive {seed}", times, signals)
    return replay(scene.car, given, {"v_x": v_x}, scene.effects, scene.forms, seed, noise=1.0)[0]
