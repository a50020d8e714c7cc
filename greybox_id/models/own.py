"""Models and effects from a file of one's own, named FILE.py:NAME. Naming a file runs it: only a person may do so."""

from __future__ import annotations

import hashlib
import re
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

from ..base.errors import BadInput, near_or_all
from ..base.files import near_file
from .effect import Effect
from .model import Model
from .registry import register

_PLACE = re.compile(r"(.+\.py):([^\W\d]\w*)")


def is_place(text: str) -> bool:
    """Whether a text names something in a file of one's own: my_car.py:my_model."""
    return _PLACE.fullmatch(text) is not None


def own_model(place: str) -> Model:
    """The model of that name in a file, made known by its own name.

    Parameters
    ----------
    place : FILE.py:NAME, where NAME is a model or a function without arguments that makes one.

    Raises
    ------
    BadInput : the file is not there or does not run, or it has no model of that name.
    """
    result = _named(place)
    made = result if isinstance(result, Model) or not callable(result) else _called(result, place)
    if not isinstance(made, Model):
        raise BadInput(f"{place} is no model but {made!r:.60}; name a MotionModel, or a function that makes one.")
    register(made)
    return made


def own_effect(place: str) -> Effect:
    """The effect of that name in a file, made known by its own name. Raises `BadInput` as `own_model` does."""
    result = _named(place)
    if not isinstance(result, Effect):
        raise BadInput(
            f"{place} is no effect but {result!r:.60}; make one with gb.effects.alteration or gb.effects.Effect."
        )
    register(result)
    return result


def own(place: str) -> Model | Effect:
    """The model or the effect of that name in a file, made known. Raises `BadInput` as `own_model` does."""
    return own_effect(place) if isinstance(_named(place), Effect) else own_model(place)


def _named(place: str) -> object:
    match = _PLACE.fullmatch(place)
    if match is None:
        raise BadInput(f"{place!r} is not FILE.py:NAME, as in my_car.py:my_model.")
    file, name = Path(match[1]), match[2]
    module = _loaded(file)
    if not hasattr(module, name):
        there = [name for name, thing in vars(module).items() if isinstance(thing, Model | Effect)]
        raise BadInput(
            f"{file} has no {name}.{near_or_all(name, there) if there else ' It has no model and no effect.'}"
        )
    return getattr(module, name)


def _loaded(file: Path) -> ModuleType:
    """The file run as a module, once for each content."""
    try:
        content = file.read_bytes()
    except OSError as error:
        raise BadInput(f"{file} cannot be read ({error.strerror}).{near_file(file)}") from error
    called = f"own_{hashlib.sha256(str(file.resolve()).encode() + content).hexdigest()[:16]}"
    if called in sys.modules:
        return sys.modules[called]
    spec = spec_from_file_location(called, file)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[called] = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[called]
        raise _failed(file, error) from error
    return module


def _failed(file: Path, error: BaseException) -> BadInput:
    return BadInput(f"{file}{_line_of(error, file)}: {type(error).__name__}: {error}")


def _called(function: object, place: str) -> object:
    assert callable(function)
    try:
        return function()
    except TypeError as error:
        raise BadInput(f"{place} cannot be called without arguments: {error}") from error
    except (Exception, SystemExit) as error:
        raise _failed(Path(place.rpartition(":")[0]), error) from error


def _line_of(error: BaseException, file: Path) -> str:
    """The line of the file at which it went wrong."""
    if isinstance(error, SyntaxError):
        return f", line {error.lineno}"
    line, trace = None, error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(file.absolute()):
            line = trace.tb_lineno
        trace = trace.tb_next
    return f", line {line}" if line else ""
