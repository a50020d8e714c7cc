"""How commands run between rows, where no column map states it: as the recordings are explained better.

With the wrong assumption every command is half a row late or early. Late commands look like a delay, which may be a
cause; no cause makes them early.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from math import inf

from ...datasets.recording import Recording
from ...fitting.holding import SHORTEST, WORDS, other_than, with_hold
from .bench import Bench
from .calibration import CAL
from .hypothesis import Hypothesis
from .preparing import Prepared
from .refit import refit
from .search import Search


def otherwise(recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings with the other hold of commands wherever it is not stated."""
    return [item if item.hold_stated else with_hold(item, other_than(item.hold)) for item in recordings]


def restated(given: Sequence[Recording], taken: Sequence[Recording]) -> tuple[str, ...]:
    """Of each recording that was examined with another hold than it was read with, a sentence that says so."""
    return tuple(
        f"{one.name}: its column map does not say how commands run between rows. They are taken as "
        f'{WORDS[other.hold]}, which explains the recording better. If that is right, state hold = "{other.hold}".'
        for one, other in zip(given, taken, strict=True)
        if one.hold != other.hold
    )


def explained_otherwise(search: Search, best: Hypothesis, prepared: Prepared, recordings: Sequence[Recording]) -> bool:
    """Whether the best hypothesis explains recordings better with the other hold of their commands.

    Parameters
    ----------
    search, best : what refitted the hypothesis, on these recordings.
    prepared : what is diagnosed.
    recordings : as they were examined.
    """
    unstated = any(not item.hold_stated and item.sample_time >= SHORTEST for item in recordings)
    if not isinstance(search.bench, Bench) or not unstated or not search.bench.model.commands:
        return False
    other = copy(search)
    other.bench = prepared.bench(otherwise(recordings))
    cost = _cost(other, best)
    if not cost < best.cost - CAL.otherwise:
        return False
    return cost < _cost(search, best) - CAL.otherwise  # the search may have ended a little early, too


def _cost(search: Search, best: Hypothesis) -> float:
    """The least cost near a hypothesis."""
    near = copy(search)
    near.nominal, near.expanded = search.nominal.copy(), search.expanded.copy()
    near.about(best)
    again = refit(near, [replace(near.start_of(best), slopes=None)])
    return again[0].cost if again else inf
