"""Sideslip by filter and smoother against what was measured, and how fast filters are.

    python benchmarks/estimators.py --data DIR [--json] [--parts sideslip speed]

sideslip  The Ferrari 250 LM's recordings in DIR/revs_250lm (or DIR): v_x, steer, yaw_rate and a_y go in, the measured
          sideslip only scores. The vehicle's numbers were tuned on the innovations of the first 200 s; every other
          segment is new to them. The first 2 s of each segment are left out.
speed     Samples per second of processor time of filters with four states, beside filterpy's.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from running import options, tell
from threadpoolctl import threadpool_limits

from greybox_id.base.errors import GreyboxError
from greybox_id.base.shorthands import Array
from greybox_id.datasets.read import SUFFIXES, read
from greybox_id.datasets.recording import Recording
from greybox_id.filters.how import TrackOptions
from greybox_id.filters.track import Track
from greybox_id.filters.verb import track
from greybox_id.fitting.requested_model import RequestedModel, named_vehicle
from greybox_id.models.effects import EFFECTS
from greybox_id.models.motion_model import MotionModel
from greybox_id.models.registry import build

SKIPPED = 2.0
"""s at the beginning of each segment."""
LEAK = 1.0
"""s, time constant of the leaky integration."""
PROTOTYPE = {
    "sideslip is zero": 1.77, "leaky integration": 1.82, "EKF, linear tyres": 0.52, "EKF, Pacejka": 0.33,
}  # fmt: skip
"""RMSE, deg, of a prototype on 200 to 400 s; its filters were chosen after seeing the segments."""
SPEED_ROWS = 20_000
FILTERPY_ROWS = 2_000
PARTS = ("sideslip", "speed")


def main() -> None:
    """Run the benchmark."""
    given = options(
        __doc__, data={"type": Path, "help": "folder of the recordings; the part sideslip needs it"},
        parts={"nargs": "+", "choices": PARTS, "default": list(PARTS)},
    )  # fmt: skip
    found: dict[str, list[dict[str, Any]]] = {}
    with threadpool_limits(1):
        if "sideslip" in given.parts:
            if given.data is None:
                raise SystemExit("The part sideslip needs --data DIR; or name others with --parts.")
            found["sideslip"] = [row for name, part in segments(given.data) for row in sideslip_rows(name, part)]
        if "speed" in given.parts:
            found["speed"] = speed_rows()
    tell(found, given.json)


def segments(data: Path) -> Iterator[tuple[str, Recording]]:
    """Each part of each recording: the first 400 s in halves, others whole."""
    folder = data / "revs_250lm" if (data / "revs_250lm").is_dir() else data
    files = sorted(path for path in folder.iterdir() if path.name.endswith(tuple(SUFFIXES))) if folder.is_dir() else []
    if not files:
        raise GreyboxError(f"{folder} holds no recording ({', '.join(SUFFIXES)}).")
    for file in files:
        whole = read(file, "revs_250lm")
        if "first400s" not in file.name:
            yield whole.name, whole
            continue
        half = int(np.searchsorted(whole.time, whole.time[0] + 200.0))
        yield "0-200 s (tuned)", whole.rows(0, half)
        yield "200-400 s", whole.rows(half, len(whole))


def sideslip_rows(name: str, recording: Recording) -> Iterator[dict[str, Any]]:
    """One row for each method."""
    vehicle = named_vehicle("ferrari_250lm")
    assert vehicle is not None
    assert vehicle.tracking is not None
    plan = vehicle.tracking
    truth, skipped = recording["sideslip"], recording.time - recording.time[0] < SKIPPED
    blind = replace(recording, signals={n: recording[n] for n in ("v_x", "steer", "yaw_rate", "a_y")})

    def told_of(method: str, estimate: Array, sd: Array | None = None, found: Track | None = None) -> dict[str, Any]:
        error = np.degrees(estimate - truth)[~skipped]
        told: dict[str, Any] = {"method": method, "segment": name}
        told |= {"rmse_deg": float(np.sqrt(np.mean(error**2))), "max_deg": float(np.max(np.abs(error)))}
        told["coverage"] = None if sd is None else float(np.mean(np.abs(error) < 2 * np.degrees(sd)[~skipped]))
        told["nis"] = {} if found is None else {n: round(c.nis, 3) for n, c in found.consistency.items()}
        told["log_likelihood"] = None if found is None else found.log_likelihood
        told["samples_per_cpu_second"] = None if found is None else len(found.rows) / max(found.seconds, 1e-9)
        told["prototype_rmse_deg"] = PROTOTYPE.get(method) if name == "200-400 s" else None
        return told

    yield told_of("sideslip is zero", np.zeros(len(recording)))
    yield told_of("leaky integration", leaky(recording))
    linear = RequestedModel("lateral", vehicle, {"tyre": "linear"}).model()
    assert isinstance(linear, MotionModel)
    found = track(linear, blind, ("C_alpha_f", "C_alpha_r"), how=TrackOptions("ekf"))
    yield told_of("EKF, linear tyres, stiffness tracked", found.values["sideslip"], found.sds["sideslip"], found)
    model = RequestedModel(None, vehicle).model()
    assert isinstance(model, MotionModel)
    for kind in ("ekf", "ukf"):
        for smooth in (False, True):
            how = TrackOptions(kind, smooth, known=plan.noise)
            found = track(model, blind, plan.parameters, disturbances=plan.disturbances, effects=EFFECTS, how=how)
            method = f"{kind.upper()}, vehicle's own model{', smoothed' if smooth else ''}"
            yield told_of(method, found.values["sideslip"], found.sds["sideslip"], found)


def leaky(recording: Recording) -> Array:
    """Sideslip from a_y - yaw_rate v_x, integrated and forgotten."""
    found, step = np.zeros(len(recording)), recording.sample_time
    rate = recording["a_y"] / recording["v_x"] - recording["yaw_rate"]
    for k in range(1, len(found)):
        found[k] = found[k - 1] * (1 - step / LEAK) + step * rate[k - 1]
    return found


def speed_rows() -> list[dict[str, Any]]:
    """Samples per second of processor time: v_y, yaw_rate and both stiffnesses from yaw_rate and a_y."""
    random = np.random.default_rng(0)
    t = np.arange(SPEED_ROWS) * 0.01
    steer = 0.02 * np.sin(0.7 * t)
    signals = {
        "steer": steer, "v_x": np.full(len(t), 25.0), "yaw_rate": 5.0 * steer + 0.01 * random.standard_normal(len(t)),
        "a_y": 125.0 * steer + 0.5 * random.standard_normal(len(t)),
    }  # fmt: skip
    recording = Recording("speed", t, signals)
    model = build("lateral", {"tyre": "linear"})
    assert isinstance(model, MotionModel)
    model = model.with_parameters(*(replace(own, fixed=True, prior=None) for own in model.parameters))
    rows = []
    for kind in ("ekf", "ukf"):
        filterpy = _filterpy_speed(kind, signals)
        for smooth in (False, True):
            how = TrackOptions(kind, smooth, tune=0.0)
            own = max(
                SPEED_ROWS / track(model, recording, ("C_alpha_f", "C_alpha_r"), how=how).seconds for _ in range(5)
            )
            rows.append(
                {
                    "method": f"{kind.upper()}, 4 states" + (", with what a smoother needs" if smooth else ""),
                    "samples_per_cpu_second": own,
                    "filterpy": filterpy,
                    "ratio": own / filterpy,
                }
            )
    return rows


def _filterpy_speed(kind: str, signals: dict[str, Array]) -> float:
    """filterpy on the same readings; its model is written by hand, a forward Euler step with a closed derivative."""
    m, I_z, l_f, l_r, dt, v = 1450.0, 2270.0, 1.3, 1.46, 0.01, 25.0

    def forces(x: Array, steer: float) -> tuple[float, float, float, float]:
        alpha_f = steer - math.atan2(x[0] + l_f * x[1], v)
        alpha_r = -math.atan2(x[0] - l_r * x[1], v)
        return x[2] * alpha_f, x[3] * alpha_r, alpha_f, alpha_r

    def step(x: Array, dt: float, steer: float) -> Array:
        F_f, F_r, _, _ = forces(x, steer)
        a_y, turning = (F_f + F_r) / m, (l_f * F_f - l_r * F_r) / I_z
        return np.array([x[0] + dt * (a_y - v * x[1]), x[1] + dt * turning, x[2], x[3]])

    def read_all(x: Array, steer: float) -> Array:
        F_f, F_r, _, _ = forces(x, steer)
        return np.array([x[1], (F_f + F_r) / m])

    def by_state(x: Array, steer: float) -> Array:
        _, _, alpha_f, alpha_r = forces(x, steer)
        return np.array(
            [[0, 1, 0, 0], [-(x[2] + x[3]) / (m * v), (-l_f * x[2] + l_r * x[3]) / (m * v), alpha_f / m, alpha_r / m]]
        )

    start, P = np.array([0.0, 0.0, 9e4, 1e5]), np.diag([0.1, 0.01, 1e8, 1e8])
    Q, R = np.diag([1e-4, 1e-5, 1e4, 1e4]), np.diag([1e-4, 0.25])
    readings = np.column_stack([signals["yaw_rate"], signals["a_y"]])[:FILTERPY_ROWS]
    steers = signals["steer"].tolist()
    if kind == "ukf":
        points = MerweScaledSigmaPoints(4, 1.0, 2.0, 0.0)
        one = UnscentedKalmanFilter(4, 2, dt, read_all, step, points)
        one.x, one.P, one.Q, one.R = start, P, Q, R
        clock = time.process_time()
        for k, z in enumerate(readings):
            one.predict(steer=steers[k])
            one.update(z, steer=steers[k])
        return FILTERPY_ROWS / (time.process_time() - clock)
    other = ExtendedKalmanFilter(4, 2)
    other.x, other.P, other.Q, other.R = start, P, Q, R
    clock = time.process_time()
    for k, z in enumerate(readings):
        H = by_state(other.x, steers[k])
        other.F = np.eye(4)
        other.F[0] += dt * (H[1] - np.array([0, v, 0, 0]))
        moment = np.array([-l_f * other.x[2] + l_r * other.x[3], -(l_f**2) * other.x[2] - l_r**2 * other.x[3]]) / v
        _, _, alpha_f, alpha_r = forces(other.x, steers[k])
        other.F[1] += dt / I_z * np.array([*moment, l_f * alpha_f, -l_r * alpha_r])
        other.x = step(other.x, dt, steers[k])
        other.P = other.F @ other.P @ other.F.T + other.Q
        other.update(z, by_state, read_all, args=(steers[k],), hx_args=(steers[k],))
    return FILTERPY_ROWS / (time.process_time() - clock)


if __name__ == "__main__":
    main()
