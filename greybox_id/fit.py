"""A fit: a model with its estimates, their uncertainty, metrics, solver record and provenance.

Saved as JSON and loaded again without running code from the file: the file names the model and its settings,
the caller hands in the function that builds models by name.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from . import __version__
from .errors import BadInput
from .files import write_atomically
from .model import Model
from .parameter import Array, Parameter, Prior
from .provenance import Certificate, DataRecord, Stage

FORMAT = "greybox-fit"
FORMAT_VERSION = 1
HARDLY, SURPRISING = 0.7, 3.0
"""A posterior spread above this share of the prior's is no news; so many prior spreads away is suspicious."""

Build = Callable[[str, Mapping[str, Any], Mapping[str, float]], Model]
"""Model name, settings, effects with their magnitudes -> model."""


@dataclass(frozen=True)
class Fit:
    """Result of fitting.

    Attributes
    ----------
    model : the model at its estimates.
    sd : name -> standard deviation of every entry, in the parameter's unit, corrected for correlated residuals.
    per_run : name -> (runs, ...) estimates of run-scoped parameters on the training runs.
    stages : the steps that led here.
    metrics : "train" and "validate" -> protocol -> output -> {rmse, rmse_sd, fvu, samples}.
    data : recordings seen.
    mode : "cross-validation", "early stopping" or "given": how the strength of regularisation was chosen.
    seed : of everything random.
    command : what reproduces it.
    version : greybox-id's own.
    """

    model: Model
    sd: Mapping[str, Array]
    stages: tuple[Stage, ...]
    metrics: Mapping[str, Any]
    data: tuple[DataRecord, ...]
    mode: str
    seed: int
    per_run: Mapping[str, Array] = field(default_factory=dict)
    command: str = ""
    version: str = __version__

    def notes(self) -> dict[str, str]:
        """What a reader must know of single parameters: held, at a bound, or hardly told by the recording."""
        found = {}
        for parameter in self.model.parameters:
            sd = self.sd.get(parameter.name)
            if parameter.fixed:
                found[parameter.name] = "held"
            elif parameter.shape == () and sd is not None:
                value, (low, high) = float(parameter.array), parameter.bounds
                if value <= low or value >= high:
                    found[parameter.name] = "at its bound"
                elif parameter.prior is not None:
                    found |= _against_prior(parameter, parameter.prior, float(sd))
        return found

    def as_dict(self) -> dict[str, Any]:
        """The fit as plain data for JSON."""
        return {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "version": self.version,
            "command": self.command,
            "mode": self.mode,
            "seed": self.seed,
            "model": {
                "name": self.model.name,
                "settings": dict(self.model.settings),
                "effects": {name: float(self.model[name].array) for name in self.model.effects},
            },
            "parameters": {
                p.name: {
                    "unit": p.unit,
                    "value": p.array.tolist(),
                    "sd": np.asarray(self.sd.get(p.name, np.zeros(p.shape))).tolist(),
                    "fixed": p.fixed,
                    "about": p.about,
                }
                for p in self.model.parameters
            },
            "per_run": {name: np.asarray(values).tolist() for name, values in self.per_run.items()},
            "notes": self.notes(),
            "together": list(self.model.together),
            "stages": [asdict(stage) for stage in self.stages],
            "metrics": dict(self.metrics),
            "data": [asdict(record) for record in self.data],
        }

    def save(self, path: str | Path) -> Path:
        """Write the fit as JSON, atomically: an existing file is replaced whole or not at all."""
        body = self.as_dict()
        body["checksum"] = _checksum(body)
        plain = json.dumps(_without_nan(body), indent=1, allow_nan=False, sort_keys=False)
        return write_atomically(Path(path), plain + "\n")


def load(path: str | Path, build: Build) -> Fit:
    """Read a fit back.

    Parameters
    ----------
    path : a file written by `Fit.save`.
    build : makes a model from its name, settings and effects.

    Raises
    ------
    BadInput : the file is no fit, is damaged, or was written by a newer version.
    """
    file = Path(path)
    body = _read_json(file)
    if not isinstance(body, dict) or body.get("format") != FORMAT:
        raise BadInput(f"{file} is not a fit of greybox-id; make one with greybox fit.")
    if body.get("format_version") != FORMAT_VERSION:
        raise BadInput(
            f"{file} has format version {body.get('format_version')!r}, this is greybox-id {__version__}, which reads "
            f"version {FORMAT_VERSION}. Install the version that wrote it ({body.get('version', 'unknown')}), "
            "or fit again."
        )
    if body.pop("checksum", None) != _checksum(body):
        raise BadInput(f"{file} is damaged: its content does not match its checksum. Restore it, or fit again.")
    try:
        return _from_dict(body, build)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadInput(f"{file} is damaged: {error}. Restore it, or fit again.") from error


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
    model = model.with_parameters(
        *(replace(p.with_value(stored[p.name]["value"]), fixed=bool(stored[p.name]["fixed"])) for p in model.parameters)
    )
    stages = []
    for stage in body["stages"]:
        certificate = stage["certificate"]
        stages.append(
            Stage(
                **{
                    **stage,
                    "history": tuple(stage["history"]),
                    "starts": tuple(stage["starts"]),
                    "tried": tuple((dict(s), e) for s, e in stage["tried"]),
                    "certificate": None if certificate is None else Certificate(**certificate),
                }
            )
        )
    return Fit(
        model=model,
        sd={name: np.asarray(record["sd"], dtype=float) for name, record in stored.items()},
        stages=tuple(stages),
        metrics=body["metrics"],
        data=tuple(DataRecord(**record) for record in body["data"]),
        mode=body["mode"],
        seed=body["seed"],
        per_run={name: np.asarray(values, dtype=float) for name, values in body["per_run"].items()},
        command=body["command"],
        version=body["version"],
    )


def _read_json(file: Path) -> Any:
    try:
        return json.loads(file.read_text(encoding="utf-8"), object_hook=_with_nan)
    except OSError as error:
        raise BadInput(f"{file} cannot be read: {error.strerror}.") from error
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{file} is damaged: it is not JSON ({error}). Restore it, or fit again.") from error


def _against_prior(parameter: Parameter, prior: Prior, sd: float) -> dict[str, str]:
    """What is to be said of a number that its prior moved, or that moved away from its prior."""
    spread = float(np.max(np.asarray(prior.sd)))
    away = 0.0 if prior.mean is None else abs(float(parameter.array) - float(np.asarray(prior.mean))) / spread
    if away > SURPRISING:
        return {parameter.name: f"{away:.1f} prior standard deviations from its prior: the model wants something else"}
    return {parameter.name: "mostly prior: this recording hardly tells it"} if sd > HARDLY * spread else {}


NOT_FINITE = "not_finite"
"""JSON has no word for numbers that are not finite; they are written as {"not_finite": "nan"}, "inf" or "-inf"."""


def _without_nan(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _without_nan(own) for name, own in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_nan(own) for own in value]
    if isinstance(value, float) and not np.isfinite(value):
        return {NOT_FINITE: str(float(value))}
    return value


def _with_nan(body: dict[str, Any]) -> Any:
    if set(body) == {NOT_FINITE} and body[NOT_FINITE] in ("nan", "inf", "-inf"):
        return float(body[NOT_FINITE])
    return body


def _checksum(body: Mapping[str, Any]) -> str:
    plain = json.dumps(body, sort_keys=True, allow_nan=True, default=list)
    return hashlib.sha256(plain.encode()).hexdigest()
