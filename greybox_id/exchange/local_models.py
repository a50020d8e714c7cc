"""Sums of local models and the impulse responses behind them, found in a file's graph by their shape alone.

    output = sum over t of  Fir_t( S * activations of t ),   S = sum over places of  g(sample) * activations of the place

Names count for nothing here: what a local model g is made of is told by its values, affine in the signals, on random
samples. So any way of writing it is understood.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..parameter import Array
from .evaluation import evaluate, fuzzy_of, index_of, weights_of, window_of
from .network import Network

SAME = 1e-9
"""Of the largest value: what evaluating a formula in another order may move it by."""
PROBES = 8
MOST_TERMS = 4_000
MOST_RELATIONS = 100
"""Relations that one local model may be made of."""


@dataclass(frozen=True)
class Place:
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
    place: Place
    steady: str | None
    factors: tuple[str, ...]


def leaves(network: Network, root: str, operations: Sequence[str]) -> tuple[list[str], list[str]]:
    """Relations of some operations nearest to `root`, and the other things it follows from: windows and numbers."""
    found, others, seen, stack = [], [], {root}, [root]
    while stack:
        name = stack.pop()
        relation = network.relations.get(name)
        if relation is None or relation.operation in ("SamplePart", "TimePart"):
            others.append(name)
        elif relation.operation in operations:
            found.append(name)
        else:
            new = [own for own in reversed(relation.inputs) if own not in seen]
            seen.update(new)
            stack += new
    return found, others


def response(network: Network, fir: str) -> Response:
    """What a Fir of the family is made of. Raises `BadInput` where it is another."""
    relation = network.relations[fir]
    W, b = weights_of(network, relation)
    if W.shape[1] != 1 or len(relation.inputs) != 1 or np.any(b):
        raise network.wrong(f"relation {fir} is not one impulse response without a bias.")
    factors = _flat(network, relation.inputs[0], "Mul")
    selects, rest = _parted(network, factors)
    sums = [name for name in rest if leaves(network, name, ("Fuzzify",))[0]]
    if len(sums) > 1:
        raise network.wrong(f"relation {fir} filters a product of two sums of local models; one is read.")
    others = tuple(name for name in rest if name not in sums)
    return Response(W[:, 0], place_of(network, selects), sums[0] if sums else None, others)


def local_models(network: Network, of: Response) -> list[tuple[Place, tuple[str, ...]]]:
    """Places and factors of every local model in the steady state of a response."""
    if of.steady is None:
        return [(of.place, of.factors)]
    found = []
    for term in _flat(network, of.steady, "Add"):
        selects, rest = _parted(network, _flat(network, term, "Mul"))
        if not selects or any(leaves(network, name, ("Fuzzify", "Fir"))[0] for name in rest):
            raise network.wrong(f"relation {term} is not a local model times its memberships.")
        found.append((place_of(network, selects), (*rest, *of.factors)))
    return found


def place_of(network: Network, selects: Sequence[str]) -> Place:
    """The place that a product of selected memberships stands for."""
    index: dict[str, int] = {}
    centres: dict[str, tuple[float, ...]] = {}
    for name in selects:
        own = network.relations[name]
        fuzzy = network.relations.get(own.inputs[0])
        if fuzzy is None or fuzzy.operation != "Fuzzify":
            raise network.wrong(f"relation {name} selects from something else than memberships (Fuzzify).")
        form, found = fuzzy_of(network, fuzzy)
        window = network.relations.get(fuzzy.inputs[0])
        if window is None or window.operation not in ("SamplePart", "TimePart"):
            raise network.wrong(f"relation {fuzzy.name} is not over the window of an input.")
        if form == "Rectangular" and len(found) > 1:
            raise network.wrong(f"relation {fuzzy.name} has rectangular memberships; triangular ones are understood.")
        signal, at = window_of(network, window)[0], index_of(network, own)
        if at >= len(found):
            raise network.wrong(f"relation {name} selects membership {at + 1} of {len(found)}.")
        if index.setdefault(signal, at) != at or centres.setdefault(signal, found) != found:
            raise network.wrong(f"relation {name}: one product of memberships holds two over {signal}.")
    return Place(index, centres)


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
    for name in factors:
        if len(network.order(name)) > MOST_RELATIONS:
            raise network.wrong(f"relation {name} is too intricate for a local model {form}.")
    rng = np.random.default_rng(0)
    given = {name: rng.uniform(0.5, 2.0, (PROBES, window, 1)) for name in network.inputs}
    value = np.prod([_sampled(network, name, given, window) for name in factors], axis=0) if factors else np.ones(())
    value = np.broadcast_to(value, (PROBES, window, 1)).ravel()
    scale = given[times].ravel() if times is not None else np.ones(value.size)
    columns = np.stack([scale, *(scale * given[name].ravel() for name in by)], axis=1)
    return matched(network, columns, value, f"the local model {' * '.join(factors) or '1'}", form)


def matched(network: Network, columns: Array, value: Array, what: str, form: str) -> Array:
    """Coefficients by which columns make up a value. Raises `BadInput` where they do not."""
    if np.all(np.isfinite(value)):
        found = np.linalg.lstsq(columns, value, rcond=None)[0]
        if np.max(np.abs(columns @ found - value)) <= SAME * np.max(np.abs(value)):
            return np.asarray(found)
    raise network.wrong(f"{what} is not of the form {form}.")


def _sampled(network: Network, name: str, given: Mapping[str, Array], window: int) -> Array:
    value = evaluate(network, name, given)
    if value.ndim != 3 or value.shape[1] not in (1, window) or value.shape[2] != 1:
        raise network.wrong(f"relation {name} has shape {value.shape[1:]}, its local model a window of {window}.")
    return value


def _flat(network: Network, root: str, operation: str) -> list[str]:
    """What a tree of sums or products puts together, in order."""
    found, stack = [], [root]
    while stack:
        name = stack.pop()
        own = network.relations.get(name)
        if own is not None and own.operation in (operation, "Identity"):
            stack += reversed(own.inputs)
        else:
            found.append(name)
        if len(found) + len(stack) > MOST_TERMS:
            raise network.wrong(f"relation {root} puts together more than {MOST_TERMS} terms.")
    return found


def _parted(network: Network, names: Sequence[str]) -> tuple[list[str], list[str]]:
    selects = [name for name in names if name in network.relations and network.relations[name].operation == "Select"]
    return selects, [name for name in names if name not in selects]
