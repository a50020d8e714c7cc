"""The truck of the transfer-learning paper: ten seconds of free run, grey-box models beside the published figures.

    python benchmarks/truck.py --data DIR [--json]

DIR holds train.parquet and val.parquet, perhaps test.parquet, columns as published. Models are fitted to train alone;
structures and beliefs were chosen on train and val. Test is scored and nothing else.

Metric, as published: every trajectory runs freely for 10 s from its first reading of v_y and yaw rate, along the
recorded inputs, at 0.05 s (every tenth row); RMSE per trajectory, mean over trajectories. Signs do not enter. What
differs from the publication: classical Runge-Kutta steps with inputs straight between rows in place of forward Euler;
Gauss-Newton on the metric itself in place of ABC-SMC. FROM THE THIRD MODEL ON, INPUTS PASS FILTERS THAT ARE NOT CAUSAL,
and alpha1 is bridged where it rests at zero (truck_inputs.py).

CPU seconds are of this process, cold: reading and preparing train, tracing and differentiating the model, writing its
C, and the fit from its stated start. Left out are the compiler, which runs once per model and machine in a process of
its own, Python's imports (start_seconds in the JSON), scoring, and the report on uncertainty.

Source of the published figures: "Physics-guided approach with transfer learning in vehicle lateral dynamics",
Tables II and III.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits
from truck_inputs import prepared, published_signs, raw
from truck_models import BOTH_ANGLES, LEVER_ARM, ONE_ANGLE, PUBLISHED, bank_map, spread_over, truck

from greybox_id.combined import combined
from greybox_id.engine.layout import NormalEquations
from greybox_id.engine.motion.prediction import Predictor
from greybox_id.engine.motion.shooting import MotionProblem, Simulated
from greybox_id.engine.motion.simulator import Simulator
from greybox_id.errors import GreyboxError
from greybox_id.motion_model import MotionModel
from greybox_id.parameter import Array
from greybox_id.recording import Recording
from greybox_id.solvers.gauss_newton import Solution, gauss_newton
from greybox_id.uncertainty import uncertainty

SPLITS = ("train", "val", "test")
OUTPUTS = ("v_y", "yaw_rate")
TYPICAL = np.array([0.045, 0.005])
"""Errors that count alike, v_y in m/s and yaw rate in rad/s."""
FLOOR = 0.3
"""A trajectory better than this share of the typical error counts quadratically."""
ROWS_PER_READING = 17.0
"""So many rows count as one reading beside what is believed: errors last (for some 65 rows, as the fit then shows)."""
MOST_STEPS, TOLERANCE, NEGLIGIBLE = 40, 1e-5, 1e-4

PAPER = {
    "bicycle, ABC-SMC (paper)": (0.1185, 0.0083),
    "MLP (paper, best per column)": (0.05109, 0.00609),
    "bicycle and MLP (paper, best per column)": (0.05378, 0.00638),
    "MLP, transfer learning (paper, best per column)": (0.05004, 0.00566),
}
"""v_y and yaw rate on the authors' test split."""


@dataclass(frozen=True)
class Candidate:
    """A model and what it is fed.

    Attributes
    ----------
    name, inputs : for people.
    prepare : file -> recording.
    model : training recording -> model.
    """

    name: str
    inputs: str
    prepare: Callable[[Path], Recording]
    model: Callable[[Recording], MotionModel]


CANDIDATES = (
    Candidate("bicycle, signs as published", "v_x, alpha1", published_signs, lambda train: truck(believed=PUBLISHED)),
    Candidate("bicycle, signs put right, lever arm", "v_x, alpha1", raw, lambda train: truck(LEVER_ARM)),
    Candidate("best with one angle", "v_x, alpha1", prepared, lambda train: truck(*ONE_ANGLE)),
    Candidate("best with both angles", "v_x, alpha1, alpha2", prepared, lambda train: truck(*BOTH_ANGLES)),
    Candidate(
        "with a map of the road's bank", "v_x, alpha1, alpha2, position", prepared,
        lambda train: truck(*BOTH_ANGLES, bank_map(spread_over(train))),
    ),
)  # fmt: skip


