"""MS-NN-long in a file's graph: two networks of the torques, local models of the lateral force, and Newton's law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import permutations

import numpy as np

from ..models.msnn_long import GRAVITY, LongitudinalSettings
from ..parameter import Array
from .evaluation import evaluate, weights_of, window_of
from .local_models import PROBES, SAME, Response, affine, leaves, local_models, responses
from .network import Network
from .recognised import Part, padded, put

FORM = "q1 + q2 (a_y - a_y0)"
LAW = (
    "((T_t + T_b)/r - k_a v_x^2 - c_l v_x - F_yf sin(steer))/m - c_r g, over 1 + 2 (I_wf + I_wr)/(m r^2) with twice "
    "one inertia or two, each term with a constant factor"
)
PHYSICAL = ("m", "r", "k_a", "c_l", "c_r")


def longitudinal(network: Network, output: str, roles: Mapping[str, str]) -> Part:
    """MS-NN-long from a relation of the file; see `lateral`."""
    of = {signal: name for name, signal in roles.items()}
    cut, others = leaves(network, output, ("Fir", "Linear"))
    torques = [name for name in cut if network.relations[name].operation == "Linear"]
    sides = [name for name in cut if name not in torques]
    branches = dict(_branch(network, name, of["motor_current"]) for name in torques)
    if len(torques) != 2 or set(branches) != {"t", "b"}:
        raise network.wrong(
            f"relation {output} is not of two networks of the motor current, one of its positive part and one of its "
            "negative part (Linear of Tanh of Fir)."
        )
    found = responses(network, sides)
    physical, factors = _newton(network, output, torques, sides, others, roles)
    lengths = [W.shape[0] for _, W, _, _ in branches.values()] + [len(own.weights) for own in found]
    length, eta = max(lengths), max(W.shape[1] for _, W, _, _ in branches.values())
    values: dict[str, Array] = {name: np.array(number) for name, number in physical.items()}
    for sign, (name, W, b, G) in branches.items():
        more = eta - W.shape[1]  # neurons of no weight
        values[f"G_1{sign}"] = np.pad(W.T, ((0, more), (length - len(W), 0)))
        values[f"b_1{sign}"] = np.pad(b, (0, more))
        values[f"G_2{sign}"] = np.pad(factors[name] * G, (0, more))
    v_x, a_y, lateral_force = _sides(network, found, [factors[name] for name in sides], length, of)
    settings = LongitudinalSettings(
        n_v=len(v_x), n_y=len(a_y), eta=eta, gamma=length - 1, one_inertia="I_w" in physical, v_x=v_x, a_y=a_y
    )
    return Part("msnn_long", settings, values | lateral_force, output, "a_x", dict(roles))


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
        raise network.wrong(f"relation {linear} is not one torque without a bias; {G.shape} weights stand in the file.")
    windows = np.random.default_rng(0).uniform(-2.0, 2.0, (PROBES, len(W), 1))
    seen = evaluate(network, below, {current: windows} if current in network.inputs else {})
    for sign, part in (("t", np.maximum(windows, 0.0)), ("b", np.minimum(windows, 0.0))):
        if seen.shape == part.shape and np.array_equal(seen, part):
            return sign, (linear, W, b, G[:, 0])
    raise network.wrong(f"relation {below} is neither the positive nor the negative part of a window of {current}.")


def _newton(
    network: Network, output: str, torques: Sequence[str], sides: Sequence[str], others: Sequence[str],
    roles: Mapping[str, str],
) -> tuple[dict[str, float], dict[str, float]]:  # fmt: skip
    """Values of the physical parameters, and the factor by which each torque and lateral force counts.

    Which number of the file is which parameter is told by trying: all orders at once, on random values.
    """
    windows = {name: window_of(network, network.relations[name]) for name in others if name in network.relations}
    numbers = [name for name in others if name not in windows]
    inertias = {6: ("I_w",), 7: ("I_wf", "I_wr")}.get(len(numbers))
    if inertias is None or any(name not in network.numbers for name in numbers):
        raise network.wrong(f"relation {output} is made of {len(numbers)} numbers; Newton's law has 6 or 7: {LAW}.")
    for name, start, stop in windows.values():
        if (start, stop) != (-1, 0) or roles.get(name) not in ("v_x", "steer"):
            raise network.wrong(f"relation {output} takes {name} at samples {start} to {stop}; {LAW}, all newest.")
    rng, count = np.random.default_rng(0), len(torques) + len(sides) + 3 + PROBES
    p = {name: rng.uniform(0.5, 2.0, count) for name in (*PHYSICAL, *inertias)}
    x = {name: rng.uniform(0.5, 1.5, count) for name in (*torques, *sides, "v_x", "steer")}
    orders = list(permutations(p))
    given = {name: np.tile(x[name], len(orders)) for name in (*torques, *sides)}
    given |= {name: np.tile(x[roles[windows[name][0]]], len(orders)) for name in windows}
    columns = np.stack(
        [x[name] / p["r"] / p["m"] for name in torques]
        + [-x[name] * np.sin(x["steer"]) / p["m"] for name in sides]
        + [-p["k_a"] * x["v_x"] ** 2 / p["m"], -p["c_l"] * x["v_x"] / p["m"], -p["c_r"] * GRAVITY], axis=1,
    )  # fmt: skip

    def told(still: bool) -> Array:
        """The law as the file has it, (orders, count), with wheels of no inertia or as they are."""
        own = {name: np.zeros(count) if still and name in inertias else values for name, values in p.items()}
        tried = {number: np.concatenate([own[order[k]] for order in orders]) for k, number in enumerate(numbers)}
        flat = {name: values[:, None, None] for name, values in (given | tried).items()}
        return np.broadcast_to(evaluate(network, output, flat), (len(orders) * count, 1, 1)).reshape(len(orders), count)

    force, whole = told(still=True), told(still=False)
    wheels = sum(p[name] for name in inertias) * (2 if len(inertias) == 1 else 1)
    for order, y, y_whole in zip(orders, force, whole, strict=True):
        factors = _solved(columns, y)
        if factors is None or np.any(np.abs(factors) < SAME):
            continue
        inertia = _solved((2 * wheels / (p["m"] * p["r"] ** 2))[:, None], y / y_whole - 1.0)
        if inertia is None:
            continue
        of_terms = dict(zip((*torques, *sides, "k_a", "c_l", "c_r"), factors.tolist(), strict=True))
        of_terms |= dict.fromkeys(inertias, float(inertia[0]))
        values = {name: float(network.numbers[numbers[k]].ravel()[0]) for k, name in enumerate(order)}
        return {name: value * of_terms.get(name, 1.0) for name, value in values.items()}, of_terms
    raise network.wrong(f"relation {output} is not Newton's law of the family: {LAW}.")


def _solved(columns: Array, y: Array) -> Array | None:
    if not np.all(np.isfinite(y)):
        return None
    found = np.linalg.lstsq(columns, y, rcond=None)[0]
    return np.asarray(found) if np.max(np.abs(columns @ found - y)) <= SAME * np.max(np.abs(y)) else None


def _sides(
    network: Network, found: Sequence[Response], factors: Sequence[float], length: int, of: Mapping[str, str]
) -> tuple[tuple[float, ...], tuple[float, ...], dict[str, Array]]:
    """Centres over v_x and a_y, and the values of the lateral force; zeros where the file has none."""
    if not found:
        zeros = {"q_1": np.zeros(1), "q_2": np.zeros(1), "F_y": np.zeros((1, length))}
        return (0.0,), (0.0,), zeros
    if "a_y" not in of:
        raise network.wrong("its lateral force has no input that is a_y.")
    v, a, first = of["v_x"], of["a_y"], found[0]
    models = local_models(network, first)
    v_x = first.place.centres.get(v, (0.0,))
    a_y = models[0][0].centres.get(a, (0.0,))
    centres = [own.place.centres for own in found] + [place.centres for place, _ in models]
    if any(own.get(v, v_x) != v_x or own.get(a, a_y) != a_y or not set(own) <= {v, a} for own in centres):
        raise network.wrong("the lateral force has memberships over other signals than v_x and a_y, or several sets.")
    q, F = np.full((2, len(a_y)), np.nan), np.full((len(v_x), length), np.nan)
    for place, own in models:
        at = place.index.get(a, 0)
        level, slope = affine(network, own, len(first.weights), [a], None, FORM)
        put(network, q, (slice(None), at), [level + slope * a_y[at], slope])
    for one, factor in zip(found, factors, strict=True):
        put(network, F, (one.place.index.get(v, 0), slice(None)), padded(factor * one.weights, length))
    if np.any(np.isnan(q)) or np.any(np.isnan(F)):
        raise network.wrong("local models or impulse responses of the lateral force are missing.")
    return v_x, a_y, {"q_1": q[0], "q_2": q[1], "F_y": F}
