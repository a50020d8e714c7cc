"""The truck of the transfer-learning paper: grey-box models, fitted to the published metric itself.

Models are fitted to train alone; structures and priors were chosen on train and val. Test is scored and nothing else.

Metric, as published: every trajectory runs freely for 10 s from its first reading of v_y and yaw rate, along the
recorded inputs, at 0.05 s (every tenth row); RMSE per trajectory, mean over trajectories. Signs do not enter. What
differs from the publication: classical Runge-Kutta steps with inputs straight between rows in place of forward Euler;
Gauss-Newton on the metric itself in place of ABC-SMC. FROM THE FOURTH MODEL ON, INPUTS PASS FILTERS THAT ARE NOT
CAUSAL, and alpha1 is bridged where it rests at zero (truck_inputs.py).

CPU seconds are of this process, cold: reading and preparing train, tracing and differentiating the model, writing its
C, and the fit from its stated start. Left out are the compiler, which runs once per model and machine in a process of
its own, Python's imports, scoring, and the report on uncertainty.

Source of the published figures: "Physics-guided approach with transfer learning in vehicle lateral dynamics",
Tables II and III.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from greybox_id.base.shorthands import Array
from greybox_id.datasets.recording import Recording
from greybox_id.engine.least_squares import LeastSquares, NormalEquations
from greybox_id.engine.motion.shooting import MotionProblem, SimulatedRuns
from greybox_id.engine.motion.simulator import Predictor, Simulator
from greybox_id.engine.solvers.gauss_newton import Solution, Status, gauss_newton
from greybox_id.fitting.fit import combined
from greybox_id.fitting.uncertainty import uncertainty
from greybox_id.models.motion_model import MotionModel
from greybox_id.models.parameter import free_places

from .truck_inputs import causal, prepared, published_signs, raw
from .truck_models import BOTH_ANGLES, CAUSAL_ANGLE, LEVER_ARM, ONE_ANGLE, PUBLISHED, bank_map, spread_over, truck

OUTPUTS = ("v_y", "yaw_rate")
TYPICAL = np.array([0.045, 0.005])
"""Errors that count alike, v_y in m/s and yaw rate in rad/s."""
FLOOR = 0.3
"""A trajectory better than this share of the typical error counts quadratically."""
ROWS_PER_READING = 17.0
"""So many rows count as one reading beside what is believed: errors last (for some 65 rows, as the fit then shows)."""
MOST_STEPS, TOLERANCE, NEGLIGIBLE = 40, 1e-5, 1e-4

PAPER = {
    "bicycle, ABC-SMC, 0.05 s (paper)": (0.1416, 0.0116),
    "bicycle, ABC-SMC, 0.5 s (paper)": (0.1354, 0.0101),
    "bicycle, ABC-SMC (paper)": (0.1185, 0.0083),
    "MLP (paper, best per column)": (0.05109, 0.00609),
    "bicycle and MLP (paper, best per column)": (0.05378, 0.00638),
    "MLP, transfer learning (paper, best per column)": (0.05004, 0.00566),
}
"""v_y and yaw rate on the authors' test split."""


@dataclass(frozen=True)
class TruckCandidate:
    """A model and what it is fed.

    Attributes
    ----------
    name, inputs : for people.
    prepare : file -> recording.
    model : training recording -> model.
    needs : signals that not every file may have.
    """

    name: str
    inputs: str
    prepare: Callable[[Path], Recording]
    model: Callable[[Recording], MotionModel]
    needs: tuple[str, ...] = ()


