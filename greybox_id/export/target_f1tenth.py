"""Target `f1tenth`: parameter files of f1tenth_gym and of the ForzaETH race stack.

Both use a single track whose axles' lateral force is mu C_S F_z alpha, C_S the cornering stiffness per load and
friction [1/rad], or in the race stack mu F_z D sin(C atan(B a - E (B a - atan(B a)))).
Sources: vehicle_dynamics_st of f1tenth_gym; id_analyser, CarConfig and PacejkaTireConfig of the ForzaETH race stack.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import NamedTuple

from .c.naming import one_line, yaml_text
from .single_track_numbers import HELD, Axle, SingleTrack, single_track_of, value_of, without_form_error
from .subject import Subject

GYM = {"h": 0.074, "s_max": 0.4189, "sv_max": 3.2, "v_switch": 7.319, "a_max": 9.51, "v_min": -5.0, "v_max": 20.0,
       "width": 0.31, "length": 0.58}  # fmt: skip
"""Values published by f1tenth_gym for its 1:10 car."""
LIKE_THE_GYMS = (0.2, 0.5)
"""Range of wheelbases, m, of cars for which the gym's values may be used as defaults."""
GYM_HOLDS = (*HELD, "longitudinal_load_transfer", "steering_rate_limit", "motor_saturation")
STACK_HOLDS = (*GYM_HOLDS, "steering_lag")
SERVO = {
    "C_d": "servo position per steering angle, 1/rad", "C_0d": "servo position at no steering",
    "C_v": "erpm per speed, s/m", "C_0v": "erpm at rest", "C_acc": "motor current per acceleration, A s^2/m",
    "C_dec": "motor current per deceleration, A s^2/m", "C_R": "motor current per speed, against drag, A s/m",
}  # fmt: skip
"""Keys of the race stack on a car's electronics, which no motion model determines."""


class Line(NamedTuple):
    """An entry of a file; without a value it is written as a comment, to be filled in."""

    key: str
    value: float | str | Sequence[float] | None
    about: str


def files(subject: Subject) -> Mapping[str, bytes]:
    """Name of file -> content. Raises `BadInput` for a model without tyres."""
    numbers, car = single_track_of(subject), subject.name.replace("_", "")
    tyre = "linear" if numbers.front.pacejka is None else "pacejka"
    written = {
        f"{subject.name}_gym.yaml": (_gym(subject, numbers), GYM_HOLDS),
        f"{car}_{tyre}.txt": (_model_file(subject, numbers, car, tyre), STACK_HOLDS),
        "car_model.yaml": (_car_model(subject, numbers), STACK_HOLDS),
    }
    if tyre == "pacejka":
        written["pacejka.yaml"] = (_tyres(subject, numbers), STACK_HOLDS)
    return {
        name: "\n".join([*_head(subject, held), *(_text(line) for line in lines), ""]).encode()
        for name, (lines, held) in written.items()
    }


def cautions(subject: Subject) -> list[str]:
    """Sentences on what these files lack."""
    numbers = single_track_of(subject)
    result = [f"{which} has no entry for {', '.join(lost)}, which is left out." for which, held in (
        ("f1tenth_gym", GYM_HOLDS), ("The ForzaETH race stack", STACK_HOLDS)
    ) if (lost := _lost(subject, held))]  # fmt: skip
    result += without_form_error(subject)
    if numbers.h_cg and "longitudinal_load_transfer" not in subject.model.effects:
        result.append(
            "Both tools compute load transfer from the height of the centre of gravity; this model has no "
            "load transfer."
        )
    if numbers.mu is not None and numbers.front.pacejka is None:
        result.append(
            "The ForzaETH race stack has only linear and Pacejka tyres: its file holds the slope of these tyres at "
            "zero slip."
        )
    result.append(
        "The tyres of f1tenth_gym are linear: its file holds their stiffness at small slip, which mu multiplies."
    )
    unknown = [line.key for line in _gym(subject, numbers) if line.value is None]
    if unknown:
        result.append(f"Not known for this vehicle, to be filled in for f1tenth_gym: {', '.join(unknown)}.")
    borrowed = [line.key for line in _gym(subject, numbers) if line.about.endswith(_BORROWED)]
    if borrowed:
        result.append(
            f"Not known for this vehicle, so the values of f1tenth_gym's 1:10 car are used: {', '.join(borrowed)}."
        )
    return result


