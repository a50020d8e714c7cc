"""The controller drives a designed manoeuvre: the plan.csv of `greybox design`, path and speed.

    python examples/nmpc/follow.py next/plan.csv --vehicle car.toml

It drives the vehicle of scene.py as its file states it. A controller that looks ahead takes a plan's path and speed;
one that does not takes the plan's commands row by row and the few lines of `greybox_id.gap.design.driver`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from controller import Controller
from lap import Lap, lap
from prediction import Prediction
from scene import PAIRS, PERIOD, SEED, STAGES, Scene

from greybox_id.models.motion_model import MotionModel
from greybox_id.models.registry import model_of
from greybox_id.models.vehicle import vehicle
from greybox_lab.driving.racing.track import POINTS, RaceTrack


def path_of(plan: pd.DataFrame, half_width: float) -> tuple[RaceTrack, float]:
    """The path of a plan from the origin along x, and its length; a straight follows, since controllers look ahead.

    Parameters
    ----------
    plan : x, y, yaw and v_x, row by row.
    half_width : m, how far from the path the vehicle may go.
    """
    start = plan.iloc[0]
    line = (plan["x"] - start["x"] + 1j * (plan["y"] - start["y"])).to_numpy() * np.exp(-1j * start["yaw"])
    there = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(line)))))
    length = float(there[-1])
    s = np.linspace(0.0, length + 3.0 * STAGES * PERIOD * float(plan["v_x"].iloc[-1]), POINTS)
    course = np.unwrap(np.angle(np.diff(line, append=2 * line[-1] - line[-2])))
    yaw = np.interp(s, there, course)
    points = np.interp(s, there, line) + np.exp(1j * course[-1]) * np.maximum(s - length, 0.0)
    speed = np.interp(s, there, plan["v_x"])
    return RaceTrack(s, points.real, points.imag, yaw, np.gradient(yaw, s), speed, half_width), length


def followed(plan: pd.DataFrame, scene: Scene, model: MotionModel) -> Lap:
    """A plan as a controller drives it that believes a model."""
    path, length = path_of(plan, scene.track.half_width)
    driver = Controller(Prediction(model, PERIOD, scene.wishes.units), path, scene.wishes, float(path.speed[0]))
    return lap(scene.stated, {}, "nominal", SEED, path, driver, PERIOD, length)


def main() -> None:
    """Drive a plan, and say how well."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plan", type=Path, help="plan.csv of greybox design")
    parser.add_argument("--vehicle", required=True, help="what the controller believes, as race.py writes it")
    asked = parser.parse_args()
    model = model_of(vehicle(asked.vehicle))
    assert isinstance(model, MotionModel)
    own = followed(pd.read_csv(asked.plan), Scene(PAIRS[0]), model)
    print(
        f"{'driven to its end' if own.finished else f'lost after {own.s[-1]:.1f} m'} in {own.time:.1f} s: path error "
        f"{1e3 * own.rms:.0f} mm rms, {1e3 * own.p95:.0f} mm 95 %; speed error {np.std(own.speed_error):.2f} m/s; most "
        f"of an axle's grip {own.use.max():.2f}"
    )


if __name__ == "__main__":
    main()