CANDIDATES = (
    TruckCandidate(
        "bicycle, signs as published", "v_x, alpha1", published_signs, lambda train: truck(believed=PUBLISHED)
    ),
    TruckCandidate("bicycle, signs corrected, lever arm", "v_x, alpha1", raw, lambda train: truck(LEVER_ARM)),
    TruckCandidate("best with one angle, causal", "v_x, alpha1", causal, lambda train: truck(*CAUSAL_ANGLE)),
    TruckCandidate("best with one angle", "v_x, alpha1", prepared, lambda train: truck(*ONE_ANGLE)),
    TruckCandidate(
        "best with both angles", "v_x, alpha1, alpha2", prepared, lambda train: truck(*BOTH_ANGLES), ("alpha2",)
    ),
    TruckCandidate(
        "with a map of the road's bank", "v_x, alpha1, alpha2, position", prepared,
        lambda train: truck(*BOTH_ANGLES, bank_map(spread_over(train))), ("alpha2", "along_road"),
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

    def simulated_nodes(self, x: Array) -> SimulatedRuns:
        """A simulation of every trajectory."""
        return self.plain.simulated_nodes(x)

    def objective(self, x: Array, nodes: SimulatedRuns) -> float:
        """The metric, in the beliefs' measure; infinite where the model is not finite."""
        relative = self._relative(nodes)
        counted = np.where(relative > FLOOR, relative, (relative**2 / FLOOR + FLOOR) / 2)
        rows = np.array([[item.rows] for item in self.plain.intervals])
        total = np.sum(counted * rows) / ROWS_PER_READING + 0.5 * np.sum(self.plain.prior_residuals(x) ** 2)
        return float(total) if np.isfinite(total) else np.inf

    def normal_equations(self, x: Array, nodes: SimulatedRuns) -> NormalEquations:
        """Of the least-squares problem that touches the metric here."""
        return self.weighted(nodes).normal_equations(x, nodes)

    def weighted(self, nodes: SimulatedRuns) -> MotionProblem:
        """The least-squares problem that touches the metric at a point."""
        weights = 1 / np.maximum(self._relative(nodes), FLOOR)
        runs = zip(weights, self.plain.runs, strict=True)
        return self.plain.weighing([np.tile(item, (len(run), 1)) for item, run in runs])

    def _relative(self, nodes: SimulatedRuns) -> Array:
        """(trajectories, outputs) RMSE over the typical one."""
        with np.errstate(over="ignore"):
            squares = ((nodes.y - self.plain.target) / TYPICAL) ** 2
        return np.sqrt([np.mean(item, axis=0) for item in np.split(squares, nodes.lanes.rows[1:-1])])


def fitted(model: MotionModel, train: Recording, max_steps: int = MOST_STEPS) -> tuple[MeanError, Solution]:
    """Fit a model to the metric, from where its parameters are believed to be. Raises `KeyboardInterrupt` on Ctrl-C."""
    noise = TYPICAL * np.sqrt(ROWS_PER_READING)
    problem = MeanError(MotionProblem(Simulator(model, compiled=True), [train], noise=noise, starts="measured"))
    solution = gauss_newton(
        cast(LeastSquares, problem),  # all of it that the solver asks for
        problem.start,
        max_steps=max_steps,
        tolerance=TOLERANCE,
        negligible=NEGLIGIBLE,
        search="levenberg_marquardt",
    )
    if solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return problem, solution


def deviations(simulator: Simulator, recording: Recording, p: Array) -> list[Array]:
    """Of every trajectory (rows, outputs): a free run's predictions less what was read."""
    result = Predictor(simulator, recording, p).free_run()
    away = result.predicted - result.measured
    return [away[result.run == run] for run in np.unique(result.run)]


def identified(problem: MeanError, solution: Solution) -> dict[str, Any]:
    """Parameters and combinations with standard deviations, which errors that last have widened."""
    result = uncertainty(problem.weighted(solution.nodes), solution.x, solution.nodes)
    model = problem.plain.model.with_values(problem.plain.shared(solution.x))
    parameters, dof = {}, {}
    for name, at in free_places(model.parameters).items():
        parameter = model[name]
        if parameter.prior is not None:
            dof[name] = result.dof[at]
            parameters[name] = {
                "unit": parameter.unit, "value": float(parameter.array), "sd": float(result.sd[at]),
                "believed_sd": float(np.asarray(parameter.prior.sd)), "at_bound": bool(result.at_bound[at]),
            }  # fmt: skip
    every = (combined(each, model, result.covariance, dof) for each in model.combinations)
    combinations = {one.name: {"unit": one.unit, "value": one.value, "sd": one.sd} for one in every}
    return {"parameters": parameters, "combinations": combinations}
