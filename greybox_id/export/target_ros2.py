"""Target `ros2`: a parameter file for a ROS 2 node; SI units, angles in radians, axes of REP-103: x forward, y left.

Parameter files of ROS 2 nodes have keys under /**: ros__parameters, each with its origin as a comment.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import isfinite

from .c.naming import one_line, yaml_text
from .subject import KeyOrigin, Subject

Value = float | str | bool | Sequence[float]


def number_text(value: float) -> str:
    """A number in YAML notation, exactly: with an exponent it needs a decimal point."""
    text = repr(float(value)).replace("inf", ".inf").replace("nan", ".nan")
    digits, e, exponent = text.partition("e")
    return f"{digits}{'.0' * (bool(e) and '.' not in digits)}{e}{exponent}"


def value_text(value: Value) -> str:
    """A value in YAML notation."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return yaml_text(value)
    if isinstance(value, int):  # ROS distinguishes integers from other numbers
        return str(value)
    if isinstance(value, float):
        return number_text(value)
    return f"[{', '.join(map(number_text, value))}]"


def parameter_file(title: str, lines: Iterable[tuple[KeyOrigin, str]], notes: Sequence[str] = ()) -> str:
    """The file's text; `lines` are entries and their meaning.

    A key with dots is in nested tables. Entries without a value are written as comments, to be filled in.
    """
    head = [f"# {one_line(title)}; written by greybox-id.", *(f"# {one_line(note)}" for note in notes)]
    body, open_tables = ["/**:", "  ros__parameters:"], list[str]()
    for item, about in lines:
        *tables, key = item.key.split(".")
        shared = 0
        while shared < min(len(tables), len(open_tables)) and tables[shared] == open_tables[shared]:
            shared += 1
        for depth in range(shared, len(tables)):
            body.append(f"{'  ' * (depth + 2)}{tables[depth]}:")
        open_tables = tables
        indent = "  " * (len(tables) + 2)
        behind = f"from {item.behind}" if item.behind else f"default: {item.why}"
        note = one_line("; ".join(filter(None, [about, behind])))
        if item.value is None:
            body.append(f"{indent}# {key}:  # {note}")
        else:
            body.append(f"{indent}{key}: {value_text(item.value)}  # {note}")
    return "\n".join([*head, *body, ""])


def texts(files: Mapping[str, str]) -> dict[str, bytes]:
    """Contents of files as bytes."""
    return {name: text.encode() for name, text in files.items()}


FRAME = "base_link"


def files(subject: Subject) -> Mapping[str, bytes]:
    """`NAME.param.yaml`. Raises `BadInput` for models other than motion models."""
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
    """Origin of each key."""
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
