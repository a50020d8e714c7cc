"""Is "usable" kept? Fits whose truth is known: poor ones, good ones, and ones of models that lack something.

    python benchmarks/usable.py [--part poor good wide lacking wrong] [--seed 0] [--json]

Recordings are of virtual vehicles of four classes (`greybox_lab.virtual`), 40 s at 50 Hz, another 40 s held out. What
is stated of them are parameters, tolerances and noise, as in a workshop's vehicle file; true ones lie within.

- poor: 3 rows, 30 rows, nothing excited, shuffled, half of another vehicle, another vehicle's file, another model,
  standing, noise in place of readings. None is "usable" in any form (or it is refused).
- good: nothing is wrong. "Not usable" is wrong.
- wide: the same, parameters stated ten times as roughly.
- lacking: one effect that no parameter of the model is. 95 % intervals of usable fits hold the truth.
- wrong: a mass stated 9 % off, a rack of varying ratio, both with the ratio estimated, and an offset of the steering's
  sensor. The interval of the ratio (of the understeer gradient for the offset) holds the truth, or the fit is not
  usable.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from running import options

import greybox_id as gb
from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import Recording
from greybox_lab.virtual import virtual_vehicle as virtual
from greybox_lab.virtual.virtual_vehicle import EFFECTS, VirtualCar, drive, random_vehicle, steered

KINDS = ("racer", "car", "truck", "sports")
SECONDS, RATE = 40.0, 50.0
COUNTS = {"poor": 60, "good": 60, "wide": 20, "lacking": 120, "wrong": 60}
A_PARAMETER = (
    "grip_scale", "front_stiffness", "rear_stiffness", "mass_change", "cog_shift", "yaw_inertia", "motor_gain",
    "aero_drag", "rolling_resistance",
)  # fmt: skip
"""Effects that are other values of parameters."""


@dataclass(frozen=True)
class Case:
    """A fit to make.

    Attributes
    ----------
    name : what it is.
    model : name of the model.
    train, held_out : recordings.
    stated, true : the vehicle.
    effects : that are estimated.
    truth : name -> value, of what has to be held.
    """

    name: str
    model: str
    train: Recording
    held_out: Recording | None
    stated: VirtualCar
    tolerances: virtual.Tolerances
    truth: Mapping[str, float]
    effects: tuple[str, ...] = ()


def vehicles(seed: int, k: int) -> tuple[VirtualCar, VirtualCar, virtual.Tolerances, np.random.Generator]:
    """What is stated, what is true, within which tolerances."""
    rng = np.random.default_rng((seed, k, 515))
    stated = random_vehicle(int(rng.integers(10**8)), KINDS[k % 4])
    usual = virtual.tolerances(stated)
    return stated, virtual.toleranced(stated, rng), usual, rng


def pair(true: VirtualCar, rng: np.random.Generator, effects: Mapping[str, float]) -> tuple[Recording, Recording]:
    """Two drives."""
    first, second = (drive(true, "mixed", SECONDS, RATE, effects, seed=int(rng.integers(10**8))) for _ in range(2))
    return first[0], second[0]


def model_of(true: VirtualCar, rng: np.random.Generator) -> str:
    """A model that the vehicle's channels suit."""
    return str(rng.choice(("lateral", "single_track")))


def good(seed: int, k: int) -> Case:
    """Nothing is wrong."""
    stated, true, tolerances, rng = vehicles(seed, k)
    return Case("good", model_of(true, rng), *pair(true, rng, {}), stated, tolerances, true.parameters)


def wide(seed: int, k: int) -> Case:
    """Nothing is wrong, and little is known of parameters."""
    case = good(seed, k)
    rough = {name: 10.0 * sd for name, sd in case.tolerances.parameters.items()}
    return replace(case, name="wide", tolerances=replace(case.tolerances, parameters=rough))


def lacking(seed: int, k: int) -> Case:
    """One effect is left out."""
    stated, true, tolerances, rng = vehicles(seed, k)
    names = [name for name in EFFECTS if name not in A_PARAMETER]
    name = names[int(rng.integers(len(names)))]
    effects = {name: true.magnitude(name, rng)}
    return Case(name, model_of(true, rng), *pair(true, rng, effects), stated, tolerances, true.parameters)


