"""Numbers of a diagnosis: each says where it comes from, and none stands elsewhere."""

import ast
from dataclasses import FrozenInstanceError
from pathlib import Path

import pytest

import greybox_id
from greybox_id.gap.estimation.calibration import CAL, provenance
from greybox_lab.exam.answers import SIZABLE

MATHEMATICS = {
    "axes": {"DIRECTIONS", "SECONDS", "SHARE"},  # a circle's quarters; usual values of units
    "closed_vehicle": {"NORMAL"},  # quantile of a normal distribution
    "diagnosis": {"NINETY_FIVE"},
    "evidence": {"NEVER"},  # guards against numbers without meaning
    "examining": {"TINY"},
    "horizons": {"HORIZONS"},  # what is told, not how
    "innovations": {"NO_GATE"},
    "preparing": {"OBSERVED"},
    "columns": {"BLOCKS", "LAGS", "LEAST"},  # a jackknife and its grid; each says where it comes from
    "problem": {"LEAST_ZONE", "RIDGE"},
    "sparse": {"NEVER"},  # guards against numbers without meaning
    "usual": {"FAST"},  # a percentile that a sentence names
}


def numbers(tree):
    """Names at the top of a module that are made of numbers alone."""
    for node in tree.body:
        if isinstance(node, ast.Assign):
            inside = list(ast.walk(node.value))
            if any(isinstance(own, ast.Attribute) and ast.unparse(own.value) == "CAL" for own in inside):
                continue
            if any(type(own.value) in (int, float) for own in inside if isinstance(own, ast.Constant)):
                names = node.targets[0]
                yield from (own.id for own in (names.elts if isinstance(names, ast.Tuple) else [names]))


def test_no_number_stands_beside_the_calibration():
    top = Path(greybox_id.__file__).parent / "gap"
    for floor in (".", "estimation", "changes"):
        for file in (top / floor).glob("*.py"):
            if file.stem != "calibration":
                found = set(numbers(ast.parse(file.read_text(encoding="utf-8"))))
                assert found <= MATHEMATICS.get(file.stem, set()), file.stem


def test_every_number_says_where_it_comes_from():
    for name, (value, how, data) in provenance().items():
        assert value is not None, name
        assert len(how) > 5, name
        assert data or len(how) > 20, name


def test_no_number_is_changed_in_passing():
    with pytest.raises(FrozenInstanceError):
        CAL.cost = 3.0


def test_a_gap_that_shows_is_one_that_examinations_want_detected():
    assert CAL.shows == SIZABLE
