"""Which trajectories are integrated in one call: those that are about as long, for it takes as long as its longest."""

from itertools import combinations

import numpy as np
import pytest

from greybox_id.engine.motion.lanes import WIDTHS, packed


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
