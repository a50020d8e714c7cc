"""Design for precise parameters: by the determinant of their covariance, averaged over what is uncertain.

The covariance follows from the information of a plan on a fit's parameters, in addition to the fit's own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...base.errors import BadInput, near_or_all
from ...base.shorthands import Array, Index, Mask, Say
from ...datasets.recording import Recording
from ...engine.motion.shooting import MotionProblem
from ...engine.motion.simulator import Simulator
from ...fitting.fit import Fit
from ...models.model import Model, must_be
from ...models.motion_model import MotionModel
from ..estimation.axes import scalars
from ..estimation.model_error import amplitude_prior
from .course import PlannedMotion
from .plan import Design
from .scatter import ROUGH_RATE, ExpectedErrors, Rough, sandwich
from .search import PlanSearch
from .task import FARTHEST, DesignTask

DRAWS, AVERAGED = 40, 3
"""Draws of the posterior that must keep to limits; those over which the criterion's median is taken."""
CRITERIA = ("d", "a", "e", "c")
LITTLE = 0.05
"""Relative reduction of a standard deviation that counts as little: twenty such drives would not halve it."""
RIDGE = 1e-12
"""Least eigenvalue of a scaled information matrix, so that directions without information have an inverse."""


def must_move(model: Model, do: str = "Fit") -> MotionModel:
    """The model, if manoeuvres can be designed with it. Raises `BadInput` where it has no equations of motion."""
    none = f"A manoeuvre is designed with equations of motion; {model.name} has none. {do} single_track."
    return must_be(MotionModel, model, none)


def precise(fit: Fit, names: Sequence[str], kind: str, design_task: DesignTask, say: Say) -> Design:
    """The manoeuvre that makes parameters of a fit precise.

    Parameters
    ----------
    fit : of equations of motion.
    names : of the parameters that count; none: all free ones.
    kind : one of `CRITERIA`, see `criterion`.
    design_task : arena, limits and the like.

    Raises
    ------
    BadInput : the model cannot predict manoeuvres, a name is none of its free parameters, or no manoeuvre fits into the
        arena and the limits.
    """
    model, known = must_move(fit.model), known_by(fit)
    target = target_names(fit, known, names)
    samples = draws(fit, known, DRAWS, design_task.seed)

    def worth(plans: Sequence[PlannedMotion], rough: bool) -> list[float]:
        values = [
            [criterion(known.precision + design_task.repeat * one, known, target, kind)
             for one in information.of(plans, p, rough=rough)]
            for p in samples[: 1 if rough else AVERAGED]
        ]  # fmt: skip
        return [float(value) for value in np.median(values, axis=0)]

    search = PlanSearch(design_task, model, [samples], worth)
    information = Information(fit, known, target)
    found_plan = search.best(say)
    after = known.precision + design_task.repeat * information.of([found_plan.plan], samples[0])[0]
    before, then = (criterion(each, known, target, kind) for each in (known.precision, after))
    every = predicted_sd(known, after)
    predicted = {name: every[name] for name in target}
    return search.design(
        "precision", found_plan, criterion={"name": kind, "parameters": list(target), "before": before, "after": then},
        drive=information.drive, predicted_sd=predicted, impossible=_hardly(model, predicted), said=_exact(model),
    )  # fmt: skip


def _exact(model: MotionModel) -> tuple[str, ...]:
    """A sentence that the fit takes its tyre curves as exact, where it does."""
    if model.settings.get("tyre", "linear") == "linear" or "form" in model.settings:
        return ()
    return ("The fit treats its tyre curves as exact; with the setting form=uncertain, sd includes their error.",)


