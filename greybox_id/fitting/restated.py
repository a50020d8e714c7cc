"""The problem that a fit solved, stated again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..engine.motion.shooting import MotionProblem
from ..engine.motion.simulator import Simulator
from ..errors import BadInput, near_or_all
from ..fit import Fit
from ..motion_model import MotionModel
from ..recording import Recording
from ..solvers.gauss_newton import Solution, Status, gauss_newton

TOLERANCE = 1e-10


def restated(fit: Fit, recordings: Sequence[Recording]) -> tuple[MotionProblem, Solution]:
    """The least-squares problem of a fit of a motion model, and its optimum.

    Starts of predictions are not kept in a fit; they follow again from its parameters.

    Parameters
    ----------
    fit : the fit.
    recordings : those it was trained on, in its order.

    Raises
    ------
    BadInput : it is a fit of another kind of model, or finds no optimum on these recordings.
    """
    model = _motion(fit)
    how = fit.how
    noise = how.get("counted", fit.stages[-1].noise)
    simulator = Simulator(model)
    simulator.kernel.prepare()
    problem = MotionProblem(
        simulator,
        recordings,
        noise=np.array([noise.get(name, 1.0) for name in model.outputs]),
        horizon=how.get("horizon"),
        starts=how.get("start_from", "free"),
        robust=how.get("robust"),
    )
    x = problem.unknowns(model.values)
    start = 0
    for parameter in model.parameters:
        if parameter.name in fit.per_run:
            for index, value in zip(problem.parameters.index, fit.per_run[parameter.name], strict=True):
                x[index[start : start + parameter.size]] = np.ravel(value)
        start += parameter.size
    solution = gauss_newton(problem, x, tolerance=TOLERANCE, search="levenberg_marquardt")
    if solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    if solution.status is Status.NOT_FINITE:
        raise BadInput(f"{model.name} is not finite on {recordings[0].name} at the fit's estimates. Fit again.")
    return problem, solution


def profiled(fit: Fit, names: Sequence[str], everything: bool = False) -> list[str]:
    """The parameters whose profiles are asked for: free numbers that are the same in all runs.

    Raises
    ------
    BadInput : none is named, or one that has no profile.
    """
    model = _motion(fit)
    free = [p.name for p in model.parameters if p.shape == () and not p.fixed and p.scope == "model"]
    if everything:
        return free
    if not names:
        raise BadInput(f"Which parameter? Name it with ‹parameter›, or ‹all› of them: {', '.join(free)}.")
    for name in names:
        if name not in model:
            raise BadInput(f"‹parameter› {name}: {model.name} has no parameter {name}.{near_or_all(name, free)}")
        if name not in free:
            why = "is held in this fit" if model[name].fixed else "has a value for each run"
            raise BadInput(f"‹parameter› {name}: {name} {why}; only {', '.join(free)} have profiles.")
    return list(dict.fromkeys(names))


def place(problem: MotionProblem, name: str) -> int:
    """Where a parameter that is the same in all runs stands among the unknowns."""
    start = 0
    for parameter in problem.model.parameters:
        if parameter.name == name:
            return int(problem.parameters.index[0][start])
        start += parameter.size
    raise KeyError(name)


def _motion(fit: Fit) -> MotionModel:
    if isinstance(fit.model, MotionModel):
        return fit.model
    raise BadInput(
        f"The fit is one of {fit.model.name}, a model with memory: its weights mean little one by one, and have no "
        "profiles. Fit equations of motion (greybox models)."
    )
