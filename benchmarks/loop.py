"""A black box or a name: which model of a changed vehicle foretells it, where it was driven and beyond?

    python benchmarks/loop.py [--cases 8] [--first 0] [--seed 0] [--rows 5000] [--arms named ...] [--out loop.jsonl]
    python benchmarks/loop.py --report loop.jsonl [--json]

The vehicle is the virtual one, which shares no code with the models; it has effects that its file does not state. A
driver follows a path at 60 % of the grip, with sensor noise, and every arm makes a model of that recording. They are
compared on laps that nobody trained on, at 60 % and at 90 % of the grip, read without noise: what is compared is the
models. No real car drives here, and the virtual vehicle's author is that of the models.

base          the vehicle file
actuator_net  it, with a network of three steps as published (`learned`, variant paper)
abstract      it, with a network of fifteen steps that says yaw rate and v_y
residual      it, with five networks of what it is off by, the less the further they part
refit         its parameters, fitted
named         it, closed by `greybox gap`
named_residual  the closed one, with five networks of what that is off by where something unnamed is likelier than not
oracle        it, with the true effects; where they lie outside the vocabulary, it as it is

What is done is kept in --out, a line for each case, and is not run again.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest
from threadpoolctl import threadpool_limits

import greybox_id as gb
from greybox_id.datasets.vehicle_file import vehicle
from greybox_id.datasets.virtual_vehicle import (
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
from greybox_id.errors import GreyboxError
from greybox_id.files import write_atomically
from greybox_id.learned.injection import injected
from greybox_id.learned.open_loop import HORIZONS, errors_ahead
from greybox_id.learned.training import train_actuator_net
from greybox_id.models.registry import model_of, with_effects
from greybox_id.motion_model import MotionModel
from greybox_id.racing.track import RaceTrack, Usage, track
from greybox_id.recording import Recording

Row = NDArray[np.float64]

PAIRS: tuple[Mapping[str, int], ...] = (
    {"steering_delay": 1, "front_stiffness": -1},
    {"steering_lag": 1, "grip_scale": -1},
    {"mass_change": 1, "steering_ratio": -1},
    {"motor_lag": 1, "motor_gain": -1},
    {"yaw_inertia": 1, "tyre_relaxation": 1},
    {"steering_backlash": 1, "rear_stiffness": -1},
    {"torque_vectoring": 1},
    {"variable_ratio": 1},
)
"""What is the matter, and on which side of its null; the last two lie outside the vocabulary of `greybox gap`."""
RATE = 50.0
NARROWEST, HALF_WIDTH = 4.0, 3.0
"""Radius of the narrowest bend, and half width of the track, over the wheelbase."""
USED, BEYOND = 0.6, 0.9
"""Shares of the grip that the speed on the track asks for."""
HELD_OUT = 40.0
"""s of each held-out drive."""
LOOK = (0.30, 0.22)
"""s ahead to which a driver steers, in training and on held-out drives: another driver."""
MEMBERS = 5


@dataclass(frozen=True)
class Case:
    """A vehicle, and what is the matter with it.

    Attributes
    ----------
    seed, number : draw and choose everything.
    """

    seed: int
    number: int

    @property
    def pair(self) -> Mapping[str, int]:
        """One of `PAIRS`."""
        return PAIRS[self.number % len(PAIRS)]

    @property
    def forms(self) -> str:
        """Whether tyres and the like have the forms of the models, "nominal", or others, drawn."""
        return ("nominal", "other")[(self.number + self.number // len(PAIRS)) % 2]

    @cached_property
    def stated(self) -> VirtualCar:
        """As its file states it; v_y is read as well as the speed is."""
        drawn = random_vehicle(1000 * self.seed + self.number, "racer")
        return replace(drawn, noise={**drawn.noise, "v_y": drawn.noise["v_x"]})

    @cached_property
    def car(self) -> VirtualCar:
        """As it is."""
        rng = np.random.default_rng((self.seed, self.number))
        return self.stated if self.forms == "nominal" else toleranced(self.stated, rng)

    @cached_property
    def effects(self) -> dict[str, float]:
        """The largest magnitudes that the virtual vehicle holds for plausible."""
        entries, size, kind = {**EFFECTS, **OUTSIDE}, self.stated.size, self.stated.kind
        return {name: entries[name].at(side * entries[name].sizes(size, kind)[1]) for name, side in self.pair.items()}

    def track(self, share: float) -> RaceTrack:
        """The track, with speeds that use a share of what the vehicle really has."""
        size, wheelbase = self.stated.size, self.stated.size.length
        weaker = self.effects.get("grip_scale", 1.0) / self.effects.get("mass_change", 1.0)
        limits = (share * weaker * own for own in (size.grip, size.drive, size.brake))
        return track(NARROWEST * wheelbase, HALF_WIDTH * wheelbase, Usage(*limits, size.top_speed))

    def driven(self, share: float, seconds: float, look: float, noise: float) -> Recording:
        """A drive along the track, as its sensors read it."""
        path, size, p = self.track(share), self.stated.size, self.stated.parameters
        rows, per_acceleration = round(seconds * RATE), p["m"] / p["force_per_unit"]
        ride = SteppedCar(self.car, float(path.speed[0]), seconds + 1.0, RATE, self.effects, self.forms, self.seed)
        commands, s = np.zeros((rows, 2)), 0.0
        for k in range(rows):
            now = ride.motion
            s, e_y, _ = path.project(now["x"], now["y"], now["yaw"], s)
            if abs(e_y) > 4.0 * path.half_width:
                raise GreyboxError(f"the driver left the track after {k / RATE:.0f} s at {share:.0%} of the grip")
            steer = pursued(path, s, now, size.length, look)
            wanted = path.line("speed", np.array([s + 0.1 * now["v_x"]]))[0][0]
            a_x = np.clip((wanted - now["v_x"]) / (0.3 * size.time), -size.brake, size.drive)
            commands[k] = np.clip(steer, -self.stated.steer_max, self.stated.steer_max), a_x * per_acceleration
            ride.step(*commands[k])
        channels = {"steer": commands[:, 0], self.stated.drive_channel: commands[:, 1]}
        plan = Recording(f"{share:.0%} of the grip", np.arange(rows) / RATE, channels)
        start = {"v_x": float(path.speed[0])}
        return replay(self.car, plan, start, self.effects, self.forms, self.seed, noise=noise)[0]


def pursued(path: RaceTrack, s: float, now: Mapping[str, float], wheelbase: float, look: float) -> float:
    """Steering, rad, of pure pursuit (Coulter 1992): along the circle to a point ahead on the path."""
    ahead = np.array([s + max(look * now["v_x"], wheelbase)])
    x, y = (np.interp(ahead % path.length, path.s, own, period=path.length)[0] for own in (path.x, path.y))
    c, d = np.cos(now["yaw"]), np.sin(now["yaw"])
    along, across = c * (x - now["x"]) + d * (y - now["y"]), c * (y - now["y"]) - d * (x - now["x"])
    return float(np.arctan(2.0 * wheelbase * across / (along**2 + across**2)))


class Arms:
    """Models made of one recording, each when it is asked for.

    Parameters
    ----------
    case : whose vehicle file is known.
    recording : to learn from.
    folder : where that file is written.
    """

    def __init__(self, case: Case, recording: Recording, folder: Path) -> None:
        self.case, self.recording = case, recording
        file = folder / "car.toml"
        stated = None if case.forms == "nominal" else tolerances(case.stated)
        file.write_text(vehicle_file_text(case.stated, stated), encoding="utf-8")
        self.vehicle = vehicle(str(file))
        self.nominal = _of_motion(model_of(self.vehicle))
        self.told: dict[str, Any] = {}

    def base(self) -> MotionModel:
        """The vehicle file's."""
        return self.nominal

    def actuator_net(self) -> MotionModel:
        """With three steps."""
        return injected(self.nominal, train_actuator_net(self.recording, variant="paper", seed=self.case.seed))

    def abstract(self) -> MotionModel:
        """With fifteen steps."""
        return injected(self.nominal, train_actuator_net(self.recording, variant="abstract", seed=self.case.seed))

    def residual(self) -> MotionModel:
        """With what the vehicle file's is off by."""
        return self._corrected(self.nominal)

    def refit(self) -> MotionModel:
        """With parameters fitted."""
        return _of_motion(gb.fit("single_track", self.recording, vehicle=self.vehicle).model)

    @cached_property
    def closed(self) -> MotionModel:
        """By `greybox gap`."""
        gap = gb.diagnose(self.vehicle, self.recording, seed=self.case.seed)
        self.told = {"applied": list(gap.applied), "unknown_probability": gap.unknown_probability}
        return _of_motion(gap.closed_model)

    def named(self) -> MotionModel:
        """Closed."""
        return self.closed

    def named_residual(self) -> MotionModel:
        """Closed, with what that is off by where something unnamed is likelier than not."""
        closed = self.closed
        return self._corrected(closed) if self.told["unknown_probability"] > 0.5 else closed

    def oracle(self) -> MotionModel:
        """With the truth, where it has a name."""
        known = {name: value for name, value in self.case.effects.items() if name in EFFECTS}
        return _of_motion(with_effects(self.nominal, known))

    def _corrected(self, model: MotionModel) -> MotionModel:
        options: dict[str, Any] = {"variant": "residual", "model": model, "members": MEMBERS, "seed": self.case.seed}
        return injected(model, train_actuator_net(self.recording, **options))