def _hardly(model: MotionModel, known: Mapping[str, tuple[float, float]]) -> tuple[str, ...]:
    """A sentence on parameters of which the manoeuvre informs little."""
    parts = []
    for name, (before, after) in known.items():
        if not np.isfinite(after):
            parts.append(f"no information on {name}, which stays unknown")
        elif np.isfinite(before) and after > (1.0 - LITTLE) * before:
            parts.append(
                f"little information on {name}: its standard deviation falls by {100 * (1 - after / before):.1f} %"
            )
    if not parts:
        return ()
    return (f"Of {model.name}, the best manoeuvre that was found in this arena adds {'; '.join(parts)}.",)


@dataclass(frozen=True)
class Known:
    """Information of a fit on the numbers it estimated.

    Attributes
    ----------
    names : of the free numbers.
    places : (q,) indices in the model's vector.
    precision : (q, q) inverse of their covariance; zero where the fit has no information.
    local : (q,) whether a number has another value in each run, so that a new run's has only its prior.
    """

    names: tuple[str, ...]
    places: Index
    precision: Array
    local: Mask


def known_by(fit: Fit) -> Known:
    """The information of a fit. Raises `BadInput` where it holds no covariance, or none of its numbers is free."""
    model = must_be(MotionModel, fit.model)
    if fit.covariance is None:
        raise BadInput("The fit has no covariance, and a manoeuvre is designed from it. Fit again.")
    free = [(k, one) for k, one in scalars(model) if not one.fixed]
    if not free:
        raise BadInput(f"The fit of {model.name} has no free parameter whose precision a manoeuvre could raise.")
    places, local = np.array([k for k, _ in free]), np.array([one.scope == "run" for _, one in free])
    prior = [0.0 if one.prior is None else max(float(np.asarray(one.prior.sd)), 1e-300) ** -2 for _, one in free]
    C = fit.covariance[np.ix_(places, places)]
    there = np.isfinite(np.diag(C)) & (np.diag(C) > 0) & ~local
    precision = np.diag(np.where(local, prior, 0.0))
    if np.any(there):
        precision[np.ix_(there, there)] = _inverse(C[np.ix_(there, there)])
    return Known(tuple(one.name for _, one in free), places, precision, local)


def target_names(fit: Fit, known: Known, names: Sequence[str]) -> tuple[str, ...]:
    """The parameters whose precision counts: the named ones, else all free ones that new runs share.

    Raises `BadInput` where one of them is not a free number of the fit.
    """
    for name in names:
        if name not in known.names:
            why = (
                f"{name} is fixed in this fit; free it (‹free›) and fit again"
                if name in fit.model
                else f"{fit.model.name} has no parameter {name}.{near_or_all(name, known.names)}"
            )
            raise BadInput(f"‹parameters› {name}: {why.rstrip('.')}.")
    return tuple(dict.fromkeys(names)) or tuple(
        name for name, local in zip(known.names, known.local, strict=True) if not local
    )


