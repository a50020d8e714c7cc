"""Tables 1 to 3 of the paper on model-structured neural networks, measured anew.

Source: Mungiello et al., "Vehicle dynamics learning from physics priors with model-structured neural networks".
Two protocols stand beside each other.

published : the authors' rules. Batches of 100 windows in order, laid across joins; the loss is the mean of the batches'
    root mean squares, as they train; what is chosen (how strongly priors hold, when training stops) is chosen on
    valid.csv, on which their structures, their stopping and their figures were. FVU as their validator forms it.
    Table 3: the whole new file is adapted to and scored, pooled.
honest : nothing is chosen on what is scored; windows cross no join; all samples pooled, with a standard error. Table 3:
    the first 20 s of motion are adapted to, what follows is scored.

The recording with 10 % more mass is not public; `single_mass.csv` stands in its place.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from greybox_id.base.shorthands import Array
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording
from greybox_id.engine.shooting import Problem
from greybox_id.engine.simulation import Prediction
from greybox_id.engine.solvers.gauss_newton import Status, gauss_newton
from greybox_id.engine.trace import Trace
from greybox_id.fitting.adaptation.memory import tuned_in_sample
from greybox_id.fitting.adaptation.verb import Adaptation, adapt
from greybox_id.fitting.fit import Fit
from greybox_id.fitting.grid import Grid, fit_grid
from greybox_id.fitting.how import FitOptions, Say, quiet
from greybox_id.fitting.scores.memory import BATCH, Protocol, errors, predictions
from greybox_id.fitting.scores.metrics import Error
from greybox_id.fitting.scores.timing import CALIBRATED, calibrated_errors, calibrated_timing, calibration_words
from greybox_id.fitting.steps import MOST_STEPS, fit_briefly
from greybox_id.fitting.verb import fit
from greybox_id.models.memory_model import MemoryModel
from greybox_id.models.model import Model, must_be
from greybox_id.models.registry import candidates, prepared
from greybox_id.reports.comparison import paired

from .bench import must_be_folder

Row = dict[str, Any]

ABLATION_1 = {"transient_over_a_x": False}
ABLATION_2 = {"transient_over_a_x": False, "steady_over_a_x": False}
ABLATION_3 = {"lateral_force": False}


@dataclass(frozen=True)
class PaperModel:
    """A model of a table.

    Attributes
    ----------
    name : as the paper calls it.
    model, settings : ours.
    tables : output -> table.
    shares : of the training data, percent, that it is fitted to.
    """

    name: str
    model: str
    settings: Mapping[str, Any]
    tables: Mapping[str, int]
    shares: Sequence[int] = (100, 80, 60)


ENTRIES = (
    PaperModel("MS-NN-bench", "msnn_bench_lat", {}, {"yaw_rate": 1}),
    PaperModel("Ablation 1", "msnn_lat", ABLATION_1, {"yaw_rate": 1}),
    PaperModel("Ablation 2", "msnn_lat", ABLATION_2, {"yaw_rate": 1}),
    PaperModel("MS-NN-full", "msnn_lat", {}, {"yaw_rate": 1}),
    PaperModel("MS-NN-bench", "msnn_bench_long", {}, {"a_x": 2}, (100,)),
    PaperModel("Ablation 3", "msnn_long", ABLATION_3, {"a_x": 2}, (100,)),
    PaperModel("MS-NN-full", "msnn_long", {}, {"a_x": 2}, (100,)),
    PaperModel("G-NN", "gnn", {}, {"yaw_rate": 1, "a_x": 2}),
)
PAPER: Mapping[tuple[str, str, int, str], tuple[float, float]] = {
    ("G-NN", "yaw_rate", 100, "train"): (0.102, 0.022), ("G-NN", "yaw_rate", 100, "valid"): (0.142, 0.053),
    ("G-NN", "yaw_rate", 80, "train"): (0.135, 0.030), ("G-NN", "yaw_rate", 80, "valid"): (0.172, 0.072),
    ("G-NN", "yaw_rate", 60, "train"): (0.134, 0.037), ("G-NN", "yaw_rate", 60, "valid"): (0.224, 0.155),
    ("MS-NN-bench", "yaw_rate", 100, "train"): (0.147, 0.056),
    ("MS-NN-bench", "yaw_rate", 100, "valid"): (0.154, 0.060),
    ("MS-NN-bench", "yaw_rate", 80, "train"): (0.159, 0.059), ("MS-NN-bench", "yaw_rate", 80, "valid"): (0.158, 0.063),
    ("MS-NN-bench", "yaw_rate", 60, "train"): (0.181, 0.088), ("MS-NN-bench", "yaw_rate", 60, "valid"): (0.181, 0.066),
    ("Ablation 1", "yaw_rate", 100, "train"): (0.081, 0.014), ("Ablation 1", "yaw_rate", 100, "valid"): (0.122, 0.033),
    ("Ablation 1", "yaw_rate", 80, "train"): (0.079, 0.012), ("Ablation 1", "yaw_rate", 80, "valid"): (0.110, 0.032),
    ("Ablation 1", "yaw_rate", 60, "train"): (0.088, 0.019), ("Ablation 1", "yaw_rate", 60, "valid"): (0.134, 0.053),
    ("Ablation 2", "yaw_rate", 100, "train"): (0.085, 0.016), ("Ablation 2", "yaw_rate", 100, "valid"): (0.116, 0.036),
    ("Ablation 2", "yaw_rate", 80, "train"): (0.084, 0.014), ("Ablation 2", "yaw_rate", 80, "valid"): (0.116, 0.035),
    ("Ablation 2", "yaw_rate", 60, "train"): (0.094, 0.022), ("Ablation 2", "yaw_rate", 60, "valid"): (0.124, 0.041),
    ("MS-NN-full", "yaw_rate", 100, "train"): (0.076, 0.012), ("MS-NN-full", "yaw_rate", 100, "valid"): (0.109, 0.031),
    ("MS-NN-full", "yaw_rate", 80, "train"): (0.076, 0.012), ("MS-NN-full", "yaw_rate", 80, "valid"): (0.106, 0.030),
    ("MS-NN-full", "yaw_rate", 60, "train"): (0.085, 0.019), ("MS-NN-full", "yaw_rate", 60, "valid"): (0.137, 0.061),
    ("G-NN", "a_x", 100, "train"): (0.348, 0.127), ("G-NN", "a_x", 100, "valid"): (0.530, 0.289),
    ("MS-NN-bench", "a_x", 100, "train"): (0.492, 0.331), ("MS-NN-bench", "a_x", 100, "valid"): (0.615, 0.464),
    ("Ablation 3", "a_x", 100, "train"): (0.398, 0.161), ("Ablation 3", "a_x", 100, "valid"): (0.607, 0.453),
    ("MS-NN-full", "a_x", 100, "train"): (0.328, 0.106), ("MS-NN-full", "a_x", 100, "valid"): (0.521, 0.281),
}  # fmt: skip
"""RMSE and FVU, Tables 1 and 2, by model, output, share of the training data in percent, and split."""

ADAPTED: Mapping[tuple[str, str, str], tuple[float | None, float | None]] = {
    ("tire_set_1", "G-NN", "yaw_rate"): (0.147, 0.107), ("tire_set_1", "G-NN", "a_x"): (0.614, 0.380),
    ("tire_set_1", "MS-NN-bench", "yaw_rate"): (0.102, 0.096), ("tire_set_1", "MS-NN-bench", "a_x"): (0.462, 0.425),
    ("tire_set_1", "MS-NN-full", "yaw_rate"): (0.172, 0.085), ("tire_set_1", "MS-NN-full", "a_x"): (0.531, 0.395),
    ("tire_set_2", "G-NN", "yaw_rate"): (0.110, 0.070), ("tire_set_2", "G-NN", "a_x"): (0.624, 0.368),
    ("tire_set_2", "MS-NN-bench", "yaw_rate"): (0.079, 0.059), ("tire_set_2", "MS-NN-bench", "a_x"): (0.373, 0.347),
    ("tire_set_2", "MS-NN-full", "yaw_rate"): (0.129, 0.053), ("tire_set_2", "MS-NN-full", "a_x"): (0.468, 0.334),
}  # fmt: skip
"""Table 3: RMSE zero-shot and fine-tuned, by recording, model and output. The recording of the third car, with 10 %
more mass, is not public: its variance is that of no public file."""
NEW_CARS = ("tire_set_1", "tire_set_2", "single_mass")
"""Recordings of Table 3, where they are there."""

GRIDS: Mapping[str, Mapping[str, Sequence[int]]] = {
    "msnn_lat": {"n_delta": (5, 6, 7), "n_x": (1, 2, 3, 4), "n_v": (1, 2, 3, 4), "q": (14, 19, 24)},
    "msnn_long": {"eta": (5, 7, 10), "gamma": (14, 19, 24), "n_v": (1, 2, 3, 4), "n_y": (1, 2, 3, 4)},
}
"""Structures of Fig. 7: 144 of each network."""
QUICK_GRIDS: Mapping[str, Mapping[str, Sequence[int]]] = {
    "msnn_lat": {"n_delta": (5,), "n_x": (1, 2, 3), "n_v": (1, 2, 3), "q": (14, 19)},
    "msnn_long": {"eta": (5, 10), "gamma": (14,), "n_v": (2,), "n_y": (1, 2, 3, 4)},
}
"""Some of them about the published ones."""
OURS = "MS-NN-full"
"""What the other models of Tables 1 and 2 are compared with."""
COUPLED: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "msnn_full": ("msnn_full", {}), "msnn_full_plus": ("msnn_full_plus", {}),
    "Ablation 1, coupled": ("msnn_full", {"lat": ABLATION_1}),
    "Ablation 2, coupled": ("msnn_full", {"lat": ABLATION_2}),
    "Ablation 3, coupled": ("msnn_full", {"long": ABLATION_3}),
}  # fmt: skip
"""Networks that read what they predict: model and settings. G-NN and MS-NN-bench have no loop to close."""
PHYSICAL: Mapping[tuple[str, str], Mapping[str, float | None]] = {
    (OURS, "msnn_long"): {"m": None, "c_r": None, "c_l": None, "k_a": -0.65, "I_w": -0.17, "r": -0.27},
    ("MS-NN-bench", "msnn_bench_lat"): {"A": -0.070},
}
"""Parameters with a physical meaning, and what the authors' stored networks have for them, where that is known."""

