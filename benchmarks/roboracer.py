"""The tables of the paper on MS-NN that this package covers, measured on the RoboRacer recordings.

    python benchmarks/roboracer.py --data DIR [--json] [--quick]

DIR holds train.csv, valid.csv and lateral_net.json. Rows stand beside the published figures, in both protocols:
"published" as the authors form their figures, "honest" without windows across joins and pooled over all samples.
Everything is chosen on training data alone.

Source of the published figures: Mungiello et al., "Vehicle dynamics learning from physics priors with
model-structured neural networks", Tables 1 and 2.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from greybox_id.base.errors import GreyboxError
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording
from greybox_id.fitting.how import How
from greybox_id.fitting.scores.memory import predictions
from greybox_id.fitting.scores.metrics import score
from greybox_id.fitting.verb import fit
from greybox_id.models.model import Model
from greybox_id.models.registry import build, candidates
from greybox_id.reports.text.fit import as_dict as summary

PUBLISHED = {
    ("yaw_rate", 100): (0.109, 0.031),
    ("yaw_rate", 80): (0.106, 0.030),
    ("yaw_rate", 60): (0.137, 0.061),
    ("a_x", 100): (0.521, 0.281),
}
"""RMSE and FVU of the authors' MS-NN-full on valid.csv, by output and share of the training data in percent."""

FITS = (
    ("msnn_lat", 100, {}),
    ("msnn_lat", 80, {}),
    ("msnn_lat", 60, {}),
    ("msnn_long", 100, {}),
    ("msnn_full", 100, {}),
    ("msnn_full_plus", 100, {}),
    ("msnn_full_plus", 60, {}),
)


def main() -> int:
    """Run the benchmark; 2 on bad input."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--data", required=True, type=Path, help="folder of the recordings")
    arguments.add_argument("--json", action="store_true", help="one JSON object on standard output")
    arguments.add_argument("--quick", action="store_true", help="priors as stated instead of cross-validation")
    given = arguments.parse_args()
    try:
        rows = measure(given.data, How(strengths=1.0) if given.quick else How())
    except (GreyboxError, OSError) as error:
        sys.stderr.write(f"roboracer: {error}\n")
        return 2
    if given.json:
        sys.stdout.write(json.dumps({"rows": rows}, indent=1) + "\n")
    else:
        show(rows)
    return 0


def measure(data: Path, how: How) -> list[dict[str, Any]]:
    """All rows: the authors' own weights first, then our fits."""
    train, valid = read(data / "train.csv", "roboracer"), read(data / "valid.csv", "roboracer")
    rows = [authors(data / "lateral_net.json", valid)]
    for name, percent, settings in FITS:
        sys.stderr.write(f"{name}, {percent} % of train {settings or ''}\n")
        part = train.rows(0, round(len(train) * percent / 100))
        found = fit(candidates(name, part, settings), [part], validate=valid, how=how)
        told = summary(found)
        rows.append(
            {
                "model": name,
                "train_percent": percent,
                "settings": settings,
                "parameters": told["parameters"],
                "mode": told["mode"],
                "cpu_seconds": told["cpu_seconds"],
                "metrics": told["metrics"]["validate"],
                "chosen": {k: v for k, v in told["model"]["settings"].items() if not isinstance(v, dict)},
                "paper": {o: PUBLISHED[o, percent] for o in found.model.outputs if (o, percent) in PUBLISHED},
            }
        )
    return rows


def authors(path: Path, valid: Recording) -> dict[str, Any]:
    """The authors' trained lateral network, evaluated by our MS-NN-lat (it was fed -a_x)."""
    model = authors_network(json.loads(path.read_text()))
    turned = valid.with_signals(a_x=-valid["a_x"])
    found = predictions(model, turned, "published")
    error = found.predicted - found.measured
    metrics = {
        protocol: {name: {"rmse": e.rmse, "fvu": e.fvu} for name, e in by_output.items()}
        for protocol, by_output in score(model, turned).items()
    }
    metrics["published_pooled"] = {"yaw_rate": {"rmse": float(np.sqrt(np.mean(error**2)))}}
    return {
        "model": "authors' weights", "train_percent": 100, "settings": {}, "parameters": {"lat": model.size},
        "mode": "published weights", "cpu_seconds": {}, "metrics": metrics, "chosen": {},
        "paper": {"yaw_rate": PUBLISHED["yaw_rate", 100]},
    }  # fmt: skip


def authors_network(saved: dict[str, Any]) -> Model:
    """MS-NN-lat at the weights of the authors' lateral network, which names them k{q}_{l}_{j}_{p} and PFir10xW."""
    centres, weights = saved["centres"], saved["parameters"]
    settings = {"steer": centres["steer"], "v_x": centres["v_x"], "a_x": centres["a_x"], "curvature_gain": 3.0}
    model = build("msnn_lat", settings)
    shape = model["kappa_1"].shape
    for q in range(1, 5):
        kappa = np.array([weights[f"k{q}_{l}_{j}_{p}"][0][0] for l, j, p in np.ndindex(*shape)]).reshape(shape)
        model = model.with_parameters(model[f"kappa_{q}"].with_value(kappa))
    fir = [[weights[f"PFir10{1 + 4 * l + 2 * p}W"] for p in range(shape[2])] for l in range(shape[0])]
    return model.with_parameters(model["F"].with_value(np.array(fir)[..., 0]))


def show(rows: list[dict[str, Any]]) -> None:
    """Print the rows for people."""
    table = Table(box=None, padding=(0, 2, 0, 0), title="valid.csv: RMSE (FVU); yaw_rate in rad/s, a_x in m/s^2")
    for title in ("model", "train", "output", "published", "honest", "free run", "paper", "CPU s"):
        table.add_column(title)
    for row in rows:
        for output in row["metrics"]["honest"]:
            cells = [row["metrics"].get(p, {}).get(output) for p in ("published", "honest", "closed_loop")]
            paper = row["paper"].get(output)
            settings = " ".join(f"{k}={v}" for k, v in row["settings"].items())
            table.add_row(
                f"{row['model']} {settings}", f"{row['train_percent']} %", output,
                *("–" if c is None else f"{c['rmse']:.4f} ({c['fvu']:.3f})" for c in cells),
                "–" if paper is None else f"{paper[0]:.3f} ({paper[1]:.3f})",
                f"{sum(v for k, v in row['cpu_seconds'].items() if k != 'cross_validation'):.1f}",
            )  # fmt: skip
    Console(soft_wrap=True).print(table)


if __name__ == "__main__":
    sys.exit(main())
