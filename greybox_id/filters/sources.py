"""The C of filters: extended Kalman filters side by side, and an unscented one whose sigma points are.

Extended ones run one to a lane, on the same readings: noise is tuned by comparing them. A reading at a time (noise of
readings is independent), covariances in Joseph's form; those of the unscented one by the unscented transform. A reading
further off than `gate` standard deviations counts as noisier by just so much that it lies at the gate: a glitch then
moves nothing, and a filter that has gone astray still finds its way back.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources

import casadi as cs

from ..engine.emit import Result, straight_line
from ..engine.vectors import PRELUDE, product

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
    loops : file of loops over segments, with `filter` as the function that is called.
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
                straight_line(function.name(), function, [Result(name) for name in item[: function.n_out()]])
                for function, item in zip((step, output), names, strict=True)
            ],
            *tables,
            LOOPS,
            resources.files(__package__).joinpath(loops).read_text("utf-8"),
        ]
    )


def ekf_source(step: cs.Function, output: cs.Function, many: bool, throughout: bool) -> str:
    """The C of extended Kalman filters.

    Parameters
    ----------
    many : whether many filters are to run side by side; a single one is a quarter faster in vectors of four lanes.
    throughout : whether a segment's noise joins all along it; smoothers know of none that does.
    step : (x, s, p) -> x_next, variance of its noise, F = d x_next / d x (sparse).
    output : (x, s, p) -> y, variance of its noise, H = d y / d x (sparse).
    """
    F, H = step.sparsity_out(2), output.sparsity_out(2)
    row, column = H.get_triplet()
    by_row = sorted(range(H.nnz()), key=row.__getitem__)
    tables = [
        _table("H_BEGIN", [sum(r < i for r in row) for i in range(H.size1() + 1)]),
        _table("H_PLACE", by_row),
        _table("H_COLUMN", [column[k] for k in by_row]),
        product("F_times", F),
        *(_table(f"F_{name}", item) for name, item in zip(("ROW", "COLUMN"), F.get_triplet(), strict=True)),
        *(["#define THROUGHOUT"] if throughout else []),
    ]
    return written(step, output, tables, "ekf.c", narrow=not many, NF=F.nnz(), NH=H.nnz())


def _table(name: str, entries: Sequence[int]) -> str:
    return f"static const short {name}[] = {{{', '.join(map(str, entries)) or 0}}};"


def ukf_source(step: cs.Function, output: cs.Function) -> str:
    """The C of an unscented Kalman filter; the functions as for `ekf_source`, whose derivatives are not used."""
    return written(_without_derivative(step), _without_derivative(output), [], "ukf.c")


def _without_derivative(function: cs.Function) -> cs.Function:
    arguments = function.sx_in()
    return cs.Function(function.name(), arguments, list(function(*arguments))[:2])
