"""`greybox profile`: how far parameters of a fit can move while all others make up for it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import pandas as pd
from rich.table import Table

from ..fit import Fit, load
from ..fitting.restated import place, profiled, restated
from ..models.registry import build
from ..processes import apart, side_by_side
from ..reports.numbers import interval, number, pretty_unit
from ..reports.recordings import matched
from ..uncertainty import uncertainty
from ..uncertainty.profile import End, Profile
from ..uncertainty.profile import profile as profile_one
from .fit_output import estimate, plain_table
from .options import jobs_option, json_option
from .output import console, print_json, progress
from .predict import target_of, write
from .report import recordings_of

ENDS = {
    End.CROSSED: "",
    End.BOUND: "end is the bound",
    End.FLAT: "side has no end",
    End.NOT_FINITE: "end is where the model is finite no more",
}
"""How one side of a profile ends, where the recording does not limit it."""


@dataclass(frozen=True)
class _Told:
    """A profile beside what the covariance says: interval and standard deviation."""

    profile: Profile
    wald: tuple[float, float]
    sd: float


@click.command(name="profile")
@click.argument("fit_file", metavar="FIT", type=click.Path())
@click.argument("files", nargs=-1, metavar="[RECORDING...]", type=click.Path())
@click.option("--parameter", "names", multiple=True, metavar="NAME", help="A free parameter; repeatable.")
@click.option("--all", "everything", is_flag=True, help="Every free parameter.")
@click.option(
    "--confidence",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    default=0.95,
    show_default=True,
    help="Of the intervals.",
)
@click.option("--columns", metavar="MAP", help="Column map; the one the fit names unless given.")
@jobs_option
@click.option("--out", metavar="FILE", help="Write the curves there: a .csv or .parquet file.")
@json_option
def profile(
    fit_file: str,
    files: Sequence[str],
    names: Sequence[str],
    everything: bool,
    confidence: float,
    columns: str | None,
    jobs: int,
    out: str | None,
    as_json: bool,
) -> None:
    """Profile parameters of FIT: the interval in which the fit stays good, all other parameters re-optimised.

    The recordings are those FIT was trained on, read again from where it found them unless RECORDING... names their
    new places. Ctrl-C keeps the profiles that are done.

    \b
    greybox profile run/fit.json --parameter I_z --parameter B_f --out profiles.csv
    """  # fmt: skip
    target = None if out is None else target_of(out)
    fit = load(fit_file, build)
    wanted = profiled(fit, names, everything)
    trained = replace(fit, data=tuple(record for record in fit.data if record.role == "train"))
    read = recordings_of(trained, Path(fit_file), files, columns=columns, option="RECORDING")
    with progress() as say:
        problem, solution = restated(fit, matched(trained, read))
        told = uncertainty(problem, solution.x, solution.nodes)
        intervals = told.interval(confidence)
        away = apart(len(wanted), jobs)

        def work(k: int) -> _Told:
            if not away:
                say(f"{wanted[k]}: profile {k + 1} of {len(wanted)}", passing=True)
            at = place(problem, wanted[k])
            own = profile_one(problem, solution.x, solution.nodes, at, told=told, confidence=confidence)
            low, high = (float(end) for end in intervals[at])
            return _Told(own, (low, high), float(told.sd[at]))

        def done_with(k: int, own: _Told) -> bool:
            del own
            say(f"{wanted[k]}: done", passing=True)
            return True

        done = side_by_side(work, len(wanted), jobs, done_with)
    found = {wanted[k]: done.found[k] for k in sorted(done.found)}
    missed = [name for name in wanted if name not in found]
    if target is not None:
        write(_curves(found), target)
    if as_json:
        body = {"model": fit.model.name, "confidence": confidence, "interrupted": bool(missed)}
        profiles = {name: _as_dict(fit, name, own) for name, own in found.items()}
        print_json(body | {"profiles": profiles} | ({"written": str(target)} if target is not None else {}))
        return
    screen = console()
    screen.print(_table(fit, found, confidence))
    for name, one in found.items():
        if one.profile.at_a_better_optimum or not one.profile.settled:
            screen.print(one.profile.about(name, fit.model[name].unit))
    if missed:
        screen.print(f"\ninterrupted before {', '.join(missed)}")
    if target is not None:
        screen.print(f"\nwritten  {target}")


def _table(fit: Fit, found: Mapping[str, _Told], confidence: float) -> Table:
    level = f"{100 * confidence:g} %"
    table = plain_table("parameter", "estimate", f"{level} by covariance", f"{level} by profile", "unit", "")
    for name, one in found.items():
        own = fit.model[name]
        table.add_row(
            name, estimate(float(own.array), one.sd), _interval(one.wald, one.sd),
            _interval(one.profile.interval, one.sd), pretty_unit(own.unit), _status(one.profile),
        )  # fmt: skip
    return table


def _interval(ends: tuple[float, float], sd: float) -> str:
    """An interval, which may have no end."""
    if all(math.isfinite(end) for end in (*ends, sd)) and sd > 0:
        return interval(*ends, sd)
    return f"[{number(ends[0])}, {number(ends[1])}]"


def _status(own: Profile) -> str:
    """What a reader must know of a profile: sides that the recording does not limit."""
    sides = [f"{side} {ENDS[end]}" for side, end in zip(("lower", "upper"), own.ends, strict=True) if ENDS[end]]
    return "; ".join(sides)


def _curves(found: Mapping[str, _Told]) -> pd.DataFrame:
    """Every profile point by point: value, rise of the objective, and the rise at which the interval ends."""
    tables = [
        pd.DataFrame({"parameter": name, "value": o.values, "rise": o.rise, "allowed": o.allowed})
        for name, o in ((name, one.profile) for name, one in found.items())
    ]
    return pd.concat(tables, ignore_index=True)


def _as_dict(fit: Fit, name: str, one: _Told) -> dict[str, Any]:
    own = one.profile
    return {
        "unit": fit.model[name].unit,
        "estimate": float(fit.model[name].array),
        "sd": one.sd,
        "by_covariance": list(one.wald),
        "by_profile": list(own.interval),
        "ends": [end.value for end in own.ends],
        "identifiable": own.identifiable,
        "at_a_better_optimum": own.at_a_better_optimum,
        "settled": own.settled,
        "about": own.about(name, fit.model[name].unit),
        "allowed_rise": own.allowed,
        "values": own.values.tolist(),
        "rise": own.rise.tolist(),
    }
