"""A fit as text: verdict, data, optimum, parameters with intervals, errors; and as one JSON object."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.table import Table

from ...fit import Fit
from ...hybrid_model import HybridModel
from ...memory_model import MemoryModel
from ...motion_model import MotionModel
from ...numbers import counted, interval, number, percent, pretty_unit, with_sd
from ...parameter import Parameter, Prior
from ...provenance import DataRecord, Stage
from ...scores.metrics import FREE_RUN
from ...signals import unit_of
from ...uncertainty.identifiability import absent, told_together
from ...verdict import Verdict
from .screen import led, plain, plain_table

MS = 1e3
NEGLIGIBLE = 1e-6
"""Share of an objective that is not worth telling."""


def timing_lines(timing: Mapping[str, Any]) -> Iterator[str]:
    """A line for each run: the delay of each output against the inputs, with its standard deviation.

    Parameters
    ----------
    timing : what `greybox_id.scores.timing.Timing.as_dict` gives.
    """
    seconds = timing["seconds"]
    told = "" if seconds is None else f", told by its first {seconds:g} s of motion"
    for run, outputs in timing["runs"].items():
        said = ", ".join(f"{name} {_late(own['delay'], own['sd'])}" for name, own in outputs.items())
        yield f"run {run}: {said}{told}"


def _late(delay: float, sd: float) -> str:
    if abs(MS * delay) < 0.5:
        return f"0 ± {MS * sd:.0f} ms"
    return f"{abs(MS * delay):.0f} ± {MS * sd:.0f} ms {'late' if delay > 0 else 'early'}"


SAME = 0.01
"""Starts whose objectives differ by less than this share of the best ended alike."""
MOST_OPEN = 4
"""Sentences printed on what the recording leaves open."""
PROTOCOL_WORDS = {
    "honest": "one sample ahead, pooled, no window across a join",
    "published": "as published: batches of 100, windows across joins",
    "closed_loop": "free run on own predictions, pooled",
    "free run": "free run of whole manoeuvres, pooled",
}
"""Protocol of a model with memory -> what is done under it."""


def parts(result: Fit, vehicle: str = "") -> Iterator[RenderableType]:
    """What a fit says, part by part.

    Parameters
    ----------
    result : the fit.
    vehicle : name of the vehicle it started from.
    """
    motion = isinstance(result.model, MotionModel)
    noise = result.stages[-1].noise if result.stages else {}
    if result.verdict is not None:
        yield verdict_table(result.verdict)
        yield ""
    for record in result.data:
        yield f"{'data' if record.role == 'train' else 'held out':9}{_recorded(record)}"
    if vehicle:
        yield f"vehicle  {vehicle}"
    for stage in result.stages:
        yield from _stage(result, stage, motion)
    if isinstance(result.model, HybridModel):
        yield f"stopped  by {', '.join(result.how['stopped_by'])}, held out; {_over_windows(result)}"
    elif not motion:
        strengths = ", ".join(f"{k} {v:g}" for s in result.stages if not s.closed_loop for k, v in s.strengths.items())
        yield f"priors   strengths {strengths or 'as stated'} ({result.mode})"
    if any(p.shape == () for p in result.model.parameters):
        yield ""
        yield from _parameters(result)
    yield ""
    for sentence in result.model.together:
        yield f"together {sentence}"
    if motion:
        yield motion_errors_table(result.metrics, noise, _held_out(result.data))
    else:
        yield ""
        yield errors_table(result.metrics)
    if "validate" in result.how.get("timing", {}):
        yield ""
        for line in timing_lines(result.how["timing"]["validate"]):
            yield led("timing", f"held out, {line}; readings against the inputs, compared with the training data")


def verdict_table(verdict: Verdict) -> Table:
    """A verdict: the word, and a line for each reason."""
    lines = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False, show_header=False)
    lines.add_column(min_width=8)
    lines.add_row("verdict", verdict.usability)
    for reason in verdict.reasons:
        lines.add_row("", reason)
    return lines


def as_dict(result: Fit) -> dict[str, Any]:
    """The fit as one JSON object: metrics, CPU time, sizes, how it was chosen."""
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
        "together": body["together"],
        "per_run": body["per_run"],
        "data": body["data"],
        "seed": result.seed,
        "version": result.version,
    }
    if isinstance(result.model, MotionModel):
        covariance = body["covariance"]
        return common | {
            "parameters": body["parameters"],
            "free": [p.name for p in result.model.parameters if not p.fixed],
            "combinations": body["combinations"],
            "covariance": covariance,
            "correlation": None if covariance is None else _correlation(covariance),
            "open": told_together(result),
            "how": body["how"],
            "noise": dict(result.stages[-1].noise),
        }
    parts = result.model.parts if isinstance(result.model, MemoryModel) else ()
    common |= {"timing": result.how["timing"]} if "timing" in result.how else {}
    return common | {
        "parameters": {_key(part.name, False): part.size for part in parts or (result.model,)}
        | ({"full": result.model.size} if parts else {}),
        "physical": {p.name: body["parameters"][p.name] for p in result.model.parameters if p.shape == ()},
    }


def motion_errors_table(
    metrics: Mapping[str, Any],
    noise: Mapping[str, float] | None = None,
    names: Mapping[str, str] | None = None,
    beside: Mapping[str, Any] | None = None,
) -> Table:
    """Errors by horizon: a row for each output of each recording, each error with its standard error.

    Parameters
    ----------
    metrics : role or recording -> protocol -> output -> error.
    noise : output -> standard deviation of the residuals, for a last column.
    names : what to call a role.
    beside : errors of holding the last reading, laid out as `metrics`; shown below each row.
    """
    protocols = list(dict.fromkeys(p for of_role in metrics.values() for p in of_role))
    protocols.sort(key=lambda name: name == FREE_RUN)
    shown = [*(name.removesuffix(" ahead") for name in protocols), *(["residual sd"] if noise else [])]
    table = plain_table("RMSE", *shown, right=shown)
    for role, of_role in metrics.items():
        table.add_row((names or {}).get(role, role), style="dim")
        for output in dict.fromkeys(o for errors in of_role.values() for o in errors):
            cells = [_error(of_role.get(p, {}).get(output)) for p in protocols]
            last = [number(noise[output], 2) if output in noise else ""] if noise else []
            table.add_row(f"{output} [{pretty_unit(unit_of(output))}]", *cells, *last)
            held = (beside or {}).get(role, {})
            if held:
                cells = [_error(held.get(p, {}).get(output)) for p in protocols]
                table.add_row("  persistence", *cells, style="dim")
    return table


def _stage(result: Fit, stage: Stage, motion: bool) -> Iterator[str]:
    if motion:
        free = sum(p.size for p in result.model.parameters if not p.fixed)
        horizon = result.how.get("horizon")
        what = f"{counted(free, 'free parameter')}, {'whole runs' if horizon is None else f'{horizon:g} s ahead'}"
    else:
        what = "closed loop" if stage.closed_loop else ""
    name = ", ".join(filter(None, (stage.model, what)))
    yield f"fit      {name}: {counted(stage.steps, 'step')}, {stage.cpu_seconds:.2f} s; {stage.status}"
    if stage.certificate is not None:
        c = stage.certificate
        ended = f"{c.status}, {counted(c.iterations, 'iteration')}"
        better = f"objective {percent(c.gained)} lower" if c.gained > NEGLIGIBLE else "objective no lower"
        confirmed = "certified" if c.confirmed else "not certified"
        yield f"{confirmed} by Ipopt: {ended}, {better}, gradient {c.gradient:.1e}"
    for number_of, words in enumerate(stage.fallbacks):
        yield f"{'' if number_of else 'instead':9}{words}"
    if motion and len(stage.starts) > 1:
        yield f"starts   {_starts(stage.starts)}"


def _parameters(result: Fit) -> Iterator[RenderableType]:
    parameters = [p for p in result.model.parameters if p.shape == ()]
    free = [p for p in parameters if not p.fixed]
    if free:
        yield _free(result, free)
    lines = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False, show_header=False)
    lines.add_column(min_width=8)
    held = [p for p in parameters if p.fixed]
    known = [f"{p.name} = {plain(float(p.array))} {_unit_word(p)}".strip() for p in held if float(p.array)]
    nothing = [p.name for p in held if not float(p.array)]
    if known:
        lines.add_row("held", ", ".join(known))
    if nothing:
        lines.add_row("at zero", ", ".join(nothing))
    for name, values in result.per_run.items():
        if result.model[name].shape == () and len(values) > 1:
            own = pretty_unit(result.model[name].unit)
            lines.add_row("by run", f"{name}: {', '.join(number(float(value)) for value in values)} {own}")
    if lines.row_count:
        yield ""
        yield lines
    told = [c for c in result.combined() if math.isfinite(c.sd) and c.sd > 0]
    if told:
        table = plain_table("identifiable combination", "estimate", "95 % interval", "unit", "")
        for c in told:
            table.add_row(c.name, with_sd(c.value, c.sd), interval(c.low, c.high, c.sd), pretty_unit(c.unit), c.about)
        yield ""
        yield table
    sentences = told_together(result)
    if sentences:
        yield ""
    for sentence in sentences[:MOST_OPEN]:
        yield f"open     {sentence}"
    if len(sentences) > MOST_OPEN:
        yield f"         and {len(sentences) - MOST_OPEN} more"


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
    """An estimate to as many digits as its standard deviation leaves it."""
    if not (math.isfinite(sd) and sd > 0.0):
        return number(value, 4)
    shown = with_sd(value, sd)
    power = shown[shown.index(")") + 1 :] if shown.startswith("(") else ""
    return shown.partition(" ± ")[0].removeprefix("(") + power


def _unit_word(parameter: Parameter) -> str:
    return "" if parameter.unit == "1" else pretty_unit(parameter.unit)


def _prior(parameter: Parameter, prior: Prior) -> str:
    """What was believed of a number: mean and standard deviation."""
    mean = parameter.array if prior.mean is None else np.asarray(prior.mean, dtype=float)
    return with_sd(float(mean), float(np.asarray(prior.sd)))


def _recorded(record: DataRecord) -> str:
    """A recording in one line: runs, duration, rate, samples."""
    steps = record.samples - record.runs
    rate = f" at {steps / record.duration:.4g} Hz" if record.duration > 0 else ""
    runs = f"{counted(record.runs, 'run')}, {record.duration:.1f} s{rate}"
    return f"{record.name}: {runs}, {counted(record.samples, 'sample')}"


def _held_out(data: Sequence[DataRecord]) -> dict[str, str]:
    """What the rows of an error table are headed with."""
    names = {role: [record.name for record in data if record.role == role] for role in ("train", "validate")}
    trained = ", ".join(names["train"]) if len(names["train"]) < 4 else counted(len(names["train"]), "recording")
    return {"train": f"train ({trained})", "validate": f"held out ({', '.join(names['validate'])})"}


def _over_windows(result: Fit) -> str:
    """The paper's loss, Eq. 13, in units of noise."""
    trained, held_out = result.how["errors_over_windows"]
    return f"RMSSE over windows {trained:.3f} of the noise, held out {held_out:.3f}"


