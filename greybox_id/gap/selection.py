"""Forward selection: single effects first, then pairs about the best of them, then a third.

Twice: first with white noise of the stated size, which finds an explanation; then with the noise that is left once that
explanation is in the model. Noise estimated before would contain the effect and hide it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..parameter import Array
from .axes import Candidate
from .colour import colour
from .search import Hypothesis, Search, Start
from .shortlist import Promise, Prospects, from_where_best, promises

SINGLES, PAIRS, PARTNERS, TRIPLES = 4, 3, 4, 3
"""Refitted: so many singles that promise to be good, and as many new ones once noise is known; pairs of so many of the
best with so many partners each; so many triples of the best pair."""
ROUGH = 8
"""Singles refitted while the noise is not known yet."""
WORTH = 8.0
"""A further effect is looked for where it promises to gain this much log-likelihood."""


@dataclass(frozen=True)
class Selection:
    """Hypotheses refitted on the same noise.

    Attributes
    ----------
    search : what refitted them.
    base : nothing but nuisances.
    tried : single effects, pairs and triples, best first.
    promised : of every single candidate beside the base.
    """

    search: Search
    base: Hypothesis
    tried: tuple[Hypothesis, ...]
    promised: tuple[Promise, ...]

    def of(self, size: int) -> list[Hypothesis]:
        """Hypotheses of so many effects, best first."""
        return [own for own in self.tried if len(own.candidates) == size]


def select(search: Search, candidates: Sequence[Candidate], good: Array) -> Selection:
    """Refit what may explain the recording.

    Parameters
    ----------
    search : with white noise of the stated size.
    candidates : what may be the cause.
    good : (N, channels) readings that count.
    """
    search.about(None)
    base = refitted(search, search.at_means())
    prospects = Prospects(search, base, candidates)
    promised = prospects.promises(base)
    rough = _with_each(search, base, promised[:ROUGH])
    best = min([base, *rough], key=lambda own: own.cost)
    likely = from_where_best(promised)
    more = _with_each(search, best, promises(search, best, likely)[:2]) if best.candidates else []
    best = min([best, *more], key=lambda own: own.cost)
    search.recoloured(colour(best.e, good, search.bench.rows))
    search.about(best)
    base = refitted(search, base)
    promised = prospects.promises(base)
    likely = from_where_best(promised)
    known = {own.names[0]: own for own in rough}
    singles = [refitted(search, own) for own in rough[:SINGLES]]
    singles += _with_each(search, base, [own for own in promised if own.candidate.effect not in known][:SINGLES])
    singles.sort(key=lambda own: own.cost)
    tried = {frozenset(own.names): own for own in singles}
    if len(best.candidates) == 2:
        tried[frozenset(best.names)] = refitted(search, best)
    for parent in singles[:PAIRS]:
        worth = [own for own in promises(search, parent, likely)[:PARTNERS] if own.gain > WORTH]
        if not worth:  # one effect explains what there is
            break
        new = [own for own in worth if frozenset((*parent.names, own.candidate.effect)) not in tried]
        tried |= {frozenset(own.names): own for own in _with_each(search, parent, new)}
    pairs = sorted((own for own in tried.values() if len(own.candidates) == 2), key=lambda own: own.cost)
    if pairs and singles[0].cost - pairs[0].cost > WORTH:
        worth = [own for own in promises(search, pairs[0], likely)[:TRIPLES] if own.gain > WORTH]
        tried |= {frozenset(own.names): own for own in _with_each(search, pairs[0], worth)}
    return Selection(search, base, tuple(sorted(tried.values(), key=lambda own: own.cost)), tuple(promised))


def refitted(search: Search, again: Hypothesis) -> Hypothesis:
    """A hypothesis, from where it stood."""
    found = search.refit([search.start_of(again)])
    return found[0] if found else again


def _with_each(search: Search, parent: Hypothesis, promised: Sequence[Promise]) -> list[Hypothesis]:
    """The parent with one more effect, for each of those that promise something; best first."""
    starts = []
    for own in promised:
        candidate, m = own.candidate, np.append(parent.m, own.start)
        null = np.append(parent.m, [candidate.axes[0].null, *own.start[1:]])
        way_back = (parent, null) if candidate.gradual else None
        starts.append(Start((*parent.candidates, candidate), m, parent.theta, parent.linear, way_back))
    return sorted(search.refit(starts), key=lambda own: own.cost)
