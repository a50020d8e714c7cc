"""Ways of adapting a model with memory to a short recording, compared by blocked cross-validation on it alone.

Everything is linearised once at the fit: a fold's fit is then the solution of a linear system, and comparing forty
candidates on eight folds costs less than one step of a fit. Also: sets of parameters to free in an adaptation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import lapack
from scipy.special import stdtrit

from ...base.errors import BadInput, near
from ...base.shorthands import Array, Index
from ...datasets.recording import Recording
from ...engine.least_squares import NormalEquations, prior_rows
from ...engine.shooting import Nodes, Problem
from ...engine.trace import Trace
from ...models.effects import EFFECTS
from ...models.memory_model import MemoryModel
from ...models.parameter import Parameter, Prior
from ..scores.memory import predictions
from ..scores.timing import moving

FEW = {"steering_ratio": ("yaw_rate", 0.1), "steering_offset": ("yaw_rate", 0.02), "motor_gain": ("a_x", 0.2)}
"""Effects that represent the changes of a car between two days: the output that identifies each, and its prior's
standard deviation around no change, in the effect's unit."""
RESPONSES = ("F", "F_y", "F_v", "F_t", "F_b")
"""Impulse responses of the networks."""
PAPER = (*RESPONSES[:1], "G_1t", "b_1t", "G_2t", "G_1b", "b_1b", "G_2b", "m")
"""Parameters that Mungiello et al. report to have tuned: the impulse responses of the lateral network, the actuation
network and the mass of the longitudinal one."""
SUBSETS = ("F", "few", "paper", "physical", "all")
"""Names of sets of parameters."""
COMPARED = ("few", "F", "all")
"""Sets that are compared by default, the fewest parameters first."""
ADAPTING = "adaptation"
"""Name of the strength of all priors in an adaptation."""
PHYSICAL_SD = 0.1
"""Prior standard deviation of an adapted parameter that had no prior, as a share of its size."""


def part_with_few(part: MemoryModel) -> MemoryModel:
    """A part with those effects of `FEW` that its outputs identify, at no change; effects it already has are kept."""
    for name, (output, sd) in FEW.items():
        effect = EFFECTS[name]
        if output in part.outputs and name not in part and effect.concerns(part):
            part = part + effect
            effect_parameter = part[name]
            part = part.with_parameters(
                replace(
                    effect_parameter,
                    value=float(effect_parameter.null or 0.0),
                    prior=Prior(sd, mean=float(effect_parameter.null or 0.0)),
                )
            )
    return part


def about_itself(part: MemoryModel) -> MemoryModel:
    """The same model with all prior means at its present values, so that priors penalise changes.

    Shapes of priors stay: impulse responses change smoothly, and most at the newest samples. Run-scoped parameters are
    fixed and become model-scoped, and no run is mirrored: a changed car may pull to one side.
    """
    return replace(
        part.with_parameters(*(_about_itself(parameter, part) for parameter in part.parameters)), symmetric=False
    )


def _about_itself(parameter: Parameter, part: MemoryModel) -> Parameter:
    if parameter.scope == "run" or (parameter.name in part.effects and parameter.name not in FEW):
        return replace(parameter, scope="model", fixed=True)
    parameter = replace(parameter, fixed=False)  # the closed loop of a coupled model fixes some
    if parameter.prior is None:
        return replace(
            parameter, prior=Prior(PHYSICAL_SD * abs(parameter.array) + 1e-6, mean=parameter.array, strength=ADAPTING)
        )
    return replace(parameter, prior=replace(parameter.prior, mean=parameter.array, strength=ADAPTING))


