"""Tables of single numbers, which have a physical meaning: estimates, intervals, priors, and what to know of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..fit import Fit
from ..parameter import Parameter
from .document import Table
from .numbers import interval, number, pretty_unit, with_sd

HEAD = ("parameter", "meaning", "estimate ± sd", "95 % interval", "unit", "prior", "note")


def scalars(fit: Fit, parameters: Sequence[Parameter] | None = None, notes: dict[str, str] | None = None) -> Table:
    """Estimates of single numbers.

    Parameters
    ----------
    fit : the fit.
    parameters : which of them; all by default.
    notes : name -> what to know of it besides what the fit itself notes.
    """
    chosen = fit.model.parameters if parameters is None else parameters
    said = fit.notes()
    rows = [
        _row(fit, p, [words[p.name] for words in (said, notes or {}) if p.name in words]) for p in chosen if not p.shape
    ]
    return Table(HEAD, tuple(rows), "lLrrllL")


def _row(fit: Fit, parameter: Parameter, notes: list[str]) -> tuple[str, ...]:
    value = float(parameter.array)
    sd = 0.0 if parameter.fixed else float(np.ravel(fit.sd.get(parameter.name, 0.0))[0])
    low, high = (float(end) for end in fit.interval(parameter.name))
    if parameter.scope == "run" and parameter.name in fit.per_run:
        runs = ", ".join(number(float(value)) for value in np.ravel(fit.per_run[parameter.name]))
        notes = [*notes, f"one per training run: {runs}; the estimate is what new runs get"]
    return (
        parameter.name, parameter.about, with_sd(value, sd), interval(low, high, sd),
        pretty_unit(parameter.unit), "held" if parameter.fixed else believed(parameter), "; ".join(notes),
    )  # fmt: skip


def believed(parameter: Parameter) -> str:
    """What was believed of a number before: mean and standard deviation."""
    prior = parameter.prior
    if prior is None:
        return "none"
    mean = parameter.array if prior.mean is None else np.asarray(prior.mean, dtype=float)
    return with_sd(float(np.ravel(mean)[0]), float(np.max(np.asarray(prior.sd, dtype=float))))
