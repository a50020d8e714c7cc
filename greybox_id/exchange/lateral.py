"""MS-NN-lat in a file's graph: local models of the curvature, and the impulse responses that filter them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..models.msnn_lat import LateralSettings
from ..parameter import Array
from .evaluation import evaluate
from .local_models import PROBES, Response, affine, leaves, local_models, matched, response
from .network import Network
from .recognised import Part, padded, put

FORM = "v_x (k1 + k2 (steer - steer_0) + k3 (v_x - v_x0) + k4 (a_x - a_x0))"
AXES = ("v_x", "steer", "a_x")
"""Axes of the local models; impulse responses lie along the first and the last."""


def lateral(network: Network, output: str, roles: Mapping[str, str]) -> Part:
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
    responses, factors = _responses(network, output)
    first = responses[0]
    models = local_models(network, first)
    of = {signal: name for name, signal in roles.items()}
    centres = _centres(
        network, [own.place.centres for own in responses] + [place.centres for place, _ in models], roles
    )
    shape = tuple(len(centres[axis]) for axis in AXES)
    length = max(len(own.weights) for own in responses)
    by = [axis for axis in AXES if axis in of]
    kappa = np.full((4, *shape), np.nan)
    for place, own in models:
        at = tuple(place.index.get(of.get(axis, ""), 0) for axis in AXES)
        window = len(first.weights)
        slopes = dict(zip(("1", *by), affine(network, own, window, [of[a] for a in by], of["v_x"], FORM), strict=True))
        middle = {axis: centres[axis][k] for axis, k in zip(AXES, at, strict=True)}
        value = slopes["1"] + sum(slopes[axis] * middle[axis] for axis in by)
        put(network, kappa, (slice(None), *at), [value, slopes["steer"], slopes["v_x"], slopes.get("a_x", 0.0)])
    F = np.full((shape[0], shape[2], length), np.nan)
    for own, factor in zip(responses, factors, strict=True):
        across = [_along(network, own, of.get(axis), len(centres[axis])) for axis in ("v_x", "a_x")]
        put(network, F, (*across, slice(None)), padded(factor * own.weights, length))
    whole = f"output {output}: of local models or impulse responses some are missing; {shape} local models are read"
    if np.any(np.isnan(kappa)) or np.any(np.isnan(F)):
        raise network.wrong(f"{whole}.")
    settings = LateralSettings(
        n_delta=shape[1], n_v=shape[0], n_x=shape[2], q=length - 1, curvature_gain=float(np.mean(kappa[1])),
        **{axis: centres[axis] for axis in AXES},
    )  # fmt: skip
    values = {f"kappa_{k + 1}": kappa[k] for k in range(4)} | {"F": F}
    return Part("msnn_lat", settings, values, output, "yaw_rate", dict(roles))


def _responses(network: Network, output: str) -> tuple[list[Response], Array]:
    """The impulse responses that make up an output, and the factor of each."""
    firs, others = leaves(network, output, ("Fir",))
    if not firs or any(name not in network.numbers for name in others):
        raise network.wrong(f"relation {output} is not a sum of impulse responses (Fir) alone.")
    rng = np.random.default_rng(0)
    probes = {name: rng.uniform(0.5, 2.0, (len(firs) + PROBES, 1, 1)) for name in firs}
    columns = np.stack([values.ravel() for values in probes.values()], axis=1)
    value = np.broadcast_to(evaluate(network, output, probes), (len(columns), 1, 1)).ravel()
    factors = matched(network, columns, value, f"relation {output}", "a sum of impulse responses")
    found = [response(network, name) for name in firs]
    if len({(own.steady, own.factors) for own in found if own.steady is not None}) > 1:
        raise network.wrong(f"relation {output}: its impulse responses filter different steady states; one is read.")
    if len(found) > 1 and any(own.steady is None for own in found):
        raise network.wrong(f"relation {output}: an impulse response of several filters no sum of local models.")
    return found, factors


def _centres(
    network: Network, found: Sequence[Mapping[str, tuple[float, ...]]], roles: Mapping[str, str]
) -> dict[str, tuple[float, ...]]:
    """Centres along every axis; an axis without memberships has one local model, at zero."""
    centres: dict[str, tuple[float, ...]] = {}
    for own in found:
        for name, values in own.items():
            axis = roles[name]
            if axis not in AXES:
                raise network.wrong(
                    f"input {name} ({axis}) has memberships; MS-NN-lat has them over {', '.join(AXES)}."
                )
            known = centres.setdefault(axis, values)
            if len(known) != len(values) or not np.allclose(known, values, rtol=1e-6, atol=1e-9):
                raise network.wrong(
                    f"input {name} has different centres in its steady and its transient part; models here have one set."
                )
    return {axis: centres.get(axis, (0.0,)) for axis in AXES}


def _along(network: Network, own: Response, name: str | None, count: int) -> int | slice:
    """Where a response lies along an axis: a place, or everywhere if it has no memberships over it."""
    return own.place.index.get(name, slice(None)) if name is not None else slice(None)
