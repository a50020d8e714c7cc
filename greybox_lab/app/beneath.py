"""What the page takes from the library beside `gb` itself: words, units, colours, equations, maps by name."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from threading import get_ident

import numpy as np

from greybox_id.base.errors import GreyboxError
from greybox_id.base.numbers import counted, number, percent, pretty_unit, with_interval
from greybox_id.base.shorthands import Array
from greybox_id.base.signals import SIGNALS, unit_of
from greybox_id.datasets.column_map import shipped_maps
from greybox_id.datasets.recording import Recording
from greybox_id.models.motion_model import MotionModel as Model
from greybox_id.reports.figures.style import BLUE, FAINT, INK, ORANGE, PALE, PURPLE, RUST, SKY

__all__ = [
    "BLUE", "FAINT", "INK", "ORANGE", "PALE", "PURPLE", "RUST", "SIGNALS", "SKY", "Array", "GreyboxError", "counted",
    "equations", "free_runs", "number", "percent", "pretty_unit", "sentence", "shipped_maps", "unit_of",
    "with_interval", "write_atomically",
]  # fmt: skip


def equations(model: Model) -> list[str]:
    """The model's equations as MathML, written by the model itself; escaped by their typesetter."""
    from greybox_id.reports.equations.expression import readable
    from greybox_id.reports.equations.tracing import traced
    from greybox_id.reports.equations.typesetting import in_mathml

    shown, _ = readable(traced(model))
    return [in_mathml(equation) for equation in shown]


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
    from greybox_id.engine.motion.prediction import Predictor
    from greybox_id.engine.motion.simulator import Simulator

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
