"""One problem and who solves it: the engine, Ipopt alone, scipy. `speed.py` and `starts.py` take it from here.

A single-track vehicle at a measured speed (Pacejka, four Runge-Kutta stages per sample) free-runs through a simulated
drive at 50 Hz; nine unknowns (B, C, D of both axles, yaw inertia, two initial states) are fitted to noisy v_y, yaw rate
and a_y. Everyone starts from the same wrong parameters. Times are CPU seconds of the solve; stating the problem is
listed apart.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import casadi as cs
import numpy as np
from scipy.optimize import least_squares

from greybox_id.base.shorthands import Array
from greybox_id.datasets.recording import Recording
from greybox_id.engine.motion.shooting import MotionProblem
from greybox_id.engine.motion.simulator import Simulator
from greybox_id.engine.solvers.gauss_newton import gauss_newton
from greybox_id.fitting.attempt import SHORT_HORIZONS, SHORT_ROWS, SHORT_STEPS
from greybox_id.models.motion_model import MotionModel
from greybox_id.models.single_track import lateral

DT = 0.02
NOISE = np.array([0.02, 0.01, 0.15])
"""Standard deviations of v_y [m/s], yaw rate [rad/s] and a_y [m/s^2]."""
WRONG = {"B_f": 0.6, "C_f": 1.15, "D_f": 0.8, "B_r": 1.5, "C_r": 0.9, "D_r": 1.2, "I_z": 1.6}
"""Factors on the true parameters where everyone starts."""
FREE = tuple(WRONG)


@dataclass(frozen=True)
class Solved:
    """One method's answer."""

    parameters: Array
    objective: float
    solve_seconds: float
    state_seconds: float
    iterations: int


def problem(samples: int) -> tuple[MotionModel, Recording]:
    """The model at its wrong start, and a simulated noisy drive."""
    model = lateral()
    model = model.with_parameters(*(replace(p, fixed=p.name not in FREE) for p in model.parameters))
    random = np.random.default_rng(7)
    time_ = DT * np.arange(samples)
    nothing = np.full(samples, np.nan)
    first = {name: np.where(np.arange(samples) == 0, 0.0, nothing) for name in ("v_y", "yaw_rate")}
    inputs = {"steer": 0.02 * _smooth(random, samples, 35), "v_x": 20.0 + 4.0 * _smooth(random, samples, 400)}
    blank = Recording("drive", time_, {**inputs, **first, "a_y": nothing})
    quiet = MotionProblem(Simulator(model), [blank], noise=NOISE, starts="measured")
    readings = quiet.simulated_nodes(quiet.start).y
    noisy = readings + NOISE * random.standard_normal(readings.shape)
    recording = Recording("drive", time_, {**inputs, **dict(zip(model.outputs, noisy.T, strict=True))})
    wrong = (p.with_value(p.array * WRONG[p.name]) if p.name in WRONG else p for p in model.parameters)
    return model.with_parameters(*wrong), recording


def _smooth(random: np.random.Generator, samples: int, width: int) -> Array:
    raw = np.convolve(random.standard_normal(samples + width), np.hanning(width), "valid")[:samples]
    return np.asarray(raw / np.std(raw))


_SIMULATOR: dict[str, Simulator] = {}


def simulator(model: MotionModel) -> Simulator:
    """One kernel for all repeats: compiled code is kept, as it is between two commands."""
    if model.name not in _SIMULATOR:
        _SIMULATOR[model.name] = Simulator(model, compiled=True)
    return _SIMULATOR[model.name]


