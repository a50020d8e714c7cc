"""A fit as text: verdict, data, optimum, parameters with intervals, errors; and as a JSON object."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.table import Table

from ...base.numbers import counted, interval, number, percent, pretty_unit, with_sd, with_unit
from ...base.signals import unit_of
from ...fitting.fit import Fit, Verdict
from ...fitting.provenance import DataRecord, Stage
from ...fitting.uncertainty.identifiability import absent, combination_sentences
from ...models.model import Model, by_kind
from ...models.parameter import Parameter, Prior
from .screen import plain, plain_table

NEGLIGIBLE = 1e-6
"""Relative change of the objective that is not mentioned."""


MOST_NAMED = 6
"""Most estimates that are named in the line of the verdict."""
MOST_OPEN = 4
"""Most sentences on parameters that are not identifiable."""
PROTOCOL_WORDS = {
    "honest": "one sample ahead, all runs together; no window spans two runs",
    "published": "as in the papers: mean over batches of 100; windows may span two runs",
    "closed_loop": "free run on its own predictions, all runs together",
    "free run": "free run of whole manoeuvres, all together",
}
"""Protocol of a model with memory -> its definition."""


def parts(result: Fit, vehicle: str = "") -> Iterator[RenderableType]:
    """The text of a fit, part by part.

    Parameters
    ----------
    result : the fit.
    vehicle : name of the vehicle with the initial values.
    """
    if result.verdict is not None:
        yield verdict_table(result.verdict, _from_prior(result))
        yield ""
    for record in result.data:
        yield f"{'data' if record.role == 'train' else 'held out':9}{_recorded(record)}"
    if vehicle:
        yield f"vehicle  {vehicle}"
    for stage in result.stages:
        yield from stage_lines(result.model, result, stage)
    yield from chosen_lines(result.model, result)
    if any(p.shape == () for p in result.model.parameters):
        yield ""
        yield from _parameters(result)
    yield ""
    for sentence in result.model.together:
        yield f"note     {sentence}"
    yield from error_parts(result.model, result)


@by_kind
def stage_lines(model: Model, result: Fit, stage: Stage) -> Iterator[str]:
    """Lines on a stage of a fit."""
    return solver_lines(stage, "closed loop" if stage.closed_loop else "")


def solver_lines(stage: Stage, what: str) -> Iterator[str]:
    """Steps and time of a stage, Ipopt's certificate, and what was tried instead if the stage failed."""
    name = ", ".join(filter(None, (stage.model, what)))
    yield f"fit      {name}: {counted(stage.steps, 'step')}, {stage.cpu_seconds:.2f} s; {stage.status}"
    if stage.certificate is not None:
        c = stage.certificate
        ended = f"{c.status}, {counted(c.iterations, 'iteration')}"
        better = f"objective {percent(c.gained)} lower than before" if c.gained > NEGLIGIBLE else "objective unchanged"
        confirmed = "confirmed" if c.confirmed else "not confirmed"
        yield f"optimum  {confirmed} by Ipopt: {ended}, {better}, gradient {c.gradient:.1e}"
    for number_of, words in enumerate(stage.fallbacks):
        yield f"{'' if number_of else 'tried':9}{words}"


@by_kind
def chosen_lines(model: Model, result: Fit) -> Iterator[str]:
    """Lines on how overfitting was avoided."""
    if "stopped_by" in result.how:
        trained, held_out = result.how["errors_over_windows"]  # the paper's loss, Eq. 13, in units of noise
        windows = (
            f"RMS error over windows, divided by the noise: {trained:.3f} on training data, {held_out:.3f} on "
            "held-out data"
        )
        yield f"stopped  by {', '.join(result.how['stopped_by'])}, held out; {windows}"


@by_kind
def error_parts(model: Model, result: Fit) -> Iterator[RenderableType]:
    """Errors of the fit."""
    yield ""
    yield errors_table(result.metrics, model.unit)


def _from_prior(result: Fit) -> str:
    """Estimates that are determined by their prior more than by data, as the end of the verdict's line."""
    names, free = result.from_prior, [p for p in result.model.parameters if p.shape == () and not p.fixed]
    if not names:
        return ""
    listed = ", ".join(names[:MOST_NAMED]) + (f" and {len(names) - MOST_NAMED} more" if names[MOST_NAMED:] else "")
    are, priors = ("is", "its prior") if len(names) == 1 else ("are", "their priors")
    return f"; {len(names)} of {counted(len(free), 'estimate')} {are} hardly more precise than {priors}: {listed}"


def verdict_table(verdict: Verdict, more: str = "") -> Table:
    """A verdict with additional words, and a line per reason."""
    lines = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False, show_header=False)
    lines.add_column(min_width=8)
    lines.add_row("verdict", f"{verdict.usability}{more}")
    for reason in verdict.reasons:
        lines.add_row("", reason)
    return lines


