"""Yaw of a Ferrari 250 LM: a single track beside the structured and the black-box network of a published application.

Source: vehicle/vehicle_lateral_dynamics_estimation in tonegas/nnodely-applications, on drives of Stanford's REVS
programme (2014 Targa Sixty-Six), 20 Hz, low-passed at 5 Hz. Their checkpoints are published, no figure is; both
structures are trained again here, by this package's least squares, on the same drives.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import greybox_id as gb
from greybox_id.base.shorthands import Array, Say
from greybox_id.models.memory_model import MemoryModel
from greybox_id.reports.comparison import paired

from .bench import PublishedBench, Row, clocked, frame, rmse
from .equations import driven_rear, local_models, rectified

COLUMNS = ("time", "handwheelAngle", "vxCG", "axCG", "yawAngle", "yawRate")
TRAIN, JUDGED = ("train_0", "train_1"), ("valid_0", "test_0")
RATIO = 13.4
"""Hand wheel over road wheels, as stated by the authors."""
STEP = 0.05
CENTRES = {"hand_wheel": (-85.0, -42.5, 0.0, 42.5, 85.0), "v_x": (12.5, 65.0), "a_x": (-5.0, 5.0)}
"""deg, m/s, m/s²: of the authors' local models, from the extremes in `build_datasets.py`."""
SEEDS, QUICK_SEEDS = 9, 3
WINDOWS = {5.0: "5 s", 60.0: "60 s"}
"""s over which yaw is integrated from where it was measured, and how that is called."""
FIRST = 40
"""Rows of a drive that are not scored: two seconds for windows to fill and a single track to settle."""
STRUCTURED, BLACK_BOX, GREY, BOTH = (
    "structured network, trained again", "black-box network, trained again", "single track",
    "single track and local models",
)  # fmt: skip
Predictions = list[Array]


def measure(data: Path, quick: bool, say: Say) -> PublishedBench:
    """Fit to the training drives, score on the others. Raises `BadInput` where a drive is not there."""
    drives = {name: frame(data, name, COLUMNS, "revs_telemetry") for name in (*TRAIN, JUDGED[0])}
    if any((data / f"{JUDGED[1]}.csv{end}").is_file() for end in ("", ".gz")):
        drives[JUDGED[1]] = frame(data, JUDGED[1], COLUMNS, "revs_telemetry")
    made: dict[str, dict[str, Predictions]] = {}
    sizes: dict[str, tuple[int, float]] = {}
    with clocked() as spent:
        say("single track")
        fit = gb.fit(driven_rear() + gb.effects.steering_delay.free(), [motion(drives[name]) for name in TRAIN],
                     options=gb.FitOptions(solver="gauss-newton"))  # fmt: skip
    made[GREY] = {name: [np.rad2deg(gb.simulate(fit, motion(one))["yaw_rate"])] for name, one in drives.items()}
    free = sum(parameter.size for parameter in fit.model.parameters if not parameter.fixed)
    sizes[GREY] = free, spent[0]
    for name, rest in ((STRUCTURED, None), (BOTH, {name: one[0] for name, one in made[GREY].items()})):
        say(name)
        with clocked() as spent:
            made[name], size = networked([local_models("rest", CENTRES)], drives, rest, quick)
        sizes[name] = size + (0 if rest is None else free), spent[0] + (0.0 if rest is None else sizes[GREY][1])
    say(BLACK_BOX)
    scale = scales(drives)
    with clocked() as spent:
        several = [rectified("rest", seed, scale) for seed in range(QUICK_SEEDS if quick else SEEDS)]
        made[BLACK_BOX], size = networked(several, drives, None, quick)
    sizes[BLACK_BOX] = size, spent[0] / len(several)
    return page(drives, made, sizes, fit, quick)


