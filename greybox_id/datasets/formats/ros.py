"""ROS bags and MCAP files: every topic is a group with its own clock; numbers are columns by dotted path.

A topic's clock is the stamp in its messages' headers. Without stamps, or if these have another epoch, it is the time at
which the bag received the messages. Both are counts of nanoseconds since 1970.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import resources
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ...base.errors import BadInput
from ...base.files import scratch_folder
from ...base.shorthands import Array
from ..column_map import ColumnMap
from ..raw_table import RawTable
from . import TIME, Columns, Contents, Group, needed, sound

SHIPPED = {
    "ackermann_msgs": ("AckermannDrive", "AckermannDriveStamped"),
    "vesc_msgs": ("VescState", "VescStateStamped"),
}
"""Package -> messages whose definitions are in `messages/`."""
SAME = {"vesc_interfaces": "vesc_msgs"}
"""Packages that define the same messages under their own name."""
LONGEST_ARRAY = 16
"""Largest length of an array of signals; longer ones are maps, images or covariances."""
UNITS = {
    "linear_acceleration": "m/s^2", "angular_velocity": "rad/s", "twist.linear": "m/s", "twist.angular": "rad/s",
    "accel.linear": "m/s^2", "accel.angular": "rad/s^2", "linear": "m/s", "angular": "rad/s", "position": "m",
    "steering_angle": "rad", "drive.speed": "m/s", "drive.acceleration": "m/s^2", "state.speed": "rpm",
    "current_motor": "A", "current_input": "A", "voltage_input": "V", "latitude": "deg", "longitude": "deg",
    "roll": "rad", "pitch": "rad", "yaw": "rad", "time": "s",
}  # fmt: skip
"""Last parts of a path -> unit, by REP 103 and the message definitions."""


def shipped_types(parse: Callable[[str, str], Mapping[str, Any]]) -> dict[str, Any]:
    """Parsed definitions of messages that are common on small cars but missing in the typestores."""
    result: dict[str, Any] = {}
    folder = resources.files(__package__).joinpath("messages")
    for package, origin in [(item, item) for item in SHIPPED] + list(SAME.items()):
        for message in SHIPPED[origin]:
            result.update(parse(folder.joinpath(f"{message}.msg").read_text("utf-8"), f"{package}/msg/{message}"))
    return result


def unit_of_path(path: str) -> str:
    """Unit of a field, by its path; empty if unknown."""
    parts = path.split(".")
    tails = {".".join(parts[first:last]) for last in (len(parts), len(parts) - 1) for first in range(last)}
    return next((unit for tail, unit in UNITS.items() if tail in tails), "")


@dataclass(frozen=True)
class Field:
    """One number in a message.

    Attributes
    ----------
    path : attribute path within the message.
    index : index in an array; None for a scalar.
    angle : "roll", "pitch" or "yaw" of the quaternion at `path`; empty for a number stored in the message.
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
        """(n,) the field's values in all messages."""
        if self.angle:
            w, x, y, z = (np.array([attrgetter(f"{self.path}.{c}")(m) for m in messages], dtype=float) for c in "wxyz")
            return _angle(self.angle, w, x, y, z)
        result = [attrgetter(self.path)(message) for message in messages]
        if self.index is None:
            return np.asarray(result, dtype=float if isinstance(result[0], float) else None) * 1
        return np.array([float(v[self.index]) if self.index < len(v) else np.nan for v in result])


def fields_of(message: Any, path: str = "") -> Iterator[Field]:
    """All numbers in a message except its header, in order; for quaternions the angles as well."""
    names = [
        name for name in getattr(message, "__dataclass_fields__", {}) if not name.startswith("__") and name != "header"
    ]
    if {"x", "y", "z", "w"} == set(names) and path:
        yield from (Field(path, angle=angle) for angle in ("roll", "pitch", "yaw"))
    for name in names:
        value, place = getattr(message, name), f"{path}.{name}" if path else name
        if isinstance(value, (bool, int, float, np.number)):
            yield Field(place)
        elif isinstance(value, np.ndarray):
            yield from (Field(place, k) for k in range(len(value)) if len(value) <= LONGEST_ARRAY)
        elif hasattr(value, "__dataclass_fields__"):
            yield from fields_of(value, place)


def _angle(which: str, w: Array, x: Array, y: Array, z: Array) -> Array:
    """Roll, pitch, yaw (rad), rotations about z, y, x in this order; Diebel, "Representing attitude", 2006, eq. 290."""
    if which == "roll":
        return np.arctan2(2 * (w * x + y * z), 1 - 2 * (x**2 + y**2))
    if which == "pitch":
        return np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2))


KIND = "ROS bag"
TOPIC = "/recording"
MESSAGE = "greybox_msgs/msg/Recording"
SAME_EPOCH = 10.0
"""Difference from the time of receipt, s, beyond which stamps have another epoch."""
LONGEST = 2**24
"""Number of elements of a sequence beyond which a message is considered damaged."""


def contents(file: Path, _: ColumnMap) -> Contents:
    """Topics with numeric messages: sqlite3 or MCAP, a file or a folder; also bags of ROS 1.

    Raises
    ------
    BadInput
        rosbags is not installed, or the bag is damaged.
    """
    bag = _Bag(file)
    with bag.opened() as (reader, decode):
        topics: dict[str, list[Any]] = {}
        for connection in reader.connections:
            topics.setdefault(connection.topic, []).append(connection)
        result = [bag.group(topic, item, reader, decode) for topic, item in topics.items()]
    groups = tuple(group for group in result if isinstance(group, Group))
    strange = tuple(note for note in result if isinstance(note, str) and note)
    if not groups:
        raise BadInput(f"{file}: no topic of this bag holds numbers. {' '.join(strange)}".strip())
    return Contents(str(file), groups, KIND, strange)


