"""The report of a hybrid, part by part: its estimates, and how its network was trained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..fit import Fit
from ..hybrid_model import HybridModel
from ..numbers import capital, counted, listed, number, percent, pretty_unit, signal_words, with_sd
from ..recording import Recording
from ..scores.estimates import apply_hybrid
from ..scores.hybrid import hybrid_predictions
from ..scores.metrics import FREE_RUN
from ..shorthands import Array
from ..signals import unit_of
from .content import (
    ROLE_WORDS,
    can_be_used,
    circumstances,
    ended,
    made_with,
    noise_words,
    recorded,
    scalars,
    stages,
    written_down,
)
from .data import data_parts, limits
from .document import Document, Drawing, Pairs, Part, Table, Text, VerdictBox, titled
from .equations.tracing import hybrid_equations, network_words
from .figures.characteristics import forces_over_slip
from .figures.estimates import convergence
from .figures_of import residual_drawings, spectrum_drawings, trace_drawings
from .noise import noise
from .recordings import Seen, matched

LOSS = (
    "The objective is half the mean square of the errors over windows, in standard deviations of each output's noise; "
    "training stopped where manoeuvres that were not trained on were predicted best."
)

LEADS = ("How good", "Against what", "How trained")


def hybrid_report(fit: Fit, recordings: Sequence[Recording]) -> Document:
    """The report of a fit. Raises `BadInput` where a recording that it saw is missing or is another file."""
    model = hybrid_model(fit)
    runs = seen(fit, recordings)
    heard = noise([one.recording for one in runs])
    signals = tuple(dict.fromkeys((*model.inputs, *model.outputs)))
    parts = (
        VerdictBox((*can_be_used(fit), *zip(LEADS, verdict(fit, runs), strict=True))),
        *titled("Provenance", recorded(fit), Pairs(made_with(fit, ("size", counted(model.size, "parameter"))))),
        *titled("Errors in free run", errors(fit)),
        *titled("Measured and predicted", *trace_drawings(runs)),
        *titled(
            "Residual analysis", *residual_drawings(runs, model.inputs), *spectrum_drawings(runs, heard),
            Text(noise_words(model.outputs, heard)),
        ),
        *titled("What it estimates", *_estimates(fit, runs)),
        *titled("Parameters", scalars(fit)),
        *titled("Equations of the model", *written_down(hybrid_equations(model), network_words(model))),
        *data_parts(runs, signals),
        *limits(runs, signals),
        *titled("How it was trained", stages(fit, lambda stage: stage.model), Text(LOSS), *_training(fit)),
    )  # fmt: skip
    return Document(model.name, model.about, "a fit", f"greybox-id {fit.version}", parts)


def hybrid_model(fit: Fit) -> HybridModel:
    """The model of a fit of this kind."""
    assert isinstance(fit.model, HybridModel)
    return fit.model


def seen(fit: Fit, recordings: Sequence[Recording]) -> tuple[Seen, ...]:
    """The recordings of a fit, in its order, with free runs; outputs that follow from what is recorded are added."""
    model = hybrid_model(fit)
    found = []
    for record, recording in zip(fit.data, matched(fit, recordings), strict=True):
        read = {name: values for name in model.outputs if (values := model.read(name, recording)) is not None}
        outputs = tuple(read)
        free = hybrid_predictions(model, recording)
        columns = [model.outputs.index(name) for name in outputs]
        own = type(free)(free.rows, free.predicted[:, columns], free.measured[:, columns], free.run)
        whole = recording.with_signals(**{name: values for name, values in read.items() if name not in recording})
        found.append(Seen(record.role, whole, outputs, {FREE_RUN: own}))
    return tuple(found)


def verdict(fit: Fit, runs: Sequence[Seen]) -> tuple[str, str, str]:
    """Three sentences: how good, against what, how trained."""
    role = "validate" if "validate" in fit.metrics else "train"
    own, stage = fit.metrics[role][FREE_RUN], fit.stages[-1]
    each = [
        f"{with_sd(e['rmse'], e['rmse_sd'])} {pretty_unit(unit_of(name))} in {signal_words(name)} "
        f"({percent(e['fvu'])} of the variance)"
        for name, e in own.items()
    ]
    beside = [
        f"{number(e['rmse'] / stage.noise[name], 2)} in {signal_words(name)}"
        for name, e in own.items()
        if stage.noise.get(name, 0.0) > 0
    ]
    trained = fit.metrics["train"][FREE_RUN]
    grown = [
        f"{number(e['rmse'] / trained[name]['rmse'], 2)} in {signal_words(name)}"
        for name, e in own.items()
        if name in trained and trained[name]["rmse"] > 0
    ]
    against = f"Over the noise of the readings its error is {listed(beside) or 'not known'}"
    if role == "validate":
        against += f", over that on the training data {listed(grown) or 'not known'}"
    return (
        f"{circumstances(fit, runs, role)}, {fit.model.name} errs in free run by an RMSE of {listed(each)}.",
        f"{against}.",
        f"{capital(ended(stage))}; of {counted(len(stage.starts), 'training')} the best on manoeuvres not trained on "
        "was kept, and single weights have no intervals: trainings from several seeds tell the spread.",
    )


def errors(fit: Fit) -> Table:
    """RMSE of every output, of each role."""
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


def _estimates(fit: Fit, runs: Sequence[Seen]) -> tuple[Part, ...]:
    every = [apply_hybrid(fit, one.recording).columns for one in runs]
    values: Mapping[str, Array] = {name: np.concatenate([own[name] for own in every]) for name in every[0]}
    figure = forces_over_slip(values)
    if figure is None:
        return ()
    caption = (
        "Lateral force of each axle over its slip angle in all recordings, as estimated, darker where more samples "
        "lie. No tyre force was measured: the network was trained through the vehicle's equations."
    )
    return (Drawing("forces_over_slip", figure, caption, "Estimated lateral force over slip angle, front and rear."),)


def _training(fit: Fit) -> tuple[Drawing, ...]:
    figure = convergence(fit.stages[-1])
    if figure is None:
        return ()
    caption = "Training: the objective over the steps, above the least; beside it, where there are, all trainings."
    return (Drawing("training", figure, caption, "The objective over the steps of training."),)
