"""MS-NN-long: the longitudinal acceleration from windows of motor current, speed and lateral acceleration.

Newton's law along the vehicle, with a learned actuation model (motor current to traction and brake torque, one
small network each) and a learned lateral force of the front axle. ISO 8855 axes.

Source: Mungiello et al., "Vehicle dynamics learning from physics priors with model-structured neural
networks", Eq. 7-15 and Fig. 3. The acceleration is that of the sample after the window. Eq. 12 gives
dv_x/dt; an accelerometer reads, and `a_x` is, g sin(road_slope) more. On a flat road both are equal.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import casadi as cs
import numpy as np

from ..base.shorthands import Array
from ..datasets.recording import Recording
from .memory_model import MemoryModel, Past
from .model import Namespace, Symbol, within
from .msnn_parts import centres, fading, fading_prior, memberships, over
from .parameter import Parameter, Prior

GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True)
class LongitudinalSettings:
    """Hyperparameters of MS-NN-long; the defaults are the paper's.

    Attributes
    ----------
    n_v, n_y : local models of the lateral force over speed and lateral acceleration.
    v_x, a_y : their centres, m/s and m/s^2; None spaces them evenly over the training recording.
    eta : neurons of each branch of the actuation model.
    gamma : past samples in a window in addition to the newest.
    one_inertia : a single wheel inertia for both axles, as in the authors' code (384 parameters); False keeps
        one per axle as in Eq. 15 (385).
    speed_window : an addition to the paper: the window of speeds also acts on the acceleration. The change of speed
        over the last samples is the best predictor of the next acceleration; it also models a motor controller that
        follows a speed command.
    lateral_force : whether to include the front lateral force's longitudinal component. The paper's Ablation 3 lacks it
        (346), and reads neither steering nor a_y.
    sample_time : s.
    """

    n_v: int = 2
    n_y: int = 4
    eta: int = 10
    gamma: int = 14
    one_inertia: bool = True
    speed_window: bool = False
    lateral_force: bool = True
    v_x: tuple[float, ...] | None = None
    a_y: tuple[float, ...] | None = None
    sample_time: float = 0.05

    def __post_init__(self) -> None:
        within(self, n_v=(1, 20), n_y=(1, 20), eta=(1, 200), gamma=(0, 500), sample_time=(1e-4, 10.0))


def covering_long(
    settings: LongitudinalSettings, recording: Recording, symmetric: bool = False
) -> LongitudinalSettings:
    """The settings with open centres set from a training recording."""
    needed = ("v_x", "motor_current", *(("steer", "a_y") if settings.lateral_force else ()), "a_x")
    recording.require(needed, "MS-NN-long")
    if not settings.lateral_force:
        return settings
    return replace(
        settings,
        v_x=settings.v_x or over(recording["v_x"], settings.n_v),
        a_y=settings.a_y or over(recording["a_y"], settings.n_y, symmetric),
    )


def msnn_long(settings: LongitudinalSettings | None = None) -> MemoryModel:
    """MS-NN-long; 384 parameters with the authors' hyperparameters (Eq. 15 with one wheel inertia)."""
    s = settings or LongitudinalSettings()
    v_x_0 = centres("v_x", s.v_x, s.n_v, 0.0, 4.0)
    a_y_0 = centres("a_y", s.a_y, s.n_y, -7.0, 7.0)

    def torque(current: Symbol, G_1: Symbol, b_1: Symbol, G_2: Symbol, past: Past) -> Symbol:
        return sum(G_2[n] * cs.tanh(past(current, G_1[n]) + b_1[n]) for n in range(s.eta))

    def equations(u: Namespace, p: Namespace, past: Past) -> dict[str, Symbol]:
        T_t = torque(cs.fmax(u.motor_current, 0), p.G_1t, p.b_1t, p.G_2t, past)
        T_b = torque(cs.fmin(u.motor_current, 0), p.G_1b, p.b_1b, p.G_2b, past)

        F_along = 0
        if s.lateral_force:
            psi_y = memberships(u.a_y, a_y_0)
            psi_v = memberships(u.v_x, v_x_0)
            Lambda = sum((p.q_1[n] + p.q_2[n] * (u.a_y - a_y_0[n])) * psi_y[n] for n in range(s.n_y))
            F_yf = sum(past(Lambda * psi_v[n], p.F_y[n]) for n in range(s.n_v))
            F_along = F_yf * cs.sin(u.steer)

        theta, v = u.road_slope, u.v_x
        both_axles = 2 * p.I_w if s.one_inertia else p.I_wf + p.I_wr
        N = (
            ((T_t + T_b) / p.r - p.k_a * v**2 - p.c_l * v - F_along) / p.m
            - p.c_r * GRAVITY * cs.cos(theta)
            - GRAVITY * cs.sin(theta)
        )
        D = 1 + 2 * both_axles / (p.m * p.r**2)
        a_x = N / D + GRAVITY * cs.sin(theta)
        if s.speed_window:
            a_x += past(u.v_x, p.F_v)
        return {"a_x": a_x}

    return MemoryModel(
        name="msnn_long",
        about="model-structured network of the longitudinal dynamics: acceleration",
        inputs=("v_x", "motor_current", *(("steer", "a_y") if s.lateral_force else ()), "road_slope"),
        outputs=("a_x",),
        parameters=_parameters(s, np.array(a_y_0), v_x_0),
        equations=equations,
        sample_time=s.sample_time,
        defaults={"road_slope": 0.0},
        settings=asdict(s),
        together=(
            "m, r and the wheel inertia, on a flat road: with D = 1 + 2 (I_wf + I_wr)/(m r^2), only c_l/(m D), "
            "k_a/(m D) and c_r/D act; G_2 can absorb any scale of the torques, so of these only T/(m r D) is "
            "identifiable",
            *(("the scales of q_1, q_2, F_y and m D: only F_yf/(m D) has an effect",) if s.lateral_force else ()),
        ),
    )


