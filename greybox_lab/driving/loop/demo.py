"""The loop on one machine: a vehicle in simulation that has what its file does not state, named and driven better.

DIR/demo.json          what is asked for, cycles that are done, arms; what it is carried on from
DIR/vehicle.toml       as stated
DIR/policy.json        in force
DIR/cycle_1/rows.csv   what was driven, as every command reads it
DIR/cycle_1/closed.toml, policy.json
DIR/log.jsonl          every event
DIR/index.html
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from greybox_id.base.errors import BadInput, must_be_one_of, must_be_whole
from greybox_id.base.files import held, write_atomically
from greybox_id.base.shorthands import Array, Say
from greybox_id.base.version import __version__
from greybox_id.datasets.recording import Recording, join
from greybox_id.models.motion_model import MotionModel
from greybox_id.models.registry import motion_model_of
from greybox_id.models.vehicle import Vehicle, write_vehicle
from greybox_id.reports.html import page
from greybox_id.reports.text.document import on_screen
from greybox_id.reports.text.screen import as_text

from ...exam.make import write_recording
from ..learned.injection import InjectedModel
from ..racing.draws import Draws, by_hand
from ..racing.learner import Learned
from ..racing.policy import Policy
from ..racing.world import Observations, World
from .adapting import (
    adapted,
    foretold,
    last_rows,
    learned_on,
    used_to,
    world_of,
)
from .arms import Twin, oracle, twin
from .demo_report import demo_report
from .protocol import ARMS, digest_of
from .safety import LATE, Cap, Envelope, Log, limits_of
from .scene import DrivenRows, Hands, Scene, driven
from .state import LoopOutcome, begun, keep
from .swap import Seat, must_drive_as_well, read_learned

CAP = 0.6
"""Share of the grip at which data are driven first: the moderate speed that was published."""


@dataclass(frozen=True)
class DemoSize:
    """How much is driven and learned.

    Attributes
    ----------
    base : steps in which a driver is got used to the vehicle as its file states it.
    rows, diagnosed : driven in a cycle, and the last of them, which are diagnosed.
    steps : in which it is learned anew in a cycle.
    judged : rows that an arm is judged by.
    """

    base: int
    rows: int
    diagnosed: int
    steps: int
    judged: int


QUICK, FULL = DemoSize(150_000, 4_500, 1_500, 150_000, 3_000), DemoSize(1_000_000, 5_000, 5_000, 300_000, 14_000)


def demo(
    out: str | Path, *, quick: bool = False, case: int = 0, arm: str = "named", seed: int = 0, cycles: int = 3,
    say: Say = lambda sentence: None,
) -> LoopOutcome:  # fmt: skip
    """Drive, name, learn anew and swap, some cycles long, and say what came of it.

    Parameters
    ----------
    out : folder; one in which the same was begun is carried on with.
    quick : fewer rows and steps.
    case : what the vehicle has that its file does not state: a number from 0 to 7, see `scene.CASES`.
    arm : what is made of rows, one of `protocol.ARMS`.
    seed : of everything that is drawn.
    cycles : how many.
    say : told what is going on.

    Raises
    ------
    BadInput : the folder holds something else, or there is no such case.
    """
    must_be_whole(cycles, "cycles", 1, 20)
    must_be_one_of(ARMS, arm, "There is no arm")
    return _Running(Path(out), Scene(case), QUICK if quick else FULL, quick, arm, seed, cycles, say).run()


class Underway(ABC):
    """Driving and learning under way in a folder: what is kept there, and who drives that knows the file alone.

    Parameters
    ----------
    file : of the state.
    kind, asked, fresh : see `state.begun`; the version is asked for too.
    scene : whose vehicle.
    say : told what is going on.
    """

    def __init__(
        self, file: Path, kind: str, requested: Mapping[str, Any], fresh: Mapping[str, Any], scene: Scene, say: Say
    ) -> None:
        self._file, self.folder, self.scene, self.say = file, file.parent, scene, say
        self.vehicle = scene.vehicle
        self.nominal = motion_model_of(self.vehicle)
        self.state = begun(file, kind, {**requested, "version": __version__}, fresh)
        self.log = Log(self.folder / "log.jsonl")
        write_atomically(self.folder / "vehicle.toml", scene.text, continued=True)

    def run(self) -> LoopOutcome:
        """All that is not done yet."""
        with held(self.folder):
            return self._run()

    @abstractmethod
    def _run(self) -> LoopOutcome:
        """The same, where nobody else is at work."""

    def body(self, **more: Any) -> dict[str, Any]:
        """What came of it, as plain data."""
        effects = dict(self.scene.effects)
        return {"scene": self.state["asked"], "withheld": effects, **more, "folder": str(self.folder)}

    def keep(self) -> None:
        """Write down how far it is."""
        keep(self._file, self.state)

    def units(self, cap: float) -> World:
        """The world that the vehicle's own driver sees."""
        return world_of(self.nominal, self.vehicle, 1, cap)

    def base(self, steps: int) -> Learned:
        """The shipped driver, used to this vehicle as its file states it."""
        file = self.folder / "base.json"
        if not file.is_file():
            self.say("learning to drive the vehicle as its file states it")
            made = used_to(self.nominal, self.vehicle, steps, CAP, self.state["asked"]["seed"])
            write_atomically(file, made.text(), continued=True)
        return read_learned(file.read_bytes(), self.folder)

    def count(self, rows: DrivenRows, cap: Cap, **where: int) -> None:
        """Let laps and crashes of a drive move the cap."""
        for episode in rows.episodes:
            cap.clean += len(episode.laps)
            if episode.crashed:
                self.log.write("crash", **where, s=float(episode.s[-1]))
                cap.event()