class _Bag:
    """A bag on disk: reopened for every topic, its types parsed once."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.old = file.suffix == ".bag"
        self.store: Any = None

    @contextmanager
    def opened(self) -> Iterator[tuple[Any, Callable[[bytes, str], Any]]]:
        """The bag's reader, and the function that decodes bytes of a type into a message."""
        needed("rosbags", "ros", str(self.file), "ROS bags")
        from rosbags import rosbag1, rosbag2

        with sound(str(self.file), KIND), (rosbag1.Reader if self.old else rosbag2.Reader)(self.file) as reader:
            self.store = self.store or self._types(reader)
            yield reader, self.store.deserialize_ros1 if self.old else self.store.deserialize_cdr

    def _types(self, reader: Any) -> Any:
        """All message definitions: the bag's own take precedence over shipped ones."""
        from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

        store = get_typestore(Stores.ROS1_NOETIC if self.old else Stores.ROS2_HUMBLE)
        store.max_sequence_length = LONGEST
        types = shipped_types(get_types_from_msg)
        for definition, name in {(connection.msgdef, connection.msgtype) for connection in reader.connections}:
            if not definition.data.strip():
                continue
            if definition.format.name == "MSG":
                types.update(get_types_from_msg(definition.data, name))
            elif definition.format.name == "IDL":
                for part in re.split(r"={80}\nIDL: .*\n", definition.data):
                    types.update(get_types_from_idl(part) if part.strip() else {})
        for name in types:
            store.fielddefs.pop(name, None)
            store.types.pop(name, None)
        store.register(types)
        return store

    def group(
        self, topic: str, connections: Sequence[Any], reader: Any, decode: Callable[[bytes, str], Any]
    ) -> Group | str:
        """A topic's columns, by its first message; a sentence if it cannot be read; empty if it has no numbers."""
        kind = connections[0].msgtype
        first = next(reader.messages(connections=connections), None)
        if first is None:
            return ""
        try:
            fields = {field.name: field for field in fields_of(decode(first[2], kind))}
        except Exception as error:  # an unknown type or damaged bytes: other topics may be sound
            return f"{topic}: messages of type {kind} cannot be read ({next(iter(str(error).splitlines()), kind):.80})."
        if not fields:
            return ""
        prefix = f"{topic}."
        units = {prefix + name: unit_of_path(name) for name in fields}

        def load(target: Sequence[str]) -> RawTable:
            chosen = [field for name, field in fields.items() if prefix + name in target]
            stamps, messages = self.messages(topic)
            columns = [pd.Series(field.column(messages)) for field in chosen]
            names = [prefix + field.name for field in chosen]
            if prefix + TIME not in names:
                names, columns = [*names, prefix + TIME], [*columns, pd.Series(stamps)]
            return RawTable(str(self.file), tuple(names), tuple(columns), 1)

        value = TIME in fields
        names = tuple(prefix + name for name in (*fields, *(() if value else (TIME,))))
        return Group(
            topic, names, load, prefix, prefix + TIME, "s" if value else "ns", {n: u for n, u in units.items() if u}
        )

    def messages(self, topic: str) -> tuple[NDArray[np.int64], list[Any]]:
        """All messages of a topic with their times, in ns since 1970."""
        received, messages = [], []
        with self.opened() as (reader, decode), sound(str(self.file), KIND):
            value = [connection for connection in reader.connections if connection.topic == topic]
            for connection, when, data in reader.messages(connections=value):
                received.append(when)
                messages.append(decode(data, connection.msgtype))
        stamped = [getattr(getattr(message, "header", None), "stamp", None) for message in messages]
        arrived = np.array(received, dtype=np.int64)
        if all(stamp is not None for stamp in stamped):
            sent = np.array([stamp.sec * 10**9 + stamp.nanosec for stamp in stamped if stamp], dtype=np.int64)
            if abs(float(np.median(sent - arrived))) < SAME_EPOCH * 1e9:
                return sent, messages
        return arrived, messages


def write(columns: Columns, path: Path) -> None:
    """Write columns as messages on one topic of an MCAP file, which includes the message's definition.

    Raises
    ------
    BadInput
        A column's name is not a valid ROS field name, or rosbags is not installed.
    """
    needed("rosbags", "ros", str(path), "ROS bags")
    from rosbags import rosbag2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    for name in columns.values:
        if not re.fullmatch(r"[a-zA-Z]\w*", name, re.ASCII):
            raise BadInput(
                f'{path}: ROS messages cannot hold a field named "{name}"; rename it in the column map, or write .h5.'
            )
    kinds = {name: "int64" if values.dtype.kind in "iu" else "float64" for name, values in columns.values.items()}
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg("".join(f"{kind} {name}\n" for name, kind in kinds.items()), MESSAGE))
    row = store.types[MESSAGE]
    lists = [values.tolist() for values in columns.values.values()]
    with scratch_folder(path.parent) as folder:
        bag = folder / "bag"
        with rosbag2.Writer(bag, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
            connection = writer.add_connection(TOPIC, MESSAGE, typestore=store)
            times = np.round(columns.steady * 1e9).astype(np.int64).tolist()
            for when, *values in zip(times, *lists, strict=True):
                writer.write(connection, when, store.serialize_cdr(row(*values), MESSAGE))
        (bag / "bag.mcap").replace(path)
