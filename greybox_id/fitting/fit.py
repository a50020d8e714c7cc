"""A fit: a model with its estimates, combinations of them and their uncertainty, metrics, provenance, and its verdict.

Saved as JSON; `saved_fit.py` reads it back.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal, get_args

import numpy as np
from scipy import special

from ..base.declared import understood
from ..base.files import write_atomically
from ..base.json_data import Kind
from ..base.shorthands import Array
from ..base.version import __version__
from ..models.model import Combination, Model
from ..models.parameter import Parameter, Prior, free_places
from .provenance import DataRecord, Stage

Usability = Literal["usable", "usable with care", "not usable"]
USABILITIES: tuple[Usability, ...] = get_args(Usability)
"""Best first."""
USABLE, WITH_CARE, NOT_USABLE = USABILITIES


@dataclass(frozen=True)
class Verdict:
    """Whether a fit is usable, and why.

    Attributes
    ----------
    usability : "usable", "usable with care" or "not usable".
    reasons : short sentences, the gravest first; for a usable fit, reasons in its favour.
    comparison : role or recording -> horizon -> output -> {rmse, fit_percent, fvu, persistence, unfitted}: errors of
        the fit, of persistence and of the model before the fit. fit_percent is
        100 (1 - rmse / standard deviation of the readings); comparisons that were not made are missing.
    """

    usability: Usability
    reasons: tuple[str, ...]
    comparison: Mapping[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """The verdict as plain data."""
        return {"verdict": self.usability, "reasons": list(self.reasons), "comparison": dict(self.comparison)}


def verdict_from(body: Mapping[str, Any]) -> Verdict | None:
    """A verdict from the result of `Verdict.as_dict`; None without one. Raises `ValueError` for an unknown one."""
    word = body.get("verdict")
    if word is None:
        return None
    if word not in USABILITIES:
        raise ValueError(f"its verdict {word!r} is not one of {', '.join(USABILITIES)}")
    return Verdict(word, tuple(str(item) for item in body.get("reasons", ())), dict(body.get("comparison") or {}))


@dataclass(frozen=True)
class Reason:
    """A reason for or against a fit, and the best verdict that it permits."""

    at_best: Usability
    sentence: str


def with_reason(verdict: Verdict, reason: Reason | None) -> Verdict:
    """The verdict with one more reason against it."""
    if reason is None:
        return verdict
    worse = USABILITIES.index(reason.at_best) >= USABILITIES.index(verdict.usability)
    kept = verdict.reasons if verdict.usability != USABLE else ()
    reasons = (reason.sentence, *kept) if worse else (*kept, reason.sentence)
    return Verdict(reason.at_best if worse else verdict.usability, reasons, verdict.comparison)


def weighed(reasons: Sequence[Reason], comparison: Mapping[str, Any]) -> Verdict:
    """The verdict that the gravest reason permits; reasons in favour are kept only for a usable fit."""
    worst = max((USABILITIES.index(reason.at_best) for reason in reasons), default=0)
    against = sorted(
        (reason for reason in reasons if reason.at_best != USABLE), key=lambda item: -USABILITIES.index(item.at_best)
    )
    kept = against or list(reasons)
    return Verdict(USABILITIES[worst], tuple(dict.fromkeys(item.sentence for item in kept)), comparison)


CONFIDENCE, Z = 0.975, 1.959963984540054
"""Upper quantile of a two-sided 95 % interval, and its distance in standard deviations when these are known."""


@dataclass(frozen=True)
class Combined:
    """The estimate of a combination of parameters: value, standard deviation and 95 % interval, in its unit."""

    name: str
    unit: str
    value: float
    sd: float
    low: float
    high: float
    about: str


def reach(dof: Array | float, quantile: float = CONFIDENCE) -> Array:
    """Half-width of an interval in standard deviations, for an upper quantile, by Student's t."""
    dof = np.asarray(dof, dtype=float)
    finite = np.isfinite(dof)
    normal = Z if quantile == CONFIDENCE else float(special.ndtri(quantile))
    return np.where(finite, special.stdtrit(np.where(finite, np.maximum(dof, 1.0), 1.0), quantile), normal)


