"""What a fit leaves open about its parameters."""

from __future__ import annotations

import numpy as np

from ..fit import Fit
from .identifiability import Identifiability, identifiability


def left_open(fit: Fit) -> Identifiability | None:
    """Parameters weakly identifiable, or only in combination; None where its covariance was not kept."""
    if fit.covariance is None:
        return None
    names, x, places, prior_sd, start = [], [], [], [], 0
    for p in fit.model.parameters:
        if p.shape == () and not p.fixed:
            names.append(p.name)
            x.append(float(p.array))
            places.append(start)
            prior_sd.append(np.inf if p.prior is None else float(np.asarray(p.prior.sd)))
        start += p.size
    inside = fit.covariance[np.ix_(places, places)]
    return identifiability(names, np.array(x), inside, prior_sd=np.array(prior_sd))


def told_together(fit: Fit) -> list[str]:
    """Parameters that the recordings tell only together, in sentences; single ones have notes of their own."""
    found = left_open(fit)
    if found is None:
        return []
    directions = [each for each in found.directions if len(each.names) > 1]
    return [*(each.about() for each in found.pairs), *(each.about() for each in directions)]


def absent(fit: Fit) -> dict[str, str]:
    """Effects whose interval holds the value at which they change nothing, and what is to be said of them."""
    found = {}
    for name in fit.model.effects:
        low, high = fit.interval(name)
        null = fit.model[name].null
        if null is not None and low <= null <= high:
            found[name] = f"may be absent: the interval holds {null:g}"
    return found
