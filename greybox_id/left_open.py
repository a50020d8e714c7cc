"""What a fit leaves open about its parameters."""

from __future__ import annotations

import numpy as np

from .fit import Fit
from .identifiability import Identifiability, identifiability


def left_open(fit: Fit) -> Identifiability | None:
    """Parameters that a fit hardly tells, or only together; None where its covariance was not kept."""
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
