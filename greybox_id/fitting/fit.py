"""A fit: a model with its estimates, their uncertainty, metrics, solver record and provenance.

Saved as JSON and loaded again without running code from the file: the file names the model and its settings,
the caller hands in the function that builds models by name.

Combinations of parameters as a fit tells them, and how far a 95 % interval reaches.

The verdict on a fit: whether it can be used, and why.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from ..base.condition import span
from ..base.declared import of_plain, understood
from ..base.errors import BadInput
from ..base.files import write_atomically
from ..base.json_data import Kind
from ..base.origin import Origin
from ..base.shorthands import Array
from ..base.version import __version__
from ..models.memory_model import MemoryModel
from ..models.model import Combination, Model
from ..models.parameter import Parameter, Prior, free_places, placed
from .provenance import DataRecord, Stage

Usability = Literal["usable", "usable with care", "not usable"]
USABILITIES: tuple[Usability, ...] = get_args(Usability)
"""Best first."""
USABLE, WITH_CARE, NOT_USABLE = USABILITIES


@dataclass(frozen=True)
class Verdict:
    """What becomes of a fit.

    Attributes
    ----------
    usability : "usable", "usable with care" or "not usable".
    reasons : short sentences, the gravest first; those of a usable fit say what speaks for it.
    comparison : role or recording -> horizon -> output -> {rmse, fit_percent, fvu, persistence, unfitted}: errors
        beside those of persistence and of the model as it was before it was fitted. fit_percent is
        100 (1 - rmse / standard deviation of the readings); what was not compared is missing.
    """

    usability: Usability
    reasons: tuple[str, ...]
    comparison: Mapping[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """The verdict as plain data."""
        return {"verdict": self.usability, "reasons": list(self.reasons), "comparison": dict(self.comparison)}


def verdict_from(body: Mapping[str, Any]) -> Verdict | None:
    """A verdict as `Verdict.as_dict` left it; None where there is none. Raises `ValueError` for an unknown one."""
    word = body.get("verdict")
    if word is None:
        return None
    if word not in USABILITIES:
        raise ValueError(f"its verdict {word!r} is not one of {', '.join(USABILITIES)}")
    return Verdict(word, tuple(str(item) for item in body.get("reasons", ())), dict(body.get("comparison") or {}))


@dataclass(frozen=True)
class Reason:
    """One thing for or against a fit, and the best that can be said of a fit of which it holds."""

    at_best: Usability
    sentence: str


def with_reason(verdict: Verdict, reason: Reason | None) -> Verdict:
    """The verdict with one more reason against it."""
    if reason is None:
        return verdict
    worse = USABILITIES.index(reason.at_best) >= USABILITIES.index(verdict.usability)
    kept = verdict.reasons if verdict.usability != USABLE else ()
    known = (reason.sentence, *kept) if worse else (*kept, reason.sentence)
    return Verdict(reason.at_best if worse else verdict.usability, known, verdict.comparison)


def weighed(reasons: Sequence[Reason], comparison: Mapping[str, Any]) -> Verdict:
    """The verdict that the gravest reason leaves; reasons that speak for a fit are only told of a usable one."""
    worst = max((USABILITIES.index(reason.at_best) for reason in reasons), default=0)
    against = sorted(
        (reason for reason in reasons if reason.at_best != USABLE), key=lambda item: -USABILITIES.index(item.at_best)
    )
    known = against or list(reasons)
    return Verdict(USABILITIES[worst], tuple(dict.fromkeys(item.sentence for item in known)), comparison)


CONFIDENCE, Z = 0.975, 1.959963984540054
"""Upper quantile of a two-sided 95 % interval, and its distance in standard deviations when these are known."""


@dataclass(frozen=True)
class Combined:
    """A combination of parameters as a fit tells it: value, standard deviation and 95 % interval, in its unit."""

    name: str
    unit: str
    value: float
    sd: float
    low: float
    high: float
    about: str


def reach(dof: Array | float, quantile: float = CONFIDENCE) -> Array:
    """How many standard deviations an interval reaches to either side, by Student's t, up to an upper quantile."""
    dof = np.asarray(dof, dtype=float)
    finite = np.isfinite(dof)
    known = Z if quantile == CONFIDENCE else float(special.ndtri(quantile))
    return np.where(finite, special.stdtrit(np.where(finite, np.maximum(dof, 1.0), 1.0), quantile), known)


