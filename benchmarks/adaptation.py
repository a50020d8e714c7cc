"""Adaptation to changed synthetic cars: does the interval hold the error found, and does adapting help?

    python benchmarks/adaptation.py [--seeds 20] [--first 0] [--reference] [--json]

A fit of `msnn_full_plus` to the shipped recording racer_train. Every seed draws a changed racer: mass and inertia by
up to +20 %, friction of the tyres by -30 to 0 %, their stiffness by -30 to +30 %, front and rear apart, their
relaxation length by a factor of 0.5 to 2. It is driven 45 s by one driver and, as another run, 25 s by another one. The
first 20 s of motion are adapted to, what follows is scored one sample ahead. Clopper-Pearson intervals of shares.
With --reference, the changed car is also driven 40 s by each of three drivers, and the model fitted to these 120 s:
what adapting to 20 s is to come near to.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import beta

from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording
from greybox_id.datasets.shipped import shipped
from greybox_id.fitting.adaptation.outcome import parted
from greybox_id.fitting.adaptation.verb import adapt
from greybox_id.fitting.fit import Fit
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.scores.memory import errors, predictions
from greybox_id.fitting.verb import fit
from greybox_id.models.registry import prepared
from greybox_lab.virtual.synthetic_racer.car import Car
from greybox_lab.virtual.synthetic_racer.drive import DrivenRun, drive
from greybox_lab.virtual.synthetic_racer.driver import Pid, PurePursuit, Stanley

OF_CARS = 77
"""Beside each seed, so that no other generator draws the same numbers."""
DRIVERS = ((Stanley, 2.4, 1.9, 1.6, 0.0), (Pid, 3.2, 3.6, 2.8, 0.0), (PurePursuit, 1.5, 4.0, 3.0, 0.07))
"""Controller, top speed, lateral and longitudinal limit, slalom: those of the shipped recordings; a tyre of 0.7 of the
friction still holds them."""


def changed(rng: np.random.Generator) -> Car:
    """A racer with more mass and other tyres."""
    car, heavier = Car(), rng.uniform(1.0, 1.2)
    front, rear = rng.uniform(0.7, 1.0, 2)
    stiff_front, stiff_rear = rng.uniform(0.7, 1.3, 2)
    return replace(
        car, m=heavier * car.m, I_z=heavier * car.I_z, mu_yf=front * car.mu_yf, mu_yr=max(rear, front) * car.mu_yr,
        mu_x=front * car.mu_x, C_yf=stiff_front * car.C_yf, C_yr=stiff_rear * car.C_yr,
        sigma_y=car.sigma_y * 2.0 ** rng.uniform(-1.0, 1.0),
    )  # fmt: skip


def driven(seed: int) -> Recording:
    """Two runs of a changed car, by two drivers."""
    rng = np.random.default_rng([seed, OF_CARS])
    car = changed(rng)
    chosen = rng.permutation(len(DRIVERS))[:2]
    return recorded(f"changed_{seed}", car, list(zip(chosen, (45.0, 25.0), strict=True)), rng)


def recorded(name: str, car: Car, parts: Sequence[tuple[int, float]], rng: np.random.Generator) -> Recording:
    """Runs by drivers, so many seconds each, as one file."""
    runs = []
    for number, seconds in parts:
        steering, v_max, a_y, a_x, slalom = DRIVERS[number]
        run = DrivenRun(steering, seconds, v_max, a_y, a_x, lead=3.0, slalom=slalom,
                        steer_delay=rng.uniform(0.0, 0.025), clockwise=bool(rng.integers(2)))  # fmt: skip
        runs.append(pd.DataFrame(drive(run, rng, car)))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.csv"
        pd.concat(runs).to_csv(path, index=False)
        return read(path, "roboracer")


def driven_long(seed: int) -> Recording:
    """120 s of the same changed car, 40 s by each driver."""
    car = changed(np.random.default_rng([seed, OF_CARS]))
    rng = np.random.default_rng([seed, OF_CARS, 120])
    return recorded(f"long_{seed}", car, [(number, 40.0) for number in range(len(DRIVERS))], rng)


def fitted(train: Recording) -> Fit:
    """`msnn_full_plus` as it is, priors as stated."""
    return fit(prepared("msnn_full_plus", train), [train], how=FitOptions(strengths=1.0, solver="gauss-newton"))


def measured(first: int, seeds: int, reference: bool) -> list[dict[str, Any]]:
    """One row for each seed and output."""
    train = read(shipped("racer_train"), "roboracer")
    found = fitted(train)
    rows = []
    for seed in range(first, first + seeds):
        clock = time.process_time()
        made = driven(seed)
        done = adapt(found, made, seconds=20.0, trained=[train])
        rest = parted(made, 20.0)[1]
        long = fitted(driven_long(seed)).model if reference else None
        told = {} if long is None or rest is None else errors(long, predictions(long, rest), "honest")
        for output in found.model.outputs:
            row: dict[str, Any] = {"seed": seed, "output": output, "choice": done.choices[output]}
            for role in ("zero_shot", "chosen"):
                own = getattr(done, role)
                low, high = own.interval[output]
                error = own.rest[output]
                row |= {f"{role}_rmse": error.rmse, f"{role}_stderr": error.rmse_sd, f"{role}_low": low,
                        f"{role}_high": high, f"{role}_held": bool(low <= error.rmse <= high)}  # fmt: skip
            row["cpu_seconds"] = done.cpu_seconds
            if output in told:
                row["reference_rmse"] = told[output].rmse
            rows.append(row)
        sys.stderr.write(f"seed {seed}: {time.process_time() - clock:.1f} CPU s\n")
    return rows


def share(held: int, count: int) -> tuple[float, float, float]:
    """A share and its 95 % interval (Clopper-Pearson)."""
    low = float(beta.ppf(0.025, held, count - held + 1)) if held else 0.0
    high = float(beta.ppf(0.975, held + 1, count - held)) if held < count else 1.0
    return held / count, low, high


def main() -> int:
    """Drive, adapt, count."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--seeds", type=int, default=20, help="changed cars (20)")
    arguments.add_argument("--first", type=int, default=0, help="the first seed (0)")
    arguments.add_argument("--reference", action="store_true", help="fit to 120 s of every changed car too")
    arguments.add_argument("--json", action="store_true", help="one JSON object on standard output")
    given = arguments.parse_args()
    table = pd.DataFrame(measured(given.first, given.seeds, given.reference))
    told: dict[str, Any] = {"rows": json.loads(table.to_json(orient="records")), "shares": {}}
    for output, own in table.groupby("output"):
        better = own["chosen_rmse"] <= own["zero_shot_rmse"] + own["zero_shot_stderr"]
        told["shares"][output] = {
            "held, chosen": share(int(own["chosen_held"].sum()), len(own)),
            "held, zero-shot": share(int(own["zero_shot_held"].sum()), len(own)),
            "not worse than zero-shot by a standard error": share(int(better.sum()), len(own)),
            "ratio of errors, median": float((own["chosen_rmse"] / own["zero_shot_rmse"]).median()),
            "ratio of errors, worst": float((own["chosen_rmse"] / own["zero_shot_rmse"]).max()),
            "error over the middle of the interval, sd of its logarithm": float(
                np.std(np.log(own["chosen_rmse"] / np.sqrt(own["chosen_low"] * own["chosen_high"])))
            ),
        }
        if given.reference:
            ratio = own["chosen_rmse"] / own["reference_rmse"]
            told["shares"][output] |= {
                "at most 1.1 times the error of a fit to 120 s": share(int((ratio <= 1.1).sum()), len(own)),
                "over that error, median": float(ratio.median()), "and worst": float(ratio.max()),
                "zero-shot over that error, median": float((own["zero_shot_rmse"] / own["reference_rmse"]).median()),
            }  # fmt: skip
    if given.json:
        sys.stdout.write(json.dumps(told, indent=1) + "\n")
    else:
        sys.stdout.write(table.round(3).to_string(index=False) + "\n\n" + json.dumps(told["shares"], indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
