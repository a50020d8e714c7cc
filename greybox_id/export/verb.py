"""The verb: a model written down for a controller or simulator elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from types import ModuleType

from ..base.errors import BadInput, near_or_all
from ..base.files import replacing
from ..base.guard import claim
from .folder import write_folder
from .origin import KeyOrigin
from .subject import Subject

TARGETS = {
    "c": "C99: step, derivatives, sensitivities, outputs; a self-test and a CMake target",
    "casadi": "CasADi functions, serialised, and a Python module that loads them with named symbols",
    "acados": "a Python module that builds an AcadosModel",
    "onnx": "an ONNX graph of the step",
    "f1tenth": "parameter files of f1tenth_gym and of the ForzaETH race stack",
    "simulink": "parameters as .mat, an idnlgrey model and an S-function around the C",
    "autoware": "parameter files of Autoware's planning simulator, vehicle and lateral controller",
    "ros2": "a parameter file for a ROS 2 node",
    "opendbc": "a snippet with CarParams for opendbc",
    "tir": "tyre property files of the Magic Formula 5.2, one an axle",
    "fmu": "functional mock-up units of FMI 2.0 and 3.0, sources and binary",
}
"""Target -> what is written for it, by the module of this folder `target_<name>`: a function `files`.

There may be a mapping `ABOUT`, which goes to the manifest, a function `cautions`, sentences on what the files lack, and
a function `origins`, what is behind each of their keys.
"""


REFUSED = {
    "mjcf": "MuJoCo knows Coulomb's friction in contacts and no slip curve: what was identified of the tyres would be "
    "lost. Export as fmu or as c, and step that beside MuJoCo.",
}
"""Targets that are asked for and would not hold what matters: why, and what to do."""


ALONE = {"fmu": ".fmu"}
"""Target -> ending of a file that holds all that its importers need; one named so is written without a folder."""


def export(subject: Subject, target: str, folder: str | Path) -> list[Path]:
    """Write a model for a target into a folder, with a manifest.

    Parameters
    ----------
    subject : the model, its name and where it comes from.
    target : one of `TARGETS`.
    folder : where to; an earlier export there is replaced, whole. A unit may be named by itself, "car.fmu" (FMI 2.0).

    Returns
    -------
    The files written.

    Raises
    ------
    BadInput : there is no such target, the model cannot be written for it, or the folder holds other files.
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
    """Sentences on what the model knows and the target's files do not hold. Raises `BadInput` as `export` does."""
    known: Callable[[Subject], list[str]] = getattr(_module(target), "cautions", lambda subject: [])
    return known(subject)


def origins(subject: Subject, target: str) -> list[KeyOrigin]:
    """What is behind each key of the target's files, or why it stands at a default. Raises `BadInput` as `export`."""
    known: Callable[[Subject], list[KeyOrigin]] = getattr(_module(target), "origins", lambda subject: [])
    return known(subject)


def _module(target: str) -> ModuleType:
    if target in REFUSED:
        raise BadInput(f"There is no target {target}: {REFUSED[target]}")
    if target not in TARGETS:
        raise BadInput(f"There is no target {target!r}.{near_or_all(target, TARGETS)}")
    return import_module(f".target_{target}", __package__)
