"""The truck of the transfer-learning paper: its tables beside ours.

Two splits stand side by side: as published, where chunks of one recording of the truck lie in train and val, and by
recording, where they do not: a third of the recordings in train and val is held out, and what is trained, pretrained or
stopped by sees none of them. Test is scored where its file is there, never fitted or selected on.

Standard errors and paired intervals are over whole recordings, whose chunks are not independent. Source:
"Physics-guided approach with transfer learning in vehicle lateral dynamics", Tables II-IV.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from greybox_id.base.errors import BadInput
from greybox_id.base.shorthands import Array
from greybox_id.base.version import __version__
from greybox_id.fitting.how import Say, quiet

from .bench import KeptBench, must_be_folder
from .truck_authors import AUTHORS, PRIORS, authors_errors, authors_particles
from .truck_comparisons import (
    beside_bicycle,
    compared,
    curves,
    lessons,
    out_of_range,
    over_durations,
    standard_error,
    traces,
)
from .truck_grey_boxes import CANDIDATES, OUTPUTS, PAPER, TruckCandidate, deviations, fitted, identified
from .truck_inputs import SPLITS, published_signs, splits
from .truck_networks import (
    BICYCLE,
    FASTER,
    LESSONS,
    METHODS,
    NetworkCell,
    NetworkTraining,
    about,
    hashed,
    scored,
    trained,
)
from .truck_sets import (
    ANGLE_HELD,
    AS_PUBLISHED,
    BY_RECORDING,
    BY_SPEED,
    HORIZONS,
    SHARES,
    SIZES,
    TAUGHT_ON,
    WHOLE,
    TruckSets,
    of_share,
)


@dataclass(frozen=True)
class TruckOptions:
    """How much of the tables is made.

    Attributes
    ----------
    quick : the smallest networks at 1 s from one seed; a few CPU minutes in place of hours.
    seeds : trainings of every network.
    curves_alone : learning curves, lessons and networks beyond the speeds they saw, and no other networks.
    """

    quick: bool = False
    seeds: int = 5
    curves_alone: bool = False


def truck_tables(
    data: Path, options: TruckOptions | None = None, say: Say = quiet, kept: KeptBench | None = None
) -> dict[str, Any]:
    """Fit, train and score everything.

    Parameters
    ----------
    data : folder of train.parquet and val.parquet, perhaps test.parquet.
    options : how much.
    say : progress.
    kept : trainings so far, to go on from and to add to.

    Returns
    -------
    Plain data: `rows`, `comparisons`, `durations`, `learning_curves`, `lessons`, `out_of_range`, `traces`,
    `identified`, `paper`, `left_out`, `cpu_seconds`.

    Raises
    ------
    BadInput : a file is missing or is none of these.
    KeyboardInterrupt : Ctrl-C; trainings before it are kept.
    """
    how, store, clock = options or TruckOptions(), kept or KeptBench("truck"), time.process_time()
    must_be_folder(data, "train.parquet and val.parquet")
    for split in SPLITS[:2]:
        if not (data / f"{split}.parquet").is_file():
            raise BadInput(
                f"{data / f'{split}.parquet'} is not there; fetch the truck's recordings (greybox datasets list) and "
                "name their folder with ‹data›."
            )
    known: dict[str, Any] = {}
    rows: list[dict[str, Any]] = []
    durations: list[dict[str, Any]] = []
    scores: dict[tuple[str, bool], Mapping[str, Array]] = {}
    with threadpool_limits(1):
        sets = TruckSets(data)
        for split in (AS_PUBLISHED, BY_RECORDING):
            for candidate in CANDIDATES if split == AS_PUBLISHED else CANDIDATES[1:5]:
                say(f"{candidate.name}, {split}")
                value = grey_box(candidate, data, split == BY_RECORDING, say)
                if value is None:
                    continue
                scored_rows, errors, identified_here = value
                rows += scored_rows
                scores[candidate.name, split == BY_RECORDING] = {
                    name: np.sqrt(np.mean(error[0] ** 2, axis=1)) for name, error in errors.items()
                }
                durations.append(over_durations(candidate.name, split, errors))
                if split == AS_PUBLISHED:
                    known[candidate.name] = identified_here
        trainings = _trained(sets, how, say, store)
        if not (how.quick or how.curves_alone):
            rows += _of_authors(data, say, store)
        if store.left_out:
            say(
                f"{store.left_out} trainings are left out: time is up. Run the same command with the same file to "
                "continue."
            )
        trained_on = (AS_PUBLISHED, ANGLE_HELD, BY_RECORDING)
        on = {split: [one for one in trainings if one.cell.data == split] for split in trained_on}
        comparisons = []
        for split, every in on.items():
            own_cells = [one for one in every if one.cell.taught == BICYCLE]
            rows += [row for one in own_cells for row in _rows(one, sets)]
            comparisons += compared(own_cells, sets)
            if split != ANGLE_HELD:
                durations += [over_durations(one.cell.name, split, one.errors) for one in own_cells]
            wide = [one for one in own_cells if one.cell.horizon == HORIZONS[-1]]
            scores |= {
                (_named(one.cell), split == BY_RECORDING): {s: np.mean(run, axis=0) for s, run in one.runs.items()}
                for one in wide if one.cell.units == max(item.cell.units for item in wide)
            }  # fmt: skip
        comparisons += beside_bicycle(scores, sets)
        result = {
            "rows": rows, "comparisons": comparisons, "durations": durations,
            "learning_curves": [] if how.quick else curves(trainings, sets), "lessons": lessons(trainings, sets),
            "out_of_range": out_of_range(trainings, sets),
            "traces": traces(on[AS_PUBLISHED], sets), "identified": known, "paper": PAPER, "quick": how.quick,
            "seeds": 1 if how.quick else how.seeds, "left_out": store.left_out,
            "cpu_seconds": time.process_time() - clock,
        }  # fmt: skip
    store.keep(tables=result)
    return result


def grey_box(
    candidate: TruckCandidate, data: Path, by_recording: bool, say: Say = quiet
) -> tuple[list[dict[str, Any]], dict[str, Array], dict[str, Any]] | None:
    """Fit a candidate to train and score it; None, and a sentence, where train or val lacks what it reads.

    Returns
    -------
    Rows of the tables; split -> (1, trajectories, rows, outputs) errors of free runs; parameters and combinations.
    """
    clock = time.process_time()
    result = splits(data, candidate.prepare, by_recording)
    for split in tuple(result):
        lacking = [name for name in candidate.needs if name not in result[split].recording.signals]
        if lacking:
            say(f"{candidate.name} is left out: {split} has no {' and no '.join(lacking)}")
            if split != "test":
                return None
            del result[split]
    train = result["train"].recording
    problem, solution = fitted(candidate.model(train), train)
    seconds = time.process_time() - clock
    simulator, p = problem.plain.simulator, problem.plain.shared(solution.x)
    free = sum(parameter.size for parameter in simulator.trace.model.parameters if not parameter.fixed)
    away = {split: deviations(simulator, item.recording, p) for split, item in result.items()}
    table = "II" if candidate is CANDIDATES[0] else "grey box"
    rows = [
        _row(table, candidate.name, candidate.inputs, split, by_recording,
             np.sqrt([np.mean(one**2, axis=0) for one in away[split]]), item.piece_of, free, seconds)
        for split, item in result.items()
    ]  # fmt: skip
    shortest = {split: min(len(one) for one in item) for split, item in away.items()}
    errors = {split: np.array([[one[: shortest[split]] for one in item]]) for split, item in away.items()}
    known = {"solver": solution.status.value, "steps": solution.steps, **identified(problem, solution)}
    return rows, errors, known


def _of_authors(data: Path, say: Say, store: KeptBench) -> list[dict[str, Any]]:
    """Table II: the fifteen particles of least distance, of windows of each length; their means and scatter."""
    result, rows = splits(data, published_signs, by_recording=False), list[dict[str, Any]]()
    train = result["train"].recording
    for horizon, as_published in [*((item, True) for item in HORIZONS[::-1]), (HORIZONS[-1], False)]:
        name = f"{AUTHORS}{' as published' if as_published else ''}, {horizon:g} s"
        about = {"method": name, "horizon": horizon, "seed": 0, "version": __version__, "train": hashed(train)}

        def sampled(horizon: float = horizon, as_published: bool = as_published, name: str = name) -> Any:
            say(name)
            return authors_particles(train, horizon, 0, as_published)

        value = _kept(store, about, sampled, say)
        if value is None:
            continue
        for split, chunks in result.items():
            each = np.sqrt(np.mean(authors_errors(chunks.recording, value["x"]) ** 2, axis=2))
            row = _row("II", name, "v_x, alpha1", split, False, np.mean(each, axis=0), chunks.piece_of, len(PRIORS),
                       value["cpu_seconds"])  # fmt: skip
            spread = np.std(np.mean(each, axis=1), axis=0, ddof=1).tolist()
            rows.append(
                row | {"particles": len(each)}
                | {f"{output}_sd_over_particles": sd for output, sd in zip(OUTPUTS, spread, strict=True)}
            )  # fmt: skip
    return rows


def _kept(store: KeptBench, about: Mapping[str, Any], train: Callable[[], Any], say: Say) -> Mapping[str, Any] | None:
    """What is kept, or made and kept now; after Ctrl-C the place is told."""
    try:
        return store.training(about, train)
    except KeyboardInterrupt:
        if store.file is not None:
            say(f"trainings so far are in {store.file}; run the same command to continue")
        raise


def _cells(how: TruckOptions) -> list[NetworkCell]:
    """What is trained, what matters most first: a run that is cut short has that."""
    smallest, largest, last = SIZES[0], SIZES[-1], HORIZONS[-1]
    if how.quick:
        quick = [NetworkCell(split, m, smallest, last) for split in (AS_PUBLISHED, BY_RECORDING) for m in METHODS]
        return [*quick, NetworkCell(ANGLE_HELD, "discrepancy", smallest, last)]
    curves = [
        NetworkCell(of_share(share), method, smallest, last)
        for share in SHARES for method in ("learning", "transfer")
    ]  # fmt: skip
    curves += [
        NetworkCell(of_share(share), "transfer", smallest, last, taught)
        for share in TAUGHT_ON for taught in LESSONS if taught != BICYCLE
    ]  # fmt: skip
    curves += [NetworkCell(BY_SPEED, method, smallest, last) for method in METHODS]
    curves += [NetworkCell(BY_SPEED, method, smallest, last, FASTER) for method in METHODS[1:]]
    if how.curves_alone:
        return curves
    target = [
        NetworkCell(AS_PUBLISHED, method, units, horizon)
        for horizon in HORIZONS[::-1] for units in SIZES for method in METHODS
    ]  # fmt: skip
    target += [NetworkCell(BY_RECORDING, method, largest, last) for method in METHODS]
    target += [NetworkCell(ANGLE_HELD, "discrepancy", largest, last)]
    target += curves
    target += [NetworkCell(AS_PUBLISHED, method, SIZES[1], WHOLE) for method in METHODS]
    return list(dict.fromkeys(target))


def _trained(sets: TruckSets, how: TruckOptions, say: Say, store: KeptBench) -> list[NetworkTraining]:
    """All cells from one seed before any from the next; those of which there is a training."""
    cells = [cell for cell in _cells(how) if sets.chunks(cell.data)]
    result: dict[NetworkCell, list[Mapping[str, Any]]] = {cell: [] for cell in cells}
    for seed in range(1 if how.quick else how.seeds):
        for cell in cells:
            value = {split: sets.recordings(cell.data)[split] for split in SPLITS[:2]}
            name = f"{cell.name}, {_of_data(cell.data)}, seed {seed}"

            def train(cell: NetworkCell = cell, value: Any = value, seed: int = seed, name: str = name) -> Any:
                say(name)
                return trained(cell, value, sets.bicycle(cell.data), seed, say)

            one = _kept(store, about(cell, value, seed), train, say)
            if one is not None:
                result[cell].append(one)
    return [
        scored(cell, sets.recordings(cell.data), sets.bicycle(cell.data), item) for cell, item in result.items() if item
    ]


def _of_data(data: str) -> str:
    return data if data in (AS_PUBLISHED, BY_RECORDING, BY_SPEED, ANGLE_HELD) else f"{100 * float(data):g} % of train"


def _named(cell: NetworkCell) -> str:
    return f"{cell.name}, {ANGLE_HELD}" if cell.data == ANGLE_HELD else cell.name


def _rows(one: NetworkTraining, sets: TruckSets) -> list[dict[str, Any]]:
    by_recording, cell, name = one.cell.data == BY_RECORDING, one.cell, _named(one.cell)
    table = "III" if cell.horizon in HORIZONS and cell.data != ANGLE_HELD else "own"
    result = []
    for split, runs in one.runs.items():
        piece_of = sets.chunks(cell.data)[split].piece_of
        it = _row(table, name, "v_x, alpha1", split, by_recording, np.mean(runs, axis=0), piece_of,
                   one.parameters, one.cpu_seconds)  # fmt: skip
        spread = np.std(np.mean(runs, axis=1), axis=0, ddof=1) if len(runs) > 1 else np.full(len(OUTPUTS), np.nan)
        it |= {"seeds": one.seeds}
        result.append(it | {f"{output}_sd_over_seeds": float(sd) for output, sd in zip(OUTPUTS, spread, strict=True)})
        if len(runs) > 1:
            result.append(
                _row("own", f"{name}, mean of {len(runs)}", "v_x, alpha1", split, by_recording,
                     one.together[split], piece_of, one.parameters * len(runs), one.cpu_seconds * len(runs))
            )  # fmt: skip
    return result


def _row(
    table: str, model: str, inputs: str, split: str, by_recording: bool, of_split: Array, piece_of: Array,
    parameters: int, seconds: float,
) -> dict[str, Any]:  # fmt: skip
    spread = standard_error(of_split, piece_of)
    return {
        "table": table, "model": model, "inputs": inputs, "split": split, "by_recording": by_recording,
        **dict(zip(OUTPUTS, np.mean(of_split, axis=0).tolist(), strict=True)),
        **{f"{name}_stderr": float(sd) for name, sd in zip(OUTPUTS, spread, strict=True)},
        "parameters": parameters, "cpu_seconds": seconds, "trajectories": len(of_split),
    }  # fmt: skip