def members(subset: str, part: MemoryModel) -> tuple[str, ...]:
    """Names of a part's parameters that belong to a set; empty if there are none."""
    free = [parameter for parameter in part.parameters if not parameter.fixed]
    words = {
        "F": [item.name for item in free if item.name in RESPONSES],
        "few": [item.name for item in free if item.name in FEW],
        "paper": [item.name for item in free if item.name in PAPER],
        "physical": [item.name for item in free if item.shape == () and item.name not in FEW],
        "all": [item.name for item in free if item.name not in FEW],
    }
    result: list[str] = []
    for word in subset.split(","):
        word = word.strip()
        result += words.get(word, [one.name for one in free if one.name == word or one.name.startswith(f"{word}_")])
    return tuple(dict.fromkeys(result))


def must_name_something(subset: str, parts: Sequence[MemoryModel]) -> None:
    """Raise `BadInput` for a name that is neither a set nor a parameter of any part."""
    for word in subset.split(","):
        if not any(members(word, part) for part in parts):
            known = [
                "auto",
                *SUBSETS,
                *(parameter.name for part in parts for parameter in part.parameters if not parameter.fixed),
            ]
            raise BadInput(
                f"‹free›: {word.strip()!r} is neither a set of parameters nor a parameter of this fit; use auto, "
                f"{', '.join(SUBSETS)} and names of parameters.{near(word.strip(), known)}"
            )


def learnt(
    part: MemoryModel, noise: Mapping[str, float], sd: Mapping[str, Array], trained: Sequence[Recording] | None
) -> Array:
    """Precision of a part's parameters from its training data alone, (parameters, parameters), around its values.

    It is the Gauss-Newton Hessian of the training data's sum of squares. Without the data it is diagonal, from the
    fit's standard deviations. For the effects in `FEW` it is zero: the old data do not inform on changes of the car.
    """
    few = np.concatenate([np.full(parameter.size, parameter.name in FEW) for parameter in part.parameters])
    if trained is None:
        spread = np.concatenate(
            [np.broadcast_to(sd.get(parameter.name, np.inf), parameter.shape).ravel() for parameter in part.parameters]
        ).astype(float)
        usable = np.isfinite(spread) & (spread > 0) & ~few
        return np.diag(np.where(usable, 1.0 / np.where(usable, spread, 1.0) ** 2, 0.0))
    problem = Problem(Trace(part), trained, noise=np.array([noise[name] for name in part.outputs]))
    J = np.concatenate([item for _, item in problem.residuals(problem.start, [])]).reshape(-1, len(few))
    J[:, few] = 0.0
    return np.asarray(J.T @ J)


class Held(Problem):
    """A problem with a quadratic penalty on deviations from a point, from earlier training.

    Parameters
    ----------
    part, recording, noise : as in `Problem`.
    precision : (parameters, parameters) of the penalty, around the part's values.
    """

    def __init__(self, part: MemoryModel, recording: Recording, noise: Array, precision: Array) -> None:
        super().__init__(Trace(part), [recording], noise=noise)
        self._precision, self._about = precision, part.values

    def objective(self, x: Array, nodes: Nodes) -> float:
        """Half the sum of squares, penalty included."""
        away = x - self._about
        return super().objective(x, nodes) + 0.5 * float(away @ self._precision @ away)

    def normal_equations(self, x: Array, nodes: Nodes) -> NormalEquations:
        """Normal equations, penalty included."""
        value = super().normal_equations(x, nodes)
        free = self.free.astype(float)
        precision = self._precision * np.outer(free, free)
        return NormalEquations(value.H + precision, value.g + precision @ (x - self._about))


STRENGTHS = (1.0, 0.5, 0.2)
"""Weights of the old recording relative to the new one, as factors on its inverse standard deviations: at one, a second
of it counts as much as a new second. The unchanged fit, with an infinite weight, is always a candidate."""
FOLD, GAP, SHORT = 5.0, 1.0, 1.0
"""Seconds held out at a time, dropped on both sides of them, and averaged into one piece for comparing candidates."""
CONFIDENCE = 0.95
BETWEEN_RUNS = 0.25
"""Standard deviation of the logarithm of an error between runs of one car and driver: the scatter of the four runs of
the RoboRacer's training recording, with errors of 0.089, 0.080, 0.056 and 0.055 rad/s under their own network."""
TOLD_BY = 3
"""Degrees of freedom of this value when it is combined with a fit's own training runs: it comes from four runs."""


