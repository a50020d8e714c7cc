"""Steering of a full-size racer: the inverse model of a published network, and the servo behind the target.

Source: "Model-Structured Neural Networks to Control the Steering Dynamics of Autonomous Race Cars" (arXiv 2507.20427);
recordings and `Results.txt` in tonegas/nnodely-applications, vehicle/control_steer_dynamics_A2RL.

The first 1 001 rows of the authors' validation lap are rows of their training lap, to the last digit;
rows are compared, and what is new is scored beside what is published.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

import greybox_id as gb
from greybox_id.base.shorthands import Array, Say

from .bench import PublishedBench, Row, clocked, frame, rmse
from .equations import AHEAD, BEHIND, G, inverse_steering

COLUMNS = ("ay", "ax", "az", "vx", "curv", "steer_target", "steer_meas")
STEP = 0.05
"""s: the files have no time; 20 Hz is their authors' word."""
PUBLISHED = ((1.694230712018907e-3, 155), (2.301451051607728e-3, 190), (2.23118020221591e-3, 225))
"""`Results.txt`: RMSE on the validation lap and weights, of the networks of the grid that are printed."""
BATCHES, BATCH = 2, 1000
"""What these RMSE are means over. They read five samples, so the laps have 2 797 and 2 997 windows, and incomplete
batches are left out. The log-likelihoods printed beside them hold for 2 000 windows with the variance of the target of
the first 2 000, and with two batches that differ in RMSE."""
TARGETS = {"steer_target": "commanded", "steer_meas": "measured"}


def measure(data: Path, quick: bool, say: Say) -> PublishedBench:
    """Fit to the training lap, score on the validation lap. Raises `BadInput` where a lap is not there."""
    laps = {name: without_gravity(frame(data, name, COLUMNS, "a2rl")) for name in ("training_lap", "validation_lap")}
    train, valid = laps.values()
    fresh = ~seen_before(train, valid)
    rows: list[Row] = []
    result: dict[str, Any] = {"rows_of_validation_in_training": int(np.sum(~fresh))}
    for column, word in TARGETS.items() if not quick else list(TARGETS.items())[:1]:
        say(f"inverse model of the {word} steering")
        with clocked() as spent:
            fit = gb.fit(inverse_steering(), [turned(train, column)], options=gb.FitOptions(solver="gauss-newton"))
        off = errors(fit, valid, column)
        free, new = fit.model.size, fresh[: len(off)]
        common: dict[str, Any] = {"parameters": free, "cpu_seconds": spent[0]}
        task = f"Inverse steering, {word}, validation lap: RMSE"
        if column == "steer_target":
            scored = f"Inverse steering, {word}, validation lap, scored as published: RMSE"
            rows.append(Row(scored, "inverse single track", 1e3 * as_published(off), "mrad", **common))
            rows += [
                Row(scored, "MS-NN-steer", 1e3 * value, "mrad", parameters=count, published=True)
                for value, count in PUBLISHED
            ]
            result["again_at_same_place"] = repeated(train, errors(fit, train, column), valid[fresh], off[new])
        rows.append(Row(task, "inverse single track", 1e3 * rmse(off), "mrad", **common))
        if not new.all():
            rows.append(
                Row(
                    f"{task}, rows that the training lap lacks",
                    "inverse single track",
                    1e3 * rmse(off[new]),
                    "mrad",
                    **common,
                )
            )
        result[f"inverse_{column}"] = fit.params.to_dict()
    say("servo")
    rows += servo(train, valid, fresh, result)
    options = gb.FitOptions(solver="gauss-newton")
    at_best = gb.fit(inverse_steering(), [turned(valid, "steer_target")], options=options)
    floor = 1e3 * rmse(errors(at_best, valid, "steer_target"))
    result["inverse_steer_target_in_sample"] = floor
    best = min(value for value, _ in PUBLISHED)
    one, whole = (next(row for row in rows if row.task.endswith(end)) for end in ("as published: RMSE", "lap: RMSE"))
    verdict = "is" if one.value <= 1e3 * best else "is not"
    answers = (
        f"The inverse single track needs {one.parameters} parameters where the published network has 155 to 225; it "
        f"also reads vertical acceleration and {BEHIND} samples before the present. "
        f"Scored as published, its error {verdict} below the smallest published error ({one.value:.2f} compared with "
        f"{1e3 * best:.2f} mrad; the others of the "
        f"grid: {', '.join(f'{1e3 * value:.2f}' for value, _ in PUBLISHED[1:])}). Over the whole validation lap its "
        f"error is {whole.value:.2f} mrad, and {floor:.2f} mrad if it is fitted to that lap itself: better "
        f"parameters can gain no more.",
        *repeated_words(result["again_at_same_place"]),
        servo_words(result),
        f"{np.sum(~fresh)} of {len(valid)} rows of the validation lap are also in the training lap. The published "
        f"errors are those of {BATCHES * BATCH} rows that contain all of these, so half of each is an error on "
        f"training data. The table of rows that are not in the training lap has no such "
        f"overlap.",
    )  # fmt: skip
    protocol = (
        "Task, as published: predict the steering from curvature, speed and accelerations of the same and the next "
        "nine samples. The target is steer_target; a full run also has steer_meas.",
        f"The published network reads neither the {BEHIND} samples before the present nor the vertical acceleration.",
        "The single track is fitted to the training lap alone; its terms were chosen by blocked cross-validation on "
        "that lap. The authors "
        "chose structure and seed on the validation lap.",
        f"The published RMSE are means of the RMSE of {BATCHES} batches of {BATCH} windows, the first of the "
        "validation lap; `scored as published` means these windows and this mean. All other RMSE are pooled over all "
        "windows. "
        "Servo: whole laps are "
        f"simulated from the target, linear between rows. The 95 % intervals are those of the mean over {PARTS} "
        "parts of a lap.",
    )
    about = (
        "Laps of 140 and 150 s by a full-size autonomous racer (A2RL), recorded at 20 Hz: comparison with a "
        "published inverse network."
    )
    return PublishedBench("a2rl", "Steering of a full-size racer", about, protocol, tuple(rows), answers, result)


