"""Sums of local models and the impulse responses behind them, found in a file's graph by their shape alone.

    output = sum over t of Fir_t(S * activations of t),   S = sum over places of g(sample) * activations of the place

Names count for nothing here: what a local model g is made of is told by its values, affine in the signals, on random
samples. So any way of writing it is understood.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from greybox_id.base.shorthands import Array

from .evaluation import LONGEST_WINDOW, evaluate, fuzzy_of, index_of, weights_of, window_of
from .network import Network

SAME = 1e-9
"""Of the largest value: what evaluating a formula in another order may move it by."""
PROBES = 8
MOST_TERMS = 4_000
MOST_RELATIONS = 80
"""Relations that one local model, or Newton's law, may be made of."""
MOST_RESPONSES, MOST_FACTORS = 400, 6


@dataclass(frozen=True)
class LocalPlace:
    """Where memberships put a local model: input -> index of its centre; in `centres`, input -> all centres."""

    index: Mapping[str, int]
    centres: Mapping[str, tuple[float, ...]]


@dataclass(frozen=True)
class Response:
    """One Fir: its weights, where it acts, and the steady state it filters.

    Attributes
    ----------
    weights : (window,) oldest sample first.
    place : of its own activations.
    steady : relation S, None where it is one local model without a sum.
    factors : relations that multiply S, apart from activations.
    """

    weights: Array
    place: LocalPlace
    steady: str | None
    factors: tuple[str, ...]


def leaves(network: Network, root: str, operations: Sequence[str]) -> tuple[list[str], list[str]]:
    """Relations of some operations nearest to `root`, and the other things it follows from: windows and numbers."""
    result, others, seen, stack = [], [], {root}, [root]
    while stack:
        name = stack.pop()
        relation = network.relations.get(name)
        if relation is None or relation.operation in ("SamplePart", "TimePart"):
            others.append(name)
        elif relation.operation in operations:
            result.append(name)
        else:
            new = [item for item in reversed(relation.inputs) if item not in seen]
            seen.update(new)
            stack += new
    return result, others


def responses(network: Network, root: str, firs: Sequence[str]) -> list[Response]:
    """What Firs are made of. Raises `BadInput` where they are none of the family, or filter different steady states."""
    if len(firs) > MOST_RESPONSES:
        raise network.wrong(f"it holds {len(firs)} impulse responses; up to {MOST_RESPONSES} are read.")
    fuzzy: set[str] = set()
    for name in network.order(root):
        value = network.relations.get(name)
        if value is not None and (value.operation == "Fuzzify" or not fuzzy.isdisjoint(value.inputs)):
            fuzzy.add(name)
    result = [_response(network, name, fuzzy) for name in firs]
    if len({(item.steady, item.factors) for item in result}) > 1:
        raise network.wrong(f"{', '.join(firs)[:200]} filter several sums of local models; only one sum is understood.")
    return result


def _response(network: Network, fir: str, fuzzy: Collection[str]) -> Response:
    relation = network.relations[fir]
    W, b = weights_of(network, relation)
    if W.shape[1] != 1 or len(W) > LONGEST_WINDOW or len(relation.inputs) != 1 or np.any(b):
        raise network.wrong(
            f"relation {fir} must be one impulse response without a bias, of {LONGEST_WINDOW} samples at most."
        )
    factors = _flat(network, relation.inputs[0], "Mul")
    selects, rest = _parted(network, factors)
    sums = [name for name in rest if name in fuzzy]
    if len(sums) > 1:
        raise network.wrong(
            f"relation {fir} filters a product of two sums of local models; only a single sum is understood."
        )
    others = tuple(_simple(network, name) for name in rest if name not in sums)
    return Response(W[:, 0], _place(network, selects), sums[0] if sums else None, others)


def local_models(network: Network, of: Response) -> list[tuple[LocalPlace, tuple[str, ...]]]:
    """Places and factors of every local model in the steady state of a response."""
    if of.steady is None:
        return [(of.place, of.factors)]
    result = []
    for term in _flat(network, of.steady, "Add"):
        selects, rest = _parted(network, _flat(network, term, "Mul"))
        if not selects:
            raise network.wrong(f"relation {term} is not a local model times its memberships.")
        result.append((_place(network, selects), (*(_simple(network, name) for name in rest), *of.factors)))
    return result


