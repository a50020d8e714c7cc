"""Effects by name: `model + gb.effects.steering_delay.free(start=0.03)`; those of installed packages among them.

Examples
--------
>>> import greybox_id as gb
>>> gb.effects.steering_lag.at(0.05)
Effect steering_lag: first-order time constant of the steering [s], nothing changes at 0; here 0.05 (fixed)
>>> "steering_lag" in gb.effects.names()
True
"""

from __future__ import annotations

from ..base.errors import near_or_all
from ..models.effect import Effect
from ..models.effects import EFFECTS
from ..models.effects.stating import alteration
from ..models.registry import install, own_effect

__all__ = ["Effect", "alteration", "names", "own"]


def names() -> tuple[str, ...]:
    """Names of all effects: those shipped, and those of installed packages."""
    install()
    return tuple(EFFECTS)


def own(place: str) -> Effect:
    """An effect of one's own from a file, which is run.

    Parameters
    ----------
    place : FILE.py:NAME, as in "my_effects.py:soft_steering".

    Raises
    ------
    BadInput : the file does not run, has no such name, or names itself like a shipped effect.
    """
    return own_effect(place)


def __getattr__(name: str) -> Effect:
    """An effect by its name."""
    if name.startswith("_"):
        raise AttributeError(name)
    if name not in EFFECTS:
        install()
    if name not in EFFECTS:
        raise AttributeError(f"There is no effect {name!r}.{near_or_all(name, EFFECTS)}")
    return EFFECTS[name]


def __dir__() -> list[str]:
    return sorted((*__all__, *names()))
