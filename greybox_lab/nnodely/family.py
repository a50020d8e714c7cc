"""Which models of the MS-NN family the outputs of a file are, and how they hang together.

Which input of a file is which signal: as said, by name, or as only one assignment makes a model of the family.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from greybox_id.base.errors import BadInput

from .evaluation import evaluate
from .lateral import lateral
from .local_models import PROBES, SAME, leaves
from .longitudinal import longitudinal
from .network import Network
from .recognised import NetworkPart

SPELLINGS: dict[str, tuple[str, ...]] = {
    "v_x": ("vx", "v", "vel", "velocity", "speed", "vlong", "ux"),
    "steer": ("steer", "steering", "steeringangle", "delta"),
    "a_x": ("ax", "acc", "accx", "along", "acceleration"),
    "a_y": ("ay", "accy", "alat"),
    "motor_current": ("motorcurrent", "current", "crt"),
}
"""Signal -> what its input is called, in small letters and without underscores."""


def assignments(
    network: Network, output: str, signals: Sequence[str], needed: Sequence[str], one: Mapping[str, str]
) -> Iterator[dict[str, str]]:
    """Ways to give the inputs that an output follows from a signal each; one where all are said or known by name.

    Parameters
    ----------
    signals, needed : what the model takes, and what it cannot do without.
    one : input -> signal, as the user said.

    Raises
    ------
    BadInput : what is said does not suit the model, or two inputs are one signal.
    """
    used = [name for name in network.order(output) if name in network.inputs]
    for name in used:
        if one.get(name, signals[0]) not in signals:
            raise network.wrong(
                f"‹inputs› says that input {name} is {one[name]}, but {output} depends on {', '.join(signals)}."
            )
    named = {name: one.get(name) or by_name(name) for name in used}
    known = {name: signal for name, signal in named.items() if signal is not None and signal in signals}
    if len(set(known.values())) < len(known) or len(used) > len(signals):
        raise network.wrong(
            f"output {output} depends on {', '.join(used)[:200]}; a model takes one input for each of "
            f"{', '.join(signals)}. Say which is which with ‹inputs›."
        )
    unknown = [name for name in used if name not in known]
    open_ = [signal for signal in signals if signal not in known.values()]
    for chosen in permutations(open_, len(unknown)):
        roles = known | dict(zip(unknown, chosen, strict=True))
        if set(needed) <= set(roles.values()):
            yield roles


def by_name(name: str) -> str | None:
    """The signal that an input's name stands for."""
    plain = name.lower().replace("_", "").replace(".", "")
    return next((signal for signal, words in SPELLINGS.items() if plain in words), None)


def roles_of(pairs: Sequence[str], network: Network) -> dict[str, str]:
    """Input -> signal from SIGNAL=INPUT pairs. Raises `BadInput` where either is unknown."""
    result: dict[str, str] = {}
    for pair in pairs:
        signal, equals, name = pair.partition("=")
        if not equals or signal not in SPELLINGS:
            raise BadInput(f"‹inputs› {pair}: write SIGNAL=INPUT, where SIGNAL is one of {', '.join(SPELLINGS)}.")
        if name not in network.inputs:
            raise network.wrong(
                f"there is no input {name}; the inputs are {', '.join(network.inputs)[:200]} (‹inputs›)."
            )
        if result.setdefault(name, signal) != signal:
            raise BadInput(f"‹inputs› says that {name} is both {result[name]} and {signal}.")
    return result


READERS = {
    "msnn_lat": (lateral, ("v_x", "steer", "a_x"), ("v_x", "steer")),
    "msnn_long": (longitudinal, ("v_x", "motor_current", "steer", "a_y"), ("v_x", "motor_current")),
}
"""Model -> what reads it, the signals it may take, and those it cannot do without."""
MOST_OUTPUTS = 5


@dataclass(frozen=True)
class NetworkFamily:
    """What a file holds.

    Attributes
    ----------
    parts : MS-NN-lat, MS-NN-long, or both; in this order.
    notes : sentences for the user.
    """

    parts: tuple[NetworkPart, ...]
    notes: tuple[str, ...]


def recognise(network: Network, stated: Mapping[str, str]) -> NetworkFamily:
    """Understand every output of a file.

    Raises
    ------
    BadInput : an output is no model of the family; the sentence names what was not understood.
    """
    relations = list(dict.fromkeys(network.outputs.values()))
    if not 0 < len(relations) <= MOST_OUTPUTS:
        raise network.wrong(f"it has {len(relations)} outputs; 1 to {MOST_OUTPUTS} are read.")
    derived = [relation for relation in relations if len(set(relations).intersection(network.order(relation))) > 1]
    parts = [_part(network, relation, stated) for relation in relations if relation not in derived]
    models = [part.model for part in parts]
    if len(set(models)) < len(models):
        raise network.wrong(f"{len(models)} outputs are {models[0]}; save one model per file (saveModel(models=...)).")
    parts.sort(key=lambda part: list(READERS).index(part.model))
    for part in parts:
        _must_be_ahead(network, part)
    _must_accelerate(network, parts, derived)
    return NetworkFamily(tuple(parts), _loops(network, parts, derived))


