"""Lateral dynamics by networks without memory: alone, or correcting a bicycle model.

`mlp_lateral`: a network computes the states' derivatives from state and input. `bicycle_mlp`: a single track with
Pacejka's tyres computes them, and a network their error; the single track is held unless `free_physics` trains it too,
with its priors.

ISO 8855 axes. States v_y [m/s], yaw_rate [rad/s]; inputs v_x [m/s], steer [rad]. Scaled, inputs and outputs of the
network are of order one: outputs are multiplied by the rates of a 0.5 Hz oscillation with the recording's spread.
Unscaled, inputs are in SI units and outputs are increments over a sample, as published. Outside the training data
hyperbolic tangents saturate: derivatives stay finite but are meaningless; trainings from several seeds diverge there.

Source: "Physics-guided approach with transfer learning in vehicle lateral dynamics", Eq. 1-5, 11, Sec. IV.B. What
Differences: the front lever arm and the load are those of a single track (Eq. 2 lacks the arms), and v_y may be read
ahead
of the centre of gravity.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import cast, get_args

import casadi as cs
import numpy as np

from ..base.errors import BadInput, must_be_one_of
from ..datasets.recording import Recording
from .hybrid import sized, v_y_of, weights
from .hybrid_model import Carried, FeedForwardNetwork, HybridModel, Integrator
from .model import Namespace, Symbol, within
from .parameter import Parameter
from .single_track import BODY, G
from .tyres import axle, pacejka

OUTPUTS = ("v_y", "yaw_rate")
AT_HALF_HERTZ = float(np.pi)
"""Rate over amplitude of a 0.5 Hz sine, 1/s: lateral dynamics respond up to a few hertz."""
LEVER = Parameter(
    "velocity_lever_arm",
    "m",
    0.0,
    (-5.0, 10.0),
    fixed=True,
    about="distance from the centre of gravity forward to the point where v_y is read",
)
Rates = Callable[[Namespace, Namespace, Namespace], Mapping[str, Symbol]]


@dataclass(frozen=True)
class LateralNetworkSettings:
    """Hyperparameters of lateral networks.

    Attributes
    ----------
    hidden : units of the hidden layers; the default is the paper's largest.
    activation : "tanh" or "relu".
    window, warm_up : rows predicted from one start at the end of training, and how many of them are not compared.
    scaled : whether inputs and outputs of the network are of order one; False as published.
    symmetric : whether the vehicle is assumed to be mirror-symmetric; the network is then odd.
    integrator : "rk4", "ab2", or "euler" as published. Only models trained with "rk4" can be exported.
    free_physics : whether the single track of bicycle_mlp is trained too.
    scales : v_y, yaw rate, mean and spread of v_x, steer, and unit rates of v_y and yaw rate; None takes the training
        recording's.
    least_speed : speed below which the lateral dynamics are not valid, m/s.
    sample_time : s; None takes the training recording's.
    """

    hidden: tuple[float, ...] = (24.0, 24.0, 24.0, 24.0)
    activation: str = "tanh"
    window: int = 20
    warm_up: int = 0
    scaled: bool = True
    symmetric: bool = True
    integrator: str = "rk4"
    free_physics: bool = False
    scales: tuple[float, ...] | None = None
    least_speed: float = 1.0
    sample_time: float | None = None

    def __post_init__(self) -> None:
        within(self, window=(2, 5000), warm_up=(0, 4999), least_speed=(0.1, 100.0))
        sized(self.window, self.warm_up, self.hidden)
        for name, words in (("activation", ("tanh", "relu")), ("integrator", get_args(Integrator))):
            must_be_one_of(words, getattr(self, name), f"Setting {name}: there is no")
        if self.scales is not None and (len(self.scales) != 7 or min(np.delete(self.scales, 2)) <= 0):
            raise BadInput(
                "Setting scales is a list of seven numbers, all above zero, except the third, the mean speed."
            )


def covering_networks(settings: LateralNetworkSettings, recording: Recording) -> LateralNetworkSettings:
    """The settings with open scales and sample time set from a training recording."""
    recording.require(("v_x", "steer", "yaw_rate"), "a lateral network")
    v_y = v_y_of(recording)
    if v_y is None:
        raise BadInput(f"{recording.name} holds neither v_y nor sideslip: a lateral network is trained on the motion.")
    driven = np.isfinite(recording["v_x"]) & (recording["v_x"] >= settings.least_speed)
    if np.sum(driven) < settings.window:
        raise BadInput(
            f"{recording.name} has only {np.sum(driven)} rows with v_x of {settings.least_speed:g} m/s or more, but a "
            f"window has {settings.window} rows: record more, or choose a shorter window or a lower least_speed."
        )
    v_x, steer = recording["v_x"][driven], recording["steer"][driven]
    spread_v, spread_r, spread_steer = (
        max(float(np.nanstd(item)), 1e-6) for item in (v_y[driven], recording["yaw_rate"][driven], steer)
    )
    scales = (
        spread_v, spread_r, float(np.mean(v_x)), max(float(np.std(v_x)), 0.1 * float(np.mean(v_x))), spread_steer,
        AT_HALF_HERTZ * spread_v, AT_HALF_HERTZ * spread_r,
    )  # fmt: skip
    return replace(
        settings,
        scales=tuple(float(f"{scale:.6g}") for scale in scales) if settings.scales is None else settings.scales,
        sample_time=round(recording.sample_time, 9) if settings.sample_time is None else settings.sample_time,
    )


def mlp_lateral(settings: LateralNetworkSettings | None = None) -> HybridModel:
    """A network that computes the derivatives of v_y and yaw rate (Eq. 11)."""
    about = "lateral dynamics predicted by a feed-forward network"
    return _networked("mlp_lateral", about, (), None, settings or LateralNetworkSettings())


def bicycle_mlp(settings: LateralNetworkSettings | None = None) -> HybridModel:
    """A single track, and a network that computes the error of its derivatives."""
    value = settings or LateralNetworkSettings()
    physical = (*BODY[:4], *pacejka.parameters("f"), *pacejka.parameters("r"), LEVER)
    held = tuple(p if value.free_physics else replace(p, fixed=True) for p in physical)
    about = "single track with Pacejka's tyres, and a feed-forward network that predicts the error of its derivatives"
    return _networked("bicycle_mlp", about, held, _bicycle, value)


def _bicycle(x: Namespace, u: Namespace, p: Namespace) -> Mapping[str, Symbol]:
    """Derivatives of a single track whose v_y is read `velocity_lever_arm` ahead of the centre of gravity (Eq. 1-5)."""
    v_y = x.v_y - p.velocity_lever_arm * x.yaw_rate
    alpha_f = u.steer - cs.atan((v_y + p.l_f * x.yaw_rate) / u.v_x)
    alpha_r = -cs.atan((v_y - p.l_r * x.yaw_rate) / u.v_x)
    weight = p.m * G / (p.l_f + p.l_r)
    F_yf = pacejka.force(alpha_f, weight * p.l_r, axle(p, "f"), 1.0, 1.0) * cs.cos(u.steer)
    F_yr = pacejka.force(alpha_r, weight * p.l_f, axle(p, "r"), 1.0, 1.0)
    turning = (p.l_f * F_yf - p.l_r * F_yr) / p.I_z
    across = (F_yf + F_yr) / p.m - u.v_x * x.yaw_rate
    return {"v_y": across + p.velocity_lever_arm * turning, "yaw_rate": turning}


def _networked(
    name: str, about: str, physical: tuple[Parameter, ...], known: Rates | None, s: LateralNetworkSettings
) -> HybridModel:
    v_y, yaw_rate, v_x, v_x_spread, steer, v_y_rate, yaw_rate_rate = s.scales or (0.3, 0.1, 15.0, 5.0, 0.05, 1.0, 0.3)
    sample_time = s.sample_time or 0.05
    network = FeedForwardNetwork(
        4, tuple(int(units) for units in s.hidden), 2, "tanh" if s.activation == "tanh" else "relu",
        (True, True, False, True) if s.symmetric else (),
    )  # fmt: skip

    def features(x: Namespace, u: Namespace, p: Namespace) -> Sequence[Symbol]:
        if not s.scaled:
            return x.v_y, x.yaw_rate, u.v_x, u.steer
        return x.v_y / v_y, x.yaw_rate / yaw_rate, (u.v_x - v_x) / v_x_spread, u.steer / steer

    def physics(
        x: Namespace, u: Namespace, p: Namespace, z: Sequence[Symbol]
    ) -> tuple[Mapping[str, Symbol], Mapping[str, Symbol]]:
        units = (v_y_rate, yaw_rate_rate) if s.scaled else (1.0 / sample_time, 1.0 / sample_time)
        rates = {name: unit * item for name, unit, item in zip(OUTPUTS, units, z, strict=True)}
        if known is not None:
            rates = {name: rate + rates[name] for name, rate in known(x, u, p).items()}
        return rates, {"sideslip": cs.atan(x.v_y / u.v_x), "yaw_acceleration": rates["yaw_rate"]}

    return HybridModel(
        name=name,
        about=about,
        inputs=("v_x", "steer"),
        commands=("steer",),
        outputs=OUTPUTS,
        parameters=(*physical, *weights(network)),
        states=(Carried("v_y", "m/s"), Carried("yaw_rate", "rad/s")),
        network=network,
        features=features,
        physics=physics,
        estimates={"v_y": "m/s", "yaw_rate": "rad/s", "sideslip": "rad", "yaw_acceleration": "rad/s^2"},
        readings={"v_y": v_y_of},
        least={"v_x": s.least_speed},
        sample_time=sample_time,
        integrator=cast(Integrator, s.integrator),
        window=s.window,
        warm_up=s.warm_up,
        settings=asdict(s),
    )