def combined(combination: Combination, model: Model, covariance: Array, dof: Mapping[str, Array]) -> Combined:
    """Estimate a combination to first order, from its derivatives and the parameters' covariance.

    Parameters
    ----------
    combination : the combination.
    model : the model, at its estimates.
    covariance : (parameters, parameters) of its parameter vector.
    dof : name -> degrees of freedom of its standard deviation.
    """
    values = {p.name: float(p.array) for p in model.parameters if p.shape == ()}
    value = float(combination.of(SimpleNamespace(**values)))
    gradient, dof_of = np.zeros(model.size), np.full(model.size, np.inf)
    for name, k in free_places(model.parameters).items():
        if np.isfinite(values[name]):
            step = 1e-6 * max(abs(values[name]), 1e-3)
            up, down = (SimpleNamespace(**{**values, name: values[name] + sign * step}) for sign in (1, -1))
            gradient[k] = (float(combination.of(up)) - float(combination.of(down))) / (2 * step)
            dof_of[k] = float(np.min(dof.get(name, np.asarray(np.inf))))
    involved = np.flatnonzero(gradient)
    variance = float(gradient[involved] @ covariance[np.ix_(involved, involved)] @ gradient[involved])
    shares = gradient * (covariance @ gradient)
    sd = float(np.sqrt(max(variance, 0.0))) if np.isfinite(variance) else np.inf
    half = float(reach(_welch(shares[involved], dof_of[involved]))) * sd
    return Combined(combination.name, combination.unit, value, sd, value - half, value + half, combination.about)


def _welch(shares: Array, dof: Array) -> float:
    """Degrees of freedom of a sum of variance estimates (Welch & Satterthwaite)."""
    weights = np.abs(shares)
    slack = float(np.sum(weights**2 / dof))
    return float(np.sum(weights)) ** 2 / slack if slack > 0 else np.inf


KIND = Kind("greybox-fit", 2, "a fit", "greybox fit", "fit again")
MOST_COVARIANCES = 200
"""Largest number of parameters whose covariance is written into a file."""
DOMINATED, SURPRISING = 0.7, 3.0
"""Posterior standard deviation, as a share of the prior's, above which the prior dominates; distance from the prior
mean, in prior standard deviations, beyond which the estimate conflicts with the prior."""
CLEARLY = 10.0
"""Log likelihood ratio that other parameters in a later part of the data must reach to be reported."""
EIGHTHS = {2: "quarter", 3: "three eighths", 4: "half", 5: "five eighths", 6: "three quarters"}
"""Names of the first part of the data, by its number of eighths."""
FREE_RUN = "free run"
"""The protocol by which every model that can simulate itself is scored."""
UNDETERMINED = 0.5
"""Largest relative standard deviation of a positive parameter that counts as determined."""


