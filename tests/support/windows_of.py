"""How far hybrid models are from a recording over windows."""

import numpy as np

from greybox_id.engine.hybrid.problem import WindowErrors
from greybox_id.fitting.training import manoeuvres


def window_error(model, recording, noise):
    """Root mean square error over windows in units of noise, the paper's RMSSE."""
    return np.sqrt(WindowErrors(model, [one for _, one in manoeuvres(model, [recording])], noise)(model.values))
