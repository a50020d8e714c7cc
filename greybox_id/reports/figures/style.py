"""What figures share: how protocols are drawn, how levels of a quantity are told apart, and labels with units."""

from __future__ import annotations

from ...recording import Recording
from ...scores.metrics import FREE_RUN, ahead
from ...signals import SIGNALS
from ..numbers import pretty_unit
from ..plot.palette import BLUE, CHAIN, DASHED, DOTTED, INK, NIGHT, ORANGE, PALE, SKY, Line
from ..words import spans

MEASURED = Line(INK, width=1.2, words="measured")
NOISE = Line(PALE, CHAIN, 1.3, "noise")
NEAR = 0.5
"""Of all horizons, s, the one that is drawn beside the free run."""

PROTOCOL_LINES = {
    "honest": Line(ORANGE, width=1.0, words="one sample ahead"),
    "published": Line(PALE, DOTTED, 1.0, "as published"),
    "closed_loop": Line(BLUE, DASHED, 1.1, "closed loop"),
    ahead(NEAR): Line(ORANGE, width=1.0, words=ahead(NEAR)),
    FREE_RUN: Line(BLUE, DASHED, 1.1, FREE_RUN),
}
"""By protocol of `greybox_id.scores.metrics`."""

LEVELS = (Line(SKY), Line(BLUE, DASHED), Line(NIGHT, CHAIN))
"""An ordered quantity, low to high."""


def symbol(name: str) -> str:
    """A signal's or parameter's name in a figure: yaw_rate in words, a_x left to be set as a symbol."""
    if name in SIGNALS and not spans(name)[0].symbol:
        return name.replace("_", " ")
    return name if spans(name)[0].symbol or len(name) == 1 else name.replace("_", " ")


def label(name: str, unit: str) -> str:
    """An axis label: a name and its unit in brackets."""
    return f"{symbol(name)} [{pretty_unit(unit)}]"


def signal_label(recording: Recording, name: str) -> str:
    """An axis label of a signal of a recording."""
    return label(name, recording.unit(name))
