"""Target `ros2`: a parameter file for a ROS 2 node; SI units, angles in radians, axes of REP-103: x forward, y left."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

from .origin import KeyOrigin
from .ros_parameters import parameter_file, texts
from .subject import Subject

FRAME = "base_link"


def files(subject: Subject) -> Mapping[str, bytes]:
    """`NAME.param.yaml`. Raises `BadInput` for what is no model of motion."""
    about = {
        f"parameters.{p.name}": ", ".join(filter(None, [p.unit, p.about])) for p in subject.equations.model.parameters
    }
    lines = [
        (origin, about.get(origin.key, _ABOUT.get(origin.key.partition(".")[0], ""))) for origin in origins(subject)
    ]
    notes = ["SI units and radians; x forward, y to the left, z up (REP-103), as ISO 8855 has it.",
             "The origin is the centre of gravity, l_r ahead of the rear axle."]  # fmt: skip
    title = f"{subject.model.about}, from {subject.source}"
    return texts({f"{subject.name}.param.yaml": parameter_file(title, lines, notes)})


def origins(subject: Subject) -> list[KeyOrigin]:
    """What is behind each key."""
    file, model = f"{subject.name}.param.yaml", subject.equations.model
    known = subject.described()["parameters"]
    result = [
        KeyOrigin(file, "model", model.name, behind="the model"),
        KeyOrigin(file, "frame_id", FRAME, why="REP-103 and REP-105"),
    ]
    for p in model.parameters:
        result.append(KeyOrigin(file, f"parameters.{p.name}", float(p.array), behind=p.name))
    for p in model.parameters:
        interval = known[p.name]["interval"]
        if interval is not None and all(map(isfinite, interval)):
            result.append(KeyOrigin(file, f"intervals.{p.name}", [float(item) for item in interval], behind=p.name))
    if subject.vehicle is not None and subject.vehicle.steer_max is not None:
        result.append(KeyOrigin(file, "steer_max", subject.vehicle.steer_max, behind="steer_max"))
    return result


_ABOUT = {"intervals": "95 % interval", "steer_max": "rad, largest road-wheel angle"}
