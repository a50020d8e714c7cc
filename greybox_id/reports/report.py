"""The report of a fit of any model, as PDF or HTML.

Each kind of model can register its own sections; those here are the default.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..base.errors import BadInput
from ..base.numbers import capital, counted, listed, percent, pretty_unit, signal_words, with_sd
from ..datasets.recording import Recording
from ..fitting.fit import Fit
from ..fitting.posterior.posterior import Posterior
from ..fitting.posterior.verb import must_suit_sampling
from ..fitting.scores.metrics import FREE_RUN, simulate
from ..models.model import Model, by_kind
from .content import (
    OBJECTIVE,
    ROLE_WORDS,
    can_be_used,
    circumstances,
    ended,
    heading,
    made_with,
    noise_words,
    recorded,
    residual_drawing,
    scalars,
    spectrum_drawing,
    stages,
    trace_drawings,
    written_down,
)
from .data import data_parts, limits
from .document import Document, Pairs, Part, Table, Text, VerdictBox, titled
from .equations.tracing import traced
from .html import write_html
from .pdf import write_pdf
from .recordings import Seen, matched, noise, shown_first

EQUATIONS = "Derived from the model, with the added effects."


@dataclass(frozen=True)
class Sections:
    """The parts of a report that depend on the kind of model, in the order in which they are printed.

    Attributes
    ----------
    runs : recordings of the fit, with predictions.
    verdict : sentences on the first page after the verdict, as (lead, sentence) pairs.
    provenance : (name, value) pairs.
    judged : sections on accuracy.
    learned : sections on the estimates and equations.
    fitted : sections on how the model was fitted.
    beside : added to the captions of traces.
    """

    runs: Sequence[Seen]
    verdict: tuple[tuple[str, str], ...]
    provenance: tuple[tuple[str, str], ...]
    judged: tuple[Part, ...]
    learned: tuple[Part, ...]
    fitted: tuple[Part, ...]
    beside: str = ""


@by_kind
def seen(model: Model, fit: Fit, recordings: Sequence[Recording]) -> Sequence[Seen]:
    """The recordings of a fit, in its order, with predictions: free runs unless a kind of model registers others.

    Raises
    ------
    BadInput : if a recording of the fit is missing, or is another file.
    """
    result = []
    for record, recording in zip(fit.data, matched(fit, recordings), strict=True):
        outputs = [k for k, name in enumerate(model.outputs) if name in recording]
        free = simulate(model, recording).of(outputs)
        result.append(Seen(record.role, recording, tuple(model.outputs[k] for k in outputs), {FREE_RUN: free}))
    return tuple(result)


@by_kind
def sections(model: Model, fit: Fit, recordings: Sequence[Recording], posterior: Posterior | None = None) -> Sections:
    """The sections of a fit's report, with draws of the posterior for kinds that have one.

    Raises
    ------
    BadInput : as `seen`, or if the posterior is of another fit.
    """
    runs = seen(model, fit, recordings)
    parameters = titled("Parameters", scalars(fit))
    equations = titled("Equations of the model", *written_down(traced(model), EQUATIONS))
    return Sections(
        runs=runs,
        verdict=(("How good", how_good(fit, runs)), ("How fitted", f"{capital(ended(fit.stages[-1]))}.")),
        provenance=made_with(fit, ("size", counted(model.size, "parameter"))),
        judged=titled("Errors in free run", errors(fit)),
        learned=(*parameters, *equations),
        fitted=titled("How it was fitted", stages(fit, lambda stage: stage.model), Text(OBJECTIVE)),
    )


def how_good(fit: Fit, runs: Sequence[Seen]) -> str:
    """RMSE of a fit in free run, in a sentence."""
    role = "validate" if "validate" in fit.metrics else "train"
    each = [
        f"{with_sd(e['rmse'], e['rmse_sd'])} {pretty_unit(fit.model.unit(name))} in {signal_words(name)} "
        f"({percent(e['fvu'])} of the variance)"
        for name, e in fit.metrics[role][FREE_RUN].items()
    ]
    return f"{circumstances(fit, runs, role)}, the RMSE of {fit.model.name} in free run is {listed(each)}."


def errors(fit: Fit) -> Table:
    """RMSE of every output in free run, per role."""
    roles = [role for role in ROLE_WORDS if role in fit.metrics]
    head = ("output", *(f"{ROLE_WORDS[role]}: {what}" for role in roles for what in ("RMSE", "FVU")))
    rows = []
    for name in fit.model.outputs:
        cells = [fit.metrics[role][FREE_RUN].get(name) for role in roles]
        if any(cells):
            words = [
                w for e in cells for w in ((with_sd(e["rmse"], e["rmse_sd"]), percent(e["fvu"])) if e else ("–", "–"))
            ]
            rows.append((f"{signal_words(name)} [{pretty_unit(fit.model.unit(name))}]", *words))
    return Table(head, tuple(rows), "l" + "R" * (len(head) - 1))


FORMATS = {"pdf": write_pdf, "html": write_html}
"""Kind of file -> function that writes it."""


def prepared(fit: Fit, recordings: Sequence[Recording], posterior: Posterior | None = None) -> Document:
    """The report of a fit, before it is written; with draws of the posterior for equations of motion.

    Raises
    ------
    BadInput : as `report`, or if the posterior is of another fit or does not suit this one.
    """
    if not fit.data:
        raise BadInput(
            f"This fit of {fit.model.name} was imported and has seen no recording, so there is nothing to report. "
            "Compare it with a recording: greybox validate."
        )
    if posterior is not None:
        must_suit_sampling(fit)
    model, kind_sections = fit.model, sections(fit.model, fit, recordings, posterior)
    runs, heard = kind_sections.runs, noise([one.recording for one in kind_sections.runs])
    signals = tuple(dict.fromkeys(name for one in runs for name in (*_recorded_inputs(model, one), *model.outputs)))
    inputs = _recorded_inputs(model, shown_first(runs))
    outputs = [name for name in model.outputs if any(name in one.outputs for one in runs)]
    parts = (
        VerdictBox((*can_be_used(fit), *kind_sections.verdict)),
        *titled("Provenance", recorded(fit), Pairs(kind_sections.provenance)),
        *kind_sections.judged,
        *titled("Measured and predicted", *trace_drawings(runs, kind_sections.beside)),
        *titled(
            "Residual analysis", residual_drawing(runs, inputs), spectrum_drawing(runs, heard),
            Text(noise_words(outputs, heard)),
        ),
        *kind_sections.learned,
        *data_parts(runs, signals),
        *limits(runs, signals),
        *kind_sections.fitted,
    )  # fmt: skip
    training = [one for one in fit.data if one.role == "train"]
    title = heading("Fit", str(fit.how.get("vehicle") or model.name), training)
    return Document(title, f"{model.name}: {model.about}", "a fit", f"greybox-id {fit.version}", parts)


def _recorded_inputs(model: Model, one: Seen) -> list[str]:
    """The signals of a recording that are inputs of the model, by name or alias."""
    names = [(name, *model.aliases.get(name, ())) for name in model.inputs]
    return [next((item for item in each if item in one.recording), each[0]) for each in names]


def kind_of(out: str | Path, kind: str | None = None) -> str:
    """Kind of file, pdf or html: as requested, or by the suffix of the file's name.

    Raises
    ------
    BadInput : if the suffix is another or contradicts the request.
    """
    suffix = {"htm": "html"}.get(value := Path(out).suffix.lower().lstrip("."), value)
    if suffix not in FORMATS:
        raise BadInput(f"{out}: a report is a .pdf or a .html file; name it so with ‹out›.")
    if kind not in (None, suffix):
        raise BadInput(f"{out} is named as {suffix.upper()}, but ‹format› says {kind}; omit one of them.")
    return suffix


def write(document: Document, out: str | Path, kind: str | None = None) -> Path:
    """Write a report as PDF or HTML, as given by `kind` or the suffix of the file's name, atomically."""
    return FORMATS[kind or kind_of(out)](document, out)
