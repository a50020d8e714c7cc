"""Newton's law along the vehicle, found in whatever words a file writes it.

Which number of the file is the mass, which the radius and so on is told by trying: all orders at once, on random
values. Each term may have a constant factor, such as the two wheels that share a torque.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from greybox_id.base.shorthands import Array
from greybox_id.models.msnn_long import GRAVITY

from .evaluation import evaluate, window_of
from .local_models import MOST_RELATIONS, PROBES, SAME
from .network import Network

LAW = (
    "((T_t + T_b)/r - k_a v_x^2 - c_l v_x - F_yf sin(steer))/m - c_r g, over 1 + 2 (I_wf + I_wr)/(m r^2) with twice "
    "one inertia or two, each term with a constant factor"
)
PHYSICAL = ("m", "r", "k_a", "c_l", "c_r")
INERTIAS = {6: ("I_w",), 7: ("I_wf", "I_wr")}
"""Count of numbers -> which wheel inertias are among them."""


def newton(
    network: Network,
    output: str,
    terms: tuple[Sequence[str], Sequence[str]],
    others: Sequence[str],
    roles: Mapping[str, str],
) -> tuple[dict[str, float], dict[str, float]]:
    """Values of the physical parameters, and the factor by which each torque and lateral force counts.

    Parameters
    ----------
    network : the file.
    output : relation that is the acceleration.
    terms : relations that are torques, and those that are lateral forces.
    others : what else it follows from: windows of one sample, and numbers.
    roles : input of the file -> signal.

    Raises
    ------
    BadInput : it is another law.
    """
    signals, numbers = _made_of(network, output, others, roles)
    torques, sides = terms
    if len(network.order(output, (*torques, *sides))) > MOST_RELATIONS:
        raise network.wrong(f"relation {output} is too intricate for Newton's law: {LAW}.")
    inertias = INERTIAS[len(numbers)]
    rng, count = np.random.default_rng(0), len(torques) + len(sides) + 3 + PROBES
    p = {name: rng.uniform(0.5, 2.0, count) for name in (*PHYSICAL, *inertias)}
    x = {name: rng.uniform(0.5, 1.5, count) for name in (*torques, *sides, "v_x", "steer")}
    orders = list(permutations(p))
    given = {name: x[name] for name in (*torques, *sides)} | {name: x[signal] for name, signal in signals.items()}

    def stated(value: Mapping[str, Array]) -> Array:
        """The law as the file has it, (count, orders), with values of the parameters."""
        flat = {name: np.tile(values, len(orders)) for name, values in given.items()}
        flat |= {number: np.concatenate([value[order[k]] for order in orders]) for k, number in enumerate(numbers)}
        result = evaluate(network, output, {name: values[:, None, None] for name, values in flat.items()})
        return np.broadcast_to(result, (len(orders) * count, 1, 1)).reshape(len(orders), count).T

    force = stated(p | {name: np.zeros(count) for name in inertias})
    columns = [x[name] / p["r"] / p["m"] for name in torques]
    columns += [-x[name] * np.sin(x["steer"]) / p["m"] for name in sides]
    columns += [-p["k_a"] * x["v_x"] ** 2 / p["m"], -p["c_l"] * x["v_x"] / p["m"], -p["c_r"] * GRAVITY]
    factors, lawful = _solved(np.stack(columns, axis=1), force)
    wheels = 2 * p["I_w"] if len(inertias) == 1 else p["I_wf"] + p["I_wr"]
    with np.errstate(all="ignore"):
        heavier = force / stated(p) - 1.0
    inertia, rolls = _solved((2 * wheels / (p["m"] * p["r"] ** 2))[:, None], heavier)
    good = np.flatnonzero(lawful & rolls)
    if not good.size:
        raise network.wrong(f"relation {output} is not Newton's law of the family: {LAW}.")
    best = int(good[0])
    of_terms = dict(zip((*torques, *sides, "k_a", "c_l", "c_r"), factors[:, best].tolist(), strict=True))
    of_terms |= dict.fromkeys(inertias, float(inertia[0, best]))
    values = {name: network.numbers[number].item() for name, number in zip(orders[best], numbers, strict=True)}
    return {name: value * of_terms.get(name, 1.0) for name, value in values.items()}, of_terms


def _made_of(
    network: Network, output: str, others: Sequence[str], roles: Mapping[str, str]
) -> tuple[dict[str, str], list[str]]:
    """Signal of each window of one sample, and the names of the numbers."""
    windows = {name: window_of(network, network.relations[name]) for name in others if name in network.relations}
    for name, start, stop in windows.values():
        if (start, stop) != (-1, 0) or roles[name] not in ("v_x", "steer"):
            raise network.wrong(f"relation {output} takes {name} at samples {start} to {stop}; {LAW}, all newest.")
    numbers = [name for name in others if name not in windows]
    if len(numbers) not in INERTIAS or any(network.number(name, f"relation {output}").size != 1 for name in numbers):
        raise network.wrong(f"relation {output} is made of {len(numbers)} numbers; Newton's law has 6 or 7: {LAW}.")
    return {name: roles[signal] for name, (signal, _, _) in windows.items()}, numbers


def _solved(columns: Array, values: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Coefficients (columns, orders) by which columns make up values (count, orders), and for which orders they do."""
    finite = np.all(np.isfinite(values), axis=0)
    values = np.where(finite, values, 0.0)
    result = np.linalg.lstsq(columns, values, rcond=None)[0]
    off = np.max(np.abs(columns @ result - values), axis=0)
    makes_up = finite & (off <= SAME * np.max(np.abs(values), axis=0)) & np.all(np.abs(result) > SAME, axis=0)
    return np.asarray(result), makes_up
