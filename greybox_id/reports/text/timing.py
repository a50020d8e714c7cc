"""Delays of runs in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

MS = 1e3


def timing_lines(timing: Mapping[str, Any]) -> Iterator[str]:
    """A line for each run: the delay of each output against the inputs, with its standard deviation.

    Parameters
    ----------
    timing : what `greybox_id.scores.timing.Timing.as_dict` gives.
    """
    seconds = timing["seconds"]
    told = "" if seconds is None else f", told by its first {seconds:g} s of motion"
    for run, outputs in timing["runs"].items():
        said = ", ".join(f"{name} {_late(own['delay'], own['sd'])}" for name, own in outputs.items())
        yield f"run {run}: {said}{told}"


def _late(delay: float, sd: float) -> str:
    if abs(MS * delay) < 0.5:
        return f"0 ± {MS * sd:.0f} ms"
    return f"{abs(MS * delay):.0f} ± {MS * sd:.0f} ms {'late' if delay > 0 else 'early'}"
