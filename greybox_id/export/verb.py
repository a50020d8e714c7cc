"""Exporting a model to a controller or simulator.

Exports are folders of generated files with a manifest, written completely or not at all.

Results that are not models, such as a policy, are exported by packages through the entry point `greybox.exporters`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

from ..base.errors import BadInput, must_be_one_of
from ..base.extensions import EXPORTERS, extensions
from ..base.files import new_folder, replacing
from ..base.guard import claim, permit_folder
from ..base.json_data import format_of, read_json, without_nan
from .subject import KeyOrigin, Subject

MANIFEST = "manifest.json"
FORMAT = "greybox-export"


def write_folder(folder: Path, files: Mapping[str, bytes], about: Mapping[str, Any]) -> list[Path]:
    """Write files and their manifest to a temporary folder, then move it to its place.

    An existing folder is replaced if it is empty or an unmodified export.

    Parameters
    ----------
    files : path within the folder -> content.
    about : content of the manifest, in addition to the files' SHA-256.

    Raises
    ------
    BadInput : the folder holds other or modified files, or cannot be written.
    """
    claim(folder)
    _must_be_replaceable(folder, _words(about))
    manifest = {"format": FORMAT, **about, "files": {name: _sha256(content) for name, content in files.items()}}
    text = json.dumps(without_nan(manifest), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    with new_folder(folder) as made:
        for name, content in {**files, MANIFEST: text.encode()}.items():
            (made / name).parent.mkdir(parents=True, exist_ok=True)
            (made / name).write_bytes(content)
    return [folder / name for name in (*files, MANIFEST)]


def _must_be_replaceable(folder: Path, becomes: str) -> None:
    if not folder.exists() and not folder.is_symlink():
        return
    if not folder.is_dir() or folder.is_symlink():
        raise BadInput(f"{folder} is not a folder. Name another place with ‹out›.")
    present = {str(file.relative_to(folder)): file for file in folder.rglob("*") if not file.is_dir()}
    if not present:
        return
    body = _manifest(folder / MANIFEST) if MANIFEST in present else None
    written = body.get("files") if body is not None else None
    if written is None or body is None:
        raise BadInput(f"{folder} holds files that no export has written. Name a new folder with ‹out›.")
    other = [
        name for name, file in present.items() if name != MANIFEST and written.get(name) != _sha256(file.read_bytes())
    ]
    if other:
        raise BadInput(
            f"{folder} holds {', '.join(sorted(other)[:3])}, which the export there did not write or which was changed "
            "since. A new export would delete this. Name another place with ‹out›, or move it away."
        )
    permit_folder(folder, _words(body), becomes)


def _manifest(file: Path) -> Mapping[str, Any] | None:
    """The manifest of an export; None if the file is not one."""
    try:
        body = read_json(file)
    except BadInput:
        return None
    value = isinstance(body, dict) and body.get("format") == FORMAT and isinstance(body.get("files"), dict)
    return body if value else None


def _words(about: Mapping[str, Any]) -> str:
    """Description of an export by model and target: one of another model or target does not replace it."""
    model = about.get("model")
    named = model.get("name") if isinstance(model, Mapping) else None
    return f"an export of {named} for {about.get('target')}"


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


TARGETS = {
    "c": "C99 functions for a step, its derivatives, sensitivities and outputs, with a self-test and a CMake target",
    "casadi": "CasADi functions, serialised, and a Python module that loads them with named symbols",
    "acados": "a Python module that builds an AcadosModel",
    "onnx": "an ONNX graph of the step",
    "f1tenth": "parameter files of f1tenth_gym and of the ForzaETH race stack",
    "simulink": "parameters as .mat, an idnlgrey model and an S-function around the C code",
    "autoware": "parameter files of Autoware's planning simulator, vehicle and lateral controller",
    "ros2": "a parameter file for a ROS 2 node",
    "opendbc": "a snippet with CarParams for opendbc",
    "tir": "tyre property files of the Magic Formula 5.2, one per axle",
    "fmu": "functional mock-up units of FMI 2.0 and 3.0, with sources and binary",
}
"""Target -> files written for it, by the module `target_<name>` of this folder: it has a function `files`.