_BORROWED = "value of f1tenth_gym's 1:10 car; not known for this vehicle"


def _gym(subject: Subject, numbers: SingleTrack) -> list[Line]:
    mu = 1.0 if numbers.mu is None else numbers.mu
    known = _limits(subject) | {"h": numbers.h_cg}
    small = LIKE_THE_GYMS[0] <= numbers.l_f + numbers.l_r <= LIKE_THE_GYMS[1]

    def limit(key: str, about: str, sign: float = 1.0, of: str = "") -> Line:
        value, other = known.get(of or key), GYM[of or key] if small else None
        if value is not None or other is None:
            return Line(key, None if value is None else sign * value, about)
        return Line(key, sign * other, f"{about}; {_BORROWED}")

    return [
        Line("mu", mu, "friction; 1, since C_S alone describes the linear tyres" if numbers.mu is None else "friction"),
        Line("C_Sf", _stiffness(numbers.front, mu), "1/rad, cornering stiffness divided by mu and load, front"),
        Line("C_Sr", _stiffness(numbers.rear, mu), "1/rad, cornering stiffness divided by mu and load, rear"),
        Line("lf", numbers.l_f, "m, front axle to centre of gravity"),
        Line("lr", numbers.l_r, "m, rear axle to centre of gravity"),
        limit("h", "m, height of the centre of gravity, by which acceleration shifts load"),
        Line("m", numbers.m, "kg"),
        Line("I", numbers.I_z, "kg m^2, yaw inertia"),
        limit("s_min", "rad, steering angle", -1, "s_max"),
        limit("s_max", "rad, steering angle"),
        limit("sv_min", "rad/s, steering rate", -1, "sv_max"),
        limit("sv_max", "rad/s, steering rate"),
        limit("v_switch", "m/s, above which the largest acceleration falls as 1/v"),
        limit("a_max", "m/s^2, largest acceleration"),
        limit("v_min", "m/s, speed"),
        limit("v_max", "m/s, speed"),
        limit("width", "m"),
        limit("length", "m"),
    ]


def _model_file(subject: Subject, numbers: SingleTrack, car: str, tyre: str) -> list[Line]:
    """File for the stack's system identification: models/CAR/CAR_TYRE.txt; a car's name has no underscore there."""
    mu = 1.0 if tyre == "pacejka" or numbers.mu is None else numbers.mu
    axles = {"f": (numbers.front, "front"), "r": (numbers.rear, "rear")}
    tyres = [
        Line(f"C_P{suffix}", axle.pacejka, f"B [1/rad], C, D, E, {where}") if tyre == "pacejka"
        else Line(f"C_S{suffix}", _stiffness(axle, mu), f"1/rad, cornering stiffness divided by mu and load, {where}")
        for suffix, (axle, where) in axles.items()
    ]  # fmt: skip
    return [
        Line("model_name", car, "car name, as in the name of the file"),
        Line("tire_model", tyre, "pacejka or linear"),
        Line("m", numbers.m, "kg"),
        Line("I_z", numbers.I_z, "kg m^2"),
        Line("l_f", numbers.l_f, "m"),
        Line("l_r", numbers.l_r, "m"),
        Line("l_wb", numbers.l_f + numbers.l_r, "m"),
        Line("h_cg", numbers.h_cg, "m, by which acceleration shifts load"),
        Line("mu", mu, "friction, by which the forces below are multiplied"),
        *tyres,
        *_electric(subject),
    ]


