"""Target `c`: C99 of a model, with a self-test, an example program, a CMake target and a README."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..base.version import __version__
from .c.memory import MemoryC
from .c.motion import MotionC
from .c.naming import c_comment, number
from .c.self_test import memory_self_test, self_test
from .equations import Equations, Named
from .memory_equations import equations_of
from .subject import Subject
from .template import filled


def cmake(name: str) -> str:
    """`CMakeLists.txt`: a library, its self-test and the example."""
    return filled("CMakeLists.txt", name, SOURCE="${CMAKE_CURRENT_SOURCE_DIR}")


def commands(name: str) -> str:
    """Shell commands that build the library, the self-test and the example."""
    return f"""\
    cmake -S . -B build && cmake --build build && ctest --test-dir build     # compares it with Python's numbers
    gcc -std=c99 -O2 {name}.c main.c -lm -o example && ./example
"""


def read_me(written: MotionC | MemoryC) -> str:
    """`README.md`: list of functions and build instructions."""
    functions = "\n".join(f"| `{function}` | {task} |" for function, task in written.tasks.items())
    return filled(
        "c_readme.md", written.name, TITLE=written.title, COMMANDS=commands(written.name), FUNCTIONS=functions,
        STACK=written.stack_bytes,
    )  # fmt: skip


def example(written: MotionC) -> str:
    """`main.c`: five seconds of a step steer, or of constant inputs, printed as CSV."""
    e = written.equations
    return filled(
        "c_motion_example.c", written.name, TITLE=written.title, LATE=bool(e.delayed), STEER=_steered(e.inputs),
        X=_at(e.states, 10.0), U=_at(e.inputs, 10.0),
    )  # fmt: skip


def memory_example(written: MemoryC) -> str:
    """`main.c`: five seconds of constant inputs with a step of the steering, on the model's own predictions, as CSV."""
    inputs = written.equations.inputs
    return filled(
        "c_memory_example.c", written.name, TITLE=written.title, STEER=_steered(inputs), U=_at(inputs, 2.0)
    )  # fmt: skip


def _steered(inputs: Sequence[Named]) -> bool:
    return any(item.name == "steer" for item in inputs)


def _at(entries: Sequence[Named], speed: float) -> str:
    """Values for a vehicle that drives straight on."""
    return ", ".join(number(speed if entry.name == "v_x" else 0.0) for entry in entries)


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
