"""How a fit was found: steps, starts, and Ipopt's word, as a table and as clauses of a verdict."""

from __future__ import annotations

from collections.abc import Callable

from ..fit import Fit
from ..provenance import Stage
from .document import Table
from .figures.starts import same_as_best, spread_of
from .numbers import counted, number, percent

MOST_STARTS, LEAST_OFF = 12, 0.01
"""Starts that have a row; standard deviations from which on an end is off."""
NOTHING = 1e-6
"""Below this share, a difference of objectives counts as none."""


def stages(fit: Fit, name: Callable[[Stage], str]) -> Table:
    """Every stage, called what `name` calls it, with how it ended."""
    head = ("stage", "how it ended", "steps", "CPU", "objective", "starts", "Ipopt")
    rows = tuple(
        (
            name(stage), stage.status, str(stage.steps),
            f"{stage.cpu_seconds:.1f} s" + (f" + {stage.cross_validation_seconds:.1f} s" if stage.tried else ""),
            number(stage.certificate.objective_after if stage.certificate else stage.starts[0], 6),
            _starts(stage), _ipopt(stage),
        )
        for stage in fit.stages
    )  # fmt: skip
    return Table(head, rows, "LLrrrLL")


def starts(fit: Fit, stage: Stage) -> Table:
    """Every start: how it compares, and the number that ended furthest from the estimate."""
    spread = spread_of(fit, stage)
    if not spread:
        return Table((), ())
    best, rows = min(stage.starts), []
    for k, objective in enumerate(stage.starts[:MOST_STARTS]):
        name = max(spread, key=lambda own: abs(spread[own][k][0]))
        above = (objective - best) / abs(best) if best else float("nan")
        off = spread[name][k][0]
        where = (name, f"{number(off, 2)} sd") if abs(off) >= LEAST_OFF else ("–", "–")
        rows.append((str(k + 1), number(objective, 6), percent(above) if above > NOTHING else "–", *where))
    head = ("start", "objective", "above the best", "furthest off", "by")
    return Table(head, tuple(rows), "lrrlr")


def ended(stage: Stage) -> str:
    """Whether the solver converged, as a clause."""
    steps = f"after {stage.steps} step{'s' if stage.steps != 1 else ''}"
    if stage.converged:
        return f"the solver converged {steps}"
    return f"the solver did not converge {steps} ({stage.status.rstrip('.')})"


def ipopt_words(stage: Stage) -> str:
    """Whether Ipopt confirmed the optimum, as a clause."""
    verdict = stage.certificate
    if verdict is None:
        return "Ipopt was not asked to confirm the optimum"
    if verdict.confirmed:
        return "Ipopt confirmed the optimum on the same problem"
    better = (
        f"finding {percent(verdict.gained)} less in the objective"
        if verdict.gained > NOTHING
        else "finding nothing better"
    )
    return f"Ipopt did not confirm the optimum: it ended with “{verdict.status}”, {better}"


def _starts(stage: Stage) -> str:
    if len(stage.starts) < 2:
        return "1"
    best, same = min(stage.starts), sum(same_as_best(stage))
    spread = (max(stage.starts) - best) / abs(best) if best else float("nan")
    words = f"{same} of {len(stage.starts)} the same"
    return f"{words}; worst {percent(spread)} above" if spread > NOTHING else words


def _ipopt(stage: Stage) -> str:
    certificate = stage.certificate
    if certificate is None:
        return "not asked"
    word = "confirmed" if certificate.confirmed else "not confirmed"
    gain = (certificate.objective_before - certificate.objective_after) / certificate.objective_before
    return (
        f"{word}: {certificate.status}, {counted(certificate.iterations, 'iteration')}, objective "
        f"{'−' + percent(gain) if gain > NOTHING else 'unchanged'}, gradient {number(certificate.gradient, 2)}, "
        f"{certificate.cpu_seconds:.1f} s"
    )
