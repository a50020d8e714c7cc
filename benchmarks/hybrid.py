"""Hybrid models on the synthetic SimRod: forces and stiffnesses of manoeuvres that were not trained on.

    python benchmarks/hybrid.py [--members 3] [--seed 0] [--json]

Trained on what the test car's sensors read; the true forces of the tyres are used for the score alone. Forces: root
mean square error over the manoeuvre's largest force. Stiffnesses: relative error where the true slip is above 0.01 rad;
below, a stiffness is not told. Rows "all" pool the manoeuvres. Takes two to three minutes a member.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from running import options, tell

from greybox_id.datasets.recording import join
from greybox_id.fitting.fit import Fit
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.scores.estimates import Estimates, apply_hybrid
from greybox_id.fitting.verb import fit
from greybox_id.models.registry import prepared
from greybox_id.models.vehicle import vehicle
from greybox_lab.virtual.synthetic_simrod import Test, make

Row = dict[str, str | float]
BARS = {"force": 4.0, "stiffness": 5.0}
"""Percent; the stretch is half of it and 2."""


def main() -> None:
    """Train, apply, score."""
    given = options(
        __doc__, members={"type": int, "default": 3, "help": "trainings that make an ensemble (3)"},
        seed={"type": int, "default": 0, "help": "of noise and of the first training (0)"},
    )  # fmt: skip
    tests, rows = make(given.seed, "held out"), []
    for name in ("hybrid_stiffness", "hybrid_force"):
        members = [trained(name, given.seed + k, given.seed) for k in range(given.members)]
        rows += scored(name, members[:1], tests)
        if len(members) > 1:
            rows += scored(f"{name}, {len(members)} members", members, tests)
    tell({"bars_percent": BARS, "rows": rows}, given.json)


def trained(name: str, seed: int, data_seed: int) -> Fit:
    recordings = [test.recording for test in make(data_seed, "train")]
    model = prepared(name, join(recordings, "training"), vehicle=vehicle("simrod"))

    def say(line: str, passing: bool = False) -> None:
        if not passing:
            sys.stderr.write(line + "\n")

    return fit(model, recordings, how=FitOptions(seed=seed), say=say)


def scored(name: str, members: Sequence[Fit], tests: Sequence[Test]) -> list[Row]:
    found = [apply_hybrid(members, test.recording) for test in tests]
    seconds = sum(stage.cpu_seconds for member in members for stage in member.stages)
    rows = [row(name, test.manoeuvre.name, [test], [own]) for test, own in zip(tests, found, strict=True)]
    return [*rows, row(name, "all", tests, found) | {"cpu_seconds": seconds}]


def row(name: str, manoeuvre: str, tests: Sequence[Test], found: Sequence[Estimates]) -> Row:
    told: Row = {"method": name, "manoeuvre": manoeuvre}
    for axle in "fr":
        F, C = f"F_y{axle}", f"C_alpha_{axle}"
        pairs = [(own[F], getattr(test.truth, F), own, test) for test, own in zip(tests, found, strict=True)]
        off = np.concatenate([(estimate - true) / np.max(np.abs(true)) for estimate, true, _, _ in pairs])
        relative = np.concatenate([own[C] / getattr(test.truth, C) - 1.0 for _, _, own, test in pairs])
        relative = relative[np.isfinite(relative)]
        told[f"{F} %"] = 100.0 * rms(off)
        told[f"{C} %"] = 100.0 * rms(relative)
        told[f"{C} within 5 %"] = 100.0 * float(np.mean(np.abs(relative) < 0.05))
        if f"{F}_sd" in found[0].columns:
            inside = [np.abs(estimate - true) <= 2.0 * own[f"{F}_sd"] for estimate, true, own, _ in pairs]
            told[f"{F} within 2 sd"] = 100.0 * float(np.mean(np.concatenate(inside)))
    beta = [
        own["sideslip"] - np.arctan2(test.truth.v_y, test.recording["v_x"])
        for test, own in zip(tests, found, strict=True)
    ]
    told["sideslip deg"] = float(np.degrees(rms(np.concatenate(beta))))
    return told


def rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    main()
