"""A grey box that is no car, and the tools beside this one: a servo axis with friction, on one recording, in one run.

The axis is that of the EMPS benchmark (Janot, Gautier, Brunot, nonlinearbenchmark.org, 2019): its equations, with the
magnitudes that its reference model has to two digits, in a loop of position and velocity, on trapezoids of 0.2 m. Where
DATA holds no recording of it, it is simulated here: as long as that recording and at its rate, in ten times as many
steps as tools take. What is published for the recording has a table of its own.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from importlib import import_module
from math import tanh
from pathlib import Path

import numpy as np
import pandas as pd

import greybox_id as gb
from greybox_id.base.numbers import number
from greybox_id.base.shorthands import Array, Say

from .bench import PublishedBench, Row, clocked, frame, rmse
from .equations import servo_axis
from .peers import PEERS, SHARP, simulated

TRUTH = {"M": 95.0, "F_v": 203.0, "F_c": 20.0, "F_0": -3.2}
"""kg, N s/m, N, N."""
WHOLE, SEARCH = "greybox-id, first call", "greybox-id, search only, first call"
"""What compares with other tools' calls, compiling included: all that a fit gives, and from rows to estimates."""
GAINS = 160.0, 243.0, 35.15
"""1/s, V s/m, N/V: position and velocity loop, force of a volt."""
STEP, ROWS, TURN = 1e-3, 24_841, 1e-5
"""s, rows of the recording of the real axis, m: scatter of the position (a count of the encoder)."""
QUICK_SHARE = 5
"""A quick run gives every tool the first fifth of its rows."""
SHAKE = 0.2
"""N: scatter of the recorded force."""
MOST_AXIS, MOST_FORCE = 0.2, 300.0
"""m/s, N: of the trapezoids, and of the motor."""
FINE = 10
"""Steps of a row with which the axis is simulated here: tools take one."""
PUBLISHED = {
    "LTI state space": 5.53, "LTI ARX": 12.6, "polynomial NARX": 5.17, "GP NARX": 1690.0, "MLP NARX": 133.0,
    "MLP FIR": 121.0, "RNN": 89.2, "GRU": 220.0, "LSTM": 74.1, "OLSTM": 111.0,
}  # fmt: skip
"""mm: position on the recording's test part, in free run; ten baselines of Champneys, Beintema, Tóth, Schoukens and
Rogers, Baseline results for selected nonlinear system identification benchmarks, arXiv 2405.10779v2, Table 3,
as a public transcription has it."""