def combined(combination: Combination, model: Model, covariance: Array, dof: Mapping[str, Array]) -> Combined:
    """A combination to first order: its derivative by every parameter, and their covariance.

    Parameters
    ----------
    combination : what is asked for.
    model : at its estimates.
    covariance : (parameters, parameters) of its parameter vector.
    dof : name -> degrees of freedom of its standard deviation.
    """
    values = {p.name: float(p.array) for p in model.parameters if p.shape == ()}
    value = float(combination.of(SimpleNamespace(**values)))
    gradient, of = np.zeros(model.size), np.full(model.size, np.inf)
    for name, k in free_places(model.parameters).items():
        if np.isfinite(values[name]):
            step = 1e-6 * max(abs(values[name]), 1e-3)
            up, down = (SimpleNamespace(**{**values, name: values[name] + sign * step}) for sign in (1, -1))
            gradient[k] = (float(combination.of(up)) - float(combination.of(down))) / (2 * step)
            of[k] = float(np.min(dof.get(name, np.asarray(np.inf))))
    moved = np.flatnonzero(gradient)
    variance = float(gradient[moved] @ covariance[np.ix_(moved, moved)] @ gradient[moved])
    shares = gradient * (covariance @ gradient)
    sd = float(np.sqrt(max(variance, 0.0))) if np.isfinite(variance) else np.inf
    half = float(reach(_welch(shares[moved], of[moved]))) * sd
    return Combined(combination.name, combination.unit, value, sd, value - half, value + half, combination.about)


def _welch(shares: Array, dof: Array) -> float:
    """Degrees of freedom of a sum of variances, each known to its own (Welch & Satterthwaite)."""
    weights = np.abs(shares)
    slack = float(np.sum(weights**2 / dof))
    return float(np.sum(weights)) ** 2 / slack if slack > 0 else np.inf


KIND = Kind("greybox-fit", 2, "a fit", "greybox fit", "fit again")
MOST_COVARIANCES = 200
"""Numbers whose covariance is written into a file."""
HARDLY, SURPRISING = 0.7, 3.0
"""A posterior spread above this share of the prior's is no news; so many prior spreads away is suspicious."""
CHOICES: Mapping[str, Any] = {
    "horizon": float | None,
    "robust": float | None,
    "start_from": str,
    "inputs": Mapping[str, str],
    "counted": Mapping[str, float],
    "imported": str,
}
"""What a fit's `how` may hold that others rely on, with its type; `TypeError` where a file says otherwise."""
FREE_RUN = "free run"
"""The protocol under which every model is scored that moves on by itself."""
LARGEST = 1e150
"""Variances, errors and objectives above it are none: their squares leave the range of numbers."""
ROUNDING = 1e-6
"""Share by which a covariance may be off through rounding."""
UNTOLD = 0.5
"""A positive number whose standard deviation is more than this share of it is not determined."""

Build = Callable[[str, Mapping[str, Any], Mapping[str, float]], Model]
"""Model name, settings, effects with their magnitudes -> model."""


