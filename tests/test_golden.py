"""Fits, gaps, tracks, profiles and exports give the numbers that they gave."""

import json

import golden
import pytest


@pytest.mark.slow
@pytest.mark.parametrize("case", golden.CASES)
def test_numbers_are_what_they_were(case):
    wanted = json.loads(golden.GOLDEN.read_text(encoding="utf-8"))[case]
    assert golden.differences(wanted, golden.plain(golden.CASES[case]())) == []


def test_a_changed_number_is_told():
    assert golden.differences({"a": [1.0, 2.0]}, {"a": [1.0, 2.0 + 4e-9]}) == ["/a[1]: 2.0 before, 2.000000004 now"]
    assert golden.differences({"a": 1.0}, {"a": 1.0, "b": 2.0}) == [": b is on one side only"]
