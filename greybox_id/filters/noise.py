"""Where the sizes of noises start from, before they are tuned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..base.errors import BadInput, near_or_all
from ..base.shorthands import Array
from ..base.signals import unit_of
from ..base.statistics import white_noise_sd
from ..datasets.recording import Recording
from .state_space import StateSpace

PER_ROOT_SECOND = 0.1
"""A state walks by this share of its scale in the root of a second, and what is tracked by this share of its sd."""
FORCE_WALK = 1.0
"""The same for what takes the place of an input or a quantity of the equations: it may change within a second."""
MEMORY = 5.0
"""How long a disturbance lasts, s."""
COLOUR_MEMORY = 1.0
LEAST = 1e-3
"""Noise of a reading that never moves."""
STEPPED, SURE = 0.2, 0.2
"""A reading of which fewer than this share of rows differ goes in steps; share of the scatter between neighbouring rows
that is noise at least."""


@dataclass(frozen=True)
class NoiseLevels:
    """Sizes of a state space's noises.

    Attributes
    ----------
    values : (noises,) in their order.
    open : names of those that nobody stated and readings tell.
    """

    values: Array
    open: tuple[str, ...]


def start_levels(
    space: StateSpace, scatter: Mapping[str, float], read: Sequence[str], stated: Mapping[str, float]
) -> NoiseLevels:
    """Sizes to start from: as stated, else as readings scatter, else usual ones.

    Parameters
    ----------
    scatter : reading -> standard deviation of its noise, as far as a recording tells it (`scatter_of`).
    read : readings that are taken.
    stated : name of a noise -> its size.

    Raises
    ------
    BadInput : a stated name is none of the noises, or its size is not above zero.
    """
    for name, size in stated.items():
        if name not in space.noises:
            raise BadInput(f"There is no noise {name}.{near_or_all(name, space.noises)}")
        if not 0 < size < np.inf:
            raise BadInput(f"The noise {name} = {size:g} is no number above zero.")
    sizes = {name: stated.get(name, _usual(space, name, scatter)) for name in space.noises}
    unread = {f"noise_{name}" for name in space.model.outputs if name not in read}
    return NoiseLevels(
        np.array([sizes[name] for name in space.noises]),
        tuple(name for name in space.noises if name not in stated and name not in unread),
    )


def origins(space: StateSpace, stated: Mapping[str, float], tuned: Sequence[str]) -> dict[str, str]:
    """Noise -> where its size is from: stated, tuned or guessed."""
    return {name: "stated" if name in stated else "tuned" if name in tuned else "guessed" for name in space.noises}


def units(space: StateSpace) -> dict[str, str]:
    """Noise -> SI unit of its size; of what walks that is per root second, and none where it walks in shares."""
    known = {item.name: "1" if item.logarithmic else item.unit for item in space.tracked}
    known = {state.name: state.unit for state in space.model.states} | known
    result = {}
    for name in space.noises:
        kind, _, of = name.partition("_")
        result[name] = "s" if kind == "memory" else known.get(of, unit_of(of)) if kind == "walk" else unit_of(of)
    return result


def scatter_of(recording: Recording, read: Sequence[str]) -> dict[str, float]:
    """Standard deviations of readings' noise: how far each departs from the straight line between its neighbours."""
    return {name: _scatter(recording[name]) for name in read}


def resolution_of(recording: Recording, read: Sequence[str]) -> dict[str, float]:
    """The least noise, standard deviation, that each reading can have as a recording holds it.

    A reading is rounded to its step, which alone scatters by a step over the root of twelve; and noise that
    neighbouring rows show (`scatter_of`) is there, unless the vehicle itself moves so fast: a fifth of it is taken to
    be noise.
    """
    result = {}
    for name, scatter in scatter_of(recording, read).items():
        values = np.unique(recording[name][np.isfinite(recording[name])])
        steps = np.diff(values)
        steps = steps[steps > 1e-9 * max(float(np.ptp(values)), 1e-300)] if len(values) > 1 else steps
        coarse = len(values) < STEPPED * len(recording) and len(steps) > 0
        step = float(np.median(steps)) if coarse else 0.0
        result[name] = max(step / np.sqrt(12.0), SURE * scatter)
    return result


def _usual(space: StateSpace, name: str, scatter: Mapping[str, float]) -> float:
    kind, _, of = name.partition("_")
    if kind == "noise":
        return scatter.get(of, 1.0)
    if kind == "colour":
        return 0.3 * scatter.get(of, 1.0)
    value = next((one for one in space.tracked if one.name == of), None)
    if kind == "memory":
        return MEMORY if value is not None else COLOUR_MEMORY
    if value is None:
        return PER_ROOT_SECOND * next(state.scale for state in space.model.states if state.name == of)
    replaces = of in space.model.inputs or of in space.model.quantities
    return (FORCE_WALK if replaces and not value.logarithmic else PER_ROOT_SECOND) * value.start_sd


def _scatter(values: Array) -> float:
    values = np.where(np.isfinite(values), values, np.nan)
    result = white_noise_sd([values], held=True)
    return LEAST if np.isnan(result) else max(result, 1e-6 * max(1.0, float(np.nanstd(values))))