def as_dict(result: Fit) -> dict[str, Any]:
    """A fit as a JSON object: metrics, CPU time, sizes, how it was selected."""
    seconds = {_key(stage.model, stage.closed_loop): stage.cpu_seconds for stage in result.stages}
    body = result.as_dict()
    common = {
        "verdict": body.get("verdict"),
        "reasons": body.get("reasons", []),
        "comparison": body.get("comparison", {}),
        "model": body["model"],
        "mode": result.mode,
        "metrics": body["metrics"],
        "cpu_seconds": seconds | {"cross_validation": sum(s.cross_validation_seconds for s in result.stages)},
        "stages": body["stages"],
        "notes": body["notes"],
        "from_prior": list(result.from_prior),
        "together": body["together"],
        "per_run": body["per_run"],
        "data": body["data"],
        "seed": result.seed,
        "version": result.version,
    }
    return common | more_data(result.model, result, body)


@by_kind
def more_data(model: Model, result: Fit, body: Mapping[str, Any]) -> dict[str, Any]:
    """Further entries of the JSON object for a kind of model; `body` is the content of the fit's file."""
    parts = model.parts or (model,)
    return {
        "parameters": {_key(part.name, False): part.size for part in parts}
        | ({"full": model.size} if model.parts else {}),
        "physical": {p.name: body["parameters"][p.name] for p in model.parameters if p.shape == ()},
        **({"timing": result.how["timing"]} if "timing" in result.how else {}),
    }


def _parameters(result: Fit) -> Iterator[RenderableType]:
    parameters = [p for p in result.model.parameters if p.shape == ()]
    free = [p for p in parameters if not p.fixed]
    if free:
        yield _free(result, free)
    lines = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False, show_header=False)
    lines.add_column(min_width=8)
    fixed = [p for p in parameters if p.fixed]
    nonzero = [f"{p.name} = {with_unit(plain(float(p.array)), p.unit)}" for p in fixed if float(p.array)]
    zero = [p.name for p in fixed if not float(p.array)]
    if nonzero:
        lines.add_row("fixed", ", ".join(nonzero))
    if zero:
        lines.add_row("" if nonzero else "fixed", f"{', '.join(zero)} = 0")
    for name, values in result.per_run.items():
        if result.model[name].shape == () and len(values) > 1:
            unit = pretty_unit(result.model[name].unit)
            lines.add_row("by run", f"{name}: {', '.join(number(float(value)) for value in values)} {unit}")
    if lines.row_count:
        yield ""
        yield lines
    current = [c for c in result.combined() if math.isfinite(c.sd) and c.sd > 0]
    if current:
        table = plain_table("identifiable combination", "estimate", "95 % interval", "unit", "")
        for c in current:
            table.add_row(c.name, with_sd(c.value, c.sd), interval(c.low, c.high, c.sd), pretty_unit(c.unit), c.about)
        yield ""
        yield table
    sentences = combination_sentences(result)
    if sentences:
        yield ""
    for sentence in sentences[:MOST_OPEN]:
        yield f"weak     {sentence}"
    if len(sentences) > MOST_OPEN:
        yield f"         and {len(sentences) - MOST_OPEN} more such combinations"


def _free(result: Fit, parameters: Sequence[Parameter]) -> Table:
    table = plain_table("parameter", "estimate", "95 % interval", "unit", "prior", "note")
    notes = absent(result) | result.notes()
    for p in parameters:
        value, sd = float(p.array), float(result.sd[p.name])
        low, high = (float(end) for end in result.interval(p.name))
        prior = "" if p.prior is None else _prior(p, p.prior)
        note = notes.get(p.name, "")
        table.add_row(p.name, estimate(value, sd), interval(low, high, sd), pretty_unit(p.unit), prior, note)
    return table


def estimate(value: float, sd: float) -> str:
    """An estimate with as many digits as its standard deviation justifies."""
    if not (math.isfinite(sd) and sd > 0.0):
        return number(value, 4)
    shown = with_sd(value, sd)
    power = shown[shown.index(")") + 1 :] if shown.startswith("(") else ""
    return shown.partition(" ± ")[0].removeprefix("(") + power


def _prior(parameter: Parameter, prior: Prior) -> str:
    """Mean and standard deviation of a prior."""
    mean = parameter.array if prior.mean is None else np.asarray(prior.mean, dtype=float)
    return with_sd(float(mean), float(np.asarray(prior.sd)))


def _recorded(record: DataRecord) -> str:
    """A recording in one line: runs, duration, rate, samples."""
    steps = record.samples - record.runs
    rate = f" at {steps / record.duration:.4g} Hz" if record.duration > 0 else ""
    runs = f"{counted(record.runs, 'run')}, {record.duration:.1f} s{rate}"
    return f"{record.name}: {runs}, {counted(record.samples, 'sample')}"


def _key(model: str, closed_loop: bool) -> str:
    return "full" if closed_loop else model.removeprefix("msnn_")


def errors_table(metrics: Mapping[str, Any], unit_of: Callable[[str], str] = unit_of) -> Table:
    """Errors by recording, protocol and output, each with its standard error and unit."""
    table = plain_table("error", "protocol", "RMSE", "unit", "FVU", right=("RMSE", "FVU"))
    for role, protocols in metrics.items():
        for protocol, outputs in protocols.items():
            for name, error in outputs.items():
                sd = error["rmse_sd"]
                rmse = with_sd(error["rmse"], sd)
                fvu, unit = number(error["fvu"]), pretty_unit(unit_of(name))
                if not math.isfinite(error["rmse"]):
                    rmse, fvu = "diverges", "–"
                table.add_row(f"{role} {name}", PROTOCOL_WORDS.get(protocol, protocol), rmse, unit, fvu)
    return table