def _simple(network: Network, name: str) -> str:
    """The name of a relation that a local model may be made of."""
    seen, stack = {name}, [name]
    while stack:
        relation = network.relations.get(stack.pop())
        if relation is not None and (relation.operation in ("Fuzzify", "Fir") or len(seen) > MOST_RELATIONS):
            raise network.wrong(f"relation {name} is too complex to be a local model or a factor of one.")
        new = set(relation.inputs) - seen if relation is not None else set()
        seen |= new
        stack += new
    return name


def _place(network: Network, selects: Sequence[str]) -> LocalPlace:
    """The place that a product of selected memberships stands for."""
    index: dict[str, int] = {}
    centres: dict[str, tuple[float, ...]] = {}
    for name in selects:
        relation = network.relations[name]
        fuzzy = network.relations.get(relation.inputs[0])
        if fuzzy is None or fuzzy.operation != "Fuzzify":
            raise network.wrong(f"relation {name} selects from something else than memberships (Fuzzify).")
        form, result = fuzzy_of(network, fuzzy)
        window = network.relations.get(fuzzy.inputs[0])
        if window is None or window.operation not in ("SamplePart", "TimePart"):
            raise network.wrong(f"relation {fuzzy.name} must have the window of an input as its argument.")
        if form == "Rectangular" and len(result) > 1:
            raise network.wrong(f"relation {fuzzy.name} has rectangular memberships; triangular ones are understood.")
        signal, at = window_of(network, window)[0], index_of(network, relation)
        if at >= len(result):
            raise network.wrong(f"relation {name} selects membership {at + 1} , but there are {len(result)}.")
        if index.setdefault(signal, at) != at or centres.setdefault(signal, result) != result:
            raise network.wrong(f"relation {name}: one product of memberships holds two over {signal}.")
    return LocalPlace(index, centres)


def affine(
    network: Network, factors: Sequence[str], window: int, by: Sequence[str], times: str | None, form: str
) -> Array:
    """Coefficients of a local model: its value at zero, then its slopes over the inputs `by`.

    Parameters
    ----------
    factors : relations whose product it is.
    window : samples.
    by : inputs.
    times : input that multiplies all of it, None for none.
    form : how the family writes it, for sentences.

    Raises
    ------
    BadInput : it is not affine in those inputs, or looks at another sample or input.
    """
    rng = np.random.default_rng(0)
    given = {name: rng.uniform(0.5, 2.0, (PROBES, window, 1)) for name in network.inputs}
    values = [np.ones((PROBES, window, 1)), *(_sampled(network, name, given, window) for name in factors)]
    value = np.asarray(reduce(np.multiply, values)).ravel()
    scale = given[times].ravel() if times is not None else np.ones(value.size)
    columns = np.stack([scale, *(scale * given[name].ravel() for name in by)], axis=1)
    return matched(network, columns, value, f"the local model {' * '.join(factors) or '1'}", form)


def matched(network: Network, columns: Array, value: Array, what: str, form: str) -> Array:
    """Coefficients by which columns make up a value. Raises `BadInput` where they do not."""
    if np.all(np.isfinite(value)):
        result = np.linalg.lstsq(columns, value, rcond=None)[0]
        if np.max(np.abs(columns @ result - value)) <= SAME * np.max(np.abs(value)):
            return np.asarray(result)
    raise network.wrong(f"{what} is not of the form {form}.")


def _sampled(network: Network, name: str, given: Mapping[str, Array], window: int) -> Array:
    value = evaluate(network, name, given)
    if value.ndim != 3 or value.shape[1] not in (1, window) or value.shape[2] != 1:
        raise network.wrong(f"relation {name} has shape {value.shape[1:]}, its local model a window of {window}.")
    return value


def _flat(network: Network, root: str, operation: str) -> list[str]:
    """What a tree of sums or products puts together, in order."""
    result, stack = [], [root]
    while stack:
        name = stack.pop()
        value = network.relations.get(name)
        if value is not None and value.operation in (operation, "Identity"):
            stack += reversed(value.inputs)
        else:
            result.append(name)
        if len(result) + len(stack) > MOST_TERMS:
            raise network.wrong(f"relation {root} combines more than {MOST_TERMS} terms.")
    return result


def _parted(network: Network, names: Sequence[str]) -> tuple[list[str], list[str]]:
    """The memberships among factors, and the others."""
    selects = [name for name in names if name in network.relations and network.relations[name].operation == "Select"]
    if max(len(selects), len(names) - len(selects)) > MOST_FACTORS:
        raise network.wrong(f"{', '.join(names)[:100]}, ...: {len(names)} factors are more than this family has.")
    return selects, [name for name in names if name not in selects]