def measure(data: Path | None, quick: bool, say: Say) -> PublishedBench:
    """Identify the axis with every tool that is installed. Raises `BadInput` where DATA lacks axis.csv."""
    columns = ("time", "force", "position")
    lap, other = (
        (made(1), made(2)) if data is None else (frame(data, name, columns, "emps") for name in ("axis", "axis_test"))
    )
    time, force, position = (lap[name].to_numpy() for name in columns)
    step = float(time[1] - time[0])
    nominal = {name: float(servo_axis()[name].array) for name in TRUTH}
    rows: list[Row] = []
    left_out: dict[str, str] = {}
    speed: dict[str, float] = {}

    def add(name: str, spent: float, estimates: dict[str, float], count: int) -> None:
        start = float(other["position"].iloc[0])
        theta = np.array([estimates[item] for item in TRUTH])
        off = simulated(theta, start, other["force"].to_numpy(), step) - other["position"].to_numpy()
        rows.append(
            Row(
                f"RMSE of the position on a held-out run, free run of {len(other) * step:.0f} s",
                name,
                1e3 * rmse(off),
                "mm",
                None,
                4,
                spent,
            )
        )
        if data is None:
            away = max(abs(estimates[name] / true - 1.0) for name, true in TRUTH.items())
            rows.append(Row("Largest error of a parameter", name, 100.0 * away, "%", None, 4, spent))
        speed[name] = count * len(TRUTH) / spent

    say("greybox-id")
    rows_of_all = len(time) // QUICK_SHARE if quick else len(time)  # a tool's fixed costs weigh more on fewer rows
    recording = gb.Recording(
        "axis", time[:rows_of_all], {"force": force[:rows_of_all], "position": position[:rows_of_all]},
        extra_units={"force": "N", "position": "m"},
    )  # fmt: skip
    for call in (", first call", ""):
        with clocked() as spent:
            fit = gb.fit(servo_axis(), [recording], options=gb.FitOptions(solver="gauss-newton"))
        estimates = {item: float(fit.params[item]) for item in TRUTH}
        add(f"greybox-id{call}", spent[0], estimates, rows_of_all)
        add(f"greybox-id, search only{call}", sum(stage.cpu_seconds for stage in fit.stages), estimates, rows_of_all)
    for name, (peer, most, package) in PEERS.items():
        count = min(len(time), most // QUICK_SHARE if quick else most)
        say(f"{name}, {count} rows")
        theirs, spent_there, why = tried(peer, package, time[:count], force[:count], position[:count], nominal)
        if theirs is None:
            left_out[name] = why
        else:
            add(name, spent_there, dict(zip(TRUTH, theirs, strict=True)), count)
    task = "Samples × parameters per CPU second"
    rows += [Row(task, name, value, "1/s", None, 4) for name, value in speed.items()]
    task = "Published for the recording of the real axis: RMSE of the position, free run"
    rows += [Row(task, name, value, "mm", published=True) for name, value in PUBLISHED.items()]
    others = {name: value for name, value in speed.items() if not name.startswith("greybox")}
    fastest = max(others, key=lambda name: others[name]) if others else ""
    answers = [
        f"Per sample of the recording, {name} takes {number(speed[SEARCH] / value, 2)} times the CPU time of the "
        f"optimisation in greybox-id (search only)."
        for name, value in others.items()
    ]
    if fastest:
        far = {row.model: row.value for row in rows if row.task.startswith("RMSE")}
        answers.insert(
            0,
            f"Compared with {fastest}, the fastest other tool here, the optimisation in greybox-id (search only), "
            f"which like the other tools gives estimates only, is {number(speed[SEARCH] / others[fastest], 2)} times "
            f"as fast, and a whole fit, with "
            f"intervals and errors over horizons, is {number(speed[WHOLE] / others[fastest], 2)} times as fast "
            f"({number(speed['greybox-id'] / others[fastest], 2)} times from the second call on). The error of "
            f"greybox-id on the held-out run is {number(far[WHOLE] / far[fastest], 2)} times that of the other tool.",
        )
    protocol = (
        f"Task: estimate four parameters from position and force, {rows_of_all} rows at {1 / step:.0f} Hz, from the "
        "same start; every tool gets the same rows, or the first ones up to its row limit. CPU seconds include "
        "compiling but not imports; greybox-id is timed at its first and at a later call. Ratios are those of the "
        "first call unless they say otherwise, since the other tools compile, too.",
        "Tools use the same equations; the sign in the friction is tanh(velocity / 1 mm/s). Equations are integrated "
        "by a fourth-order Runge-Kutta method with one step per row, unless a tool has its own integrator.",
        "Other tools use the settings of their examples; experts in these tools may get better results.",
        "The ten published baselines (Champneys et al., arXiv 2405.10779) were fitted to the recording of the real "
        "axis. An axis that is simulated by the fitted equations is easier: compare only orders of magnitude.",
        *(f"{name} is left out: {why}" for name, why in left_out.items()),
    )
    about = "Servo axis in the form of the EMPS benchmark: M q'' = F − F_v q' − F_c sign(q') − F_0."
    result = {"speed": speed, "left_out": left_out}
    return PublishedBench("emps", "A servo axis, and other tools", about, protocol, tuple(rows), tuple(answers), result)


def tried(
    peer: Callable[..., Array], package: str, time: Array, force: Array, position: Array, nominal: dict[str, float]
) -> tuple[Array | None, float, str]:
    """What another tool estimates, and its CPU seconds once `package` is imported; or why it does not."""
    try:
        with redirect_stdout(sys.stderr):
            import_module(package)
        with redirect_stdout(sys.stderr), clocked() as spent:
            result = peer(time, force, position, np.array(list(nominal.values())))
    except ImportError as error:
        return None, 0.0, f"it is not installed ({error})"
    except Exception as error:  # whatever another library raises is told, not raised
        return None, 0.0, f"it fails ({type(error).__name__}: {error})"
    if not np.all(np.isfinite(result)):
        return None, 0.0, "its estimates are not numbers"
    return np.asarray(result), spent[0], ""


def made(seed: int) -> pd.DataFrame:
    """The axis in its loop, on trapezoids of random height: time s, force N, position m."""
    random = np.random.default_rng(seed)
    k_p, k_v, volt = GAINS
    goals = np.concatenate([[0.0], random.uniform(0.05, 0.2, 20) * np.where(np.arange(20) % 2, 0.0, 1.0)])

    def wanted(t: float) -> float:
        k = min(int(t / 1.25), len(goals) - 2)
        share = np.clip((t - 1.25 * k) * MOST_AXIS / max(abs(goals[k + 1] - goals[k]), 1e-9), 0.0, 1.0)
        return float(goals[k] + (goals[k + 1] - goals[k]) * share * share * (3.0 - 2.0 * share))

    def rate(v: float, F: float) -> float:
        return (F - TRUTH["F_v"] * v - TRUTH["F_c"] * tanh(v / SHARP) - TRUTH["F_0"]) / TRUTH["M"]

    time = STEP * np.arange(ROWS)
    x, v, force, position = 0.0, 0.0, np.zeros(ROWS), np.zeros(ROWS)
    h = STEP / FINE
    for k, t in enumerate(time):  # the controller holds its force for a row, as its converter does
        F = min(max(volt * k_v * (k_p * (wanted(t) - x) - v), -MOST_FORCE), MOST_FORCE)
        position[k], force[k] = x, F
        for _ in range(FINE):
            a = rate(v, F)
            b = rate(v + 0.5 * h * a, F)
            c = rate(v + 0.5 * h * b, F)
            d = rate(v + h * c, F)
            x, v = x + h * v + h * h / 6 * (a + b + c), v + h / 6 * (a + 2 * (b + c) + d)
    return pd.DataFrame({"time": time, "force": force + SHAKE * random.standard_normal(len(time)),
                         "position": position + TURN * random.standard_normal(len(time))})  # fmt: skip
