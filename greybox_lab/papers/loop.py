"""Black box against name: which arm drives a changed vehicle better, and which model foretells it, on the same rows?

The vehicle is the virtual one, which shares no code with the models; it has effects that its file does not state. All
arms get the same rows of the first drive, the same driver to begin with, and as many steps of learning. No real car
drives here, and the virtual vehicle's author is that of the models.

DIR/bench.json               what is asked for
DIR/case_1_vehicle_30_seed_0/ one of the cases: driver.json, that before any data, and
    actuator_net.json ...    what came of an arm; an arm whose file is there is not run again
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from greybox_id.base.errors import BadInput, GreyboxError, must_be_one_of, must_be_whole
from greybox_id.base.files import write_atomically
from greybox_id.base.json_data import plain, read_json, without_nan
from greybox_id.base.shorthands import Say
from greybox_id.base.version import __version__
from greybox_id.datasets.recording import Recording
from greybox_id.models.registry import motion_model_of

from ..driving.learned.open_loop import HORIZONS, errors_ahead
from ..driving.loop.adapting import SETTLED, last_rows, learned_on, world_of
from ..driving.loop.arms import Twin, oracle, twin
from ..driving.loop.scene import CASES, DrivenRows, Hands, Scene, driven
from ..driving.loop.state import begun
from ..driving.loop.swap import read_learned
from ..driving.racing.learner import Learned, shipped_learned
from ..driving.racing.track import RaceTrack, Usage, track
from ..driving.racing.world import HALF_WIDTH, NARROWEST, World
from ..virtual.virtual_vehicle import OUTSIDE, SteppedCar, replay
from .loop_report import ARMS, BASE, ORACLE, reported

CAPS = (0.6, 0.7, 0.8, 0.9)
"""Shares of the grip: of the first drive, moderate as was published, and after each cycle."""
FIRST_VEHICLE = 40
"""Those before were driven while arms and learning were developed, or looked at before."""
SHARES = (0.6, 0.9)
"""Shares of the grip of held-out drives: what was driven, and beyond."""
WITHOUT_ROWS = ("hand", "nominal", ORACLE)
CURVE: Mapping[str, tuple[int, ...]] = {"named": (2_000,), "actuator_net": (2_000, 5_000, 10_000, 20_000)}
"""Rows that models are made of besides."""


@dataclass(frozen=True)
class LoopBenchSize:
    """How much is driven and learned.

    Attributes
    ----------
    cases : numbers of `scene.CASES` that are run unless others are asked for.
    arms : that are run unless others are asked for.
    cycles : of driving, modelling and learning.
    base : steps in which the shipped driver is got used to the vehicle as its file states it, give or take the ranges
        of `hand`.
    rows : of a drive; models are made of the last so many.
    steps : of learning in a cycle.
    judged : rows that an arm is judged by, at each of two caps.
    curve : rows that models of other numbers of rows are made of at most, see `CURVE`.
    """

    cases: tuple[int, ...]
    arms: tuple[str, ...]
    cycles: int
    base: int
    rows: int
    steps: int
    judged: int
    curve: int


QUICK = LoopBenchSize((1,), (BASE, "hand", "actuator_net", "named", ORACLE), 1, 300_000, 2_000, 300_000, 3_500, 10_000)
FULL = LoopBenchSize(tuple(range(len(CASES))), ARMS, 3, 300_000, 5_000, 300_000, 12_000, 20_000)


def loop_tables(
    out: str | Path, *, quick: bool = False, cases: Sequence[int] = (), arms: Sequence[str] = (),
    cycles: int | None = None, vehicles: int = 1, seeds: int = 1, say: Say = lambda sentence: None,
) -> dict[str, Any]:  # fmt: skip
    """Run what is not done yet, and compare all that a folder holds.

    Parameters
    ----------
    out : folder; one in which the same was begun is carried on with.
    quick : one case, one cycle, five arms, unless others are asked for.
    cases : numbers of `scene.CASES`; none: those of the size.
    arms : of `loop_report.ARMS`; none: those of the size.
    cycles : of driving, modelling and learning, from 1 to 3; None: those of the size.
    vehicles : drawn for each case; every other one has other mathematical forms than the models, and parameters
        anywhere within the tolerances that its file states.
    seeds : of learning, for each vehicle.
    say : told what is going on.

    Returns
    -------
    Plain data: `cases`, `table`, `bars`, see docs/json.md.

    Raises
    ------
    BadInput : the folder holds something else, or there is no such case or arm.
    """
    size = QUICK if quick else FULL
    if cycles is not None:
        must_be_whole(cycles, "cycles", 1, len(CAPS) - 1)
        size = replace(size, cycles=cycles)
    for name in arms:
        must_be_one_of(ARMS, name, "There is no arm")
    folder = Path(out)
    requested = {"quick": quick, "cycles": size.cycles, "version": __version__}
    begun(folder / "bench.json", "bench", requested, {})
    chosen = [name for name in ARMS if name in (arms or size.arms)]
    target = [
        _BenchCase(folder, number, FIRST_VEHICLE + vehicle, seed, size)
        for seed in range(seeds)
        for vehicle in range(vehicles)
        for number in (cases or size.cases)
    ]
    with threadpool_limits(1):
        for k, case in enumerate(target, 1):
            case.run(chosen, _after(f"{k}/{len(target)} ", say))
    return {"quick": quick, "folder": str(folder), **reported(kept(folder))}


def _after(words: str, say: Say) -> Say:
    """Says what it is told after these words."""
    return lambda sentence: say(words + sentence)


def kept(folder: Path) -> list[dict[str, Any]]:
    """All that is done in a folder, case by case."""
    result = []
    for file in sorted(folder.glob("case_*")):
        about = read_json(file / "case.json") if (file / "case.json").is_file() else None
        if isinstance(about, dict):
            arms = {name: read_json(file / f"{name}.json") for name in ARMS if (file / f"{name}.json").is_file()}
            result.append({**about, "arms": arms})
    return result


class _BenchCase:
    """A vehicle, what is the matter with it, and a seed of learning."""

    def __init__(self, folder: Path, number: int, vehicle: int, seed: int, size: LoopBenchSize) -> None:
        forms = ("nominal", "other")[(number + vehicle - FIRST_VEHICLE) % 2]
        self.scene = Scene(number, vehicle, forms, exact=forms == "nominal")
        self.size, self.seed = size, seed
        self.name = f"case {number}, vehicle {vehicle}, seed {seed}"
        self.folder = folder / self.name.replace(", ", "_").replace(" ", "_")
        self.vehicle = self.scene.vehicle
        self.nominal = motion_model_of(self.vehicle)

    def run(self, arms: Sequence[str], say: Say) -> None:
        """Arms that are not done yet."""
        waiting = [name for name in arms if not (self.folder / f"{name}.json").is_file()]
        if not waiting:
            return
        self.folder.mkdir(exist_ok=True)
        outside = [name for name in self.scene.effects if name in OUTSIDE]
        about = {"case": self.scene.case, "vehicle": self.scene.seed, "seed": self.seed, "forms": self.scene.forms,
                 "withheld": self.scene.effects, "outside": outside}  # fmt: skip
        self._write("case", about)
        say(f"{self.name}: learning to drive before any data")
        base = self._base()
        held = {f"{share:.0%}": held_out(self.scene, share) for share in SHARES}
        for name in waiting:
            say(f"{self.name}: {name}")
            self._write(name, self._arm(name, base, held, _after(f"{self.name}: {name}, ", say)))

    def _write(self, name: str, what: Mapping[str, Any]) -> None:
        text = json.dumps(without_nan(plain(dict(what))), allow_nan=False) + "\n"
        write_atomically(self.folder / f"{name}.json", text, continued=True)

    def _base(self) -> Learned:
        """The driver before any data: the shipped one, used to this vehicle within published ranges, at all speeds."""
        file, last = self.folder / "driver.json", CAPS[self.size.cycles]
        if not file.is_file():
            made = learned_on(
                twin("hand", self.vehicle, ()), self.vehicle, shipped_learned(), self._units(last),
                steps=self.size.base, cap=last, seed=self.seed, usage=(CAPS[0], last),
            )  # fmt: skip
            write_atomically(file, made.text(), continued=True)
        return read_learned(file.read_bytes(), self.folder)

    def _units(self, cap: float) -> World:
        """The world that the vehicle's own driver sees."""
        return world_of(self.nominal, self.vehicle, 1, cap)

    def _arm(self, name: str, base: Learned, held: Mapping[str, Recording], say: Say) -> dict[str, Any]:
        """Its cycles, its models' errors, and how it drives at the end; a sentence where it failed."""
        seconds = dict.fromkeys(("driving", "model", "learning"), 0.0)
        clock = time.process_time()

        def spent(on: str) -> None:
            nonlocal clock
            now = time.process_time()
            seconds[on], clock = seconds[on] + now - clock, now

        known: dict[str, Any] = {"arm": name, "cycles": []}
        learned, rows = base, list[Recording]()
        try:
            for k in range(0 if name == BASE else self.size.cycles):
                if name not in WITHOUT_ROWS:
                    drive = driven(self.scene, self._hands(learned, CAPS[k]), self.size.rows, self._seed(k))
                    rows = last_rows([*rows, *drive.recordings], self.size.rows)
                    spent("driving")
                    known["cycles"].append({"cap": CAPS[k], **judged(drive)})
                result = self._twin(name, rows, k)
                if result is None:
                    return {"arm": name, "failed": "no model has it"}
                spent("model")
                if k == 0:
                    known |= self._modelled(name, result, held)
                    clock = time.process_time()
                learned = self._learned(result, learned, CAPS[k + 1], k, say)
                spent("learning")
        except GreyboxError as error:
            return {"arm": name, "failed": str(error)}
        if name == BASE:
            known |= self._modelled(name, Twin(self.vehicle, self.nominal), held)
        known["cpu_seconds"] = seconds
        for when, cap in (("first", CAPS[0]), ("last", CAPS[self.size.cycles])):
            drive = driven(self.scene, self._hands(learned, cap), self.size.judged, self._seed(9))
            known[when] = {"cap": cap, **judged(drive)}
        return known

    def _hands(self, learned: Learned, cap: float) -> Hands:
        return Hands(self._units(cap), learned.policy.act)

    def _seed(self, k: int) -> int:
        return 1000 * self.seed + 100 * k

    def _twin(self, name: str, rows: Sequence[Recording], k: int) -> Twin | None:
        """What an arm makes of rows; None where there is nothing that it could be."""
        if name == ORACLE:
            return oracle(self.vehicle, self.scene.effects)
        if not rows and name not in WITHOUT_ROWS:
            raise BadInput("In every attempt, the vehicle crashed before there were enough rows to learn from.")
        return twin(name, self.vehicle, rows, self.seed + k)

    def _learned(self, result: Twin, start: Learned, cap: float, k: int, say: Say) -> Learned:
        """Go on in a twin, at all speeds up to those of the next cap."""
        return learned_on(
            result, self.vehicle, start, self._units(cap), steps=self.size.steps, cap=cap, seed=self.seed + k + 1,
            usage=(CAPS[0], cap), say=say,
        )  # fmt: skip

    def _modelled(self, name: str, result: Twin, held: Mapping[str, Recording]) -> dict[str, Any]:
        """What an arm's first model is, and how far it errs on laps that nobody learned from."""
        errors = {share: _plainly(errors_ahead(result.model, [item])) for share, item in held.items()}
        known: dict[str, Any] = {"errors": errors, "named": [dict(item) for item in result.named]}
        known |= {"applied": dict(result.applied), "unknown_probability": result.unknown_probability}
        return known | ({"curve": {str(self.size.rows): errors} | self._curve(name, held)} if name in CURVE else {})

    def _curve(self, name: str, held: Mapping[str, Recording]) -> dict[str, Any]:
        """Errors of models of other numbers of rows, driven by the driver before any data."""
        base, result = self._base(), {}
        for rows in CURVE[name]:
            if rows <= self.size.curve and rows != self.size.rows:
                drive = driven(self.scene, self._hands(base, CAPS[0]), rows, self._seed(0))
                made = twin(name, self.vehicle, drive.recordings, self.seed)
                result[str(rows)] = {share: _plainly(errors_ahead(made.model, [item])) for share, item in held.items()}
        return result


