"""MS-NN-lat: the yaw rate from windows of speed, steering and longitudinal acceleration.

Local linear models of the path's curvature over steering angle, speed and longitudinal acceleration (the
quasi steady state), seen through local finite impulse responses (the transient). ISO 8855 axes.

Source: Mungiello et al., "Vehicle dynamics learning from physics priors with model-structured neural
networks", Eq. 1-6 and Fig. 1b-2. The yaw rate is that of the sample after the window, and the speed of each
sample in the window multiplies its own curvature, as in the authors' implementation.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import exp

import numpy as np

from ..model import Model, Namespace, Past, Symbol
from ..parameter import Array, Parameter, Prior
from .fuzzy import evenly, memberships


@dataclass(frozen=True)
class LateralSettings:
    """Hyperparameters of MS-NN-lat; the defaults are the paper's.

    Attributes
    ----------
    steer, v_x, a_x : centres of the local models, rad, m/s and m/s^2 (n_delta = 5, n_v = 2, n_x = 2).
    q : past samples in a window besides the newest.
    curvature_gain : prior mean of d(curvature)/d(steer), 1/(m rad); about the inverse wheelbase.
    sample_time : s.
    """

    steer: tuple[float, ...] = evenly(-0.4, 0.4, 5)
    v_x: tuple[float, ...] = evenly(0.0, 4.0, 2)
    a_x: tuple[float, ...] = evenly(-6.0, 6.0, 2)
    q: int = 19
    curvature_gain: float = 3.0
    sample_time: float = 0.05


def msnn_lat(settings: LateralSettings | None = None) -> Model:
    """MS-NN-lat; 160 weights with the paper's hyperparameters (Eq. 6)."""
    s = settings or LateralSettings()

    def equations(u: Namespace, p: Namespace, past: Past) -> dict[str, Symbol]:
        psi_delta = memberships(u.steer, s.steer)
        psi_v = memberships(u.v_x, s.v_x)
        psi_x = memberships(u.a_x, s.a_x)
        S = sum(
            (
                p.kappa_1[l, j, i]
                + p.kappa_2[l, j, i] * (u.steer - s.steer[j])
                + p.kappa_3[l, j, i] * (u.v_x - s.v_x[l])
                + p.kappa_4[l, j, i] * (u.a_x - s.a_x[i])
            )
            * (psi_delta[j] * psi_v[l] * psi_x[i])
            for l in range(len(s.v_x))
            for j in range(len(s.steer))
            for i in range(len(s.a_x))
        )
        return {
            "yaw_rate": sum(
                past(u.v_x * S * psi_v[l] * psi_x[i], p.F[l, i]) for l in range(len(s.v_x)) for i in range(len(s.a_x))
            )
        }

    return Model(
        name="msnn_lat",
        about="model-structured network of the lateral dynamics: yaw rate",
        inputs=("v_x", "steer", "a_x"),
        outputs=("yaw_rate",),
        parameters=lateral_parameters(s),
        equations=equations,
        sample_time=s.sample_time,
        settings=asdict(s),
        together=("the scale of F and that of kappa_1 ... kappa_4: only their product acts",),
    )


def lateral_parameters(s: LateralSettings) -> tuple[Parameter, ...]:
    """Curvature weights about the kinematic single-track car, and impulse responses about a lag of 3 samples."""
    shape = (len(s.v_x), len(s.steer), len(s.a_x))
    kinematic = np.broadcast_to(s.curvature_gain * np.array(s.steer)[None, :, None], shape)
    steady = "steady_state"
    return (
        Parameter(
            "kappa_1", "1/m", kinematic, prior=Prior(0.5, step_sd=(0.5, 0.5, 0.5), strength=steady),
            about="curvature at the centre of each local model (v_x, steer, a_x)", source="kinematic car",
        ),
        Parameter(
            "kappa_2", "1/(m rad)", np.full(shape, s.curvature_gain),
            prior=Prior(2.0, step_sd=(1.0, 1.0, 1.0), strength=steady),
            about="its slope over the steering angle", source="kinematic car",
        ),
        Parameter(
            "kappa_3", "s/m^2", np.zeros(shape), prior=Prior(0.2, step_sd=(0.2, 0.2, 0.2), strength=steady),
            about="its slope over speed",
        ),
        Parameter(
            "kappa_4", "s^2/m^2", np.zeros(shape), prior=Prior(0.1, step_sd=(0.1, 0.1, 0.1), strength=steady),
            about="its slope over longitudinal acceleration",
        ),
        Parameter(
            "F", "1", np.broadcast_to(fading(s.q + 1), (len(s.v_x), len(s.a_x), s.q + 1)),
            prior=Prior(0.2, step_sd=(None, None, 0.2), strength="transient"),
            about="finite impulse response of each local model, oldest sample first",
        ),
    )  # fmt: skip


def fading(length: int, samples: float = 3.0) -> Array:
    """An impulse response that fades over `samples` samples, oldest first, with unit gain."""
    weights = np.array([exp(-age / samples) for age in reversed(range(length))])
    return weights / weights.sum()
