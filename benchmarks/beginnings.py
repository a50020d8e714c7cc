"""Effects that begin within a drive, or end: does `gb.diagnose` say which, from when on and how much?

    python benchmarks/beginnings.py --seed 1 --each 2 [--family tmeasy --family rational] [--out FILE] [--json]

Cases are those of the foreign tier (an independent double track with tolerances, `greybox exam make --tier foreign`),
whose vehicle changes at an instant between a quarter and three quarters of the drive: grip, stiffness, mass, drag,
resistance of rolling, the drive's gain, or a sensor's bias. Even cases begin, odd ones end there. Magnitudes are
drawn as the examination draws them; where one would not show in a whole drive, another is drawn.

right: the effect is named first, or cannot be told from what is, its instant within 5 % of the drive and its side told.
constant: it is named, as acting everywhere. wrong: another name is applied. silent: none is. Every case is a line of
FILE, and is not run again.
"""

from __future__ import annotations

import json
import resource
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from running import options

import greybox_id as gb
from greybox_id.api.given import vehicle as known_vehicle
from greybox_id.base.errors import BadInput
from greybox_id.base.machine_code import kept
from greybox_id.datasets.recording import Recording
from greybox_lab.exam.answers import exceeds
from greybox_lab.exam.foreign.case import DURATION, _ForeignCase, driven, recorded
from greybox_lab.exam.foreign.double_track import advance, at_start, record
from greybox_lab.exam.foreign.families import OF_SENSORS, together, withheld
from greybox_lab.exam.foreign.vehicles import Stepwise
from greybox_lab.exam.plan import Planned
from greybox_lab.virtual.virtual_vehicle import vehicle_file_text
from greybox_lab.virtual.virtual_vehicle.layout import Grid

EFFECTS = (
    *("grip_scale", "front_stiffness", "rear_stiffness", "mass_change", "aero_drag", "rolling_resistance"),
    *("motor_gain", "yaw_rate_bias", "accel_bias_x", "accel_bias_y"),
)
SHOWN = (
    *("family", "effect", "truth", "end", "at", "verdict", "first", "magnitude", "told", "probability", "applied"),
    *("closed", "cpu_seconds"),
)
NEAR = 0.05
"""Of the drive, within which an instant is right."""
DRAWS = 12


@cache
def _advance() -> Any:
    def run(car: Any, s: Any, commands: Any, row: int, steps: int, period: float, gusts: Any, out: Any) -> None:
        advance(car, s, commands, row, steps, period, gusts, out)

    return kept(run)


class _Changing(Stepwise):
    """A double track that becomes another one at a row."""

    def __init__(self, before: dict[str, float], after: dict[str, float], row: int) -> None:
        self.cars, self.row = (record(before), record(after)), row
        self.linear_hold = bool(before["linear_hold"])

    def begin(self, start: tuple[float, ...], steer: float, drive: float) -> None:
        self.s = at_start(*start, steer, drive, self.cars[0])
        self.state = self.s[:6]

    def advance(self, commands: Grid, row: int, steps: int, period: float, out: Any) -> None:
        _advance()(self.cars[int(row >= self.row)], self.s, commands, row, steps, period, np.zeros(1), out)
        self.state = self.s[:6]


class _Begins(_ForeignCase):
    """A case whose effect acts in part of the drive alone."""

    def change(self, ends: bool) -> tuple[Recording, float, float]:
        """The recording, when its effect begins or ends, s, and how long it is."""
        small, everything = self.true.small, together(self.true.small, self.effects)
        seconds, share = float(self.rng.uniform(*DURATION)), float(self.rng.uniform(0.25, 0.75))
        row, run_in = round(share * seconds * self.rate), int(np.ceil(3.0 * self.rate))
        first, then = (everything, small) if ends else (small, everything)
        numbers = [withheld(self.numbers, own, self.vehicle.about) for own in (first, then)]
        ride = driven(_Changing(*numbers, row + run_in), self.stated, seconds, self.rate, self.seed)
        one, other = (recorded(ride, self.stated, own, self.seed, self.planned.case) for own in (first, then))
        if any(name in OF_SENSORS for name in self.effects):
            early = np.arange(len(one)) < row
            one = one.with_signals(**{name: np.where(early, one[name], other[name]) for name in one.signals})
        hold = "linear" if self.ride.linear_hold else "zero"
        made = Recording(one.name, one.time, dict(one.signals), hold=hold)
        return made, float(one.time[row]), float(one.time[-1])


