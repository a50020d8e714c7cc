"""Hypotheses of a diagnosis, and starts from which they are refitted."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...base.shorthands import Array
from .axes import Axis, Candidate
from .calibration import CAL


@dataclass(frozen=True)
class Hypothesis:
    """Some candidates at the magnitudes that explain the recordings best.

    Attributes
    ----------
    candidates : those that are present.
    m : (m,) their coordinates, in the order of their axes.
    theta : coordinates of the nuisances that move nonlinearly.
    linear : coordinates of those that enter to first order.
    cost : negative log posterior density, up to a constant.
    e : (N, channels) residuals, prediction minus reading.
    J : (N, channels, m) their derivative by m.
    """

    candidates: tuple[Candidate, ...]
    m: Array
    theta: Array
    linear: Array
    cost: float
    e: Array
    J: Array

    @property
    def names(self) -> tuple[str, ...]:
        """The candidates' effects."""
        return tuple(candidate.effect for candidate in self.candidates)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Axes of all candidates."""
        return tuple(axis for candidate in self.candidates for axis in candidate.axes)

    @property
    def parts(self) -> list[tuple[Candidate, slice]]:
        """Candidates, each with the places of its coordinates."""
        return parts_of(self.candidates)

    def main(self, effect: str) -> tuple[Axis, int]:
        """The axis of an effect's magnitude, and the place of its coordinate."""
        return next((item.axes[0], at.start) for item, at in self.parts if item.effect == effect)

    @property
    def at_bounds(self) -> frozenset[str]:
        """Effects whose magnitudes are at a bound: symptoms of other causes, no estimates."""
        near = ((item, item.axes[0], self.m[at.start]) for item, at in self.parts)
        return frozenset(
            item.effect
            for item, axis, m in near
            if min(abs(m - axis.low), abs(m - axis.high)) < CAL.at_bound * axis.scale
        )

    def only(self, effects: Collection[str]) -> Hypothesis:
        """Some of its effects at their present coordinates; the cost is not known yet."""
        places = [k for item, at in self.parts if item.effect in effects for k in range(at.start, at.stop)]
        candidates = tuple(candidate for candidate in self.candidates if candidate.effect in effects)
        return replace(self, candidates=candidates, m=self.m[places], J=self.J[:, :, places], cost=np.inf)


def parts_of(candidates: Sequence[Candidate]) -> list[tuple[Candidate, slice]]:
    """Candidates, each with the places of its coordinates among those of all."""
    ends = np.cumsum([0, *(len(candidate.axes) for candidate in candidates)]).tolist()
    return [(candidate, slice(a, b)) for candidate, a, b in zip(candidates, ends[:-1], ends[1:], strict=True)]


def by_cost(hypothesis: Hypothesis) -> float:
    """Key by which hypotheses are sorted, best first."""
    return hypothesis.cost


@dataclass(frozen=True)
class Start:
    """Where a refit begins.

    Attributes
    ----------
    candidates : of the hypothesis.
    m, theta, linear : coordinates.
    origin : a hypothesis without the last candidate, and the coordinates at which the whole one equals it: a start that
        explains less is drawn back towards it. None: no such hypothesis is known.
    slopes : (N, channels, k) derivatives of residuals by the first k coordinates, taken nearby; zero where not known.
    """

    candidates: tuple[Candidate, ...]
    m: Array
    theta: Array
    linear: Array
    origin: tuple[Hypothesis, Array] | None = None
    slopes: Array | None = None