class Information:
    """Linearises the fit's own least-squares problem on recordings that plans would give.

    Noise is that of the fit's residuals; beside it, unknown forces act (`scatter`).

    Parameters
    ----------
    fit : the fit; new recordings are assumed to have its noise, horizon and outputs.
    known : its information.
    target : parameters that are not held even in coarse simulations.
    """

    def __init__(self, fit: Fit, known: Known, target: Sequence[str] = ()) -> None:
        self.model, self.known, self.how = must_be(MotionModel, fit.model), known, fit.how
        self.drive = str(self.how.get("inputs", {}).get("drive", self.model.aliases.get("drive", ("drive",))[0]))
        noise = fit.stages[-1].noise if fit.stages else {}
        counted = fit.how.get("counted", noise)
        self.read = tuple(name for name in self.model.outputs if name in noise)
        if not self.read:
            raise BadInput("The fit holds no noise levels. Fit again with this version.")
        self.noise = np.array([counted.get(name, 1.0) for name in self.model.outputs])
        without_priors = [replace(p, prior=None) for p in self.model.parameters]  # `known` holds the priors
        blank = self.model.with_parameters(*without_priors)
        self.rough = Rough(blank, target)
        self.simulator = Simulator(blank)
        self.simulator.kernel.prepare()
        self.rough_simulator = self.simulator.of(self.rough.model)
        self.errors = ExpectedErrors(self.model, amplitude_prior(self.noise, True, False, {}).median)

    def of(self, plans: Sequence[PlannedMotion], p: Array, *, rough: bool = False) -> list[Array]:
        """(q, q) information of each plan on the free numbers, starts of runs free; zero where it is not finite."""
        return [sandwich(H, S) for H, S in zip(*self.scores(plans, p, rough=rough), strict=True)]

    def scores(self, plans: Sequence[PlannedMotion], p: Array, *, rough: bool = False) -> tuple[Array, Array]:
        """Curvature and scatter of each plan's cost by the free numbers.

        Parameters
        ----------
        plans : commands and expected motion; several cost little more than one, as lanes of one simulation.
        p : (parameters,) where to linearise.
        rough : whether to take only some of the rows, and no delays.

        Returns
        -------
        H : (plans, q, q) curvature of the squares as the fit weighs residuals.
        S : (plans, q, q) covariance of their gradient as residuals scatter.
        """
        step = plans[0].time[1] - plans[0].time[0]
        every = max(1, round(1.0 / step / ROUGH_RATE)) if rough else 1
        p, simulator = (self.rough.of(p), self.rough_simulator) if rough else (p, self.simulator)
        recordings = [self.recording(plan, every) for plan in plans]
        problem = MotionProblem(
            simulator, recordings, noise=self.noise / np.sqrt(every), horizon=self.how.get("horizon"),
            starts=self.how.get("start_from", "free"), about=p,
        )  # fmt: skip
        x = problem.unknowns(p)
        nodes, q = problem.simulated_nodes(x), len(self.known.places)
        H, G = np.zeros((len(plans), q, q)), np.zeros((*problem.target.shape, q))
        loose = problem.free.copy()
        loose[np.concatenate(problem.parameters.index)] = False
        linearised = zip(problem.rows_of_intervals(nodes), problem.residuals(x, nodes), strict=True)
        for k, (rows, (_, J)) in enumerate(linearised):
            run, unknowns = problem.intervals[k].run, problem.layout.index[k]
            index = problem.parameters.index[run][self.known.places]
            places = np.array([np.flatnonzero(unknowns == place)[0] for place in index])
            by, by_start = J[:, :, places], J[:, :, np.flatnonzero(loose[unknowns])]
            flat = by_start.reshape(-1, by_start.shape[2])
            if flat.shape[1]:  # starts of predictions are nuisances, known by noisy readings alone
                starts = unknowns[loose[unknowns]]
                inner = flat.T @ flat + problem.prior_curvature[np.ix_(starts, starts)]
                pull = np.linalg.pinv(inner, rcond=1e-10, hermitian=True) @ (flat.T @ by.reshape(-1, q))
                by = by - (flat @ pull).reshape(by.shape)
            H[run] += by.reshape(-1, q).T @ by.reshape(-1, q)
            G[rows] += by * problem.weight[rows][:, :, None]
        each = np.repeat(np.arange(len(plans)), [len(recording) for recording in recordings])
        lost = ~np.all(np.isfinite(H), axis=(1, 2))
        lost[each[~np.all(np.isfinite(G), axis=(1, 2))]] = True
        H[lost], G[lost[each]] = 0.0, 0.0
        begun = [np.array([one.start for one in problem.intervals if one.run == k]) for k in range(len(plans))]
        return H, H + self.errors.scatter(recordings, p, G, begun)

    def recording(self, plan: PlannedMotion, every: int = 1) -> Recording:
        """The recording that a plan is expected to give, without noise; one row of `every`."""
        signals = {"steer": plan.steer, self.drive: plan.drive}
        for name in self.read:
            signals[name] = plan.of(name) if name in ("v_x", "v_y", "yaw_rate", "a_y") else np.zeros(len(plan.time))
        return Recording("plan", plan.time[::every], {name: values[::every] for name, values in signals.items()})


