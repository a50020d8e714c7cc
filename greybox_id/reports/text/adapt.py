"""An adaptation as text: what was selected, and its errors compared with the unchanged fit."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import RenderableType

from ...base.numbers import listed, number, pretty_unit, with_sd
from ...base.signals import unit_of
from ...fitting.adaptation.verb import Adaptation
from ...models.motion_model import MotionModel
from .screen import led, plain_table

MOST_MOVED = 8
"""Most parameters that are named."""


def parts(result: Adaptation) -> Iterator[RenderableType]:
    """The text of an adaptation, part by part."""
    for doubt in result.doubts:
        yield led("doubt", doubt)
    outputs_of: dict[str, list[str]] = {}
    for output, words in result.choices.items():
        outputs_of.setdefault(words, []).append(output)
    for words, outputs in outputs_of.items():
        what = "the unchanged fit" if words == "zero-shot" else words
        yield led("chosen", f"for {listed(outputs)}: {what}")
    if any("strength" in words for words in outputs_of):
        yield led("", "strength of the priors: the smaller it is, the further parameters may move from the fit")
    for run, delays in result.delays.items():
        run_delays = ", ".join(f"{output} {round(1e3 * delay) or 0:+d} ms" for output, delay in delays.items())
        yield led(
            "timing",
            f"run {run}: delays of readings after inputs, compared with the training data of the fit: {run_delays}",
        )
    if result.moved:
        names = [f"{name} ({count})" if count > 1 else name for name, count in list(result.moved.items())[:MOST_MOVED]]
        yield led("moved", f"by more than two of their standard deviations in the fit: {', '.join(names)}")
    yield ""
    if not result.zero_shot.rest:
        yield led("rest", f"no rows are left after the {result.seconds:g} s of the adaptation, so nothing is scored")
        for output, item in result.in_sample.items():
            unit = pretty_unit(unit_of(output))
            yield led("", f"{output}, on the seconds of the adaptation: RMSE {number(item['rmse'])} {unit}")
        return
    ahead = ", 0.5 s ahead" if isinstance(result.fit.model, MotionModel) else ""
    table = plain_table(
        f"RMSE on the rest{ahead}", "unit", "before adaptation", "after adaptation", "95 % interval expected after"
    )
    for output, error in result.chosen.rest.items():
        before, (low, high) = result.zero_shot.rest[output], result.chosen.interval[output]
        table.add_row(
            output, pretty_unit(unit_of(output)), with_sd(before.rmse, before.rmse_sd),
            with_sd(error.rmse, error.rmse_sd),
            f"[{number(low)}, {number(high)}]",
        )  # fmt: skip
    yield table
