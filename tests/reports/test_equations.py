"""Equations in reports are those of the model: evaluated, they give what the model gives."""

import math
from xml.etree import ElementTree

import casadi as cs
import numpy as np
import pytest
import typst

from greybox_id.engine.motion.trace import MotionTrace
from greybox_id.engine.trace import Trace
from greybox_id.models.effects import EFFECTS
from greybox_id.models.msnn_full import msnn_full
from greybox_id.models.msnn_lat import LateralSettings, msnn_lat
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle
from greybox_id.reports.equations.expression import (
    MOST_TERMS,
    Call,
    Cases,
    Comparison,
    Constant,
    Equation,
    Power,
    Product,
    Quotient,
    Sum,
    Symbol,
    Window,
    readable,
)
from greybox_id.reports.equations.motion import motion_equations
from greybox_id.reports.equations.tracing import Reader
from greybox_id.reports.equations.typesetting import in_mathml, in_typst
from greybox_id.reports.memory import memory_equations
from greybox_id.reports.settled import without_memory

FUNCTIONS = {
    "sin": math.sin, "cos": math.cos, "tan": math.tan, "arctan": math.atan, "arctan2": math.atan2, "abs": abs,
    "sqrt": math.sqrt, "tanh": math.tanh, "max": max, "min": min, "exp": math.exp, "ln": math.log,
    "sgn": lambda x: math.copysign(1.0, x) if x else 0.0,
}  # fmt: skip
COMPARED = {"<": float.__lt__, "≤": float.__le__, ">": float.__gt__, "≥": float.__ge__}


def value(of, known):
    """An expression at known values of symbols."""

    def inner(own):
        return value(own, known)

    match of:
        case Constant(number):
            return number
        case Symbol():
            return known[of]
        case Sum(terms, 0):
            return sum(-inner(own) if minus else inner(own) for minus, own in terms)
        case Product(factors):
            return math.prod(map(inner, factors))
        case Quotient(above, below):
            return inner(above) / inner(below)
        case Power(base, exponent):
            return inner(base) ** inner(exponent)
        case Call(name, arguments):
            return FUNCTIONS[name](*map(inner, arguments))
        case Comparison(sign, left, right):
            return COMPARED[sign](float(inner(left)), float(inner(right)))
        case Cases(where, then, otherwise):
            return inner(then) if inner(where) else inner(otherwise)
    raise AssertionError(of)


def car(name, *effects):
    return build(name, None, {effect: EFFECTS[effect].typical for effect in effects}, vehicle("full_size_car"))


@pytest.mark.parametrize("name", ["single_track", "lateral", "longitudinal", "kinematic"])
@pytest.mark.parametrize("speed", [20.0, 0.2])
def test_they_give_the_derivatives_of_the_model(name, speed):
    model = car(name)
    known = {Symbol(p.name): float(p.array) for p in model.parameters}
    inputs = {n: {"v_x": speed, "steer": 0.04}.get(n, 0.1) for n in model.inputs}
    states = {state.name: {"v_x": speed}.get(state.name, 0.15) for state in model.states}
    known |= {Symbol(n): v for n, v in (inputs | states).items()}
    shown, left_out = readable(motion_equations(model))
    assert left_out == 0
    waiting = list(shown)
    while waiting:  # abbreviations stand behind what they are used in
        solved = [own for own in waiting if _try(own, known)]
        assert solved, waiting
        waiting = [own for own in waiting if own not in solved]
    trace = MotionTrace(without_memory(model, model.outputs))
    held = [0.0, *inputs.values(), *([0.0] * (trace.segment_size - 1 - len(inputs)))]
    rates = np.ravel(trace.rates(list(states.values()), held, model.values).full())
    np.testing.assert_allclose([known[Symbol(n, dots=1)] for n in states], rates, rtol=1e-9, atol=1e-12)


def _try(equation, known):
    try:
        known[equation.left] = value(equation.right, known)
    except KeyError:
        return False
    return True


