"""Yaw of a Ferrari 250 LM: a single track beside the structured and the black-box network of a published application.

Source: vehicle/vehicle_lateral_dynamics_estimation in tonegas/nnodely-applications, on drives of Stanford's REVS
programme (2014 Targa Sixty-Six), 20 Hz, low-passed at 5 Hz. Their checkpoints are published, no figure is; both
structures are trained again here, by this package's least squares, on the same drives.

The zero of the hand wheel moves by tenths of a degree from drive to drive, which turns a fast car by as many deg/s.
The grey boxes take it from the hand wheel itself, where the car gains speed on straights.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

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
LONG = f"yaw angle over {WINDOWS[60.0]}"
FIRST = 40
"""Rows of a drive that are not scored: two seconds for windows to fill and a single track to settle."""
FAST, SMALL = 30.0, 8.0
"""m/s, deg: a car that gains speed above the one, with the hand wheel within the other, drives straight ahead."""
STRUCTURED, BLACK_BOX, AVERAGED = (
    "structured network, trained again", "black-box network, trained again", "black-box networks, their mean",
)  # fmt: skip
GREY, LOCAL, PROCESS = "single track", "single track and local models", "single track and Gaussian process"
Predictions = list[Array]


def measure(data: Path, quick: bool, say: Say) -> PublishedBench:
    """Fit to the training drives, score on the others. Raises `BadInput` where a drive is not there."""
    drives = {name: frame(data, name, COLUMNS, "revs_telemetry") for name in (*TRAIN, JUDGED[0])}
    if any((data / f"{JUDGED[1]}.csv{end}").is_file() for end in ("", ".gz")):
        drives[JUDGED[1]] = frame(data, JUDGED[1], COLUMNS, "revs_telemetry")
    zeroed = {name: straightened(one) for name, one in drives.items()}
    made: dict[str, dict[str, Predictions]] = {}
    sizes: dict[str, tuple[int, float]] = {}
    with clocked() as spent:
        say(GREY)
        fit = gb.fit(driven_rear() + gb.effects.steering_delay.free(), [motion(zeroed[name]) for name in TRAIN],
                     options=gb.FitOptions(solver="gauss-newton"))  # fmt: skip
    swung = {name: np.rad2deg(gb.simulate(fit, motion(one))["yaw_rate"]) for name, one in zeroed.items()}
    made[GREY] = {name: [one] for name, one in swung.items()}
    free = sum(parameter.size for parameter in fit.model.parameters if not parameter.fixed)
    sizes[GREY] = free, spent[0]
    seeds, locally, scale = range(QUICK_SEEDS if quick else SEEDS), [local_models("rest", CENTRES)], scales(drives)
    boxes = [rectified("rest", seed, scale) for seed in seeds]
    for name, models in ((STRUCTURED, locally), (BLACK_BOX, boxes), (LOCAL, locally)):
        say(name)
        with clocked() as spent:
            seen, before = (zeroed, swung) if name == LOCAL else (drives, None)
            made[name], size = networked(models, seen, before, quick)
        sizes[name] = size, spent[0]
    made[AVERAGED] = {name: [np.mean(one, axis=0)] for name, one in made[BLACK_BOX].items()}
    say(PROCESS)
    with clocked() as spent:
        made[PROCESS], size = processed(zeroed, swung)
    count = len(seeds)
    sizes[LOCAL] = sizes[LOCAL][0] + free, sizes[LOCAL][1] + sizes[GREY][1]
    sizes[PROCESS] = size + free, spent[0] + sizes[GREY][1]
    sizes[AVERAGED] = count * sizes[BLACK_BOX][0], sizes[BLACK_BOX][1]
    sizes[BLACK_BOX] = sizes[BLACK_BOX][0], sizes[BLACK_BOX][1] / count
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
        mean = {name: float(np.mean([rmse(item["yaw rate"]) for item in each])) for name, each in score.items()}
        turn = {name: float(np.mean([rmse(item[LONG]) for item in each])) for name, each in score.items()}
        theirs = min((STRUCTURED, BLACK_BOX), key=lambda name: mean[name])
        for name in (PROCESS, LOCAL, GREY):
            other = score[theirs][0]["yaw rate"]
            pair = paired(other, score[name][0]["yaw rate"], np.zeros(len(one) - FIRST), STEP)
            word = "not distinguished" if pair.low < 0.0 < pair.high else "worse" if pair.low > 0.0 else "better"
            ratio = {other: mean[name] / mean[other] for other in (STRUCTURED, BLACK_BOX, AVERAGED)}
            far = turn[name] / min(turn[STRUCTURED], turn[BLACK_BOX])
            answers.append(
                f"{drive}: in yaw rate, the error of the {name} is {ratio[theirs]:.2f} times that of the {theirs}: "
                f"{word} (difference of RMSE {pair.second - pair.first:+.3f} [{pair.low:+.3f}, {pair.high:+.3f}] "
                f"deg/s), and {ratio[AVERAGED]:.2f} times that of the mean of all black boxes; in yaw angle over a "
                f"minute, it is {far:.2f} times that of the better network."
            )
            result["paired"][f"{drive}, {name}"] = {
                "against": theirs,
                "ratio": ratio[theirs],
                "ratios": ratio,
                "yaw_angle_ratio": far,
                "low": pair.low,
                "high": pair.high,
            }
    protocol = (
        f"Trained on {' and '.join(TRAIN)} alone. The inputs are the hand wheel, v_x and a_x, without any measured "
        "yaw. Networks read the last ten samples and predict the next; the single track runs freely over whole drives.",
        "Networks are trained by Gauss-Newton with priors on their weights, not, as by the authors, by Adam with "
        "early stopping on the validation drive. For the black box, tables give mean and standard error over "
        f"{QUICK_SEEDS if quick else SEEDS} seeds, and the error of the mean prediction. Combined with the single "
        "track, local models learn its residual.",
        "The Gaussian process learns the residual of the single track from what it reads and predicts: means over "
        f"{SPANS[-1][1] * STEP:g} s of the past of hand wheel, a_x and predicted yaw rate, speed, and the lateral "
        "acceleration that follows. Far from the training drives its correction fades to none. What it reads, its "
        "length scale and its noise were chosen by blocked cross-validation of the training drives, in five parts of "
        "about a lap, and by fitting to one drive and scoring on the other. Its column of parameters counts the rows "
        "that it keeps.",
        "For the single track, the zero of each drive's hand wheel is its median where the car gains speed above "
        f"{FAST:g} m/s with the hand wheel within {SMALL:g} deg: this uses the inputs of the whole drive, not the "
        "yaw. The authors' networks read the hand wheel as recorded.",
        "Yaw angle: the predicted rate is integrated by the trapezoidal rule over consecutive windows of 5 or 60 s, "
        "from the measured angle at the start of each; errors are pooled.",
        f"The first {FIRST * STEP:g} s of each drive are not scored. Intervals of differences come from paired "
        "blocks as long as the correlation time of the errors. The single track was designed on plots of both "
        "training drives and valid_0, not of test_0. Since then valid_0 was evaluated twice: once for the Gaussian "
        "process, and once for tyres that hold their peak, which were chosen by the free run of the other training "
        "drive.",
    )
    about = (
        "Ferrari 250 LM on a race track at up to 61 m/s, recorded at 20 Hz: comparison with the networks of "
        "tonegas/nnodely-applications."
    )
    return PublishedBench("ferrari", "Yaw of a Ferrari 250 LM", about, protocol, tuple(rows), tuple(answers), result)


def straightened(drive: pd.DataFrame) -> pd.DataFrame:
    """A drive whose hand wheel counts from straight ahead."""
    wheel = drive["handwheelAngle"]
    straight = (drive["vxCG"] > FAST) & (drive["axCG"] > 0.0) & (wheel.abs() < SMALL)
    return drive.assign(handwheelAngle=wheel - (wheel[straight].median() if straight.any() else 0.0))


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
    """Means and standard deviations over the training drives, of what the black box reads and predicts."""
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


SPANS = ((0, 1), (1, 4), (4, 10), (10, 20))
"""Rows ago, from and to below, over which the process reads means: a second in all."""
SCATTER, KEPT = 0.3, 3
"""Noise of a row over the residual's deviation; one row in so many is kept: a residual below 5 Hz loses little."""


