"""Grip under brakes, from other people's simulator: tracked over time, known where axles lock, and unknown elsewhere.

Source: "A Road Friction-Aware Anti-Lock Braking System Based on Model-Structured Neural Networks"; recordings in
tonegas/nnodely-applications, vehicle/road_friction_aware_ABS. Wheel speeds in the files are sums of an axle's two
wheels (twice the speed over the radius of 0.2286 m that the authors state), torques are those that act: of a locked
wheel, what the road makes of it.

The lap that is tracked is cut together of both recordings where no other is there, so that its grip steps.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import greybox_id as gb
from greybox_id.base.errors import BadInput
from greybox_id.base.shorthands import Array, Say

from .bench import PublishedBench, Row, clocked, frame, rmse
from .equations import WINDOW, braked_car

COLUMNS = (
    "brake_pedal", "speed", "acc", "motor_torque", "f_rot_speed", "r_rot_speed",
    "final_brake_tw_rr", "final_brake_tw_rl", "final_brake_tw_fr", "final_brake_tw_fl",
)  # fmt: skip
GRIP = {"dry": 1.0, "ice": 0.25}
RADIUS = 0.2286
"""m, of the authors' `train_MS_NN.py`."""
STEP = 0.05
LOCKED, STANDING, SETTLED = 0.8, 3.0, 6
"""An axle is locked while it slips by so much, above so many m/s, for so many samples already."""
TOLD = 0.1
"""Grip is known where its standard deviation is below the bar that its error is held to."""
UNKNOWN = 0.5
"""Grip that a lap begins with, by a factor of e either way: the middle of what roads offer."""
WALK = float(np.log(GRIP["dry"] / GRIP["ice"]) / np.sqrt(10.0))
"""Per root second, of its logarithm: grip may change from ice to dry within ten seconds."""
SCATTER = 100.0
"""N: a tenth of what an axle brakes with on ice."""
EVIDENCE = 20
"""Samples over which the two networks' errors are compared: one second."""
OURS, CHOSEN = "tracked by the locked axles", "whichever of two linear networks fits better"
SECONDS = 100.0
"""Of each piece of the lap that is cut together."""


def measure(data: Path, quick: bool, say: Say) -> PublishedBench:
    """Fit to dry and ice, track grip. Raises `BadInput` where a recording is not there."""
    roads = {name: frame(data, name, COLUMNS, "abs") for name in GRIP}
    lap, truth, name = stepped(data, roads)
    say("fitting the car on ice")
    with clocked() as spent:
        fit = gb.fit(braked_car(), [braked(roads["ice"], "ice")], fix={"grip_scale": GRIP["ice"]},
                     options=gb.FitOptions(solver="gauss-newton", horizon=2.0))  # fmt: skip
    say(f"tracking {name}")
    noise = {"walk_grip_scale": WALK, "noise_sliding_front": SCATTER, "noise_sliding_rear": SCATTER}
    how = gb.TrackOptions(readings=("v_x", "a_x", "sliding_front", "sliding_rear"), tune=0.0, noise=noise)
    with clocked() as walked:
        start = fit.model.with_parameters(replace(fit.model["grip_scale"], value=UNKNOWN))
        track = gb.track(start, braked(lap, name), ["grip_scale"], options=how).to_pandas()
    grip, sd = track["grip_scale"].to_numpy(), track["grip_scale_sd"].to_numpy()
    known = sd < TOLD
    chosen = chosen_road(roads, lap)
    task, rest = f"Grip on {name}, where it is known ({100 * known.mean():.0f} % of the time): RMSE", "elsewhere"
    free = sum(not parameter.fixed for parameter in fit.model.parameters)
    rows = [
        Row(task, OURS, rmse(grip[known] - truth[known]), "1", None, free, spent[0] + walked[0]),
        Row(task, CHOSEN, rmse(chosen[known] - truth[known]), "1", None, 2 * FEATURES),
        Row(f"Grip on {name}, {rest}: share of the time in which the 95 % interval holds it", OURS,
            100.0 * float(np.mean((np.abs(np.log(grip / truth)) < 1.96 * sd / grip)[~known])), "%", parameters=free),
        Row(f"Grip on {name}, all of the time: RMSE", OURS, rmse(grip - truth), "1", None, free),
        Row(f"Grip on {name}, all of the time: RMSE", CHOSEN, rmse(chosen - truth), "1", None, 2 * FEATURES),
    ]  # fmt: skip
    low, high = map(float, fit.conf_int(0.95).loc["slide_front"].to_numpy())
    answers = (
        f"Use a tracked grip only while its standard deviation is below {TOLD:g}: its error is {rows[0].value:.3f} "
        "there. "
        "Elsewhere no axle locks and the interval is wide.",
        f"A car with {free} free parameters, fitted on ice alone, is used on all roads. Its sliding friction of the "
        f"front axle at grip 1 is {low:.0f} to {high:.0f} N (95 % interval).",
    )  # fmt: skip
    protocol = (
        "Task: estimate the grip from the pedals' torques, speeds and acceleration, sample by sample, from past "
        "samples only.",
        f"Lap: {name}. The true grip is the value that the authors of the recordings set: 1 on dry road, 0.25 on ice.",
        "Ours: gb.fit of an own model on ice, gb.track of grip_scale along the lap; walk and scatter are stated, "
        "they are not tuned on the lap.",
        "Compared with the authors' selection among networks: a model of each road predicts the acceleration of the "
        "last second from pedal, motor torque and speed, and the road with the smaller errors is chosen.",
    )
    result = {"estimates": fit.params.to_dict(), "known_share": float(known.mean())}
    about = "Brakes with and without grip, 300 s each at 20 Hz of a simulator that shares no code with this project."
    return PublishedBench("abs", "Grip under brakes", about, protocol, tuple(rows), answers, result)


