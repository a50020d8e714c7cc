"""Source is read as arithmetic; whatever else it says is refused, and nothing of it happens."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from greybox_id.base.errors import BadInput
from greybox_lab.nnodely.formula import DEEPEST, FUNCTIONS, LIBRARIES, MOST_CODE, formula

X = np.linspace(-2.0, 2.0, 7)


def returning(expression, arguments="x, y"):
    return formula(f"def f({arguments}):\n    return {expression}\n", "net.json: function F")


@pytest.mark.parametrize(
    ("expression", "wanted"),
    [
        ("x * (y - 3) / 2", X * (X[::-1] - 3) / 2),
        ("-x + +y", -X + X[::-1]),
        ("x**2 - torch.pow(x, 2)", 0 * X),
        ("torch.sin(x) * torch.cos(y) + torch.tan(x)", np.sin(X) * np.cos(X[::-1]) + np.tan(X)),
        ("torch.mul(x, torch.gt(x, 0))", np.maximum(X, 0)),
        ("x * ~(x > 0)", np.minimum(X, 0)),
        ("torch.relu(x)", np.maximum(X, 0)),
        ("x.clamp(max=0) + torch.clamp(x, 0, 1)", np.minimum(X, 0) + np.clip(X, 0, 1)),
        ("torch.where(x < y, x, y)", np.minimum(X, X[::-1])),
        ("torch.maximum(x, torch.zeros_like(x))", np.maximum(X, 0)),
        ("math.pi * x.square()", math.pi * X**2),
        ("9**9**9 * 0 + x", np.full(7, np.nan)),
    ],
)
def test_arithmetic_means_what_it_means_in_python(expression, wanted):
    with np.errstate(all="ignore"):
        np.testing.assert_allclose(returning(expression)(X, X[::-1]), wanted, rtol=1e-15, atol=1e-15)


def test_assignments_and_a_docstring_are_read():
    found = formula(
        "def f(a, b):\n    '''What it is.'''\n    c = a * b  # a product\n    a = c + 1\n    return a\n", "F"
    )
    np.testing.assert_array_equal(found(X, X), X * X + 1)


@pytest.mark.parametrize(
    "expression",
    [
        "__import__('os').system('x')",
        "exec('x')",
        "open('/etc/passwd').read()",
        "().__class__.__bases__[0].__subclasses__()",
        "torch.load('weights.pt')",
        "torch.tensor([x])",
        "torch.os.system('x')",
        "np.lib.format.open_memmap('x')",
        "np.add(x, y, x)",
        "np.add(x, y, out=x)",
        "torch.sin(*x)",
        "torch.sin(**x)",
        "torch.sin(x, dtype=object)",
        "torch.where(x)",
        "(lambda: x)()",
        "[x for _ in y]",
        "(z := x)",
        "f'{x}'",
        "x if x else y",
        "x and y",
        "x < y < x",
        "x @ y",
        "x // y",
        "x[0]",
        "x.T",
        "z",
        "'text'",
        "True",
        "1j",
        "None",
        "...",
        "await x",
        "yield x",
        "9" * 400,
        "~x",
        "-(x > y)",
    ],
)
def test_anything_else_is_refused_with_a_sentence(expression):
    with pytest.raises(BadInput, match="F"):
        returning(expression)(X, X)


@pytest.mark.parametrize(
    "code",
    [
        "",
        "x = 1",
        "lambda x: x",
        "def f(x):\n  pass",
        "def f(x):\n  return",
        "def f(x):\n  x += 1\n  return x",
        "def f(x):\n  import os\n  return x",
        "def f(x):\n  while True: pass",
        "def f(x):\n  for k in x: pass\n  return x",
        "def f(x):\n  global y\n  return x",
        "def f(x):\n  a, b = x\n  return a",
        "def f(x):\n  x.a = 1\n  return x",
        "def f(x=print('ran')):\n  return x",
        "def f(*x):\n  return x",
        "def f(x, /):\n  return x",
        "@print\ndef f(x):\n  return x",
        "class f: pass",
        "async def f(x):\n  return x",
        "def f(x):\n  return x\ndef g(x):\n  return x",
        "def f(x):\n  return x\nprint('ran')",
        "def f(x: print('ran')):\n  raise x",
        "def f(x):\n  return (",
        "def f(x):\n  return x\0",
        "\ud800",
        None,
        3,
        ["def f(x):\n  return x"],
        "#" * (MOST_CODE + 1),
    ],
)
def test_source_that_is_no_plain_function_is_refused(code):
    with pytest.raises(BadInput, match="F"):
        formula(code, "function F")(X)


@pytest.mark.parametrize("word", ["-", "(", "x+", "not ", "x.", "lambda:", "[", "~", "x if x else ", "torch.sin("])
def test_expressions_as_deep_as_source_can_be_end_in_a_sentence(word):
    room = MOST_CODE - len("def f(x):\n    return x")
    with pytest.raises(BadInput):
        returning(word * (room // len(word)) + "x", "x")(X)


def test_what_the_compiler_would_warn_of_is_not_said(recwarn):
    assert returning("1if x else 0", "x").arguments == ("x",)
    assert len(recwarn) == 0


def test_the_deepest_expression_that_is_read():
    assert returning("-" * (DEEPEST - 3) + "x", "x")(X).shape == X.shape
    with pytest.raises(BadInput, match="deeper"):
        returning("-" * (DEEPEST + 3) + "x", "x")


def test_an_argument_may_be_called_as_a_library_is():
    np.testing.assert_array_equal(returning("torch.square()", "torch")(X), X**2)


def test_the_number_of_arguments_is_checked():
    with pytest.raises(BadInput, match="takes 2 arguments, but the file passes 1"):
        returning("x")(X)


@given(st.sampled_from(sorted(FUNCTIONS)), st.sampled_from(LIBRARIES), st.integers(0, 4))
def test_every_function_with_any_number_of_arguments_is_a_value_or_a_sentence(name, library, count):
    expression = f"{library}.{name}({', '.join('xy'[k % 2] for k in range(count))})"
    try:
        with np.errstate(all="ignore"):
            found = returning(expression)(X, X)
    except BadInput as error:
        found, said = X, str(error)
    else:
        said = name
    assert found.shape == X.shape
    assert name in said