def processed(
    drives: Mapping[str, pd.DataFrame], swung: Mapping[str, Array], train: Sequence[str] = TRAIN
) -> tuple[dict[str, Predictions], int]:
    """Drive -> yaw rate of the single track with its residual from a Gaussian process, deg/s; and rows that it keeps.

    The kernel is Matérn's of order 3/2; its length scale is the root mean square of the standardised inputs together.
    Source: Rasmussen, Williams, Gaussian Processes for Machine Learning, 2006, Secs. 2.2 and 4.2.
    """
    seen = {name: recent(one, swung[name]) for name, one in drives.items()}
    rest = {name: drives[name]["yawRate"].to_numpy() - swung[name] for name in train}
    inputs = np.vstack([seen[name][FIRST::KEPT] for name in train])
    left = np.concatenate([rest[name][FIRST::KEPT] for name in train])
    known = np.isfinite(left) & np.isfinite(inputs).all(axis=1)
    inputs, left = inputs[known], left[known]
    middle, size, unit = inputs.mean(axis=0), inputs.std(axis=0), float(left.std())
    inputs = (inputs - middle) / size
    weights = cho_solve(
        cho_factor(matern(inputs, inputs) + SCATTER**2 * np.eye(len(left)), overwrite_a=True), left / unit
    )
    return {
        name: [swung[name] + unit * matern((one - middle) / size, inputs) @ weights] for name, one in seen.items()
    }, len(left)


def recent(drive: pd.DataFrame, swung: Array) -> Array:
    """(n, 14) what the process reads at each row; of rows before the first one, what that one has."""
    v = drive["vxCG"].to_numpy()
    columns = [v, swung * v]
    for signal in (drive["handwheelAngle"].to_numpy(), drive["axCG"].to_numpy(), swung):
        back = [signal, *(np.concatenate([np.full(k, signal[0]), signal[:-k]]) for k in range(1, SPANS[-1][1]))]
        columns += [np.mean(back[first:last], axis=0) for first, last in SPANS]
    return np.stack(columns, axis=1)


def matern(one: Array, other: Array) -> Array:
    """(n, m) covariances of (n, d) and (m, d) inputs."""
    away = np.sqrt(3.0 / one.shape[1]) * cdist(one, other)
    result: Array = (1.0 + away) * np.exp(-away)
    return result


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
