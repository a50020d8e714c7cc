"""The baselines of the paper on model-structured networks: G-NN, and MS-NN-bench, lateral and longitudinal.

ISO 8855 axes; outputs are those of the sample after the window.

Source: Mungiello et al., "Vehicle dynamics learning from physics priors with model-structured neural networks",
Figs. 5 and 6. The numbers of neurons, centres and weights are only in the authors' code.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import casadi as cs
import numpy as np

from ..datasets.recording import Recording
from .memory_model import MemoryModel, Past
from .model import Namespace, Symbol, within
from .msnn_lat import average_gain
from .msnn_long import GRAVITY
from .msnn_parts import centres, fading, fading_prior, memberships, over
from .parameter import Parameter, Prior

TYPICAL_RANGE = {"v_x": 1.0, "motor_current": 3.0, "steer": 0.2}
"""Standard deviations of a 1:10 car's inputs, SI units, used without a recording that determines them."""
DAMPED = -0.5
"""Least A v_max^2 of MS-NN-bench. The authors' A of -0.070 s^2/m^2 puts the pole of 1/(1 + A v^2) at 3.8 m/s, next to
the highest speed driven; at this bound the gain at top speed is twice that at standstill."""


@dataclass(frozen=True)
class GeneralSettings:
    """Hyperparameters of G-NN; the defaults are the authors'.

    Attributes
    ----------
    neurons : in the hidden layer.
    gamma : past samples in a window in addition to the newest.
    v_x, motor_current, steer : scales of the inputs for the initial weights, m/s, A and rad; None takes the standard
        deviations of the training recording.
    seed : of the initial weights.
    sample_time : s.
    """

    neurons: int = 11
    gamma: int = 14
    v_x: float | None = None
    motor_current: float | None = None
    steer: float | None = None
    seed: int = 0
    sample_time: float = 0.05

    def __post_init__(self) -> None:
        within(self, neurons=(1, 200), gamma=(0, 500), seed=(0, 2**31), sample_time=(1e-4, 10.0))
        for name in TYPICAL_RANGE:
            if getattr(self, name) is not None:
                within(self, **{name: (1e-9, 1e9)})


def covering_gnn(settings: GeneralSettings, recording: Recording) -> GeneralSettings:
    """The settings with open scales set from a training recording."""
    recording.require((*TYPICAL_RANGE, "a_x", "yaw_rate"), "G-NN")
    scales: dict[str, Any] = {
        name: max(float(np.nanstd(recording[name])), 1e-6)
        for name in TYPICAL_RANGE
        if getattr(settings, name) is None and np.any(np.isfinite(recording[name]))
    }
    return replace(settings, **scales)


def gnn(settings: GeneralSettings | None = None) -> MemoryModel:
    """G-NN, a network without model structure: one hidden layer over the windows of all inputs; 528 weights."""
    s = settings or GeneralSettings()

    def equations(u: Namespace, p: Namespace, past: Past) -> dict[str, Symbol]:
        h = [
            cs.tanh(past(u.v_x, p.W_v[n]) + past(u.motor_current, p.W_i[n]) + past(u.steer, p.W_delta[n]) + p.b[n])
            for n in range(s.neurons)
        ]
        return {
            "yaw_rate": sum(p.G_yaw[n] * h[n] for n in range(s.neurons)),
            "a_x": sum(p.G_x[n] * h[n] for n in range(s.neurons)),
        }

    return MemoryModel(
        name="gnn",
        about="network without structure, one hidden layer: yaw rate and acceleration",
        inputs=("v_x", "motor_current", "steer"),
        outputs=("yaw_rate", "a_x"),
        parameters=_general(s),
        equations=equations,
        sample_time=s.sample_time,
        settings=asdict(s),
    )


def _general(s: GeneralSettings) -> tuple[Parameter, ...]:
    """Random initial weights about zero, so that neurons differ, larger for the newest samples."""
    random = np.random.default_rng(s.seed)
    length, hidden = s.gamma + 1, "hidden_layer"
    layers = []
    for name, signal, unit in (("W_v", "v_x", "s/m"), ("W_i", "motor_current", "1/A"), ("W_delta", "steer", "1/rad")):
        scale = getattr(s, signal) or TYPICAL_RANGE[signal]
        start = random.standard_normal((s.neurons, 1)) * fading(length) / scale
        layers.append(
            Parameter(
                name, unit, start,
                about=f"weights of the first layer on {signal}: neuron, then age of the sample, oldest first",
                prior=fading_prior(length, sd=0.6 / scale, decay=0.75, axes=2, mean=0.0, strength=hidden),
            )
        )  # fmt: skip
    return (
        *layers,
        Parameter("b", "1", random.standard_normal(s.neurons), prior=Prior(1.0, mean=0.0, strength=hidden),
                  about="thresholds of the neurons"),
        Parameter("G_yaw", "rad/s", np.full(s.neurons, 0.1), prior=Prior(2.0, mean=0.0),
                  about="weights of the second layer, for the yaw rate"),
        Parameter("G_x", "m/s^2", np.full(s.neurons, 0.1), prior=Prior(4.0, mean=0.0),
                  about="weights of the second layer, for the acceleration"),
    )  # fmt: skip