def wrong(seed: int, k: int) -> Case:
    """Something stated or measured is wrong."""
    kind = ("mass", "rack", "offset")[k % 3]
    stated, true, tolerances, rng = vehicles(seed, k // 3)
    if kind == "mass":
        ratio = float(rng.uniform(0.9, 1.1))
        factor = 0.91 if rng.random() < 0.5 else 1.09
        known = replace(stated, parameters={**stated.parameters, "m": factor * stated.parameters["m"]})
        both = pair(true, rng, {"steering_ratio": ratio})
        truth = {"steering_ratio": ratio * true.small.get("steering_ratio", 1.0)}
        return Case("mass 9 % off", "lateral", *both, known, tolerances, truth, ("steering_ratio",))
    if kind == "rack":
        effects = {"variable_ratio": true.magnitude("variable_ratio", rng)}
        train, truth = drive(true, "mixed", SECONDS, RATE, effects, seed=int(rng.integers(10**8)))
        held = drive(true, "mixed", SECONDS, RATE, effects, seed=int(rng.integers(10**8)))[0]
        moves = np.abs(train["steer"]) > 0.2 * np.max(np.abs(train["steer"]))
        gain = np.sort(truth.states["steer"][moves] / train["steer"][moves])
        least, most = (float(gain[round(share * len(gain))]) for share in (0.25, 0.75))
        return Case("variable rack", "lateral", train, held, stated, tolerances, {"steering_ratio": least,
                    " steering_ratio": most}, ("steering_ratio",))  # fmt: skip
    offset = float(rng.choice((-1, 1)) * rng.uniform(0.006, 0.012))
    both = pair(true, rng, {"steering_offset": offset})
    return Case("sensor offset", "lateral", *both, stated, tolerances, {"K_us": understeer(true.parameters)})


def understeer(p: Mapping[str, float]) -> float:
    """Understeer gradient at small slip, rad s^2/m: m/L (l_r/C_f - l_f/C_r), where C = B C D F_z."""
    front, rear = (p[f"B_{axle}"] * p[f"C_{axle}"] * p[f"D_{axle}"] for axle in "fr")
    return (1.0 / front - 1.0 / rear) / 9.80665


def poor(seed: int, k: int) -> Case:
    """Nothing that can be used."""
    stated, true, tolerances, rng = vehicles(seed, k)
    how = ("3 rows", "30 rows", "unexcited", "shuffled", "half another car", "wrong vehicle", "wrong model",
           "standing", "noise")[k % 9]  # fmt: skip
    train, held = pair(true, rng, {})
    model, given = model_of(true, rng), tolerances
    another = random_vehicle(int(rng.integers(10**8)), KINDS[(k + 1 + int(rng.integers(3))) % 4])
    if how in ("3 rows", "30 rows"):
        begin, rows = int(rng.integers(len(train) - 40)), int(how.split()[0])
        train = train.rows(begin, begin + rows)
    elif how in ("unexcited", "standing"):
        speed = 0.0 if how == "standing" else 0.5 * true.top_speed
        rows = round(SECONDS * RATE)
        train, held = (
            steered(true, how, np.zeros(rows), np.full(rows, speed), RATE, seed=int(rng.integers(10**8)))[0]
            for _ in range(2)
        )
    elif how == "shuffled":
        order = rng.permutation(len(train))
        train, held = (one.with_signals(steer=one["steer"][order]) for one in (train, held))
    elif how == "half another car":
        drawn = (random_vehicle(int(rng.integers(10**8)), true.kind) for _ in range(1000))
        same = next(one for one in drawn if one.drive_channel == true.drive_channel)
        other = drive(same, "mixed", SECONDS, RATE, seed=int(rng.integers(10**8)))[0]
        half = len(train) // 2
        both = [name for name in train.signals if name in other.signals]
        train = Recording("halves", train.time, {name: np.r_[train[name][:half], other[name][half:]] for name in both})
    elif how == "wrong vehicle":
        stated, given = another, virtual.tolerances(another)
    elif how == "wrong model":
        model = ("lateral", "longitudinal")[(k // 9) % 2]  # what drives it is not what it is driven by
        driven, by = ("steer", "v_x") if model == "lateral" else (true.drive_channel, "yaw_rate")
        train, held = (
            one.with_signals(**{driven: np.std(one[driven]) / np.std(one[by]) * (one[by] - np.mean(one[by]))})
            for one in (train, held)
        )
    elif how == "noise":
        train, held = (
            one.with_signals(**{
                name: np.mean(one[name]) + np.std(one[name]) * rng.standard_normal(len(one))
                for name in ("yaw_rate", "a_y", "v_y") if one.has(name)
            })
            for one in (train, held)
        )  # fmt: skip
    return Case(how, model, train, held if rng.random() < 0.7 else None, stated, given, {})


def fit_of(case: Case) -> gb.Fit:
    """The fit that a workshop would make. Raises `BadInput` where the recording can carry none."""
    about_null = {name: sd for name, sd in case.tolerances.effects.items() if name not in case.effects}
    text = virtual.vehicle_file_text(case.stated, replace(case.tolerances, effects=about_null))
    with tempfile.NamedTemporaryFile("w", suffix=".toml") as file:
        file.write(text)
        file.flush()
        return gb.fit(case.model, case.train, validation=case.held_out, vehicle=file.name, effects=list(case.effects))


def fitted(case: Case) -> dict[str, Any]:
    """The verdict, and which intervals hold what is true."""
    result: dict[str, Any] = {"name": case.name, "model": case.model, "vehicle": case.stated.name}
    try:
        fit = fit_of(case)
    except BadInput as refusal:
        return result | {"verdict": "refused", "reasons": [str(refusal)], "missed": {}, "counted": 0}
    table = fit.conf_int()
    known = {name: tuple(map(float, table.loc[name])) for name in table.index}
    known |= {one.name: (one.low, one.high) for one in fit.combined()}
    held, missed = 0, {}
    for name, value in case.truth.items():
        low, high = known.get(name.strip(), (np.nan, np.nan))
        if np.isfinite(low) and np.isfinite(high):
            held += 1
            if not low <= value <= high:
                missed[name] = [low, value, high]
    return result | {
        "verdict": fit.verdict.usability, "reasons": list(fit.verdict.reasons), "missed": missed, "counted": held,
    }  # fmt: skip


PARTS = {"poor": poor, "good": good, "wide": wide, "lacking": lacking, "wrong": wrong}


def show(rows: list[dict[str, Any]]) -> None:
    """What was found, part by part."""
    say = sys.stdout.write
    for part in dict.fromkeys(row["part"] for row in rows):
        chosen = [row for row in rows if row["part"] == part]
        say(f"{part}: {dict(Counter(row['verdict'] for row in chosen))}\n")
        for verdict in ("usable", "usable with care"):
            counted = sum(row["counted"] for row in chosen if row["verdict"] == verdict)
            missed = sum(len(row["missed"]) for row in chosen if row["verdict"] == verdict)
            if counted:
                say(f"    {verdict}: {counted - missed} of {counted} intervals hold the truth\n")
        for row in chosen:
            if row["verdict"] == "not usable" if part in ("good", "wide") else row["verdict"].startswith("usable"):
                reason = f"{row['k']} {row['name']}, {row['model']}, {row['vehicle']}: {row['reasons'][0]}\n"
                say(f"    {reason}" if part in ("poor", "good", "wide") else "")


def main() -> None:
    """Run the benchmark; as JSON one object a line for each fit."""
    given = options(
        __doc__, part={"nargs": "+", "choices": PARTS, "default": list(PARTS)}, seed=0,
        cases={"type": int, "nargs": 2, "metavar": ("FIRST", "END"), "help": "of each part, these alone"},
    )  # fmt: skip
    rows = []
    for part in given.part:
        for k in range(*(given.cases or (0, COUNTS[part]))):
            rows.append({"part": part, "k": k} | fitted(PARTS[part](given.seed, k)))
            if given.json:
                print(json.dumps(rows[-1], default=float), flush=True)
    if not given.json:
        show(rows)


if __name__ == "__main__":
    main()
