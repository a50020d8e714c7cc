"""The verb: a model written down for a controller or simulator elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path

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
"""Target -> what is written for it, by the module of this folder `target_<name>`: a function `files`."""


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
    if target not in TARGETS:
        raise BadInput(f"There is no target {target!r}.{near_or_all(target, TARGETS)}")
    write: Callable[[Subject], Mapping[str, bytes]] = import_module(f".target_{target}", __package__).files
    return write_folder(Path(folder), write(subject), {"target": target, **subject.described()})