class _Running(Underway):
    """A demo under way; parameters as of `demo`."""

    def __init__(
        self, folder: Path, scene: Scene, size: DemoSize, quick: bool, arm: str, seed: int, cycles: int, say: Say
    ) -> None:
        self.size, self.seed, self.cycles, self.arm = size, seed, cycles, arm
        requested = {"case": scene.case, "arm": arm, "seed": seed, "quick": quick, "cycles": cycles}
        super().__init__(folder / "demo.json", "demo", requested, {"cycles": [], "arms": {}, "cap": CAP}, scene, say)

    def _run(self) -> LoopOutcome:
        base = self.base(self.size.base)
        while len(self.state["cycles"]) < self.cycles:
            self._cycle(base)
        for name, made in self._arms(base).items():
            if name not in self.state["arms"]:
                self.state["arms"][name] = self._judged(name, made)
                self.keep()
        arms = {name: item for name, item in self.state["arms"].items() if item is not None}
        value = self.body(cycles=self.state["cycles"], arms=arms)
        report = demo_report(value)
        write_atomically(self.folder / "index.html", page(report), continued=True)
        cycles = [{name: item for name, item in one.items() if name != "trace"} for one in value["cycles"]]
        lines = as_text(on_screen(report)), "", f"written  {value['folder']}/index.html"
        return LoopOutcome({**value, "cycles": cycles}, lines)

    def _cycle(self, base: Learned) -> None:
        """DrivenRows rows, name, learn, probe and swap."""
        began, k = time.monotonic(), len(self.state["cycles"]) + 1
        folder, cap = self.folder / f"cycle_{k}", Cap(self.state["cap"])
        folder.mkdir(exist_ok=True)
        present = base if k == 1 else read_learned((self.folder / "policy.json").read_bytes(), self.folder)
        driven_at = cap.share
        units = self.units(driven_at)
        before = self.state["foretold"] if k > 1 else self._foretold(self.nominal, present, driven_at, by_hand())
        self.say(f"cycle {k}: driving {self.size.rows} rows at {driven_at:.0%} of the grip")
        seat = Seat(present.text().encode(), self.folder)
        hands = Watched(units, seat, base.policy, cap, self.units, before["worst"], self.log)
        drive = driven(self.scene, hands, self.size.rows, self._seed(k))
        self.count(drive, cap, cycle=k)
        recordings = last_rows(drive.recordings, self.size.diagnosed)
        if not recordings:
            raise BadInput(
                "In every attempt, the vehicle crashed before there were enough rows for a diagnosis; try "
                "another ‹seed›."
            )
        write_recording(joined(recordings), folder / "rows.csv")
        self.say(f"cycle {k}: identifying a model from the rows, and learning on it")
        learned, model, seconds = adapted(
            self.vehicle, recordings, present, units, self.arm, steps=self.size.steps, cap=driven_at,
            seed=self.seed + k,
        )  # fmt: skip
        write_vehicle(model.vehicle, folder / "closed.toml")
        if isinstance(model.model, InjectedModel):
            write_atomically(folder / "net.json", model.model.net.text(), continued=True)
        body = learned.text().encode()
        write_atomically(folder / "policy.json", body.decode(), continued=True)
        reason = seat.refusal(body, digest_of(body), twin_of(model, self.vehicle, units, driven_at))
        self.log.write("swap" if not reason else "no swap", cycle=k, sha256=digest_of(body), reason=reason)
        now = present if reason else learned
        if reason and k == 1:
            write_atomically(self.folder / "policy.json", present.text(), continued=True)
        if not reason:
            cap.next_cycle()
        self.state["cap"] = cap.share
        twin = self._foretold(model.model, now, cap.share)
        self.state["foretold"] = twin
        self.state["cycles"].append(
            {
                "rows": drive.rows,
                "cap": driven_at,
                "detected": model.detected,
                "named": [dict(cause) for cause in model.named],
                "applied": dict(model.applied),
                "path_error_rms": drive.path_error,
                "path_error_foretold": before["path_error_rms"],
                "lap_time": drive.lap_time,
                "crashes": drive.crashes,
                "events": hands.events,
                "swapped": not reason,
                "reason": reason,
                "seconds": time.monotonic() - began,
                "cpu_seconds": seconds,
                "next": {"cap": cap.share, **twin},
                "trace": trace(drive),
            }
        )
        self.keep()
        seat.close()

    def _foretold(self, model: MotionModel, learned: Learned, cap: float, draws: Draws | None = None) -> dict[str, Any]:
        """How the twin is driven, as plain data; before a vehicle is known, `draws` are what it may be."""
        result = foretold(model, self.vehicle, learned.policy.act, self.units(cap), cap, draws)
        return {"path_error_rms": result.path_error, "worst": result.worst, "lap_time": result.lap_time,
                "crashes": result.crashes}  # fmt: skip

    def _seed(self, k: int) -> int:
        return 1000 * self.seed + 100 * k

    def _arms(self, base: Learned) -> Mapping[str, Callable[[], Learned]]:
        """Who is compared; all but the base learn as many steps as the loop took."""
        steps, cap = self.cycles * self.size.steps, self.state["cap"]

        def on(twin: Twin | None) -> Learned:
            if twin is None:
                raise BadInput("no model has it")
            return learned_on(twin, self.vehicle, base, self.units(cap), steps=steps, cap=cap, seed=self.seed + 1)

        return {
            "base": lambda: base,
            "nominal": lambda: on(twin("nominal", self.vehicle, ())),
            self.arm: lambda: read_learned((self.folder / "policy.json").read_bytes(), self.folder),
            "oracle": lambda: on(oracle(self.vehicle, self.scene.effects)),
        }

    def _judged(self, name: str, made: Callable[[], Learned]) -> dict[str, Any] | None:
        """How an arm drives the vehicle, at the first cap and at the last one; None for one that there is not."""
        self.say(f"judging the arm {name}")
        try:
            policy = made().policy
        except BadInput:
            return None
        result = {}
        for when, cap in (("first", CAP), ("last", self.state["cap"])):
            drive = driven(self.scene, Hands(self.units(cap), policy.act), self.size.judged, self._seed(90))
            result[when] = {"cap": cap, "path_error_rms": drive.path_error, "lap_time": drive.lap_time,
                           "crashes": drive.crashes,
                           "laps": sum(len(episode.laps) for episode in drive.episodes)}  # fmt: skip
        return result