STRENGTHS = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0)
"""Factors on the priors that the published protocol chooses from on valid.csv."""
REWEIGHTED = 5
"""Times that batches are weighed anew: the loss changes by less than a thousandth in the last."""
WATCHED = 6
"""First steps that are single ones, each looked at on valid.csv: the authors stop where that is best."""


@dataclass(frozen=True)
class MsnnBench:
    """What was measured.

    Attributes
    ----------
    rows : of the tables.
    comparisons : of models on valid.csv, one sample ahead, paired over blocks.
    fits : (name, model) -> fit to the whole training recording under the honest protocol.
    adapted : (car, model) -> its adaptation to the first seconds of a changed car.
    grids : model -> the structures of Fig. 7 that were fitted.
    train, valid : recordings.
    cars : name -> recording of a changed car.
    quick : whether priors were taken as stated, and few structures fitted.
    """

    rows: list[Row]
    comparisons: list[Row]
    fits: Mapping[tuple[str, str], Fit]
    adapted: Mapping[tuple[str, str], Adaptation]
    grids: Mapping[str, Grid]
    train: Recording
    valid: Recording
    cars: Mapping[str, Recording]
    quick: bool


def measure(
    data: Path, *, quick: bool = False, say: Say = quiet, keep: Callable[[list[Row]], None] | None = None
) -> MsnnBench:
    """All rows, and what is drawn of them.

    Parameters
    ----------
    data : folder with train.csv and valid.csv, and with recordings of changed cars.
    quick : priors as stated in the honest protocol, instead of cross-validation.
    keep : called with the rows so far whenever some have come.

    Raises
    ------
    BadInput : a recording is not there or cannot be used.
    """
    must_be_folder(data, "train.csv and valid.csv")
    train, valid = read(data / "train.csv", "roboracer"), read(data / "valid.csv", "roboracer")
    for recording in (train, valid):
        recording.must_run()
    rows: list[Row] = []
    how = FitOptions(strengths=1.0 if quick else "cross-validation", solver="gauss-newton")
    whole: dict[tuple[str, str], Fit] = {}
    with threadpool_limits(1):
        for entry in ENTRIES:
            for share in entry.shares:
                say(f"{entry.name} ({entry.model}), {share} % of train")
                part = train.rows(0, round(len(train) * share / 100))
                rows += _published(entry, share, part, valid)
                honest, result = _honest(entry, share, part, valid, how)
                rows += honest
                if share == 100:
                    whole[entry.name, entry.model] = result
                if keep is not None:
                    keep(rows)
        rows += _closed(train, valid, quick, how, say)
        cars = {car: read(data / f"{car}.csv", "roboracer") for car in NEW_CARS if (data / f"{car}.csv").is_file()}
        adapted: dict[tuple[str, str], Adaptation] = {}
        for car, recording in cars.items():
            say(f"adapting to {car}")
            rows += _adapted(car, recording, whole, train, adapted)
            if keep is not None:
                keep(rows)
    grids = {
        name: fit_grid(name, train, varied, validate=valid, strength=1.0 if quick else None, say=say)
        for name, varied in (QUICK_GRIDS if quick else GRIDS).items()
    }
    return MsnnBench(rows, compared(whole, valid), whole, adapted, grids, train, valid, cars, quick)


