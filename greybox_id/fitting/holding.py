"""Hold of commands between rows: kept constant, or interpolated? Both are fitted, and their likelihoods compared.

A measured steering angle continues between rows; a command is held. With the wrong assumption, every command is half a
row late or early, and inertia, tyres and delays compensate. If no column map states it, the likelier one is taken.

In either case the instant of a row is known only to within a row. The two fits show how parameters change when commands
come half a row later, and the errors of one of them how much later they would have to come. With a prior variance of
1/12 of a squared row, the second moment of that delay enters every standard deviation, of times and of all parameters
that act like a delay.

`restated` sets up the problem that a fit solved again, on recordings treated as in the fit.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any, Literal

import numpy as np

from ..base.errors import BadInput, near_or_all
from ..base.numbers import number, with_unit
from ..base.shorthands import Array
from ..base.statistics import correlation_time
from ..datasets.checks.consistency import standing
from ..datasets.recording import Recording
from ..engine.least_squares import LeastSquares
from ..engine.motion.shooting import MotionProblem
from ..engine.motion.simulator import Simulator
from ..engine.solvers.gauss_newton import Solution, Status, gauss_newton
from ..models.model import Model, by_kind
from ..models.motion_model import MotionModel
from .attempt import Attempt, attempted, errors_at, misfit, with_starts
from .fit import WITH_CARE, Fit, Reason
from .how import FitOptions, quiet

TOLERANCE = 1e-10
Hold = Literal["zero", "linear"]
IN_MOTION = "in motion or unbraked"
"""Note on a recording without the rows in which the vehicle stands under its brake."""


def with_hold(recording: Recording, hold: Hold) -> Recording:
    """The recording with commands held, or interpolated, between rows."""
    return replace(recording, hold=hold)


def as_fitted(fit: Fit, recording: Recording) -> Recording:
    """A recording whose map does not state the hold, with the hold that the fit took for its recordings."""
    hold = fit.how.get("hold")
    taken = hold.get("taken") if isinstance(hold, Mapping) else None
    if recording.hold_stated or taken not in ("zero", "linear"):
        return recording
    return with_hold(recording, "linear" if taken == "linear" else "zero")


def as_seen(fit: Fit, recording: Recording) -> Recording:
    """A training recording as the fit used it: with its hold, and without the rows that were dropped."""
    recording = as_fitted(fit, recording)
    moving = ~standing(recording) if fit.how.get("stood") else np.ones(len(recording), dtype=bool)
    return recording if moving.all() or not moving.any() else recording.keep(moving, IN_MOTION)


@by_kind
def stated_again(model: Model, fit: Fit, recordings: Sequence[Recording]) -> tuple[LeastSquares, Array]:
    """The least-squares problem that a fit of this kind solved, and its unknowns at the fit's estimates."""
    raise BadInput(
        f"{model.name} is {model.called}; its fits solve no least-squares problem that could be set up again."
    )


def restated(fit: Fit, recordings: Sequence[Recording]) -> tuple[LeastSquares, Solution]:
    """The least-squares problem of a fit, and its optimum.

    Initial states are not stored in a fit; they follow again from its parameters.

    Parameters
    ----------
    fit : the fit.
    recordings : its training recordings, in the fit's order.

    Raises
    ------
    BadInput : this kind of model solves no such problem, or is not finite on these recordings.
    """
    problem, x = stated_again(fit.model, fit, [as_seen(fit, recording) for recording in recordings])
    x = with_starts(problem, x) if isinstance(problem, MotionProblem) else x
    solution = gauss_newton(problem, x, tolerance=TOLERANCE, search="levenberg_marquardt")
    if solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    if solution.status is Status.NOT_FINITE:
        raise BadInput(f"{fit.model.name} is not finite on {recordings[0].name} at the fit's estimates. Fit again.")
    return problem, solution


def profiled(fit: Fit, names: Sequence[str], everything: bool = False) -> list[str]:
    """The requested parameters for profiles: free scalars that are the same in all runs.

    Raises
    ------
    BadInput : none is named, or one that has no profile.
    """
    model = fit.model
    if fit.mode == "early stopping":
        raise BadInput(
            f"Held-out data stopped the training of {model.name} early: its weights are at no optimum, so they have "
            f"no profile. "
            "Train it from several seeds to see how far its numbers scatter."
        )
    free = [p.name for p in model.parameters if p.shape == () and not p.fixed and p.scope == "model"]
    if not free:
        raise BadInput(
            f"The fit of {model.name} has no free number that is the same in all runs: arrays of weights mean little "
            "one by one, and have no profiles. Fit equations of motion (greybox models)."
        )
    if everything:
        return free
    if not names:
        raise BadInput(f"Which parameter? Name it with ‹parameter›, or ‹all› of them: {', '.join(free)}.")
    for name in names:
        if name not in model:
            raise BadInput(f"‹parameter› {name}: {model.name} has no parameter {name}.{near_or_all(name, free)}")
        if name not in free:
            why = "is fixed in this fit" if model[name].fixed else "has a value for each run"
            raise BadInput(f"‹parameter› {name}: {name} {why}; only {', '.join(free)} have profiles.")
    return list(dict.fromkeys(names))


