"""What the page takes from the library beside `gb` itself: words, units, colours, equations, maps by name."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import get_ident
from typing import TYPE_CHECKING, Any

import numpy as np

from greybox_id.base.errors import GreyboxError
from greybox_id.base.files import held
from greybox_id.base.numbers import counted, number, percent, pretty_unit, quantity
from greybox_id.base.shorthands import Array
from greybox_id.base.signals import SIGNALS, unit_of
from greybox_id.datasets.column_map import shipped_maps
from greybox_id.datasets.mapping.evidence import USUAL
from greybox_id.datasets.recording import Recording
from greybox_id.datasets.shipped import named_text
from greybox_id.models.motion_model import MotionModel as Model
from greybox_id.reports.figures.sheet import BLUE, FAINT, INK, ORANGE, PALE, PURPLE, RUST, SKY

if TYPE_CHECKING:
    from greybox_id import Fit as FitResult
    from greybox_id.gap.gap import Gap, Ranked

__all__ = [
    "BLUE", "FAINT", "INK", "ORANGE", "PALE", "PURPLE", "RUST", "SIGNALS", "SKY", "USUAL", "Array", "GreyboxError",
    "Model", "cause_words", "change_parts", "companion", "counted", "equations", "free_runs", "gap_parts", "held",
    "named_text", "number", "percent", "pretty_unit", "quantity", "read_gap", "report_parts", "sentence",
    "shipped_maps", "unit_of", "write_atomically",
]  # fmt: skip


def equations(model: Model) -> list[str]:
    """The model's equations as MathML, written by the model itself; escaped by their typesetter."""
    from greybox_id.reports.equations.expression import readable
    from greybox_id.reports.equations.tracing import traced
    from greybox_id.reports.equations.typesetting import in_mathml

    shown, _ = readable(traced(model))
    return [in_mathml(equation) for equation in shown]


def report_parts(fit: FitResult) -> str:
    """What the report says of estimates and of errors, as HTML."""
    from greybox_id.reports.document import Drawing, titled
    from greybox_id.reports.html import part_html
    from greybox_id.reports.motion import errors_by_horizon, estimates

    parts = (*estimates(fit), *titled("Errors by horizon", errors_by_horizon(fit, {})))
    return "\n".join(part_html(part) for part in parts if not isinstance(part, Drawing))


def gap_parts(gap: Gap) -> tuple[str, str]:
    """What the report of a diagnosis says first, and of what could be there unseen, as HTML."""
    from greybox_id.reports.document import Points, Text, VerdictBox, titled
    from greybox_id.reports.gap.report import limits_table, unseen
    from greybox_id.reports.gap.words import verdict
    from greybox_id.reports.html import part_html

    words = Text(" ".join(unseen(gap)), small=False)
    silent = titled("What could be present undetected", words, Points(gap.advice), limits_table(gap), level=2)
    return part_html(VerdictBox(tuple(verdict(gap)))), "".join(map(part_html, silent))


def change_parts(gap: Gap, answer: dict[str, Any]) -> str:
    """What changed, what did not, and of what recordings do not say whether it did, as HTML."""
    from greybox_id.reports.gap.report import what_changed
    from greybox_id.reports.html import part_html

    return "".join(map(part_html, what_changed(gap, answer)))


def read_gap(path: Path) -> Gap:
    """A diagnosis that `greybox gap` wrote. Raises `BadInput`."""
    from greybox_id.reports.gap.saved import load_gap

    return load_gap(path)[0]


def cause_words(cause: Ranked) -> str:
    """Magnitude and probability of a cause, as reports write them."""
    from greybox_id.reports.gap.words import magnitude_words, probability_words

    return f"{magnitude_words(cause)}, probability {probability_words(cause.probability)}"


def companion(recording: Recording, signal: str, values: Array) -> tuple[str, Array] | None:
    """What a signal, (n,) values, should look like by the others, where they say: in words, and (n,) in its SI unit."""
    from greybox_id.datasets.checks.pairs import pairs

    with np.errstate(all="ignore"):
        paired = pairs(replace(recording, signals={**recording.signals, signal: values}))
        return next(((pair.right, pair.right_values) for pair in paired if pair.nodes[0] == signal), None)


def write_atomically(path: Path, text: str) -> None:
    """Write a file of the session at once; unlike a command, the page writes over what it has read, such as its map."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.{get_ident()}")
    beside.write_text(text, "utf-8")
    os.replace(beside, path)


def free_runs(model: Model, recording: Recording) -> Callable[[Model], dict[str, Array]]:
    """What `gb.simulate` does with one model at many values: its equations are laid out and compiled once.

    Returns
    -------
    callable
        The same model with other values -> output -> (n,) free run, NaN in rows that are not predicted.
    """
    from greybox_id.engine.motion.simulator import Predictor, Simulator

    simulator = Simulator(model)
    simulator.kernel.prepare()

    def simulated(moved: Model) -> dict[str, Array]:
        run = Predictor(simulator, recording, moved.values).free_run()
        traces = {name: np.full(len(recording), np.nan) for name in model.outputs}
        for k, name in enumerate(model.outputs):
            traces[name][run.rows] = run.predicted[:, k]
        return traces

    return simulated


def sentence(error: Exception) -> str:
    """An error for people; names of arguments are read as options of the command line."""
    if isinstance(error, GreyboxError):
        return error.said(lambda argument: f"--{argument.replace('_', '-')}")
    return str(error) or type(error).__name__
