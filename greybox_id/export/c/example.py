"""A C program that shows how an export is used."""

from __future__ import annotations

from collections.abc import Sequence

from ..equations import Named
from ..template import filled
from .memory import MemoryC
from .motion import MotionC
from .naming import number


def example(written: MotionC) -> str:
    """`main.c`: five seconds of a step steer, or of whatever inputs there are, printed as CSV."""
    e = written.equations
    return filled(
        "c_motion_example.c", written.name, TITLE=written.title, LATE=bool(e.delayed), STEER=_steered(e.inputs),
        X=_at(e.states, 10.0), U=_at(e.inputs, 10.0),
    )  # fmt: skip


def memory_example(written: MemoryC) -> str:
    """`main.c`: five seconds of steady inputs with a step of the steering, on the map's own predictions, as CSV."""
    inputs = written.equations.inputs
    return filled(
        "c_memory_example.c", written.name, TITLE=written.title, STEER=_steered(inputs), U=_at(inputs, 2.0)
    )  # fmt: skip


def _steered(inputs: Sequence[Named]) -> bool:
    return any(item.name == "steer" for item in inputs)


def _at(entries: Sequence[Named], speed: float) -> str:
    """Numbers of a vehicle that drives straight on."""
    return ", ".join(number(speed if entry.name == "v_x" else 0.0) for entry in entries)
