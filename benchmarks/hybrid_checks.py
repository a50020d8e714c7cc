"""What a hybrid model bears: constant stiffness, other tyres, other noise and rates, no sideslip, speeds that change.

    python benchmarks/hybrid_checks.py [--parts constant speed update alarm noise imu bands] [--seed 0] [--json]

`hybrid_stiffness` on the synthetic SimRod, seed 0; errors are of the held-out manoeuvres, as in `benchmarks/hybrid.py`.
constant : tyres whose forces are proportional to slip angle and load, without noise and with the stated one.
speed    : manoeuvres whose speed changes, by models trained at constant speeds, without and with loads that shift and
           brakes that take their share (longitudinal=true): a sine while the car slows down by 3 m/s^2, and a turn in
           which it is braked by 4 m/s^2.
update   : relaxation length 0.25 m, stiffness x 0.8 and x 1.2 (the peak stays): as trained on the old tyres, and after
           training was carried on with 10, 20 and 40 s of the new ones, and by adapt with 20 s, which may leave it.
alarm    : root mean square error over windows in units of noise (RMSSE) of single manoeuvres over that of training: old
           tyres, ten seeds of noise, and the new ones; above 1.5 a model is to be updated.
noise    : every other manoeuvre; sensors with twice and four times the noise, and with coloured noise; 50 and 200 rows
           a second.
imu      : trained on a_y and yaw rate alone.
bands    : five trainings on four fifths of the manoeuvres; how often mean +- 2 standard deviations hold the force, of
           their spread alone, and calibrated on the readings of the other fifth.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from hybrid import Row, as_table, row
from rich.console import Console
from threadpoolctl import threadpool_limits

from greybox_id.base.shorthands import Array
from greybox_id.datasets.recording import join
from greybox_id.fitting.adaptation.verb import adapt
from greybox_id.fitting.fit import Fit
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.scores.estimates import apply_hybrid
from greybox_id.fitting.training import update_hybrid, window_error
from greybox_id.fitting.verb import fit
from greybox_id.models.hybrid_model import HybridModel
from greybox_id.models.registry import prepared
from greybox_id.models.vehicle_file import vehicle
from greybox_lab.virtual.synthetic_simrod import (
    EFFECTS,
    FORMS,
    MANOEUVRES,
    RATE,
    Manoeuvre,
    Test,
    drive,
    make,
    simrod,
    steering,
    tyre_truth,
)  # fmt: skip
from greybox_lab.virtual.virtual_vehicle import steered

NAME = "hybrid_stiffness"
PARTS = ("constant", "speed", "update", "alarm", "noise", "imu", "bands")
TRAIN, HELD_OUT = ([own for own in MANOEUVRES if own.part == part] for part in ("train", "held out"))
RELAXED = {"tyre_relaxation": 0.25}
LINEAR = {f"{letter}_{axle}": value for axle in "fr" for letter, value in (("B", 0.14), ("C", 1.0), ("D", 100.0))}
"""A magic formula that is straight at all slips there are: B C D of 14 per radian; at 0.1 rad it is off by 1e-4."""
UPDATED = (11, 2, 13, 6)
"""Manoeuvres of `TRAIN` driven with the new tyres, in this order: sines and steps in turn, at 10 to 14 m/s."""
MEMBERS = 5
NEW = 1000
"""Beside seeds of noise, so that new tyres are not driven with the noise of the old ones."""


def tyres() -> dict[str, dict[str, Any]]:
    """The tyres that a car is updated to."""
    stated = simrod().parameters
    scaled = {k: {f"B_{axle}": k * stated[f"B_{axle}"] for axle in "fr"} for k in (0.8, 1.2)}
    return {
        "relaxation length 0.25 m": {"effects": {**EFFECTS, **RELAXED}},
        "stiffness x 0.8": {"tyres": scaled[0.8]}, "stiffness x 1.2": {"tyres": scaled[1.2]},
    }  # fmt: skip


def trained(tests: Sequence[Test], seed: int, hidden: Sequence[str] = (), **settings: Any) -> Fit:
    """A training on what some drives recorded, but for hidden signals."""
    recordings = [
        replace(test.recording, signals={n: v for n, v in test.recording.signals.items() if n not in hidden})
        for test in tests
    ]
    model = prepared(NAME, join(recordings, "training"), settings, vehicle=vehicle("simrod"))
    return fit(model, recordings, how=FitOptions(seed=seed))


def scored(words: str, found: Fit | Sequence[Fit], tests: Sequence[Test]) -> Row:
    """One row over all of some drives."""
    several = [found] if isinstance(found, Fit) else list(found)
    own = row(words, "all", tests, [apply_hybrid(several, test.recording) for test in tests])
    return own | {"cpu_seconds": sum(stage.cpu_seconds for fit in several for stage in fit.stages)}


def constant(seed: int) -> Iterator[Row]:
    still = {"effects": MappingProxyType({}), "forms": "nominal", "tyres": {**LINEAR, "h_cg": 0.0}}
    for noise in (0.0, 1.0):
        train, held_out = (
            drive(own, [seed + first + k for k in range(len(own))], noise=noise, **still)
            for own, first in ((TRAIN[::2], 0), (HELD_OUT, 100))
        )
        yield scored(f"constant stiffness, noise x {noise:g}", trained(train, seed), held_out)


def changing(kind: str, seed: int) -> Test:
    """A drive at a speed that changes."""
    braked = kind == "braked in a turn"
    manoeuvre = Manoeuvre("step" if braked else "sine", 15.0, 1.2, 0.12 if braked else 0.4, 8.0 if braked else 6.0)
    steer = steering(manoeuvre, RATE)
    t = np.arange(len(steer)) / RATE
    speed = np.maximum(15.0 - (4.0 if braked else 3.0) * np.clip(t - (2.5 if braked else 1.0), 0.0, 2.0), 6.0)
    recording, truth = steered(simrod(), kind, steer, speed, RATE, EFFECTS, FORMS, seed)
    return Test(manoeuvre, recording, tyre_truth(truth, recording.time))


def updated(found: Fit, tests: Sequence[Test]) -> tuple[Fit, float]:
    clock = time.process_time()
    assert isinstance(found.model, HybridModel)
    told = update_hybrid(
        found.model, [test.recording for test in tests], FitOptions(), lambda line, passing=False: None
    )
    return replace(found, model=told.model), time.process_time() - clock


def update(found: Fit, seed: int) -> Iterator[Row]:
    for words, tyre in tyres().items():
        held_out = drive(HELD_OUT, [NEW + seed + k for k in range(len(HELD_OUT))], **tyre)
        yield scored(f"{words}, as trained", found, held_out) | {"cpu_seconds": 0.0}
        new = drive([TRAIN[k] for k in UPDATED], [2 * NEW + seed + k for k in UPDATED], **tyre)
        for count in (1, 2, 4):
            again, spent = updated(found, new[:count])
            yield scored(f"{words}, after {10 * count} s", again, held_out) | {"cpu_seconds": spent}
        done = adapt(found, join([test.recording for test in new[:2]], "new tyres"), seconds=20.0)
        told = f"{words}, adapt to 20 s: {done.chosen.name}"
        yield scored(told, done.fit, held_out) | {"cpu_seconds": done.cpu_seconds}


def alarm(found: Fit, seed: int) -> Iterator[Row]:
    model = found.model
    assert isinstance(model, HybridModel)
    noise = np.array([found.stages[0].noise[name] for name in model.outputs])
    usual = found.how["errors_over_windows"][0]

    def ratios(tests: Sequence[Test]) -> Array:
        return np.array([window_error(model, test.recording, noise) / usual for test in tests])

    old = np.concatenate([ratios(make(seed + 1 + k, "held out")) for k in range(10)])
    cases = {"old tyres": old} | {
        words: ratios(drive(HELD_OUT, [NEW + seed + k for k in range(len(HELD_OUT))], **tyre))
        for words, tyre in tyres().items()
    }
    for words, own in cases.items():
        yield {"method": f"RMSSE over training's, {words}", "manoeuvre": f"{len(own)} of 10 s",
               "least": float(own.min()), "median": float(np.median(own)), "largest": float(own.max()),
               "above 1.5, %": 100.0 * float(np.mean(own > 1.5))}  # fmt: skip


def noise(seed: int) -> Iterator[Row]:
    for words, more in {
        "noise x 1": {},
        "noise x 2": {"noise": 2.0}, "noise x 4": {"noise": 4.0}, "coloured noise": {"colour": 0.8},
        "50 Hz": {"rate": 50.0}, "200 Hz": {"rate": 200.0},
    }.items():  # fmt: skip
        train, held_out = (
            drive(own, [seed + first + k for k in range(len(own))], **more)
            for own, first in ((TRAIN[::2], 0), (HELD_OUT, 100))
        )
        yield scored(words, trained(train, seed), held_out)


def bands(seed: int, tests: Sequence[Test]) -> Iterator[Row]:
    driven = make(seed, "train")
    apart = set(np.random.default_rng((seed, 613, MEMBERS)).permutation(len(driven))[: len(driven) // 5].tolist())
    new = [test.recording for k, test in enumerate(driven) if k in apart]
    members = [trained([test for k, test in enumerate(driven) if k not in apart], seed + k) for k in range(MEMBERS)]
    yield scored("five trainings, their spread", members, tests)
    found = [apply_hybrid(members, test.recording, new) for test in tests]
    yield row("five trainings, calibrated", "all", tests, found)
    yield row("one training", "all", tests, [apply_hybrid(members[:1], test.recording) for test in tests])


def main() -> int:
    """Train, apply, score."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    arguments.add_argument("--seed", type=int, default=0, help="of noise and of the first training (0)")
    arguments.add_argument("--json", action="store_true", help="one JSON object on standard output")
    given = arguments.parse_args()
    seed, rows = given.seed, []

    def tell(several: Iterator[Row] | Sequence[Row]) -> None:
        for own in several:
            rows.append(own)
            sys.stderr.write(json.dumps(own) + "\n")

    with threadpool_limits(1):
        tests = make(seed, "held out")
        if {"speed", "update", "alarm"} & set(given.parts):
            base = trained(make(seed, "train"), seed)
            tell([scored("as trained", base, tests)])
        if "speed" in given.parts:
            along = trained(make(seed, "train"), seed, longitudinal=True)
            tell([scored("as trained, longitudinal", along, tests)])
            for kind in ("slowing down in a sine", "braked in a turn"):
                drives = [changing(kind, seed)]
                tell(scored(f"{kind}{words}", own, drives) for words, own in (("", base), (", longitudinal", along)))
        if "update" in given.parts:
            tell(update(base, seed))
        if "alarm" in given.parts:
            tell(alarm(base, seed))
        if "imu" in given.parts:
            tell([scored("trained on a_y and yaw rate", trained(make(seed, "train"), seed, ("v_y",)), tests)])
        if "constant" in given.parts:
            tell(constant(seed))
        if "noise" in given.parts:
            tell(noise(seed))
        if "bands" in given.parts:
            tell(bands(seed, tests))
    if given.json:
        sys.stdout.write(json.dumps({"rows": rows}, indent=1) + "\n")
    else:
        Console(width=180).print(as_table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
