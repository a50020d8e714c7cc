"""What the C of all filters has in common."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as cs

from ..engine.emit import Result, straight_line
from ..engine.vectors import PRELUDE

NARROW = "#define NARROW"
"""Asks for vectors of four lanes where there are wider ones."""
LOOPS = r"""
/* loops over the entries of covariances are worth unrolling, which -O1 does not do: a sixth of the time */
#pragma GCC optimize("O3")

typedef struct { double *predicted, *predicted_P, *filtered, *filtered_P, *forward, *off, *spread; } Record;
"""


def written(
    step: cs.Function, output: cs.Function, tables: Sequence[str], loops: str, *, narrow: bool = False, **sizes: int
) -> str:
    """The C of a filter.

    Parameters
    ----------
    step, output : (x, s, p) -> value, variance of its noise and, if the filter uses it, the derivative by x.
    tables : declarations that the loops need.
    loops : over segments, with `filter` as the function that is called.
    narrow : whether vectors of four lanes will do.
    sizes : further constants.
    """
    x, s, p = (step.numel_in(k) for k in range(3))
    constants = {"NX": x, "NS": s, "NP": p, "NY": output.numel_out(0), **sizes}
    names = [["next", "noise", "F"], ["y", "noise", "H"]]
    return "\n".join(
        [
            *([NARROW] if narrow else []),
            PRELUDE,
            *[f"#define {name} {size}" for name, size in constants.items()],
            *[
                straight_line(function.name(), function, [Result(name) for name in own[: function.n_out()]])
                for function, own in zip((step, output), names, strict=True)
            ],
            *tables,
            LOOPS,
            loops,
        ]
    )
