"""Models of the benches, as anybody would write their own: equations over names, parameters with units and bounds.

Axes are those of ISO 8855. On the command line each is named by this file: `--model equations.py:inverse_steering`.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as cs
import numpy as np

from greybox_id.models.memory_model import MemoryModel, Past
from greybox_id.models.model import Namespace, Symbol
from greybox_id.models.motion_model import MotionModel, Quantities, State
from greybox_id.models.msnn_parts import fading, fading_prior, memberships
from greybox_id.models.parameter import Parameter, Prior

G = 9.81


AHEAD, BEHIND = 10, 5
"""Samples from the present on, as many as the published inverse model reads, and samples before them."""


def inverse_steering() -> MemoryModel:
    """Steering that makes the path that follows, of curvature, speed and accelerations around the present.

    It runs on a recording turned round in time, so that what is to come is its past; it reads half a second ahead and
    a quarter behind. The path's curvature is read twice, as it was recorded and as a_y / v_x²: their noise differs, and
    so do they where the car slides. Beside geometry there is the rate of turning in, understeer that braking brings and
    that outlasts it, oversteer under power and more where the car slides, vertical acceleration that loads the tyres,
    the more the slower the car (less downforce), a self-steer that saturates on straights, and a pull as a_x changes.
    The car answers late and smoothly: paths are weighed by a bell, forces by an exponential over the samples to come;
    which side the self-steer takes is read off the mean curvature of all samples. Scales: 10 m/s² for accelerations,
    40 m/s, 1/40 m for curvature.
    """

    def equations(u: Namespace, p: Namespace, past: Past) -> dict[str, Symbol]:
        age = np.arange(-BEHIND, AHEAD)[::-1]
        bell = [cs.exp(-0.5 * ((float(k) - p.lead) / p.width) ** 2) for k in age]
        fade = [cs.exp(-float(k) / p.force_lag) if k >= 0 else 0.0 for k in age]
        total, sum_fade = sum(bell), sum(fade)
        bell, fade = [w / total for w in bell], [w / sum_fade for w in fade]
        middle = sum(float(k) * w for k, w in zip(age, bell, strict=True))
        bend, turning = 40.0 * u.curvature, 40.0 * u.a_y / u.v_x**2
        path, turn = past(bend, bell), past(turning, bell)
        rate = past(turning, [w * (float(k) - middle) for k, w in zip(age, bell, strict=True)])
        v, a_x, a_y, a_z = (past(own, fade) / unit for own, unit in
                            ((u.v_x, 40.0), (u.a_x, 10.0), (u.a_y, 10.0), (u.a_z, 10.0)))  # fmt: skip
        beyond = past(u.a_y - u.v_x**2 * u.curvature, fade) / 10.0
        straight = past(u.curvature, [1.0 / len(age)] * len(age))
        change = past(u.a_x, [float(k == 0) - float(k == AHEAD - 1) for k in age]) / 10.0
        trail = past(bend * cs.fmin(u.a_x, 0.0), [float(k < 0) / BEHIND for k in age]) / 10.0
        brake, drive = cs.fmin(a_x, 0.0), cs.fmax(a_x, 0.0)
        return {
            "steering": p.geometry * path + p.balance * turn + p.turn_in * rate
            + p.straight * cs.tanh(straight / p.bend) * v + p.pull * change + p.load * path * a_z / v
            + p.brake_path * past(bend, fade) * brake + p.brake_turn * turn * brake + p.trail * trail
            + p.power * a_y * drive * v + p.sliding * beyond * drive
        }  # fmt: skip

    def weight(name: str, value: float, about: str) -> Parameter:
        return Parameter(name, "rad", value, (-1.0, 1.0), about=about)

    return MemoryModel(
        name="inverse_steering", about="steering angle that produces the path ahead",
        inputs=("curvature", "v_x", "a_x", "a_y", "a_z"), outputs=("steering",), sample_time=0.05, equations=equations,
        parameters=(
            Parameter("lead", "1", 2.0, (-5.0, 12.0), about="samples by which the path lags the steering"),
            Parameter("width", "1", 1.3, (0.3, 8.0), about="standard deviation of the weighting of the "
                      "path about that lag, in samples"),
            Parameter("force_lag", "1", 2.4, (0.3, 20.0), about="samples over which forces fade in"),
            Parameter("bend", "1/m", 3.5e-4, (5e-5, 1e-2), about="mean curvature at which self-steer saturates"),
            weight("geometry", 3.1 / 40.0, "steering per curvature of 1/40 m: wheelbase over 40 m"),
            weight("balance", 0.0, "steering per a_y / v_x² of 1/40 m"),
            weight("turn_in", 0.0, "steering per change of a_y / v_x² in a sample"),
            weight("sliding", 0.0, "steering per a_y beyond v_x² times curvature, under power"),
            weight("straight", 0.0, "steering that holds the car straight, at 40 m/s"),
            weight("pull", 0.0, "steering per loss of a_x over the next half second"),
            weight("brake_path", 0.0, "steering per curvature, under braking"),
            weight("brake_turn", 0.0, "steering per a_y / v_x², under braking"),
            weight("trail", 0.0, "steering per curvature, after braking in the last quarter of a second"),
            weight("power", 0.0, "steering per a_y, under power at 40 m/s"),
            weight("load", 0.0, "steering per curvature, under vertical acceleration at 40 m/s"),
        ),
    )  # fmt: skip


def driven_rear() -> MotionModel:
    """Single track, driven at the rear: load transfer by a_x, combined slip, a pull of the brakes, a steering ratio.

    The ratio of hand wheel to road wheels falls with the angle; Pacejka's formula without curvature factor, which
    holds its peak: a free run of a whole drive that is slightly over the peak would spin where the force falls.
    Source: Pacejka, Tire and Vehicle Dynamics, 3rd ed., Secs. 1.2 and 4.3.
    """

    def dynamics(x: Namespace, u: Namespace, p: Namespace, q: Quantities) -> Mapping[str, Symbol]:
        L, v = p.l_f + p.l_r, cs.fmax(u.v_x, 3.0)
        angle = u.steer - p.steer_0
        steer = p.ratio * angle * (1.0 + p.ratio_slope * angle**2)
        q.alpha_f = steer - cs.atan2(x.v_y + p.l_f * x.yaw_rate, v)
        q.alpha_r = -cs.atan2(x.v_y - p.l_r * x.yaw_rate, v)
        F_x = p.m * u.a_x + p.drag * v**2
        brake, drive = cs.fmin(F_x, 0.0), cs.fmax(F_x, 0.0)

        def force(alpha: Symbol, F_z: Symbol, F_x: Symbol, mu: Symbol, B: Symbol) -> Symbol:
            most = mu * F_z * (1.0 - p.load_sensitivity * (F_z / (0.5 * p.m * G) - 1.0))
            most = cs.sqrt(cs.fmax(most**2 - F_x**2, (0.2 * most) ** 2))
            return most * cs.sin(cs.fmax(-0.5 * np.pi, cs.fmin(SHAPE * cs.atan(B * alpha), 0.5 * np.pi)))

        q.F_yf = force(q.alpha_f, p.m * (G * p.l_r - p.h_cg * u.a_x) / L, p.brake_front * brake, p.mu_f, p.B_f)
        rear = (1.0 - p.brake_front) * brake + drive
        q.F_yr = force(q.alpha_r, p.m * (G * p.l_f + p.h_cg * u.a_x) / L, rear, p.mu_r, p.B_r)
        pull = p.brake_pull * brake + p.drive_pull * drive
        return {
            "v_y": (q.F_yf * cs.cos(steer) + q.F_yr) / p.m - x.yaw_rate * u.v_x,
            "yaw_rate": (p.l_f * q.F_yf * cs.cos(steer) - p.l_r * q.F_yr + pull) / p.I_z,
        }

    return MotionModel(
        name="driven_rear", about="single track driven at the rear",
        states=(State("v_y", "m/s", 0.3, start=lambda x, u, p: p.l_r * x.yaw_rate), State("yaw_rate", "rad/s", 0.1)),
        inputs=("steer", "v_x", "a_x"), commands=("steer",), outputs=("yaw_rate",),
        quantities=("alpha_f", "alpha_r", "F_yf", "F_yr"), dynamics=dynamics,
        parameters=(
            Parameter("m", "kg", 982.0, (500.0, 2000.0), fixed=True, about="mass"),
            Parameter("l_f", "m", 1.33, (0.5, 2.0), fixed=True, about="front axle to centre of gravity"),
            Parameter("l_r", "m", 1.07, (0.5, 2.0), fixed=True, about="rear axle to centre of gravity"),
            Parameter("drag", "N s^2/m^2", 0.4, (0.0, 3.0), fixed=True, about="aerodynamic drag"),
            Parameter("h_cg", "m", 0.4, (0.1, 1.0), about="height of the centre of gravity"),
            Parameter("I_z", "kg m^2", 1500.0, (500.0, 4000.0), about="yaw inertia"),
            Parameter("mu_f", "1", 1.1, (0.6, 2.0), about="peak friction, front"),
            Parameter("mu_r", "1", 1.2, (0.6, 2.0), about="peak friction, rear"),
            Parameter("B_f", "1/rad", 10.0, (2.0, 40.0), about="stiffness factor, front"),
            Parameter("B_r", "1/rad", 12.0, (2.0, 40.0), about="stiffness factor, rear"),
            Parameter("load_sensitivity", "1", 0.1, (0.0, 0.8), fixed=True,
                      about="relative loss of friction per relative growth of the axle load; not distinguished from "
                            "the height of the centre of gravity"),
            Parameter("brake_front", "1", 0.6, (0.0, 1.0), about="front share of braking"),
            Parameter("brake_pull", "m", 0.0, (-0.5, 0.5), about="yaw moment per braking force"),
            Parameter("drive_pull", "m", 0.0, (-0.5, 0.5), about="yaw moment per driving force"),
            Parameter("ratio", "1", 1.0, (0.4, 1.4), about="ratio of road-wheel to hand-wheel angle, divided by the "
            "stated ratio"),
            Parameter("ratio_slope", "1/rad^2", 0.0, (-30.0, 30.0), about="change of that ratio with the square of "
                                                                          "the hand-wheel angle"),
            Parameter("steer_0", "rad", 0.0, (-0.03, 0.03), about="hand-wheel angle at which the wheels stand "
                                                                  "straight"),
        ),
    )  # fmt: skip


SHAPE = 1.4
"""Shape factor C of both axles; with slip angles alone it is not told apart from B and the friction."""


def local_models(signal: str, centres: Mapping[str, tuple[float, ...]]) -> MemoryModel:
    """The structured network of the Ferrari: local affine models of three finite impulse responses; 110 weights.

    Source: `MSNN.py` of vehicle_lateral_dynamics_estimation in tonegas/nnodely-applications; degrees throughout.

    Parameters
    ----------
    signal : what it predicts, deg/s.
    centres : of hand wheel (deg), v_x (m/s) and a_x (m/s²).
    """
    names = ("hand_wheel", "v_x", "a_x")
    grid = [(i, j, k) for i in range(len(centres[names[0]])) for j in range(len(centres[names[1]]))
            for k in range(len(centres[names[2]]))]  # fmt: skip

    def equations(u: Namespace, p: Namespace, past: Past) -> dict[str, Symbol]:
        now = [getattr(u, name) for name in names]
        psi = [memberships(x, centres[name]) for x, name in zip(now, names, strict=True)]
        seen = [past(x, getattr(p, f"F_{name}")) for x, name in zip(now, names, strict=True)]
        total: Symbol = 0
        for cell, at in enumerate(grid):
            off = [seen[j] - centres[name][at[j]] for j, name in enumerate(names)]
            weights = p.k[cell]
            local = weights[0] + sum(weights[j + 1] * off[j] for j in range(3))
            total = total + psi[0][at[0]] * psi[1][at[1]] * psi[2][at[2]] * local
        return {signal: total}

    typical = np.array([20.0, 0.5, 1.0, 3.0])
    responses = tuple(
        Parameter(f"F_{name}", "1", fading(WINDOW), prior=fading_prior(WINDOW, 0.5, 0.72, axes=1),
                  about=f"finite impulse response of {name}, oldest first") for name in names
    )  # fmt: skip
    return MemoryModel(
        name="local_models", about="local affine models of three impulse responses", inputs=names, outputs=(signal,),
        sample_time=0.05, equations=equations,
        parameters=(Parameter("k", "deg/s", np.full((len(grid), 4), 1e-5),
                              prior=Prior(np.broadcast_to(typical, (len(grid), 4)), mean=0.0),
                              about="local models: constant, and slopes over the three"), *responses),
    )  # fmt: skip


WINDOW = 10
"""Samples of the published networks' windows."""


