"""How an export is built, for CMake and for people."""

from __future__ import annotations

from .memory import MemoryC
from .motion import MotionC


def cmake(name: str) -> str:
    """`CMakeLists.txt`: a library, its self-test and the example."""
    return f"""\
cmake_minimum_required(VERSION 3.16)
project({name} C)

add_library({name} STATIC {name}.c)
target_include_directories({name} PUBLIC ${{CMAKE_CURRENT_SOURCE_DIR}})
set_target_properties({name} PROPERTIES C_STANDARD 99 C_STANDARD_REQUIRED ON C_EXTENSIONS OFF)
set_target_properties({name} PROPERTIES POSITION_INDEPENDENT_CODE ON)
if(NOT MSVC)
    target_link_libraries({name} PUBLIC m)
endif()

if(CMAKE_SOURCE_DIR STREQUAL CMAKE_CURRENT_SOURCE_DIR)
    if(NOT CMAKE_BUILD_TYPE)
        set(CMAKE_BUILD_TYPE Release)
    endif()
    enable_testing()
    add_executable({name}_test {name}_test.c)
    target_link_libraries({name}_test {name})
    add_test(NAME {name} COMMAND {name}_test)
    add_executable({name}_example main.c)
    target_link_libraries({name}_example {name})
endif()
"""


def commands(name: str) -> str:
    """Of a shell, that build the library, the self-test and the example."""
    return f"""\
    cmake -S . -B build && cmake --build build && ctest --test-dir build     # compares it with Python's numbers
    gcc -std=c99 -O2 {name}.c main.c -lm -o example && ./example
"""


def read_me(written: MotionC | MemoryC) -> str:
    """`README.md`: what is there and how to build it."""
    name = written.name
    functions = "\n".join(f"| `{function}` | {task} |" for function, task in written.tasks.items())
    return f"""\
# {name}

{written.title}

{commands(name)}
`{name}.h` says what stands where in states, inputs, parameters and outputs, and in which unit; `manifest.json` adds
intervals and where the numbers come from. To use it in a project of your own: `{name}.c` and `{name}.h`, or
`add_subdirectory` and link `{name}`.

| function | |
|---|---|
{functions}

`{name}_default_parameters` holds the parameters as estimated; hand in others to change them. Nothing is allocated and
nothing is kept between calls but in what you hand in; a call takes at most {written.stack_bytes} bytes of stack.
"""
