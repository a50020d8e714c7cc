"""Export of models as code or files for controllers and simulators."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..base.declared import understood
from ..base.errors import BadInput
from ..base.numbers import pretty_unit
from ..export.subject import KeyOrigin, Subject
from ..export.verb import ALONE, ForeignResult, cautions, exporter_of, exporter_of_file, origins
from ..export.verb import export as export_subject
from ..fitting.fit import Fit
from ..fitting.requested_model import Magnitudes, RequestedModel, magnitudes, with_choices
from ..models.model import Model
from ..models.registry import with_effects
from ..reports.text.screen import plain
from . import given
from .fitting import load as load_fit
from .given import Effects, ModelLike, Numbers, VehicleLike


class Exported(list[Path]):
    """The files of an export.

    Attributes
    ----------
    target, name : their purpose, and name used for functions.
    model : name of the model or kind of result.
    cautions : sentences on what the files do not include or assume.
    keys : for files of parameters, the origin of each key.
    """

    target: str
    name: str
    model: str
    cautions: tuple[str, ...]
    keys: tuple[KeyOrigin, ...]

    def __init__(
        self, files: Iterable[Path], target: str, name: str, model: str, cautions: Iterable[str] = (),
        keys: Iterable[KeyOrigin] = (),
    ) -> None:  # fmt: skip
        super().__init__(files)
        self.target, self.name, self.model = target, name, model
        self.cautions, self.keys = tuple(cautions), tuple(keys)

    def to_json(self) -> dict[str, Any]:
        """The object that `greybox export --json` prints."""
        keys, written = [key.plain() for key in self.keys], [str(file) for file in self]
        return {"target": self.target, "name": self.name, "model": self.model, "written": written, "keys": keys}


@understood
def export(
    model: ModelLike | Fit | Path | Any,
    to: str | Path,
    *,
    target: str = "c",
    name: str = "",
    parameters: str | Iterable[str] = "free",
    vehicle: VehicleLike = None,
    effects: Effects = (),
    fix: str | Iterable[str] | Numbers = (),
    source: str = "",
    command: str = "",
) -> Exported:
    """Export a model for a controller or a simulator.

    Parameters
    ----------
    model : a fit, a model such as `gap.closed_model`, a model's name, or a policy or its file, for which the targets
        are "c" and "onnx".
    to : folder, which is written completely or not at all; an earlier export is replaced, other files are not. A
        functional mock-up unit may be named itself, such as "car.fmu".
    target : "c", "casadi", "acados", "onnx", "f1tenth", "fmu", "simulink", "autoware", "ros2", "opendbc" or "tir".
    name : used for functions; by default the folder's name.
    parameters : which can be changed afterwards, others become constants: "free", "all", or a list of names.
    vehicle : with the numbers of a model given by name.
    effects, fix : effects that are added, and parameters that are fixed, at your own values.
    source, command : for the manifest: origin of the numbers, and command that reproduces the export.

    Returns
    -------
    Exported
        A list of the written files, including a manifest, with `cautions` and `keys`.

    Raises
    ------
    BadInput : if the target is unknown, the model is not suited to it, or the folder contains other files.

    Examples
    --------
    >>> import tempfile
    >>> import greybox_id as gb
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = gb.export(gb.models.lateral(vehicle="roboracer"), f"{folder}/car")
    >>> "car.c" in [file.name for file in files]
    True
    """
    if not isinstance(to, str | Path):
        raise BadInput(f"to: the path of a folder is needed, not {to!r:.60}.")
    name = name or identifier(to)
    if isinstance(model, Path) or (isinstance(model, str) and model.endswith(".json")):
        exporter, source = exporter_of_file(model), source or str(model)
        model = load_fit(model) if exporter is None else exporter.load(model)
    if not isinstance(model, Fit | Model | str | RequestedModel):
        exporter = exporter_of(model)
        files = exporter.write(model, ForeignResult(name, source, command), target, to)
        return Exported(files, target, name, exporter.what)
    fit, stated = model if isinstance(model, Fit) else None, given.vehicle(vehicle)
    if isinstance(model, RequestedModel):
        added, stated = dict(model.effects), model.vehicle
    else:
        objects, written = given.named_effects(effects)
        added = magnitudes(written)
        model = given.added(with_effects(given.model(model, stated), added), objects)
    exported = with_choices(given.model(model), given.choices(fix))
    where = source or (exported.name if fit is None else "fit")
    subject = Subject(exported, name, moving(exported, parameters), fit, where, command, stated)
    warnings = (*_assumed(exported, added), *cautions(subject, target))
    return Exported(
        export_subject(subject, target, to), target, name, exported.name, warnings, origins(subject, target)
    )


def _assumed(model: Model, stated: Magnitudes) -> list[str]:
    """Sentences on effects whose magnitude was not stated."""
    return [
        f"The exported code has {name} = {plain(float(model[name].array))} {pretty_unit(model[name].unit)}, the "
        f"typical size of the effect, since no size was stated. State one as {name}=VALUE."
        for name, magnitude in stated.items()
        if magnitude is None
    ]


def identifier(folder: str | Path) -> str:
    """A folder's name, converted to an identifier of C; for a single file, its name without suffix."""
    path = Path(folder).resolve()
    name = path.stem if path.suffix in ALONE.values() else path.name
    result = re.sub(r"\W+", "_", name.lower(), flags=re.ASCII).strip("_")
    if not result:
        raise BadInput(
            f"The folder's name {folder} cannot be used for names of functions; choose another name with ‹name›."
        )
    return result if result[0].isalpha() else f"model_{result}"


def moving(model: Model, text: str | Iterable[str]) -> tuple[str, ...] | None:
    """Names of the parameters that can be changed after an export: "free", "all" (None), or a list of names."""
    if text == "all":
        return None
    if text == "free":
        return tuple(p.name for p in model.parameters if not p.fixed)
    names = text.split(",") if isinstance(text, str) else text
    return tuple(name.strip() for name in given.listed(names, "parameters") if name.strip())