def compared(fits: Mapping[tuple[str, str], Fit], valid: Recording) -> list[Row]:
    """Errors of every model of Tables 1 and 2 against those of MS-NN-full at the same rows, by the output."""
    result: list[Row] = []
    for output in ("yaw_rate", "a_x"):
        seen = {
            name: one_output(one.model, valid, output) for (name, _), one in fits.items() if output in one.model.outputs
        }
        ours = seen.pop(OURS, None)
        if ours is None:
            continue
        for name, theirs in seen.items():
            rows, mine, other = np.intersect1d(ours.rows, theirs.rows, return_indices=True)
            runs = np.searchsorted([start for start, _ in valid.runs], rows, side="right").astype(float)
            pair = paired(_errors(ours)[mine], _errors(theirs)[other], runs, valid.sample_time)
            result.append(
                {"output": output, "model": name, "against": OURS, "difference": pair.second - pair.first,
                 "low": pair.low, "high": pair.high, "distinguished": pair.significant, "blocks": pair.blocks}
            )  # fmt: skip
    return result


def one_output(model: Model, recording: Recording, output: str) -> Prediction:
    """Predictions of one output, one sample ahead."""
    seen, k = predictions(must_be(MemoryModel, model), recording), model.outputs.index(output)
    return Prediction(seen.rows, seen.predicted[:, [k]], seen.measured[:, [k]], seen.run)


