"""The families of foreign vehicles: which simulator, which effects it can be made to have, and what it serves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...datasets.virtual_vehicle import EFFECTS as VOCABULARY
from ...datasets.virtual_vehicle.compiled import Row
from ...errors import BadInput
from ..plan import Counts, Planned, dealt
from .double_track import DoubleTrack
from .effects import NOT_OF_SLIPX, OF_SENSORS, OUTSIDE
from .slipx_car import SlipxCar
from .vehicles import Draw, Reality, drawn_double_track, drawn_slipx

Build = Callable[[Mapping[str, float], Row], Reality]


@dataclass(frozen=True)
class Family:
    """A family of foreign vehicles.

    Attributes
    ----------
    draw : a vehicle of it.
    build : numbers, and gusts of unit variance -> the simulator with that vehicle in it.
    effects, outside : that it can be made to have.
    """

    draw: Draw
    build: Build
    effects: tuple[str, ...]
    outside: tuple[str, ...]


def _double_track(tyre: int, name: str) -> Family:
    return Family(drawn_double_track(tyre, name), DoubleTrack, tuple(VOCABULARY), tuple(OUTSIDE))


_SLIPX = Family(
    drawn_slipx,
    lambda numbers, _: SlipxCar(numbers),
    tuple(name for name in VOCABULARY if name not in NOT_OF_SLIPX),
    tuple(name for name in OUTSIDE if name in OF_SENSORS or name in ("locked_axle", "sinking_voltage")),
)

FAMILIES: Mapping[str, Family] = {
    "fiala": _double_track(0, "fiala"),
    "exponential": _double_track(1, "exponential"),
    "tmeasy": _double_track(2, "tmeasy"),
    "rational": _double_track(3, "rational"),
    "dugoff": _double_track(4, "dugoff"),
    "slipx": _SLIPX,
}
"""Every family; the double tracks go by the shape of their tyres."""
DEVELOPMENT = ("fiala", "exponential")
"""Families that thresholds may be calibrated on."""
EXAMINATION = ("tmeasy", "rational", "dugoff", "slipx")
"""Families that examine, and nothing else."""
SETS: Mapping[str, tuple[str, ...]] = {"development": DEVELOPMENT, "examination": EXAMINATION}


def families(wanted: Sequence[str]) -> tuple[str, ...]:
    """Names of families, sets of them spelt out.

    Raises
    ------
    BadInput : there is no such family.
    """
    found: dict[str, None] = {}
    for name in wanted or ("examination",):
        if name not in FAMILIES and name not in SETS:
            raise BadInput(f'There is no family "{name}"; there are {", ".join((*SETS, *FAMILIES))}.')
        found |= dict.fromkeys(SETS.get(name, (name,)))
    return tuple(found)


def able(names: Sequence[str], effects: Sequence[str]) -> tuple[str, ...]:
    """Those of some families that can be made to have all of these effects."""
    return tuple(own for own in names if set(effects) <= {*FAMILIES[own].effects, *FAMILIES[own].outside})


def gusts(rows: int, seed: int) -> Row:
    """Gusts of unit variance, one each 20 ms, that change within a second; (rows,)."""
    rng, keeps = np.random.default_rng((seed, 7, 4099)), np.exp(-0.02 / 0.8)
    shocks, values = rng.standard_normal(rows), np.zeros(rows)
    for k in range(1, rows):
        values[k] = keeps * values[k - 1] + np.sqrt(1.0 - keeps**2) * shocks[k]
    return values


def dealt_out(counts: Counts, seed: int, wanted: Sequence[str]) -> tuple[Planned, ...]:
    """Cases of an examination on foreign vehicles, each of a family that can be made to have its effects."""
    names = families(wanted)
    known = [set(FAMILIES[own].effects) for own in names]
    other = [set(FAMILIES[own].outside) for own in names]
    whole = any(own == set.union(*known) for own in known)
    effects = set.union(*known) if whole else set.intersection(*known)
    beyond = set.union(*other)
    cases = dealt(counts, "foreign", seed, [n for n in VOCABULARY if n in effects], [n for n in OUTSIDE if n in beyond])
    rng = np.random.default_rng((seed, 51151))
    return tuple(replace(own, family=str(rng.choice(able(names, own.effects)))) for own in cases)
