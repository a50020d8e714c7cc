"""What is exported: a model at its values, and where these come from.

Where the entries of exported files come from.
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
    name : what files and functions are called after: lower-case letters, digits and underscores.
    moving : names of the parameters that can be changed afterwards; others become constants. None: all of them.
    fit : where the values come from; None where they are stated.
    source : the fit's or vehicle's name, for people.
    command : what reproduces the export.
    vehicle : whose numbers the model has, where they are a vehicle's.
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
        """The functions of a model of motion. Raises `BadInput` for other models."""
        model = equations_of_motion(self.model, f"; this target takes {_MOTION} only")
        moving = None if self.moving is None else [name for name in self.moving if name in model]
        return Equations(self._as_recorded(model), moving)

    def _as_recorded(self, model: MotionModel) -> MotionModel:
        """The model whose inputs are the signals that the fit has seen, where any of several might be one."""
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
    """Raise `BadInput` where functions in C cannot be called so."""
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
    """An entry of a file.

    Attributes
    ----------
    file : which.
    key : of the entry.
    value : in the file's unit; None where it is left open.
    behind : the parameter or effect it holds; "" where there is none.
    why : why it stands at a default or is left open, as a clause; "" where something is behind it.
    """

    file: str
    key: str
    value: float | str | bool | Sequence[float] | None
    behind: str = ""
    why: str = ""

    def plain(self) -> dict[str, Any]:
        """As plain data, for a manifest."""
        value = list(self.value) if isinstance(self.value, (list, tuple)) else self.value
        known = {"file": self.file, "key": self.key, "value": value}
        return known | ({"from": self.behind} if self.behind else {"default": self.why})