def rectified(signal: str, seed: int, scale: Mapping[str, tuple[float, float]]) -> MemoryModel:
    """The black box of the Ferrari: 30 inputs, layers of 8 and 5 rectified neurons; 299 weights from a seed.

    Source: `NN.py`, as above. `scale` holds mean and standard deviation of hand_wheel, v_x, a_x and of the output.
    """
    names, hidden = ("hand_wheel", "v_x", "a_x"), (8, 5)
    random = np.random.default_rng(seed)

    def drawn(name: str, *shape: int, of: int) -> Parameter:
        return Parameter(
            name, "1", random.standard_normal(shape) * np.sqrt(2.0 / of), prior=Prior(1.0, mean=0.0), about="weights"
        )

    def equations(u: Namespace, p: Namespace, past: Past) -> dict[str, Symbol]:
        scaled = [(getattr(u, name) - scale[name][0]) / scale[name][1] for name in names]
        first = [cs.fmax(0.0, sum(past(x, getattr(p, f"W_{name}")[n]) for x, name in zip(scaled, names, strict=True))
                 + p.b_1[n]) for n in range(hidden[0])]  # fmt: skip
        second = [
            cs.fmax(0.0, sum(p.W_2[n][j] * first[j] for j in range(hidden[0])) + p.b_2[n]) for n in range(hidden[1])
        ]
        return {
            signal: scale[signal][0]
            + scale[signal][1] * (sum(p.W_3[n] * second[n] for n in range(hidden[1])) + p.b_3[0])
        }

    return MemoryModel(
        name="rectified", about="layers of rectified neurons", inputs=names, outputs=(signal,), sample_time=0.05,
        equations=equations,
        parameters=(*(drawn(f"W_{name}", hidden[0], WINDOW, of=30) for name in names), drawn("b_1", hidden[0], of=30),
                    drawn("W_2", hidden[1], hidden[0], of=8), drawn("b_2", hidden[1], of=8),
                    drawn("W_3", hidden[1], of=5), drawn("b_3", 1, of=5)),
    )  # fmt: skip


