"""MS-NN-lat: the yaw rate from windows of speed, steering and longitudinal acceleration.

Local linear models of path curvature over steering angle, speed and longitudinal acceleration (the quasi steady
state), followed by local finite impulse responses (the transient). ISO 8855 axes.

Source: Mungiello et al., "Vehicle dynamics learning from physics priors with model-structured neural
networks", Eq. 1-6 and Fig. 1b-2. The yaw rate is that of the sample after the window, and the speed of each
sample in the window multiplies its own curvature, as in the authors' implementation.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import NamedTuple

import numpy as np

from ..datasets.recording import Recording
from .memory_model import MemoryModel, Past
from .model import Namespace, Symbol, within
from .msnn_parts import centres, fading, fading_prior, memberships, over
from .parameter import Parameter, Prior

TYPICAL_GAIN = 3.0
"""Curvature per steering angle of a 1:10 car, 1/(m rad), used without a recording that determines it."""


class Centres(NamedTuple):
    """Centres of the local models, rad, m/s and m/s^2."""

    steer: tuple[float, ...]
    v_x: tuple[float, ...]
    a_x: tuple[float, ...]


@dataclass(frozen=True)
class LateralSettings:
    """Hyperparameters of MS-NN-lat; the defaults are the paper's.

    Attributes
    ----------
    n_delta, n_v, n_x : local models over steering angle, speed and longitudinal acceleration.
    q : past samples in a window in addition to the newest.
    steer, v_x, a_x : their centres, rad, m/s and m/s^2; None spaces them evenly over the training recording.
    curvature_gain : prior mean of d(curvature)/d(steer), 1/(m rad), about the inverse wheelbase; None takes the
        training recording's average.
    steady_over_a_x, transient_over_a_x : whether curvature and impulse responses depend on a_x. The paper's Ablation 1
        lacks the latter (120 weights), its Ablation 2 both (70), and then does not read a_x.
    sample_time : s.
    """

    n_delta: int = 5
    n_v: int = 2
    n_x: int = 2
    q: int = 19
    steer: tuple[float, ...] | None = None
    v_x: tuple[float, ...] | None = None
    a_x: tuple[float, ...] | None = None
    curvature_gain: float | None = None
    steady_over_a_x: bool = True
    transient_over_a_x: bool = True
    sample_time: float = 0.05

    def __post_init__(self) -> None:
        within(self, n_delta=(1, 50), n_v=(1, 20), n_x=(1, 20), q=(0, 500), sample_time=(1e-4, 10.0))

    @property
    def reads_a_x(self) -> bool:
        """Whether anything depends on the longitudinal acceleration."""
        return self.steady_over_a_x or self.transient_over_a_x


def covering_lat(settings: LateralSettings, recording: Recording, symmetric: bool = False) -> LateralSettings:
    """The settings with open centres and gain set from a training recording."""
    s = settings
    recording.require(("v_x", "steer", *(("a_x",) if s.reads_a_x else ()), "yaw_rate"), "MS-NN-lat")
    return replace(
        s,
        steer=s.steer or over(recording["steer"], s.n_delta, symmetric),
        v_x=s.v_x or over(recording["v_x"], s.n_v),
        a_x=s.a_x or (over(recording["a_x"], s.n_x) if s.reads_a_x else None),
        curvature_gain=average_gain(recording) if s.curvature_gain is None else s.curvature_gain,
    )


def average_gain(recording: Recording) -> float:
    """Path curvature per steering angle, 1/(m rad), by least squares; the typical one if the steering is zero."""
    turning = recording["v_x"] * recording["steer"]
    known = np.isfinite(turning) & np.isfinite(recording["yaw_rate"])
    power = float(turning[known] @ turning[known])
    return float(turning[known] @ recording["yaw_rate"][known]) / power if power > 0 else TYPICAL_GAIN


def msnn_lat(settings: LateralSettings | None = None) -> MemoryModel:
    """MS-NN-lat; 160 weights with the paper's hyperparameters (Eq. 6)."""
    s = settings or LateralSettings()
    c = Centres(
        steer=centres("steer", s.steer, s.n_delta, -0.4, 0.4),
        v_x=centres("v_x", s.v_x, s.n_v, 0.0, 4.0),
        a_x=centres("a_x", s.a_x, s.n_x, -6.0, 6.0),
    )

    steady = range(len(c.a_x)) if s.steady_over_a_x else range(1)
    transient = range(len(c.a_x)) if s.transient_over_a_x else range(1)

    def equations(u: Namespace, p: Namespace, past: Past) -> dict[str, Symbol]:
        psi_delta = memberships(u.steer, c.steer)
        psi_v = memberships(u.v_x, c.v_x)
        psi_x = memberships(u.a_x, c.a_x) if s.reads_a_x else []
        S = sum(
            (
                p.kappa_1[l, j, i]
                + p.kappa_2[l, j, i] * (u.steer - c.steer[j])
                + p.kappa_3[l, j, i] * (u.v_x - c.v_x[l])
                + (p.kappa_4[l, j, i] * (u.a_x - c.a_x[i]) if s.steady_over_a_x else 0)
            )
            * (psi_delta[j] * psi_v[l] * (psi_x[i] if s.steady_over_a_x else 1))
            for l in range(len(c.v_x))
            for j in range(len(c.steer))
            for i in steady
        )
        if not s.transient_over_a_x:
            return {"yaw_rate": sum(past(u.v_x * S * psi_v[l], p.F[l]) for l in range(len(c.v_x)))}
        return {
            "yaw_rate": sum(
                past(u.v_x * S * psi_v[l] * psi_x[i], p.F[l, i]) for l in range(len(c.v_x)) for i in transient
            )
        }

    return MemoryModel(
        name="msnn_lat",
        about="model-structured network of the lateral dynamics: yaw rate",
        inputs=("v_x", "steer", *(("a_x",) if s.reads_a_x else ())),
        outputs=("yaw_rate",),
        parameters=_parameters(s, c),
        equations=equations,
        sample_time=s.sample_time,
        settings=asdict(s),
        together=(
            f"the scale of F and the scale of kappa_1 ... kappa_{4 if s.steady_over_a_x else 3} cannot be "
            "distinguished: only their product has an effect",
        ),
    )


