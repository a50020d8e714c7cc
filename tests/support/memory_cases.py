"""What the tests of a diagnosis of maps with memory share: recordings that such a map made of itself."""

import numpy as np
from toys import drive

from greybox_id.datasets.recording import join
from greybox_id.fitting.scores.memory import predictions
from greybox_id.models.effects import EFFECTS
from greybox_id.models.vehicle import Vehicle

NOISE = {"yaw_rate": 0.08, "a_x": 0.15}
CARRIED = {name for name, effect in EFFECTS.items() if effect.apply_to_memory}
"""Effects that are known for maps with memory."""
FITTED = Vehicle("fit", noise=NOISE)
"""What training left."""


def made(model, effects=None, seed=0, noise=1.0, rows=400):
    """Two runs that the model drove freely with effects at these magnitudes, read with noise."""
    for name, value in (effects or {}).items():
        model = model + EFFECTS[name].at(value)
    rng = np.random.default_rng(50 + seed)
    given = join([drive(rows, 2 * seed + k) for k in (0, 1)], f"made{seed}")
    found = predictions(model, given, "closed_loop")
    read = {name: np.array(given[name]) for name in model.outputs}
    for k, name in enumerate(model.outputs):
        white = rng.standard_normal(len(found.rows))
        read[name][found.rows] = found.predicted[:, k] + noise * NOISE[name] * white
    return given.with_signals(**read)
