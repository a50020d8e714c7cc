"""The truck's trainings beside each other: errors over durations, paired differences, learning curves, traces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from greybox_id.base.shorthands import Array
from greybox_id.engine.motion.simulator import Simulator

from .truck_grey_boxes import CANDIDATES, OUTPUTS, deviations
from .truck_inputs import SPLITS
from .truck_networks import BICYCLE, LESSONS, NetworkCell, NetworkTraining, along
from .truck_sets import AS_PUBLISHED, BY_RECORDING, BY_SPEED, HORIZONS, SHARES, SIZES, TAUGHT_ON, TruckSets, of_share

DURATIONS = (0.05, *(float(k) for k in range(1, 11)))
REPEATS = 2000
"""Draws of the bootstrap over recordings."""
LEVEL = 1.96
"""Standard deviations to a side of a 95 % band."""


def standard_error(of_split: Array, piece_of: Array) -> Array:
    """Standard error of the mean over trajectories (n, outputs), whole recordings drawn with replacement."""
    return np.asarray(np.std(redrawn(of_split, piece_of), axis=0, ddof=1))


def redrawn(values: Array, piece_of: Array) -> Array:
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
    low, high = np.quantile(redrawn(away, piece_of), [0.025, 0.975], axis=0)
    for k, output in enumerate(OUTPUTS):
        yield {
            "output": output, "difference": float(np.mean(away[:, k])), "low": float(low[k]), "high": float(high[k]),
            "distinguished": bool(low[k] > 0 or high[k] < 0),
        }  # fmt: skip


def compared(network_trainings: Sequence[NetworkTraining], sets: TruckSets) -> list[dict[str, Any]]:
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


def beside_bicycle(scores: Mapping[tuple[str, bool], Mapping[str, Array]], sets: TruckSets) -> list[dict[str, Any]]:
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


def over_durations(model: str, split: str, errors: Mapping[str, Array]) -> dict[str, Any]:
    """RMSE over all trajectories from their start to so many seconds (Fig. 3); of several seeds the mean."""
    scored_on = "test" if "test" in errors else "val"
    value = np.mean([along(each) for each in errors[scored_on]], axis=0)
    rows = [min(round(seconds / 0.05), len(value) - 1) for seconds in DURATIONS]
    known: Mapping[str, list[float]] = {name: value[rows, k].tolist() for k, name in enumerate(OUTPUTS)}
    by_recording = split == BY_RECORDING
    return {"model": model, "split": scored_on, "by_recording": by_recording, "seconds": list(DURATIONS), **known}


def curves(network_trainings: Sequence[NetworkTraining], sets: TruckSets) -> list[dict[str, Any]]:
    """Learning alone and after a bicycle, on shares of the training recordings, scored on val."""
    at = {one.cell: one for one in network_trainings}
    curves = []
    for share in SHARES:
        cells = [NetworkCell(of_share(share), method, SIZES[0], HORIZONS[-1]) for method in ("learning", "transfer")]
        if not all(cell in at for cell in cells):
            continue
        scratch, after = (np.mean(at[cell].runs["val"], axis=0) for cell in cells)
        drawn = redrawn(np.column_stack([scratch, after]), sets.chunks(cells[0].data)["val"].piece_of)
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


def lessons(network_trainings: Sequence[NetworkTraining], sets: TruckSets) -> list[dict[str, Any]]:
    """Which effect of transfer is distinguished: every lesson against none, and against the fitted bicycle, on val."""
    at = {one.cell: one for one in network_trainings}
    lessons = []
    for share in TAUGHT_ON:
        none = at.get(NetworkCell(of_share(share), "learning", SIZES[0], HORIZONS[-1]))
        best = at.get(NetworkCell(of_share(share), "transfer", SIZES[0], HORIZONS[-1]))
        for taught in LESSONS:
            one = at.get(NetworkCell(of_share(share), "transfer", SIZES[0], HORIZONS[-1], taught))
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


def out_of_range(network_trainings: Sequence[NetworkTraining], sets: TruckSets) -> list[dict[str, Any]]:
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
        drawn = redrawn(np.column_stack([base, each]), fast.piece_of)
        low, high = np.quantile(drawn[:, len(OUTPUTS) :] / drawn[:, : len(OUTPUTS)], [0.025, 0.975], axis=0)
        error, of = np.mean(each, axis=0), np.mean(base, axis=0)
        rows += [
            {"model": name, "output": output, "error": float(error[k]), "ratio": float(error[k] / of[k]),
             "low": float(low[k]), "high": float(high[k]), "seeds": seeds, "trajectories": len(each)}
            for k, output in enumerate(OUTPUTS)
        ]  # fmt: skip
    return rows


def traces(network_trainings: Sequence[NetworkTraining], sets: TruckSets) -> dict[str, Any]:
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
