"""Write results of this version into tests/release/results/VERSION: `python tests/release/write_results.py`.

Run once a release; what earlier versions wrote stays as it is. The recordings are synthetic and are not kept.
"""

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import greybox_id as gb

RESULTS = Path(__file__).parent / "results"
COMMANDS = (
    "fit --model kinematic --vehicle roboracer --with steering_delay lap.csv --validate other.csv --out motion",
    "fit --model msnn_lat lap.csv --validate other.csv --out memory",
    "gap late7.csv --model lateral --vehicle full_size_car --held-out late8.csv --apply closed.toml --out gap",
)
FILES = {
    "motion/fit.json": "fit_motion.json",
    "memory/fit.json": "fit_memory.json",
    "gap/gap.json": "gap.json",
    "closed.toml": "closed.toml",
}


def recordings(folder):
    """Two stretches of the shipped recordings, and two laps of a car that steers 60 ms late."""
    for name, shipped, rows in (("lap", "racer_train", 300), ("other", "racer_valid", 200)):
        table = gb.read(gb.datasets.shipped(shipped), columns="roboracer").rows(0, rows).to_pandas()
        table.to_csv(folder / f"{name}.csv", index=False)
    truth = gb.models.lateral(vehicle="full_size_car") + gb.effects.steering_delay.at(0.06)
    time = np.arange(0.0, 20.0, 0.02)
    for name, rate in {"late7": 0.9, "late8": 1.3}.items():
        steer = 0.04 * np.sin(rate * time) * np.sin(0.21 * time) + 0.01 * np.sign(np.sin(2.3 * rate * time))
        inputs = gb.Recording(name, time, {"steer": steer, "v_x": 18.0 + 4.0 * np.sin(0.3 * time)})
        table = inputs.with_signals(**gb.simulate(truth, inputs).signals).to_pandas()
        noise = np.random.default_rng(0).normal(0, [0.05, 0.01, 0.15], (len(time), 3))
        table[["v_y", "yaw_rate", "a_y"]] += noise
        table.to_csv(folder / f"{name}.csv", index=False)


def numbers(folder):
    """What a reader of the files in a folder gets: these numbers are equal in every later version."""
    from greybox_id.reports.gap.saved import load_gap

    fits = {name: gb.load(folder / f"fit_{name}.json") for name in ("motion", "memory")}
    gap, made = load_gap(folder / "gap.json")
    vehicle = gb.Vehicle.load(folder / "closed.toml")
    return {
        "fits": {name: {key: float(np.sum(value)) for key, value in fit.params.items()} for name, fit in fits.items()},
        "stderr": {key: float(value) for key, value in fits["motion"].stderr.dropna().items()},
        "magnitude": {row.effect: row.magnitude for row in gap.ranking},
        "ranking": {row.effect: row.probability for row in gap.ranking},
        "version": made.version,
        "vehicle": {name: stated.value for name, stated in vehicle.values.items() if stated.value is not None},
    }


def main():
    out = RESULTS / gb.__version__
    out.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as folder:
        recordings(Path(folder))
        for command in COMMANDS:
            words = [sys.executable, "-c", "from greybox_id.cli import main; main()", *command.split()]
            done = subprocess.run(words, cwd=folder, stdout=subprocess.DEVNULL)
            assert done.returncode in (0, 3), command  # 3: written, and not usable
        for made, kept in FILES.items():
            shutil.copyfile(Path(folder) / made, out / kept)
    (out / "numbers.json").write_text(json.dumps(numbers(out), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
