"""Which input of a file is which signal: as said, by name, or as only one assignment makes a model of the family."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import permutations

from greybox_id.base.errors import BadInput

from .network import Network

SPELLINGS: dict[str, tuple[str, ...]] = {
    "v_x": ("vx", "v", "vel", "velocity", "speed", "vlong", "ux"),
    "steer": ("steer", "steering", "steeringangle", "delta"),
    "a_x": ("ax", "acc", "accx", "along", "acceleration"),
    "a_y": ("ay", "accy", "alat"),
    "motor_current": ("motorcurrent", "current", "crt"),
}
"""Signal -> what its input is called, in small letters and without underscores."""


def assignments(
    network: Network, output: str, signals: Sequence[str], needed: Sequence[str], one: Mapping[str, str]
) -> Iterator[dict[str, str]]:
    """Ways to give the inputs that an output follows from a signal each; one where all are said or known by name.

    Parameters
    ----------
    signals, needed : what the model takes, and what it cannot do without.
    one : input -> signal, as the user said.

    Raises
    ------
    BadInput : what is said does not suit the model, or two inputs are one signal.
    """
    used = [name for name in network.order(output) if name in network.inputs]
    for name in used:
        if one.get(name, signals[0]) not in signals:
            raise network.wrong(f"input {name} is said to be {one[name]}; {output} is made of {', '.join(signals)}.")
    named = {name: one.get(name) or by_name(name) for name in used}
    known = {name: signal for name, signal in named.items() if signal is not None and signal in signals}
    if len(set(known.values())) < len(known) or len(used) > len(signals):
        raise network.wrong(
            f"output {output} follows from {', '.join(used)[:200]}; a model here takes one input each for "
            f"{', '.join(signals)}. Say which is which with ‹inputs›."
        )
    unknown = [name for name in used if name not in known]
    open_ = [signal for signal in signals if signal not in known.values()]
    for chosen in permutations(open_, len(unknown)):
        roles = known | dict(zip(unknown, chosen, strict=True))
        if set(needed) <= set(roles.values()):
            yield roles


def by_name(name: str) -> str | None:
    """The signal that an input's name stands for."""
    plain = name.lower().replace("_", "").replace(".", "")
    return next((signal for signal, words in SPELLINGS.items() if plain in words), None)


def roles_of(pairs: Sequence[str], network: Network) -> dict[str, str]:
    """Input -> signal from SIGNAL=INPUT pairs. Raises `BadInput` where either is unknown."""
    result: dict[str, str] = {}
    for pair in pairs:
        signal, equals, name = pair.partition("=")
        if not equals or signal not in SPELLINGS:
            raise BadInput(f"‹inputs› {pair}: write SIGNAL=INPUT, where SIGNAL is one of {', '.join(SPELLINGS)}.")
        if name not in network.inputs:
            raise network.wrong(f"there is no input {name}; there are {', '.join(network.inputs)[:200]} (‹inputs›).")
        if result.setdefault(name, signal) != signal:
            raise BadInput(f"‹inputs› says that {name} is both {result[name]} and {signal}.")
    return result
