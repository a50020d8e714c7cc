"""Models to filter and what is known of them in closed form."""

from dataclasses import replace
from math import factorial

import numpy as np
from linear_bicycle import SIMROD, VEHICLE
from linear_bicycle import recorded as bicycle
from scipy.linalg import expm

from greybox_id.datasets.recording import Recording
from greybox_id.filters.kernel import CompiledFilter, SigmaPoints
from greybox_id.filters.plain import PlainFilter
from greybox_id.filters.state_space import StateSpace, Tracked, walking
from greybox_id.models.effects import EFFECTS
from greybox_id.models.motion_model import MotionModel, State
from greybox_id.models.parameter import Parameter
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle

NEVER = np.inf
"""No gate."""
A = np.array([[-1.5, 0.8], [-2.0, -0.6]])
B = np.array([0.7, -0.4])
C = np.array([[0.0, 1.0], [0.5, -1.2]])
D = np.array([0.0, 0.3])


def linear_model():
    """Two states, a disturbance d of the command, and two readings: x' = A x + B (u + d), y = C x + D (u + d)."""

    def dynamics(x, u, p, q):
        given = u.steer + p.d
        q.a_y = C[1, 0] * x.v_y + C[1, 1] * x.yaw_rate + D[1] * given
        return {
            "v_y": A[0, 0] * x.v_y + A[0, 1] * x.yaw_rate + B[0] * given,
            "yaw_rate": A[1, 0] * x.v_y + A[1, 1] * x.yaw_rate + B[1] * given,
        }

    return MotionModel(
        name="linear", about="", states=(State("v_y", "m/s"), State("yaw_rate", "rad/s", 0.1)), inputs=("steer",),
        commands=("steer",), outputs=("yaw_rate", "a_y"), quantities=("a_y",), dynamics=dynamics,
        parameters=(Parameter("d", "rad", 0.0),),
    )  # fmt: skip


class LinearCase:
    """The linear model with d tracked (drawn back with the time constant T, or not) and a coloured a_y, as matrices.

    x = [v_y, yaw_rate, d, colour]
    """

    def __init__(self, T=None, colour=True, throughout=False):
        tracked = Tracked("d", "rad", 0.05, 0.2, logarithmic=False, returns=T is not None)
        self.space = StateSpace(linear_model(), (tracked,), ("a_y",) if colour else (), throughout=throughout)
        self.T, self.start, self.colour = T, tracked.value, colour
        sizes = {"walk_v_y": 0.3, "walk_yaw_rate": 0.1, "walk_d": 0.2, "memory_d": T, "noise_yaw_rate": 0.05,
                 "noise_a_y": 0.2, "colour_a_y": 0.4, "memory_a_y": 0.7}  # fmt: skip
        self.sizes = sizes
        self.p = np.array([0.0, *(sizes[name] for name in self.space.noises)])
        self.R = np.diag([sizes["noise_yaw_rate"], sizes["noise_a_y"]]) ** 2
        self.H = np.column_stack([C, D, [0.0, 1.0]])[:, : self.space.size]

    def step(self, h, u):
        """F, the part of the command, and Q, of a segment of h seconds."""
        powers = [np.linalg.matrix_power(h * A, k) for k in range(5)]
        Phi = sum(power / factorial(k) for k, power in enumerate(powers))
        Gamma = h * sum(power / factorial(k + 1) for k, power in enumerate(powers[:4])) @ B
        drawn = 1.0 if self.T is None else np.exp(-h / self.T)
        memory, colour = self.sizes["memory_a_y"], self.sizes["colour_a_y"]
        F = np.zeros((4, 4))
        F[:2, :2], F[:2, 2], F[2, 2], F[3, 3] = Phi, Gamma, drawn, np.exp(-h / memory)
        given = np.array([*(Gamma * u), (1 - drawn) * self.start, 0.0])
        joins = h if self.T is None else self.T / 2 * (1 - np.exp(-2 * h / self.T))
        Q = np.diag([0.3**2 * h, 0.1**2 * h, 0.2**2 * joins, colour**2 * (1 - np.exp(-2 * h / memory))])
        n = self.space.size
        return F[:n, :n], given[:n], Q[:n, :n]

    def given(self, rows=60, seed=0, missing=0.3):
        """x, P, segments and readings to filter: steps of uneven length, some readings missing."""
        random, n = np.random.default_rng(seed), self.space.size
        s = np.column_stack([random.uniform(0.01, 0.4, rows), random.standard_normal(rows), np.zeros(rows)])
        y = random.standard_normal((rows, 2))
        y[random.random((rows, 2)) < missing] = np.nan
        root = random.standard_normal((n, n))
        return random.standard_normal((1, n)), (root @ root.T + 0.1 * np.eye(n))[None], s, y

    def kalman(self, x, P, s, y):
        """Kalman's filter as he wrote it: all readings of a row at once. Predicted and filtered means and covariances,
        and half of minus two log-likelihoods without constants."""
        x, P, cost, told = x[0].copy(), P[0].copy(), 0.0, []
        for k, (own, read) in enumerate(zip(s, y, strict=True)):
            before = x, P
            there = np.isfinite(read)
            if there.any():
                H, R = self.H[there], self.R[np.ix_(there, there)]
                S = H @ P @ H.T + R
                e = read[there] - H @ x - D[there] * own[1]
                K = P @ H.T @ np.linalg.inv(S)
                x, P = x + K @ e, P - K @ S @ K.T
                cost += 0.5 * (e @ np.linalg.solve(S, e) + np.log(np.linalg.det(S)))
            told.append((*before, x, P))
            if k + 1 < len(s):
                F, given, Q = self.step(own[0], own[1])
                x, P = F @ x + given, F @ P @ F.T + Q
        return *(np.array(column) for column in zip(*told, strict=True)), cost