def judged(drive: DrivenRows) -> dict[str, Any]:
    """How a vehicle was driven, as plain data."""
    off = np.concatenate([np.abs(episode.e_y[episode.time >= SETTLED]) for episode in drive.episodes])
    steps = [np.diff(recording["steer"]) / recording.sample_time for recording in drive.recordings]
    rates = np.concatenate(steps) if steps else np.array([np.nan])
    return {
        "rows": drive.rows,
        "path_error_rms": drive.path_error,
        "path_error_p95": float(np.quantile(off, 0.95)) if len(off) else float("nan"),
        "lap_time": drive.lap_time,
        "laps": sum(len(episode.laps) for episode in drive.episodes),
        "crashes": drive.crashes,
        "steering_rate_rms": float(np.sqrt(np.mean(rates**2))),
    }


def _plainly(errors: Mapping[float, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    return {f"{horizon:g}": dict(errors[horizon]) for horizon in HORIZONS}


RATE = 50.0
"""Commands a second, as drivers give them."""
SECONDS = 40.0
"""Of a held-out drive."""
LOOK = 0.22
"""s ahead to which this driver steers."""


def held_out(scene: Scene, share: float, seconds: float = SECONDS) -> Recording:
    """A drive at a share of the grip that the vehicle really has, read without noise: what is compared is models.

    Raises
    ------
    GreyboxError : the driver left the track.
    """
    size, p = scene.stated.size, scene.stated.parameters
    path = _track(scene, share)
    rows, per_acceleration = round(seconds * RATE), p["m"] / p["force_per_unit"]
    v_x = float(path.speed[0])
    ride = SteppedCar(scene.car, v_x, seconds + 1.0, RATE, scene.effects, scene.forms, scene.seed)
    commands, s = np.zeros((rows, 2)), 0.0
    for k in range(rows):
        now = ride.motion
        s, e_y, _ = path.project(now["x"], now["y"], now["yaw"], s)
        if abs(e_y) > 4.0 * path.half_width:
            raise GreyboxError(f"the driver left the track for good after {k / RATE:.0f} s at {share:.0%} of the grip")
        steer = _pursued(path, s, now, size.length)
        target = path.line("speed", np.array([s + 0.1 * now["v_x"]]))[0][0]
        a_x = np.clip((target - now["v_x"]) / (0.3 * size.time), -size.brake, size.drive)
        commands[k] = np.clip(steer, -scene.stated.steer_max, scene.stated.steer_max), a_x * per_acceleration
        ride.step(*commands[k])
    channels = {"steer": commands[:, 0], scene.stated.drive_channel: commands[:, 1]}
    plan = Recording(f"{share:.0%} of the grip", np.arange(rows) / RATE, channels)
    return replay(scene.car, plan, {"v_x": v_x}, scene.effects, scene.forms, scene.seed, noise=0.0)[0]


def _track(scene: Scene, share: float) -> RaceTrack:
    """The track, with speeds that use a share of what the vehicle really has."""
    size = scene.stated.size
    grip = share * scene.effects.get("grip_scale", 1.0)
    pulls = grip / scene.effects.get(
        "mass_change", 1.0
    )  # a payload presses on the tyres too, but no motor pulls harder
    use = Usage(grip * size.grip, pulls * size.drive, pulls * size.brake, size.top_speed)
    return track(NARROWEST * size.length, HALF_WIDTH * size.length, use)


def _pursued(path: RaceTrack, s: float, now: Mapping[str, float], wheelbase: float) -> float:
    """Steering, rad, of pure pursuit (Coulter 1992): along the circle to a point ahead on the path."""
    ahead = np.array([s + max(LOOK * now["v_x"], wheelbase)])
    x, y = (np.interp(ahead % path.length, path.s, item, period=path.length)[0] for item in (path.x, path.y))
    c, d = np.cos(now["yaw"]), np.sin(now["yaw"])
    along, across = c * (x - now["x"]) + d * (y - now["y"]), c * (y - now["y"]) - d * (x - now["x"])
    return float(np.arctan(2.0 * wheelbase * across / (along**2 + across**2)))
