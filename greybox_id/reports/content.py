"""What a report says, as plain data: sentences and tables of words. Here stands what reports of all models say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..fit import Fit
from ..provenance import DataRecord
from ..signals import unit_of
from .document import Pairs, Part, Points, Table, Text, VerdictBox, titled
from .noise import Noise
from .numbers import capital, counted, listed, number, pretty_unit, signal_words
from .recordings import Seen, of_role

ROLE_WORDS = {"train": "training", "validate": "validation"}


@dataclass(frozen=True, kw_only=True)
class Content:
    """Everything a report says.

    Attributes
    ----------
    model, about : name of the model and one sentence on it.
    verdict : three sentences.
    errors : by output, and by protocol or horizon.
    noise : a sentence on the sensors' noise.
    recordings, provenance : files seen, and (what, value) pairs.
    parameters : physical (scalar) parameters; together: what cannot be distinguished.
    stages : how it was fitted.
    """

    model: str
    about: str
    verdict: tuple[str, ...]
    errors: Table
    noise: str
    recordings: Table
    provenance: tuple[tuple[str, str], ...]
    parameters: Table
    together: tuple[str, ...]
    stages: Table


def circumstances(fit: Fit, recordings: Sequence[Seen], role: str, *, chose: str = "") -> str:
    """On which recordings a fit is judged, how long they are, and whether it has seen them.

    Parameters
    ----------
    fit, recordings : the fit and what it saw.
    role : "train" or "validate".
    chose : what the validation recording chose, if anything.
    """
    data = of_role(recordings, role)
    seconds = sum(one.recording.duration for one in data)
    where = listed([one.recording.name for one in data])
    if role == "train":
        return f"On {where}, the {seconds:.1f} s it was fitted to (no recording was held back)"
    if chose:
        return f"On {where}, {seconds:.1f} s that it was not fitted to but that chose {chose}"
    return f"On {where}, {seconds:.1f} s that it has not seen"


def noise_words(outputs: Sequence[str], noise: Noise | None) -> str:
    """How large the sensors' noise is, and where it was heard."""
    if noise is None:
        return (
            "The recordings hold no stretch at rest or straight at constant speed that is long enough to hear the "
            "sensors' noise alone; it is left out."
        )
    each = [
        f"{number(noise.sd(name))} {pretty_unit(unit_of(name))} in {signal_words(name)}"
        for name in outputs
        if np.isfinite(noise.sd(name))
    ]
    caveat = (
        " At rest there is no vibration of motor and road: it is a lower bound." if noise.where == "at rest" else ""
    )
    return (
        f"The sensors' noise, heard {noise.where} ({noise.seconds:.1f} s in "
        f"{counted(len(noise.stretches), 'stretch', 'stretches')}), has a standard deviation of "
        f"{' and '.join(each) or 'unknown size'}.{caveat}"
    )


def recorded(fit: Fit) -> Table:
    """The recordings that a fit saw."""
    return recorded_in(fit.data, ROLE_WORDS)


def recorded_in(data: Sequence[DataRecord], roles: Mapping[str, str]) -> Table:
    """Recordings, what each was for, in words, and how large it is."""
    head = ("role", "recording", "sha256", "column map", "runs", "samples", "duration")
    rows = tuple(
        (
            roles.get(d.role, d.role), d.path.replace("\\", "/").rsplit("/", 1)[-1] or d.name,
            d.sha256[:12] or "in memory", d.columns or "–", str(d.runs), str(d.samples), f"{d.duration:.2f} s",
        )
        for d in data
    )  # fmt: skip
    return Table(head, rows, "lLllrrr")


def made_with(fit: Fit, *more: tuple[str, str]) -> tuple[tuple[str, str], ...]:
    """What a fit was made with and what reproduces it, as (what, value) pairs."""
    return (
        ("version", f"greybox-id {fit.version}"),
        ("command", fit.command or "not recorded (fitted from Python)"),
        ("seed", str(fit.seed)),
        *more,
        ("effects added", ", ".join(fit.model.effects) or "none"),
    )


def opening(fit: Fit, said: Content, leads: tuple[str, str, str]) -> tuple[Part, ...]:
    """The verdict, each sentence behind its lead; whether the fit can be used first."""
    return (VerdictBox((*can_be_used(fit), *zip(leads, said.verdict, strict=True))),)


def can_be_used(fit: Fit) -> tuple[tuple[str, str], ...]:
    """The verdict on a fit with its reasons, behind its lead; nothing where nobody judged it."""
    if fit.verdict is None:
        return ()
    return (("Verdict", " ".join([f"{capital(fit.verdict.usability)}.", *fit.verdict.reasons])),)


def provenance(said: Content) -> tuple[Part, ...]:
    """Files and what reproduces the fit."""
    return titled("Provenance", said.recordings, Pairs(said.provenance))


def told_together(said: Content) -> tuple[Part, ...]:
    """What no recording can tell apart."""
    if not said.together:
        return ()
    lead = Text("by any recording, because the equations let them act together only:", lead="Cannot be distinguished")
    return (lead, Points(said.together))


OBJECTIVE = "The objective is half the sum of squares of residuals and priors, in standard deviations."
