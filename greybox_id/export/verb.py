"""The verb: a model written down for a controller or simulator elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from types import ModuleType

from ..errors import BadInput, near_or_all
from .folder import write_folder
from .subject import Subject

TARGETS = {
    "c": "C99: step, derivatives, sensitivities, outputs; a self-test and a CMake target",
    "casadi": "CasADi functions, serialised, and a Python module that loads them with named symbols",
    "acados": "a Python module that builds an AcadosModel",
    "onnx": "an ONNX graph of the step",
    "f1tenth": "parameter files of f1tenth_gym and of the ForzaETH race stack",
}
"""Target -> what is written for it, by the module of this folder `target_<name>`: a function `files`.

There may be a mapping `ABOUT`, which goes to the manifest, and a function `cautions`, sentences on what the files lack.
"""


def export(subject: Subject, target: str, folder: str | Path) -> list[Path]:
    """Write a model for a target into a folder, with a manifest.

    Parameters
    ----------
    subject : the model, its name and where it comes from.
    target : one of `TARGETS`.
    folder : where to; an earlier export there is replaced, whole.

    Returns
    -------
    The files written.

    Raises
    ------
    BadInput : there is no such target, the model cannot be written for it, or the folder holds other files.
    """
    module = _module(target)
    write: Callable[[Subject], Mapping[str, bytes]] = module.files
    about = {"target": target, **getattr(module, "ABOUT", {}), "lacking": cautions(subject, target)}
    return write_folder(Path(folder), write(subject), about | subject.described())


def cautions(subject: Subject, target: str) -> list[str]:
    """Sentences on what the model knows and the target's files do not hold. Raises `BadInput` as `export` does."""
    told: Callable[[Subject], list[str]] = getattr(_module(target), "cautions", lambda subject: [])
    return told(subject)


def _module(target: str) -> ModuleType:
    if target not in TARGETS:
        raise BadInput(f"There is no target {target!r}.{near_or_all(target, TARGETS)}")
    return import_module(f".target_{target}", __package__)
