"""A lap of the single track itself, without noise."""

import numpy as np
import pytest

from greybox_id.datasets.recording import Recording
from greybox_id.fitting.requested_model import RequestedModel
from greybox_id.models.vehicle import vehicle
from greybox_lab.driving.racing.stage import PLANE, Period


@pytest.fixture(scope="package")
def lap():
    """40 s at 50 Hz, straight on and to and fro."""
    own = Period(RequestedModel("single_track", vehicle("roboracer")).model(), 0.02)
    steer, drive = own.inputs.index("steer"), own.inputs.index(own.drive)
    t = 0.02 * np.arange(2000)
    acting = np.zeros((len(t), len(own.inputs)))
    acting[:, steer] = 0.1 * np.sin(2.0 * t) + 0.08 * np.sin(7.1 * t + 1.0) + 0.02 * np.sin(19.0 * t)
    per_drive, v_x = own.per_drive(own.equations.values)[0], own.states.index("v_x")
    z = [np.concatenate([own.begun(2.5, own.equations.values)[0], np.zeros(3)])]
    for k, commands in enumerate(acting):
        commands[drive] = 2.0 * (3.0 + 0.7 * np.sin(0.6 * t[k]) - z[-1][v_x]) / per_drive
        z.append(own.advance(z[-1][None], commands[None], np.zeros((1, 3)), own.equations.values[None])[0])
    motion = np.array(z)[:-1, [own.states.index(name) for name in PLANE]]
    signals = {"steer": acting[:, steer], "motor_current": acting[:, drive]}
    return Recording("lap", t, signals | {name: motion[:, k] for k, name in enumerate(PLANE)})