def _part(network: Network, output: str, stated: Mapping[str, str]) -> NetworkPart:
    nearest = {network.relations[name].operation for name in leaves(network, output, ("Fir", "Linear"))[0]}
    model = "msnn_long" if "Linear" in nearest else "msnn_lat"
    reader, signals, needed = READERS[model]
    network_parts: list[NetworkPart] = []
    errors: list[BadInput] = []
    ways = list(assignments(network, output, signals, needed, stated))
    for roles in ways:
        try:
            network_parts.append(reader(network, output, roles))
        except BadInput as error:
            errors.append(error)
    if len(network_parts) == 1:
        return network_parts[0]
    if len(ways) == 1:
        raise errors[0]
    if not ways:
        raise network.wrong(f"output {output} depends on too few inputs: {model} needs {' and '.join(needed)}.")
    unclear = ", ".join(name for name in ways[0] if len({roles[name] for roles in ways}) > 1)
    hint = f"say what {unclear[:200]} are with ‹inputs› SIGNAL=INPUT ({', '.join(signals)})."
    if network_parts:
        raise network.wrong(f"the names of its inputs do not show which signal is which; {hint}")
    raise BadInput(f"{errors[0]} If that is because of names, {hint}")


def _must_be_ahead(network: Network, part: NetworkPart) -> None:
    """What training compared with an output has to be the sample after the window."""
    names = {part.relation, *(name for name, relation in network.outputs.items() if relation == part.relation)}
    for pair in network.targets:
        for item, other in (pair, pair[::-1]):
            target = network.relations.get(other)
            if item not in names or target is None or target.operation not in ("SamplePart", "TimePart"):
                continue
            ends = target.rest[1] if len(target.rest) > 1 else None
            if isinstance(ends, list) and len(ends) == 2 and ends[-1] in (0, 0.0):
                raise network.wrong(
                    f"{part.relation} was trained to give the newest sample of {', '.join(target.inputs)[:100]}; "
                    "models of greybox-id give the sample after it (next() in place of last())."
                )


def _must_accelerate(network: Network, parts: list[NetworkPart], derived: list[str]) -> None:
    """Outputs that follow from others have to be the lateral acceleration, which closes the loop."""
    rng = np.random.default_rng(0)
    turning = next((part for part in parts if part.model == "msnn_lat"), None)
    for name in derived:
        if turning is not None:
            speed = next(name for name, signal in turning.roles.items() if signal == "v_x")
            given = {item: rng.uniform(0.5, 2.0, (PROBES, 1, 1)) for item in network.inputs}
            rate = rng.uniform(0.5, 2.0, (PROBES, 1, 1))
            try:
                value = evaluate(network, name, given | {turning.relation: rate})
            except BadInput:
                value = np.full_like(rate, np.nan)
            if value.shape == rate.shape and np.allclose(value, rate * given[speed], rtol=SAME):
                continue
        raise network.wrong(f"output {name} depends on another output and is not the yaw rate times the newest v_x.")


def _loops(network: Network, parts: list[NetworkPart], derived: list[str]) -> tuple[str, ...]:
    """What is to be said of loops. Raises `BadInput` where one is closed by something else than the family's."""
    roles = {name: signal for part in parts for name, signal in part.roles.items()}
    closed = {name: item for name, item in network.inputs.items() if item is not None and name in roles}
    closing = {"a_x": [part.relation for part in parts if part.output == "a_x"], "a_y": derived}
    for name, one in closed.items():
        if network.outputs.get(one, one) not in closing.get(roles[name], ()):
            raise network.wrong(
                f"input {name} is fed back from {one[:60]}; MS-NN-full feeds a_x back from its prediction and a_y from "
                "yaw rate times speed."
            )
    if len(parts) < 2:
        return ()
    result = [
        "in closed loop a_y is the predicted yaw rate times the speed of the same sample; nnodely multiplies by the "
        "speed one sample before. One sample ahead (open loop) both are the same."
    ]
    if len({roles[name] for name in closed}) < 2:
        result.insert(0, "the file does not close the loops of both a_x and a_y; MS-NN-full does, except in open loop.")
    return tuple(result)