def filtered(space, kind, x, P, s, y, p, gate=NEVER, compiled=True, kept="both ways", points=None):
    """What a filter makes of it: cost and history; what it is given is left as it is."""
    made = (CompiledFilter if compiled else PlainFilter)(space, kind, points or SigmaPoints())
    (cost,), history = made.run(x.copy(), P.copy(), s, y, np.atleast_2d(p), gate, kept)
    return cost, history


def assert_close(found, expected, close):
    """The same numbers, within so much of the largest of their kind; covariances, of the standard deviations."""
    assert found.shape == expected.shape
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    scale = np.nanmax(np.abs(expected), axis=0, initial=1e-300)
    if expected.ndim == 3:
        sd = np.sqrt(np.diagonal(scale))
        scale = np.maximum(np.outer(sd, sd), 1e-300)
    np.testing.assert_allclose(found / scale, expected / scale, rtol=0, atol=close)


def car(name="single_track", effects=None, settings=None, **values):
    """A model of the full-size car, whose numbers are certain."""
    model = build(name, settings, effects or {}, vehicle("full_size_car"))
    model = model.with_parameters(*(replace(parameter, fixed=True, prior=None) for parameter in model.parameters))
    return model.with_parameters(*(model[n].with_value(v) for n, v in values.items()))


def driven_space(
    name="single_track", parameters=("C_alpha_f", "C_alpha_r"), disturbances=(), effects=None, coloured=()
):
    """A state space of the full-size car, and its parameters with noise of usual sizes."""
    model, tracked = walking(car(name, effects), parameters, disturbances, EFFECTS)
    space = StateSpace(model, tracked, coloured)
    usual = {"walk_v_x": 0.2, "walk_v_y": 0.1, "walk_yaw_rate": 0.1, "noise_v_x": 0.02, "noise_yaw_rate": 0.005,
             "noise_a_y": 0.2, "noise_a_x": 0.2, "noise_v_y": 0.05, "colour_a_y": 0.1, "memory_a_y": 0.5}  # fmt: skip
    sizes = [usual.get(n, 3.0 if n.startswith("memory") else 0.03) for n in space.noises]
    return space, np.concatenate([model.values, sizes])


def driving(space, p, rows=200, seed=0, h=0.02, missing=0.2, glitches=0):
    """x, P, segments, and readings of a car that swerves: the model's own, with noise."""
    random, trace = np.random.default_rng(seed), space.trace
    time = h * np.arange(rows)
    s = np.zeros((rows, trace.segment_size))
    s[:, 0] = h
    inputs = {"steer": 0.04 * np.sin(3.0 * time) + 0.01 * np.sin(11 * time), "drive": 0.5 * np.cos(time) + 0.3}
    for k, name in enumerate(space.model.inputs):
        s[:, 1 + k] = inputs[name]
    start = trace.start(("v_x", "yaw_rate"))
    z = np.asarray(start([20.0, 0.0], s[0, 1 : 1 + len(space.model.inputs)], p[: space.model.size])).ravel()
    x = np.concatenate([z, [own.start for own in space.tracked], np.zeros(len(space.coloured))])
    sd = np.concatenate([np.where(np.arange(len(z)) < 3, [0.1] * len(z), 0.0), [0.1] * (space.size - len(z))])
    y, own = np.zeros((rows, len(space.model.outputs))), x.copy()
    for k in range(rows):
        read, noise, _ = space.output(own, s[k], p)
        y[k] = np.asarray(read).ravel() + np.sqrt(np.asarray(noise).ravel()) * random.standard_normal(len(y[k]))
        own = np.asarray(space.step(own, s[k], p)[0]).ravel()
    y[random.random(y.shape) < missing] = np.nan
    y[random.integers(1, rows, glitches), -1] = 30.0
    return (x + sd * random.standard_normal(len(x)))[None], np.diag(sd**2)[None], s, y


