"""The report of a hybrid model: its estimates, its equations, and the training of its network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace

import numpy as np

from ..base.numbers import capital, counted, listed, number, signal_words
from ..base.shorthands import Array
from ..datasets.recording import Recording
from ..fitting.fit import Fit
from ..fitting.posterior.posterior import Posterior
from ..fitting.scores.estimates import apply_hybrid
from ..fitting.scores.hybrid import hybrid_predictions
from ..fitting.scores.metrics import FREE_RUN
from ..models.hybrid_model import FeedForwardNetwork, HybridModel
from .content import ended, made_with, scalars, stages, written_down
from .document import Drawing, Text, titled
from .equations.expression import Equation, Symbol
from .equations.tracing import Reader, traced
from .figures.characteristics import forces_over_slip
from .figures.estimates import convergence
from .recordings import Seen, matched
from .report import Sections, errors, how_good, sections, seen

NETWORK_OUTPUT = "z"
"""Symbol of the network's output."""


@traced.register(HybridModel)
def hybrid_equations(model: HybridModel) -> tuple[Equation, ...]:
    """Equations of outputs and estimates, then of the derivatives of the states."""
    read = Reader()
    x = SimpleNamespace(**{state.name: read.named(Symbol(state.name)) for state in model.states})
    u = SimpleNamespace(**{name: read.named(Symbol(name)) for name in model.inputs})
    p = SimpleNamespace(
        **{
            parameter.name: read.named(Symbol(parameter.name))
            for parameter in model.parameters
            if parameter.shape == ()
        }
    )
    z = [read.named(Symbol(NETWORK_OUTPUT, (k + 1,))) for k in range(model.network.outputs)]
    rates, quantities = model.physics(x, u, p, z)
    target = [*model.estimates, *(name for name in model.outputs if name not in model.estimates)]
    result = [Equation(Symbol(name), read(quantities[name])) for name in target if name in quantities]
    result += [Equation(Symbol(name, dots=1), read(rate)) for name, rate in rates.items()]
    return tuple(item for item in result if item.right != Symbol(item.left.name))


def network_words(model: HybridModel) -> str:
    """Inputs and size of the network, in a sentence."""
    network = model.network
    if isinstance(network, FeedForwardNetwork):
        units = {"tanh": "hyperbolic tangents", "relu": "rectified linear units"}[network.activation]
        layers = ", ".join(map(str, network.hidden))
        mirrored = (
            " The network is an odd function: a right turn gives the mirror image of a left turn."
            if network.mirrored
            else ""
        )
        return (
            f"z is the output of a feed-forward network of {layers} {units}, which reads {network.features} features "
            f"of states and inputs; its last layer is linear.{mirrored}"
        )
    layers = ", ".join(map(str, network.hidden))
    skip = " and reads the features directly, too" if network.skip else ""
    return (
        f"z is the output of a recurrent network of {layers} rectified linear units. At every row it reads "
        f"{network.features} features of states and inputs, and the outputs of its layers at the row before; its "
        f"last layer is linear{skip}."
    )


LOSS = (
    "The objective is half the mean square of the errors over windows, each divided by the standard deviation of that "
    "output's noise. Training stopped when held-out manoeuvres were predicted best."
)


TRAINING = (
    "Training: the objective minus its best value, over the steps; several trainings are drawn side by side.",
    "The objective over the steps of training.",
)
"""Caption of the drawing and its alternative text."""


@sections.register(HybridModel)
def _sections(
    model: HybridModel, fit: Fit, recordings: Sequence[Recording], posterior: Posterior | None = None
) -> Sections:
    runs = _seen(model, fit, recordings)
    return Sections(
        runs=runs,
        verdict=(("How good", how_good(fit, runs)), ("Compared", _against(fit)), ("How trained", _trained(fit))),
        provenance=made_with(fit, ("size", counted(model.size, "parameter"))),
        judged=titled("Errors in free run", errors(fit)),
        learned=(
            *titled("What it estimates", _estimates(fit, runs)),
            *titled("Parameters", scalars(fit)),
            *titled("Equations of the model", *written_down(hybrid_equations(model), network_words(model))),
        ),
        fitted=titled(
            "How it was trained",
            stages(fit, lambda stage: stage.model),
            Text(LOSS),
            Drawing("training", convergence(fit.stages[-1]), *TRAINING),
        ),
    )


@seen.register(HybridModel)
def _seen(model: HybridModel, fit: Fit, recordings: Sequence[Recording]) -> Sequence[Seen]:
    """Adds outputs that follow from recorded signals."""
    result = []
    for record, recording in zip(fit.data, matched(fit, recordings), strict=True):
        read = {name: values for name in model.outputs if (values := model.read(name, recording)) is not None}
        free = hybrid_predictions(model, recording).of([model.outputs.index(name) for name in read])
        extended = recording.with_signals(**{name: values for name, values in read.items() if name not in recording})
        result.append(Seen(record.role, extended, tuple(read), {FREE_RUN: free}))
    return tuple(result)


def _against(fit: Fit) -> str:
    role = "validate" if "validate" in fit.metrics else "train"
    scores, noise, trained = fit.metrics[role][FREE_RUN], fit.stages[-1].noise, fit.metrics["train"][FREE_RUN]
    to_noise = [
        f"{number(e['rmse'] / noise[name], 2)} in {signal_words(name)}"
        for name, e in scores.items()
        if noise.get(name, 0.0) > 0
    ]
    to_training = [
        f"{number(e['rmse'] / trained[name]['rmse'], 2)} in {signal_words(name)}"
        for name, e in scores.items()
        if name in trained and trained[name]["rmse"] > 0
    ]
    against = f"This RMSE divided by the noise of the readings is {listed(to_noise) or 'not known'}."
    if role == "validate":
        against += f" Divided by the RMSE on the training data, it is {listed(to_training) or 'not known'}."
    return against


def _trained(fit: Fit) -> str:
    stage = fit.stages[-1]
    return (
        f"{capital(ended(stage))}; {counted(len(stage.starts), 'training')} ran, and the best on held-out manoeuvres "
        "was kept. Single weights have no intervals: repeat the training with several seeds to see how "
        "predictions scatter."
    )


def _estimates(fit: Fit, runs: Sequence[Seen]) -> Drawing:
    estimated = [apply_hybrid(fit, one.recording).columns for one in runs]
    values: Mapping[str, Array] = {name: np.concatenate([item[name] for item in estimated]) for name in estimated[0]}
    return Drawing(
        "forces_over_slip",
        forces_over_slip(values),
        "Estimated lateral force of each axle over its slip angle, in all recordings; darker where there are more "
        "samples. No tyre force was measured: the network was trained through the vehicle's equations.",
        "Estimated lateral force over slip angle, front and rear.",
    )
