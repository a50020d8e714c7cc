"""Fits from their files: read without running code, and refused if their content is not reliable.

A file names the model and its settings; the caller passes the function that builds models by name.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..base.condition import span
from ..base.declared import of_plain
from ..base.errors import BadInput
from ..base.origin import Origin
from ..base.shorthands import Array
from ..models.memory_model import MemoryModel
from ..models.model import Model
from ..models.parameter import Parameter, Prior, placed
from .fit import FREE_RUN, KIND, Fit, verdict_from
from .provenance import DataRecord, Stage

CHOICES: Mapping[str, Any] = {
    "horizon": float | None,
    "robust": float | None,
    "start_from": str,
    "inputs": Mapping[str, str],
    "counted": Mapping[str, float],
    "imported": str,
}
"""Entries of a fit's `how` that other code relies on, with their types; `TypeError` if a file differs."""
LARGEST = 1e150
"""Largest variance, error or objective accepted: squares of larger ones overflow."""
ROUNDING = 1e-6
"""Relative error of a covariance permitted by rounding."""

Build = Callable[[str, Mapping[str, Any], Mapping[str, float]], Model]
"""Model name, settings, effects with their magnitudes -> model."""


def load(path: str | Path, build: Build) -> Fit:
    """Read a fit from its file.

    Parameters
    ----------
    path : a file written by `Fit.save`.
    build : builds a model from its name, settings and effects.

    Raises
    ------
    BadInput : the file is no fit, is damaged, or was written by another version; or its equations are in a module that
        greybox-id does not ship and that `build` does not know. Loading a file never runs code that it names.

    Warns
    -----
    UserWarning : a user's equations come from a file that has changed since the fit was saved.
    """

    def made(body: Mapping[str, Any]) -> Fit:
        return _sound(_from_dict(body, _checked(build, body["model"].get("origins", {}), Path(path))))

    return KIND.load(path, made)


def _sound(fit: Fit) -> Fit:
    """The fit, if its content is reliable. Raises `TypeError` or `ValueError` otherwise."""
    _must_have_sound_stages(fit)
    _must_have_sound_metrics(fit)
    for name, sd in fit.sd.items():
        _sizes(sd, f"standard deviation of {name}")
    if fit.covariance is not None:
        _of_covariance(fit.covariance)
    for name, kind in CHOICES.items():
        if name in fit.how:
            of_plain(kind, fit.how[name], f"how.{name}")
    for record in fit.data:
        _must_be_of_a_recording(record)
    for name, values in fit.per_run.items():
        if name not in fit.model or np.shape(values)[1:] != fit.model[name].shape:
            raise ValueError(f"its values of {name!r:.60} by run are not those of a parameter")
    for name, values in fit.dof.items():
        if np.shape(values) not in ((), fit.model[name].shape):
            raise ValueError(f"its degrees of freedom of {name} have shape {np.shape(values)}")
    return fit


def _must_have_sound_stages(fit: Fit) -> None:
    if not fit.stages and "imported" not in fit.how:
        raise ValueError("it has no stages, and was not imported")
    for k, stage in enumerate(fit.stages):
        _sizes((*stage.history, *stage.starts), f"objectives of stages[{k}]")
        _sizes(tuple(stage.noise.values()), f"noise of stages[{k}]")
        if len({frozenset(item) for item in stage.ended_at}) > 1 or len(stage.ended_at) not in (0, len(stage.starts)):
            raise ValueError(f"the starts in stages[{k}] do not all list the values of the same parameters")


def _must_have_sound_metrics(fit: Fit) -> None:
    for error in (item for role in fit.metrics.values() for protocol in role.values() for item in protocol.values()):
        numbers = {name: value for name, value in error.items() if name != "diverges"}  # "diverges" is no number
        if not {"rmse", "rmse_sd", "fvu"} <= of_plain(Mapping[str, float], numbers, "metrics").keys():
            raise ValueError("its metrics are not complete")
        _sizes((error["rmse"], error["rmse_sd"]), "errors in metrics")
    free_run = not isinstance(fit.model, MemoryModel)
    if free_run and any(metric and FREE_RUN not in metric for metric in fit.metrics.values()):
        raise ValueError("its metrics are not complete")


def _must_be_of_a_recording(record: DataRecord) -> None:
    if record.role not in ("train", "validate") or min(record.samples, record.runs) < 1 or not record.duration >= 0:
        raise ValueError(f"its record of {record.name!r:.60} is not that of a recording")
    if record.between:
        try:
            span(record.between)
        except BadInput as error:
            raise ValueError(f"in its record of {record.name!r:.60}, {error}") from error


def _sizes(values: ArrayLike, what: str) -> None:
    """Raise `ValueError` unless the values are valid sizes: not negative, and at most LARGEST, infinite or NaN."""
    value = np.asarray(values, dtype=float)
    if np.any(value < 0) or np.any((value > LARGEST) & np.isfinite(value)):
        raise ValueError(f"its {what} are no sizes")


def _of_covariance(matrix: Array) -> None:
    """Raise `ValueError` unless the matrix is a valid covariance: symmetric, and no correlation beyond one."""
    variance = np.diag(matrix)
    if not np.all(np.isfinite(matrix)) or np.any(variance < 0) or np.any(variance > LARGEST):
        raise ValueError("its covariance has a variance that is negative, too large or not finite")
    most = np.sqrt(np.outer(variance, variance)) * (1 + ROUNDING)
    if np.any(np.abs(matrix) > most) or np.any(np.abs(matrix - matrix.T) > ROUNDING * most):
        raise ValueError("its covariance is invalid: it is not symmetric, or has correlations beyond one")


def _checked(build: Build, origins: Mapping[str, Mapping[str, str]], path: Path) -> Build:
    """`build`, with errors and warnings about equations that are not shipped: missing ones, and changed ones."""
    recorded = {name: Origin(str(origin["file"]), str(origin["sha256"])) for name, origin in origins.items()}

    def checked(name: str, settings: Mapping[str, Any], effects: Mapping[str, float]) -> Model:
        try:
            model = build(name, settings, effects)
        except BadInput as error:
            if not recorded:
                raise
            where = "; ".join(f"{name} in {origin.words}" for name, origin in recorded.items())
            raise BadInput(
                f"{path} needs equations that greybox-id does not ship: {where}. A fit's file never runs code: pass "
                f"them when loading it (‹own|models=, effects=›). {error}"
            ) from error
        present = {**model.origins, name: model.origin}
        for item, origin in recorded.items():
            now = present.get(item)
            if now is not None and origin.sha256 and now.sha256 and now.sha256 != origin.sha256:
                warnings.warn(
                    f"{path} was saved with {item} in {origin.words}, which is now {now.words}: if the equations "
                    "differ, the fit's numbers do not apply. Fit again.",
                    stacklevel=2,
                )
        return model

    return checked


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
    """A parameter of the registry's model with the fit's bounds and prior: a vehicle file may have changed them."""
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


def _covariance_from_dict(record: Mapping[str, Any] | None, model: Model) -> Array | None:
    if record is None:
        return None
    start = {parameter.name: place.start for parameter, place in placed(model.parameters)}
    matrix = np.zeros((model.size, model.size))
    places = [start[name] for name in record["names"]]
    matrix[np.ix_(places, places)] = np.asarray(record["matrix"], dtype=float).reshape(len(places), len(places))
    return matrix
