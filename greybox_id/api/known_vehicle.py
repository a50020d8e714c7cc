"""A vehicle with its file."""

from __future__ import annotations

from dataclasses import dataclass, fields
from html import escape
from pathlib import Path

from ..base.errors import BadInput
from ..base.numbers import counted, exact, short_with_sd
from ..fitting.choices.parameters import named_vehicle
from ..models.vehicle import Stated, Vehicle
from ..models.vehicle_file import write_vehicle

MOST_SHOWN, IN_A_LINE = 12, 4
"""Values that are shown, and of those in a line."""


@dataclass(frozen=True)
class KnownVehicle(Vehicle):
    """What is stated of a vehicle: values, how well they are known, tolerances, sensor noise; from a file and to it.

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
        """A shipped vehicle by its name, or one's own from a .toml or .json file.

        Raises
        ------
        BadInput : there is no such vehicle, or its file is no valid vehicle file.
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
        """Write a vehicle file, .toml or .json, atomically. Raises `BadInput` where it cannot be written."""
        return write_vehicle(self, path)


def _said(name: str, stated: Stated) -> str:
    if stated.value is None:
        return name
    return f"{name} = {short_with_sd(stated.value, stated.sd) if stated.sd else exact(stated.value, 6)}"
