"""Actuator networks with random weights, for tests of what is around them."""

import numpy as np

from greybox_lab.driving.learned.injection import fingerprint
from greybox_lab.driving.learned.net import DRIVE, VARIANTS, ActuatorNet, drawn


def network(variant, model=None, members=1, size=1.0, sigma=1.0, seed=0):
    """A network of a variant at 50 Hz; `size` is how large what it says is."""
    own = VARIANTS[variant]
    ins, outs = len(own.inputs), len(own.outputs)
    sizes = (own.history * ins, 8, outs)
    layers = [drawn(sizes, np.random.default_rng(seed + k)) for k in range(members)]
    return ActuatorNet(
        variant, own.inputs, own.outputs, own.history, 0.02, tuple(layers), np.zeros(ins), np.ones(ins), np.zeros(outs),
        np.full(outs, size), np.full(outs, sigma), "motor_current" if DRIVE in own.inputs else "",
        "" if not own.residual else "any" if model is None else fingerprint(model),
    )  # fmt: skip