class Watched(Hands):
    """A seat, with limits, a watchdog and an envelope.

    A command that takes a policy more than `LATE` periods does not come: the vehicle brakes, and steers as before. Once
    the envelope is left, the last good policy drives under a lower cap.

    Parameters
    ----------
    world, seat : what drives first.
    good : the last good policy.
    cap : that falls.
    units : cap -> the world that a driver sees under it.
    worst : m, of the path error that is foretold, see `adapting.Foretold`.
    log : of events.
    """

    def __init__(
        self, world: World, seat: Seat, good: Policy, cap: Cap, units: Callable[[float], World], worst: float, log: Log
    ) -> None:
        super().__init__(world, seat.act)
        period = world.rules.period
        self._good, self._cap, self._units, self._log = good, cap, units, log
        self._limits = limits_of(world.steer_max, *world.drives, period)
        self._envelope = Envelope(world.track.half_width, worst, period)
        self._late, self._brake = False, world.drives[0]
        self.events = 0

    def acted(self, seen: Observations) -> Array:
        """Actions; the watchdog looks at how long they take."""
        begun = time.thread_time()
        done = self.act(seen)
        took = time.thread_time() - begun
        self._late = took > LATE * self.world.rules.period
        if self._late:
            self._log.write("watchdog", seconds=took)
        return done

    def limited(self, command: Array) -> Array:
        """Limited in size and rate; braking where a command came too late."""
        return self._limits(np.array([self._limits.last[0], -self._brake]) if self._late else command)

    def watch(self, row: Mapping[str, float]) -> None:
        """Look whether the envelope is left."""
        if row["time"] == 0.0:
            self._envelope.begin()
        reason = self._envelope.left(row["e_y"])
        if not reason:
            return
        self.events += 1
        self._cap.event()
        self._log.write("envelope", reason=reason, s=row["s"], cap=self._cap.share)
        self.world = self._units(self._cap.share)
        self.act = self._good.act
        self._envelope.begin(float("inf"))  # what the other policy does was not foretold