def as_published(off: Array) -> float:
    """Mean of the RMSE of the first batches, rad."""
    return float(np.mean([rmse(off[k * BATCH : (k + 1) * BATCH]) for k in range(BATCHES)]))


def repeated(train: pd.DataFrame, off: Array, valid: pd.DataFrame, off_valid: Array) -> dict[str, float]:
    """How much of an error comes again on the next lap at the same place, which noise would not.

    `valid` holds the rows that follow those of `train`. Places are counted by distance; a lap is as long as the shift
    at which curvatures agree best.

    Returns
    -------
    correlation of both laps' errors; RMSE on the later lap (mrad), and what is left of it when the error of the
    earlier lap at that place is taken off; lap length (m) and correlation of curvatures. Empty where no lap closes.
    """
    both = pd.concat([train, valid], ignore_index=True)
    place = STEP * np.cumsum(both["vx"].to_numpy())
    metres: Array = np.arange(0.0, place[-1])
    curvature = np.interp(metres, place, both["curv"].to_numpy())
    shifts = range(len(metres) // 4, len(metres) - SHARED, 2)
    agree = [np.corrcoef(curvature[:-shift], curvature[shift:])[0, 1] for shift in shifts]
    if not len(valid) or not agree or max(agree) < CLOSED:
        return {}
    lap = shifts[int(np.argmax(agree))]
    known = np.flatnonzero(np.isfinite(off))
    then = place[len(train) :][: len(off_valid)] - lap
    kept = (then > place[0]) & (then < place[known[-1]]) & np.isfinite(off_valid)
    later, earlier = 1e3 * off_valid[kept], 1e3 * np.interp(then[kept], place[known], off[known])
    names = ("correlation", "rmse", "rmse_less_earlier", "lap_length", "correlation_of_curvature")
    together = np.corrcoef(later, earlier)[0, 1]
    values = (together, rmse(later), rmse(later - earlier), lap, max(agree))
    return dict(zip(names, map(float, values), strict=True))


SHARED, CLOSED = 1000, 0.95
"""m of a second lap that curvatures are compared over at least, and how well they agree where a lap closes (.996 here;
at other shifts less than .5)."""


def repeated_words(repeated: Mapping[str, float]) -> list[str]:
    """Whether what is left is noise."""
    if not repeated:
        return []
    return [
        f"The error is not noise alone: at the same places of a lap of {repeated['lap_length']:.0f} m, "
        f"errors of the next lap have correlation {repeated['correlation']:.2f} with those of the training lap, and "
        f"without the latter {repeated['rmse_less_earlier']:.2f} of {repeated['rmse']:.2f} mrad are left."
    ]


def servo_words(result: Mapping[str, Any]) -> str:
    """What a reader takes the servo for."""
    words = []
    for symbol in ("steering_delay", "lag"):
        value, other = (result[f"servo, {lap}, {symbol}"] for lap in ("training lap", "validation lap"))
        agree = value[0] <= other[1] and other[0] <= value[1]
        words.append(
            f"{symbol.removeprefix('steering_')} [{1e3 * value[0]:.1f}, {1e3 * value[1]:.1f}] and "
            f"[{1e3 * other[0]:.1f}, {1e3 * other[1]:.1f}] ms, which {'overlap' if agree else 'do not overlap'}"
        )
    delay, lag = (1e3 * result[f"servo, {symbol}, RMSE"] for symbol in ("steering_delay", "lag"))
    return (
        f"The servo is better described as a {'delay' if delay < lag else 'lag'}: on the other lap the delay errs by "
        f"{delay:.2f} mrad, the lag by {lag:.2f} mrad. The laps give: {'; '.join(words)}."
    )


def seen_before(train: pd.DataFrame, valid: pd.DataFrame) -> NDArray[np.bool_]:
    """(n,) whether a row of the validation lap is one of the training lap."""
    known = set(map(tuple, train.round(9).to_numpy()))
    return np.array([tuple(row) in known for row in valid.round(9).to_numpy()])


def without_gravity(lap: pd.DataFrame) -> pd.DataFrame:
    """The lap with a vertical acceleration that is zero on a level road: one of the files contains gravity."""
    return lap.assign(az=lap["az"] - G * np.round(lap["az"].mean() / G))


def turned(lap: pd.DataFrame, column: str) -> gb.Recording:
    """The lap backwards: what a window of the past holds are the samples to come.

    A model with memory predicts the sample after its newest input. The target moves by that sample and by the samples
    that are read behind it: that of row k then follows from the inputs of rows k - 5 to k + 9.
    """
    late = BEHIND + 1
    angle = np.pad(lap[column].to_numpy()[late:], (0, late), "edge")  # what is added is in the first window alone
    names = {"curv": "curvature", "vx": "v_x", "ax": "a_x", "ay": "a_y", "az": "a_z"}
    signals = {name: lap[item].to_numpy()[::-1] for item, name in names.items()} | {"steering": angle[::-1]}
    time: Array = STEP * np.arange(float(len(lap)))
    return gb.Recording(column, time, signals, extra_units={"curvature": "1/m", "steering": "rad"})


def errors(fit: gb.Fit, lap: pd.DataFrame, column: str) -> Array:
    """(n - 9,) predicted less recorded steering of rows 0 to n - 10, rad; the first row stands for those before it."""
    padded = pd.concat([lap.iloc[:1]] * (BEHIND + 1) + [lap], ignore_index=True)
    back = turned(padded, column)
    made = gb.predict(fit, back, open_loop=True)["steering"][::-1]
    off = made - back["steering"][::-1]
    return off[: len(lap) - AHEAD + 1]


def servo(train: pd.DataFrame, valid: pd.DataFrame, fresh: NDArray[np.bool_], result: dict[str, Any]) -> list[Row]:
    """How late the wheels are in either lap, as a pure delay and as a lag; the error of the one on the other.

    Free together, neither lap distinguishes the two: at 20 Hz only their sum is identifiable. Intervals are of the mean
    over parts of a lap, each fitted by itself: what the servo does otherwise in other corners is in them.
    """
    laps = {"training lap": train, "validation lap": valid[fresh] if fresh.any() else valid}
    rows: list[Row] = []
    lap, task = followed(laps["validation lap"]), "Servo, fresh rows of the validation lap: RMSE of the measured angle"
    held_out: list[Row] = []
    for symbol, held in (("steering_delay", {"lag": INSTANT}), ("lag", {"steering_delay": 0.0})):
        word = symbol.removeprefix("steering_")
        for name, one in laps.items():
            with clocked() as spent:
                late = [float(late_by(followed(part), held).params[symbol]) for part in parts(one)]
            middle, reach = float(np.mean(late)), float(stats.t.ppf(0.975, PARTS - 1) * stats.sem(late))
            whose = f"{name}, fresh rows" if name[0] == "v" else name
            about = f"Servo as a {word}, with 95 % interval"
            rows.append(Row(about, whose, 1e3 * middle, "ms", 1e3 * reach, 3, spent[0]))
            result[f"servo, {name}, {symbol}"] = [middle - reach, middle + reach]
        off = gb.simulate(late_by(followed(train), held), lap)["steer_measured"] - lap["steer_measured"]
        result[f"servo, {symbol}, RMSE"] = rmse(off)
        held_out.append(Row(task, f"{word} of the training lap", 1e3 * rmse(off), "mrad", parameters=3))
    untouched = 1e3 * rmse(lap["steer"] - lap["steer_measured"])
    return [*rows, *held_out, Row(task, "target as it is", untouched, "mrad", parameters=0)]


def late_by(lap: gb.Recording, held: Mapping[str, float]) -> gb.Fit:
    """The servo fitted to rows, with a lag or a delay held."""
    model = gb.models.steering() + gb.effects.steering_delay.free()
    return gb.fit(model, [lap], fix=held, options=gb.FitOptions(solver="gauss-newton"))


PARTS = 10
"""Of a lap: 14 s each, far longer than errors of the servo stay correlated."""


def parts(lap: pd.DataFrame) -> list[pd.DataFrame]:
    """Parts of a lap, of one length."""
    ends = np.linspace(0, len(lap), PARTS + 1).astype(int)
    return [lap.iloc[first:last] for first, last in pairwise(ends)]


INSTANT = 2e-3
"""s: a lag that cannot be seen in rows 50 ms apart."""


def followed(lap: pd.DataFrame) -> gb.Recording:
    """Target and measured angle."""
    signals = {"steer": lap["steer_target"].to_numpy(), "steer_measured": lap["steer_meas"].to_numpy()}
    return gb.Recording(
        "servo", STEP * np.arange(len(lap), dtype=float), signals, extra_units={"steer_measured": "rad"}, hold="linear"
    )
