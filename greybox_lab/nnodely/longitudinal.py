"""MS-NN-long in a file's graph: two networks of the torques, local models of the lateral force, and Newton's law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from greybox_id.base.shorthands import Array
from greybox_id.models.msnn_long import LongitudinalSettings

from .evaluation import LONGEST_WINDOW, evaluate, weights_of
from .local_models import PROBES, Response, affine, leaves, local_models, responses
from .network import Network
from .newton import newton
from .recognised import NetworkPart, padded, put

FORM = "q1 + q2 (a_y - a_y0)"
MOST_SIDES, MOST_NEURONS = 20, 200


def longitudinal(network: Network, output: str, roles: Mapping[str, str]) -> NetworkPart:
    """MS-NN-long from a relation of the file; see `lateral`."""
    of = {signal: name for name, signal in roles.items()}
    cut, others = leaves(network, output, ("Fir", "Linear"))
    torques = [name for name in cut if network.relations[name].operation == "Linear"]
    sides = [name for name in cut if name not in torques]
    if len(sides) > MOST_SIDES:
        raise network.wrong(f"relation {output} has {len(sides)} impulse responses; up to {MOST_SIDES} are read.")
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
        raise network.wrong(f"relation {linear} is not one torque without a bias; {G.shape} weights stand in the file.")
    if len(W) > LONGEST_WINDOW or W.shape[1] > MOST_NEURONS:
        raise network.wrong(
            f"relation {fir.name} has weights of shape {W.shape}; {LONGEST_WINDOW, MOST_NEURONS} are read."
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
