"""Common units, known without pint, are what pint says they are."""

from itertools import product

import pytest

from greybox_id.base import units


def test_common_units_and_their_products_are_pints():
    known = 0
    for a, b in product(units._COMMON, repeat=2):
        for spelled in (f"{a}/{b}", f"{a} {b}^2"):
            base = units._base(spelled, spelled)
            plain = units._plain_factor(spelled, units._plain(base))
            if plain is not None:
                factor, offset = units._affine(spelled, base, spelled)
                assert (plain, offset) == (pytest.approx(factor, rel=1e-12), 0.0), spelled
                known += 1
    assert known > 500


def test_what_is_of_another_kind_or_rare_is_left_to_pint():
    assert units._plain_factor("m/s", "m/s^2") is None
    assert units._plain_factor("furlong", "m") is None
    assert units.to_si("mile/h", "m/s").factor == pytest.approx(0.44704)