ARMS = ("base", "actuator_net", "abstract", "residual", "refit", "named", "named_residual", "oracle")


def run(case: Case, rows: int, arms: list[str], say: Callable[[str], None]) -> dict[str, Any]:
    """All arms on one case, as plain data."""
    found: dict[str, Any] = {
        "seed": case.seed, "case": case.number, "rows": rows, "vehicle": case.stated.name, "forms": case.forms,
        "effects": case.effects, "outside": [name for name in case.effects if name not in EFFECTS], "arms": {},
    }  # fmt: skip
    say("driving")
    train = case.driven(USED, rows / RATE, LOOK[0], 1.0)
    held = {f"{share:.0%}": case.driven(share, HELD_OUT, LOOK[1], 0.0) for share in (USED, BEYOND)}
    found["sd"] = {share: {name: float(np.std(own[name])) for name in ("v_x", "v_y", "yaw_rate")}
                   for share, own in held.items()}  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        made = Arms(case, train, Path(folder))
        for name in arms:
            say(name)
            clock = time.process_time()
            try:
                model = getattr(made, name)()
                seconds = time.process_time() - clock
                if name == "named_residual":  # the diagnosis, where it was made just before
                    seconds += found["arms"].get("named", {}).get("cpu_seconds", 0.0)
                errors = {share: errors_ahead(model, [own]) for share, own in held.items()}
            except GreyboxError as error:
                found["arms"][name] = {"failed": str(error)}
                continue
            found["arms"][name] = {"cpu_seconds": seconds, "errors": errors}
            if name.startswith("named"):
                found["arms"][name] |= made.told
    return found


