"""A driver made by hand: it steers by the curvature ahead and back to the line, and wants the speed wanted there."""

import numpy as np

from greybox_lab.driving.racing.policy import Policy
from greybox_lab.driving.racing.world import AHEAD, OWN


def by_hand(gain: float = 1.0) -> Policy:
    """One linear layer."""
    W = np.zeros((OWN + 2 * len(AHEAD), 2), dtype=np.float32)
    W[3, 0], W[4, 0], W[2, 0] = -0.9 * gain, -1.5, -0.1
    W[OWN + 1, 0] = 0.95
    W[OWN + len(AHEAD), 1] = 2.14
    return Policy((W,), (np.array([0.0, -1.14], dtype=np.float32),), {"made": "by hand"})