def criterion(precision: Array, known: Known, target: Sequence[str], kind: str) -> float:
    """Value of a precision for the target numbers, more is better.

    Parameters
    ----------
    precision : (q, q) of all free numbers.
    target : those that count; all others are nuisances (Schur complement).
    kind : "d": minus the log-determinant of their covariance; "a": minus the log of the mean relative variance; "e":
        minus that of the largest relative variance of any combination; "c": minus that of the first one's variance.

    Notes
    -----
    Source: Atkinson, Donev & Tobias, Optimum Experimental Designs, with SAS, 2007, ch. 10.
    """
    C = _inverse(precision)
    at = [known.names.index(name) for name in target]
    block = C[np.ix_(at, at)]
    if not np.all(np.isfinite(block)):
        return -np.inf
    if kind == "d":
        sign, value = np.linalg.slogdet(block)
        return -float(value) if sign > 0 else -np.inf
    if kind == "c":
        return -float(np.log(max(block[0, 0], 1e-300)))
    before = np.sqrt(np.diag(_inverse(known.precision))[at])
    scale = np.where(np.isfinite(before), np.maximum(before, 1e-150), 1.0)
    relative = block / np.outer(scale, scale)
    value = np.mean(np.diag(relative)) if kind == "a" else np.max(np.linalg.eigvalsh(relative))
    return -float(np.log(max(float(value), 1e-300)))


def draws(fit: Fit, known: Known, count: int, seed: int) -> Array:
    """(count, parameters) draws of the model's vector from the fit's Laplace posterior, in bounds; the estimate first.

    Draws beyond bounds are set to them, draws beyond `FARTHEST` to that distance.
    """
    rng = np.random.default_rng((seed, 2311))
    model = fit.model
    result = np.tile(model.values, (count, 1))
    assert fit.covariance is not None
    places = known.places
    C = fit.covariance[np.ix_(places, places)]
    sd = np.sqrt(np.maximum(np.nan_to_num(np.diag(C), posinf=0.0), 0.0))
    there = np.flatnonzero(sd > 0)
    if len(there) == 0 or count < 2:
        return result
    R = C[np.ix_(there, there)] / np.outer(sd[there], sd[there])
    variances, vector = np.linalg.eigh(0.5 * (R + R.T))
    root = vector * np.sqrt(np.maximum(variances, 0.0))
    z = np.clip(rng.standard_normal((count - 1, len(there))), -FARTHEST, FARTHEST) @ root.T
    result[1:, places[there]] += np.clip(z, -FARTHEST, FARTHEST) * sd[there]
    for name, place in zip(known.names, places, strict=True):
        low, high = model[name].bounds
        value_ = float(model[name].array)
        lowest = max(low, 0.3 * value_) if value_ > 0 and low >= 0 else low
        result[:, place] = np.clip(result[:, place], lowest, high)
    return result


def predicted_sd(known: Known, precision: Array) -> dict[str, tuple[float, float]]:
    """Name -> standard deviation before and after; infinite where there is no information."""
    before, after = (np.sqrt(np.diag(_inverse(item))).tolist() for item in (known.precision, precision))
    both = zip(before, after, strict=True)
    return {name: sds for name, sds, local in zip(known.names, both, known.local, strict=True) if not local}


def _inverse(matrix: Array) -> Array:
    """Inverse of a positive semidefinite matrix, scaled to a unit diagonal; infinite variance without information."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    there = scale > 0
    result = np.full_like(matrix, 0.0)
    result[np.diag_indices_from(result)] = np.inf
    if np.any(there):
        inner = matrix[np.ix_(there, there)] / np.outer(scale[there], scale[there])
        eigenvalues, vector = np.linalg.eigh(0.5 * (inner + inner.T))
        inverse = (vector / np.maximum(eigenvalues, RIDGE)) @ vector.T
        result[np.ix_(there, there)] = inverse / np.outer(scale[there], scale[there])
    return result