def _parameters(s: LateralSettings, c: Centres) -> tuple[Parameter, ...]:
    """Curvature weights with priors about the kinematic car, and impulse responses that decay within a second."""
    gain = TYPICAL_GAIN if s.curvature_gain is None else s.curvature_gain
    shape = (len(c.v_x), len(c.steer), len(c.a_x) if s.steady_over_a_x else 1)
    local = (("v_x", c.v_x), *((("a_x", c.a_x),) if s.transient_over_a_x else ()))
    responses = tuple(len(item) for _, item in local)
    kinematic = np.broadcast_to(gain * np.array(c.steer)[None, :, None], shape)
    steady = "steady_state"
    curvature = (
        Parameter(
            "kappa_1", "1/m", kinematic, prior=Prior(0.3, step_sd=(0.4, 0.4, 0.4), strength=steady),
            about="curvature at the centre of each local model (v_x, steer, a_x)", source="kinematic car",
        ),
        Parameter(
            "kappa_2", "1/(m rad)", np.full(shape, gain),
            prior=Prior(1.5, step_sd=(2.0, 2.0, 2.0), strength=steady),
            about="slope of the curvature kappa_1 over the steering angle", source="kinematic car",
        ),
        Parameter(
            "kappa_3", "s/m^2", np.zeros(shape), prior=Prior(0.3, step_sd=(0.4, 0.4, 0.4), strength=steady),
            about="slope of the curvature kappa_1 over speed",
        ),
        Parameter(
            "kappa_4", "s^2/m^2", np.zeros(shape), prior=Prior(0.1, step_sd=(0.15, 0.15, 0.15), strength=steady),
            about="slope of the curvature kappa_1 over longitudinal acceleration",
        ),
    )  # fmt: skip
    responding = Parameter(
        "F", "1", np.broadcast_to(fading(s.q + 1), (*responses, s.q + 1)),
        prior=fading_prior(s.q + 1, sd=0.5, decay=0.72, axes=len(local) + 1, strength="transient"),
        about="finite impulse response of each local model, oldest sample first", axes=local,
    )  # fmt: skip
    return (*(curvature if s.steady_over_a_x else curvature[:3]), responding)
