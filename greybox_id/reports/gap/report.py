"""The report of a diagnosis, part by part."""

from __future__ import annotations

from pathlib import Path

from ...gap import Gap
from ...models.effects import EFFECTS
from ...models.registry import build
from ...motion_model import MotionModel
from ..document import Document, Formulas, Pairs, Part, Points, Text, Together, Verdict, titled
from ..equations.motion import motion_equations
from ..equations.shared import readable
from ..numbers import listed
from ..report import write
from .content import GapContent, Made, gap_content, likely
from .page import drawings

DOUBTS = "What is wrong with the data looks like a gap; it is better mended before effects are sought."
RANKING = (
    "Probability: that the effect is there. Gain: of the log-likelihood over the model without it, beside the other "
    "applied effects. Effects that cannot be told apart share what there is to be told."
)
CLOSURE = (
    "Mean squares of the errors over those of the noise, all channels alike. The excess is what lies above the floor, "
    "the error of a model that fits as well as noise lets it; intervals of 95 % are from paired blocks of time."
)
MATHEMATICS = (
    "The equations that change where an effect is added, written down from the model itself. A dot is a derivative by "
    "time, w an abbreviation; a prime marks what an effect alters, late what a delay leaves, read what a sensor reads."
)
METHOD = (
    (
        "Gap",
        "Every run is simulated freely from its first readings. A p-value says how often noise and tolerances as "
        "stated would leave errors as large as these.",
    ),
    (
        "Which effect",
        "Each effect is put on the model, alone and with others, and estimated together with all that is stated with a "
        "tolerance. The likelihood gained, less a price for every effect, makes its probability; hypotheses that "
        "explain the recordings equally well share it.",
    ),
    (
        "How far",
        "Tolerances are refitted before and after. What is measured on recordings that chose the effects flatters "
        "them; recordings held out do not.",
    ),
    (
        "Unknown",
        "What exceeds the noise and what rough equations may be off by, is still explained by how the vehicle was "
        "driven, or needs a magnitude that changes along the drive, has no name among the effects.",
    ),
)
ERRORS = "RMSE before → after (floor), from measured states over each horizon, and in free run."


def write_report(gap: Gap, made: Made, out: str | Path, kind: str | None = None) -> Path:
    """Write the report of a diagnosis as PDF or HTML, as `kind` or the file's name says, atomically.

    Parameters
    ----------
    gap : the diagnosis.
    made : what it was made with.
    out : file to write.
    kind : "pdf" or "html".

    Raises
    ------
    BadInput : `out` cannot be written.
    """
    return write(gap_report(gap, made), out, kind)


def gap_report(gap: Gap, made: Made) -> Document:
    """What the report of a diagnosis says and shows."""
    said = gap_content(gap, made)
    parts = (
        Verdict(said.verdict),
        *drawings(gap),
        *(titled("Doubts on the data", Text(DOUBTS, small=False), Points(said.doubts)) if said.doubts else ()),
        *_which(said),
        *_mathematics(gap, made),
        *titled("What could not be told", Points(said.apart), said.silent, Text(said.absorbed)),
        *titled("How far the gap closes", Text(" ".join(said.judged), small=False), said.closures, Text(CLOSURE)),
        *(part for title, table in said.errors for part in titled(title, table, level=2)),
        Text(ERRORS if said.errors else ""),
        *titled("Where it lies", said.equations, said.channels, said.regimes),
        *titled("How it was found", *(Text(words, lead=f"{lead}:") for lead, words in METHOD)),
        *titled("How to make it again", said.recordings, Pairs(said.provenance)),
    )
    return Document(said.model, said.about, "a gap", f"greybox-id {made.version}", parts)


def _which(said: GapContent) -> tuple[Part, ...]:
    if not said.ranking.rows:
        return titled("Which effect", Text("No named effect stands out.", small=False))
    evidence = (Text(words, lead=f"{effect.replace('_', ' ')}:") for effect, words in said.evidence)
    runner_up = (Text(said.runner_up, lead="Runner-up:"),) if said.runner_up else ()
    return titled("Which effect", said.ranking, Text(RANKING), *evidence, *runner_up)


def _mathematics(gap: Gap, made: Made) -> tuple[Part, ...]:
    """The equations that each likely effect puts in the place of the model's."""
    model = build(gap.model, made.settings, {})
    if not isinstance(model, MotionModel):
        return ()
    before = set(motion_equations(model))
    parts: list[Part] = []
    for own in likely(gap):
        effect = EFFECTS.get(own.effect)
        if effect is None or not effect.concerns(model):
            continue
        changed = [line for line in motion_equations(model + effect.starting_at(effect.typical)) if line not in before]
        shown, _ = readable(changed)
        lead = f"{own.effect.replace('_', ' ')}:"
        if shown:
            parts.append(Together((Text("", lead=lead), Formulas(shown))))
        else:
            parts.append(Text(f"acts before or behind the equations, on {listed([*effect.touches])}.", lead=lead))
    return titled("What these effects do to the equations", Text(MATHEMATICS if parts else ""), *parts)