@pytest.mark.parametrize("effect", EFFECTS)
def test_every_effect_can_be_written_down_and_set(effect):
    model = next(
        own for own in (car("single_track"), car("longitudinal"), car("lateral")) if EFFECTS[effect].concerns(own)
    )
    model = model + EFFECTS[effect].starting_at(EFFECTS[effect].typical)
    for equation in motion_equations(model):
        assert in_typst(equation)
        ElementTree.fromstring(in_mathml(equation))


def test_the_typesetter_takes_them_all():
    models = [car("single_track", *(name for name in EFFECTS if EFFECTS[name].concerns(car("single_track"))))]
    lines = [in_typst(own) for model in models for own in readable(motion_equations(model))[0]]
    lines += [in_typst(own) for own in readable(memory_equations(msnn_full()))[0]]
    assert len(lines) > 60
    typst.compile("\n".join(f"$ {line} $" for line in lines).encode(), format="pdf", ignore_system_fonts=True)


def test_a_delay_an_offset_and_a_bias_show_in_them():
    lines = [
        in_typst(equation)
        for equation in motion_equations(car("lateral", "steering_delay", "steering_offset", "yaw_rate_bias"))
    ]
    assert 'δ^prime = δ^"late" + "steering offset"' in lines
    assert any(line.startswith('δ^"late" = δ lr((t - "steering delay"') for line in lines)
    assert any(line.startswith('dot(ψ)^"read" = dot(ψ) + "yaw rate bias"') for line in lines)


def test_windows_are_sums_and_equal_to_the_model_s_prediction():
    model = msnn_lat(LateralSettings(n_delta=2, n_v=1, n_x=1, q=2, steer=(-0.2, 0.2), v_x=(2.0,), a_x=(0.0,)))
    (equation,) = memory_equations(model)
    rng = np.random.default_rng(0)
    past = {name: rng.uniform(-0.1, 0.3, 3) for name in model.inputs}
    values = {
        Symbol(p.name, tuple(k + 1 for k in index)): float(p.array[index])
        for p in model.parameters
        for index in np.ndindex(p.shape)
    }
    terms = equation.right.terms if isinstance(equation.right, Sum) else ((False, equation.right),)
    total = 0.0
    for _, window in terms:
        assert isinstance(window, Window)
        for n in range(window.length):
            at = values | {Symbol(name): float(own[n]) for name, own in past.items()}
            total += values[Symbol(window.weights.name, (*window.weights.entry, n + 1))] * value(window.signal, at)
    trace = Trace(model)
    _, y = trace.step
    U = np.array([past[name] for name in model.inputs])
    expected = cs.Function("y", [trace.step[0], trace.p], [y])(U, model.values)
    assert total == pytest.approx(float(expected), rel=1e-9)


def test_long_sums_are_shortened_and_say_so():
    shown, _ = readable(memory_equations(msnn_full()))
    longest = max(len(own.right.terms) for own in shown if isinstance(own.right, Sum))
    assert longest <= MOST_TERMS
    cut = [own for own in shown if isinstance(own.right, Sum) and own.right.left_out]
    assert cut
    assert 'terms"' in in_typst(cut[0])
    assert "terms)" in in_mathml(cut[0])


def test_signs_and_brackets_are_kept():
    a, b, c = (cs.SX.sym(name) for name in "abc")
    read = Reader({name: Symbol(name) for name in "abc"})
    known = {Symbol("a"): 2.0, Symbol("b"): -3.0, Symbol("c"): 0.5}
    for made in (
        a - (b - c),
        -a * (b + c),
        a / (b / c),
        (a - b) ** 2,
        -(a**2) / -b,
        cs.if_else(a > b, a, -b),
        2 * a - 1,
    ):
        expected = float(cs.Function("f", [a, b, c], [made])(2.0, -3.0, 0.5))
        assert value(read(made), known) == pytest.approx(expected)
    assert in_typst_right(read(a - (b - c))) in ("a - b + c", "a - lr((b - c))")


def in_typst_right(expression):
    return in_typst(Equation(Symbol("y"), expression)).removeprefix("y = ")