It may also have a mapping `ABOUT`, which is added to the manifest, a function `cautions`, sentences on what the files
lack, and a function `origins`, the origin of each of their keys.
"""


REFUSED = {
    "mjcf": "MuJoCo models Coulomb friction in contacts and no slip curve, so the identified tyres would be lost. "
    "Export as fmu or as c, and simulate that model together with MuJoCo.",
}
"""Targets that users request but that cannot represent the model: reason and alternative."""


ALONE = {"fmu": ".fmu"}
"""Target -> suffix of a single file that is sufficient for importers; such a file is written without a folder."""


def export(subject: Subject, target: str, folder: str | Path) -> list[Path]:
    """Write a model for a target into a folder, with a manifest.

    Parameters
    ----------
    subject : the model, its name and its origin.
    target : one of `TARGETS`.
    folder : of the export; an earlier export there is replaced as a whole. A unit may be a single file, "car.fmu" (FMI
        2.0).

    Returns
    -------
    The files written.

    Raises
    ------
    BadInput : there is no such target, it cannot represent the model, or the folder holds other files.
    """
    module = _module(target)
    write: Callable[[Subject], Mapping[str, bytes]] = module.files
    if Path(folder).suffix and Path(folder).suffix == ALONE.get(target):
        with replacing(claim(folder)) as beside:
            beside.write_bytes(write(subject)[f"{subject.name}{ALONE[target]}"])
        return [Path(folder)]
    about = {"target": target, **getattr(module, "ABOUT", {}), "lacking": cautions(subject, target)}
    if keys := origins(subject, target):
        about["keys"] = [key.plain() for key in keys]
    return write_folder(Path(folder), write(subject), about | subject.described())


def cautions(subject: Subject, target: str) -> list[str]:
    """Sentences on properties of the model that the target's files lack. Raises `BadInput` as `export` does."""
    function: Callable[[Subject], list[str]] = getattr(_module(target), "cautions", lambda subject: [])
    return function(subject)


def origins(subject: Subject, target: str) -> list[KeyOrigin]:
    """Origin of each key of the target's files, or the reason for its default. Raises `BadInput` as `export` does."""
    function: Callable[[Subject], list[KeyOrigin]] = getattr(_module(target), "origins", lambda subject: [])
    return function(subject)


def _module(target: str) -> ModuleType:
    if target in REFUSED:
        raise BadInput(f"There is no target {target}: {REFUSED[target]}")
    must_be_one_of(TARGETS, target, "There is no target")
    return import_module(f".target_{target}", __package__)


class Exporter(Protocol):
    """Writer of one kind of result.

    Attributes
    ----------
    format : of its result files, `base.json_data.Kind.format`.
    what : name of the kind, for people: "policy".
    targets : name -> what is written.
    """

    format: str
    what: str
    targets: Mapping[str, str]

    def load(self, path: str | Path) -> Any:
        """Load the result from a file."""

    def takes(self, result: object) -> bool:
        """Whether a value is a result of this kind."""

    def write(self, result: Any, named: ForeignResult, target: str, to: str | Path) -> list[Path]:
        """Write it for a target into a folder; returns the files."""


@dataclass(frozen=True)
class ForeignResult:
    """Name of files and functions, source of the result, and the command, for the manifest."""

    name: str
    source: str = ""
    command: str = ""


def exporter_of_file(path: str | Path) -> Exporter | None:
    """The exporter for a result file; None if it is a fit or of an unknown kind."""
    kind = format_of(path)
    return (
        next((extension for extension in extensions(EXPORTERS).values() if extension.format == kind), None)
        if kind
        else None
    )


def exporter_of(result: object) -> Exporter:
    """The exporter for a value. Raises `BadInput` if there is none."""
    for exporter in extensions(EXPORTERS).values():
        if exporter.takes(result):
            return exporter  # type: ignore[no-any-return]
    raise BadInput(f"model: a Fit, a Model, its name or a saved policy is needed, not {result!r:.60}.")
