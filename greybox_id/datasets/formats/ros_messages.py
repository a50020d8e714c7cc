"""What ROS messages hold: definitions that come with us, numbers by dotted path, their units, angles of quaternions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...recording import Array

SHIPPED = {
    "ackermann_msgs": ("AckermannDrive", "AckermannDriveStamped"),
    "vesc_msgs": ("VescState", "VescStateStamped"),
}
"""Package -> messages whose definitions lie in `messages/`."""
SAME = {"vesc_interfaces": "vesc_msgs"}
"""Packages that call the same messages their own."""
LONGEST_ARRAY = 16
"""Longer arrays are maps, images and covariances, not signals."""
UNITS = {
    "linear_acceleration": "m/s^2", "angular_velocity": "rad/s", "twist.linear": "m/s", "twist.angular": "rad/s",
    "accel.linear": "m/s^2", "accel.angular": "rad/s^2", "linear": "m/s", "angular": "rad/s", "position": "m",
    "steering_angle": "rad", "drive.speed": "m/s", "drive.acceleration": "m/s^2", "state.speed": "rpm",
    "current_motor": "A", "current_input": "A", "voltage_input": "V", "latitude": "deg", "longitude": "deg",
    "roll": "rad", "pitch": "rad", "yaw": "rad", "time": "s",
}  # fmt: skip
"""Units by the last parts of a path, as REP 103 and the definitions say."""


def shipped_types(parse: Callable[[str, str], Mapping[str, Any]]) -> dict[str, Any]:
    """Definitions of messages that are common on small cars and in no typestore, parsed."""
    found: dict[str, Any] = {}
    folder = resources.files(__package__).joinpath("messages")
    for package, origin in [(own, own) for own in SHIPPED] + list(SAME.items()):
        for message in SHIPPED[origin]:
            found.update(parse(folder.joinpath(f"{message}.msg").read_text("utf-8"), f"{package}/msg/{message}"))
    return found


def unit_of_path(path: str) -> str:
    """Unit of a field; empty where its path does not tell."""
    parts = path.split(".")
    tails = {".".join(parts[first:last]) for last in (len(parts), len(parts) - 1) for first in range(last)}
    return next((unit for tail, unit in UNITS.items() if tail in tails), "")


@dataclass(frozen=True)
class Field:
    """One number in a message.

    Attributes
    ----------
    path : attributes from the message to it.
    index : place in an array; None for a number that stands alone.
    angle : "roll", "pitch" or "yaw" of the quaternion at `path`; empty for what the message holds itself.
    """

    path: str
    index: int | None = None
    angle: str = ""

    @property
    def name(self) -> str:
        """The dotted name that a column map uses."""
        last = self.angle or ("" if self.index is None else str(self.index))
        return ".".join(filter(None, (self.path, last)))

    def column(self, messages: list[Any]) -> NDArray[Any]:
        """(n,) its values in all messages."""
        if self.angle:
            w, x, y, z = (np.array([attrgetter(f"{self.path}.{c}")(m) for m in messages], dtype=float) for c in "wxyz")
            return _angle(self.angle, w, x, y, z)
        found = [attrgetter(self.path)(message) for message in messages]
        if self.index is None:
            return np.asarray(found, dtype=float if isinstance(found[0], float) else None) * 1
        return np.array([float(v[self.index]) if self.index < len(v) else np.nan for v in found])


def fields_of(message: Any, path: str = "") -> Iterator[Field]:
    """All numbers in a message but its header's, in its order; of quaternions the angles as well."""
    names = [
        name for name in getattr(message, "__dataclass_fields__", {}) if not name.startswith("__") and name != "header"
    ]
    if {"x", "y", "z", "w"} == set(names) and path:
        yield from (Field(path, angle=angle) for angle in ("roll", "pitch", "yaw"))
    for name in names:
        value, own = getattr(message, name), f"{path}.{name}" if path else name
        if isinstance(value, (bool, int, float, np.number)):
            yield Field(own)
        elif isinstance(value, np.ndarray):
            yield from (Field(own, k) for k in range(len(value)) if len(value) <= LONGEST_ARRAY)
        elif hasattr(value, "__dataclass_fields__"):
            yield from fields_of(value, own)


def _angle(which: str, w: Array, x: Array, y: Array, z: Array) -> Array:
    """Roll, pitch, yaw (rad) of turns about z, y, x in that order; Diebel, "Representing attitude", 2006, eq. 290."""
    if which == "roll":
        return np.arctan2(2 * (w * x + y * z), 1 - 2 * (x**2 + y**2))
    if which == "pitch":
        return np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2))
