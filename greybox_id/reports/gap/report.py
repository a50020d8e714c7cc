"""The report of a diagnosis, part by part."""

from __future__ import annotations

from pathlib import Path

from ...gap import Gap
from ...memory_model import MemoryModel
from ...model import Model
from ...models.effects import EFFECTS
from ...models.registry import build
from ...motion_model import MotionModel
from ..document import Document, Formulas, Pairs, Part, Points, Text, Together, VerdictBox, titled
from ..equations.expression import Equation
from ..equations.memory import memory_equations
from ..equations.motion import motion_equations
from ..equations.shared import readable
from ..numbers import listed
from ..report import write
from . import unseen
from .content import GapContent, Made, gap_content, likely
from .page import drawings

DOUBTS = "What is wrong with the data looks like a gap; it is better mended before effects are sought."
RANKING = (
    "Probability: that the effect is there. Gain: of the log-likelihood over the model without it, beside the other "
    "applied effects. Effects that cannot be distinguished share the evidence."
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
        "Each effect is put on the model, alone and with others, and estimated together with all that is stated with "
        "a tolerance, beside unknown forces and coloured sensors, which every explanation has. The likelihood gained, "
        "less a cost for every effect, makes its probability; hypotheses that explain the recordings equally well "
        "share it.",
    ),
    (
        "How far",
        "Tolerances are refitted before and after. What is measured on recordings that chose the effects flatters "
        "them; recordings held out do not.",
    ),
    (
        "Unknown",
        "Unknown forces that stay larger beside the named effects than equations usually err by, or readings that "
        "scatter by more than their stated noise, are unmodelled effects.",
    ),
)
ERRORS = "RMSE before → after (floor), from measured states over each horizon, and in free run."
ERRORS_ALONE = "RMSE (floor), from measured states over each horizon, and in free run."
LIMITS = (
    "Would show from: twice the standard deviation that an effect's magnitude would have here, to first order, once "
    "all that is stated with a tolerance is refitted; told: the share of what the recordings say of it that "
    "tolerances do not take up. Effects whose size has a threshold, such as plays, are found by refits alone and left "
    "out."
)
CHANNELS = (
    "Where a model leaves nothing but noise, errors over noise are one, in free run and at every frequency; the last "
    "two columns say at which frequency the errors of the model as it was exceed noise most."
)
STATED = (
    "What is exact is taken as it stands; a tolerance is refitted and charged for, and no gap as long as it suffices."
)
EQUATIONS = "The simulation that was compared, written down from the model itself, with the effects it has."


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
        VerdictBox(said.verdict),
        *drawings(gap),
        *_data(gap, said),
        *(_which(said) if gap.gap_detected else ()),
        *(_mathematics(gap, made) if gap.gap_detected else ()),
        *titled(
            "What could be there unseen", Text(" ".join(unseen.sentences(gap)), small=False), Points(said.apart),
            unseen.limits(gap), Text(LIMITS if gap.limits else ""), Text(said.absorbed),
        ),
        *_how_far(gap, said),
        *titled("Where it lies" if gap.gap_detected else "Where it was driven", said.equations, said.regimes),
        *(titled("What was tried", said.ranking, Text(RANKING)) if said.ranking.rows and not gap.gap_detected else ()),
        *_simulated(made, gap),
        *titled("How it was found", *(Text(words, lead=f"{lead}:") for lead, words in METHOD)),
        *titled("How to make it again", said.recordings, Pairs(said.provenance)),
    )  # fmt: skip
    return Document(said.model, said.about, "a gap", f"greybox-id {made.version}", parts)


def _data(gap: Gap, said: GapContent) -> tuple[Part, ...]:
    """Whether the data are to be trusted."""
    if said.doubts:
        return titled("Doubts on the data", Text(DOUBTS, small=False), Points(said.doubts))
    noise = (
        "The noise of the sensors is stated." if gap.noise_stated else "No sensor noise is stated: what the best "
        "explanation leaves is taken for it, so that a gap without a name cannot show."
    )  # fmt: skip
    words = f"Units, signs, time and delays of {listed([*gap.recordings])} are not to be doubted. {noise}"
    return titled("Are the data to be trusted", Text(words, small=False))


def _which(said: GapContent) -> tuple[Part, ...]:
    if not said.ranking.rows:
        return titled("Which effect", Text("No named effect stands out.", small=False))
    evidence = (Text(words, lead=f"{effect.replace('_', ' ')}:") for effect, words in said.evidence)
    runner_up = (Text(said.runner_up, lead="Runner-up:"),) if said.runner_up else ()
    return titled("Which effect", said.ranking, Text(RANKING), *evidence, *runner_up)


def _how_far(gap: Gap, said: GapContent) -> tuple[Part, ...]:
    """How far the gap closes, or how far the simulation is from the recordings where there is none."""
    title = "How far the gap closes" if gap.gap_detected else "How far simulation and vehicle are apart"
    errors = ERRORS if gap.applied else ERRORS_ALONE
    return (
        *titled(title, Text(" ".join(said.judged), small=False), said.closures, Text(CLOSURE)),
        *(part for title, table in said.errors for part in titled(title, table, level=2)),
        Text(errors if said.errors else ""),
        *titled("Errors beside noise", unseen.channels(gap), Text(CHANNELS), level=2),
    )


def _simulated(made: Made, gap: Gap) -> tuple[Part, ...]:
    """The model that was compared, and what is stated of its vehicle."""
    model = build(gap.model, made.settings, made.effects)
    found, left_out = readable(memory_equations(model) if isinstance(model, MemoryModel) else _of_motion(model))
    more = f" {left_out} abbreviations are left out for their number." if left_out else ""
    table = unseen.stated(made)
    return titled(
        "What was simulated", table, Text(STATED if table.rows else ""), Text(EQUATIONS + more), Formulas(found)
    )


def _of_motion(model: Model) -> tuple[Equation, ...]:
    return motion_equations(model) if isinstance(model, MotionModel) else ()


def _mathematics(gap: Gap, made: Made) -> tuple[Part, ...]:
    """The equations that each likely effect puts in the place of the model's."""
    model = build(gap.model, made.settings, made.effects)
    if not isinstance(model, MotionModel):
        return ()
    before = set(motion_equations(model))
    parts: list[Part] = []
    for own in likely(gap):
        effect = EFFECTS.get(own.effect)
        if effect is None or own.effect in model.effects or not effect.concerns(model):
            continue
        changed = [line for line in motion_equations(model + effect.starting_at(effect.typical)) if line not in before]
        shown, _ = readable(changed)
        lead = f"{own.effect.replace('_', ' ')}:"
        if shown:
            parts.append(Together((Text("", lead=lead), Formulas(shown))))
        else:
            parts.append(Text(f"acts before or behind the equations, on {listed([*effect.touches])}.", lead=lead))
    return titled("What these effects do to the equations", Text(MATHEMATICS if parts else ""), *parts)
