"""The published equations and the engine's arithmetic once more, in plain numpy and plain loops.

Written from the paper (Mungiello et al., Eq. 1-15), sharing no code with greybox_id.
"""

import numpy as np

GRAVITY = 9.81


def psi(x, centres, k):
    """Eq. 4, Fig. 2b: the k-th piecewise linear activation."""
    if len(centres) == 1:
        return 1.0
    return float(np.interp(x, centres, np.eye(len(centres))[k]))


def lateral(window, weights, steer_0, v_0, a_0):
    """Eq. 2-5: the yaw rate after one window; window has v_x, steer, a_x, weights kappa_1 ... kappa_4 and F."""
    total = 0.0
    for age, (v, d, a) in enumerate(zip(window["v_x"], window["steer"], window["a_x"], strict=True)):
        curvature = 0.0
        for j, d_0 in enumerate(steer_0):
            for l, v_l in enumerate(v_0):  # noqa: E741
                for p, a_p in enumerate(a_0):
                    s = (
                        weights["kappa_1"][l, j, p]
                        + weights["kappa_2"][l, j, p] * (d - d_0)
                        + weights["kappa_3"][l, j, p] * (v - v_l)
                        + weights["kappa_4"][l, j, p] * (a - a_p)
                    )
                    curvature += s * psi(d, steer_0, j) * psi(v, v_0, l) * psi(a, a_0, p)
        for l in range(len(v_0)):  # noqa: E741
            for p in range(len(a_0)):
                total += v * curvature * psi(v, v_0, l) * psi(a, a_0, p) * weights["F"][l, p, age]
    return total


def longitudinal(window, weights, v_0, a_y_0):
    """Eq. 8-14 with a single wheel inertia I_w, or I_wf and I_wr where given."""
    w = weights
    current = np.asarray(window["motor_current"])

    def branch(values, side):
        neurons = len(w[f"b_1{side}"])
        layer = [np.tanh(w[f"G_1{side}"][n] @ values + w[f"b_1{side}"][n]) for n in range(neurons)]
        return float(np.dot(w[f"G_2{side}"], layer))

    T = branch(np.where(current > 0, current, 0), "t") + branch(np.where(current < 0, current, 0), "b")
    F_yf = 0.0
    for age, (v, a_y) in enumerate(zip(window["v_x"], window["a_y"], strict=True)):
        steady = sum(
            (w["q_1"][k] + w["q_2"][k] * (a_y - centre)) * psi(a_y, a_y_0, k) for k, centre in enumerate(a_y_0)
        )
        F_yf += sum(steady * psi(v, v_0, k) * w["F_y"][k, age] for k in range(len(v_0)))
    v, steer, theta = window["v_x"][-1], window["steer"][-1], window["road_slope"][-1]
    both = w["I_wf"] + w["I_wr"] if "I_wf" in w else 2 * w["I_w"]
    N = (T / w["r"] - w["k_a"] * v**2 - w["c_l"] * v - F_yf * np.sin(steer)) / w["m"]
    N += -w["c_r"] * GRAVITY * np.cos(theta) - GRAVITY * np.sin(theta)
    return float(N / (1 + 2 * both / (w["m"] * w["r"] ** 2)) + GRAVITY * np.sin(theta))  # dv/dt -> specific force


def weights_of(model):
    """Parameter values of a model by name."""
    return {p.name: p.array for p in model.parameters}


def predict_rows(equations, signals, length, rows):
    """Predictions of rows `length` ... rows - 1, each from the window of `length` rows before it."""
    return np.array(
        [
            equations({name: values[k - length : k] for name, values in signals.items()})
            for k in range(length, rows)
        ]
    )  # fmt: skip


def rate_limited(command, limit, dt):
    """A command behind an actuator that moves by at most limit * dt per sample, at rest on the first command."""
    seen = [command[0]]
    for target in command[1:]:
        seen.append(seen[-1] + np.clip(target - seen[-1], -limit * dt, limit * dt))
    return np.array(seen)


def free_run_of_full(signals, lat, long, memory, measured):
    """MS-NN-full on its own predictions, row by row: a_x is the last prediction, a_y yaw rate times speed.

    `lat` and `long` are (equations of one window, window length); rows before `memory` hold what was measured.
    """
    rows = len(signals["v_x"])
    yaw_rate, a_x = measured["yaw_rate"].copy(), measured["a_x"].copy()
    yaw_rate[memory:] = a_x[memory:] = np.nan
    for k in range(memory, rows):
        known = {**signals, "a_x": a_x, "a_y": yaw_rate * signals["v_x"]}
        yaw_rate[k] = lat[0]({n: v[k - lat[1] : k] for n, v in known.items()})
        a_x[k] = long[0]({n: v[k - long[1] : k] for n, v in known.items()})
    return np.column_stack([yaw_rate, a_x])