def place(problem: LeastSquares, model: Model, name: str) -> int:
    """Index among the unknowns of a parameter that is the same in all runs."""
    before = itertools.takewhile(lambda parameter: parameter.name != name, model.parameters)
    return int(problem.layout.index[0][sum(parameter.size for parameter in before)])


CLEAR = 3.0
"""Log likelihood ratio, in nats and corrected for correlation, of a clearly likelier hold: odds of 20 to 1."""
SHORTEST = 2e-3
"""Sample time, s, below which half a row is invisible in any vehicle."""
MOST_ROWS = 50_000
"""Rows above which a hold stated by the column map is not tested: the test costs a quarter of a fit."""
ROW = 1 / sqrt(12.0)
"""Standard deviation of an instant that is known to within a row, in rows."""
WORDS: Mapping[str, str] = {"zero": "held between rows", "linear": "interpolated between rows"}


@dataclass(frozen=True)
class Holding:
    """Hold of commands between rows, compared with the other one.

    Attributes
    ----------
    taken : "zero" or "linear", as fitted.
    stated : whether the column map states it.
    gain : log likelihood ratio over the other, nats, corrected for correlated residuals.
    moved : parameter -> its change under the other hold, in its unit.
    late : root of the second moment of the commands' delay relative to the hold taken, in half rows.
    values : (parameters,) optimum of the other hold, the start of its fit if it is likelier.
    """

    taken: Hold
    stated: bool
    gain: float
    moved: Mapping[str, float]
    late: float = 0.0
    values: Array | None = None

    @property
    def doubt(self) -> float:
        """Probability of the other hold, with equal prior probabilities; 0 if the map states it."""
        return 0.0 if self.stated else float(1 / (1 + np.exp(min(self.gain, 700.0))))

    def as_dict(self) -> dict[str, Any]:
        """As plain data, for a fit's `how`."""
        return {"taken": self.taken, "stated": self.stated, "gain": self.gain, "late": self.late}


def other_than(hold: str) -> Hold:
    """The other of the two."""
    return "linear" if hold == "zero" else "zero"


def weighed(fit: Fit, recordings: Sequence[Recording], how: FitOptions) -> Holding | None:
    """Compare the fit's hold with the other; None if it cannot matter, or is not to be tested."""
    model, holds = fit.model, {recording.hold for recording in recordings}
    if not isinstance(model, MotionModel) or len(holds) != 1 or not fit.confirmed or not _matters(model, recordings):
        return None
    stated = all(recording.hold_stated for recording in recordings)
    if stated and (sum(map(len, recordings)) > MOST_ROWS or not all(recording.source.path for recording in recordings)):
        return None
    (taken,) = holds
    simulator = Simulator(model)
    options = replace(
        how, starts=1, solver="gauss-newton", noise=fit.how["counted"]
    )  # one noise, comparable likelihoods
    fit_taken = attempted(simulator, recordings, model.values, options, quiet, model.name, (), TOLERANCE)
    if fit_taken is None or not _ended(fit_taken):
        return None
    noise, taken_model = fit_taken.problem.noise, model.with_values(fit_taken.problem.shared(fit_taken.solution.x))
    gain = -misfit(fit_taken, simulator, recordings, noise, options)
    errors = fit_taken.problem.errors(fit_taken.problem.simulated_nodes(fit_taken.solution.x))
    rows = correlation_time(np.where(np.isfinite(errors), errors, 0.0))
    del fit_taken  # for hours of data, one layout at a time is enough
    others = [with_hold(recording, other_than(taken)) for recording in recordings]
    fit_other = attempted(simulator, others, model.values, options, quiet, model.name, (), TOLERANCE)
    if fit_other is None or not _ended(fit_other):
        return None
    gain, other_model = (
        gain + misfit(fit_other, simulator, others, noise, options),
        model.with_values(fit_other.problem.shared(fit_other.solution.x)),
    )
    del fit_other
    moved = {
        parameter.name: float(other_model[parameter.name].array - parameter.array)
        for parameter in taken_model.parameters
        if parameter.shape == () and not parameter.fixed
    }
    late = _late(errors, errors_at(simulator, others, noise, options, taken_model.values), noise, float(gain), rows)
    return Holding(taken, stated, float(gain / rows), moved, late, other_model.values)


