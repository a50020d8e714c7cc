"""Hybrid models of the lateral dynamics: a linear single track with a recurrent network for its tyres.

`hybrid_stiffness`: the network computes the cornering stiffnesses, F_y = C_alpha alpha; trained on a_y, yaw rate and
sideslip. At zero slip a stiffness is not observable. `hybrid_force`: the network computes the lateral forces, and is
trained on a_y, yaw rate, v_y and yaw acceleration; these are observable at any slip.

ISO 8855 axes. States v_y [m/s], yaw_rate [rad/s]; inputs v_x [m/s], steer [rad] at the road wheels. Positive slip
angles give positive forces: slip angles are the negative of the paper's.

Source: "Tire cornering stiffness estimation using hybrid modeling", Eq. 2-12, 18. Differences: arc tangents and
cos(steer) are kept, since they cost nothing; the network's inputs are slip angles, centripetal acceleration and speed,
equivalent to state and input but of order one at any speed.

Additions to the paper: offsets of the steering angle and of a_y, longitudinal tyre forces, and two factors per axle for
other tyres by the similarity method (Pacejka, Tire and Vehicle Dynamics, 3rd ed., Sec. 4.2):

    F_y(alpha) = grip_scale F_y,trained(stiffness_scale / grip_scale alpha)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import ceil

import casadi as cs
import numpy as np

from ..base.errors import BadInput
from ..base.shorthands import Array
from ..datasets.recording import Recording
from .hybrid_model import Carried, FeedForwardNetwork, HybridModel, RecurrentNetwork
from .model import Namespace, Symbol, within
from .parameter import Parameter, Prior
from .single_track import BODY, DRIVE, G
from .smooth import remaining
from .tyres import TYRES, TyreSettings, axle

SLOPE = 12.0
"""Initial cornering stiffness over load, 1/rad; radial tyres lie between 8 and 20."""
EXCITED = 0.01
"""Slip angle, rad, below which the ratio of force to slip does not identify a stiffness."""
OFFSETS = (
    Parameter("steering_offset", "rad", 0.0, (-0.2, 0.2), fixed=True, about="added to the road-wheel angle"),
    Parameter("accel_bias_y", "m/s^2", 0.0, (-3.0, 3.0), fixed=True, about="added to the lateral acceleration"),
)
SIMILAR = tuple(
    Parameter(f"{kind}_scale_{axle}", "1", 1.0, (0.3, 3.0), Prior(0.3), fixed=True, about=f"{what}, {where} axle")
    for kind, what in (("stiffness", "slope at zero slip divided by that of the trained tyres"),
                       ("grip", "largest force divided by that of the trained tyres"))
    for axle, where in (("f", "front"), ("r", "rear"))
)  # fmt: skip
ALONG = (
    BODY[4],
    *(item for item in DRIVE if item.name in ("drive_split_front", "brake_split_front")),
    *(Parameter(f"mu_{axle}", "1", 1.0, (0.1, 3.0), fixed=True, about=f"friction of the {where} axle")
      for axle, where in (("f", "front"), ("r", "rear"))),
    Parameter("slope_load_exponent", "1", 0.64, (0.0, 1.5), fixed=True,
              about="exponent of an axle's load in its tyres' slope at zero slip"),
    Parameter("grip_load_exponent", "1", 0.85, (0.0, 1.5), fixed=True,
              about="exponent of an axle's load in its largest force"),
)  # fmt: skip
"""Exponents are those of a car's tyre about its nominal load (Pacejka, App. 3, 205/60 R 15): d ln K / d ln F_z =
cos(2 atan(1 / p_Ky2)) with p_Ky2 = 2.13, and 1 + p_Dy2 / p_Dy1 with -0.990 and 0.145. Of four other cars' tyres whose
coefficients are public (CommonRoad's; 195/65 R 15, 225/60 R 16 and 195/50 R 15 at pierre.lemerle.free.fr) the first is
0.60, 0.67, 0.77 and 0.34."""
_SLIP = 0.1
"""Scale of slip angles as inputs of the network, rad."""
_LONGEST_STEP = 0.0125
"""Longest integration step, s; see `engine.hybrid.cell`."""


@dataclass(frozen=True)
class HybridSettings:
    """Hyperparameters of hybrid models; the defaults for the network are the paper's.

    Attributes
    ----------
    hidden : units of the hidden layers.
    window, warm_up : rows predicted from one start in training, and how many of them are not compared.
    speed, speed_spread : centre and scale of the network's speed input, m/s; None takes mean and standard deviation of
        the training recording.
    symmetric : whether the vehicle is mirror-symmetric: stiffnesses then depend on magnitudes of the lateral signals;
        forces are trained on every manoeuvre mirrored too, at twice the cost.
    tyre : initial tyre curve, "pacejka" for example, with a vehicle's parameters; None for a straight line.
    longitudinal : whether the axles' lateral forces depend on load transfer by a_x, and on the friction used by brakes
        and drive; a_x is an input then.
    least_speed : speed below which slip angles are meaningless, m/s.
    sample_time : s; None takes the training recording's.
    """

    hidden: tuple[float, ...] = (25.0, 15.0, 10.0)
    window: int = 60
    warm_up: int = 20
    speed: float | None = None
    speed_spread: float | None = None
    symmetric: bool = False
    tyre: str | None = None
    longitudinal: bool = False
    least_speed: float = 3.0
    sample_time: float | None = None

    def __post_init__(self) -> None:
        within(self, window=(2, 5000), warm_up=(0, 4999), least_speed=(0.1, 100.0))
        sized(self.window, self.warm_up, self.hidden)
        if self.tyre is not None:
            TyreSettings(self.tyre)


def sized(window: int, warm_up: int, hidden: Sequence[float]) -> None:
    """Raise `BadInput` if sizes of a network's windows or layers are not valid."""
    if warm_up >= window:
        raise BadInput(f"Setting warm_up must be smaller than window, {window}; {warm_up} rows were given.")
    if any(units != int(units) or not 1 <= units <= 500 for units in hidden):
        raise BadInput("Setting hidden is a list of whole numbers from 1 to 500, as in hidden=[25,15,10].")


def covering_hybrid(settings: HybridSettings, recording: Recording) -> HybridSettings:
    """The settings with open speed and sample time set from a training recording."""
    along = ("a_x",) if settings.longitudinal else ()
    recording.require(("v_x", "steer", *along, "a_y", "yaw_rate"), "a hybrid model")
    v_x = recording["v_x"]
    driven = v_x[np.isfinite(v_x) & (v_x >= settings.least_speed)]
    if len(driven) == 0:
        raise BadInput(
            f"{recording.name} is nowhere faster than {settings.least_speed:g} m/s; at lower speeds, slip angles "
            "mean nothing."
        )
    mean, spread = float(np.mean(driven)), float(np.std(driven))
    return replace(
        settings,
        speed=round(mean, 3) if settings.speed is None else settings.speed,
        speed_spread=round(max(spread, 0.1 * mean), 3) if settings.speed_spread is None else settings.speed_spread,
        sample_time=round(recording.sample_time, 9) if settings.sample_time is None else settings.sample_time,
    )


def hybrid_stiffness(settings: HybridSettings | None = None) -> HybridModel:
    """Hybrid model whose network computes the axles' cornering stiffnesses (Eq. 6-8)."""
    return _hybrid(
        "hybrid_stiffness",
        "linear single track whose cornering stiffnesses are predicted by a recurrent network",
        ("a_y", "yaw_rate", "sideslip"),
        lambda z, nominal, load: _positive(z) * nominal,
        settings or HybridSettings(),
        skip=False,
    )


def hybrid_force(settings: HybridSettings | None = None) -> HybridModel:
    """Hybrid model whose network computes the axles' lateral forces (Eq. 9-12).

    Its outputs are added to a plain tyre's force, without which the vehicle would not turn and training could not
    start; features also enter the output directly, so that this tyre's slope need not be right.
    """
    return _hybrid(
        "hybrid_force",
        "rigid single track whose lateral tyre forces are predicted by a recurrent network",
        ("a_y", "yaw_rate", "v_y", "yaw_acceleration"),
        lambda z, nominal, load: nominal + load * z,
        settings or HybridSettings(),
        skip=True,
    )


def _hybrid(
    name: str,
    about: str,
    outputs: tuple[str, ...],
    force: Callable[[Symbol, Symbol, Symbol], Symbol],
    s: HybridSettings,
    skip: bool,
) -> HybridModel:
    network = RecurrentNetwork(4, tuple(int(units) for units in s.hidden), 2, skip)
    speed, spread = s.speed or 15.0, s.speed_spread or 5.0
    sample_time = s.sample_time or 0.01

    sizes, tyre = s.symmetric and not skip, TYRES.get(s.tyre or "")

    def nominal(axle_of: str, slip: Symbol, load: Symbol, p: Namespace) -> Symbol:
        return SLOPE * load * slip if tyre is None else tyre.force(slip, load, axle(p, axle_of), 1.0, 1.0)

    def slips(x: Namespace, u: Namespace, p: Namespace) -> tuple[Symbol, Symbol]:
        front = u.steer + p.steering_offset - cs.atan((x.v_y + p.l_f * x.yaw_rate) / u.v_x)
        return front, -cs.atan((x.v_y - p.l_r * x.yaw_rate) / u.v_x)

    def similar(x: Namespace, u: Namespace, p: Namespace) -> tuple[Symbol, Symbol]:
        alpha_f, alpha_r = slips(x, u, p)
        if s.longitudinal:
            bent = p.slope_load_exponent - p.grip_load_exponent
            alpha_f, alpha_r = (
                each**bent * slip for each, slip in zip(_loads(u.a_x, p), (alpha_f, alpha_r), strict=True)
            )
        return p.stiffness_scale_f / p.grip_scale_f * alpha_f, p.stiffness_scale_r / p.grip_scale_r * alpha_r

    def features(x: Namespace, u: Namespace, p: Namespace) -> Sequence[Symbol]:
        alpha_f, alpha_r = similar(x, u, p)
        turning = alpha_f / _SLIP, alpha_r / _SLIP, u.v_x * x.yaw_rate / G
        return *(map(cs.fabs, turning) if sizes else turning), (u.v_x - speed) / spread

    def physics(
        x: Namespace, u: Namespace, p: Namespace, z: Sequence[Symbol]
    ) -> tuple[Mapping[str, Symbol], Mapping[str, Symbol]]:
        alpha_f, alpha_r = slips(x, u, p)
        steer = u.steer + p.steering_offset
        weight = p.m * G / (p.l_f + p.l_r)
        front, rear, F_xf = weight * p.l_r, weight * p.l_f, 0.0
        if s.longitudinal:
            front, rear, F_xf = _loaded(u.a_x, p)
        F_yf, F_yr = (
            force(each, nominal(suffix, slip, load, p), load)
            for each, suffix, slip, load in zip(
                z, "fr", similar(x, u, p), (p.grip_scale_f * front, p.grip_scale_r * rear), strict=True
            )
        )
        across = F_yf * cs.cos(steer) + F_xf * cs.sin(steer)
        a_y = (across + F_yr) / p.m
        yaw_acceleration = (p.l_f * across - p.l_r * F_yr) / p.I_z
        return {"v_y": a_y - u.v_x * x.yaw_rate, "yaw_rate": yaw_acceleration}, {
            "F_yf": F_yf, "F_yr": F_yr, "alpha_f": alpha_f, "alpha_r": alpha_r,
            "C_alpha_f": F_yf / alpha_f, "C_alpha_r": F_yr / alpha_r,
            "a_y": a_y + p.accel_bias_y, "yaw_acceleration": yaw_acceleration, "sideslip": cs.atan(x.v_y / u.v_x),
        }  # fmt: skip

    curves = () if tyre is None else (replace(p, fixed=True) for suffix in "fr" for p in tyre.parameters(suffix))
    known = {item.name: item for item in (*(ALONG if s.longitudinal else ()), *curves)}
    return HybridModel(
        name=name,
        about=about,
        inputs=("v_x", "steer", *(("a_x",) if s.longitudinal else ())),
        commands=("steer",),
        symmetric=s.symmetric and not sizes,
        outputs=outputs,
        parameters=(*BODY[:4], *OFFSETS, *SIMILAR, *known.values(), *weights(network)),
        states=(Carried("v_y", "m/s"), Carried("yaw_rate", "rad/s")),
        network=network,
        features=features,
        physics=physics,
        estimates={
            "F_yf": "N", "F_yr": "N", "C_alpha_f": "N/rad", "C_alpha_r": "N/rad", "alpha_f": "rad", "alpha_r": "rad",
            "v_y": "m/s", "sideslip": "rad", "yaw_rate": "rad/s", "a_y": "m/s^2",
        },
        untold={"C_alpha_f": ("alpha_f", EXCITED), "C_alpha_r": ("alpha_r", EXCITED)},
        readings={"v_y": v_y_of, "sideslip": _sideslip, "yaw_acceleration": _yaw_acceleration},
        least={"v_x": s.least_speed},
        carried_on=tuple(item.name for item in SIMILAR),
        sample_time=sample_time,
        substeps=max(ceil(sample_time / _LONGEST_STEP - 1e-9), 1),
        window=s.window,
        warm_up=s.warm_up,
        settings=asdict(s),
        together=("mass, inertia and forces: without a force sensor only F/m and I_z/m are identifiable",),
    )  # fmt: skip


def _loads(a_x: Symbol, p: Namespace) -> tuple[Symbol, Symbol]:
    """Loads of front and rear axle relative to those at rest."""
    moved = p.h_cg * a_x / G
    return 1.0 - moved / p.l_r, 1.0 + moved / p.l_f


def _loaded(a_x: Symbol, p: Namespace) -> tuple[Symbol, Symbol, Symbol]:
    """Effective load [N] of each axle, by which friction scales, reduced by longitudinal forces; and F_xf [N]."""
    weight = p.m * G / (p.l_f + p.l_r)
    front, rear = (each**p.grip_load_exponent for each in _loads(a_x, p))
    F_zf, F_zr = weight * p.l_r * front, weight * p.l_f * rear
    driving, braking = p.m * cs.fmax(a_x, 0.0), p.m * cs.fmin(a_x, 0.0)
    F_xf = p.drive_split_front * driving + p.brake_split_front * braking
    F_xr = driving + braking - F_xf
    left_f, left_r = (remaining((F_x / F_max) ** 2) for F_x, F_max in ((F_xf, p.mu_f * F_zf), (F_xr, p.mu_r * F_zr)))
    return F_zf * cs.sqrt(left_f), F_zr * cs.sqrt(left_r), F_xf


def _positive(z: Symbol) -> Symbol:
    """Positive function: one at zero, nearly z for large z; it does not overflow."""
    return (z + cs.sqrt(z * z + 4.0)) / 2.0


def weights(network: RecurrentNetwork | FeedForwardNetwork) -> tuple[Parameter, ...]:
    """Weights of a network as parameters, initially zero, so that its outputs are zero."""
    return tuple(
        Parameter(name, "1", np.zeros(shape), about=_ABOUT[name.split("_")[0]] + f" {name.split('_')[1]}")
        for name, shape in network.shapes.items()
    )


_ABOUT = {"W": "weights of layer", "R": "weights of the memory, layer", "b": "biases of layer"}


def v_y_of(recording: Recording) -> Array | None:
    """Lateral velocity, recorded or from the sideslip angle; None if neither is recorded."""
    if "v_y" in recording:
        return recording["v_y"]
    if "sideslip" not in recording:
        return None
    return np.asarray(recording["v_x"] * np.tan(recording["sideslip"]))


def _sideslip(recording: Recording) -> Array | None:
    if "v_y" not in recording:
        return None
    return np.asarray(np.arctan2(recording["v_y"], recording["v_x"]))


def _yaw_acceleration(recording: Recording) -> Array:
    """Central differences of the yaw rate, run by run (Sec. 3.1)."""
    result = np.full(len(recording), np.nan)
    for start, stop in recording.runs:
        if stop - start > 2:
            result[start:stop] = np.gradient(recording["yaw_rate"][start:stop], recording.time[start:stop])
    return result