@dataclass(frozen=True)
class AdaptedCandidate:
    """One way of adapting a part.

    Attributes
    ----------
    free : the set of free parameters; "" for none.
    strength : weight of the training data, one of `STRENGTHS`; infinite if nothing is free.
    timing : whether readings are aligned first.
    pieces : (pieces,) cross-validated mean square over pieces of the new seconds, in noise variances.
    """

    free: str
    strength: float
    timing: bool
    pieces: Array

    @property
    def error(self) -> float:
        """Cross-validated error, in noise standard deviations."""
        return float(np.sqrt(np.mean(self.pieces)))

    @property
    def words(self) -> str:
        """The candidate in words."""
        named = [
            *(["timing"] if self.timing else []),
            *([f"{self.free} (strength {self.strength:g})"] if self.free else []),
        ]
        return " + ".join(named) or "zero-shot"


class LinearisedPart:
    """A part, linearised at its values on the new seconds.

    Parameters
    ----------
    part : the part, with prior means at its values.
    recording : its new seconds; rows without readings are dropped.
    noise : output -> standard deviation by which residuals are divided.
    learnt : (parameters, parameters) precision of the part's parameters from the training data.
    """

    def __init__(self, part: MemoryModel, recording: Recording, noise: Mapping[str, float], learnt: Array) -> None:
        self.part, self.recording, self.learnt = part, recording, learnt
        self.problem = Problem(Trace(part), [recording], noise=np.array([noise[name] for name in part.outputs]))
        linearised = list(self.problem.residuals(self.problem.start, []))
        self.r = np.concatenate([item for item, _ in linearised])
        self.J = np.concatenate([item for _, item in linearised])
        first = [run.rows.start + run.first for run in self.problem.runs]
        self.rows = np.concatenate(
            [start + np.arange(len(item)) for start, (item, _) in zip(first, linearised, strict=True)]
        )
        starts = [start for start, _ in recording.runs]
        self.run = np.searchsorted(starts, self.rows, side="right") - 1
        rows_per_second = 1.0 / part.sample_time
        self.fold, self.piece = (self._cut(starts, round(seconds * rows_per_second)) for seconds in (FOLD, SHORT))
        self.gap = round(GAP * rows_per_second)

    def _cut(self, starts: Sequence[int], length: int) -> Index:
        """Number of the stretch of `length` rows that each row lies in, counted within runs."""
        key = self.run * 10**6 + (self.rows - np.array(starts)[self.run]) // max(1, length)
        return np.asarray(np.unique(key, return_inverse=True)[1])

    def mask(self, free: str) -> Array:
        """(parameters,) whether a parameter belongs to a set."""
        names = members(free, self.part) if free else ()
        return np.concatenate([np.full(parameter.size, parameter.name in names) for parameter in self.part.parameters])

    def candidates(self, free: str, timing: bool) -> list[AdaptedCandidate]:
        """Every strength of a set, cross-validated; the unchanged fit for the empty set."""
        moving = self.mask(free)
        if not np.any(moving):
            return [] if free else [AdaptedCandidate("", np.inf, timing, self._pieces(self.r))]
        J = self.J[:, :, moving]
        R = prior_rows(self.part.parameters)[0].toarray()[:, moving]
        prior_precision, precision = R.T @ R, self.learnt[np.ix_(moving, moving)]
        predicted = {strength: self.r.copy() for strength in STRENGTHS}
        for fold in range(int(self.fold.max()) + 1):
            held_out = self.fold == fold
            low, high = self.rows[held_out].min(), self.rows[held_out].max()
            near = (self.rows >= low - self.gap) & (self.rows <= high + self.gap) & (self.run == self.run[held_out][0])
            A, b = J[~near].reshape(-1, J.shape[2]), self.r[~near].ravel()
            H, g = A.T @ A, A.T @ b
            for strength, residuals in predicted.items():
                residuals[held_out] += J[held_out] @ -_solved(H + prior_precision + strength**2 * precision, g)
        return [
            AdaptedCandidate(free, strength, timing, self._pieces(residuals))
            for strength, residuals in predicted.items()
        ]

    def _pieces(self, residuals: Array) -> Array:
        square = np.mean(residuals**2, axis=1)
        return np.bincount(self.piece, square) / np.bincount(self.piece)


