"""Target `opendbc`: a Python snippet with the values that a port of a car to opendbc states: CarSpecs and CarParams.

Source: CarParams in opendbc's structs: SI units, stiffness of an axle in N/rad.
"""

from __future__ import annotations

from collections.abc import Mapping

from .c.naming import one_line
from .single_track_numbers import HELD, single_track_of, value_of
from .subject import KeyOrigin, Subject

HOLDS = (*HELD, "steering_delay")


def files(subject: Subject) -> Mapping[str, bytes]:
    """`NAME_opendbc.py`. Raises `BadInput` for a model without tyres."""
    title = one_line(f"{subject.model.about}, from {subject.source}")
    lines = [
        f"# {title}; written by greybox-id.",
        "# For _get_params of the car's interface; keys without a value are not known of this vehicle.",
        "",
        "",
        "def vehicle_params(ret):",
    ]
    for origin in origins(subject):
        note = f"from {origin.behind}" if origin.behind else origin.why
        if origin.value is None:
            lines.append(f"    # ret.{origin.key} = ...  # {note}")
        else:
            lines.append(f"    ret.{origin.key} = {origin.value!r}  # {note}")
    return {_file(subject): "\n".join([*lines, "    return ret", ""]).encode()}


def origins(subject: Subject) -> list[KeyOrigin]:
    """Origin of each key."""
    numbers, file = single_track_of(subject), _file(subject)
    assert not subject.model.name.startswith("msnn")
    delay = value_of(subject.equations.model, "steering_delay") if "steering_delay" in subject.model.effects else None
    tyres = "B, C, D: cornering stiffness at rest" if numbers.front.pacejka else "cornering stiffness at rest"
    return [
        KeyOrigin(file, "mass", numbers.m, "m"),
        KeyOrigin(file, "wheelbase", numbers.l_f + numbers.l_r, "l_f, l_r"),
        KeyOrigin(file, "centerToFront", numbers.l_f, "l_f"),
        KeyOrigin(file, "rotationalInertia", numbers.I_z, "I_z"),
        KeyOrigin(file, "tireStiffnessFront", numbers.front.C_alpha, tyres),
        KeyOrigin(file, "tireStiffnessRear", numbers.rear.C_alpha, tyres),
        KeyOrigin(file, "steerActuatorDelay", delay, "steering_delay")
        if delay is not None
        else KeyOrigin(file, "steerActuatorDelay", None, why="s; the model has no steering_delay"),
        KeyOrigin(
            file,
            "steerRatio",
            None,
            why="ratio of steering-wheel to road-wheel angle; the model's input is the road-wheel angle",
        ),
        KeyOrigin(file, "steerLimitTimer", None, why="s; no parameter or effect gives this value"),
    ]


def cautions(subject: Subject) -> list[str]:
    """Sentences on what the snippet lacks."""
    lost = [name for name in subject.model.effects if name not in HOLDS]
    result = [f"CarParams has no entry for {', '.join(lost)}, which is left out."] if lost else []
    return [*result, "steerRatio is not known: the model's input is the road-wheel angle."]


def _file(subject: Subject) -> str:
    return f"{subject.name}_opendbc.py"
