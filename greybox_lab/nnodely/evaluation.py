"""What a file's graph makes of windows, evaluated relation by relation in double precision.

Values are (windows, samples, outputs), as in nnodely. This is the reference that every imported model is held against,
and by which local models and formulas are understood whatever the words they are written in.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from greybox_id.base.errors import BadInput
from greybox_id.base.shorthands import Array

from .formula import Formula, formula
from .network import LARGEST, Network, NetworkRelation

LONGEST_WINDOW = 501
MOST_CENTRES = 50
MOST_VALUES = 2_000_000
"""Numbers that one relation may hold; the windows of a network of the family hold some thousands."""
ELEMENTWISE: dict[str, tuple[Callable[..., Any], int]] = {
    "Add": (np.add, 2), "Sub": (np.subtract, 2), "Mul": (np.multiply, 2), "Div": (np.divide, 2),
    "Pow": (np.power, 2), "Neg": (np.negative, 1), "Sin": (np.sin, 1), "Cos": (np.cos, 1), "Tan": (np.tan, 1),
    "Tanh": (np.tanh, 1), "Relu": (lambda x: np.maximum(x, 0.0), 1), "Identity": (np.asarray, 1),
}  # fmt: skip


def evaluate(network: Network, root: str, given: Mapping[str, Array]) -> Array:
    """The values of a relation.

    Parameters
    ----------
    network : the file.
    root : name of the relation.
    given : name -> (windows, samples, outputs) of inputs, whose last sample is the newest, and of whatever else shall
        hold other values than the graph gives it: relations, parameters.

    Raises
    ------
    BadInput : the graph holds what is not understood; the sentence names the relation.
    """
    order = network.order(root, given)
    left = Counter(item for name in order if name not in given for item in _taken(network, name))
    values: dict[str, Array] = {}
    with np.errstate(all="ignore"):
        for name in order:
            values[name] = np.asarray(given[name]) if name in given else _value(network, name, values)
            for item in _taken(network, name) if name not in given else ():
                left[item] -= 1
                if not left[item] and item != root:
                    del values[item]
    return values[root]


def window_of(network: Network, relation: NetworkRelation) -> tuple[str, int, int]:
    """Which input a SamplePart or TimePart looks at, and its first and last sample: (-20, 0) are the newest twenty.

    Raises
    ------
    BadInput : it is no window of an input that ends at or before the newest sample.
    """
    where = f"relation {relation.name}"
    if len(relation.rest) != 2 or len(relation.inputs) != 1 or relation.inputs[0] not in network.inputs:
        raise network.wrong(
            f"{where} is not a plain window of an input; offsets and windows of windows cannot be imported."
        )
    ends = relation.rest[1]
    if not (isinstance(ends, list) and len(ends) == 2 and all(_is_number(end) for end in ends)):
        raise network.wrong(f"{where} must have a window of two numbers, [from, to].")
    step = network.sample_time if relation.operation == "TimePart" else 1.0
    if any(abs(end / step) > LONGEST_WINDOW for end in ends):
        raise network.wrong(
            f"{where} looks further than {LONGEST_WINDOW} samples, the longest window that can be imported."
        )
    start, stop = (round(end / step) for end in ends)
    if not start < stop <= 0:
        raise network.wrong(
            f"{where} looks at samples {start} to {stop} of {relation.inputs[0]}; only past samples can be imported."
        )
    return relation.inputs[0], start, stop


def fuzzy_of(network: Network, relation: NetworkRelation) -> tuple[str, tuple[float, ...]]:
    """Form and centres of a Fuzzify. Raises `BadInput` where they are none of nnodely's own."""
    name = relation.rest[0] if relation.rest else None
    value = network.functions.get(name, {}) if isinstance(name, str) else {}
    form, centres = value.get("functions"), value.get("centers")
    if form not in ("Triangular", "Rectangular"):
        raise network.wrong(
            f"relation {relation.name} has membership functions of its own (function {name}); "
            "only nnodely's 'Triangular' ones are understood."
        )
    if not (isinstance(centres, list) and 0 < len(centres) <= MOST_CENTRES and all(map(_is_number, centres))):
        raise network.wrong(f"function {name} must have 1 to {MOST_CENTRES} centres, all of them numbers.")
    if not all(a < b for a, b in zip(centres[:-1], centres[1:], strict=True)):
        raise network.wrong(f"the centres of function {name} do not increase.")
    return form, tuple(float(centre) for centre in centres)


def weights_of(network: Network, relation: NetworkRelation) -> tuple[Array, Array]:
    """Weights (inputs, outputs) and biases (outputs,) of a Fir or Linear."""
    where = f"relation {relation.name}"
    W = network.number(relation.rest[0] if relation.rest else None, where)
    if W.ndim != 2:
        raise network.wrong(f"the weights of {where} have {W.ndim} axes; they must have two.")
    bias = relation.rest[1] if len(relation.rest) > 1 else None
    b = np.zeros(W.shape[1]) if bias is None else network.number(bias, where)
    if b.shape != (W.shape[1],):
        raise network.wrong(f"the biases of {where} have shape {b.shape}, its weights {W.shape}.")
    return W, b


def _taken(network: Network, name: str) -> tuple[str, ...]:
    relation = network.relations.get(name)
    if relation is None:
        return ()
    return relation.inputs


