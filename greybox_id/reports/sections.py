"""What a kind of model has to say in the report of a fit, and what is said of one that brings nothing of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..base.numbers import capital, counted, listed, percent, pretty_unit, signal_words, with_sd
from ..base.signals import unit_of
from ..datasets.recording import Recording
from ..fitting.fit import Fit
from ..fitting.posterior.posterior import Posterior
from ..fitting.scores.metrics import FREE_RUN
from ..fitting.scores.prediction import simulate
from ..models.kinds import by_kind
from ..models.model import Model
from .content import OBJECTIVE, ROLE_WORDS, circumstances, ended, made_with, scalars, stages, written_down
from .document import Part, Table, Text, titled
from .equations.tracing import traced
from .recordings import Seen, matched

EQUATIONS = "Written down from the model itself, with the effects added to it."


@dataclass(frozen=True)
class Sections:
    """The parts of a report that differ between kinds of models, in the order in which they are printed.

    Attributes
    ----------
    runs : what the fit saw, with predictions.
    verdict : what the first page says below the verdict, each behind its lead.
    provenance : pairs of what and value.
    judged : sections on how good it is.
    learned : sections on what it has learned.
    fitted : sections on how it was fitted.
    beside : said of the predictions in the captions of traces.
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
    """The recordings of a fit, in its order, with predictions; free runs where a kind makes no others.

    Raises
    ------
    BadInput : one that the fit saw is missing, or is another file.
    """
    result = []
    for record, recording in zip(fit.data, matched(fit, recordings), strict=True):
        outputs = [k for k, name in enumerate(model.outputs) if name in recording]
        free = simulate(model, recording).of(outputs)
        result.append(Seen(record.role, recording, tuple(model.outputs[k] for k in outputs), {FREE_RUN: free}))
    return tuple(result)


@by_kind
def sections(model: Model, fit: Fit, recordings: Sequence[Recording], posterior: Posterior | None = None) -> Sections:
    """What the report of a fit says, with draws of its posterior where a kind has such.

    Raises
    ------
    BadInput : as `seen`, or the posterior is of another fit.
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
    """How far a fit errs in free run, in a sentence."""
    role = "validate" if "validate" in fit.metrics else "train"
    each = [
        f"{with_sd(e['rmse'], e['rmse_sd'])} {pretty_unit(unit_of(name))} in {signal_words(name)} "
        f"({percent(e['fvu'])} of the variance)"
        for name, e in fit.metrics[role][FREE_RUN].items()
    ]
    return f"{circumstances(fit, runs, role)}, {fit.model.name} errs in free run by an RMSE of {listed(each)}."


def errors(fit: Fit) -> Table:
    """RMSE of every output in free run, of each role."""
    roles = [role for role in ROLE_WORDS if role in fit.metrics]
    head = ("output", *(f"{ROLE_WORDS[role]}: {what}" for role in roles for what in ("RMSE", "FVU")))
    rows = []
    for name in fit.model.outputs:
        cells = [fit.metrics[role][FREE_RUN].get(name) for role in roles]
        if any(cells):
            words = [
                w for e in cells for w in ((with_sd(e["rmse"], e["rmse_sd"]), percent(e["fvu"])) if e else ("–", "–"))
            ]
            rows.append((f"{signal_words(name)} [{pretty_unit(unit_of(name))}]", *words))
    return Table(head, tuple(rows), "l" + "R" * (len(head) - 1))