def simrod(name="lateral", **stated):
    """The linear single track of the recordings below."""
    model = build(name, {"tyre": "linear"}, None, VEHICLE)
    model = model.with_parameters(*(replace(parameter, fixed=True, prior=None) for parameter in model.parameters))
    return model.with_parameters(*(model[n].with_value(v) for n, v in stated.items()))


C_F, C_R, SPEED = 60e3, 75e3, 14.0


def swerving(seconds=20.0, rate=50.0, seed=0, straight=0.0, amplitude=0.02, name="swerving", v_x=SPEED):
    """A linear single track with stiffnesses C_F and C_R that swerves, straight on for so many seconds at first; and
    the truth of it."""
    time = np.arange(round(seconds * rate)) / rate
    waves = np.sin(2 * np.pi * 0.4 * time) + 0.6 * np.sin(2 * np.pi * 0.9 * time + 1)
    steer = np.where(time < straight, 0.0, amplitude * waves)
    truth = bicycle(steer, v_x, C_F, C_R, rate=rate, name=name)
    found = bicycle(steer, v_x, C_F, C_R, rate=rate, seed=seed, name=name)
    return found, Truth(truth)


class Truth:
    """What a linear single track went through."""

    def __init__(self, exact):
        v_x, v_y, r, steer = (exact[n] for n in ("v_x", "v_y", "yaw_rate", "steer"))
        self.sideslip = np.arctan2(v_y, v_x)
        self.alpha_f, self.alpha_r = steer - (v_y + SIMROD["l_f"] * r) / v_x, -(v_y - SIMROD["l_r"] * r) / v_x
        self.F_yf, self.F_yr = C_F * self.alpha_f, C_R * self.alpha_r


def changed(recording, **signals):
    return Recording(recording.name, recording.time, {**recording.signals, **signals}, hold=recording.hold)


WALKS = {"walk_v_y": 0.08, "walk_yaw_rate": 0.03}
NOISES = {"noise_yaw_rate": 0.008, "noise_a_y": 0.25}


def shaken(seconds=40.0, rate=50.0, seed=0, amplitude=0.02, v_x=SPEED, walks=WALKS, noises=NOISES, I_z=SIMROD["I_z"]):
    """The same vehicle with states that are shaken: each row white noise joins them; and its sideslip."""
    m, l_f, l_r = SIMROD["m"], SIMROD["l_f"], SIMROD["l_r"]
    moment = l_f * C_F - l_r * C_R
    A = -np.array(
        [
            [(C_F + C_R) / (m * v_x), v_x + moment / (m * v_x)],
            [moment / (I_z * v_x), (l_f**2 * C_F + l_r**2 * C_R) / (I_z * v_x)],
        ]
    )
    B = np.array([C_F / m, l_f * C_F / I_z])
    step = expm(np.block([[A, B[:, None]], [np.zeros((1, 3))]]) / rate)
    random, time = np.random.default_rng(seed), np.arange(round(seconds * rate)) / rate
    steer = amplitude * (np.sin(2 * np.pi * 0.4 * time) + 0.6 * np.sin(2 * np.pi * 0.9 * time + 1))
    shake = np.array([walks["walk_v_y"], walks["walk_yaw_rate"]]) / np.sqrt(rate)
    x = np.zeros((len(time), 2))
    for k in range(1, len(time)):
        x[k] = step[:2, :2] @ x[k - 1] + step[:2, 2] * steer[k - 1] + shake * random.standard_normal(2)
    a_y = x @ A[0] + B[0] * steer + v_x * x[:, 1]
    read = {"yaw_rate": x[:, 1], "a_y": a_y}
    noisy = {n: v + noises[f"noise_{n}"] * random.standard_normal(len(v)) for n, v in read.items()}
    recording = Recording("shaken", time, {"v_x": np.full(len(time), v_x), "steer": steer, **noisy})
    return recording, np.arctan2(x[:, 0], v_x)


def true_simrod(**stated):
    """The model of that vehicle, with its true numbers."""
    return simrod(**{"C_alpha_f": C_F, "C_alpha_r": C_R, **stated})