def joined(file: Path) -> list[dict[str, Any]]:
    """The cases of a file, arms that were run at different times together."""
    found: dict[tuple[int, int, int], dict[str, Any]] = {}
    for text in file.read_text("utf-8").splitlines() if file.exists() else []:
        line = json.loads(text)
        key = (line["seed"], line["case"], line["rows"])
        if key in found:
            found[key]["arms"] |= line["arms"]
        else:
            found[key] = line
    return list(found.values())


def report(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """Medians over cases, and the bar."""
    table: dict[str, Any] = {}
    for rows in sorted({line["rows"] for line in lines}):
        own = [line for line in lines if line["rows"] == rows]
        arms: dict[str, Any] = {}
        for name in ARMS:
            done = [line["arms"][name] for line in own if "errors" in line["arms"].get(name, {})]
            if done:
                arms[name] = {
                    "n": len(done),
                    "cpu_seconds": float(np.median([one["cpu_seconds"] for one in done])),
                    "yaw_rate_rms": {
                        share: {str(h): float(np.median([_error(one, share, h) for one in done])) for h in HORIZONS}
                        for share in (f"{USED:.0%}", f"{BEYOND:.0%}")
                    },
                }
        table[str(rows)] = {"cases": len(own), "arms": arms, **_compared(own)}
    return table


def _compared(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """How named does against the network at 0.5 s beyond where both were trained, case by case."""
    both = [
        (line["arms"]["named"], line["arms"]["actuator_net"], bool(line["outside"]))
        for line in lines
        if all("errors" in line["arms"].get(name, {}) for name in ("named", "actuator_net"))
    ]
    if not both:
        return {}
    told: dict[str, Any] = {}
    for what, chosen in (("all", both), ("within_vocabulary", [one for one in both if not one[2]])):
        ratios = [_error(a, f"{BEYOND:.0%}", 0.5) / _error(b, f"{BEYOND:.0%}", 0.5) for a, b, _ in chosen]
        if ratios:
            better = sum(ratio < 1.0 for ratio in ratios)
            told[what] = {
                "n": len(ratios), "median_ratio": float(np.median(ratios)), "ratios": ratios,
                "half_or_less": sum(ratio <= 0.5 for ratio in ratios), "better": better,
                "sign_test_p": float(binomtest(better, len(ratios), alternative="greater").pvalue),
            }  # fmt: skip
    return {"named_over_actuator_net_0.5s_90%": told}


def _error(arm: Mapping[str, Any], share: str, horizon: float) -> float:
    return float(arm["errors"][share][str(horizon)]["yaw_rate"])


def _of_motion(model: object) -> MotionModel:
    assert isinstance(model, MotionModel)
    return model


def show(table: dict[str, Any]) -> None:
    """Print a report."""
    for rows, own in table.items():
        print(f"\n{rows} rows ({int(rows) / RATE:.0f} s), {own['cases']} cases: median yaw rate error, rad/s")
        print(f"{'arm':16} {'n':>3} {'CPU s':>7}  60 %: 0.1 s   0.5 s     2 s   90 %: 0.1 s   0.5 s     2 s")
        for name, arm in own["arms"].items():
            numbers = [arm["yaw_rate_rms"][share][str(h)] for share in ("60%", "90%") for h in HORIZONS]
            cells = [f"{number:.4f}" for number in numbers]
            print(f"{name:16} {arm['n']:3d} {arm['cpu_seconds']:7.1f} {cells[0]:>12} {cells[1]:>7} {cells[2]:>7}"
                  f" {cells[3]:>13} {cells[4]:>7} {cells[5]:>7}")  # fmt: skip
        for what, told in own.get("named_over_actuator_net_0.5s_90%", {}).items():
            words = what.replace("_", " ")
            print(f"named over actuator_net at 0.5 s and 90 %, {words}: median {told['median_ratio']:.2f} (bar 0.5),")
            print(f"  at most 0.5 in {told['half_or_less']} of {told['n']}, below 1 in {told['better']}"
                  f" (sign test p = {told['sign_test_p']:.2g})")  # fmt: skip


def main() -> None:
    """Run the cases that are not done yet, and report all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=len(PAIRS))
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rows", type=int, nargs="+", default=[5000], help="to learn from, at 50 Hz")
    parser.add_argument("--arms", nargs="+", default=list(ARMS), choices=ARMS)
    parser.add_argument("--out", type=Path, default=Path("loop.jsonl"))
    parser.add_argument("--report", type=Path, help="report a file, run nothing")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    out = given.report or given.out
    if given.report and not out.is_file():
        parser.error(f"{out} is not there; run cases first.")
    lines = joined(out)
    if not given.report:
        done = {
            (line["seed"], line["case"], line["rows"], name)
            for line in lines
            for name, arm in line["arms"].items()
            if "errors" in arm
        }
        wanted = [
            (k, rows, [name for name in given.arms if (given.seed, k, rows, name) not in done])
            for k in range(given.first, given.first + given.cases)
            for rows in given.rows
        ]
        asked = [own for own in wanted if own[2]]
        for number, (k, rows, arms) in enumerate(asked, 1):

            def say(what: str, at: str = f"{number}/{len(asked)} case {k}, {rows} rows") -> None:
                print(f"\r{at}: {what:20}", end="", file=sys.stderr, flush=True)

            try:
                line = json.dumps(run(Case(given.seed, k), rows, arms, say))
            except GreyboxError as error:
                print(f"\rcase {k}, {rows} rows: {error}", file=sys.stderr)
                continue
            before = out.read_text("utf-8") if out.exists() else ""
            write_atomically(out, before + line + "\n")
        print(file=sys.stderr)
    table = report(joined(out))
    if given.json:
        print(json.dumps(table, indent=1))
    else:
        show(table)


if __name__ == "__main__":
    with threadpool_limits(1):
        main()
