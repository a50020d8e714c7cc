"""Additional text on a fit of a model with memory: strengths of priors, and delays of runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rich.console import RenderableType

from ...fitting.fit import Fit
from ...models.memory_model import MemoryModel
from .fit import chosen_lines, error_parts, errors_table
from .screen import led

MS = 1e3


def timing_lines(timing: Mapping[str, Any]) -> Iterator[str]:
    """A line per run: the delay of each output relative to the inputs, with its standard deviation.

    Parameters
    ----------
    timing : from `greybox_id.fitting.scores.timing.Timing.as_dict`.
    """
    seconds = timing["seconds"]
    source = "" if seconds is None else f", estimated from its first {seconds:g} s of motion"
    for run, outputs in timing["runs"].items():
        delays = ", ".join(f"{name} {_late(output['delay'], output['sd'])}" for name, output in outputs.items())
        yield f"run {run}: {delays}{source}"


def _late(delay: float, sd: float) -> str:
    if abs(MS * delay) < 0.5:
        return f"0 ± {MS * sd:.0f} ms"
    return f"{abs(MS * delay):.0f} ± {MS * sd:.0f} ms {'late' if delay > 0 else 'early'}"


@chosen_lines.register(MemoryModel)
def _strengths(model: MemoryModel, result: Fit) -> Iterator[str]:
    strengths = ", ".join(f"{k} {v:g}" for s in result.stages if not s.closed_loop for k, v in s.strengths.items())
    yield f"priors   strengths of the priors of the weights: {strengths or 'as stated'} ({result.mode})"


@error_parts.register(MemoryModel)
def _errors(model: MemoryModel, result: Fit) -> Iterator[RenderableType]:
    yield ""
    yield errors_table(result.metrics, model.unit)
    if "validate" in result.how.get("timing", {}):
        yield ""
        for line in timing_lines(result.how["timing"]["validate"]):
            yield led("timing", f"held out, {line}; delays of readings after inputs, compared with the training data")
