"""Parts of a hypothesis: coordinates go with their candidates."""

import numpy as np
import pytest
from gap_cases import axis

from greybox_id.gap.estimation.axes import Candidate
from greybox_id.gap.estimation.hypothesis import Hypothesis


def of_three():
    own = [Candidate("gust", (axis(0), axis(1))), Candidate("lag", (axis(2),)), Candidate("bias", (axis(3),))]
    J = np.arange(24.0).reshape(3, 2, 4)
    return Hypothesis(tuple(own), np.array([0.1, 0.2, 0.3, 0.4]), np.zeros(2), np.zeros(1), 7.0, np.ones((3, 2)), J)


def test_each_candidate_has_its_coordinates():
    own = of_three()
    assert [(each.effect, own.m[at].tolist()) for each, at in own.parts] == [
        ("gust", [0.1, 0.2]), ("lag", [0.3]), ("bias", [0.4])
    ]  # fmt: skip
    assert own.main("lag") == (own.candidates[1].axes[0], 2)


def test_effects_at_their_bounds_are_known():
    bounded = [Candidate(name, (axis(k, low=0.0, high=0.2),)) for k, name in enumerate(("grip", "lag", "bias"))]
    J = np.zeros((3, 2, 3))
    place = Hypothesis(tuple(bounded), np.array([0.0, 0.1, 0.2]), np.zeros(2), np.zeros(1), 7.0, np.ones((3, 2)), J)
    assert place.at_bounds == {"grip", "bias"}


@pytest.mark.parametrize(
    ("kept", "places"), [({"gust", "bias"}, [0, 1, 3]), ({"lag"}, [2]), (set(), []), ({"other"}, [])]
)
def test_some_effects_stay_where_they_stand(kept, places):
    whole = of_three()
    own = whole.only(kept)
    assert set(own.names) == kept - {"other"}
    np.testing.assert_array_equal(own.m, whole.m[places])
    np.testing.assert_array_equal(own.J, whole.J[:, :, places])
    assert own.cost == np.inf