@dataclass(frozen=True)
class Fit:
    """Result of fitting.

    Attributes
    ----------
    model : the model at its estimates.
    sd : name -> standard deviation of every entry, in the parameter's unit, corrected for correlated residuals.
    dof : name -> degrees of freedom of every entry's standard deviation; missing where there are plenty.
    covariance : (parameters, parameters) of the model's parameter vector; None where it was not kept.
    per_run : name -> (runs, ...) estimates of run-scoped parameters on the training runs.
    stages : the steps that led here.
    metrics : "train" and "validate" -> protocol -> output -> {rmse, rmse_sd, fvu, samples}.
    data : recordings seen.
    mode : "cross-validation", "early stopping" or "given": how the strength of regularisation was chosen.
    seed : of everything random.
    how : horizon and further choices of the problem that was solved, to state it again.
    command : what reproduces it.
    version : greybox-id's own.
    verdict : whether it can be used, and why; None where nobody judged it.
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
        """Whether it ended at an optimum; what is imported or was trained is taken as it is."""
        return not self.stages or self.stages[-1].confirmed

    def interval(self, name: str) -> tuple[Array, Array]:
        """95 % interval of every entry of a parameter, cut at its bounds; NaN where it is held."""
        parameter = self.model[name]
        sd = np.asarray(self.sd.get(name, np.full(parameter.shape, np.nan)))
        if parameter.fixed:
            sd = np.full(parameter.shape, np.nan)
        half = reach(self.dof.get(name, np.inf)) * sd
        low, high = parameter.bounds
        with np.errstate(invalid="ignore"):  # an effect that stands at its infinite null has no interval
            return np.maximum(parameter.array - half, low), np.minimum(parameter.array + half, high)

    def combined(self) -> list[Combined]:
        """The model's combinations of parameters, with what is known of them together."""
        if self.covariance is None:
            return []
        return [combined(each, self.model, self.covariance, self.dof) for each in self.model.combinations]

    def notes(self) -> dict[str, str]:
        """What a reader must know of single parameters: held, at a bound, or hardly told by the recording."""
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
                elif low >= 0 and parameter.name not in self.model.effects and sd > UNTOLD * value:
                    result[parameter.name] = f"not determined by this recording (sd {100 * float(sd) / value:.0f} %)"
        return result

    @property
    def from_prior(self) -> tuple[str, ...]:
        """Estimates that are more prior than data: their standard deviation is hardly less than the prior's."""
        return tuple(
            p.name
            for p in self.model.parameters
            if p.shape == () and not p.fixed and p.prior is not None and p.name in self.sd
            and float(self.sd[p.name]) > HARDLY * float(np.max(np.asarray(p.prior.sd)))
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


def load(path: str | Path, build: Build) -> Fit:
    """Read a fit back.

    Parameters
    ----------
    path : a file written by `Fit.save`.
    build : makes a model from its name, settings and effects.

    Raises
    ------
    BadInput : the file is no fit, is damaged, or was written by another version; or its equations are in a module that
        greybox-id does not ship and that `build` does not know. A file never names code that loading it would run.

    Warns
    -----
    UserWarning : equations of one's own come from a file that has changed since the fit was saved.
    """

    def made(body: Mapping[str, Any]) -> Fit:
        return _sound(_from_dict(body, _checked(build, body["model"].get("origins", {}), Path(path))))

    return KIND.load(path, made)


def _sound(fit: Fit) -> Fit:
    """The fit, if what depends on it can rely on its content. Raises `TypeError` or `ValueError` otherwise."""
    if not fit.stages and "imported" not in fit.how:
        raise ValueError("it has no stages, and was not imported")
    for k, stage in enumerate(fit.stages):
        _sizes((*stage.history, *stage.starts), f"objectives of stages[{k}]")
        _sizes(tuple(stage.noise.values()), f"noise of stages[{k}]")
        if len({frozenset(item) for item in stage.ended_at}) > 1 or len(stage.ended_at) not in (0, len(stage.starts)):
            raise ValueError(f"its starts of stages[{k}] did not all end at the same parameters' values")
    for name, sd in fit.sd.items():
        _sizes(sd, f"standard deviation of {name}")
    if fit.covariance is not None:
        _of_covariance(fit.covariance)
    for error in (item for role in fit.metrics.values() for protocol in role.values() for item in protocol.values()):
        known = {name: value for name, value in error.items() if name != "diverges"}  # where it does is a record
        if not {"rmse", "rmse_sd", "fvu"} <= of_plain(Mapping[str, float], known, "metrics").keys():
            raise ValueError("its metrics are not complete")
        _sizes((error["rmse"], error["rmse_sd"]), "errors in metrics")
    if not isinstance(fit.model, MemoryModel) and any(
        metric and FREE_RUN not in metric for metric in fit.metrics.values()
    ):
        raise ValueError("its metrics are not complete")
    for name, kind in CHOICES.items():
        if name in fit.how:
            of_plain(kind, fit.how[name], f"how.{name}")
    for record in fit.data:
        if record.role not in ("train", "validate") or min(record.samples, record.runs) < 1 or not record.duration >= 0:
            raise ValueError(f"its record of {record.name!r:.60} is not that of a recording")
        if record.between:
            try:
                span(record.between)
            except BadInput as error:
                raise ValueError(f"in its record of {record.name!r:.60}, {error}") from error
    for name, values in fit.per_run.items():
        if name not in fit.model or np.shape(values)[1:] != fit.model[name].shape:
            raise ValueError(f"its values of {name!r:.60} by run are not those of a parameter")
    for name, values in fit.dof.items():
        if np.shape(values) not in ((), fit.model[name].shape):
            raise ValueError(f"its degrees of freedom of {name} have shape {np.shape(values)}")
    return fit


def _sizes(values: ArrayLike, what: str) -> None:
    """Raise `ValueError` unless these are sizes: not negative, and of no absurd size unless infinite or not told."""
    value = np.asarray(values, dtype=float)
    if np.any(value < 0) or np.any((value > LARGEST) & np.isfinite(value)):
        raise ValueError(f"its {what} are no sizes")


def _of_covariance(matrix: Array) -> None:
    """Raise `ValueError` unless this can be a covariance: symmetric, and no correlation beyond one."""
    variance = np.diag(matrix)
    if not np.all(np.isfinite(matrix)) or np.any(variance < 0) or np.any(variance > LARGEST):
        raise ValueError("its covariance has a variance that is negative, too large or not finite")
    most = np.sqrt(np.outer(variance, variance)) * (1 + ROUNDING)
    if np.any(np.abs(matrix) > most) or np.any(np.abs(matrix - matrix.T) > ROUNDING * most):
        raise ValueError("its covariance is invalid: it is not symmetric, or has correlations beyond one")


def _checked(build: Build, origins: Mapping[str, Mapping[str, str]], path: Path) -> Build:
    """The same, with a sentence on equations that are not shipped: which are missing, which have changed."""
    recorded = {name: Origin(str(origin["file"]), str(origin["sha256"])) for name, origin in origins.items()}

    def checked(name: str, settings: Mapping[str, Any], effects: Mapping[str, float]) -> Model:
        try:
            model = build(name, settings, effects)
        except BadInput as error:
            if not recorded:
                raise
            where = "; ".join(f"{name} in {origin.words}" for name, origin in recorded.items())
            raise BadInput(
                f"{path} needs equations that greybox-id does not ship: {where}. A fit's file never runs code: hand "
                f"them over when loading it (‹own|models=, effects=›). {error}"
            ) from error
        present = {**model.origins, name: model.origin}
        for item, origin in recorded.items():
            now = present.get(item)
            if now is not None and origin.sha256 and now.sha256 and now.sha256 != origin.sha256:
                warnings.warn(
                    f"{path} was saved with {item} in {origin.words}, which is now {now.words}: where the equations "
                    "differ, its numbers mean nothing. Fit again.",
                    stacklevel=2,
                )
        return model

    return checked


def _origins_as_dict(model: Model) -> dict[str, Any]:
    """Where equations come from that are not shipped; nothing where all are."""
    value = model.origin
    result = {**model.origins, **({model.name: value} if value is not None else {})}
    return {"origins": {name: asdict(origin) for name, origin in result.items()}} if result else {}


def _from_dict(body: Mapping[str, Any], build: Build) -> Fit:
    described = body["model"]
    model = build(described["name"], described["settings"], described["effects"])
    stored = body["parameters"]
    if set(stored) != {p.name for p in model.parameters}:
        raise ValueError(f"its parameters are not those of model {model.name}")
    for p in model.parameters:
        shape = np.shape(stored[p.name]["sd"])
        if shape != p.shape:
            raise ValueError(f"the standard deviations of {p.name} have shape {shape}, its values {p.shape}")
    model = model.with_parameters(*(_restored(p, stored[p.name]) for p in model.parameters))
    return Fit(
        model=model,
        sd={name: np.asarray(record["sd"], dtype=float) for name, record in stored.items()},
        stages=of_plain(tuple[Stage, ...], body["stages"], "stages"),
        metrics=of_plain(Mapping[str, Mapping[str, Mapping[str, Mapping[str, Any]]]], body["metrics"], "metrics"),
        data=of_plain(tuple[DataRecord, ...], body["data"], "data"),
        mode=of_plain(str, body["mode"], "mode"),
        seed=of_plain(int, body["seed"], "seed"),
        dof={name: np.asarray(record["dof"], dtype=float) for name, record in stored.items() if "dof" in record},
        covariance=_covariance_from_dict(body["covariance"], model),
        how=of_plain(Mapping[str, Any], body["how"], "how"),
        per_run={name: np.asarray(values, dtype=float) for name, values in body["per_run"].items()},
        command=of_plain(str, body["command"], "command"),
        version=of_plain(str, body["version"], "version"),
        verdict=verdict_from(body),
    )


def _restored(parameter: Parameter, record: Mapping[str, Any]) -> Parameter:
    """A parameter of the registry's model as the fit had it: a vehicle file may have changed what is known of it."""
    changes: dict[str, Any] = {"fixed": bool(record["fixed"])}
    if parameter.shape == ():
        prior = record["prior"]
        changes |= {
            "bounds": tuple(float(bound) for bound in record["bounds"]),
            "prior": None if prior is None else _prior(prior, f"prior of {parameter.name}"),
            "scope": of_plain(Literal["model", "run"], record["scope"], f"scope of {parameter.name}"),
        }
    return replace(parameter, value=np.asarray(record["value"], dtype=float).reshape(parameter.shape), **changes)


def _prior(record: Mapping[str, Any], name: str) -> Prior:
    sd, mean = (of_plain(float | None, record.get(key), f"{name}, its {key},") for key in ("sd", "mean"))
    return Prior(sd, mean=mean, strength=of_plain(str, record.get("strength", ""), f"{name}, its strength,"))


def _prior_as_dict(parameter: Parameter) -> dict[str, Any] | None:
    if parameter.prior is None or parameter.shape != ():
        return None
    prior = parameter.prior
    mean = parameter.array if prior.mean is None else np.asarray(prior.mean)
    return {"sd": float(np.asarray(prior.sd)), "mean": float(mean), "strength": prior.strength}


def _covariance_as_dict(fit: Fit) -> dict[str, Any] | None:
    """The covariance of the numbers that moved, by name; that of networks is left out for its size."""
    if fit.covariance is None:
        return None
    free = free_places(fit.model.parameters)
    if len(free) > MOST_COVARIANCES:
        return None
    places = [*free.values()]
    return {"names": [*free], "matrix": fit.covariance[np.ix_(places, places)].tolist()}


def _covariance_from_dict(record: Mapping[str, Any] | None, model: Model) -> Array | None:
    if record is None:
        return None
    start = {parameter.name: place.start for parameter, place in placed(model.parameters)}
    matrix = np.zeros((model.size, model.size))
    places = [start[name] for name in record["names"]]
    matrix[np.ix_(places, places)] = np.asarray(record["matrix"], dtype=float).reshape(len(places), len(places))
    return matrix


def _against_prior(parameter: Parameter, prior: Prior, sd: float) -> dict[str, str]:
    """What is to be said of a number that its prior moved, or that moved away from its prior."""
    spread = float(np.max(np.asarray(prior.sd)))
    away = 0.0 if prior.mean is None else abs(float(parameter.array) - float(np.asarray(prior.mean))) / spread
    if away > SURPRISING:
        return {parameter.name: f"conflicts with the prior ({away:.1f} sd): suspect the model structure"}
    return {parameter.name: "weakly identifiable; dominated by the prior"} if sd > HARDLY * spread else {}


def conflict(fitted: Model) -> float:
    """By how much intervals are wider where estimates conflict with what was stated.

    One of the stated numbers is off by more than its standard deviation then, and nothing says which: all are taken to
    be uncertain by a common factor under which they agree (Birge, The Calculation of Errors by the Method of Least
    Squares, Phys. Rev. 40, 1932; the scale factor of the Particle Data Group's averages).
    """
    away = [
        float((p.array - np.asarray(p.prior.mean)) / np.max(np.asarray(p.prior.sd)))
        for p in fitted.parameters
        if p.shape == () and not p.fixed and p.prior is not None and p.prior.mean is not None
    ]
    if not away or max(map(abs, away)) < SURPRISING:
        return 1.0
    return max(1.0, float(np.sqrt(np.mean(np.square(away)))))
