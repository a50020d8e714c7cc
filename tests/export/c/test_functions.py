"""Straight-line C from small functions."""

import re

import casadi as cs
import pytest

from greybox_id.engine.compiler import CannotCompile
from greybox_id.export.c.functions import body

x, p = cs.SX.sym("x", 3), cs.SX.sym("p", 2)


def lines(*results, names=("y", "z")):
    return body(cs.Function("f", [x, p], list(results)), ["x", "p"], names[: len(results)])


def test_an_expression_stands_where_it_is_asked_for_once():
    computed, stored = lines(x[0] + 2 * x[1]).lines
    assert re.fullmatch(r"const double (v\d+) = x\[0\] \+ \((x\[1\] \+ x\[1\]|2\.0 \* x\[1\])\);", computed)
    assert stored.startswith("y[0] = v")


def test_what_is_asked_for_twice_is_computed_once():
    shared = cs.exp(x[0])
    text = "\n".join(lines(cs.vertcat(shared + 1, shared + 2)).lines)
    assert text.count("exp(") == 1


def test_a_choice_is_one_choice():
    text = "\n".join(lines(cs.if_else(x[0] > 1, x[1], x[2])).lines)
    assert re.search(r"v\d+ \? x\[1\] : x\[2\]", text)
    assert ": 0.0" not in text
    assert "!" not in text


def test_sine_and_cosine_of_one_angle_are_asked_for_together():
    found = lines(cs.vertcat(cs.sin(x[0]), cs.cos(x[0]), cs.sin(x[1])))
    assert sum("own_sincos(" in line for line in found.lines) == 1
    assert found.functions == {"own_sincos", "own_sin"}


def test_what_is_handed_through_is_read_before_anything_is_written():
    found = lines(cs.vertcat(x[1], x[0])).lines
    assert found.index("const double y_1 = x[0];") < found.index("y[0] = y_0;")


def test_derivatives_where_limits_meet_are_shared():
    """CasADi gives half of the slope to each of two equal numbers, as a quotient of tests."""
    slope = cs.jacobian(cs.fmax(x[0], x[1]), x[0])
    (quotient,) = [line for line in lines(slope).lines if "/" in line]
    assert "(double)" in quotient.partition("/")[0]


def test_numbers_are_written_exactly():
    number = 0.1 + 0.2
    line, _ = lines(x[0] * number).lines
    assert float(re.search(r"0\.3\d+", line)[0]) == number


def test_an_argument_that_has_no_part_is_known():
    found = lines(x[0] + 1)
    assert found.reads("x")
    assert not found.reads("p")


def test_an_operation_without_c_is_a_sentence():
    with pytest.raises(CannotCompile, match="operation"):
        body(cs.Function("f", [x], [cs.SX.binary(cs.OP_PRINTME, x[0], x[1])]), ["x"], ["y"])
