"""Effects by name, including those of installed packages: `model + gb.effects.steering_delay.free(start=0.03)`.

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
    """Names of all effects, shipped and from installed packages."""
    install()
    return tuple(EFFECTS)


def own(place: str) -> Effect:
    """Your own effect, from a Python file that is executed.

    Parameters
    ----------
    place : FILE.py:NAME, such as "my_effects.py:soft_steering".

    Raises
    ------
    BadInput : if the file fails, lacks the name, or has the name of a shipped effect.
    """
    return own_effect(place)


def __getattr__(name: str) -> Effect:
    """An effect by name."""
    if name.startswith("_"):
        raise AttributeError(name)
    if name not in EFFECTS:
        install()
    if name not in EFFECTS:
        raise AttributeError(f"There is no effect {name!r}.{near_or_all(name, EFFECTS)}")
    return EFFECTS[name]


def __dir__() -> list[str]:
    return sorted((*__all__, *names()))
