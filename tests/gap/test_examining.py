"""What decides how a gap is examined."""

from types import SimpleNamespace

import numpy as np
import pytest

from greybox_id.gap.examining import spins


@pytest.mark.parametrize(("off", "expected"), [(0.5, False), (1.5, True)])
def test_a_simulation_spins_where_its_yaw_rate_is_further_off_than_the_yaw_rate_itself(off, expected):
    yaw_rate = np.sin(np.linspace(0.0, 20.0, 400))
    bench = SimpleNamespace(channels=("v_x", "yaw_rate"), measured=np.column_stack([np.full(400, 5.0), yaw_rate]))
    errors = np.column_stack([np.full(400, 30.0), off * yaw_rate[::-1]])  # speed is far off, and does not count
    good = np.ones((400, 2), dtype=bool)
    assert spins(bench, errors, good) is expected
    good[:, 1] = False
    assert not spins(bench, errors, good)
    assert not spins(SimpleNamespace(channels=("v_x",), measured=np.ones((400, 1))), errors[:, :1], good[:, :1])
