"""The truck of the transfer-learning paper: its tables beside ours.

Two splits stand side by side: as published, where chunks of one recording of the truck lie in train and val, and by
recording, where they do not: a third of the recordings in train and val is held out, and what is trained, pretrained or
stopped by sees none of them. Test is scored where its file is there, never fitted or selected on.

Standard errors and paired intervals are over whole recordings, whose chunks are not independent. Source:
"Physics-guided approach with transfer learning in vehicle lateral dynamics", Tables II-IV.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from ..errors import BadInput
from ..fitting.how import Say, quiet
from ..fitting.pretraining import Pretraining
from ..motion_model import MotionModel
from ..parameter import Array
from ..recording import Recording
from .truck_grey_boxes import CANDIDATES, OUTPUTS, PAPER, TruckCandidate, errors, fitted, identified
from .truck_inputs import raw
from .truck_models import LEVER_ARM, truck
from .truck_networks import METHODS, NetworkTraining, trained

SPLITS = ("train", "val", "test")
SECONDS = 10.0
"""Of a chunk."""
HELD_OUT = 3
"""Every so many-th recording is held out where the split is by recording."""
HORIZONS, SIZES = (0.05, 0.5, 1.0), (8, 16, 24)
WHOLE = 10.0
"""s: windows as long as what is scored."""
DURATIONS = (0.05, *(float(k) for k in range(1, 11)))
REPEATS = 2000
"""Draws of the bootstrap over recordings."""
SHARES = (0.1, 0.25, 0.5)
"""Of the training recordings, for learning curves."""


@dataclass(frozen=True)
class TruckOptions:
    """How much of the tables is made.

    Attributes
    ----------
    quick : the smallest networks at 1 s from one seed; a few CPU minutes in place of hours.
    seeds : trainings of every network.
    """

    quick: bool = False
    seeds: int = 5


def truck_tables(data: Path, options: TruckOptions | None = None, say: Say = quiet) -> dict[str, Any]:
    """Fit, train and score everything.

    Parameters
    ----------
    data : folder of train.parquet and val.parquet, perhaps test.parquet.
    options : how much.
    say : progress.

    Returns
    -------
    Plain data: `rows`, `comparisons`, `durations`, `learning_curves`, `identified`, `paper`, `cpu_seconds`.

    Raises
    ------
    BadInput : a file is missing or is none of these.
    """
    how, clock = options or TruckOptions(), time.process_time()
    if not data.is_dir():
        raise BadInput(f"{data} is no folder; name that of train.parquet and val.parquet with ‹data›.")
    for split in SPLITS[:2]:
        if not (data / f"{split}.parquet").is_file():
            raise BadInput(
                f"{data / f'{split}.parquet'} is not there; fetch the truck's recordings (greybox datasets list) and "
                "name their folder with ‹data›."
            )
    rows: list[dict[str, Any]] = []
    told: dict[str, Any] = {}
    comparisons: list[dict[str, Any]] = []
    durations: list[dict[str, Any]] = []
    with threadpool_limits(1):
        for by_recording in (False, True):
            chosen = CANDIDATES if not by_recording else CANDIDATES[1:4]
            for candidate in chosen:
                say(f"{candidate.name}{', by recording' if by_recording else ''}")
                own, identifiable = _grey_box(candidate, data, by_recording)
                rows += own
                if not by_recording:
                    told[candidate.name] = identifiable
            found = _networks(data, by_recording, how, say)
            rows += [row for one in found for row in _rows(one, data, by_recording)]
            comparisons += _compared(found, data, by_recording)
            durations += [_along(one, by_recording) for one in found]
        curves = [] if how.quick else _curves(data, how, say)
    return {
        "rows": rows, "comparisons": comparisons, "durations": durations, "learning_curves": curves, "identified": told,
        "paper": PAPER, "quick": how.quick, "seeds": 1 if how.quick else how.seeds,
        "cpu_seconds": time.process_time() - clock,
    }  # fmt: skip


@dataclass(frozen=True)
class Chunks:
    """Trajectories of 10 s, and the recording of the truck that each is a piece of.

    Attributes
    ----------
    recording : the trajectories as runs.
    piece_of : (trajectories,) number of the recording's first trajectory.
    """

    recording: Recording
    piece_of: Array

    def of(self, which: NDArray[np.bool_], name: str) -> Chunks:
        """Some of the trajectories, (trajectories,) bool."""
        own = self.recording
        runs = [run for run, taken in zip(own.runs, which, strict=True) if taken]
        rows = np.concatenate([np.arange(a, b) for a, b in runs])
        stops = np.cumsum([b - a for a, b in runs]).tolist()
        chosen = replace(
            own, name=name, time=own.time[rows], signals={n: v[rows] for n, v in own.signals.items()},
            runs=tuple(zip([0, *stops[:-1]], stops, strict=True)),
        )  # fmt: skip
        return Chunks(chosen, self.piece_of[which])


def chunks(path: Path, prepare: Any = raw) -> Chunks:
    """The trajectories of a file. A chunk's number less its first second over ten is its recording's first chunk.

    Raises
    ------
    BadInput : the file is none of the truck's.
    """
    found: Recording = prepare(path)
    table = pd.read_parquet(path, columns=["trajectory", "time"])
    begun = table.groupby("trajectory", sort=False)["time"].first()
    numbers = begun.index.to_numpy(dtype=float) - np.round(begun.to_numpy(dtype=float) / SECONDS)
    if len(numbers) != len(found.runs):
        raise BadInput(f"{path} has {len(numbers)} trajectories in {len(found.runs)} unbroken runs; is it complete?")
    return Chunks(found, numbers)


def splits(data: Path, prepare: Any, by_recording: bool) -> dict[str, Chunks]:
    """Split -> trajectories; test where its file is there."""
    found = {split: chunks(data / f"{split}.parquet", prepare) for split in SPLITS[:2]}
    if by_recording:
        both = _joined(found["train"], found["val"])
        held = np.isin(both.piece_of, np.unique(both.piece_of)[HELD_OUT - 1 :: HELD_OUT])
        found = {"train": both.of(~held, "train, by recording"), "val": both.of(held, "val, by recording")}
    elif (data / "test.parquet").is_file():
        found["test"] = chunks(data / "test.parquet", prepare)
    return found


def _joined(one: Chunks, other: Chunks) -> Chunks:
    a, b = one.recording, other.recording
    shift = len(a)
    runs = (*a.runs, *((start + shift, stop + shift) for start, stop in b.runs))
    signals = {name: np.concatenate([own, b.signals[name]]) for name, own in a.signals.items() if name in b.signals}
    whole = replace(a, time=np.concatenate([a.time, b.time]), signals=signals, runs=runs)
    return Chunks(whole, np.concatenate([one.piece_of, other.piece_of]))


def _grey_box(candidate: TruckCandidate, data: Path, by_recording: bool) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    clock = time.process_time()
    found = splits(data, candidate.prepare, by_recording)
    train = found["train"].recording
    problem, solution = fitted(candidate.model(train), train)
    seconds = time.process_time() - clock
    simulator, p = problem.plain.simulator, problem.plain.shared(solution.x)
    free = sum(own.size for own in simulator.trace.model.parameters if not own.fixed)
    rows = [
        _row("II" if candidate is CANDIDATES[0] else "grey box", candidate.name, candidate.inputs, split, by_recording,
             errors(simulator, own.recording, p), own.piece_of, free, seconds)
        for split, own in found.items()
    ]  # fmt: skip
    return rows, {"solver": solution.status.value, "steps": solution.steps, **identified(problem, solution)}


def _known(train: Recording) -> tuple[MotionModel, Pretraining]:
    """The bicycle with the signs put right, fitted to the training trajectories."""
    problem, solution = fitted(truck(LEVER_ARM), train)
    model, p = problem.plain.model, problem.plain.shared(solution.x)
    return model.with_values(p), Pretraining(model, p[None], span="box", source="the bicycle")


def _networks(data: Path, by_recording: bool, how: TruckOptions, say: Say) -> list[NetworkTraining]:
    found = {split: own.recording for split, own in splits(data, raw, by_recording).items()}
    _, known = _known(found["train"])
    cells: Iterable[tuple[int, float]]
    if how.quick:
        cells = [(SIZES[0], HORIZONS[-1])]
    elif by_recording:
        cells = [(SIZES[-1], HORIZONS[-1])]
    else:
        cells = [*((size, horizon) for horizon in HORIZONS for size in SIZES), (SIZES[1], WHOLE)]
    seeds = range(1 if how.quick else how.seeds)
    trainings = []
    for units, horizon in cells:
        for method in METHODS:
            say(f"{method}, 4 x {units}, {horizon:g} s{', by recording' if by_recording else ''}")
            trainings.append(trained(method, units, horizon, found, known, seeds, say))
    return trainings


def _name(one: NetworkTraining) -> str:
    words = {"learning": "MLP", "discrepancy": "bicycle and MLP", "transfer": "MLP, transfer learning"}[one.method]
    return f"{words}, 4 x {one.units}, {one.horizon:g} s"


def _rows(one: NetworkTraining, data: Path, by_recording: bool) -> list[dict[str, Any]]:
    pieces = {split: own.piece_of for split, own in splits(data, raw, by_recording).items()}
    table = "III" if one.horizon in HORIZONS else "own"
    found = []
    for split, runs in one.runs.items():
        own = _row(table, _name(one), "v_x, alpha1", split, by_recording, np.mean(runs, axis=0), pieces[split],
                   one.parameters, one.cpu_seconds)  # fmt: skip
        spread = np.std(np.mean(runs, axis=1), axis=0, ddof=1) if len(runs) > 1 else np.full(len(OUTPUTS), np.nan)
        found.append(own | {f"{name}_sd_over_seeds": float(sd) for name, sd in zip(OUTPUTS, spread, strict=True)})
        if len(runs) > 1:
            found.append(
                _row("own", f"{_name(one)}, mean of {len(runs)}", "v_x, alpha1", split, by_recording,
                     one.together[split], pieces[split], one.parameters * len(runs), one.cpu_seconds * len(runs))
            )  # fmt: skip
    return found


def _row(
    table: str, model: str, inputs: str, split: str, by_recording: bool, of_split: Array, piece_of: Array,
    parameters: int, seconds: float,
) -> dict[str, Any]:  # fmt: skip
    spread = _spread(of_split, piece_of)
    return {
        "table": table, "model": model, "inputs": inputs, "split": split, "by_recording": by_recording,
        **dict(zip(OUTPUTS, np.mean(of_split, axis=0).tolist(), strict=True)),
        **{f"{name}_stderr": float(sd) for name, sd in zip(OUTPUTS, spread, strict=True)},
        "parameters": parameters, "cpu_seconds": seconds, "trajectories": len(of_split),
    }  # fmt: skip


def _spread(of_split: Array, piece_of: Array) -> Array:
    """Standard error of the mean over trajectories (n, outputs), whole recordings drawn with replacement."""
    return np.asarray(np.std(_redrawn(of_split, piece_of), axis=0, ddof=1))


def _redrawn(values: Array, piece_of: Array) -> Array:
    """(draws, outputs) means over trajectories of recordings that are drawn with replacement."""
    names, group = np.unique(piece_of, return_inverse=True)
    sums = np.zeros((len(names), values.shape[1]))
    np.add.at(sums, group, values)
    counts = np.bincount(group, minlength=len(names)).astype(float)
    drawn = np.random.default_rng(20240).integers(len(names), size=(REPEATS, len(names)))
    return np.asarray(np.sum(sums[drawn], axis=1) / np.sum(counts[drawn], axis=1)[:, None])


def _compared(found: Sequence[NetworkTraining], data: Path, by_recording: bool) -> list[dict[str, Any]]:
    """Transfer and discrepancy beside learning alone, trajectory by trajectory."""
    pieces = {split: own.piece_of for split, own in splits(data, raw, by_recording).items()}
    alone = {(one.units, one.horizon): one for one in found if one.method == "learning"}
    compared = []
    for one in found:
        if one.method == "learning":
            continue
        base = alone[(one.units, one.horizon)]
        for split in one.runs:
            if split == "train":
                continue
            away = np.mean(one.runs[split], axis=0) - np.mean(base.runs[split], axis=0)
            low, high = np.quantile(_redrawn(away, pieces[split]), [0.025, 0.975], axis=0)
            for k, output in enumerate(OUTPUTS):
                compared.append(
                    {
                        "model": _name(one), "against": _name(base), "split": split, "by_recording": by_recording,
                        "output": output, "difference": float(np.mean(away[:, k])), "low": float(low[k]),
                        "high": float(high[k]), "distinguished": bool(low[k] > 0 or high[k] < 0),
                    }
                )  # fmt: skip
    return compared


def _along(one: NetworkTraining, by_recording: bool) -> dict[str, Any]:
    """RMSE over all trajectories from their start to so many seconds (Table IV)."""
    split = "test" if "test" in one.along else "val"
    own = np.mean(one.along[split], axis=0)
    rows = [min(round(seconds / 0.05), len(own) - 1) for seconds in DURATIONS]
    told: Mapping[str, list[float]] = {name: own[rows, k].tolist() for k, name in enumerate(OUTPUTS)}
    return {"model": _name(one), "split": split, "by_recording": by_recording, "seconds": list(DURATIONS), **told}


def _curves(data: Path, how: TruckOptions, say: Say) -> list[dict[str, Any]]:
    """Learning alone and after a bicycle, on shares of the training recordings, scored on val."""
    found = splits(data, raw, by_recording=False)
    train = found["train"]
    names = np.unique(train.piece_of)
    curves = []
    for share in SHARES:
        order = np.random.default_rng(77).permutation(names)
        some = train.of(np.isin(train.piece_of, order[: max(2, round(share * len(names)))]), f"{share:g} of train")
        recordings = {"train": some.recording, "val": found["val"].recording}
        _, known = _known(some.recording)
        own = {}
        for method in ("learning", "transfer"):
            say(f"{method} on {100 * share:g} % of the training recordings")
            own[method] = trained(method, SIZES[1], HORIZONS[-1], recordings, known, range(how.seeds), say)
        for k, output in enumerate(OUTPUTS):
            scratch, after = (np.mean(own[m].runs["val"], axis=0)[:, k] for m in ("learning", "transfer"))
            drawn = _redrawn(np.column_stack([scratch, after]), found["val"].piece_of)
            low, high = np.quantile(drawn[:, 1] / drawn[:, 0], [0.025, 0.975])
            curves.append(
                {
                    "share": share, "output": output, "learning": float(np.mean(scratch)),
                    "transfer": float(np.mean(after)), "ratio": float(np.mean(after) / np.mean(scratch)),
                    "low": float(low), "high": float(high),
                }
            )  # fmt: skip
    return curves
