"""The truck of the transfer-learning paper: its tables beside ours.

Two splits stand side by side: as published, where chunks of one recording of the truck lie in train and val, and by
recording, where they do not: a third of the recordings in train and val is held out, and what is trained, pretrained or
stopped by sees none of them. Test is scored where its file is there, never fitted or selected on.

Standard errors and paired intervals are over whole recordings, whose chunks are not independent. Source:
"Physics-guided approach with transfer learning in vehicle lateral dynamics", Tables II-IV.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from greybox_id.base.errors import BadInput
from greybox_id.base.shorthands import Array
from greybox_id.base.version import __version__
from greybox_id.datasets.recording import Recording
from greybox_id.engine.motion.simulator import Simulator
from greybox_id.fitting.how import Say, quiet
from greybox_id.models.motion_model import MotionModel

from .bench import KeptBench
from .truck_authors import AUTHORS, PRIORS, authors_errors, authors_particles
from .truck_grey_boxes import CANDIDATES, OUTPUTS, PAPER, TruckCandidate, deviations, fitted, identified
from .truck_inputs import SPLITS, Chunks, by_speed, causal, published_signs, raw, splits
from .truck_models import CAUSAL_ANGLE, truck, with_held_angle
from .truck_networks import (
    BICYCLE,
    FASTER,
    LESSONS,
    METHODS,
    NetworkCell,
    NetworkTraining,
    about,
    along,
    fitted_bicycle,
    hashed,
    scored,
    trained,
)

HORIZONS, SIZES = (0.05, 0.5, 1.0), (8, 16, 24)
WHOLE = 10.0
"""s: windows as long as what is scored."""
DURATIONS = (0.05, *(float(k) for k in range(1, 11)))
REPEATS = 2000
"""Draws of the bootstrap over recordings."""
SHARES = (0.1, 0.25, 0.5, 1.0)
"""Of the training recordings, for learning curves."""
TAUGHT_ON = (0.1, 1.0)
"""Shares on which several lessons before training are compared."""
SLOW, FAST = 60 / 3.6, 70 / 3.6
"""m/s: trajectories that stay below the one are trained on, those with a mean above the other scored, out of range."""
AS_PUBLISHED, BY_RECORDING, BY_SPEED = "as published", "by recording", "by speed"
ANGLE_HELD = "angle held"
"""Split as published; the angle is what the best causal grey box, fitted to train, makes of alpha1 and its past."""
LEVEL = 1.96
"""Standard deviations to a side of a 95 % band."""


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
    if not data.is_dir():
        raise BadInput(f"{data} is no folder; name that of train.parquet and val.parquet with ‹data›.")
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
                value = GreyBoxRun.of(candidate, data, split == BY_RECORDING, say)
                if value is None:
                    continue
                rows += value.rows
                scores[candidate.name, split == BY_RECORDING] = value.runs
                durations.append(_durations(candidate.name, split, value.errors))
                if split == AS_PUBLISHED:
                    known[candidate.name] = value.identified
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
            comparisons += _compared(own_cells, sets)
            if split != ANGLE_HELD:
                durations += [_durations(one.cell.name, split, one.errors) for one in own_cells]
            wide = [one for one in own_cells if one.cell.horizon == HORIZONS[-1]]
            scores |= {
                (_named(one.cell), split == BY_RECORDING): {s: np.mean(run, axis=0) for s, run in one.runs.items()}
                for one in wide if one.cell.units == max(item.cell.units for item in wide)
            }  # fmt: skip
        comparisons += _beside_bicycle(scores, sets)
        result = {
            "rows": rows, "comparisons": comparisons, "durations": durations,
            "learning_curves": [] if how.quick else _curves(trainings, sets), "lessons": _lessons(trainings, sets),
            "out_of_range": _out_of_range(trainings, sets),
            "traces": _traces(on[AS_PUBLISHED], sets), "identified": known, "paper": PAPER, "quick": how.quick,
            "seeds": 1 if how.quick else how.seeds, "left_out": store.left_out,
            "cpu_seconds": time.process_time() - clock,
        }  # fmt: skip
    store.keep(tables=result)
    return result


class TruckSets:
    """The recordings that networks are trained on and scored by, as recorded.

    Parameters
    ----------
    data : folder of the files.
    """

    def __init__(self, data: Path) -> None:
        self._data = data
        self.chunks = cache(self._chunks)
        self.bicycle = cache(self._bicycle)

    def recordings(self, name: str) -> dict[str, Recording]:
        """Split -> recording."""
        return {split: chunk.recording for split, chunk in self.chunks(name).items()}

    def _chunks(self, name: str) -> dict[str, Chunks]:
        """Of "as published", "by recording", "by speed", "angle held" or a share of the training recordings, 0.1."""
        if name in (AS_PUBLISHED, BY_RECORDING):
            return splits(self._data, raw, name == BY_RECORDING)
        if name == ANGLE_HELD:
            held = splits(self._data, causal, by_recording=False)
            problem, solution = fitted(truck(*CAUSAL_ANGLE), held["train"].recording)
            model = problem.plain.model.with_values(problem.plain.shared(solution.x))
            return {s: replace(item, recording=with_held_angle(item.recording, model)) for s, item in held.items()}
        result = self.chunks(AS_PUBLISHED)
        if name == BY_SPEED:
            return by_speed(result, SLOW, FAST)
        train = result["train"]
        order = np.random.default_rng(77).permutation(np.unique(train.piece_of))
        some = order[: max(2, round(float(name) * len(order)))]
        return {"train": train.of(np.isin(train.piece_of, some), f"{name} of train"), "val": result["val"]}

    def _bicycle(self, name: str) -> MotionModel:
        return fitted_bicycle(self.chunks(name)["train"].recording)


@dataclass(frozen=True)
class GreyBoxRun:
    """A grey-box model, fitted to train and scored.

    Attributes
    ----------
    rows : of the tables.
    errors : split -> (1, trajectories, rows, outputs).
    identified : parameters and combinations.
    """

    rows: list[dict[str, Any]]
    errors: dict[str, Array]
    identified: dict[str, Any]

    @property
    def runs(self) -> dict[str, Array]:
        """Split -> (trajectories, outputs) RMSE of free runs."""
        return {split: np.sqrt(np.mean(error[0] ** 2, axis=1)) for split, error in self.errors.items()}

    @classmethod
    def of(cls, candidate: TruckCandidate, data: Path, by_recording: bool, say: Say = quiet) -> GreyBoxRun | None:
        """Fit and score a candidate; None, and a sentence, where train or val lacks what it reads."""
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
        return cls(rows, errors, known)


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
        NetworkCell(AS_PUBLISHED if share == 1.0 else f"{share:g}", method, smallest, last)
        for share in SHARES for method in ("learning", "transfer")
    ]  # fmt: skip
    curves += [
        NetworkCell(AS_PUBLISHED if share == 1.0 else f"{share:g}", "transfer", smallest, last, taught)
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


def _pairs(one: NetworkTraining, base: NetworkTraining, split: str, piece_of: Array) -> Iterator[dict[str, Any]]:
    """By output, a network's error less another's, trajectory by trajectory, with its 95 % interval."""
    return _differences(np.mean(one.runs[split], axis=0) - np.mean(base.runs[split], axis=0), piece_of)


def _differences(away: Array, piece_of: Array) -> Iterator[dict[str, Any]]:
    """By output, the mean of (trajectories, outputs) differences with its 95 % interval."""
    low, high = np.quantile(_redrawn(away, piece_of), [0.025, 0.975], axis=0)
    for k, output in enumerate(OUTPUTS):
        yield {
            "output": output, "difference": float(np.mean(away[:, k])), "low": float(low[k]), "high": float(high[k]),
            "distinguished": bool(low[k] > 0 or high[k] < 0),
        }  # fmt: skip


def _compared(network_trainings: Sequence[NetworkTraining], sets: TruckSets) -> list[dict[str, Any]]:
    """Transfer and discrepancy beside learning alone, of the same size and windows."""
    alone = {(one.cell.units, one.cell.horizon): one for one in network_trainings if one.cell.method == "learning"}
    compared = []
    for one in network_trainings:
        base = alone.get((one.cell.units, one.cell.horizon))
        if one.cell.method == "learning" or base is None:
            continue
        for split in SPLITS[1:]:
            if split not in one.errors:
                continue
            head = {"model": one.cell.name, "against": base.cell.name, "split": split,
                    "by_recording": one.cell.data == BY_RECORDING}  # fmt: skip
            pieces = sets.chunks(one.cell.data)[split].piece_of
            compared += [head | pair for pair in _pairs(one, base, split, pieces)]
    return compared


def _beside_bicycle(scores: Mapping[tuple[str, bool], Mapping[str, Array]], sets: TruckSets) -> list[dict[str, Any]]:
    """Grey boxes, and the widest networks at the longest windows, beside the bicycle with the signs put right."""
    compared, bicycle = [], CANDIDATES[1].name
    for (name, by_recording), score in scores.items():
        base = scores.get((bicycle, by_recording), {})
        for split in SPLITS[1:]:
            if name != bicycle and split in score and split in base:
                pieces = sets.chunks(BY_RECORDING if by_recording else AS_PUBLISHED)[split].piece_of
                head = {"model": name, "against": bicycle, "split": split, "by_recording": by_recording}
                compared += [head | pair for pair in _differences(score[split] - base[split], pieces)]
    return compared


def _durations(model: str, split: str, errors: Mapping[str, Array]) -> dict[str, Any]:
    """RMSE over all trajectories from their start to so many seconds (Fig. 3); of several seeds the mean."""
    scored_on = "test" if "test" in errors else "val"
    value = np.mean([along(each) for each in errors[scored_on]], axis=0)
    rows = [min(round(seconds / 0.05), len(value) - 1) for seconds in DURATIONS]
    known: Mapping[str, list[float]] = {name: value[rows, k].tolist() for k, name in enumerate(OUTPUTS)}
    by_recording = split == BY_RECORDING
    return {"model": model, "split": scored_on, "by_recording": by_recording, "seconds": list(DURATIONS), **known}


def _of_share(share: float) -> str:
    return AS_PUBLISHED if share == 1.0 else f"{share:g}"


def _curves(network_trainings: Sequence[NetworkTraining], sets: TruckSets) -> list[dict[str, Any]]:
    """Learning alone and after a bicycle, on shares of the training recordings, scored on val."""
    at = {one.cell: one for one in network_trainings}
    curves = []
    for share in SHARES:
        cells = [NetworkCell(_of_share(share), method, SIZES[0], HORIZONS[-1]) for method in ("learning", "transfer")]
        if not all(cell in at for cell in cells):
            continue
        scratch, after = (np.mean(at[cell].runs["val"], axis=0) for cell in cells)
        drawn = _redrawn(np.column_stack([scratch, after]), sets.chunks(cells[0].data)["val"].piece_of)
        low, high = np.quantile(drawn[:, 2:] / drawn[:, :2], [0.025, 0.975], axis=0)
        for k, output in enumerate(OUTPUTS):
            one, other = float(np.mean(scratch[:, k])), float(np.mean(after[:, k]))
            curves.append(
                {
                    "share": share, "output": output, "learning": one, "transfer": other, "ratio": other / one,
                    "low": float(low[k]), "high": float(high[k]), "seeds": min(at[cell].seeds for cell in cells),
                }
            )  # fmt: skip
    return curves


def _lessons(network_trainings: Sequence[NetworkTraining], sets: TruckSets) -> list[dict[str, Any]]:
    """Which effect of transfer is distinguished: every lesson against none, and against the fitted bicycle, on val."""
    at = {one.cell: one for one in network_trainings}
    lessons = []
    for share in TAUGHT_ON:
        none = at.get(NetworkCell(_of_share(share), "learning", SIZES[0], HORIZONS[-1]))
        best = at.get(NetworkCell(_of_share(share), "transfer", SIZES[0], HORIZONS[-1]))
        for taught in LESSONS:
            one = at.get(NetworkCell(_of_share(share), "transfer", SIZES[0], HORIZONS[-1], taught))
            for against, base in (("no lesson", none), (BICYCLE, best)):
                if one is None or base is None or one is base:
                    continue
                pieces = sets.chunks(one.cell.data)["val"].piece_of
                head = {"share": share, "taught": taught, "against": against, "seeds": min(one.seeds, base.seeds)}
                means = np.mean(one.runs["val"], axis=(0, 1))
                lessons += [
                    head | {"error": float(means[OUTPUTS.index(pair["output"])])} | pair
                    for pair in _pairs(one, base, "val", pieces)
                ]
    return lessons


def _out_of_range(network_trainings: Sequence[NetworkTraining], sets: TruckSets) -> list[dict[str, Any]]:
    """Trained on slow trajectories, scored on fast ones: everything over learning from measurements alone."""
    value = [one for one in network_trainings if one.cell.data == BY_SPEED]
    alone_of = [one.cell.name for one in value if one.cell.method == "learning"]
    if not alone_of:
        return []
    fast, bicycle = sets.chunks(BY_SPEED)["fast"], sets.bicycle(BY_SPEED)
    alone = deviations(Simulator(bicycle), fast.recording, bicycle.values)
    scores = {one.cell.name: (np.mean(one.runs["fast"], axis=0), one.seeds) for one in value}
    scores["bicycle"] = (np.sqrt([np.mean(each**2, axis=0) for each in alone]), 1)
    base, _ = scores[alone_of[0]]
    rows = []
    for name, (each, seeds) in scores.items():
        drawn = _redrawn(np.column_stack([base, each]), fast.piece_of)
        low, high = np.quantile(drawn[:, len(OUTPUTS) :] / drawn[:, : len(OUTPUTS)], [0.025, 0.975], axis=0)
        error, of = np.mean(each, axis=0), np.mean(base, axis=0)
        rows += [
            {"model": name, "output": output, "error": float(error[k]), "ratio": float(error[k] / of[k]),
             "low": float(low[k]), "high": float(high[k]), "seeds": seeds, "trajectories": len(each)}
            for k, output in enumerate(OUTPUTS)
        ]  # fmt: skip
    return rows


def _traces(network_trainings: Sequence[NetworkTraining], sets: TruckSets) -> dict[str, Any]:
    """A slalom, measured and predicted by each method with a 95 % band (Fig. 4).

    The band is as wide as errors on train spread so many seconds after a start, and as seeds part; the share of all
    readings of the split within it is told.
    """
    wide = [one for one in network_trainings if one.cell.horizon == HORIZONS[-1]]
    if not wide:
        return {}
    units = max(one.cell.units for one in wide)
    value = [one for one in wide if one.cell.units == units]
    split = "test" if "test" in value[0].errors else "val"
    recording = sets.recordings(AS_PUBLISHED)[split]
    rows = value[0].errors[split].shape[2]
    read = np.array([np.column_stack([recording[n][b - rows : b] for n in OUTPUTS]) for _, b in recording.runs])
    yaw_rate = read[:, :, OUTPUTS.index("yaw_rate")]
    turning = [np.sign(one[np.abs(one) > np.std(yaw_rate)]) for one in yaw_rate]
    turns = np.array([np.sum(np.diff(one) != 0) for one in turning])  # from one side well to the other
    chosen = int(np.lexsort((np.std(yaw_rate, axis=1), turns))[-1])
    lines = []
    for one in value:
        mean = np.mean(one.errors[split], axis=0)
        among = np.var(one.errors[split], axis=0, ddof=1) if one.seeds > 1 else 0.0
        within = np.mean(one.errors["train"] ** 2, axis=(0, 1))[: mean.shape[1]]
        reach = LEVEL * np.sqrt(np.zeros(mean.shape) + within + among)
        lines.append(
            {
                "model": one.cell.name, "coverage": np.mean(np.abs(mean) <= reach, axis=(0, 1)).tolist(),
                **{name: (read[chosen] + mean[chosen])[:, k].tolist() for k, name in enumerate(OUTPUTS)},
                **{f"{name}_reach": reach[chosen][:, k].tolist() for k, name in enumerate(OUTPUTS)},
            }
        )  # fmt: skip
    start, stop = recording.runs[chosen]
    return {
        "split": split, "trajectory": chosen,
        "seconds": (recording.time[stop - rows : stop] - recording.time[start]).tolist(),
        "measured": {name: read[chosen][:, k].tolist() for k, name in enumerate(OUTPUTS)}, "lines": lines,
    }  # fmt: skip
