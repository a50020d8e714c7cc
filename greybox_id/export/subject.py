"""The subject of an export: a model with its values and their source.

Also the origin of each entry of the exported files.
"""

from __future__ import annotations

import keyword
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..base.errors import BadInput, must_be_one_of
from ..base.version import __version__
from ..engine.simulation import equations_of_motion
from ..fitting.fit import Fit
from ..models.model import Model
from ..models.motion_model import MotionModel
from ..models.vehicle import Vehicle
from .equations import Equations

NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")
RESERVED = {
    *("auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern"),
    *("float", "for", "goto", "if", "inline", "int", "long", "register", "restrict", "return", "short", "signed"),
    *("sizeof", "static", "struct", "switch", "typedef", "union", "unsigned", "void", "volatile", "while", "main"),
}


@dataclass(frozen=True)
class Subject:
    """A model to export.

    Attributes
    ----------
    model : at the values that become the default parameters.
    name : prefix of files and functions: lower-case letters, digits and underscores.
    moving : names of the parameters that remain adjustable; others become constants. None: all of them.
    fit : source of the values; None if they are stated.
    source : name of the fit or vehicle, for people.
    command : reproduces the export.
    vehicle : whose values the model has, if they are a vehicle's.
    """

    model: Model
    name: str
    moving: tuple[str, ...] | None = None
    fit: Fit | None = None
    source: str = ""
    command: str = ""
    vehicle: Vehicle | None = None

    def __post_init__(self) -> None:
        named_in_c(self.name)
        known = [parameter.name for parameter in self.model.parameters]
        for name in self.moving or ():
            must_be_one_of(known, name, f"{self.model.name} has no parameter")

    @cached_property
    def equations(self) -> Equations:
        """The functions of a motion model. Raises `BadInput` for other models."""
        model = equations_of_motion(self.model, f"; this target takes {_MOTION} only")
        moving = None if self.moving is None else [name for name in self.moving if name in model]
        return Equations(self._as_recorded(model), moving)

    def _as_recorded(self, model: MotionModel) -> MotionModel:
        """The model with each alternative input narrowed to the signal that the fit used."""
        seen = {} if self.fit is None else self.fit.how.get("inputs", {})
        narrowed = {name: (seen[name],) if name in seen else aliase for name, aliase in model.aliases.items()}
        return replace(model, aliases=narrowed)

    def described(self) -> dict[str, Any]:
        """Model, parameters with units and intervals, and data, as plain data for a manifest."""
        model, fit = self.model, self.fit
        return {
            "name": self.name,
            "greybox_id": __version__,
            "source": self.source,
            "command": self.command,
            "model": {
                "name": model.name,
                "about": model.about,
                "settings": dict(model.settings),
                "effects": {name: float(model[name].array) for name in model.effects},
                "inputs": list(model.inputs),
                "outputs": list(model.outputs),
            },
            "parameters": {
                p.name: {
                    "unit": p.unit,
                    "value": p.array.tolist(),
                    "interval": None if fit is None or p.fixed or p.name not in fit.sd else _interval(fit, p.name),
                    "constant": self.moving is not None and p.name not in self.moving,
                    "about": p.about,
                }
                for p in model.parameters
            },
            "data": [
                {"role": record.role, "name": record.name, "sha256": record.sha256, "samples": record.samples}
                for record in (() if fit is None else fit.data)
            ],
        }


def named_in_c(name: str) -> None:
    """Raise `BadInput` if a name is not valid for functions in C."""
    if not NAME.fullmatch(name) or name in RESERVED or keyword.iskeyword(name):
        raise BadInput(
            f"{name!r} cannot name C functions. A name has at most 40 lower-case letters, digits and underscores, "
            "begins with a letter, and is no keyword of C or Python. Name another with ‹name›."
        )


_MOTION = "single_track, lateral, longitudinal and kinematic"


def _interval(fit: Fit, name: str) -> list[Any] | None:
    low, high = fit.interval(name)
    return [low.tolist(), high.tolist()] if np.all(np.isfinite(low) & np.isfinite(high)) else None


@dataclass(frozen=True)
class KeyOrigin:
    """An entry of a file and its origin.

    Attributes
    ----------
    key : of the entry.
    value : in the file's unit; None if it is left open.
    behind : the parameter or effect that determines it; "" if none.
    why : reason for a default or an open value, as a clause; "" if a parameter or effect determines it.
    """

    file: str
    key: str
    value: float | str | bool | Sequence[float] | None
    behind: str = ""
    why: str = ""

    def plain(self) -> dict[str, Any]:
        """The entry as plain data, for a manifest."""
        value = list(self.value) if isinstance(self.value, (list, tuple)) else self.value
        known = {"file": self.file, "key": self.key, "value": value}
        return known | ({"from": self.behind} if self.behind else {"default": self.why})
