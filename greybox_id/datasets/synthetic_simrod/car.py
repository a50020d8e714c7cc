"""The SimRod as a virtual vehicle: the numbers of its vehicle file, and what is true of its tyres beyond them."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from ..vehicle_file import vehicle
from ..virtual_vehicle import Forms, VirtualCar

EFFECTS: Mapping[str, float] = MappingProxyType(
    {"load_sensitivity": 0.15, "longitudinal_load_transfer": 1.0, "combined_slip": 1.0}
)
"""What the virtual vehicle has besides its nonlinear tyres: friction falls with load; loads shift along; the drive
takes its share of the rear tyres' friction."""
FORMS = Forms(stiffness="degressive", geometry="each_wheel", wheels="rotating")
"""Each wheel has the slip of where it stands; an outer wheel gains less stiffness than the inner one loses."""
_TOP_SPEED = 20.0
"""m/s: brisk for it."""


def simrod() -> VirtualCar:
    """The SimRod as its vehicle file states it: m 930 kg, I_z 700 kg m^2, l_f 1.175 m, wheelbase 2.346 m."""
    stated = vehicle("simrod")
    values = {name: own.value for name, own in stated.values.items() if own.value is not None}
    return VirtualCar(
        name="synthetic SimRod",
        kind="car",
        parameters=values,
        drive_channel="ax_cmd",
        noise=stated.noise,
        steer_max=stated.steer_max or 0.5,
        top_speed=_TOP_SPEED,
    )
