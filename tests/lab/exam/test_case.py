"""Draws of a case: fair ones, and vehicles that cannot be driven."""

import pytest

from greybox_id.base.errors import BadInput
from greybox_lab.exam.case import LATER, fair_case


class Drawn:
    """A draw that is fair or not, of a vehicle that can be driven from some attempt on."""

    def __init__(self, attempt, fair, drives):
        self.attempt, self.fair = attempt, fair
        if attempt < drives:
            raise BadInput("It rolls over.")

    def made(self):
        return self.attempt


@pytest.mark.parametrize(
    ("fair_at", "drives_from", "taken"),
    [(3, 0, 3), (99, 0, 11), (99, 11, 11), (99, 20, 20), (25, 20, 20)],
    ids=["the first fair one", "the last of twelve", "the only one", "the first that drives", "fair comes too late"],
)
def test_the_first_fair_draw_else_one_that_can_be_driven(fair_at, drives_from, taken):
    assert fair_case(lambda k: Drawn(k, k == fair_at, drives_from), 12, "vehicles") == taken


def test_where_none_can_be_driven_another_seed_is_asked_for():
    with pytest.raises(BadInput, match=f"None of {12 * LATER} vehicles can be driven"):
        fair_case(lambda k: Drawn(k, True, 10**6), 12, "vehicles")
