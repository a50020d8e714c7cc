"""Is a magnitude the same everywhere? A true cause's is; a mimic's varies with speed, load, time or channel.

The magnitude in a part of the recording is estimated with all else refitted to first order, tolerances among it: what
these absorb differs from part to part, and is no spread of the magnitude.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from ...base.shorthands import Array
from .calibration import CAL
from .hypothesis import Hypothesis
from .search import Search

BETWEEN_CHANNELS = "between channels"


@dataclass(frozen=True)
class Spread:
    """How a magnitude differs between parts of a recording.

    Attributes
    ----------
    place : between which parts, in words: along a signal, or between channels.
    relative : weighted standard deviation of the parts' magnitudes over the magnitude, in excess of noise.
    p_value : how often so much would come from noise.
    parts : coordinate of the magnitude in each part, from low to high; NaN where a part does not inform it.
    """

    place: str
    relative: float
    p_value: float
    parts: tuple[float, ...]


InParts = Callable[[Array], tuple[Array, Array]]
"""(N, K) or (channels, K), one where rows or channels belong to one of K parts -> Hessian and gradient by a coordinate
in these parts, all else refitted to first order."""


def _alone(search: Search, hypothesis: Hypothesis, at: int) -> tuple[Array, InParts] | None:
    """How much each row, (N,), informs one coordinate of a hypothesis, and its derivatives in parts.

    None where the recording does not inform it.
    """
    shape = hypothesis.e.shape
    both = search.weighed(np.concatenate([hypothesis.e[:, :, None], hypothesis.J], axis=2))
    both = both.reshape(hypothesis.e.size, -1)
    r, J = both[:, 0], both[:, 1:]
    u = np.concatenate([hypothesis.theta, hypothesis.linear])
    g = search.white.T @ r + search.precision @ (u - search.means)
    stays = ((u <= search.low) & (g > 0)) | ((u >= search.high) & (g < 0))
    stays |= search.among({axis.index for axis in hypothesis.axes})
    others = np.arange(J.shape[1]) != at
    moves = np.concatenate([~stays, others])  # all else, nuisances first
    gram = J.T @ J
    beside = search.white.T @ J
    H = np.block([[search.gram + search.precision, beside], [beside.T, gram]])[np.ix_(moves, moves)]
    scale = 1 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    inverse = np.linalg.pinv(H * np.outer(scale, scale), hermitian=True) * np.outer(scale, scale)
    does, alike = J[:, at].reshape(shape), np.concatenate([beside[:, at], gram[:, at]])[moves]
    undone = np.zeros(len(moves))
    undone[moves] = inverse @ alike
    known = float(gram[at, at] - alike @ undone[moves])
    if not known > CAL.ridge * float(gram[at, at]):
        return None
    cancelled = (search.white @ undone[: len(u)] + J @ undone[len(u) :]).reshape(shape)  # by all else
    pulls, slope = does * r.reshape(shape), np.concatenate([g, J.T @ r])[moves]
    by_row, by_channel = zip(*(_products(does, item.reshape(*shape, -1)) for item in (search.white, J)), strict=True)
    rows, channels = (np.concatenate(each, axis=1)[:, moves] for each in (by_row, by_channel))

    def in_parts(part: Array) -> tuple[Array, Array]:
        axis = 1 if len(part) == len(does) else 0
        cross = (rows if axis else channels).T @ part
        undone = inverse @ cross
        H = np.diag(np.sum(does**2, axis=axis) @ part) - cross.T @ undone
        return H, np.sum(pulls, axis=axis) @ part - undone.T @ slope

    return np.sum((does - cancelled) ** 2, axis=1), in_parts


def _products(one: Array, many: Array) -> tuple[Array, Array]:
    """(N, n), (channels, n) of (N, channels) times (N, channels, n), summed over channels and over rows."""
    over_rows = np.array([many[:, c].T @ one[:, c] for c in range(one.shape[1])])
    return np.asarray((one[:, None, :] @ many)[:, 0]), over_rows


def spreads(search: Search, hypothesis: Hypothesis, orders: Mapping[str, Array], effect: int = 0) -> list[Spread]:
    """Magnitudes of one of a hypothesis' effects in thirds of the rows in several orders, and by channel."""
    at = hypothesis.parts[effect][1].start
    alone = _alone(search, hypothesis, at)
    if alone is None:
        return []
    informs, in_parts = alone
    cuts = {place: np.eye(CAL.parts)[_thirds(values, informs)] for place, values in orders.items()}
    here = acts_on(search, hypothesis, effect)  # errors of other channels say nothing about a sensor
    cuts[BETWEEN_CHANNELS] = np.eye(len(here))[:, here]
    m, null = float(hypothesis.m[at]), hypothesis.axes[at].null
    return [_spread(place, m, null, *in_parts(part)) for place, part in cuts.items()]