@dataclass(frozen=True)
class LateralBenchSettings:
    """Hyperparameters of MS-NN-bench, lateral; the defaults are the authors'.

    Attributes
    ----------
    n_v : local models over speed.
    q : past samples in a window in addition to the newest.
    v_x : their centres, m/s; None spaces them evenly over the training recording.
    curvature_gain : prior mean of d(curvature)/d(steer), 1/(m rad); None takes the training recording's average.
    sample_time : s.
    """

    n_v: int = 2
    q: int = 19
    v_x: tuple[float, ...] | None = None
    curvature_gain: float | None = None
    sample_time: float = 0.05

    def __post_init__(self) -> None:
        within(self, n_v=(1, 20), q=(0, 500), sample_time=(1e-4, 10.0))


def covering_bench_lat(settings: LateralBenchSettings, recording: Recording) -> LateralBenchSettings:
    """The settings with open centres and gain set from a training recording."""
    recording.require(("v_x", "steer", "yaw_rate"), "MS-NN-bench")
    gain = average_gain(recording) if settings.curvature_gain is None else settings.curvature_gain
    return replace(settings, v_x=settings.v_x or over(recording["v_x"], settings.n_v), curvature_gain=gain)


def msnn_bench_lat(settings: LateralBenchSettings | None = None) -> MemoryModel:
    """MS-NN-bench, lateral: a steady-state gain over speed times local impulse responses of steering; 41 weights."""
    s = settings or LateralBenchSettings()
    v_x_0 = centres("v_x", s.v_x, s.n_v, 0.0, 4.0)
    fastest = max(abs(v_x_0[0]), abs(v_x_0[-1]), 0.1)
    gain = 3.0 if s.curvature_gain is None else s.curvature_gain

    def equations(u: Namespace, p: Namespace, past: Past) -> dict[str, Symbol]:
        psi_v = memberships(u.v_x, v_x_0)
        seen = sum(psi_v[l] * past(u.steer, p.F[l]) for l in range(s.n_v))
        return {"yaw_rate": u.v_x / (1 + p.A * u.v_x**2) * seen}

    length = s.q + 1
    return MemoryModel(
        name="msnn_bench_lat",
        about="benchmark network of the lateral dynamics: yaw rate",
        inputs=("v_x", "steer"),
        outputs=("yaw_rate",),
        parameters=(
            Parameter("A", "s^2/m^2", 1e-5, (DAMPED / fastest**2, 10.0), Prior(1.0 / fastest**2),
                      about="understeer: the gain over speed is v/(1 + A v^2)"),
            Parameter("F", "1/(m rad)", np.broadcast_to(gain * fading(length), (s.n_v, length)),
                      prior=fading_prior(length, sd=0.5 * abs(gain) + 1e-3, decay=0.72, axes=2, strength="transient"),
                      about="finite impulse response of each local model, oldest sample first", axes=(("v_x", v_x_0),)),
        ),
        equations=equations,
        sample_time=s.sample_time,
        settings=asdict(s),
    )  # fmt: skip


@dataclass(frozen=True)
class LongitudinalBenchSettings:
    """Hyperparameters of MS-NN-bench, longitudinal; the defaults are the authors'.

    Attributes
    ----------
    gamma : past samples in a window in addition to the newest, for both branches of the motor current.
    slope : the paper's G_6, a weight on the sine of the road's slope, which the authors' code lacks.
    sample_time : s.
    """

    gamma: int = 14
    slope: bool = False
    sample_time: float = 0.05

    def __post_init__(self) -> None:
        within(self, gamma=(0, 500), sample_time=(1e-4, 10.0))


def msnn_bench_long(settings: LongitudinalBenchSettings | None = None) -> MemoryModel:
    """MS-NN-bench, longitudinal: drag, and impulse responses of positive and negative current; 34 weights, linear."""
    s = settings or LongitudinalBenchSettings()
    length = s.gamma + 1

    def equations(u: Namespace, p: Namespace, past: Past) -> dict[str, Symbol]:
        traction = past(cs.fmax(u.motor_current, 0), p.F_t) + p.b_t
        brake = past(cs.fmin(u.motor_current, 0), p.F_b) + p.b_b
        a_x = p.w * u.v_x**2 + p.b + traction + brake
        return {"a_x": a_x + (p.G_6 * cs.sin(u.road_slope) if s.slope else 0)}

    branches = tuple(
        parameter
        for branch, word in (("t", "positive"), ("b", "negative"))
        for parameter in (
            Parameter(f"F_{branch}", "m/(s^2 A)", fading(length), about=f"impulse response to {word} current",
                      prior=fading_prior(length, sd=0.5, decay=0.8, axes=1, strength="actuation")),
            Parameter(f"b_{branch}", "m/s^2", 0.0, prior=Prior(0.5), about=f"offset of the response to {word} current"),
        )
    )  # fmt: skip
    slope = Parameter("G_6", "m/s^2", 0.0, (-2 * GRAVITY, 2 * GRAVITY), Prior(1.0), about="weight of the road's slope")
    return MemoryModel(
        name="msnn_bench_long",
        about="benchmark network of the longitudinal dynamics: acceleration",
        inputs=("v_x", "motor_current", *(("road_slope",) if s.slope else ())),
        outputs=("a_x",),
        parameters=(
            Parameter("w", "1/m", 0.0, prior=Prior(0.3), about="drag"),
            Parameter("b", "m/s^2", 0.0, prior=Prior(0.5), about="offset"),
            *branches,
            *((slope,) if s.slope else ()),
        ),
        equations=equations,
        sample_time=s.sample_time,
        defaults={"road_slope": 0.0} if s.slope else {},
        settings=asdict(s),
        together=("b, b_t and b_b: only their sum has an effect",),
    )
