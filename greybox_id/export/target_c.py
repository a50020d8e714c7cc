"""C99 of a model, with a self-test, an example and a CMake target."""

from __future__ import annotations

from collections.abc import Mapping

from .. import __version__
from ..errors import BadInput
from ..motion_model import MotionModel
from .c.build import cmake, read_me
from .c.example import example
from .c.motion import MotionC
from .c.naming import comment
from .c.self_test import self_test
from .subject import Subject


def files(subject: Subject) -> Mapping[str, bytes]:
    """The files of an export, by name."""
    model, name = subject.model, subject.name
    title = comment(
        f"{name}: {model.about} ({model.name}), from {subject.source or 'Python'}, by greybox-id {__version__}."
    )
    if isinstance(model, MotionModel):
        written = MotionC(name, subject.equations, title)
    else:
        raise BadInput(f"{model.name} cannot be written in C yet.")
    texts = {
        f"{name}.h": written.header,
        f"{name}.c": written.source,
        f"{name}_test.c": self_test(written),
        "main.c": example(written),
        "CMakeLists.txt": cmake(name),
        "README.md": read_me(written),
    }
    return {file: text.encode() for file, text in texts.items()}
