"""How an export is built, for CMake and for people."""

from __future__ import annotations

from ..template import filled
from .memory import MemoryC
from .motion import MotionC


def cmake(name: str) -> str:
    """`CMakeLists.txt`: a library, its self-test and the example."""
    return filled("CMakeLists.txt", name, SOURCE="${CMAKE_CURRENT_SOURCE_DIR}")


def commands(name: str) -> str:
    """Of a shell, that build the library, the self-test and the example."""
    return f"""\
    cmake -S . -B build && cmake --build build && ctest --test-dir build     # compares it with Python's numbers
    gcc -std=c99 -O2 {name}.c main.c -lm -o example && ./example
"""


def read_me(written: MotionC | MemoryC) -> str:
    """`README.md`: what is there and how to build it."""
    functions = "\n".join(f"| `{function}` | {task} |" for function, task in written.tasks.items())
    return filled(
        "c_readme.md", written.name, TITLE=written.title, COMMANDS=commands(written.name), FUNCTIONS=functions,
        STACK=written.stack_bytes,
    )  # fmt: skip