def _value(network: Network, name: str, values: Mapping[str, Array]) -> Array:
    if name in network.numbers:
        number = network.numbers[name]
        if number.size != 1:
            raise network.wrong(f"{name} holds {number.size} numbers, but its formula takes one number.")
        return number.reshape(1, 1, 1)
    if name in network.inputs:
        raise network.wrong(f"input {name} has an effect in a place where it should have none.")
    relation = network.relations[name]
    if relation.operation not in ("SamplePart", "TimePart") and any(item in network.inputs for item in relation.inputs):
        raise network.wrong(f"relation {name} takes an input without a window; make one with sw() or last().")
    taken = [values[item] for item in relation.inputs]
    operation = OPERATIONS.get(relation.operation)
    if relation.operation in ELEMENTWISE:
        function, count = ELEMENTWISE[relation.operation]
        if len(taken) != count:
            raise network.wrong(
                f"relation {name} ({relation.operation}) takes {len(taken)} inputs; it must take {count}."
            )
        return np.asarray(_together(network, name, lambda: function(*_fitting(taken))))
    if relation.operation == "ParamFun":
        return _called(network, relation, taken)
    if operation is None or len(taken) != 1:
        known = ", ".join(("ParamFun", *OPERATIONS, *ELEMENTWISE))
        raise network.wrong(f"relation {name}: {relation.operation!r:.40} is not understood here; {known} are.")
    return np.asarray(_together(network, name, lambda: operation(network, relation, taken[0])))


def _together(network: Network, name: str, work: Callable[[], Any]) -> Any:
    try:
        return work()
    except (ValueError, IndexError) as error:
        raise network.wrong(f"relation {name} combines shapes that do not match: {error}.") from error


def _called(network: Network, relation: NetworkRelation, taken: list[Array]) -> Array:
    function = relation.rest[0] if relation.rest else None
    entry = network.functions.get(function) if isinstance(function, str) else None
    if entry is None or entry.get("map_over_dim") not in (False, None):
        raise network.wrong(
            f"relation {relation.name} must name a function of the file that is applied sample by sample "
            "(map_over_dim false); other functions cannot be imported."
        )
    where = f"function {function}"
    if any(value.shape[-1] != 1 for value in taken):
        raise network.wrong(f"{where} must take single signals and numbers only.")
    _together(network, relation.name, lambda: _fitting(taken))
    return understood(network.file, str(function), entry.get("code"))(*taken)


@lru_cache(maxsize=512)
def _parsed(code: str, where: str) -> Formula:
    return formula(code, where)


def understood(file: str, function: str, code: object) -> Formula:
    """The formula of a function of a file, parsed once."""
    where = f"{file}: function {function}"
    if not isinstance(code, str):
        raise BadInput(f"{where} holds no source.")
    return _parsed(code, where)


def _part(network: Network, relation: NetworkRelation, x: Array) -> Array:
    _, start, stop = window_of(network, relation)
    if x.shape[1] < -start:
        raise ValueError(f"a window of {-start} samples of {x.shape[1]}")
    return x[:, x.shape[1] + start : x.shape[1] + stop]


def index_of(network: Network, relation: NetworkRelation) -> int:
    """Which output of a relation a Select takes."""
    index = relation.rest[1] if len(relation.rest) == 2 else None
    if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < MOST_CENTRES:
        raise network.wrong(f"relation {relation.name} does not say which output it selects.")
    return index


def _fuzzify(network: Network, relation: NetworkRelation, x: Array) -> Array:
    form, c = fuzzy_of(network, relation)
    if x.shape[-1] != 1:
        raise ValueError("memberships of more than one signal")
    if form == "Rectangular":
        edges = np.array([(a + b) / 2 for a, b in zip(c[:-1], c[1:], strict=True)])
        return np.asarray(
            np.searchsorted(edges, x[:, :, 0], side="right")[:, :, None] == np.arange(len(c)), dtype=float
        )
    rising = [np.clip((x - a) / (b - a), 0.0, 1.0) for a, b in zip(c[:-1], c[1:], strict=True)]
    edges_ = [np.ones_like(x), *rising, np.zeros_like(x)]
    return np.concatenate([edges_[k] - edges_[k + 1] for k in range(len(c))], axis=2)


def _fir(network: Network, relation: NetworkRelation, x: Array) -> Array:
    W, b = weights_of(network, relation)
    if x.shape[-1] != 1:
        raise ValueError("an impulse response to more than one signal")
    _bounded((len(x), W.shape[1]))
    return np.asarray((x[:, :, 0] @ W + b)[:, None, :])


def _linear(network: Network, relation: NetworkRelation, x: Array) -> Array:
    W, b = weights_of(network, relation)
    _bounded((*x.shape[:2], W.shape[1]))
    return np.asarray(x @ W + b)


def _fitting(taken: list[Array]) -> list[Array]:
    _bounded(np.broadcast_shapes(*(item.shape for item in taken)))
    return taken


def _bounded(shape: tuple[int, ...]) -> None:
    if np.prod(shape, dtype=float) > MOST_VALUES:
        raise ValueError(f"shape {shape}")


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= LARGEST


OPERATIONS: dict[str, Callable[[Network, NetworkRelation, Array], Array]] = {
    "SamplePart": _part, "TimePart": _part,
    "Select": lambda network, relation, x: x[:, :, [index_of(network, relation)]],
    "Fuzzify": _fuzzify, "Fir": _fir, "Linear": _linear,
}  # fmt: skip
