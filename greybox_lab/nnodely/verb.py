"""The verb `import`: a network that nnodely saved becomes a fit of our own.

The file is read, never run. Its graph is recognised by shape, and what comes out is held against the graph itself,
evaluated on random windows: a model that predicts anything else than the file is not handed out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from greybox_id.base.errors import BadInput
from greybox_id.base.shorthands import Array
from greybox_id.datasets.recording import Recording
from greybox_id.fitting.fit import Fit
from greybox_id.fitting.scores.memory import predictions
from greybox_id.models.memory_model import MemoryModel
from greybox_id.models.model import must_be
from greybox_id.models.parameter import Parameter
from greybox_id.models.registry import build

from .evaluation import evaluate
from .family import NetworkFamily, recognise, roles_of
from .network import Network, read_network

CHECKED = 1e-9
"""Of the largest prediction: how near the model has to come to the file's own graph."""
WINDOWS = 16
UNSTATED = 1.0
"""s; what nnodely writes where no sample time was given."""
WIDEST = {
    "v_x": (0.2, 4.0),
    "steer": (-0.5, 0.5),
    "a_x": (-6.0, 6.0),
    "a_y": (-7.0, 7.0),
    "motor_current": (-30.0, 30.0),
}
"""Signal -> where random windows lie, in its SI unit, where the file's centres do not say."""


@dataclass(frozen=True)
class Imported:
    """What was made of a file.

    Attributes
    ----------
    fit : the model at the file's numbers, without uncertainty.
    roles : input of the file -> signal.
    outputs : output of the file -> signal.
    error : largest difference from the file's own graph on random windows, as a share of the largest prediction.
    notes : sentences for the user.
    """

    fit: Fit
    roles: Mapping[str, str]
    outputs: Mapping[str, str]
    error: float
    notes: tuple[str, ...]


def import_network(
    path: str | Path, inputs: Sequence[str] = (), sample_time: float | None = None, command: str = ""
) -> Imported:
    """A model from a file of nnodely's saveModel, without running anything in it.

    Parameters
    ----------
    path : the file.
    inputs : SIGNAL=INPUT pairs, for inputs whose names do not tell: "v_x=omega".
    sample_time : s; None takes the file's.
    command : what reproduces the import, for the record.

    Raises
    ------
    BadInput : the file is damaged, or no network of the MS-NN family; the sentence says what was not understood.
    """
    network = read_network(path)
    if sample_time is not None:
        network = replace(network, sample_time=sample_time)
    elif network.sample_time == UNSTATED:
        raise network.wrong(
            "its sample time is 1 s, which nnodely writes if none was given to neuralizeModel. State the sample "
            "time of its training, in seconds (‹sample_time› 0.05)."
        )
    family = recognise(network, roles_of(inputs, network))
    model, odd = _model(network, family)
    error = _difference(network, family, model)
    roles = {name: signal for part in family.parts for name, signal in part.roles.items()}
    signals = {part.relation: part.output for part in family.parts}
    outputs = {name: signals[relation] for name, relation in network.outputs.items() if relation in signals}
    fit = Fit(
        model=model,
        sd={p.name: np.full(p.shape, np.nan) for p in model.parameters},
        stages=(),
        metrics={},
        data=(),
        mode="imported",
        seed=0,
        how={"imported": Path(path).name, "inputs": roles, "outputs": outputs},
        command=command,
    )
    return Imported(fit, roles, outputs, error, (*odd, *family.notes))


def _model(network: Network, family: NetworkFamily) -> tuple[MemoryModel, tuple[str, ...]]:
    """The model at the file's numbers, all held, and what is odd about them."""
    settings = {part.model: asdict(replace(part.settings, sample_time=network.sample_time)) for part in family.parts}
    if len(settings) == 1:
        made = build(family.parts[0].model, settings[family.parts[0].model])
    else:
        made = build("msnn_full", {"lat": settings["msnn_lat"], "long": settings["msnn_long"]})
    model = must_be(MemoryModel, made)
    values = {name: value for part in family.parts for name, value in part.values.items()}
    beyond = [p for p in model.parameters if not _within(p, values[p.name])]
    odd = (
        [
            f"{', '.join(p.name for p in beyond)}: impossible for a vehicle, but kept, since the network predicts with "
            "it."
        ]
        if beyond
        else []
    )
    taken = {signal for part in family.parts for signal in part.roles.values()}
    absent = [name for name in model.inputs if name not in model.defaults and name not in taken]
    if absent:
        odd.append(f"the file does not take {', '.join(absent)}; the model needs it as an input but ignores it.")
    held = (replace(_opened(p, p in beyond).with_value(values[p.name]), fixed=True) for p in model.parameters)
    return model.with_parameters(*held), tuple(odd)


def _within(parameter: Parameter, value: Array) -> bool:
    low, high = parameter.bounds
    return bool(np.all((value >= low) & (value <= high)))


def _opened(parameter: Parameter, beyond: bool) -> Parameter:
    """What was believed of a vehicle's numbers says nothing of numbers that are given."""
    prior = parameter.prior if parameter.shape else None
    return replace(parameter, prior=prior, bounds=(-np.inf, np.inf) if beyond else parameter.bounds)


def _difference(network: Network, family: NetworkFamily, model: MemoryModel) -> float:
    """How far the model is from the file's graph on random windows. Raises `BadInput` where they differ."""
    rng, worst = np.random.default_rng(0), 0.0
    length = 1 + max(getattr(part.settings, "q", getattr(part.settings, "gamma", 0)) for part in family.parts)
    windows = {name: rng.uniform(*_range(family, name), (WINDOWS, length)) for name in model.inputs}
    drawn = Recording(
        "random windows",
        np.tile(np.arange(length + 1) * network.sample_time, WINDOWS),
        {name: np.pad(values, ((0, 0), (0, 1))).ravel() for name, values in windows.items()}
        | {name: np.zeros(WINDOWS * (length + 1)) for name in model.outputs if name not in windows},
        runs=tuple((k, k + length + 1) for k in range(0, WINDOWS * (length + 1), length + 1)),
    )
    predicted = predictions(model, drawn, "honest").predicted
    for part in family.parts:
        given = {name: windows[signal][:, :, None] for name, signal in part.roles.items()}
        stated = evaluate(network, part.relation, given).ravel()
        value = predicted[:, model.outputs.index(part.output)]
        if stated.shape != value.shape or not np.all(np.isfinite(stated) & np.isfinite(value)):
            raise network.wrong(f"{part.relation} gives no finite predictions.")
        scale = max(float(np.max(np.abs(stated))), np.finfo(float).tiny)
        worst = max(worst, float(np.max(np.abs(stated - value))) / scale)
    if worst > CHECKED:
        raise BadInput(
            f"{network.file} was read as {model.name}, but its own graph predicts something else (difference: "
            f"{worst:.1e} of the "
            "largest prediction); it is not of the family."
        )
    return worst


def _range(family: NetworkFamily, signal: str) -> tuple[float, float]:
    """Where random windows of a signal lie: about the centres of its memberships."""
    for part in family.parts:
        centres = getattr(part.settings, signal, None)
        if centres is not None and len(centres) > 1:
            reach = 0.2 * (centres[-1] - centres[0])
            return centres[0] - reach, centres[-1] + reach
    return WIDEST.get(signal, (0.0, 0.0))