class MeanError:
    """The published metric as an objective: the mean over trajectories of each one's RMSE, and what is believed.

    At every point a weighted least-squares problem touches it and lies above it elsewhere: squares of a trajectory's
    residuals weigh one over its RMSE. The solver steps on that and is judged by the metric.

    Attributes
    ----------
    plain : the problem, all weights one.
    bounds, free : as of `LeastSquares`.
    """

    def __init__(self, problem: MotionProblem) -> None:
        self.plain = problem
        self.bounds, self.free = problem.bounds, problem.free

    @property
    def start(self) -> Array:
        """Unknowns to start from."""
        return self.plain.start

    def simulated_nodes(self, x: Array) -> Simulated:
        """A simulation of every trajectory."""
        return self.plain.simulated_nodes(x)

    def objective(self, x: Array, nodes: Simulated) -> float:
        """The metric, in the beliefs' measure; infinite where the model is not finite."""
        relative = self._relative(nodes)
        counted = np.where(relative > FLOOR, relative, (relative**2 / FLOOR + FLOOR) / 2)
        rows = np.array([[len(interval)] for interval in self.plain.intervals])
        total = np.sum(counted * rows) / ROWS_PER_READING + 0.5 * np.sum(self.plain.belief_residuals(x) ** 2)
        return float(total) if np.isfinite(total) else np.inf

    def normal_equations(self, x: Array, nodes: Simulated) -> NormalEquations:
        """Of the least-squares problem that touches the metric here."""
        return self.weighted(nodes).normal_equations(x, nodes)

    def weighted(self, nodes: Simulated) -> MotionProblem:
        """The least-squares problem that touches the metric at a point."""
        weights = 1 / np.maximum(self._relative(nodes), FLOOR)
        runs = zip(weights, self.plain.runs, strict=True)
        return self.plain.weighing([np.tile(own, (len(run), 1)) for own, run in runs])

    def _relative(self, nodes: Simulated) -> Array:
        """(trajectories, outputs) RMSE over the typical one."""
        with np.errstate(over="ignore"):
            squares = ((nodes.y - self.plain.target) / TYPICAL) ** 2
        return np.sqrt([np.mean(own, axis=0) for own in np.split(squares, nodes.lanes.rows[1:-1])])


def main() -> int:
    """Run the benchmark; 2 on bad input."""
    start_seconds = time.process_time()
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--data", required=True, type=Path, help="folder of the recordings")
    arguments.add_argument("--json", action="store_true", help="one JSON object on standard output")
    given = arguments.parse_args()
    try:
        with threadpool_limits(1):
            found = [measure(candidate, given.data) for candidate in CANDIDATES]
    except (GreyboxError, OSError) as error:
        sys.stderr.write(f"truck: {error}\n")
        return 2
    rows = [row for of_one, _ in found for row in of_one]
    told = {candidate.name: of_one for candidate, (_, of_one) in zip(CANDIDATES, found, strict=True)}
    if given.json:
        everything = {"rows": rows, "told": told, "paper": PAPER, "start_seconds": start_seconds}
        sys.stdout.write(json.dumps(everything, indent=1) + "\n")
    else:
        show(rows, told)
    return 0