def acts_on(search: Search, hypothesis: Hypothesis, effect: int) -> NDArray[np.bool_]:
    """(channels,) whether one of a hypothesis' effects acts on a channel by a notable share of its whole action.

    An effect on a sensor acts on other channels through starts of runs that follow its readings: that does not count.
    """
    candidate, at = hypothesis.parts[effect]
    if candidate.reads:
        return np.array([channel in candidate.reads for channel in search.bench.channels])
    does = np.sum((hypothesis.J[:, :, at.start] / search.whitener.stationary_sd) ** 2, axis=0)
    return np.asarray(does > CAL.acts**2 * np.sum(does))


def _spread(place: str, m: float, null: float, H: Array, g: Array) -> Spread:
    """The spread of a magnitude m with these derivatives in parts."""
    weight = np.diag(H)
    known = weight > CAL.part_least * float(np.sum(weight))
    count = int(np.sum(known))
    offs = np.full(len(known), np.nan)
    relative, p = 0.0, 1.0
    if count:
        curve, pull = H[np.ix_(known, known)], g[known]
        offs[known] = -np.linalg.solve(curve + CAL.ridge * np.diag(np.diag(curve)), pull)
    if count > 1:
        Q = max(float(-pull @ offs[known]) - float(np.sum(pull)) ** 2 / max(float(np.sum(curve)), 1e-300), 0.0)
        ratio = Q / (count - 1)  # one on average where a magnitude is constant
        p = float(chdtrc(count - 1, Q))
        mean = float(np.average(offs[known], weights=weight[known]))
        variance = float(np.average((offs[known] - mean) ** 2, weights=weight[known]))
        relative = float(np.sqrt(variance * max(1 - 1 / max(ratio, 1e-300), 0.0))) / (abs(m - null) + 1e-300)
    return Spread(place, relative, p, tuple(float(m + off) for off in offs))


def orders_of(seen: Mapping[str, Array], rows: int) -> dict[str, Array]:
    """Values by which rows are sorted: "along ..." -> (N,)."""
    result = {
        "along time": np.arange(rows, dtype=float),
        "along speed": seen.get("v_x"),
        "along longitudinal acceleration": seen.get("a_x"),
        "along lateral acceleration": None if "a_y" not in seen else np.abs(seen["a_y"]),
        "from right to left": seen.get("a_y"),
        "along steering": seen.get("steer"),
        "along yaw rate": seen.get("yaw_rate"),
    }
    return {place: values for place, values in result.items() if values is not None}


def unsteadiness(search: Search, hypothesis: Hypothesis, orders: Mapping[str, Array], effect: int = 0) -> float:
    """Variance of a magnitude's mean over its square if parts of a drive are draws about it: tau^2 / K over m^2.

    Model-form errors move a magnitude differently in each part of a drive, and the mean of K parts that scatter by tau
    has a variance of tau^2 / K beside that of noise and tolerances (random effects, DerSimonian & Laird, Control. Clin.
    Trials 7, 1986). The largest over all ways to part the drive counts.
    """
    each = (
        min(spread.relative, 1e6) ** 2 / int(np.sum(np.isfinite(spread.parts)))  # at its null a size has no scale
        for spread in spreads(search, hypothesis, orders, effect)
        if np.any(np.isfinite(spread.parts))
    )
    return max(each, default=0.0)


def discounted(gain: Array | float, unsteady: Array | float) -> Array:
    """The gain of an effect, in nats, given its unsteadiness: half of m^2 over the sum of both variances."""
    finite = np.clip(gain, 0.0, 1e12)  # where a refit without it leaves the range of numbers, a gain is infinite
    return np.asarray(finite / (1.0 + 2.0 * finite * np.minimum(unsteady, 1e12)))


def varies(search: Search, hypothesis: Hypothesis, seen: Mapping[str, Array]) -> dict[str, Spread]:
    """Effect -> its largest spread along an order or between channels, of those that noise does not explain."""
    orders = orders_of(seen, len(hypothesis.e))
    result = {}
    for k, name in enumerate(hypothesis.names):
        known = [spread for spread in spreads(search, hypothesis, orders, k) if spread.p_value < CAL.surely_varies]
        if known:
            result[name] = max(known, key=lambda item: item.relative)
    return result


def _thirds(values: Array, informs: Array) -> NDArray[np.int_]:
    """(N,) index of each row's part: rows sorted by value, parts of equal information."""
    order = np.argsort(values, kind="stable")
    filled = np.cumsum(informs[order])
    part = np.empty(len(order), dtype=int)
    part[order] = np.minimum((CAL.parts * filled / max(filled[-1], 1e-300)).astype(int), CAL.parts - 1)
    return part