def stepped(data: Path, roads: dict[str, pd.DataFrame]) -> tuple[pd.DataFrame, Array, str]:
    """A lap on which the grip changes in steps, its grip and its name.

    It is test.csv with a column grip or a file grip.csv beside it, or pieces of the two roads in turn.
    """
    if any((data / f"test.csv{end}").is_file() for end in ("", ".gz")):
        steps = data / "grip.csv"
        if not steps.is_file():
            lap = frame(data, "test", (*COLUMNS, "grip"), "abs")
            return lap, lap["grip"].to_numpy(), "test"
        lap = frame(data, "test", COLUMNS, "abs")
        at = pd.read_csv(steps).to_numpy(float)  # time s, grip: it holds from there on
        rows = np.searchsorted(at[:, 0], STEP * np.arange(1.0, len(lap) + 1.0), side="right") - 1
        return lap, at[np.maximum(rows, 0), 1], "test"
    length = round(SECONDS / STEP)
    pieces = [(road, roads[road].iloc[k * length : (k + 1) * length]) for k in range(3) for road in GRIP]
    pieces = [(road, part) for road, part in pieces if len(part)]
    if not pieces:
        raise BadInput(f"{data} holds less than a second of each road; fetch it again.")
    truth = np.concatenate([np.full(len(part), GRIP[road]) for road, part in pieces])
    return pd.concat([part for _, part in pieces], ignore_index=True), truth, "a lap cut together of dry and ice"


def braked(lap: pd.DataFrame, name: str) -> gb.Recording:
    """Forces of both axles as inputs, and as readings of sliding friction while they are locked."""
    speed = lap["speed"].rolling(5, min_periods=1).mean().to_numpy()
    torque = {
        "front": lap["final_brake_tw_fl"] + lap["final_brake_tw_fr"],
        "rear": lap["final_brake_tw_rl"] + lap["final_brake_tw_rr"],
    }
    signals: dict[str, Array] = {
        "v_x": lap["speed"].to_numpy(),
        "a_x": lap["acc"].to_numpy(),
        "motor_torque": lap["motor_torque"].to_numpy(),
    }
    for axle, item in torque.items():
        wheels = lap[f"{axle[0]}_rot_speed"].to_numpy() * RADIUS / 2.0
        slips = (1.0 - wheels / np.maximum(speed, 1.0) > LOCKED) & (speed > STANDING)
        settled = np.convolve(slips, np.ones(SETTLED))[: len(slips)] > SETTLED - 0.5
        signals[f"brake_{axle}"] = item.to_numpy() / RADIUS
        signals[f"sliding_{axle}"] = np.where(settled, item.to_numpy() / RADIUS, np.nan)
    units = {"motor_torque": "N m"} | {f"{what}_{axle}": "N" for what in ("brake", "sliding") for axle in torque}
    return gb.Recording(name, STEP * np.arange(1.0, len(lap) + 1.0), signals, extra_units=units, hold="linear")


FEATURES = 2 * WINDOW + 3
"""Weights of one road's model of the acceleration."""


def chosen_road(roads: dict[str, pd.DataFrame], lap: pd.DataFrame) -> Array:
    """(n,) grip of the road whose model of the acceleration erred least over the last second."""
    seen = features(lap)
    errors = []
    for road in GRIP:
        weights = np.linalg.lstsq(features(roads[road]), roads[road]["acc"].to_numpy(), rcond=None)[0]
        errors.append(pd.Series((seen @ weights - lap["acc"].to_numpy()) ** 2).rolling(EVIDENCE, min_periods=1).mean())
    grips: Any = np.array(list(GRIP.values()))
    best: Array = grips[np.argmin(np.array(errors), axis=0)]
    return best


def features(lap: pd.DataFrame) -> Array:
    """(n, 23) the last ten samples of pedal and motor torque, speed, its square and one."""
    windows = [
        np.concatenate([np.full(k, item[0]), item[: len(item) - k]])
        for item in (lap["brake_pedal"].to_numpy(), lap["motor_torque"].to_numpy())
        for k in range(WINDOW)
    ]
    speed = lap["speed"].to_numpy()
    return np.stack([*windows, speed, speed**2, np.ones(len(lap))], axis=1)
