"""Models by name, including those of installed packages: `gb.models.single_track(tyre="pacejka", vehicle=car)`.

Also the elements of your own models: `MotionModel`, `State`, `Parameter`, `Prior`.

Examples
--------
>>> import greybox_id as gb
>>> gb.models.names()[:4]
('single_track', 'lateral', 'longitudinal', 'kinematic')
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from html import escape
from pathlib import Path
from typing import Any, cast

from ..api import given
from ..base.errors import BadInput, near_or_all
from ..base.numbers import counted, exact, short_with_sd
from ..datasets.recording import Recording
from ..fitting.requested_model import named_vehicle
from ..models.hybrid_model import HybridModel
from ..models.memory_model import MemoryModel
from ..models.model import Model
from ..models.motion_model import MotionModel, State
from ..models.parameter import Parameter, Prior, Stated
from ..models.registry import MODELS, build, install, own_model, prepared
from ..models.vehicle import Vehicle, shipped_vehicles, write_vehicle
from .given import VehicleLike

__all__ = [
    "Model", "MotionModel", "Parameter", "Prior", "State", "Stated",
    "bicycle_mlp", "gnn", "hybrid_force", "hybrid_stiffness", "kinematic", "lateral", "longitudinal", "mlp_lateral",
    "msnn_bench_lat", "msnn_bench_long", "msnn_full", "msnn_full_plus", "msnn_lat", "msnn_long",
    "names", "own", "single_track", "steering", "vehicles",
]  # fmt: skip


def single_track(tyre: str = "pacejka", vehicle: VehicleLike = None) -> MotionModel:
    """Single-track model with three degrees of freedom: v_x, v_y [m/s] and yaw rate [rad/s] from steering and drive.

    Parameters
    ----------
    tyre : "pacejka", "linear", "dugoff" or "brush".
    vehicle : with the initial values: a shipped name, a file or a `Vehicle`; None uses those of a full-size car.

    Raises
    ------
    BadInput : if the tyre or the vehicle is unknown, or a number of the vehicle cannot be used.

    Examples
    --------
    >>> import greybox_id as gb
    >>> model = gb.models.single_track(tyre="brush", vehicle="roboracer")
    >>> float(model["m"].value)
    3.6
    """
    return cast(MotionModel, build("single_track", {"tyre": tyre}, vehicle=given.vehicle(vehicle)))


def lateral(tyre: str = "pacejka", vehicle: VehicleLike = None) -> MotionModel:
    """Single-track model at a measured speed: v_y [m/s] and yaw rate [rad/s] from steering [rad] and v_x [m/s].

    Parameters and errors are those of `single_track`.

    Examples
    --------
    >>> import greybox_id as gb
    >>> gb.models.lateral(tyre="linear").outputs
    ('v_y', 'yaw_rate', 'a_y')
    """
    return cast(MotionModel, build("lateral", {"tyre": tyre}, vehicle=given.vehicle(vehicle)))


def longitudinal(vehicle: VehicleLike = None) -> MotionModel:
    """Longitudinal model: v_x [m/s] and a_x [m/s^2] from the drive signal and the road's slope [rad].

    Examples
    --------
    >>> import greybox_id as gb
    >>> gb.models.longitudinal().outputs
    ('v_x', 'a_x')
    """
    return cast(MotionModel, build("longitudinal", vehicle=given.vehicle(vehicle)))


def kinematic(understeer: bool = True, vehicle: VehicleLike = None) -> MotionModel:
    """Kinematic car: yaw rate [rad/s] and a_y [m/s^2] from steering [rad] and measured speed [m/s].

    Parameters
    ----------
    understeer : whether it has an understeer gradient K_us [rad s^2/m].
    vehicle : as in `single_track`.

    Examples
    --------
    >>> import greybox_id as gb
    >>> "K_us" in gb.models.kinematic(understeer=False)
    False
    """
    return cast(MotionModel, build("kinematic", {"understeer": understeer}, vehicle=given.vehicle(vehicle)))


def steering() -> MotionModel:
    """Steering actuator: the measured road-wheel angle [rad], which lags behind its command [rad].

    Examples
    --------
    >>> import greybox_id as gb
    >>> gb.models.steering().outputs
    ('steer_measured',)
    """
    return cast(MotionModel, build("steering"))


def _network(name: str, recording: Recording | None, settings: Mapping[str, Any]) -> Model:
    if recording is None:
        return build(name, settings)
    return prepared(name, given.one_recording(recording), settings)


def msnn_lat(recording: Recording | None = None, **settings: Any) -> MemoryModel:
    """Model-structured neural network of the yaw rate [rad/s] (Mungiello et al.), 160 weights by default.

    Parameters
    ----------
    recording : training data that determine the range of hyperparameters that are not set.
    settings : hyperparameters, as listed by `greybox models msnn_lat`.

    Raises
    ------
    BadInput : if a setting is unknown, or the recording lacks a signal.

    Examples
    --------
    >>> import greybox_id as gb
    >>> gb.models.msnn_lat().outputs
    ('yaw_rate',)
    """
    return cast(MemoryModel, _network("msnn_lat", recording, settings))


def msnn_long(recording: Recording | None = None, **settings: Any) -> MemoryModel:
    """Model-structured neural network of the longitudinal acceleration [m/s^2]; parameters as in `msnn_lat`."""
    return cast(MemoryModel, _network("msnn_long", recording, settings))


def msnn_full(recording: Recording | None = None, **settings: Any) -> MemoryModel:
    """Both model-structured networks in closed loop; parameters as in `msnn_lat`."""
    return cast(MemoryModel, _network("msnn_full", recording, settings))


def msnn_full_plus(recording: Recording | None = None, **settings: Any) -> MemoryModel:
    """`msnn_full`, with structure selected by cross-validation if fitted by name; parameters as in `msnn_lat`."""
    return cast(MemoryModel, _network("msnn_full_plus", recording, settings))


def gnn(recording: Recording | None = None, **settings: Any) -> MemoryModel:
    """Network without structure of yaw rate and acceleration (Mungiello et al., G-NN); parameters as in `msnn_lat`."""
    return cast(MemoryModel, _network("gnn", recording, settings))


def msnn_bench_lat(recording: Recording | None = None, **settings: Any) -> MemoryModel:
    """The paper's benchmark of the yaw rate (Mungiello et al., MS-NN-bench); parameters as in `msnn_lat`."""
    return cast(MemoryModel, _network("msnn_bench_lat", recording, settings))


