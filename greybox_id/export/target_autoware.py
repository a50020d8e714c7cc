"""Target `autoware`: parameter files of Autoware's planning simulator, vehicle and lateral controller.

Every key is determined by a parameter or effect, or has the default that Autoware publishes (sample vehicle, MPC
lateral controller). Sources: documentation of simple_planning_simulator, vehicle_info_utils, mpc_lateral_controller and
raw_vehicle_cmd_converter of Autoware Universe.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import NamedTuple

import numpy as np

from .single_track_numbers import HELD, SingleTrack, single_track_of, value_of
from .subject import KeyOrigin, Subject
from .target_ros2 import parameter_file, texts

SIMULATOR, VEHICLE, CONTROLLER = "simulator_model.param.yaml", "vehicle_info.param.yaml", "mpc.param.yaml"
ACCELERATING, BRAKING = "accel_map.csv", "brake_map.csv"
SPEEDS = (0.0, 1.39, 2.78, 4.17, 5.56, 6.94, 8.33, 9.72, 11.11, 12.5, 13.89)
"""Speeds, m/s, of the maps that Autoware ships."""
PEDALS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
SHORTEST = 0.03
"""s; the planning simulator raises shorter time constants to this value."""
ACTUATORS = {
    "steer_time_delay": "steering_delay", "steer_time_constant": "steering_lag",
    "steer_rate_lim": "steering_rate_limit",
    "steer_dead_band": "steering_backlash", "steer_bias": "steering_offset",
    "debug_steer_scaling_factor": "steering_ratio", "acc_time_constant": "motor_lag",
    "debug_acc_scaling_factor": "motor_gain", "vel_rate_lim": "motor_saturation",
}  # fmt: skip
"""Keys of the simulator -> effect that determines them."""


class AutowareEntry(NamedTuple):
    """A key with its default, used unless a parameter or effect determines it."""

    key: str
    default: float | str | bool | tuple[float, ...]
    about: str
    behind: str = ""
    value: float | None = None


def files(subject: Subject) -> Mapping[str, bytes]:
    """Name of file -> content. Raises `BadInput` for a model without tyres."""
    title = f"{subject.model.about}, from {subject.source}"
    result = {
        file: parameter_file(title, [(_origin(subject, file, entry), entry.about) for entry in entries])
        for file, entries in _entries(subject).items()
    }
    if _has_pedals(subject):
        result |= {ACCELERATING: _map(subject, 1.0), BRAKING: _map(subject, -1.0)}
    return texts(result)


def origins(subject: Subject) -> list[KeyOrigin]:
    """Origin of each key, or the reason for its default."""
    return [_origin(subject, file, entry) for file, entries in _entries(subject).items() for entry in entries]


def cautions(subject: Subject) -> list[str]:
    """Sentences on what these files lack."""
    held = (*ACTUATORS.values(), *HELD)
    model = subject.model
    lost = [name for name in model.effects if name not in held]
    result = [f"Autoware's files have no entry for {', '.join(lost)}, which is left out."] if lost else []
    short = [
        name for name in ("steering_lag", "motor_lag") if name in model.effects and float(model[name].array) < SHORTEST
    ]
    if short:
        result.append(
            f"Autoware's planning simulator raises time constants below {SHORTEST} s to that value: {', '.join(short)}."
        )
    if not _has_pedals(subject):
        result.append(
            f"{ACCELERATING} and {BRAKING} are not written: they are maps of pedal positions, and the model's drive "
            "signal is not a throttle position."
        )
    open_keys = [origin.key for origin in origins(subject) if origin.why and origin.file == VEHICLE]
    if open_keys:
        result.append(f"Not known for this vehicle, so {VEHICLE} holds Autoware's defaults: {', '.join(open_keys)}.")
    return result


def _origin(subject: Subject, file: str, entry: AutowareEntry) -> KeyOrigin:
    if entry.value is not None and isfinite(entry.value):
        return KeyOrigin(file, entry.key, entry.value, behind=entry.behind)
    if entry.key in _BY_EFFECT and entry.behind:
        return KeyOrigin(file, entry.key, _plain(entry.default), why=f"the model has no {entry.behind}")
    why = f"{entry.behind} is not stated" if entry.behind else "no parameter or effect gives this value"
    return KeyOrigin(file, entry.key, _plain(entry.default), why=why)


_BY_EFFECT = {*ACTUATORS, "input_delay", "vehicle_model_steer_tau"}


def _plain(default: float | str | bool | tuple[float, ...]) -> float | str | bool | list[float]:
    return list(default) if isinstance(default, tuple) else default


def _entries(subject: Subject) -> dict[str, list[AutowareEntry]]:
    numbers = single_track_of(subject)
    return {
        SIMULATOR: _simulator(subject),
        VEHICLE: _vehicle(subject, numbers),
        CONTROLLER: _controller(subject, numbers),
    }


def _effect(subject: Subject, name: str) -> float | None:
    return value_of(subject.model, name) if name in subject.model.effects else None


def _simulator(subject: Subject) -> list[AutowareEntry]:
    def by(key: str, default: float, about: str, sign: float = 1.0) -> AutowareEntry:
        value = _effect(subject, ACTUATORS[key])
        return AutowareEntry(key, default, about, ACTUATORS[key], None if value is None else sign * value)

    limit = None if subject.vehicle is None else subject.vehicle.steer_max
    added = "rad, added to the steering reading; wheel angle = command - steer_bias"
    bias = by("steer_bias", 0.0, added, -_scaled_after(subject))
    return [
        AutowareEntry("simulated_frame_id", "base_link", "centre of the rear axle"),
        AutowareEntry("origin_frame_id", "map", ""),
        AutowareEntry("vehicle_model_type", "DELAY_STEER_ACC_GEARED", "first-order lags with delays and limits"),
        AutowareEntry("initialize_source", "INITIAL_POSE_TOPIC", ""),
        AutowareEntry("timer_sampling_time_ms", 25, "ms"),
        AutowareEntry("add_measurement_noise", False, ""),
        AutowareEntry("vel_lim", 50.0, "m/s"),
        by("vel_rate_lim", 7.0, "m/s^2, largest acceleration"),
        AutowareEntry("steer_lim", 1.0, "rad", "steer_max", limit),
        by("steer_rate_lim", 5.0, "rad/s"),
        AutowareEntry("acc_time_delay", 0.1, "s, dead time of the acceleration command"),
        by("acc_time_constant", 0.1, "s"),
        by("steer_time_delay", 0.24, "s, dead time of the steering command"),
        by("steer_time_constant", 0.27, "s"),
        by("steer_dead_band", 0.0, "rad, half width"),
        bias,
        by("debug_acc_scaling_factor", 1.0, "ratio of the acceleration to the commanded one"),
        by("debug_steer_scaling_factor", 1.0, "ratio of the steering angle to the commanded one"),
        AutowareEntry("x_stddev", 0.0001, "m, for the covariance of the pose"),
        AutowareEntry("y_stddev", 0.0001, "m, for the covariance of the pose"),
    ]  # fmt: skip


def _scaled_after(subject: Subject) -> float:
    """Factor on the offset: the steering ratio if that effect was added after it, else one."""
    effects = list(subject.model.effects)
    if "steering_ratio" not in effects or "steering_offset" not in effects:
        return 1.0
    later = effects.index("steering_ratio") > effects.index("steering_offset")
    return float(subject.model["steering_ratio"].array) if later else 1.0


def _vehicle(subject: Subject, numbers: SingleTrack) -> list[AutowareEntry]:
    def stated(name: str) -> float | None:
        if subject.vehicle is not None and name in subject.vehicle.values:
            return subject.vehicle.values[name].value
        return None

    limit = None if subject.vehicle is None else subject.vehicle.steer_max
    return [
        AutowareEntry("wheel_radius", 0.383, "m", "wheel_radius", stated("wheel_radius")),
        AutowareEntry("wheel_width", 0.235, "m"),
        AutowareEntry("wheel_base", 2.79, "m", "l_f + l_r", numbers.l_f + numbers.l_r),
        AutowareEntry("wheel_tread", 1.64, "m", "track_f", stated("track_f")),
        AutowareEntry("front_overhang", 1.0, "m"),
        AutowareEntry("rear_overhang", 1.1, "m"),
        AutowareEntry("left_overhang", 0.128, "m"),
        AutowareEntry("right_overhang", 0.128, "m"),
        AutowareEntry("vehicle_height", 2.5, "m"),
        AutowareEntry("max_steer_angle", 0.70, "rad", "steer_max", limit),
    ]


def _controller(subject: Subject, numbers: SingleTrack) -> list[AutowareEntry]:
    share_f, share_r = (item.load / 2 / 9.81 for item in (numbers.front, numbers.rear))
    tyres = "B, C, D: cornering stiffness at rest" if numbers.front.pacejka else "cornering stiffness at rest"
    return [
        AutowareEntry("vehicle_model_type", "kinematics", "kinematics, kinematics_no_delay or dynamics"),
        AutowareEntry(
            "input_delay", 0.24, "s, of the steering command", "steering_delay", _effect(subject, "steering_delay")
        ),
        AutowareEntry("vehicle_model_steer_tau", 0.3, "s", "steering_lag", _effect(subject, "steering_lag")),
        AutowareEntry("acceleration_limit", 2.0, "m/s^2"),
        AutowareEntry("velocity_time_constant", 0.3, "s"),
        AutowareEntry("cg_to_front_m", 1.228, "m", "l_f", numbers.l_f),
        AutowareEntry("cg_to_rear_m", 1.5618, "m", "l_r", numbers.l_r),
        AutowareEntry("mass_kg", 2400.0, "kg", "m", numbers.m),
        AutowareEntry("mass_fl", 600.0, "kg on the wheel", "m, l_f, l_r", share_f),
        AutowareEntry("mass_fr", 600.0, "kg on the wheel", "m, l_f, l_r", share_f),
        AutowareEntry("mass_rl", 600.0, "kg on the wheel", "m, l_f, l_r", share_r),
        AutowareEntry("mass_rr", 600.0, "kg on the wheel", "m, l_f, l_r", share_r),
        AutowareEntry("cf", 155494.663, "N/rad, front axle", tyres, numbers.front.C_alpha),
        AutowareEntry("cr", 155494.663, "N/rad, rear axle", tyres, numbers.rear.C_alpha),
    ]


def _has_pedals(subject: Subject) -> bool:
    """Whether the fit's drive signal is the throttle, a share of full throttle."""
    seen = {} if subject.fit is None else subject.fit.how.get("inputs", {})
    return seen.get("drive") == "throttle"


def _map(subject: Subject, sign: float) -> str:
    """Steady acceleration, m/s^2, over pedal and speed on a level road, straight ahead."""
    e = subject.equations
    places = {state.name: k for k, state in enumerate(e.states)}, {item.name: k for k, item in enumerate(e.inputs)}
    rows = [["default", *(f"{v:g}" for v in SPEEDS)]]
    for pedal in PEDALS:
        row = [f"{pedal:g}"]
        for v in SPEEDS:
            x, u = np.zeros(len(e.states)), np.zeros(len(e.inputs))
            x[places[0]["v_x"]], u[places[1]["drive"]] = v, sign * pedal
            settled = np.array(e.settled(x, u, e.values)).ravel()
            row.append(f"{float(e.ode(settled, u, e.values)[places[0]['v_x']]):.6g}")
        rows.append(row)
    return "".join(",".join(row) + "\n" for row in rows)