def _late(here: Array, there: Array, noise: Array, gain: float, rows: float) -> float:
    """Root of the second moment of the delay that the errors indicate relative to the hold taken, in half rows.

    Along the delay the objective is a parabola: its slope at the hold taken is that of the errors, by the envelope
    theorem, and the other hold, half a row further, is a second point on it.
    """
    both_read = np.isfinite(here) & np.isfinite(there)
    e, change = (np.where(both_read, item, 0.0) / noise for item in (here, there - here))
    slope = float(np.sum(e * change)) / rows
    bend = max(2 * (gain / rows - slope), 0.0)
    precision = bend + 1 / (2 * ROW) ** 2  # with the prior precision: uniform over a row
    return float(np.hypot(slope / precision, 1 / np.sqrt(precision)))


def _matters(model: MotionModel, recordings: Sequence[Recording]) -> bool:
    """Whether the model has a command that varies, in rows that are far enough apart."""
    names = {alias for name in model.commands for alias in (name, *model.aliases.get(name, ()))}
    varies = any(np.ptp(recording[name]) > 0 for recording in recordings for name in names if name in recording)
    return varies and all(recording.sample_time >= SHORTEST for recording in recordings)


def _ended(attempt: Attempt) -> bool:
    return attempt.solution.status in (Status.CONVERGED, Status.SLOW, Status.STALLED) and bool(
        np.isfinite(attempt.solution.objective)
    )


def in_doubt(fit: Fit, held: Holding, step: float) -> Fit:
    """The fit with the doubt about the hold in its standard deviations, and half a row in those of times.

    Parameters
    ----------
    fit : the fit with the hold taken.
    held : the comparison.
    step : sample time, s.
    """
    share = float(np.hypot(sqrt(held.doubt * (1 - held.doubt)), held.late))
    along = np.concatenate(
        [np.full(parameter.size, held.moved.get(parameter.name, 0.0)) for parameter in fit.model.parameters]
    )
    sd = dict(fit.sd)
    for parameter in fit.model.parameters:
        if parameter.fixed or parameter.name not in held.moved:
            continue
        of_row = ROW * step if parameter.unit == "s" else 0.0
        sd[parameter.name] = np.hypot(sd[parameter.name], max(share * abs(held.moved[parameter.name]), of_row))
    covariance = None if fit.covariance is None else fit.covariance + share**2 * np.outer(along, along)
    if covariance is not None:  # half a row is an independent error of each time: it adds no covariances
        variance_root = np.concatenate(
            [np.broadcast_to(sd.get(p.name, 0.0), p.shape).ravel() for p in fit.model.parameters]
        )
        covariance[np.diag_indices_from(covariance)] = np.maximum(np.diag(covariance), (along != 0) * variance_root**2)
    return replace(fit, sd=sd, covariance=covariance, how={**fit.how, "hold": held.as_dict()})


def reason(fit: Fit, held: Holding) -> Reason | None:
    """A question to the user, if the stated hold is unlikely, or neither is clearly likelier."""
    unlikely = held.stated and held.gain < -CLEAR
    unclear = not held.stated and held.gain < CLEAR
    shares = {n: abs(v) / float(fit.sd[n]) for n, v in held.moved.items() if n in fit.sd and float(fit.sd[n]) > 0}
    most = max(shares, key=lambda name: shares[name], default="")
    if not most or not (unlikely or (unclear and shares[most] >= 1)):  # an unlikely hold has widened its own intervals
        return None
    parameter, what = fit.model[most], " or ".join(getattr(fit.model, "commands", ()))
    moved = with_unit(number(held.moved[most], 2), parameter.unit)
    if unlikely:
        return Reason(
            WITH_CARE,
            f'The column map says hold = "{held.taken}": commands are {WORDS[held.taken]}. With '
            f'hold = "{other_than(held.taken)}" (commands {WORDS[other_than(held.taken)]}), the log-likelihood is '
            f"{-held.gain:.0f} higher and {most} changes by {moved}. Was {what} measured or commanded? "
            "Correct hold if it is wrong.",
        )
    return Reason(
        WITH_CARE,
        f"Was {what} measured or commanded? Neither the column map nor the recording shows it. The fit takes commands "
        f'as {WORDS[held.taken]} (hold = "{held.taken}"). With commands {WORDS[other_than(held.taken)]} '
        f'(hold = "{other_than(held.taken)}"), {most} changes by {moved}. Set hold in the column map.',
    )