def _starts(objectives: Sequence[float]) -> str:
    """How far apart fits from several starting points ended."""
    best, worst = min(objectives), max(objectives)
    alike = sum(objective <= best * (1 + SAME) for objective in objectives)
    if alike == len(objectives):
        return f"all {alike} starts ended at the same objective, {number(best, 4)}"
    spread = f"the others between it and {number(worst, 4)}" if len(objectives) - alike > 1 else number(worst, 4)
    return f"{alike} of {len(objectives)} starts ended at the best objective, {number(best, 4)}; {spread}"


def _error(error: Mapping[str, float] | None) -> str:
    if error is None:
        return "–"
    if error.get("diverges") or not math.isfinite(error["rmse"] if error["rmse"] is not None else math.inf):
        return "diverges"
    return with_sd(error["rmse"], error["rmse_sd"])


def _correlation(covariance: Mapping[str, Any]) -> dict[str, Any]:
    """Correlations of the numbers whose covariance is given."""
    matrix = np.asarray(covariance["matrix"], dtype=float).reshape(len(covariance["names"]), -1)
    sd = np.sqrt(np.diag(matrix))
    with np.errstate(divide="ignore", invalid="ignore"):
        return {"names": covariance["names"], "matrix": (matrix / np.outer(sd, sd)).tolist()}


def _key(model: str, closed_loop: bool) -> str:
    return "full" if closed_loop else model.removeprefix("msnn_")


def errors_table(metrics: Mapping[str, Any]) -> Table:
    """Errors by recording, protocol and output, each with its standard error and unit."""
    table = plain_table("error", "protocol", "RMSE", "unit", "FVU", right=("RMSE", "FVU"))
    for role, protocols in metrics.items():
        for protocol, outputs in protocols.items():
            for name, error in outputs.items():
                sd = error["rmse_sd"]
                rmse = f"{error['rmse']:.4f} ± " + (f"{sd:.4f}" if math.isfinite(sd) else "–")
                fvu, unit = f"{error['fvu']:.4f}", pretty_unit(unit_of(name))
                if not math.isfinite(error["rmse"]):
                    rmse, fvu = "diverges", "–"
                table.add_row(f"{role} {name}", PROTOCOL_WORDS.get(protocol, protocol), rmse, unit, fvu)
    return table
