"""The C around the straight-line code: vectors of lanes (`vectors.c`), functions of them (`functions.c`), and loops
over lanes, segments and sensitivities (`simulate.c`, `follow.c`, `linearise.c`).

Lanes are GCC's vector type (clang has it too), as wide as the machine's registers: 8 with AVX-512, 4 with AVX2,
else 2. On processors with fused multiply-add, sine, cosine, arctangents, exponential and hyperbolic tangent are
implemented here, within 2 ulp. Other functions come from glibc's libmvec on x86-64, whose results are within 4 ulp;
elsewhere each lane calls the mathematical library. With AVX-512 up to four remaining lanes run in vectors of four, in
three quarters of the time: divisions and square roots take time in proportion to the width.
Infinities and NaN behave as in CasADi's virtual machine: no compiler flag assumes their absence. Products with a
parameter that is zero count as zero.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import casadi as cs

from .graph import SLOW
from .idle import refinements
from .straight import Result, straight_line

WIDE, FEW = 8, 4
"""Lanes of the widest vectors, and of the narrow ones for a remainder that would leave a wide vector half empty."""


MOST_IN_LINE = 60
"""Largest number of inlined calls of mathematical functions: a single-track model in four Runge-Kutta stages has 43,
and takes 7 % less time inlined. A network of 64 takes 8 % more, and twice the time to compile."""


@cache
def c_of(name: str) -> str:
    """C text that is the same for all models."""
    return Path(__file__).with_name(f"{name}.c").read_text("utf-8")


@cache
def writers(module: str) -> str:
    """Text that determines the C written by another module: its source, the C files beside it, and the files here."""
    folder, writer = Path(__file__).parent, Path(module)
    names = ("graph", "idle", "straight", "vectors")
    files = [
        *(folder / f"{name}.py" for name in names),
        *sorted(folder.glob("*.c")),
        writer,
        *sorted(writer.parent.glob("*.c")),
    ]
    return "\0".join(file.read_text("utf-8") for file in dict.fromkeys(files))


def of_lanes(*functions: cs.Function) -> str:
    """C of vectors of lanes, and of their mathematical functions; inlined unless there are too many calls."""
    calls = sum(f.instruction_id(k) in SLOW for f in functions for k in range(f.n_instructions()))
    how = "NOINLINE" if calls > MOST_IN_LINE else "INLINE"
    return f"{c_of('vectors')}\n#define IN_LINE {how}\n#if FUSED\n{c_of('functions')}#endif"


def scratch_size(columns: int, outputs: int) -> int:
    """Length of the scratch array for accumulating normal equations: rows of a batch, their product, alignment."""
    wide = (columns + 3) // 3 * 3
    return WIDE * (1 + wide * (wide + outputs * (1 + 12 // (outputs + 1))))


def source(value: cs.Function, slope: cs.Function) -> str:
    """The C of a kernel; `narrow_source` is the second file.

    Parameters
    ----------
    value : (z, s, p) -> z_next, y, dense.
    slope : (z, s, p) -> z_next, y, dense, and A, B, C, D: the derivatives of z_next and y, each by z and p, sparse.

    Raises `CannotCompile`.
    """
    A, B, C, D = (slope.sparsity_out(k) for k in range(2, 6))
    sizes = {"NA": A.nnz(), "NB": B.nnz(), "NC": C.nnz(), "ND": D.nnz()}
    following, y = _results(value)
    derivatives = [
        Result("A"),
        Result("B", [f"moving[{parameter}] >= 0" for parameter in B.get_triplet()[1]]),
        Result("C", ["reading"] * C.nnz()),
        Result("D", ["reading"] * D.nnz()),
    ]
    declared = ["int reading", "const ptrdiff_t *moving"]
    return "\n".join(
        [
            _simulation(value),
            *[f"#define {name} {size}" for name, size in sizes.items()],
            straight_line("slope", slope, [following, y, *derivatives], declared, refinements(value)),
            table("B_ROW", B.get_triplet()[0]),
            table("B_COLUMN", B.get_triplet()[1]),
            table("D_ROW", D.get_triplet()[0]),
            table("D_COLUMN", D.get_triplet()[1]),
            product("A_times", A),
            product("C_times", C),
            c_of("linearise"),
        ]
    )


def narrow_source(value: cs.Function) -> str:
    """The C of `simulate_few` and `follow_few`, in vectors of `FEW` lanes; empty unless wider vectors exist."""
    simulation = re.sub(r"void (simulate|follow)\(", r"void \1_few(", _simulation(value))
    return f"#if defined __AVX512F__\n#define NARROW\n{simulation}\n#endif"


def _simulation(value: cs.Function) -> str:
    sizes = {"NZ": value.nnz_in(0), "NS": value.nnz_in(1), "NP": value.nnz_in(2), "NY": value.nnz_out(1)}
    return "\n".join(
        [
            of_lanes(value),
            *[f"#define {name} {size}" for name, size in sizes.items()],
            straight_line("value", value, _results(value), ["int reading"], refinements(value)),
            c_of("simulate"),
            c_of("follow"),
        ]
    )


def _results(value: cs.Function) -> list[Result]:
    return [Result("next"), Result("y", ["reading"] * value.nnz_out(1))]


def table(name: str, entries: Sequence[int]) -> str:
    """A C table of small integers."""
    return f"static const short {name}[] = {{{', '.join(map(str, entries)) or 0}}};"


def product(name: str, sparsity: cs.Sparsity) -> str:
    """C of a sparse matrix times Z, column by column of Z so that the result may overwrite Z."""
    row, column = sparsity.get_triplet()
    lines = [f"const v x{j} = Z[{j} * columns + c];" for j in sorted(set(column))]
    for i in range(sparsity.size1()):
        terms = [(f"J[{k}]", f"x{j}") for k, (r, j) in enumerate(zip(row, column, strict=True)) if r == i]
        text = " * ".join(terms[0]) if terms else "splat(0)"
        for entry, x in terms[1:]:
            text = f"fused({entry}, {x}, {text})"
        lines.append(f"result[{i} * columns + c] = {text};")
    return f"""
static void {name}(const v *J, const v *Z, v *result, ptrdiff_t columns)
{{
    for (ptrdiff_t c = 0; c < columns; c++) {{
        {(chr(10) + " " * 8).join(lines)}
    }}
}}"""