def msnn_bench_long(recording: Recording | None = None, **settings: Any) -> MemoryModel:
    """The paper's benchmark of the acceleration (Mungiello et al., MS-NN-bench); parameters as in `msnn_lat`."""
    return cast(MemoryModel, _network("msnn_bench_long", recording, settings))


def hybrid_stiffness(recording: Recording | None = None, **settings: Any) -> HybridModel:
    """Linear single track whose cornering stiffnesses a recurrent network predicts; parameters as in `msnn_lat`."""
    return cast(HybridModel, _network("hybrid_stiffness", recording, settings))


def mlp_lateral(recording: Recording | None = None, **settings: Any) -> HybridModel:
    """Feed-forward network of the rates of v_y [m/s] and yaw rate [rad/s]; parameters as in `msnn_lat`.

    Examples
    --------
    >>> import greybox_id as gb
    >>> gb.models.mlp_lateral(hidden=[8, 8]).outputs
    ('v_y', 'yaw_rate')
    """
    return cast(HybridModel, _network("mlp_lateral", recording, settings))


def bicycle_mlp(recording: Recording | None = None, **settings: Any) -> HybridModel:
    """Single track, and a feed-forward network of the errors of its rates; parameters as in `msnn_lat`."""
    return cast(HybridModel, _network("bicycle_mlp", recording, settings))