def page(
    drives: Mapping[str, pd.DataFrame], made: Mapping[str, dict[str, Predictions]],
    sizes: Mapping[str, tuple[int, float]],
    fit: gb.Fit, quick: bool,
) -> PublishedBench:  # fmt: skip
    """Errors of everything on the drives that nothing was fitted to."""
    rows: list[Row] = []
    answers: list[str] = []
    result: dict[str, Any] = {"estimates": fit.params.to_dict(), "paired": {}}
    for drive in (name for name in JUDGED if name in drives):
        one = drives[drive]
        score = {name: [yaw_errors(one, each) for each in item[drive]] for name, item in made.items()}
        for task in score[GREY][0]:
            unit = "deg/s" if task == "yaw rate" else "deg"
            for name, each in score.items():
                values = np.array([rmse(item[task]) for item in each])
                spread = float(np.std(values) / np.sqrt(len(values))) if len(values) > 1 else None
                rows.append(
                    Row(f"{task.capitalize()}, {drive}: RMSE", name, float(values.mean()), unit, spread, *sizes[name])
                )
        better = min(
            (STRUCTURED, BLACK_BOX), key=lambda name: np.mean([rmse(item["yaw rate"]) for item in score[name]])
        )
        for name in (GREY, BOTH):
            pair = paired(score[better][0]["yaw rate"], score[name][0]["yaw rate"], np.zeros(len(one) - FIRST), STEP)
            ratio = pair.second / float(np.mean([rmse(item["yaw rate"]) for item in score[better]]))
            word = "not distinguished" if pair.low < 0.0 < pair.high else "worse" if pair.low > 0.0 else "better"
            answers.append(
                f"{drive}: the {name} errs {ratio:.2f} times as much in yaw rate as the {better}: {word} "
                f"(difference of RMSE {pair.second - pair.first:+.3f} [{pair.low:+.3f}, {pair.high:+.3f}] deg/s)."
            )
            result["paired"][f"{drive}, {name}"] = {
                "against": better,
                "ratio": ratio,
                "low": pair.low,
                "high": pair.high,
            }
    protocol = (
        f"Trained on {' and '.join(TRAIN)} alone. Inputs: hand wheel, v_x and a_x; nothing measured of the yaw. "
        "Networks read the last ten samples and predict the next, the single track runs freely over whole drives.",
        "Networks are trained by Gauss-Newton with priors on their weights, not by the authors' Adam stopped on the "
        f"validation drive. The black box: mean and standard error over {QUICK_SEEDS if quick else SEEDS} seeds.",
        "Yaw angle: the predicted rate integrated by the trapezoidal rule over windows of 5 and 60 s in turn, from the "
        "measured angle at their start; pooled.",
        f"The first {FIRST * STEP:g} s of each drive are not scored. Intervals of differences are of blocks drawn in "
        "pairs, as long as errors stay correlated. What the single track holds was settled on plots of both "
        "training drives and of valid_0; test_0 was not looked at.",
    )
    about = "Ferrari 250 LM on a race track, 20 Hz, to 61 m/s; beside networks of tonegas/nnodely-applications."
    return PublishedBench("ferrari", "Yaw of a Ferrari 250 LM", about, protocol, tuple(rows), tuple(answers), result)


def motion(drive: pd.DataFrame) -> gb.Recording:
    """A drive in SI units, at the road wheels."""
    signals = {"steer": np.deg2rad(drive["handwheelAngle"].to_numpy()) / RATIO, "v_x": drive["vxCG"].to_numpy(),
               "a_x": drive["axCG"].to_numpy(), "yaw_rate": np.deg2rad(drive["yawRate"].to_numpy())}  # fmt: skip
    return gb.Recording("drive", drive["time"].to_numpy(), signals, hold="linear")


def windowed(drive: pd.DataFrame, rest: Array | None) -> gb.Recording:
    """A drive in the authors' units; what is to be predicted is the yaw rate, or what a single track left of it."""
    left = drive["yawRate"].to_numpy() - (0.0 if rest is None else rest)
    signals = {"hand_wheel": drive["handwheelAngle"].to_numpy(), "v_x": drive["vxCG"].to_numpy(),
               "a_x": drive["axCG"].to_numpy(), "rest": left}  # fmt: skip
    return gb.Recording("drive", drive["time"].to_numpy(), signals, extra_units={"hand_wheel": "deg", "rest": "deg/s"})


def scales(drives: Mapping[str, pd.DataFrame]) -> dict[str, tuple[float, float]]:
    """Means and standard deviations over the training drives."""
    both = pd.concat([drives[name] for name in TRAIN])
    names = {"hand_wheel": "handwheelAngle", "v_x": "vxCG", "a_x": "axCG", "rest": "yawRate"}
    return {name: (float(both[item].mean()), float(both[item].std())) for name, item in names.items()}


def networked(
    models: Sequence[MemoryModel], drives: Mapping[str, pd.DataFrame], rest: Mapping[str, Array] | None, quick: bool
) -> tuple[dict[str, Predictions], int]:  # fmt: skip
    """Drive -> yaw rate predicted by each network trained on the training drives, deg/s; and a network's weights."""
    ready = {name: windowed(one, None if rest is None else rest[name]) for name, one in drives.items()}
    options = gb.FitOptions(strengths=1.0 if quick else "cross-validation", solver="gauss-newton")
    made: dict[str, Any] = {name: [] for name in drives}
    for model in models:
        fit = gb.fit(model, [ready[name] for name in TRAIN], options=options)
        for name, one in ready.items():
            made[name].append(gb.predict(fit, one, open_loop=True)["rest"] + (0.0 if rest is None else rest[name]))
    return made, models[0].size


def yaw_errors(drive: pd.DataFrame, predicted: Array) -> dict[str, Array]:
    """Errors of the yaw rate, deg/s, and of the yaw angle over windows in turn, deg."""
    rate, angle = predicted[FIRST:], drive["yawAngle"].to_numpy()[FIRST:]
    result = {"yaw rate": rate - drive["yawRate"].to_numpy()[FIRST:]}
    for seconds, word in WINDOWS.items():
        length = round(seconds / STEP)
        off = []
        for start in range(0, len(rate) - length, length):
            part = slice(start, start + length + 1)
            turned = np.concatenate([[0.0], np.cumsum(STEP * 0.5 * (rate[part][1:] + rate[part][:-1]))])
            off.append(turned - (angle[part] - angle[start]))
        result[f"yaw angle over {word}"] = np.concatenate(off) if off else np.array([np.nan])
    return result