def _errors(seen: Prediction) -> Array:
    return np.asarray(seen.predicted[:, 0] - seen.measured[:, 0])


def _row(
    table: int | str, model: str, share: int, split: str, protocol: str, output: str, error: Error, *,
    fvu: float, parameters: int, cpu: float, paper: tuple[float | None, float | None] | None,
) -> Row:  # fmt: skip
    return {
        "table": table, "model": model, "share": share, "split": split, "protocol": protocol, "output": output,
        "rmse": error.rmse, "stderr": error.rmse_sd, "fvu": fvu, "paper": None if paper is None else paper[0],
        "paper_fvu": None if paper is None else paper[1], "parameters": parameters, "cpu_seconds": cpu,
    }  # fmt: skip


def _published(entry: PaperModel, share: int, train: Recording, valid: Recording) -> list[Row]:
    clock = time.process_time()
    if len(entry.tables) > 1:  # several outputs: one loss for both, stopped on valid as theirs was
        how = FitOptions(strengths="early stopping", solver="gauss-newton")
        model = must_be(MemoryModel, fit(_memory(entry, train), [train], validate=valid, how=how).model)
    else:
        model = as_the_authors(_memory(entry, train), train, valid)
    spent = time.process_time() - clock
    return _scored(entry, share, "published", model, spent, {"train": train, "valid": valid})


