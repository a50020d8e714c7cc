"""MS-NN-lat in a file's graph: local models of the curvature, and the impulse responses that filter them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from greybox_id.base.shorthands import Array
from greybox_id.models.msnn_lat import LateralSettings

from .evaluation import evaluate
from .local_models import PROBES, LocalPlace, Response, affine, leaves, local_models, matched, responses
from .network import Network
from .recognised import NetworkPart, padded, put

FORM = "v_x (k1 + k2 (steer - steer_0) + k3 (v_x - v_x0) + k4 (a_x - a_x0))"
AXES = ("v_x", "steer", "a_x")
"""Axes of the local models; impulse responses lie along the first and the last."""


def lateral(network: Network, output: str, roles: Mapping[str, str]) -> NetworkPart:
    """MS-NN-lat from a relation of the file.

    Parameters
    ----------
    network : the file.
    output : relation that is the yaw rate.
    roles : input of the file -> signal.

    Raises
    ------
    BadInput : it is something else.
    """
    filtered, factors = _filtered(network, output)
    models = local_models(network, filtered[0])
    of = {signal: name for name, signal in roles.items()}
    places = [item.place for item in filtered] + [place for place, _ in models]
    centres = _centres(network, places, roles)
    kappa = _curvatures(network, models, len(filtered[0].weights), centres, of)
    F = _impulse_responses(network, filtered, factors, centres, of)
    if np.any(np.isnan(kappa)) or np.any(np.isnan(F)):
        raise network.wrong(
            f"relation {output} lacks local models or impulse responses: there is one of each for every centre "
            f"({' × '.join(str(len(centre)) for centre in centres.values())} over {', '.join(AXES)})."
        )
    settings = LateralSettings(
        n_delta=len(centres["steer"]), n_v=len(centres["v_x"]), n_x=len(centres["a_x"]), q=F.shape[-1] - 1,
        steer=centres["steer"], v_x=centres["v_x"], a_x=centres["a_x"], curvature_gain=float(np.mean(kappa[1])),
    )  # fmt: skip
    values = {f"kappa_{k + 1}": kappa[k] for k in range(4)} | {"F": F}
    return NetworkPart("msnn_lat", settings, values, output, "yaw_rate", dict(roles))


def _curvatures(
    network: Network,
    models: Sequence[tuple[LocalPlace, tuple[str, ...]]],
    window: int,
    centres: Mapping[str, tuple[float, ...]],
    of: Mapping[str, str],
) -> Array:
    """kappa_1 ... kappa_4, (4, v_x, steer, a_x); NaN where the file has no local model."""
    by = [axis for axis in AXES if axis in of]
    kappa = np.full((4, *(len(centres[axis]) for axis in AXES)), np.nan)
    for place, g in models:
        at = {axis: place.index.get(of.get(axis, ""), 0) for axis in AXES}
        result = affine(network, g, window, [of[axis] for axis in by], of["v_x"], FORM)
        slope = dict.fromkeys(AXES, 0.0) | dict(zip(by, result[1:].tolist(), strict=True))
        middle = result[0] + sum(slope[axis] * centres[axis][at[axis]] for axis in AXES)
        put(network, kappa, (slice(None), *at.values()), [middle, slope["steer"], slope["v_x"], slope["a_x"]])
    return kappa


def _impulse_responses(
    network: Network,
    result: Sequence[Response],
    factors: Array,
    centres: Mapping[str, tuple[float, ...]],
    of: Mapping[str, str],
) -> Array:
    """F, (v_x, a_x, window); a response without memberships along an axis acts everywhere along it."""
    length = max(len(item.weights) for item in result)
    F = np.full((len(centres["v_x"]), len(centres["a_x"]), length), np.nan)
    for item, factor in zip(result, factors.tolist(), strict=True):
        along = [item.place.index.get(of.get(axis, ""), slice(None)) for axis in ("v_x", "a_x")]
        put(network, F, (*along, slice(None)), padded(factor * item.weights, length))
    return F


def _filtered(network: Network, output: str) -> tuple[list[Response], Array]:
    """The impulse responses that make up an output, and the factor of each."""
    firs, others = leaves(network, output, ("Fir",))
    result = responses(network, output, firs)
    if not firs or any(name not in network.numbers for name in others):
        raise network.wrong(f"relation {output} is not a sum of impulse responses (Fir) alone.")
    rng = np.random.default_rng(0)
    probes = {name: rng.uniform(0.5, 2.0, (len(firs) + PROBES, 1, 1)) for name in firs}
    columns = np.stack([values.ravel() for values in probes.values()], axis=1)
    value = np.broadcast_to(evaluate(network, output, probes), (len(columns), 1, 1)).ravel()
    factors = matched(network, columns, value, f"relation {output}", "a sum of impulse responses")
    return result, factors


def _centres(network: Network, places: Sequence[LocalPlace], roles: Mapping[str, str]) -> dict[str, tuple[float, ...]]:
    """Centres along every axis; an axis without memberships has one local model, at zero."""
    centres: dict[str, tuple[float, ...]] = {}
    for place in places:
        for name, centre in place.centres.items():
            axis = roles[name]
            if axis not in AXES:
                raise network.wrong(
                    f"input {name} ({axis}) has memberships; MS-NN-lat has them over {', '.join(AXES)}."
                )
            known = centres.setdefault(axis, centre)
            if len(known) != len(centre) or not np.allclose(known, centre, rtol=1e-6, atol=1e-9):
                raise network.wrong(
                    f"input {name} has different centres in its steady and its transient part; they must be the same."
                )
    return {axis: centres.get(axis, (0.0,)) for axis in AXES}
