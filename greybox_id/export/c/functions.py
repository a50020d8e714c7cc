"""From CasADi functions to C functions of straight-line C99.

CasADi's own generated code keeps every intermediate number in a work array and reads it back; here each is a local
constant, which stays in a register. Operations are ordered by the number of slow functions before them: those of front
and rear axle are then adjacent, and the processor works on both at once.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as cs

from ...base.shorthands import Array
from ...engine.graph import FUNCTIONS, LOGIC, OPERATORS, SELECT, SLOW, TESTS, Graph, Leaf, Operation, traced
from ..equations import Named
from .mathematics import EXACT, definitions
from .mathematics import FUNCTIONS as OWN
from .naming import c_comment, names, numbers

OWN_OF = {name: f"own_{name}" for name in FUNCTIONS.values() if f"own_{name}" in OWN}
"""Functions with an implementation of this project in C."""
LONGEST = 60
"""Largest number of characters of an expression that is inlined at its only use."""


@dataclass(frozen=True)
class Body:
    """Body of a C function.

    Attributes
    ----------
    lines : statements.
    functions : names of the functions of `mathematics` that they call.
    """

    lines: tuple[str, ...]
    functions: frozenset[str]

    def reads(self, argument: str) -> bool:
        """Whether an argument is used."""
        return any(re.search(rf"\b{argument}\b", line) for line in self.lines)


def body(function: cs.Function, arguments: Sequence[str], results: Sequence[str]) -> Body:
    """The statements that compute an SX function's dense results.

    Parameters
    ----------
    function : of column vectors.
    arguments : their names in C; one that ends in "*" is a number, not an array.
    results : names of the arrays for the results, column by column.

    Raises `CannotCompile` for an operation without a C equivalent.
    """
    symbols = function.sx_in()
    dense = cs.Function("dense", symbols, [cs.densify(result) for result in function.call(symbols)])
    graph, numbers = traced(dense, [name.rstrip("*") for name in arguments], "p")
    scalars = frozenset(name.rstrip("*") for name in arguments if name.endswith("*"))
    writer = _Writer(graph, scalars, [value for values in numbers for value in values])
    lines = list(writer.lines())
    # values passed through are read before results are written, since x_next may be x
    held, stores = list[str](), list[str]()
    for array, values in zip(results, numbers, strict=True):
        for k, value in enumerate(values):
            given = writer.name(value)
            if given.endswith("]"):
                held.append(f"const double {array}_{k} = {given};")
                given = f"{array}_{k}"
            stores.append(f"{array}[{k}] = {given};")
    return Body((*lines, *held, *stores), frozenset(writer.functions))


class _Writer:
    """Writes a graph's operations as C statements.

    Attributes
    ----------
    functions : names of the functions of `mathematics` called so far.
    """

    def __init__(self, graph: Graph, scalars: frozenset[str], target: Sequence[int]) -> None:
        self.graph = graph
        self.scalars = scalars
        self.functions: set[str] = set()
        self._operations = graph.operations()
        self._choices = dict(self._found_choices())
        self._needed = self._found_needed(target)
        self._angles = self._found_angles()
        self._uses = self._found_uses(target)
        self._inlined: dict[int, str] = {}

    def lines(self) -> Iterator[str]:
        """The statements, ordered by the number of slow functions that they depend on."""
        depths = [0] * len(self.graph.values)
        for k, value in self._operations.items():
            depths[k] = max(depths[source] for source in value.sources) + (value.op in SLOW)
        done = set[int]()
        for k in sorted(self._operations, key=depths.__getitem__):
            if k not in self._needed or k in done:
                continue
            value = self._operations[k]
            pair = self._angles.get(value.sources[0]) if value.op in (cs.OP_SIN, cs.OP_COS) else None
            if pair is None:
                text = self._expression(k, value)
                if self._uses[k] == 1 and value.op in OPERATORS and len(text) <= LONGEST:
                    self._inlined[k] = f"({text})"
                else:
                    yield f"const {'int' if value.op in TESTS or value.op in LOGIC else 'double'} v{k} = {text};"
            else:
                sine, cosine = pair
                done |= {sine, cosine}
                self.functions.add("own_sincos")
                yield f"double v{sine}, v{cosine};"
                yield f"own_sincos({self.name(value.sources[0])}, &v{sine}, &v{cosine});"

    def name(self, k: int) -> str:
        """The C expression of a value."""
        value = self.graph.values[k]
        if not isinstance(value, Leaf):
            return self._inlined.get(k, f"v{k}")
        number = re.fullmatch(r"splat\((.*)\)", value.text)
        if number is not None:
            return _literal(number[1])
        array = value.text.partition("[")[0]
        return array if array in self.scalars else value.text

    def _expression(self, k: int, value: Operation) -> str:
        names = [self._operand(source, value.op) for source in value.sources]
        if k in self._choices:
            test, yes, no = (self.name(source) for source in self._choices[k])
            return f"{test} ? {yes} : {no}"
        if value.op in TESTS:
            return TESTS[value.op].format(*names)
        if value.op in LOGIC:
            words = {cs.OP_NOT: "!{0}", cs.OP_AND: "{0} && {1}", cs.OP_OR: "{0} || {1}"}
            return words[value.op].format(*names)
        if value.op == SELECT:
            return f"{names[0]} ? {names[1]} : 0.0"
        if value.op in OPERATORS:
            return OPERATORS[value.op].replace("splat(1)", "1.0").format(*names)
        called = FUNCTIONS[value.op]
        entry = OWN_OF.get(called, called)
        if entry != called:
            self.functions.add(entry)
        return f"{entry}({', '.join(names)})"

    def _operand(self, k: int, op: int) -> str:
        """A value as an operand; tests are integers in C and are cast to double, or quotients would be truncated."""
        value = self._operations.get(k)
        tested = value is not None and (value.op in TESTS or value.op in LOGIC)
        return f"(double){self.name(k)}" if tested and (op in OPERATORS or op in FUNCTIONS) else self.name(k)

    def _found_choices(self) -> Iterator[tuple[int, tuple[int, int, int]]]:
        """Sums of the form "a if a test holds, plus b if it does not", which become one conditional expression."""
        for k, value in self._operations.items():
            if value.op != cs.OP_ADD:
                continue
            parts = [self._operations.get(source) for source in value.sources]
            if all(part is not None and part.op == SELECT for part in parts):
                (test, yes), (other, no) = (part.sources for part in parts if part is not None)
                negated = self._operations.get(other)
                if negated is not None and negated.op == cs.OP_NOT and negated.sources == (test,):
                    yield k, (test, yes, no)

    def _found_angles(self) -> Mapping[int, tuple[int, int]]:
        """Angles of which both sine and cosine are needed."""
        by_angle: dict[int, dict[int, int]] = {}
        for k, value in self._operations.items():
            if k in self._needed and value.op in (cs.OP_SIN, cs.OP_COS):
                by_angle.setdefault(value.sources[0], {})[value.op] = k
        return {a: (both[cs.OP_SIN], both[cs.OP_COS]) for a, both in by_angle.items() if len(both) == 2}

    def _found_uses(self, target: Sequence[int]) -> Counter[int]:
        """Number of uses of each value; two if it is doubled, squared or a result.

        Results are computed before any is stored, since x_next may be x.
        """
        uses = Counter(dict.fromkeys(target, 2))
        for k in self._needed & self._operations.keys():
            value = self._operations[k]
            counter = Counter(self._choices.get(k, value.sources))
            uses += Counter(dict.fromkeys(counter, 2)) if value.op in (cs.OP_SQ, cs.OP_TWICE) else counter
        return uses

    def _found_needed(self, target: Sequence[int]) -> set[int]:
        """Operations whose values are needed after merging conditionals."""
        needed = set(target)
        for k in reversed(self._operations):  # operands precede the values computed from them
            if k in needed:
                needed.update(self._choices.get(k, self._operations[k].sources))
        return needed


def _literal(text: str) -> str:
    """A number of the graph in C: the shortest decimal that equals it exactly."""
    if text.lstrip("-") in ("NAN", "INFINITY"):
        return text
    number = repr(float.fromhex(text))
    return f"({number})" if number.startswith("-") else number


INLINE = """\
#if defined __GNUC__
#define INLINE inline __attribute__((always_inline, unused))
#else
#define INLINE inline
#endif
"""
FRAME = 1024
"""Stack bytes of a C function besides its own variables: saved registers, arguments, and the functions it calls."""


@dataclass(frozen=True)
class Argument:
    """An argument of a C function.

    Attributes
    ----------
    name : in C.
    size : its length as a constant of the header, such as "CAR_NX"; "" for a number.
    """

    name: str
    size: str

    @property
    def given(self) -> str:
        """Its declaration as an input."""
        return f"const double *{self.name}" if self.size else f"double {self.name}"


@dataclass(frozen=True)
class CFunction:
    """A function written from a CasADi function.

    Attributes
    ----------
    name : in C.
    function : column vectors -> dense results.
    arguments, results : in its order.
    about : what it computes.
    """

    name: str
    function: cs.Function
    arguments: tuple[Argument, ...]
    results: tuple[Argument, ...]
    about: str

    @cached_property
    def body(self) -> Body:
        """The statements."""
        arguments = [argument.name if argument.size else f"{argument.name}*" for argument in self.arguments]
        return body(self.function, arguments, [result.name for result in self.results])

    @property
    def stack_bytes(self) -> int:
        """Upper bound of the stack it needs, even if the compiler keeps nothing in registers."""
        return 8 * sum(line.startswith(("const", "double")) for line in self.body.lines) + FRAME

    @property
    def _all(self) -> tuple[Argument, ...]:
        return (*self.arguments, *self.results)

    @property
    def signature(self) -> str:
        """Its declaration, without the final semicolon."""
        known = [argument.given for argument in self.arguments] + [f"double *{result.name}" for result in self.results]
        return wrapped(f"void {self.name}(", known)

    @property
    def declaration(self) -> str:
        """Its declaration with a comment, for a header."""
        sizes = ", ".join(f"{item.name} {item.size}" for item in self._all if item.size)
        return f"/* {c_comment(self.about)}\n   Lengths: {sizes}. */\n{self.signature};\n"

    @property
    def definition(self) -> str:
        """Its definition in C."""
        unused = [f"(void){item.name};" for item in self._all if not self.body.reads(item.name)]
        lines = "\n".join(f"    {line}" for line in (*self.body.lines, *unused))
        return f"{self.signature}\n{{\n{lines}\n}}\n"


def wrapped(head: str, arguments: Sequence[str]) -> str:
    """A declaration with its arguments broken into lines."""
    lines, line = [], head
    for k, argument in enumerate(arguments):
        piece = argument + ("," if k + 1 < len(arguments) else ")")
        joined = f"{line}{'' if line.endswith('(') or not line.strip() else ' '}{piece}"
        if len(joined) > 100 and line.strip():
            lines.append(line)
            line = f"    {piece}"
        else:
            line = joined
    return "\n".join([*lines, line])


def mathematics_of(functions: Sequence[CFunction]) -> str:
    """C of the elementary functions that these call."""
    called = frozenset().union(*[function.body.functions for function in functions])
    return f"{INLINE}\n{definitions(called)}"


def beginning(
    title: str, name: str, functions: Sequence[CFunction], values: Array, lists: Mapping[str, Sequence[Named]]
) -> list[str]:
    """Beginning of a source file: includes, elementary functions, default parameters, and the names of entries.

    Parameters
    ----------
    title, name : of the export.
    functions : that the source defines.
    values : of the parameters.
    lists : "input", "parameter" ... -> the entries with names.
    """
    return [
        f"/* {title} */\n",
        EXACT,
        f'#include "{name}.h"\n\n#include <math.h>\n#include <stdint.h>\n#include <string.h>\n',
        mathematics_of(functions),
        f"const double {name}_default_parameters[] = {{\n{numbers(values if len(values) else [0.0])}\n}};\n",
        *(names(f"{name}_{which}_names", entries) for which, entries in lists.items()),
    ]