@dataclass(frozen=True)
class Fit:
    """Result of fitting.

    Attributes
    ----------
    model : the model, at its estimates.
    sd : name -> standard deviation of every entry, in the parameter's unit, corrected for correlated residuals.
    dof : name -> degrees of freedom of every entry's standard deviation; missing if there are plenty.
    covariance : (parameters, parameters) of the model's parameter vector; None if it was not kept.
    per_run : name -> (runs, ...) estimates of run-scoped parameters on the training runs.
    stages : the steps of the fit.
    metrics : "train" and "validate" -> protocol -> output -> {rmse, rmse_sd, fvu, samples}.
    data : recordings used.
    mode : "cross-validation", "early stopping" or "given": how the strength of regularisation was chosen.
    seed : seed of all random numbers.
    how : horizon and further options of the problem that was solved, for setting it up again.
    command : command that reproduces the fit.
    version : version of greybox-id.
    verdict : whether the fit is usable, and why; None if it was not judged.
    """

    model: Model
    sd: Mapping[str, Array]
    stages: tuple[Stage, ...]
    metrics: Mapping[str, Any]
    data: tuple[DataRecord, ...]
    mode: str
    seed: int
    per_run: Mapping[str, Array] = field(default_factory=dict)
    dof: Mapping[str, Array] = field(default_factory=dict)
    covariance: Array | None = None
    how: Mapping[str, Any] = field(default_factory=dict)
    command: str = ""
    version: str = __version__
    verdict: Verdict | None = None

    @property
    def confirmed(self) -> bool:
        """Whether the fit ended at an optimum; an imported fit, without stages, counts as such."""
        return not self.stages or self.stages[-1].confirmed

    def interval(self, name: str) -> tuple[Array, Array]:
        """95 % interval of every entry of a parameter, clipped to its bounds; NaN if it is fixed."""
        parameter = self.model[name]
        sd = np.asarray(self.sd.get(name, np.full(parameter.shape, np.nan)))
        if parameter.fixed:
            sd = np.full(parameter.shape, np.nan)
        half = reach(self.dof.get(name, np.inf)) * sd
        low, high = parameter.bounds
        with np.errstate(invalid="ignore"):  # an effect at its infinite null has no interval
            return np.maximum(parameter.array - half, low), np.minimum(parameter.array + half, high)

    def combined(self) -> list[Combined]:
        """Estimates of the model's combinations of parameters."""
        if self.covariance is None:
            return []
        known = [combined(each, self.model, self.covariance, self.dof) for each in self.model.combinations]
        return [replace(each, about="; ".join([each.about, *self._scaled(each.name)])) for each in known]

    def _scaled(self, name: str) -> list[str]:
        """A note if a parameter is proportional to a stated one."""
        return [
            f"proportional to {stated}: valid only for the stated {stated}"
            for stated, of in self.how.get("scaling", {}).items()
            if name in of
        ]

    def notes(self) -> dict[str, str]:
        """Remarks on single parameters: fixed, at a bound, or weakly identifiable."""
        result = {}
        for parameter in self.model.parameters:
            sd = self.sd.get(parameter.name)
            if parameter.fixed:
                result[parameter.name] = "held"
            elif parameter.shape == () and sd is not None:
                value, (low, high) = float(parameter.array), parameter.bounds
                if value <= low or value >= high:
                    result[parameter.name] = "at its bound"
                elif np.isnan(sd):
                    result[parameter.name] = "no interval: the optimum is not confirmed"
                elif parameter.prior is not None:
                    result |= _against_prior(parameter, parameter.prior, float(sd))
                elif not np.isfinite(sd):
                    result[parameter.name] = "not determined by this recording"
                elif low >= 0 and parameter.name not in self.model.effects and sd > UNDETERMINED * value:
                    result[parameter.name] = f"not determined by this recording (sd {100 * float(sd) / value:.0f} %)"
                if known := [note for note in (result.get(parameter.name), *self._scaled(parameter.name)) if note]:
                    result[parameter.name] = "; ".join(known)
        return result

    @property
    def from_prior(self) -> tuple[str, ...]:
        """Estimates dominated by their prior: their standard deviation is hardly smaller than the prior's."""
        return tuple(
            p.name
            for p in self.model.parameters
            if p.shape == () and not p.fixed and p.prior is not None and p.name in self.sd
            and float(self.sd[p.name]) > DOMINATED * float(np.max(np.asarray(p.prior.sd)))
        )  # fmt: skip

    def as_dict(self) -> dict[str, Any]:
        """The fit as plain data for JSON."""
        return {
            "version": self.version,
            "command": self.command,
            "mode": self.mode,
            "seed": self.seed,
            "model": {
                "name": self.model.name,
                "settings": dict(self.model.settings),
                "effects": {name: float(self.model[name].array) for name in self.model.effects},
                **_origins_as_dict(self.model),
            },
            "parameters": {
                p.name: {
                    "unit": p.unit,
                    "value": p.array.tolist(),
                    "sd": np.asarray(self.sd.get(p.name, np.zeros(p.shape))).tolist(),
                    **({"dof": np.asarray(self.dof[p.name]).tolist()} if p.name in self.dof else {}),
                    "interval": None if p.fixed else [end.tolist() for end in self.interval(p.name)],
                    "fixed": p.fixed,
                    "scope": p.scope,
                    "bounds": list(p.bounds),
                    "prior": _prior_as_dict(p),
                    "about": p.about,
                }
                for p in self.model.parameters
            },
            "combinations": [asdict(combination) for combination in self.combined()],
            "covariance": _covariance_as_dict(self),
            "how": dict(self.how),
            "per_run": {name: np.asarray(values).tolist() for name, values in self.per_run.items()},
            "notes": self.notes(),
            "together": list(self.model.together),
            "stages": [asdict(stage) for stage in self.stages],
            "metrics": dict(self.metrics),
            "data": [asdict(record) for record in self.data],
            **({} if self.verdict is None else self.verdict.as_dict()),
        }

    @understood
    def save(self, path: str | Path) -> Path:
        """Write the fit as JSON, atomically: an existing file is replaced whole or not at all."""
        return write_atomically(Path(path), KIND.text(self.as_dict()))


