"""Does a parameter vary in time that equations hold constant: bank of the road, offset of the steering, grip?

A magnitude theta(t) = theta + sigma xi(t) beside the unknown forces, xi a first-order Gauss-Markov process of unit
variance like theirs. It moves the vehicle as the effect does: both axles at once, or the front one alone; that
distinguishes it from independent unknown forces. Source: Kristensen, Madsen & Jorgensen, Automatica 40, 2004, where
diffusion in a parameter's equation shows that the parameter is not constant.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ...base.shorthands import Array
from .axes import Axis
from .bench import Bench
from .calibration import CAL
from .model_error import (
    AmplitudePrior,
    Amplitudes,
    ForceSizes,
    Linearised,
    Processes,
    linearised,
    negative_log_likelihood,
    tuned_on,
)


@dataclass(frozen=True)
class Wander:
    """An effect whose magnitude varies all the time.

    Attributes
    ----------
    effect, unit : of the magnitude.
    sd : standard deviation of its variation.
    correlation_time : s, of its variation.
    gain : log-likelihood over the best constant magnitude, beside unknown forces of their usual size.
    """

    effect: str
    unit: str
    sd: float
    correlation_time: float
    gain: float


def wandering(
    bench: Bench,
    p: Array,
    residuals: Array,
    usable: NDArray[np.bool_],
    one: Amplitudes,
    prior: AmplitudePrior,
    noise: Array,
    requested: Sequence[tuple[str, Axis]],
) -> tuple[Wander, ...]:
    """Effects whose varying magnitudes would replace unknown forces: the likeliest, and those about as likely.

    Beside such an effect, unknown forces have their usual size, and it explains as much as larger ones do, or more.

    Parameters
    ----------
    bench : of a model with unknown forces.
    p : (parameters,) of the explanation that left the residuals.
    residuals : (N, channels).
    usable : (N, channels).
    one : amplitudes of model error beside it.
    prior : of these.
    noise : (channels,) standard deviations of the readings at which runs start.
    requested : effects with the axes of their magnitudes, which act at once and gradually.
    """
    sizes = ForceSizes(bench)
    about = tuned_on(linearised(bench, p, noise, sizes, [axis.index for _, axis in requested]), usable)
    forces = len(sizes.forces)
    r = np.ascontiguousarray(residuals[about.row, about.channel])
    quiet = quietened(one, prior.median)
    loud, still = _costs(about, r, prior, [(one, 0.0, 1.0), (quiet, 0.0, 1.0)], forces, None)
    units = [abs(axis.value(axis.null + axis.scale) - axis.value(axis.null)) for _, axis in requested]

    def best(lanes: Iterator[Lane], k: int) -> tuple[float, Lane]:
        return _best(about, r, prior, lanes, forces, forces + k)

    firsts = [best(_everywhere(quiet, unit, CAL.wander_memories), k) for k, unit in enumerate(units)]
    least = min((cost for cost, _ in firsts), default=still)
    by_chance = float(np.log(max(len(requested), 1) / CAL.rare))  # twice such a gain is chi-square of two
    needed = max(by_chance, float(still - loud) - CAL.alike)
    wanders = list[tuple[float, Wander]]()
    for k, ((name, axis), (cost, lane)) in enumerate(zip(requested, firsts, strict=True)):
        if cost > least + CAL.cost or still - cost < CAL.promising * needed:
            continue
        cost, (_, sd, memory) = best(_about(*lane), k)
        if still - cost < needed:
            continue
        _, staying = best(_everywhere(quiet, units[k], (np.inf,)), k)
        stays, _ = best(_about(*staying), k)
        if stays - cost > by_chance:
            wanders.append((cost, Wander(name, axis.unit, sd, memory, min(still, stays) - cost)))
    wanders.sort(key=lambda item: item[0])
    return tuple(item for cost, item in wanders if cost < wanders[0][0] + CAL.alike)


def quietened(one: Amplitudes, usual: Amplitudes) -> Amplitudes:
    """Amplitudes with unknown forces no larger than usual."""
    return replace(
        one, floor_y=min(one.floor_y, usual.floor_y), share_y=min(one.share_y, usual.share_y),
        floor_x=min(one.floor_x, usual.floor_x), share_x=min(one.share_x, usual.share_x), memory_y=usual.memory_y,
        memory_x=usual.memory_x,
    )  # fmt: skip


Lane = tuple[Amplitudes, float, float]
"""Amplitudes of model error; sd and correlation time of the magnitude."""


def _everywhere(amplitudes: Amplitudes, unit: float, memories: Sequence[float]) -> Iterator[Lane]:
    for share, memory in product(CAL.wander_shares, memories):
        yield amplitudes, share * unit, memory


def _about(amplitudes: Amplitudes, sd: float, memory: float) -> Iterator[Lane]:
    for a, b in product(CAL.wander_nearby, CAL.wander_soon if np.isfinite(memory) else (1.0,)):
        yield amplitudes, a * sd, b * memory


def _best(
    about: Linearised, r: Array, prior: AmplitudePrior, tried: Iterator[Lane], forces: int, column: int
) -> tuple[float, Lane]:
    """Least cost over some lanes, and the lane that has it."""
    lanes = list(tried)
    cost = _costs(about, r, prior, lanes, forces, column)
    return float(np.min(cost)), lanes[int(np.argmin(cost))]


def _costs(
    about: Linearised, r: Array, prior: AmplitudePrior, lanes: Sequence[Lane], forces: int, column: int | None
) -> Array:
    """(lanes,) negative log-likelihood, plus the cost of the amplitudes by their prior."""
    chosen = [*range(forces), *([] if column is None else [column])]
    one = replace(about, B=np.ascontiguousarray(about.B[..., chosen]), D=np.ascontiguousarray(about.D[..., chosen]))
    amplitudes, sds, memories = zip(*lanes, strict=True)
    more = None
    if column is not None:
        shape = (len(one.length), 1, len(lanes))
        correlation = np.exp(-one.length[:, None, None] / np.array(memories))
        more = Processes(np.broadcast_to(np.array(sds), shape), correlation)
    nll = negative_log_likelihood(one, amplitudes, r, more)
    cost = nll + prior.cost(np.vstack([each.logarithms for each in amplitudes]))
    return np.where(np.isfinite(cost), cost, np.inf)  # derivatives overflow where the vehicle nearly spins
