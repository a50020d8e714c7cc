"""Is a magnitude the same everywhere? A true cause's is; an impostor's changes with speed, load, time and channel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from ..estimation.calibration import CAL
from ..estimation.hypothesis import Hypothesis
from ..estimation.search import Search
from ..shorthands import Array


@dataclass(frozen=True)
class Spread:
    """How a magnitude differs between parts of a recording.

    Attributes
    ----------
    place : between what parts, in words: along what, or between channels.
    relative : weighted standard deviation of the parts' magnitudes over the magnitude.
    p_value : how often so much would come from noise.
    parts : of each part, magnitudes as coordinates, from low to high; NaN where a part says nothing.
    """

    place: str
    relative: float
    p_value: float
    parts: tuple[float, ...]


def spreads(search: Search, found: Hypothesis, orders: Mapping[str, Array], effect: int = 0) -> list[Spread]:
    """Magnitudes of one of a hypothesis' effects in thirds of what orders the rows, and by channel, the others held.

    Parameters
    ----------
    search, found : the hypothesis and what refitted it.
    orders : "along ..." -> (N,) by which rows are sorted.
    effect : which one.
    """
    at = sum(len(own.axes) for own in found.candidates[:effect])
    r = search.colour.white(found.e[:, :, None])[:, :, 0]
    W = search.colour.white(found.J[:, :, at : at + 1])[:, :, 0]
    informs, pulls = W**2, W * r
    axis, total = found.axes[at], float(np.sum(informs))
    if total <= 0:
        return []
    rows, channels = np.sum(informs, axis=1), np.arange(informs.shape[1])
    cuts = {place: (_thirds(values, rows)[:, None], CAL.parts) for place, values in orders.items()}
    cuts["between channels"] = (channels, len(channels))
    result = []
    for place, (part, count) in cuts.items():
        of = np.broadcast_to(part, informs.shape).ravel()
        told_by = np.bincount(of, informs.ravel(), count)
        offs = -np.bincount(of, pulls.ravel(), count)
        told = told_by > CAL.part_least * total
        offs = np.where(told, offs / np.where(told, told_by, 1.0), np.nan)
        mean = np.nansum(offs * told_by) / np.sum(told_by[told]) if np.any(told) else 0.0
        Q = float(np.nansum(told_by * (offs - mean) ** 2))
        size = abs(found.m[at] - axis.null) + 1e-300
        relative = (
            float(np.sqrt(max(Q - (np.sum(told) - 1), 0.0) / np.sum(told_by[told])) / size) if np.any(told) else 0.0
        )
        p = float(chdtrc(max(int(np.sum(told)) - 1, 1), Q))
        result.append(Spread(place, relative, p, tuple(float(found.m[at] + off) for off in offs)))
    return result


def varies(search: Search, found: Hypothesis, seen: Mapping[str, Array]) -> dict[str, Spread]:
    """Effect -> how its magnitude differs most: by speed, accelerations, time or channel; none where noise may do so.

    Parameters
    ----------
    search, found : as of `spreads`.
    seen : signals per row.
    """
    orders = {"along speed": seen.get("v_x"), "along longitudinal acceleration": seen.get("a_x"),
              "along time": np.arange(len(found.e), dtype=float)}  # fmt: skip
    if "a_y" in seen:
        orders["along lateral acceleration"] = np.abs(seen["a_y"])
    known = {name: own for name, own in orders.items() if own is not None}
    result = {}
    for k, name in enumerate(found.names):
        told = [own for own in spreads(search, found, known, k) if own.p_value < CAL.surely_varies]
        if told:
            result[name] = max(told, key=lambda own: own.relative)
    return result


def _thirds(values: Array, informs: Array) -> NDArray[np.int_]:
    """(N,) the part of each row: by value, of equal information."""
    order = np.argsort(values, kind="stable")
    filled = np.cumsum(informs[order])
    part = np.empty(len(order), dtype=int)
    part[order] = np.minimum((CAL.parts * filled / max(filled[-1], 1e-300)).astype(int), CAL.parts - 1)
    return part