def condensed(model: MotionModel, recording: Recording) -> Solved:
    """Growing horizons, then the whole run, as the verb fit goes about it; noise as known."""
    solving, stated, steps, p = 0.0, 0.0, 0, model.values
    short: MotionProblem | None = None
    for rows in SHORT_HORIZONS:
        clock = time.process_time()
        short = MotionProblem(
            simulator(model), [recording], noise=NOISE, horizon=rows * DT, most_rows=SHORT_ROWS, starts="measured",
            like=short,
        )  # fmt: skip
        stated += time.process_time() - clock
        clock = time.process_time()
        solution = gauss_newton(
            short, short.unknowns(p), max_steps=SHORT_STEPS, tolerance=1e-3, search="levenberg_marquardt"
        )
        solving += time.process_time() - clock
        p, steps = short.shared(solution.x), steps + solution.steps
    clock = time.process_time()
    whole = MotionProblem(simulator(model), [recording], noise=NOISE, like=short)
    stated += time.process_time() - clock
    clock = time.process_time()
    solution = gauss_newton(whole, whole.unknowns(p), tolerance=1e-12, negligible=0.0, search="levenberg_marquardt")
    solving += time.process_time() - clock
    names = [p.name for p in model.parameters]
    values = whole.shared(solution.x)
    found = np.array([values[names.index(name)] for name in FREE])
    return Solved(found, solution.objective, solving, stated, steps + solution.steps)


def scipy_compiled(model: MotionModel, recording: Recording) -> Solved:
    """Trust-region reflective on residuals and Jacobian from the compiled kernel, single shooting."""
    clock = time.process_time()
    whole = MotionProblem(simulator(model), [recording], noise=NOISE)
    free = np.flatnonzero(whole.free)
    stated = time.process_time() - clock

    def full(v: Array) -> Array:
        x = whole.start
        x[free] = v
        return x

    def residuals(v: Array) -> Array:
        nodes = whole.simulated_nodes(full(v))
        return np.nan_to_num(whole.errors(nodes) / NOISE).ravel()

    def jacobian(v: Array) -> Array:
        x = full(v)
        ((_, J),) = whole.residuals(x, whole.simulated_nodes(x))
        return J.reshape(-1, J.shape[-1])[:, free]

    clock = time.process_time()
    found = least_squares(
        residuals, whole.start[free], jacobian, x_scale="jac", xtol=1e-10, ftol=1e-12, gtol=1e-10,
        bounds=(whole.bounds[0][free], whole.bounds[1][free]),
    )  # fmt: skip
    names = [p.name for p in model.parameters]
    order = [names.index(name) for name in FREE]
    return Solved(full(found.x)[order], found.cost, time.process_time() - clock, stated, found.nfev)


class _Bicycle:
    """The same problem written out in CasADi alone, for those who do without the engine."""

    def __init__(self, model: MotionModel, recording: Recording) -> None:
        known = {p.name: float(p.array) for p in model.parameters}
        x, u, q = cs.SX.sym("x", 2), cs.SX.sym("u", 3), cs.SX.sym("q", len(FREE))
        p = known | {name: q[k] for k, name in enumerate(FREE)}
        self.scale = np.array([known[name] for name in FREE])

        def forces(x: Any, steer: Any, v_x: Any) -> tuple[Any, Any]:
            alpha_f = steer - cs.atan2(x[0] + p["l_f"] * x[1], v_x)
            alpha_r = -cs.atan2(x[0] - p["l_r"] * x[1], v_x)
            L = p["l_f"] + p["l_r"]

            def magic(axle: str, alpha: Any, load: Any) -> Any:
                slip = p[f"B_{axle}"] * alpha
                bent = slip - p[f"E_{axle}"] * (slip - cs.atan(slip))
                return load * p[f"D_{axle}"] * cs.sin(p[f"C_{axle}"] * cs.atan(bent))

            return magic("f", alpha_f, p["m"] * 9.81 * p["l_r"] / L), magic("r", alpha_r, p["m"] * 9.81 * p["l_f"] / L)

        def rates(x: Any, steer: Any, v_x: Any) -> Any:
            F_f, F_r = forces(x, steer, v_x)
            a_y = (F_f * cs.cos(steer) + F_r) / p["m"]
            return cs.vertcat(a_y - x[1] * v_x, (p["l_f"] * F_f * cs.cos(steer) - p["l_r"] * F_r) / p["I_z"])

        middle = (u[1] + u[2]) / 2
        k1 = rates(x, u[0], u[1])
        k2 = rates(x + DT / 2 * k1, u[0], middle)
        k3 = rates(x + DT / 2 * k2, u[0], middle)
        k4 = rates(x + DT * k3, u[0], u[2])
        self.step = cs.Function("step", [x, u, q], [x + DT / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])
        F_f, F_r = forces(x, u[0], u[1])
        read = cs.vertcat(x, (F_f * cs.cos(u[0]) + F_r) / p["m"])
        self.read = cs.Function("read", [x, u, q], [read])
        v_x = recording["v_x"]
        self.inputs = np.vstack([recording["steer"], v_x, np.append(v_x[1:], v_x[-1])])
        self.measured = np.vstack([recording[name] for name in model.outputs])
        low = np.array([model[name].bounds[0] for name in FREE])
        high = np.array([model[name].bounds[1] for name in FREE])
        self.bounds = (low / self.scale, high / self.scale)


