"""What a report of a map with memory says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...fit import Fit
from ...provenance import Stage
from ...signals import unit_of
from ..content import ROLE_WORDS, Content, made_with, noise_words, recorded
from ..convergence import stages
from ..document import Table
from ..noise import Noise
from ..numbers import counted, number, percent, pretty_unit, raised, signal_words, with_sd
from ..parameters import scalars
from ..recordings import Seen
from .seen import memory_model
from .verdict import Yardstick, verdict, yardsticks

PROTOCOL_WORDS = {
    "honest": "one sample ahead",
    "published": "as published",
    "closed_loop": "closed loop",
}
PROTOCOL_MEANING = {
    "honest": "every input is measured, no window crosses a join between runs, and all samples are pooled.",
    "published": "as in the papers on model-structured networks: windows are laid across joins as if the recording "
    "were one run, and the figure is the mean of the RMSE of batches of 100 windows. It is given for comparison "
    "with published tables only.",
    "closed_loop": "the model runs on its own predictions from the first window of each run to the run's end; no "
    "window crosses a join, and all samples are pooled.",
}


@dataclass(frozen=True, kw_only=True)
class MemoryContent(Content):
    """Everything a report of a map with memory says.

    Attributes
    ----------
    error_notes : what the protocols are.
    arrays : parameters that are no single numbers.
    strengths : of priors, a sentence per stage.
    """

    error_notes: tuple[tuple[str, str], ...]
    arrays: Table
    strengths: tuple[str, ...]


def memory_content(fit: Fit, recordings: Sequence[Seen], noise: Noise | None) -> MemoryContent:
    """What a report of a fit says.

    Parameters
    ----------
    fit : the fit.
    recordings : what it saw, with predictions.
    noise : where the sensors' noise can be heard, if anywhere.
    """
    measures = yardsticks(fit, recordings)
    model = memory_model(fit)
    return MemoryContent(
        model=model.name,
        about=model.about,
        verdict=verdict(fit, recordings, measures),
        errors=_errors(fit, measures),
        error_notes=tuple((PROTOCOL_WORDS[p], PROTOCOL_MEANING[p]) for p in fit.metrics["train"]),
        noise=noise_words(model.outputs, noise),
        recordings=recorded(fit),
        provenance=made_with(
            fit,
            ("strength of regularisation", "given" if fit.mode == "given" else f"by {fit.mode}"),
            ("sample time", f"{model.sample_time * 1e3:.4g} ms"),
            ("size", counted(model.size, "parameter")),
        ),
        parameters=scalars(fit),
        arrays=_arrays(fit),
        together=tuple(raised(sentence) for sentence in model.together),
        stages=stages(fit, _stage_name),
        strengths=_strengths(fit),
    )


def _errors(fit: Fit, measures: Mapping[str, Mapping[str, Yardstick]]) -> Table:
    roles = [role for role in ROLE_WORDS if role in fit.metrics]
    head = ["output", "protocol", *(f"{ROLE_WORDS[r]}: {what}" for r in roles for what in ("RMSE", "FVU"))]
    rows = []
    for name in fit.model.outputs:
        output = f"{signal_words(name)} [{pretty_unit(unit_of(name))}]"
        for protocol in fit.metrics["train"]:
            cells = [fit.metrics[role][protocol][name] for role in roles]
            words = [w for e in cells for w in (with_sd(e["rmse"], e["rmse_sd"]), percent(e["fvu"]))]
            rows.append((output, PROTOCOL_WORDS[protocol], *words))
            output = ""
        held = [measures[role][name] for role in roles]
        words = [w for m in held for w in (number(m.held), percent(m.held_fvu))]
        rows.append(("", "last measured value held", *words))
    return Table(tuple(head), tuple(rows), "ll" + "R" * (len(head) - 2))


def _arrays(fit: Fit) -> Table:
    head = ("parameter", "meaning", "entries", "rms value", "rms sd", "unit", "strength")
    rows = []
    for parameter in fit.model.parameters:
        if parameter.shape == ():
            continue
        sd = np.asarray(fit.sd.get(parameter.name, np.zeros(parameter.shape)))
        strength = parameter.prior.strength.replace("_", " ") if parameter.prior is not None else ""
        rows.append(
            (
                parameter.name, parameter.about, " × ".join(str(n) for n in parameter.shape),
                number(float(np.sqrt(np.mean(parameter.array**2)))),
                "held" if parameter.fixed else number(float(np.sqrt(np.mean(sd**2))), 2),
                pretty_unit(parameter.unit), strength or "–",
            )
        )  # fmt: skip
    return Table(head, tuple(rows), "lLlrrll")


def _stage_name(stage: Stage) -> str:
    return f"{stage.model}, {'on its own predictions' if stage.closed_loop else 'on measured inputs'}"


def _strengths(fit: Fit) -> tuple[str, ...]:
    """One sentence per stage on the factors on its priors; stages that share the last one's are not repeated."""
    sentences = []
    for stage in fit.stages:
        if not stage.strengths or (stage.closed_loop and len(fit.stages) > 1):
            continue
        factors = ", ".join(f"{name.replace('_', ' ')} × {number(f, 2)}" for name, f in stage.strengths.items())
        tried = f"; {counted(len(stage.tried), 'choice')} tried by cross-validation" if stage.tried else ""
        sentences.append(f"{stage.model}: {factors} ({stage.strengths_from}{tried}).")
    return tuple(sentences)