def braked_car() -> MotionModel:
    """A car on braked axles; what a locked axle still brakes with is the grip's share of its sliding friction."""

    def dynamics(x: Namespace, u: Namespace, p: Namespace, q: Quantities) -> Mapping[str, Symbol]:
        q.a_x = (u.brake_front + u.brake_rear + p.gear * u.motor_torque - p.drag * x.v_x**2 - p.rolling) / p.m
        q.sliding_front, q.sliding_rear = -p.grip_scale * p.slide_front, -p.grip_scale * p.slide_rear
        return {"v_x": q.a_x}

    return MotionModel(
        name="braked_car", about="car on braked axles, sliding friction when locked",
        states=(State("v_x", "m/s", 10.0),),
        inputs=("brake_front", "brake_rear", "motor_torque"), outputs=("v_x", "a_x", "sliding_front", "sliding_rear"),
        quantities=("a_x", "sliding_front", "sliding_rear"), dynamics=dynamics,
        parameters=(
            Parameter("m", "kg", 1200.0, (500.0, 3000.0), about="mass, and that of spinning wheels"),
            Parameter("gear", "1/m", 9.0, (0.0, 50.0), about="driving force per motor torque"),
            Parameter("drag", "N s^2/m^2", 0.5, (0.0, 5.0), about="aerodynamic drag"),
            Parameter("rolling", "N", 100.0, (0.0, 1000.0), about="rolling resistance"),
            Parameter("slide_front", "N", 4000.0, (500.0, 2e4), about="sliding friction of the front axle at grip 1"),
            Parameter("slide_rear", "N", 4000.0, (500.0, 2e4), about="sliding friction of the rear axle at grip 1"),
            Parameter("grip_scale", "1", 0.5, (0.02, 2.0), prior=Prior(0.5), fixed=True, about="grip"),
        ),
    )  # fmt: skip