def twin_of(twin: Twin, vehicle: Vehicle, units: World, cap: float) -> Callable[[Policy, Policy], None]:
    """What refuses a policy that crashes in the twin, or follows the path worse than `WORSE` times the present one."""

    def tried(new: Policy, present: Policy) -> None:
        after = foretold(twin.model, vehicle, new.act, units, cap)
        before = None if after.crashes else foretold(twin.model, vehicle, present.act, units, cap)
        must_drive_as_well(
            after.crashes, after.path_error, None if before is None or before.crashes else before.path_error
        )

    return tried


TRACED = 600
"""Points of a figure's line, about."""


def joined(recordings: Sequence[Recording]) -> Recording:
    """Recordings one after the other, a run each."""
    shifted, at = [], 0.0
    for recording in recordings:
        shifted.append(replace(recording, time=recording.time - recording.time[0] + at))
        at = float(shifted[-1].time[-1]) + 1.0
    return join(shifted, "rows")


def trace(drive: DrivenRows) -> dict[str, list[float]]:
    """Lateral error over the distance along the track, of the last episode, thinned out for a figure."""
    episode = drive.episodes[-1]
    every = max(len(episode.s) // TRACED, 1)
    return {"s": np.round(episode.s[::every], 2).tolist(), "e_y": np.round(episode.e_y[::every], 4).tolist()}