def made(family: str, effect: str, number: int, seed: int) -> tuple[_Begins, Recording, float, float]:
    """A case whose effect would exceed the noise if it acted everywhere."""
    planned = Planned(f"{family}_{effect}_{number}", "single", "foreign", (effect,), number, seed, family)
    for attempt in range(DRAWS):
        try:
            case = _Begins(planned, attempt)
            if exceeds(case.again.size(case.effects, {})) or attempt == DRAWS - 1:
                return case, *case.change(bool(number % 2))
        except BadInput:  # beyond all bounds
            continue
    raise SystemExit(f"None of {DRAWS} draws of {planned.case} can be driven.")


def examined(family: str, effect: str, number: int, seed: int) -> dict[str, Any]:
    """What is said of a case."""
    case, recording, at, length = made(family, effect, number, seed)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "vehicle.toml"
        file.write_text(vehicle_file_text(case.stated, case.tolerances))
        vehicle = known_vehicle(file)
    begun = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    gap = gb.diagnose(vehicle, recording)
    cpu = resource.getrusage(resource.RUSAGE_SELF).ru_utime - begun
    first = gap.ranking[0] if gap.ranking else None
    end = "until" if number % 2 else "since"
    told = None if first is None else getattr(first, end)
    alike = set() if first is None else {first.effect, *first.indistinguishable_from}
    named = effect in alike and gap.gap_detected
    right = named and told is not None and abs(told - at) <= NEAR * length
    others = [own for own in gap.applied if own != effect and not (named and own in alike)]
    verdict = "right" if right and not others else "wrong" if others else "constant" if named else "silent"
    return {
        "family": family, "effect": effect, "number": number, "seed": seed, "end": end, "at": at, "length": length,
        "truth": case.effects[effect], "verdict": verdict, "first": first and first.effect,
        "magnitude": first and first.magnitude, "interval": first and first.interval, "told": told,
        "probability": first and first.probability, "applied": gap.applied, "reason": first and first.reason,
        "closed": gap.gap.closed, "cpu_seconds": cpu,
    }  # fmt: skip


def main() -> None:
    asked = options(
        __doc__, seed=0, each={"type": int, "default": 2, "help": "cases of an effect, families in turn"},
        family={"action": "append"}, effect={"action": "append", "choices": EFFECTS},
        out={"type": Path, "default": Path("beginnings.jsonl")},
    )  # fmt: skip
    families = asked.family or ["tmeasy", "rational"]
    lines = asked.out.read_text().splitlines() if asked.out.exists() else []
    results = {(own["family"], own["effect"], own["number"], own["seed"]): own for own in map(json.loads, lines)}
    for k, effect in enumerate(asked.effect or EFFECTS):
        for number in range(asked.each):
            family = families[(k + number) % len(families)]
            key = (family, effect, number, asked.seed)
            if key not in results:
                results[key] = examined(family, effect, number, asked.seed * 1000 + 10 * k + number) | {
                    "seed": asked.seed
                }
                with asked.out.open("a") as out:
                    out.write(json.dumps(results[key], default=float) + "\n")
            own = results[key]
            if not asked.json:
                said = (f"{own[name]:.3g}" if isinstance(own[name], float) else own[name] for name in SHOWN)
                print(*said, flush=True)
    if asked.json:
        print(json.dumps(list(results.values()), default=float))


if __name__ == "__main__":
    main()