def _car_model(subject: Subject, numbers: SingleTrack) -> list[Line]:
    """File for stack_master/config/CAR."""
    limits = _limits(subject)
    return [
        Line("m", numbers.m, "kg"),
        Line("Iz", numbers.I_z, "kg m^2"),
        Line("lf", numbers.l_f, "m"),
        Line("lr", numbers.l_r, "m"),
        Line("wheelbase", numbers.l_f + numbers.l_r, "m"),
        Line("h_cg", numbers.h_cg, "m"),
        Line("v_max", None, "m/s"),
        Line("v_min", None, "m/s"),
        Line("max_steering_angle", limits["s_max"], "rad"),
        Line("max_steering_velocity", limits["sv_max"], "rad/s"),
        *_electric(subject),
    ]


def _tyres(subject: Subject, numbers: SingleTrack) -> list[Line]:
    """File for stack_master/config/CAR/pacejka/FLOOR/default.yaml."""
    front, rear = numbers.front.pacejka or (), numbers.rear.pacejka or ()
    return [
        Line("friction_coeff", 1.0, "by which the forces are multiplied"),
        *(Line(f"{letter}f", value, "front") for letter, value in zip("BCDE", front, strict=True)),
        *(Line(f"{letter}r", value, "rear") for letter, value in zip("BCDE", rear, strict=True)),
        Line("floor", subject.name, "floor on which these tyres were identified"),
    ]


def _electric(subject: Subject) -> list[Line]:
    limits = _limits(subject)
    return [
        Line("tau_steer", limits["tau_steer"], "s, time constant of the steering"),
        Line("a_max", limits["a_max"], "m/s^2"),
        Line("a_min", None, "m/s^2, hardest braking, negative"),
        *(Line(key, None, about) for key, about in SERVO.items()),
    ]


def _limits(subject: Subject) -> dict[str, float | None]:
    """Limits stated in the vehicle file or given by the model's effects; None if unknown or infinite."""
    model = subject.model
    result = {
        "s_max": None if subject.vehicle is None else subject.vehicle.steer_max,
        "sv_max": value_of(model, "steering_rate_limit"),
        "a_max": value_of(model, "motor_saturation"),
        "v_switch": value_of(model, "motor_saturation_v_b"),
        "tau_steer": value_of(model, "steering_lag"),
    }
    return {name: value if value is not None and isfinite(value) else None for name, value in result.items()}


def _stiffness(axle: Axle, mu: float) -> float:
    return axle.C_alpha / (mu * axle.load)


def _lost(subject: Subject, held: Sequence[str]) -> list[str]:
    """Effects, and shifts of tyre curves, that a file cannot contain, with their values."""
    model = subject.model
    shifts = [p.name for p in model.parameters if p.name.startswith(("S_h_", "S_v_")) and float(p.array)]
    names = [*(name for name in model.effects if name not in held), *shifts]
    return [f"{name} {float(model[name].array):.4g} {model[name].unit}".removesuffix(" 1") for name in names]


def _head(subject: Subject, held: Sequence[str]) -> list[str]:
    lost = _lost(subject, held)
    return [
        f"# {one_line(f'{subject.model.about}, from {subject.source}')}; written by greybox-id.",
        *([f"# This file has no entry for {one_line(', '.join(lost))}."] if lost else []),
        "# Lines that begin with # and a key are not known of this vehicle: fill them in.",
    ]


def _text(line: Line) -> str:
    if line.value is None:
        return f"# {line.key}:  # {line.about}"
    if isinstance(line.value, (str, float)):
        return f"{line.key}: {_plain(line.value)}  # {line.about}"
    return f"{line.key}: [{', '.join(map(_plain, line.value))}]  # {line.about}"


def _plain(value: str | float) -> str:
    """A value in YAML notation: a number with an exponent needs a decimal point."""
    if isinstance(value, str):
        return yaml_text(value)
    digits, e, exponent = f"{value:.12g}".partition("e")
    return f"{digits}{'.0' * ('.' not in digits)}{e}{exponent}"