def _parameters(s: LongitudinalSettings, a_y: Array, v_x: tuple[float, ...]) -> tuple[Parameter, ...]:
    """Physical parameters with priors about a 1:10 car, and the weights of its three networks."""
    length, eta = s.gamma + 1, s.eta
    inertias = ("I_w",) if s.one_inertia else ("I_wf", "I_wr")
    physical = (
        Parameter("m", "kg", 3.5, (0.5, 10.0), Prior(0.05), about="vehicle mass"),
        Parameter("c_r", "1", 0.03, (0.0, 0.5), Prior(0.03), about="rolling resistance coefficient"),
        Parameter("c_l", "N s/m", 0.5, (0.0, 50.0), Prior(3.0), about="laminar drag coefficient"),
        Parameter("k_a", "N s^2/m^2", 0.02, (0.0, 5.0), Prior(0.12), about="aerodynamic drag coefficient"),
        *(Parameter(n, "kg m^2", 5e-5, (1e-7, 1e-2), Prior(1e-5), about="wheel inertia, one wheel") for n in inertias),
        Parameter("r", "m", 0.055, (0.01, 0.2), Prior(0.0005), about="wheel radius"),
    )
    # Identical neurons would stay identical: initial thresholds are spread over the branch's range of current.
    branches = tuple(
        parameter
        for branch, word, gain, thresholds in (
            ("t", "traction", 1.0, -np.linspace(0.2, 5.0, eta)),
            ("b", "brake", 2.0, np.linspace(0.2, 3.0, eta)),
        )
        for parameter in (
            Parameter(f"G_1{branch}", "1/A", np.outer(np.full(eta, gain), fading(length, 2.0)),
                      prior=fading_prior(length, sd=0.2, decay=0.65, axes=2, strength="actuation"),
                      about=f"{word} network, weights of the first layer: neuron, then age of the sample, oldest "
                            f"first"),
            Parameter(f"b_1{branch}", "1", thresholds, prior=Prior(0.25, strength="actuation"),
                      about=f"{word} network, thresholds"),
            Parameter(f"G_2{branch}", "N m", np.full(eta, 0.05), prior=Prior(0.5, mean=0.0),
                      about=f"{word} network, weights of the second layer"),
        )
    )  # fmt: skip
    lateral = (
        Parameter("q_1", "N", 1.7 * a_y, prior=Prior(10.0),
                  about="front lateral force at the centre of each local model", source="half the mass times a_y"),
        Parameter("q_2", "N s^2/m", np.full(len(a_y), 1.7), prior=Prior(3.0),
                  about="slope of this force over lateral acceleration", source="half the mass"),
        Parameter("F_y", "1", np.broadcast_to(fading(length), (s.n_v, length)),
                  prior=fading_prior(length, sd=0.5, decay=0.75, axes=2, strength="lateral_force"),
                  about="finite impulse response of each local model, oldest sample first", axes=(("v_x", v_x),)),
    )  # fmt: skip
    speed = (
        Parameter("F_v", "1/s", np.zeros(length),
                  prior=fading_prior(length, sd=10.0, decay=0.7, axes=1, strength="speed_window"),
                  about="impulse response of the acceleration to speed, oldest sample first"),
    )  # fmt: skip
    return physical + branches + (lateral if s.lateral_force else ()) + (speed if s.speed_window else ())
