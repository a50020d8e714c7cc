"""The unit of work: one recording, read once and taken through its steps; plain data in, plain data out.

It runs in a process of its own (`contained.units`), on this machine or on another one, and knows nothing of fleets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from greybox_id.api import given
from greybox_id.api.fitting import fit as fit_model
from greybox_id.base.errors import BadInput
from greybox_id.base.json_data import attributes
from greybox_id.base.shorthands import Array
from greybox_id.base.units import pairs
from greybox_id.base.version import __version__
from greybox_id.datasets.checks import check, distrusted
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording
from greybox_id.fitting.fit import Fit
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.requested_model import RequestedModel
from greybox_id.fitting.uncertainty.identifiability import left_open
from greybox_id.models.model import Model
from greybox_id.models.parameter import Parameter, placed
from greybox_id.models.registry import install, is_place
from greybox_id.models.vehicle import Vehicle

from .statuses import CHECK, FAILED, FIT, GAP, NOT_TRUSTED, OK

MADE_BY = __version__
"""The version of what computes: part of every key."""
OF_PARAMETERS = ("fix", "free", "prior", "start")
"""What [fit] may say of parameters, as the options of `greybox fit` do."""
OF_MODEL = ("model", "set", "with", "noise")
OF_FIT = ("horizon", "start_from", "robust", "solver", "starts", "seed")
OPTIONS = {CHECK: ("wheelbase",), FIT: (*OF_MODEL, *OF_PARAMETERS, *OF_FIT), GAP: ("model", "seed")}
"""Step -> its options."""
Tell = Callable[[dict[str, Any]], None]
"""Is handed what a step found, as soon as it is known."""


def worked(job: Mapping[str, Any], tell: Tell) -> None:
    """Take a recording through its steps.

    Parameters
    ----------
    job : path, sha256 of its bytes, columns, vehicle, steps, and the options of each step by its name.
    tell : is handed, step by step, what belongs into the row of the recording and into other tables.
    """
    try:
        recording = read(job["path"], job["columns"])
        if job["sha256"] and recording.source.sha256 != job["sha256"]:
            raise BadInput(f"{job['path']} was changed while the fleet was run; run the fleet again.")
        recording = replace(recording, source=replace(recording.source, path=job["shown"]))
        duration = float(len(recording) * recording.sample_time) if recording.sample_time > 0 else None
        tell({"rows": len(recording), "seconds": duration})
        if CHECK in job["steps"] and not _trusted(recording, job.get(CHECK, {}), tell):
            return
        vehicle = given.vehicle(job["vehicle"])
        if FIT in job["steps"]:
            tell(_fitted(recording, vehicle, job.get(FIT, {})))
        if GAP in job["steps"]:
            tell(_gap(recording, vehicle, job.get(GAP, {}), job.get(FIT, {})))
        tell({"status": OK})
    except BadInput as error:
        tell({"status": FAILED, "sentence": str(error).replace(job["path"], job["shown"])})


def requested_of(options: Mapping[str, Any], vehicle: Vehicle | None) -> tuple[RequestedModel, FitOptions]:
    """The model that [fit] asks for, and how it is fitted.

    Raises
    ------
    BadInput : an option is not known, or names nothing.
    """
    written = _words(options.get("with", ()), "with")
    model = options.get("model")
    for item in (*written, *([model] if model is not None else [])):
        if not isinstance(item, str):
            raise BadInput(f"[fit]: model and with must be names, not {item!r:.40}.")
        if is_place(item):
            raise BadInput(
                f"[fit] {item}: a fleet's file cannot name code to run; name a shipped or an installed model or effect."
            )
    install()
    settings = options.get("set", {})
    if not isinstance(settings, Mapping):
        raise BadInput(f'[fit] set is a table, as in set = {{tyre = "linear"}}, not {settings!r:.40}.')
    values = {name: _values(options.get(name, ()), name) for name in ("fix", "prior", "start")}
    chosen = given.choices(**values, free=_words(options.get("free", ()), "free"))
    requested = given.requested(model, vehicle, settings, written, chosen)
    how = {name: options[name] for name in OF_FIT if name in options}
    return requested, FitOptions(**how, noise=_values(options.get("noise", ()), "noise"))


def _trusted(recording: Recording, options: Mapping[str, Any], tell: Tell) -> bool:
    findings = check(recording, options.get("wheelbase"))
    sentences = [f"{one.severity.value}: {one.where.channel}: {one.sentence}" for one in findings]
    body: dict[str, Any] = {"findings": sentences}
    if distrusted(findings):
        body |= {"status": NOT_TRUSTED, "sentence": findings[0].sentence}
    tell(body)
    return not distrusted(findings)


def _fitted(recording: Recording, vehicle: Vehicle | None, options: Mapping[str, Any]) -> dict[str, Any]:
    requested, how = requested_of(options, vehicle)
    fit = fit_model(requested, recording, options=how)
    verdict = fit.verdict
    return {
        "verdict": None if verdict is None else verdict.usability,
        "reasons": [] if verdict is None else list(verdict.reasons),
        "parameters": parameters_of(fit),
        "covariances": covariances_of(fit),
    }


def parameters_of(fit: Fit) -> list[dict[str, Any]]:
    """Single numbers of a fit that were estimated, and their identifiable combinations."""
    rows, notes = [], fit.notes()
    open_ = left_open(fit)
    weak = set(open_.undetermined) if open_ is not None else set()
    for p in _estimated(fit.model):
        sd = float(np.asarray(fit.sd.get(p.name, np.nan)))
        low, high = (float(end) for end in fit.interval(p.name))
        dof = float(np.min(fit.dof.get(p.name, np.asarray(np.inf))))
        known = fit.confirmed and bool(np.isfinite(sd)) and p.name not in weak and "bound" not in notes.get(p.name, "")
        row = {"name": p.name, "unit": p.unit, "value": float(p.array), "sd": sd, "low": low, "high": high, "dof": dof}
        rows.append(row | {"told": known})
    for item in fit.combined():
        if item.name in fit.model or item.sd == 0:  # what is estimated itself, or follows from what is held
            continue
        row = attributes(item, "name", "unit", "value", "sd", "low", "high")
        rows.append(row | {"dof": None, "told": fit.confirmed and bool(np.isfinite(item.sd))})
    return rows


def covariances_of(fit: Fit) -> list[dict[str, Any]]:
    """The covariance of what was estimated, in logarithms where a parameter is positive by nature, and its priors.

    A fit holds what its priors say as well as what the recording says; who joins many fits counts a prior once, and so
    has to know it. Nothing is returned where the optimum was not confirmed or no covariance was kept.
    """
    entry = list(_estimated(fit.model))
    if fit.covariance is None or not fit.confirmed or not entry:
        return []
    start = {p.name: place.start for p, place in placed(fit.model.parameters)}
    at = [start[p.name] for p in entry]
    logs = [in_logarithm(p, fit.model) for p in entry]
    scale = np.array([1.0 / float(p.array) if log else 1.0 for p, log in zip(entry, logs, strict=True)])
    matrix = fit.covariance[np.ix_(at, at)] * np.outer(scale, scale)
    centre = [float(np.log(p.array)) if log else float(p.array) for p, log in zip(entry, logs, strict=True)]
    bounded = [not p.bounds[0] < float(p.array) < p.bounds[1] for p in entry]
    prior = [_prior(p, log) for p, log in zip(entry, logs, strict=True)]
    dof = [float(np.min(fit.dof.get(p.name, np.asarray(np.inf)))) for p in entry]
    return [
        {
            "names": [p.name for p in entry],
            "units": [p.unit for p in entry],
            "logarithm": logs,
            "centre": centre,
            "lower": [float(item) for item in packed(matrix)],
            "dof": dof,
            "at_bound": bounded,
            "prior_mean": [mean for mean, _ in prior],
            "prior_sd": [sd for _, sd in prior],
        }
    ]


def packed(matrix: Array) -> Array:
    """The lower triangle of a symmetric matrix, row by row."""
    return matrix[np.tril_indices(len(matrix))]


def unpacked(lower: Sequence[float] | Array, size: int) -> Array:
    """The symmetric matrix of a lower triangle."""
    rows, columns = _triangle(size)
    matrix = np.empty((size, size))
    matrix[rows, columns] = matrix[columns, rows] = lower
    return matrix


@lru_cache(maxsize=64)
def _triangle(size: int) -> tuple[Any, Any]:
    rows, columns = np.tril_indices(size)
    return rows, columns


def in_logarithm(parameter: Parameter, model: Model) -> bool:
    """Whether a parameter is positive by nature: effects are not, whose null is often at their bound."""
    return parameter.bounds[0] >= 0 and parameter.name not in model.effects and float(parameter.array) > 0


def _prior(parameter: Parameter, log: bool) -> tuple[float, float]:
    """Mean and standard deviation in the coordinate of the parameter; infinite where there is no prior."""
    if parameter.prior is None:
        return 0.0, float("inf")
    sd = float(np.asarray(parameter.prior.sd))
    mean = float(parameter.array if parameter.prior.mean is None else np.asarray(parameter.prior.mean))
    value = float(parameter.array)
    return (float(np.log(value)) + (mean - value) / value, sd / value) if log else (mean, sd)


def _estimated(model: Model) -> list[Parameter]:
    return [p for p in model.parameters if p.shape == () and not p.fixed and p.scope == "model"]


def _gap(
    recording: Recording, vehicle: Vehicle | None, options: Mapping[str, Any], fit: Mapping[str, Any]
) -> dict[str, Any]:
    if vehicle is None:
        raise BadInput("The step gap needs a vehicle, whose simulation is compared; name its file in [vehicle].")
    from greybox_id.api.diagnosing import diagnose  # a third of the memory of all modules, for one step

    named = options.get("model", fit.get("model") if vehicle.model is None else None)
    result = (
        diagnose(vehicle, [recording], seed=int(options.get("seed", 0)))
        if named is None
        else diagnose(named, [recording], vehicle=vehicle, seed=int(options.get("seed", 0)))
    )
    common = {"p": result.p_value, "detected": result.gap_detected, "unknown": result.unknown_probability}
    rows: list[dict[str, Any]] = [
        {
            "effect": item.effect, "probability": item.probability, "magnitude": item.magnitude, "unit": item.unit,
            "low": item.interval[0], "high": item.interval[1], "aliases": list(item.indistinguishable_from),
            "applied": item.effect in result.applied,
        }
        for item in result.ranking
    ]  # fmt: skip
    return {"gaps": [{**common, **row} for row in rows] or [common]}


def _words(value: Any, option: str) -> list[str]:
    several = [value] if isinstance(value, str) else value
    if not isinstance(several, list | tuple) or not all(isinstance(item, str) for item in several):
        raise BadInput(f"[fit] {option} is a text or a list of texts, not {value!r:.40}.")
    return list(several)


def _values(value: Any, option: str) -> Mapping[str, Any]:
    """Numbers and texts by name, of a table or of a list of texts as the command line writes them."""
    if isinstance(value, Mapping):
        return value
    return pairs(_words(value, option), "NAME=VALUE", alone=option == "fix")