def _solved(H: Array, b: Array) -> Array:
    unit = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    _, result, failed = lapack.dposv(H * np.outer(unit, unit) + 1e-12 * np.eye(len(H)), unit * b)
    return np.asarray(unit * result) if not failed else np.zeros_like(b)


def chosen(candidates: Sequence[AdaptedCandidate]) -> AdaptedCandidate:
    """The best candidate, or the simplest one that is not significantly worse; candidates are in order of simplicity.

    Simpler candidates have fewer free parameters or, for the same set, a larger weight of the training data. A simpler
    one is preferred if the mean difference of its pieces to the best is within its standard error.
    """
    best = min(candidates, key=lambda item: float(np.mean(item.pieces)))
    return next(
        candidate for candidate in candidates if candidate is best or not surely_better(best.pieces, candidate.pieces)
    )


def surely_better(new: Array, old: Array) -> bool:
    """Whether the mean over pieces falls by more than the standard error of the paired difference."""
    if len(new) != len(old):
        return bool(np.mean(new) < np.mean(old))
    gain = old - new
    return bool(np.mean(gain) > np.std(gain, ddof=1) / np.sqrt(len(gain))) if len(gain) > 1 else False


def between_runs(part: MemoryModel, trained: Sequence[Recording] | None) -> float:
    """Standard deviation of the logarithm of an error between runs, from the training runs and `BETWEEN_RUNS`."""
    logs = []
    for recording in trained or ():
        prediction = predictions(part, recording)
        driven = moving(recording)[prediction.rows] > 0
        for run in np.unique(prediction.run):
            rows = driven & (prediction.run == run)
            if np.count_nonzero(rows) * recording.sample_time >= FOLD:
                logs.append(
                    0.5
                    * np.log(max(float(np.mean((prediction.predicted[rows] - prediction.measured[rows]) ** 2)), 1e-300))
                )
    if len(logs) < 2:
        return BETWEEN_RUNS
    sum_of_squares = TOLD_BY * BETWEEN_RUNS**2 + float(np.sum((np.array(logs) - np.mean(logs)) ** 2))
    return float(np.sqrt(sum_of_squares / (TOLD_BY + len(logs) - 1)))


def foretold(pieces: Array, seconds: float, unit: float = 1.0, between: float = BETWEEN_RUNS) -> tuple[float, float]:
    """95 % interval of the root mean square error over `seconds` of further driving, in `unit`, from known pieces.

    Mean squares scatter around a mean that is itself uncertain, and the further driving may be another run: Student's t
    in the logarithm. The known run and the further one each deviate from the usual by `between`.
    """
    length = round(FOLD / 2 / SHORT)
    count = len(pieces) // length
    if count < 2:
        return 0.0, np.inf
    means = pieces[: count * length].reshape(count, length).mean(axis=1)
    spread = float(np.std(np.log(np.maximum(means, 1e-300)), ddof=1))
    ahead = max(seconds / (length * SHORT), 1.0)
    reach = float(stdtrit(count - 1, 0.5 + CONFIDENCE / 2))
    reach *= np.sqrt(spread**2 * (1 / count + 1 / ahead) + 2 * (2 * between) ** 2)
    middle = float(np.mean(means))
    return unit * float(np.sqrt(middle * np.exp(-reach))), unit * float(np.sqrt(middle * np.exp(reach)))
