"""Profile likelihood of a fit's parameters."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import RenderableType
from rich.table import Table

from ..base.declared import understood
from ..base.errors import BadInput
from ..base.numbers import interval, number, pretty_unit
from ..base.processes import Pace, apart, side_by_side
from ..datasets.recording import Recording
from ..datasets.result_table import PLAIN, claimed_table, write_table
from ..engine.least_squares import LeastSquares
from ..engine.solvers.gauss_newton import Solution
from ..fitting.fit import Fit
from ..fitting.holding import place, profiled, restated
from ..fitting.how import Say, quiet
from ..fitting.uncertainty import uncertainty
from ..fitting.uncertainty.beyond_noise import wider
from ..fitting.uncertainty.form import NOISE_ALONE
from ..fitting.uncertainty.profile import End, Profile
from ..fitting.uncertainty.profile import profile as profile_one
from ..fitting.uncertainty.sandwich import Uncertainty
from ..reports.recordings import matched
from ..reports.text.fit import estimate
from ..reports.text.screen import as_text, plain_table
from . import given
from .given import Columns, Recordings

ENDS = {
    End.CROSSED: "",
    End.BOUND: "end is the bound",
    End.FLAT: "side has no end",
    End.NOT_FINITE: "the profile ends where the model is no longer finite",
}
"""End of one side of a profile -> words, if the recording does not limit it."""
WORDS = "a table of profiles"
"""Kind of file, for messages."""
MOVED = 0.1
"""Distance from the fit, in standard deviations, from which an optimum counts as another one."""


@dataclass(frozen=True)
class ProfileBeside:
    """A profile with the intervals of the covariance, for comparison.

    Attributes
    ----------
    profile : the profile, including the interval for noise alone.
    wald : interval by the covariance of the fit, which includes model error.
    sd : standard deviation of the fit.
    noise_wald, noise_sd : both for noise alone.
    """

    profile: Profile
    wald: tuple[float, float]
    sd: float
    noise_wald: tuple[float, float]
    noise_sd: float


@dataclass(frozen=True)
class Profiles:
    """Profiles of several parameters.

    Attributes
    ----------
    fit : the fit.
    confidence : of the intervals.
    found : parameter -> its profile.
    missed : parameters without a profile because of an interruption.
    moved : parameters that a new optimisation from the fit moves -> distance in standard deviations.
    """

    fit: Fit
    confidence: float
    found: Mapping[str, ProfileBeside]
    missed: Sequence[str] = ()
    moved: Mapping[str, float] = field(default_factory=dict)

    def parts(self) -> Iterator[RenderableType]:
        """The text of the profiles, part by part."""
        if self.moved:
            most = max(self.moved, key=lambda name: abs(self.moved[name]))
            yield (
                f"The fit was not at its optimum: when it was optimised again, {most} moved by "
                f"{number(abs(self.moved[most]), 2)} sd. Fit again.\n"
            )
        yield _table(self.fit, self.found, self.confidence)
        yield f"\n{NOISE_ALONE}"
        for name, one in self.found.items():
            if one.profile.at_a_better_optimum or not one.profile.settled:
                yield one.profile.about(name, self.fit.model[name].unit)
        if self.missed:
            yield f"\ninterrupted before {', '.join(self.missed)}"

    def summary(self) -> str:
        """The text that `greybox profile` prints."""
        return as_text(self.parts())

    def to_pandas(self) -> pd.DataFrame:
        """All profiles point by point: value, rise of the objective, and the rise at which the interval ends, with
        model error and for noise alone.
        """
        tables = [
            pd.DataFrame(
                {
                    "parameter": name,
                    "value": o.values,
                    "rise": o.rise,
                    "allowed": o.allowed,
                    "allowed_noise_alone": o.noise_alone.allowed,
                }
            )
            for name, o in ((name, one.profile) for name, one in self.found.items())
        ]
        return pd.concat(tables, ignore_index=True)

    def save(self, path: Path) -> Path:
        """Write the curves as .csv or .parquet."""
        write_table(self.to_pandas(), path, WORDS)
        return path

    def as_dict(self) -> dict[str, Any]:
        """The profiles as plain data."""
        return {
            "model": self.fit.model.name,
            "confidence": self.confidence,
            "interrupted": bool(self.missed),
            "moved": dict(self.moved),
            "profiles": {name: _as_dict(self.fit, name, item) for name, item in self.found.items()},
        }


@understood
def profile(
    fit: Fit,
    parameter: str,
    recordings: Recordings | None = None,
    *,
    confidence: float = 0.95,
    columns: Columns = "canonical",
) -> Profile:
    """Profile likelihood of one parameter of a fit, with all others re-optimised.

    Parameters
    ----------
    fit : of equations of motion, or of a model with memory, whose physical parameters have profiles.
    parameter : a free one that is common to all runs.
    recordings : training recordings; a fit from `gb.fit` or `gb.load` has them.
    confidence : of the interval, between 0 and 1.
    columns : column map for files.

    Returns
    -------
    Profile
        `interval` in the parameter's SI unit, which includes model error like the fit's interval; `noise_alone`, the
        interval without it; `values` (k,) along the profile, and `rise` (k,) of the objective there, which ends the
        interval at `allowed`; `ends`, how each side ends; `about(name, unit)`, all of it in words.

    Raises
    ------
    BadInput : if the parameter is unknown or was fixed, or a recording is not the one that was fitted.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 400)
    >>> fit = gb.fit("kinematic", lap, vehicle="roboracer")
    >>> found = gb.profile(fit, "yaw_lag")
    >>> bool(found.interval[0] < fit.params["yaw_lag"] < found.interval[1])
    True
    """
    if not isinstance(parameter, str):
        raise BadInput(f"parameter: the name of one parameter is needed, not {parameter!r:.60}.")
    given.must_be_share(confidence, "confidence")
    profiled(fit, [parameter])  # report a wrong name before reading recordings
    read = given.seen_by(fit, recordings, columns)
    return profiles(fit, [parameter], read, confidence).found[parameter].profile


def profiles(
    fit: Fit,
    names: Sequence[str],
    recordings: Sequence[Recording],
    confidence: float = 0.95,
    jobs: int = 1,
    say: Say = quiet,
) -> Profiles:
    """Profiles of several parameters in `jobs` parallel processes; Ctrl-C keeps the finished ones."""
    problem, solution = restated(fit, matched(trained(fit), recordings))
    uncertainties = uncertainty(problem, solution.x, solution.nodes)
    away, pace, finished = apart(len(names), jobs), Pace(len(names)), itertools.count(1)

    def work(k: int) -> ProfileBeside:
        if not away:
            say(f"{names[k]}: profile {k + 1} of {len(names)}{pace.left(k)}", passing=True)
        at = place(problem, fit.model, names[k])
        ratio = wider(fit, names[k], float(uncertainties.sd[at]))
        value = profile_one(
            problem, solution.x, solution.nodes, at, known=uncertainties, confidence=confidence, wider=ratio
        )
        intervals = (uncertainties.interval(confidence, one)[at] for one in (ratio, 1.0))
        both, noise = ((float(low), float(high)) for low, high in intervals)
        return ProfileBeside(value, both, ratio * float(uncertainties.sd[at]), noise, float(uncertainties.sd[at]))

    def done_with(k: int, profile_beside: ProfileBeside) -> bool:
        del profile_beside
        done = next(finished)
        say(f"{names[k]}: done, {done} of {len(names)}{pace.left(done)}", passing=True)
        return True

    done = side_by_side(work, len(names), jobs, done_with)
    result = {names[k]: done.by_number[k] for k in sorted(done.by_number)}
    missed = [name for name in names if name not in result]
    return Profiles(fit, confidence, result, missed, _moved(fit, problem, solution, uncertainties))


def profiles_target(out: str) -> Path:
    """The file for profiles. Raises `BadInput` for another kind of file."""
    return claimed_table(out, WORDS, PLAIN)


def trained(fit: Fit) -> Fit:
    """The fit with records of its training recordings only."""
    return replace(fit, data=tuple(record for record in fit.data if record.role == "train"))


def _moved(fit: Fit, problem: LeastSquares, solution: Solution, known: Uncertainty) -> dict[str, float]:
    """Parameters that a new optimisation from the fit moves, and their distances in standard deviations."""
    result = {}
    for parameter in fit.model.parameters:
        if parameter.shape == () and not parameter.fixed and parameter.scope == "model":
            at = place(problem, fit.model, parameter.name)
            if np.isfinite(known.sd[at]) and known.sd[at] > 0:
                result[parameter.name] = float((solution.x[at] - float(parameter.array)) / known.sd[at])
    return {name: away for name, away in result.items() if abs(away) > MOVED}


def _table(fit: Fit, result: Mapping[str, ProfileBeside], confidence: float) -> Table:
    level = f"{100 * confidence:g} %"
    noise = f"{level} by profile, noise alone"
    table = plain_table("parameter", "estimate", f"{level} by covariance", f"{level} by profile", noise, "unit", "")
    for name, one in result.items():
        value = fit.model[name]
        table.add_row(
            name, estimate(float(value.array), one.sd), _interval(one.wald, one.sd),
            _interval(one.profile.interval, one.sd), _interval(one.profile.noise_alone.interval, one.noise_sd),
            pretty_unit(value.unit), _status(one.profile),
        )  # fmt: skip
    return table


def _interval(ends: tuple[float, float], sd: float) -> str:
    """An interval, whose ends may be infinite."""
    if all(math.isfinite(end) for end in (*ends, sd)) and sd > 0:
        return interval(*ends, sd)
    return f"[{number(ends[0])}, {number(ends[1])}]"


def _status(profile: Profile) -> str:
    """Notes on a profile: sides that the recording does not limit."""
    sides = [f"{side} {ENDS[end]}" for side, end in zip(("lower", "upper"), profile.ends, strict=True) if ENDS[end]]
    return "; ".join(sides)


def _as_dict(fit: Fit, name: str, one: ProfileBeside) -> dict[str, Any]:
    profile, noise = one.profile, one.profile.noise_alone
    return {
        "unit": fit.model[name].unit,
        "estimate": float(fit.model[name].array),
        "sd": one.sd,
        "by_covariance": list(one.wald),
        "by_profile": list(profile.interval),
        "ends": [end.value for end in profile.ends],
        "noise_alone": {
            "sd": one.noise_sd,
            "by_covariance": list(one.noise_wald),
            "by_profile": list(noise.interval),
            "ends": [end.value for end in noise.ends],
            "allowed_rise": noise.allowed,
        },
        "identifiable": profile.identifiable,
        "at_a_better_optimum": profile.at_a_better_optimum,
        "settled": profile.settled,
        "about": profile.about(name, fit.model[name].unit),
        "allowed_rise": profile.allowed,
        "values": profile.values.tolist(),
        "rise": profile.rise.tolist(),
    }
