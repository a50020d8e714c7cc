"""Time that goes on where clocks begin anew."""

import numpy as np

from greybox_id.estimation.clock import running


def test_time_runs_on_between_recordings():
    one = np.array([0.5, 1.5, 2.5])
    np.testing.assert_allclose(running(one), one)
    np.testing.assert_allclose(running(np.concatenate([one, one])), [0.5, 1.5, 2.5, 3.5, 4.5, 5.5])
