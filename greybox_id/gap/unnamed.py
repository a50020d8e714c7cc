"""What model error, nuisances and noise are left beside the named effects: is something without a name at work?"""

from __future__ import annotations

import numpy as np

from ..estimation.hypothesis import Hypothesis
from ..estimation.model_error import Amplitudes
from ..estimation.search import Search
from .gap import Unnamed


def unnamed(search: Search, best: Hypothesis, found: Amplitudes, median: Amplitudes) -> Unnamed:
    """Collect it."""
    off = np.concatenate([best.theta, best.linear]) - search.means
    own = search.beliefs({axis.index for axis in best.axes})
    each = np.sqrt(np.maximum(np.diag(own), 0.0)) * np.abs(off)
    names = [axis.name for axis in (*search.moving, *search.shifts, *search.shifts)]
    k = int(np.argmax(each[: len(names)])) if names else -1
    total = np.hypot(found.noise, found.colour) / np.hypot(median.noise, median.colour)
    return Unnamed(
        found.share_y, found.share_x, found.floor_y, found.floor_x, found.memory_y, found.memory_x,
        float(off @ own @ off), (names[k], float(each[k])) if names else ("", 0.0),
        {c: float(v) for c, v in zip(search.bench.channels, total, strict=True)}, search.expected_charge(best),
    )  # fmt: skip
