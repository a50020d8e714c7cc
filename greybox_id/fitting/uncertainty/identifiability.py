"""Identifiability: weakly identifiable parameters, correlated pairs, and directions that a recording leaves open.

A covariance is examined in relative coordinates, in which a parameter changes by shares of its size; there, an open
direction reads as a sentence: mass and both cornering stiffnesses can grow by a third together, and hardly any residual
changes.

Sources: Belsley, Kuh & Welsch, Regression diagnostics (1980), chapter 3, condition numbers of scaled matrices; Brun,
Reichert & Kuensch, Practical identifiability analysis of large environmental simulation models, Water Resources
Research 37 (2001).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.numbers import signed, with_unit
from ...base.shorthands import Array
from ...models.parameter import free_places
from ..fit import Fit

HALF = 0.5
"""Relative standard deviation above which hardly more than the sign is determined."""
NO_NEWS = 0.7
"""Standard deviation, as a share of the prior's, above which the recording added little."""
TOGETHER = 0.95
"""Correlation above which two parameters are identifiable only in combination."""
NAMED, LEAST_NAMED = 4, 0.25
"""Largest number of parameters named of an open direction, and their least change relative to the largest one."""


@dataclass(frozen=True)
class CorrelatedPair:
    """Two highly correlated parameters."""

    first: str
    second: str
    correlation: float

    def about(self) -> str:
        """The pair in a plain sentence."""
        combined = "sum" if self.correlation < 0 else "difference"
        return (
            f"{self.first} and {self.second} are identifiable only in combination, as a weighted {combined} "
            f"(correlation {signed(self.correlation)})."
        )


@dataclass(frozen=True)
class Direction:
    """Parameters that can change together with hardly any change of the residuals.

    Attributes
    ----------
    names : parameters that change most, in descending order.
    moves : change of each by one standard deviation along the direction, as a share of its size.
    changes : the same in each one's unit, as text, for parameters with estimates near zero, for which per cent would
        mean nothing. None for the others.
    """

    names: tuple[str, ...]
    moves: tuple[float, ...]
    changes: tuple[str | None, ...]

    def about(self) -> str:
        """The direction in a plain sentence."""
        moves = [
            f"{name} by {f'{signed(100 * move, 2)} %' if change is None else change}"
            for name, move, change in zip(self.names, self.moves, self.changes, strict=True)
        ]
        listed = moves[0] if len(moves) == 1 else ", ".join(moves[:-1]) + " and " + moves[-1]
        one = "This change (one standard deviation) hardly alters"
        several = "These changes together (one standard deviation) hardly alter"
        return f"{one if len(moves) == 1 else several} the residuals: {listed}."


@dataclass(frozen=True)
class Identifiability:
    """Parameters that a recording does not determine.

    Attributes
    ----------
    undetermined : names of weakly identifiable parameters, the worst first: their standard deviations are large, or
        hardly less than their priors'.
    pairs : highly correlated pairs, the strongest correlation first.
    directions : open directions, the widest first; orthogonal in relative coordinates.
    """

    undetermined: tuple[str, ...]
    pairs: tuple[CorrelatedPair, ...]
    directions: tuple[Direction, ...]


