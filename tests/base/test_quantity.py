"""Numbers with units, as a user writes them on the command line."""

import pytest

from greybox_id.base.errors import BadInput
from greybox_id.base.units import Belief, belief, number, pairs


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("3.5", "kg", 3.5),
        ("3.5kg", "kg", 3.5),
        ("1.2 t", "kg", 1200.0),
        ("30ms", "s", 0.03),
        ("-2 deg", "rad", -0.0349066),
        ("1e-3", "1", 1e-3),
        ("5%", "1", 0.05),
        ("6 1/rad", "1/rad", 6.0),
        ("0.047 kg m²", "kg m^2", 0.047),
        ("1g", "m/s^2", 9.80665),
        ("2.8 N/unit", "N/unit", 2.8),
        ("inf", "rad/s", float("inf")),
        ("−1", "1", -1.0),
    ],
)
def test_a_number_is_read_in_the_unit_of_its_parameter(text, unit, value):
    assert number(text, unit, "--fix x") == pytest.approx(value)


@pytest.mark.parametrize(
    ("text", "unit", "says"),
    [
        ("3.5m", "kg", "SI unit is kg"),
        ("3 rad", "1", "is not a unit of this quantity"),
        ("3 florins", "kg", '"florins" is not known'),
        ("heavy", "kg", "'heavy' is not a number"),
        ("", "kg", "is not a number"),
        ("3,5", "kg", "cannot be understood"),
    ],
)
def test_what_is_no_such_number_is_a_sentence(text, unit, says):
    with pytest.raises(BadInput, match="--fix x: .*" + says):
        number(text, unit, "--fix x")


@pytest.mark.parametrize("text", ["6±3", "6 ± 3", "6+-3", "6+/-3", "6 +- 3 1/rad", "6±3 1/rad", "6 1/rad ± 3 1/rad"])
def test_a_belief_may_be_written_in_many_ways(text):
    assert belief(text, "1/rad", "--prior B_f") == Belief(6.0, 3.0)


def test_a_unit_behind_a_belief_counts_for_both_numbers():
    told = belief("-31±3 ms", "s", "--prior x")
    assert (told.value, told.sd) == pytest.approx((-0.031, 0.003))


def test_a_number_alone_is_a_belief_without_a_standard_deviation():
    assert belief("2e+3", "1", "--with x") == Belief(2000.0, None)


@pytest.mark.parametrize(
    ("text", "says"), [("1±0", "above zero"), ("1±2±3", "MEAN±SD"), ("1±", "not a number"), ("inf±1", "mean")]
)
def test_a_belief_that_cannot_be_is_a_sentence(text, says):
    with pytest.raises(BadInput, match=says):
        belief(text, "1", "--prior x")


def test_pairs_are_values_by_name():
    assert pairs(["m=3.5kg", "I_z"], "NAME", alone=True) == {"m": "3.5kg", "I_z": None}
    for text in ("I_z", "=3", "I_z="):
        with pytest.raises(BadInput, match="is not NAME=VALUE"):
            pairs([text], "NAME=VALUE")