def _origins_as_dict(model: Model) -> dict[str, Any]:
    """Origins of equations that greybox-id does not ship; empty if there are none."""
    value = model.origin
    result = {**model.origins, **({model.name: value} if value is not None else {})}
    return {"origins": {name: asdict(origin) for name, origin in result.items()}} if result else {}


def _prior_as_dict(parameter: Parameter) -> dict[str, Any] | None:
    if parameter.prior is None or parameter.shape != ():
        return None
    prior = parameter.prior
    mean = parameter.array if prior.mean is None else np.asarray(prior.mean)
    return {"sd": float(np.asarray(prior.sd)), "mean": float(mean), "strength": prior.strength}


def _covariance_as_dict(fit: Fit) -> dict[str, Any] | None:
    """The covariance of the free parameters, by name; that of networks is omitted for its size."""
    if fit.covariance is None:
        return None
    free = free_places(fit.model.parameters)
    if len(free) > MOST_COVARIANCES:
        return None
    places = [*free.values()]
    return {"names": [*free], "matrix": fit.covariance[np.ix_(places, places)].tolist()}


def _against_prior(parameter: Parameter, prior: Prior, sd: float) -> dict[str, str]:
    """A remark on a parameter that its prior dominates, or that conflicts with it."""
    spread = float(np.max(np.asarray(prior.sd)))
    away = 0.0 if prior.mean is None else abs(float(parameter.array) - float(np.asarray(prior.mean))) / spread
    if away > SURPRISING:
        return {parameter.name: f"conflicts with the prior ({away:.1f} sd): suspect the model structure"}
    return {parameter.name: "weakly identifiable; dominated by the prior"} if sd > DOMINATED * spread else {}


def conflict(fitted: Model) -> float:
    """Factor by which intervals widen if estimates conflict with stated values.

    A stated value is then off by more than its standard deviation, and it is unknown which: all are assumed uncertain
    by a common factor under which they agree (Birge, The Calculation of Errors by the Method of Least Squares, Phys.
    Rev. 40, 1932; the scale factor of the Particle Data Group's averages).
    """
    distances = [
        float((p.array - np.asarray(p.prior.mean)) / np.max(np.asarray(p.prior.sd)))
        for p in fitted.parameters
        if p.shape == () and not p.fixed and p.prior is not None and p.prior.mean is not None
    ]
    if not distances or max(map(abs, distances)) < SURPRISING:
        return 1.0
    return max(1.0, float(np.sqrt(np.mean(np.square(distances)))))