def identifiability(
    names: Sequence[str],
    x: Array,
    covariance: Array,
    prior_sd: Array | None = None,
    units: Sequence[str] | None = None,
) -> Identifiability:
    """Find the parameters, pairs and directions that a recording leaves open.

    Parameters
    ----------
    names : names of the parameters.
    x : (parameters,) estimates.
    covariance : (parameters, parameters) of the estimates; fixed ones or those at a bound have zero rows and are
        dropped.
    prior_sd : (parameters,) prior standard deviations, infinite for none; a parameter whose prior includes zero (an
        offset) is compared with its prior alone.
    units : units of the parameters; None if they have none.

    A relative standard deviation is relative to the larger of the estimate and the prior's standard deviation.
    """
    variance, units = np.diag(covariance), ["1"] * len(x) if units is None else units
    prior_sd = np.full(len(x), np.inf) if prior_sd is None else np.asarray(prior_sd, dtype=float)
    size = np.maximum(np.abs(x), np.where(np.isfinite(prior_sd), prior_sd, 0.0))
    about_zero = np.isfinite(prior_sd) & (np.abs(x) < prior_sd)
    sd = np.sqrt(np.maximum(variance, 0.0))
    relative = np.divide(sd, size, out=np.where(sd > 0.0, np.inf, 0.0), where=(size > 0.0) & np.isfinite(sd))
    open_ = np.flatnonzero(((relative > HALF) & ~about_zero) | (sd > NO_NEWS * prior_sd) | np.isinf(sd))
    inner = np.flatnonzero((variance > 0.0) & np.isfinite(variance))
    C = covariance[np.ix_(inner, inner)]
    correlation = C / np.outer(sd[inner], sd[inner])
    scaled = np.flatnonzero(size[inner] > 0.0)
    unit = size[inner][scaled]
    return Identifiability(
        tuple(names[int(k)] for k in open_[np.argsort(-relative[open_], kind="stable")]),
        _pairs([names[int(k)] for k in inner], correlation),
        _directions(
            [names[int(k)] for k in inner[scaled]],
            C[np.ix_(scaled, scaled)] / np.outer(unit, unit),
            unit,
            np.abs(x[inner][scaled]),
            [units[int(k)] for k in inner[scaled]],
        ),
    )


def _pairs(names: Sequence[str], correlation: Array) -> tuple[CorrelatedPair, ...]:
    first, second = np.nonzero(np.triu(np.abs(correlation) > TOGETHER, 1))
    order = np.argsort(-np.abs(correlation[first, second]), kind="stable")
    return tuple(
        CorrelatedPair(names[i], names[j], float(correlation[i, j]))
        for i, j in zip(first[order], second[order], strict=True)
    )


def _directions(
    names: Sequence[str], relative: Array, size: Array, estimate: Array, units: Sequence[str]
) -> tuple[Direction, ...]:
    """Eigenvectors with large eigenvalues of a covariance in relative coordinates; `estimate`: absolute values."""
    variances, vectors = np.linalg.eigh(relative)
    result = []
    for variance, vector in zip(variances[::-1], vectors.T[::-1], strict=True):
        spread = float(np.sqrt(max(variance, 0.0)))
        if spread <= HALF:
            break
        order = np.argsort(-np.abs(vector), kind="stable")[:NAMED]
        order = order[np.abs(vector[order]) >= LEAST_NAMED * np.abs(vector[order[0]])]
        moves = spread * vector[order] * np.sign(vector[order[0]])
        changes = [
            with_unit(signed(move * size[k], 2), units[k]) if max(abs(move), 1.0) * size[k] > estimate[k] else None
            for k, move in zip(order, moves, strict=True)
        ]
        result.append(Direction(tuple(names[k] for k in order), tuple(float(m) for m in moves), tuple(changes)))
    return tuple(result)


def left_open(fit: Fit) -> Identifiability | None:
    """Parameters weakly identifiable, or only in combination; None if the fit's covariance was not kept."""
    if fit.covariance is None:
        return None
    free = free_places(fit.model.parameters)
    places, parameters = [*free.values()], [fit.model[name] for name in free]
    x = np.array([float(p.array) for p in parameters])
    prior_sd = np.array([np.inf if p.prior is None else float(np.asarray(p.prior.sd)) for p in parameters])
    inside = fit.covariance[np.ix_(places, places)]
    return identifiability([*free], x, inside, prior_sd=prior_sd, units=[p.unit for p in parameters])


def combination_sentences(fit: Fit) -> list[str]:
    """Sentences on parameters identifiable only in combination; single ones have notes of their own."""
    identifiability = left_open(fit)
    if identifiability is None:
        return []
    directions = [each for each in identifiability.directions if len(each.names) > 1]
    return [*(each.about() for each in identifiability.pairs), *(each.about() for each in directions)]


def absent(fit: Fit) -> dict[str, str]:
    """Effects whose interval contains their null, with a note."""
    result = {}
    for name in fit.model.effects:
        low, high = fit.interval(name)
        null = fit.model[name].null
        if null is not None and low <= null <= high:
            result[name] = f"may be absent: the interval holds {null:g}"
    return result