def ipopt_alone(model: MotionModel, recording: Recording, steps: int) -> Solved:
    """Multiple shooting in CasADi, solved by Ipopt with MUMPS; nodes start at the measurements."""
    clock = time.process_time()
    bicycle = _Bicycle(model, recording)
    n = bicycle.inputs.shape[1] // steps * steps
    intervals = n // steps
    x, q, u = cs.MX.sym("x", 2), cs.MX.sym("q", len(FREE)), cs.MX.sym("u", 3, steps)
    states = cs.horzcat(x, bicycle.step.mapaccum(steps)(x, u, cs.repmat(q, 1, steps))) if steps > 1 else None
    if steps == 1:
        end, read = bicycle.step(x, u, q), bicycle.read(x, u, q)
    else:
        end, read = states[:, -1], bicycle.read.map(steps)(states[:, :-1], u, cs.repmat(q, 1, steps))
    piece = cs.Function("piece", [x, u, q], [end, cs.vec(read)])
    X, v = cs.MX.sym("X", 2, intervals), cs.MX.sym("v", len(FREE))
    U = cs.DM(bicycle.inputs[:, :n])
    ends, reads = piece.map(intervals)(X, U, cs.repmat(v * bicycle.scale, 1, intervals))
    weights = 1.0 / NOISE[:, None]
    target = (bicycle.measured[:, :n] * weights).reshape(3, intervals, steps).transpose(2, 0, 1).reshape(-1, intervals)
    e = cs.vec(reads * cs.repmat(cs.DM(weights), steps, intervals) - cs.DM(target))
    w = cs.vertcat(v, cs.vec(X))
    g = cs.vec(ends[:, :-1] - X[:, 1:])
    options: dict[str, Any] = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-9}
    J = cs.jacobian(e, w)
    gamma, lam, none = cs.MX.sym("gamma"), cs.MX.sym("lam", g.numel()), cs.MX.sym("none", 0)
    options["hess_lag"] = cs.Function("hess_lag", [w, none, gamma, lam], [gamma * cs.triu(J.T @ J)])
    solver = cs.nlpsol("solver", "ipopt", {"x": w, "f": cs.sumsqr(e) / 2, "g": g}, options)
    nodes = bicycle.measured[:2, :n:steps]
    start = np.concatenate([np.ones(len(FREE)), nodes.ravel(order="F")])
    low, high = np.full(w.numel(), -np.inf), np.full(w.numel(), np.inf)
    low[: len(FREE)], high[: len(FREE)] = bicycle.bounds
    stated = time.process_time() - clock
    clock = time.process_time()
    found = solver(x0=start, lbx=low, ubx=high, lbg=0, ubg=0)
    seconds = time.process_time() - clock
    solved = np.asarray(found["x"].full()).ravel()[: len(FREE)] * bicycle.scale
    return Solved(solved, float(found["f"]), seconds, stated, int(solver.stats()["iter_count"]))