def _scored(
    entry: PaperModel,
    share: int,
    protocol: Protocol,
    model: MemoryModel,
    spent: float,
    recordings: Mapping[str, Recording],
) -> list[Row]:
    """A row for each recording and output, by a protocol."""
    rows = []
    for split, recording in recordings.items():
        result = errors(model, predictions(model, recording, protocol), protocol)
        for output, table in entry.tables.items():
            value = result[output]
            fvu = value.fvu_published if protocol == "published" else value.fvu
            rows.append(
                _row(table, entry.name, share, split, protocol, output, value, fvu=fvu,
                     parameters=model.size, cpu=spent, paper=PAPER.get((entry.name, output, share, split)))
            )  # fmt: skip
    return rows


def as_the_authors(model: MemoryModel, train: Recording, valid: Recording) -> MemoryModel:
    """A model fitted to the authors' loss; stopped, and held to its priors, as is best on the validation recording."""
    trace = Trace(model)
    noise, near, laid = fit_briefly(trace, [train])
    best, least = model, np.inf
    for strength in STRENGTHS:
        named = {p.prior.strength: strength for p in model.parameters if p.prior is not None and p.prior.strength}
        problem = laid.counted(noise=noise, strengths=named)
        x = near
        for steps in (*[1] * WATCHED, *[MOST_STEPS] * REWEIGHTED):
            solution = gauss_newton(problem, x, tolerance=1e-5, max_steps=steps)
            if solution.status is Status.INTERRUPTED:
                raise KeyboardInterrupt
            x = solution.x
            problem = problem.counted(keep=_by_batch(problem, x))
            fitted = model.with_values(problem.shared(x))
            known = errors(fitted, predictions(fitted, valid, "published", trace=trace), "published")
            error = max(item.rmse for item in known.values())
            if error < least:
                best, least = fitted, error
    return best


def _by_batch(problem: Problem, x: Array) -> list[Array]:
    """Weights of rows with which least squares minimise the mean of the batches' root mean squares: 1/RMSE of each.

    Source: iteratively reweighted least squares; the derivative of a root mean square is that of its mean square over
    twice itself.
    """
    residuals = np.concatenate(
        [np.sum((y - run.measured[run.predicted]) ** 2, axis=1)
         for run, y in zip(problem.runs, problem.simulated(x, []), strict=True)]
    )  # fmt: skip
    full = len(residuals) // BATCH * BATCH
    if not full:
        return list(problem.keep)
    size = np.sqrt(residuals[:full].reshape(-1, BATCH).mean(axis=1))
    weight = np.full(len(residuals), 1.0)
    weight[:full] = np.repeat(np.mean(size) / np.maximum(size, 1e-9), BATCH)
    keep, start = [], 0
    for run in problem.runs:
        value = np.ones(len(run))
        count = len(run) - run.first
        value[run.predicted] = weight[start : start + count]
        start += count
        keep.append(value)
    return keep