def servo_axis() -> MotionModel:
    """A servo axis with viscous and Coulomb friction: M q'' = F - F_v q' - F_c sign(q') - F_0.

    The sign is tanh of the velocity over 1 mm/s. Source: Janot, Gautier, Brunot, Data set and reference models of EMPS,
    nonlinearbenchmark.org, 2019.
    """

    def dynamics(x: Namespace, u: Namespace, p: Namespace, q: Quantities) -> Mapping[str, Symbol]:
        friction = p.F_v * x.velocity + p.F_c * cs.tanh(x.velocity / 1e-3)
        return {"position": x.velocity, "velocity": (u.force - friction - p.F_0) / p.M}

    return MotionModel(
        name="servo_axis", about="servo axis with viscous and Coulomb friction",
        states=(State("position", "m", 0.1), State("velocity", "m/s", 0.1)), inputs=("force",),
        commands=("force",), outputs=("position",),
        dynamics=dynamics,
        parameters=(
            Parameter("M", "kg", 80.0, (10.0, 500.0), about="inertia, as a mass"),
            Parameter("F_v", "N s/m", 150.0, (0.0, 2000.0), about="viscous friction"),
            Parameter("F_c", "N", 15.0, (0.0, 200.0), about="Coulomb friction"),
            Parameter("F_0", "N", 0.0, (-50.0, 50.0), about="offset of the force"),
        ),
    )  # fmt: skip
