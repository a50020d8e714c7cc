"""C99 of a model, with a self-test, an example and a CMake target."""

from __future__ import annotations

from collections.abc import Mapping

from ..base.version import __version__
from .c.build import cmake, read_me
from .c.example import example, memory_example
from .c.memory import MemoryC
from .c.motion import MotionC
from .c.self_test import memory_self_test, self_test
from .equations import Equations
from .memory_equations import equations_of
from .quoting import c_comment
from .subject import Subject


def files(subject: Subject) -> Mapping[str, bytes]:
    """The files of an export, by name.

    Raises
    ------
    BadInput : the model is a hybrid.
    """
    name, source = subject.name, subject.source or "Python"
    title = c_comment(f"{name}: {subject.model.about} ({subject.model.name}), from {source}, greybox-id {__version__}.")
    equations = equations_of(subject)
    written: MotionC | MemoryC
    if isinstance(equations, Equations):
        written = MotionC(name, equations, title)
        programs = {f"{name}_test.c": self_test(written), "main.c": example(written)}
    else:
        written = MemoryC(name, equations, title)
        programs = {f"{name}_test.c": memory_self_test(written), "main.c": memory_example(written)}
    texts = {
        f"{name}.h": written.header,
        f"{name}.c": written.source,
        **programs,
        "CMakeLists.txt": cmake(name),
        "README.md": read_me(written),
    }
    return {file: text.encode() for file, text in texts.items()}