def _memory(entry: PaperModel, train: Recording) -> MemoryModel:
    return must_be(MemoryModel, prepared(entry.model, train, entry.settings))


def _honest(
    entry: PaperModel, share: int, train: Recording, valid: Recording, how: FitOptions
) -> tuple[list[Row], Fit]:
    clock = time.process_time()
    result = fit(_memory(entry, train), [train], how=how)
    spent = time.process_time() - clock
    model = must_be(MemoryModel, result.model)
    return _scored(entry, share, "honest", model, spent, {"train": train, "valid": valid}), result


def _closed(train: Recording, valid: Recording, quick: bool, how: FitOptions, say: Say) -> list[Row]:
    """The coupled networks, open and closed loop, and with the delay of every run told by its first seconds."""
    rows: list[Row] = []
    for name, (kind, settings) in COUPLED.items():
        say(f"{name}, closed loop")
        clock = time.process_time()
        several = [prepared(kind, train, settings)] if quick else candidates(kind, train, settings)
        result = fit(several, [train], how=how)
        spent = time.process_time() - clock
        model = must_be(MemoryModel, result.model)
        known: dict[str, Mapping[str, Error]] = {
            protocol: errors(model, predictions(model, valid, protocol), protocol)
            for protocol in ("published", "honest", "closed_loop")
        }
        known[calibration_words(CALIBRATED)] = calibrated_errors(model, valid, calibrated_timing(result, valid))
        for protocol, item in known.items():
            for output, error in item.items():
                alone = OURS if name == kind else name.partition(",")[0]
                paper = PAPER.get((alone, output, 100, "valid")) if protocol in ("published", "honest") else None
                rows.append(
                    _row("coupled", name, 100, "valid", protocol, output, error,
                         fvu=error.fvu_published if protocol == "published" else error.fvu,
                         parameters=model.size, cpu=spent, paper=paper)
                )  # fmt: skip
    return rows


def _adapted(
    car: str,
    recording: Recording,
    whole: Mapping[tuple[str, str], Fit],
    train: Recording,
    keep: dict[tuple[str, str], Adaptation],
) -> list[Row]:
    """Table 3 for one recording: all of it in sample, as published, and its first 20 s against what follows."""
    rows = []
    for (name, kind), item in whole.items():
        if name.startswith("Ablation"):
            continue
        model = must_be(MemoryModel, item.model)
        before = errors(model, predictions(model, recording, "published"), "published")
        pooled = errors(model, predictions(model, recording), "honest")
        clock = time.process_time()
        tuned = tuned_in_sample(item, recording)
        spent = time.process_time() - clock
        first = keep[car, kind] = adapt(item, recording, trained=[train])
        for output in model.outputs:
            paper = ADAPTED.get((car, name, output))
            common: dict[str, Any] = {"parameters": model.size}
            zero = pooled[output]
            rows.append(
                _row(3, name, 100, f"{car}, zero-shot", "published", output, zero,
                     fvu=before[output].fvu_pooled, cpu=0.0,
                     paper=None if paper is None else (paper[0], None), **common)
            )  # fmt: skip
            value = tuned[output]
            rows.append(
                _row(3, name, 100, f"{car}, fine-tuned in sample", "published", output,
                     replace(zero, rmse=value["rmse"], rmse_sd=np.nan), fvu=value["fvu_pooled"], cpu=spent,
                     paper=None if paper is None else (paper[1], None), **common)
            )  # fmt: skip
            for outcome, words in ((first.zero_shot, "zero-shot"), (first.chosen, "adapted to 20 s")):
                if output in outcome.rest:
                    error = outcome.rest[output]
                    rows.append(
                        _row(3, name, 100, f"{car}, {words}", "honest", output, error, fvu=error.fvu,
                             cpu=first.cpu_seconds, paper=None, **common)
                    )  # fmt: skip
    return rows