def hybrid_force(recording: Recording | None = None, **settings: Any) -> HybridModel:
    """Linear single track whose axle forces a recurrent network predicts; parameters as in `msnn_lat`."""
    return cast(HybridModel, _network("hybrid_force", recording, settings))


def own(place: str) -> Model:
    """Your own model, from a Python file that is executed.

    Parameters
    ----------
    place : FILE.py:NAME, such as "my_car.py:my_model"; NAME is a model, or a function without arguments that makes one.

    Raises
    ------
    BadInput : if the file fails, lacks the name, or has the name of a shipped model.
    """
    return own_model(place)


def names() -> tuple[str, ...]:
    """Names of all models, shipped and from installed packages.

    Examples
    --------
    >>> import greybox_id as gb
    >>> "single_track" in gb.models.names()
    True
    """
    install()
    return tuple(MODELS)


def vehicles() -> tuple[str, ...]:
    """Names of the vehicles that come with the package.

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> import greybox_id as gb
    >>> "roboracer" in gb.models.vehicles()
    True
    """
    return shipped_vehicles()


def __getattr__(name: str) -> Callable[..., Model]:
    """A model of an installed package."""
    if name.startswith("_"):
        raise AttributeError(name)
    install()
    if name not in MODELS:
        raise AttributeError(f"There is no model {name!r}.{near_or_all(name, MODELS)}")

    def brought(vehicle: VehicleLike = None, **settings: Any) -> Model:
        return build(name, settings, vehicle=given.vehicle(vehicle))

    return brought


MOST_SHOWN, IN_A_LINE = 12, 4
"""Most values that are shown, and number per line."""


@dataclass(frozen=True)
class KnownVehicle(Vehicle):
    """The stated numbers of a vehicle: values, standard deviations, tolerances, sensor noise; from a file and to it.

    Attributes are those of `greybox_id.models.vehicle.Vehicle`: `values` and `effects` (name -> `Stated`), `noise`
    (signal -> standard deviation), `steer_max` [rad], `model`, `tracking`, all in SI units.

    Examples
    --------
    >>> import greybox_id as gb
    >>> car = gb.Vehicle.load("roboracer")
    >>> car.values["m"].value
    3.6
    >>> gb.Vehicle("my car", values={"m": gb.models.Stated(3.5, sd=0.1)}).values["m"].sd
    0.1
    """

    @classmethod
    def load(cls, path: str | Path) -> KnownVehicle:
        """A shipped vehicle by its name, or your own from a .toml or .json file.

        Raises
        ------
        BadInput : if the vehicle is unknown, or its file is not a valid vehicle file.
        """
        if not isinstance(path, str | Path):
            raise BadInput(f"path: a shipped name or a path is needed, not {path!r:.60}.")
        result = named_vehicle(str(path))
        assert result is not None
        return cls(**{field.name: getattr(result, field.name) for field in fields(Vehicle)})

    def __repr__(self) -> str:
        values = [_said(name, value) for name, value in self.values.items()]
        lines = [", ".join(values[k : k + IN_A_LINE]) for k in range(0, min(len(values), MOST_SHOWN), IN_A_LINE)]
        more = len(values) - MOST_SHOWN
        named = {"tolerances": self.effects, "noise of": self.noise}
        lines += [f"{title} {', '.join(item)}" for title, item in named.items() if item]
        left = f", {more} of them not shown" if more > 0 else ""
        first = f"Vehicle {self.name}: {counted(len(values), 'value')}{left}"
        return "\n  ".join([first, *lines])

    def _repr_html_(self) -> str:
        return f"<pre>{escape(repr(self))}</pre>"

    def save(self, path: str | Path) -> Path:
        """Write a vehicle file, .toml or .json, atomically. Raises `BadInput` if it cannot be written."""
        return write_vehicle(self, path)


def _said(name: str, stated: Stated) -> str:
    if stated.value is None:
        return name
    return f"{name} = {short_with_sd(stated.value, stated.sd) if stated.sd else exact(stated.value, 6)}"