def measure(candidate: Candidate, data: Path) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Rows of one model, a row per split, and what the fit tells of its parameters and their combinations."""
    sys.stderr.write(f"{candidate.name}\n")
    clock = time.process_time()
    train = candidate.prepare(data / "train.parquet")
    problem, solution = fitted(candidate.model(train), train)
    seconds = time.process_time() - clock
    simulator, p = problem.plain.simulator, problem.plain.shared(solution.x)
    rows = []
    for split in SPLITS:
        path = data / f"{split}.parquet"
        if split != "test" or path.exists():
            of_split = errors(simulator, train if split == "train" else candidate.prepare(path), p)
            rows.append(_row(candidate, simulator.trace.model, split, of_split, seconds))
    return rows, {"solver": solution.status.value, "steps": solution.steps, **identified(problem, solution)}


def fitted(model: MotionModel, train: Recording, max_steps: int = MOST_STEPS) -> tuple[MeanError, Solution]:
    """Fit a model to the metric, from where its parameters are believed to be."""
    noise = TYPICAL * np.sqrt(ROWS_PER_READING)
    problem = MeanError(MotionProblem(Simulator(model, compiled=True), [train], noise=noise, starts="measured"))
    search = {"tolerance": TOLERANCE, "negligible": NEGLIGIBLE, "search": "damp"}
    return problem, gauss_newton(problem, problem.start, max_steps=max_steps, **search)


def errors(simulator: Simulator, recording: Recording, p: Array) -> Array:
    """(trajectories, outputs) RMSE of free runs."""
    found = Predictor(simulator, recording, p).free_run()
    squares = (found.predicted - found.measured) ** 2
    return np.sqrt([np.mean(squares[found.run == run], axis=0) for run in np.unique(found.run)])


def identified(problem: MeanError, solution: Solution) -> dict[str, Any]:
    """Parameters and combinations with standard deviations, which errors that last have widened."""
    found = uncertainty(problem.weighted(solution.nodes), solution.x, solution.nodes)
    model = problem.plain.model.with_values(problem.plain.shared(solution.x))
    parameters, dof, at = {}, {}, 0
    for parameter in model.parameters:
        if not parameter.fixed and parameter.shape == ():
            dof[parameter.name] = found.dof[at]
            parameters[parameter.name] = {
                "unit": parameter.unit, "value": float(parameter.array), "sd": float(found.sd[at]),
                "believed_sd": float(np.asarray(parameter.prior.sd)), "at_bound": bool(found.at_bound[at]),
            }  # fmt: skip
        at += parameter.size
    every = (combined(each, model, found.covariance, dof) for each in model.combinations)
    combinations = {one.name: {"unit": one.unit, "value": one.value, "sd": one.sd} for one in every}
    return {"parameters": parameters, "combinations": combinations}


def _row(candidate: Candidate, model: MotionModel, split: str, of_split: Array, seconds: float) -> dict[str, Any]:
    mean, spread = np.mean(of_split, axis=0), np.std(of_split, axis=0, ddof=1)
    return {
        "model": candidate.name,
        "inputs": candidate.inputs,
        "parameters": sum(parameter.size for parameter in model.parameters if not parameter.fixed),
        "split": split,
        **dict(zip(OUTPUTS, mean.tolist(), strict=True)),
        "cpu_seconds": seconds,
        "trajectories": len(of_split),
        "standard_error": dict(zip(OUTPUTS, (spread / np.sqrt(len(of_split))).tolist(), strict=True)),
    }


def show(rows: list[dict[str, Any]], told: dict[str, Any]) -> None:
    """Print the rows for people."""
    title = "10 s free runs: RMSE, mean over trajectories (standard error)"
    table = Table(box=None, padding=(0, 2, 0, 0), title=title)
    for head in ("model", "inputs", "free", "split", "v_y, m/s", "yaw rate, rad/s", "CPU s"):
        table.add_column(head)
    for row in rows:
        spread, first = row["standard_error"], row["split"] == SPLITS[0]
        table.add_row(
            *((row["model"], row["inputs"], str(row["parameters"])) if first else ("", "", "")), row["split"],
            f"{row['v_y']:.4f} ({spread['v_y']:.4f})", f"{row['yaw_rate']:.5f} ({spread['yaw_rate']:.5f})",
            f"{row['cpu_seconds']:.1f}" if first else "",
        )  # fmt: skip
    for name, (v_y, yaw_rate) in PAPER.items():
        table.add_row(name, "", "", "test", f"{v_y:.4f}", f"{yaw_rate:.5f}", "")
    console = Console(soft_wrap=True, width=140)
    console.print(table)
    console.print("\nTold together (standard deviation):")
    for name, of_model in told.items():
        each = (f"{n} {c['value']:.4g} ({c['sd']:.2g}) {c['unit']}" for n, c in of_model["combinations"].items())
        console.print(f"{name}: {'; '.join(each)}", highlight=False)


if __name__ == "__main__":
    sys.exit(main())
