"""Errors of two models at the same rows, and an interval of what they differ by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..parameter import Array
from ..recording import Recording
from ..scores.metrics import Prediction
from ..statistics import correlation_time, resampled

DRAWS = 2000
"""Of blocks, with replacement, for each interval."""
LEAST_SECONDS, TIMES = 1.0, 4.0
"""A block lasts so long at least, and so many correlation times of the difference."""
LEAST_BLOCKS = 6
"""Fewer blocks tell no interval."""

Judged = Mapping[str, tuple[tuple[Recording, tuple[str, ...], Prediction], ...]]
"""Protocol -> (recording, outputs, predictions) of each recording."""


@dataclass(frozen=True)
class Paired:
    """Errors of two fits at the same rows.

    Attributes
    ----------
    first, second : RMSE in the output's unit.
    low, high : 95 % interval of second less first, from blocks drawn in pairs; NaN where there are too few.
    seconds : length of a block.
    blocks : how many.
    """

    first: float
    second: float
    low: float
    high: float
    seconds: float
    blocks: int

    @property
    def told(self) -> bool:
        """Whether the interval leaves out zero."""
        return bool(np.isfinite(self.low) and (self.low > 0 or self.high < 0))


def paired(first: Array, second: Array, run: Array, sample_time: float) -> Paired:
    """Errors of two models at the same rows, and an interval of what their RMSE differ by.

    Parameters
    ----------
    first, second : (n,) errors.
    run : (n,) number of the unbroken run of each.
    sample_time : s.
    """
    one, other = first**2, second**2
    off = other - one - np.mean(other - one)
    length = max(round(LEAST_SECONDS / sample_time), round(TIMES * correlation_time(off[:, None])), 1)
    blocks: list[tuple[float, float, int]] = []
    for number_ in np.unique(run):
        rows = np.flatnonzero(run == number_)
        count = max(1, len(rows) // length)
        blocks += [
            (float(one[part].sum()), float(other[part].sum()), len(part)) for part in np.array_split(rows, count)
        ]
    low, high = resampled(np.array(blocks), _difference, DRAWS) if len(blocks) >= LEAST_BLOCKS else (np.nan, np.nan)
    return Paired(
        float(np.sqrt(one.mean())), float(np.sqrt(other.mean())), float(low), float(high), length * sample_time,
        len(blocks),
    )  # fmt: skip


def _difference(sums: Array) -> float:
    """By how much two RMSE differ, of sums of squares and their count."""
    return float(np.diff(np.sqrt(sums[:2] / sums[2]))[0])


def pairs_of(first: Judged, second: Judged) -> dict[tuple[str, str], Paired]:
    """(output, protocol) -> errors of both, where both predict it."""
    found = {}
    for protocol in (name for name in first if name in second and name != "published"):
        outputs = dict.fromkeys(name for _, names, _ in first[protocol] for name in names)
        for output in outputs:
            parts = [
                _together(output, one, other)
                for one, other in zip(first[protocol], second[protocol], strict=True)
                if output in one[1] and output in other[1]
            ]
            parts = [part for part in parts if len(part[0])]
            if parts:
                runs = np.concatenate([part[2] + 1000 * k for k, part in enumerate(parts)])
                own, others = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
                found[output, protocol] = paired(own, others, runs, first[protocol][0][0].sample_time)
    return found


def _together(
    output: str,
    one: tuple[Recording, tuple[str, ...], Prediction],
    other: tuple[Recording, tuple[str, ...], Prediction],
) -> tuple[Array, Array, Array]:
    """Errors of both at the rows that both predict, and the rows' runs."""
    errors = []
    for _, outputs, found in (one, other):
        k = outputs.index(output)
        errors.append((found.rows, found.predicted[:, k] - found.measured[:, k], found.run))
    _, at, also = np.intersect1d(errors[0][0], errors[1][0], return_indices=True)
    first, second, run = errors[0][1][at], errors[1][1][also], errors[0][2][at]
    known = np.isfinite(first) & np.isfinite(second)
    return first[known], second[known], run[known]
