"""MS-NN-long in a file's graph: two networks of the torques, local models of the lateral force, and Newton's law.

Newton's law along the vehicle, found in whatever words a file writes it.

Which number of the file is the mass, which the radius and so on is told by trying: all orders at once, on random
values. Each term may have a constant factor, such as the two wheels that share a torque.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from greybox_id.base.shorthands import Array
from greybox_id.models.msnn_long import GRAVITY, LongitudinalSettings

from .evaluation import LONGEST_WINDOW, evaluate, weights_of, window_of
from .local_models import MOST_RELATIONS, PROBES, SAME, Response, affine, leaves, local_models, responses
from .network import Network
from .recognised import NetworkPart, padded, put

LAW = (
    "((T_t + T_b)/r - k_a v_x^2 - c_l v_x - F_yf sin(steer))/m - c_r g, divided by 1 + 2 (I_wf + I_wr)/(m r^2), with "
    "one or two wheel inertias, and a constant factor on each term"
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
            raise network.wrong(
                f"relation {output} takes {name} at samples {start} to {stop}; {LAW}; all inputs "
                "must be the newest samples."
            )
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


FORM = "q1 + q2 (a_y - a_y0)"
MOST_SIDES, MOST_NEURONS = 20, 200


def longitudinal(network: Network, output: str, roles: Mapping[str, str]) -> NetworkPart:
    """MS-NN-long from a relation of the file; see `lateral`."""
    of = {signal: name for name, signal in roles.items()}
    cut, others = leaves(network, output, ("Fir", "Linear"))
    torques = [name for name in cut if network.relations[name].operation == "Linear"]
    sides = [name for name in cut if name not in torques]
    if len(sides) > MOST_SIDES:
        raise network.wrong(
            f"relation {output} has {len(sides)} impulse responses; at most {MOST_SIDES} are supported."
        )
    branches = dict(_branch(network, name, of["motor_current"]) for name in torques)
    if len(torques) != 2 or set(branches) != {"t", "b"}:
        raise network.wrong(
            f"relation {output} is not of two networks of the motor current, one of its positive part and one of its "
            "negative part (Linear of Tanh of Fir)."
        )
    result = responses(network, output, sides)
    physical, factors = newton(network, output, (torques, sides), others, roles)
    lengths = [W.shape[0] for _, W, _, _ in branches.values()] + [len(item.weights) for item in result]
    length, eta = max(lengths), max(W.shape[1] for _, W, _, _ in branches.values())
    values: dict[str, Array] = {name: np.array(number) for name, number in physical.items()}
    for sign, (name, W, b, G) in branches.items():
        more = eta - W.shape[1]  # neurons of no weight
        values[f"G_1{sign}"] = np.pad(W.T, ((0, more), (length - len(W), 0)))
        values[f"b_1{sign}"] = np.pad(b, (0, more))
        values[f"G_2{sign}"] = np.pad(factors[name] * G, (0, more))
    v_x, a_y, lateral_force = _sides(network, result, [factors[name] for name in sides], length, of)
    settings = LongitudinalSettings(
        n_v=len(v_x), n_y=len(a_y), eta=eta, gamma=length - 1, one_inertia="I_w" in physical, v_x=v_x, a_y=a_y
    )
    return NetworkPart("msnn_long", settings, values | lateral_force, output, "a_x", dict(roles))


def _branch(network: Network, linear: str, current: str) -> tuple[str, tuple[str, Array, Array, Array]]:
    """Which currents a torque network sees, "t" or "b"; its name, weights and biases of both layers."""
    G, g = weights_of(network, network.relations[linear])
    below = linear
    for operation in ("Linear", "Tanh", "Fir"):
        if below not in network.relations or network.relations[below].operation != operation:
            raise network.wrong(
                f"relation {linear} is not a Linear of a Tanh of a Fir, a torque network of the family."
            )
        fir, below = network.relations[below], network.relations[below].inputs[0]
    W, b = weights_of(network, fir)
    if np.any(g) or G.shape != (W.shape[1], 1):
        raise network.wrong(
            f"relation {linear} must have one output, the torque, weights of shape {(W.shape[1], 1)} and no bias other "
            f"than zero; the file has weights of shape {G.shape} and the bias {g.tolist()!s:.60}."
        )
    if len(W) > LONGEST_WINDOW or W.shape[1] > MOST_NEURONS:
        raise network.wrong(
            f"relation {fir.name} has weights of shape {W.shape}; at most {LONGEST_WINDOW} samples and {MOST_NEURONS} "
            "neurons are supported."
        )
    windows = np.random.default_rng(0).uniform(-2.0, 2.0, (PROBES, len(W), 1))
    seen = evaluate(network, below, {current: windows} if current in network.inputs else {})
    for sign, part in (("t", np.maximum(windows, 0.0)), ("b", np.minimum(windows, 0.0))):
        if seen.shape == part.shape and np.array_equal(seen, part):
            return sign, (linear, W, b, G[:, 0])
    raise network.wrong(f"relation {below} is neither the positive nor the negative part of a window of {current}.")


def _sides(
    network: Network, result: Sequence[Response], factors: Sequence[float], length: int, of: Mapping[str, str]
) -> tuple[tuple[float, ...], tuple[float, ...], dict[str, Array]]:
    """Centres over v_x and a_y, and the values of the lateral force; zeros where the file has none."""
    if not result:
        zeros = {"q_1": np.zeros(1), "q_2": np.zeros(1), "F_y": np.zeros((1, length))}
        return (0.0,), (0.0,), zeros
    if "a_y" not in of:
        raise network.wrong("its lateral force has no input that is a_y.")
    v, a, first = of["v_x"], of["a_y"], result[0]
    models = local_models(network, first)
    v_x = first.place.centres.get(v, (0.0,))
    a_y = models[0][0].centres.get(a, (0.0,))
    centres = [item.place.centres for item in result] + [place.centres for place, _ in models]
    if any(centre.get(v, v_x) != v_x or centre.get(a, a_y) != a_y or not set(centre) <= {v, a} for centre in centres):
        raise network.wrong("the lateral force has memberships over other signals than v_x and a_y, or several sets.")
    q, F = np.full((2, len(a_y)), np.nan), np.full((len(v_x), length), np.nan)
    for place, item in models:
        at = place.index.get(a, 0)
        level, slope = affine(network, item, len(first.weights), [a], None, FORM)
        put(network, q, (slice(None), at), [level + slope * a_y[at], slope])
    for one, factor in zip(result, factors, strict=True):
        put(network, F, (one.place.index.get(v, 0), slice(None)), padded(factor * one.weights, length))
    if np.any(np.isnan(q)) or np.any(np.isnan(F)):
        raise network.wrong("local models or impulse responses of the lateral force are missing.")
    return v_x, a_y, {"q_1": q[0], "q_2": q[1], "F_y": F}
