"""Which trajectories are integrated in one call: those that are about as long, for it takes as long as its longest.

Intervals are cut into lanes that are about as long, for the same reason."""

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest

from greybox_id.engine.motion.lanes import WIDTHS, Interval, cut_rows, even_cuts, packed


def cost(lengths, parts):
    """What calls of these parts take."""
    sizes = [own.stop - own.start for own in parts]
    each = [min(cost for width, cost in WIDTHS.items() if width >= size) for size in sizes]
    return sum(own * lengths[part.stop - 1] for own, part in zip(each, parts, strict=True))


def every_way(count):
    """All ways to cut so many trajectories into calls."""
    for k in range(count):
        for cuts in combinations(range(1, count), k):
            edges = [0, *cuts, count]
            parts = [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]
            if all(own.stop - own.start <= max(WIDTHS) for own in parts):
                yield parts


@pytest.mark.parametrize("seed", range(4))
def test_no_way_to_share_calls_takes_less(seed):
    lengths = tuple(sorted(int(own) for own in np.random.default_rng(seed).integers(50, 6000, 10)))
    parts = packed(lengths)
    assert [k for own in parts for k in range(len(lengths))[own]] == list(range(len(lengths)))
    assert cost(lengths, parts) == pytest.approx(min(cost(lengths, own) for own in every_way(len(lengths))))


def test_runs_of_many_simulations_are_integrated_run_by_run():
    lengths = tuple(sorted((2756, 3118, 3233, 6357) * 8))
    assert packed(lengths) == [slice(8 * k, 8 * k + 8) for k in range(4)]
    assert packed(()) == []


def cut(lengths, lanes):
    """How intervals of so many rows are cut, two segments each, and how long their longest lane is."""
    plans = [SimpleNamespace(row_segment=2 * np.arange(own), segments=np.empty((2 * own, 1))) for own in lengths]
    intervals = [Interval(k, 0, own) for k, own in enumerate(lengths)]
    counts, longest = even_cuts(plans, intervals, lanes), 0
    for item, plan, own, count in zip(intervals, plans, lengths, counts, strict=True):
        begin = plan.row_segment[cut_rows(plan, item.start, item.stop, count)]
        longest = max(longest, np.max(np.diff([*begin, 2 * own])))
    return counts, longest


def test_longer_intervals_are_cut_into_more_lanes():
    assert cut([1000], 16)[0] == [16]
    assert cut([500, 500, 500, 500], 16)[0] == [4, 4, 4, 4]
    counts, longest = cut([879, 697, 439, 419], 16)
    assert sum(counts) == 16
    assert longest <= 2 * 176 < 2 * 879 / 4, "four lanes of each would wait for the first"
    assert cut([1000, 3], 16)[0] == [15, 1]
    assert cut([5, 9, 7], 3)[0] == [1, 1, 1]
