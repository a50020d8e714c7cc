"""Columns whose names say nothing: what they agree with may say what they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..recording import Array, Recording
from ..signals import SIGNALS
from ..units import to_si
from .entry import MapEntry
from .evidence import MARGIN, USUAL, Met, met, misfit, sizes_of

SOUGHT = ("v_x", "yaw_rate", "steer", "a_x", "a_y")
"""Signals that other signals tell, and that most models read or predict."""
ALIKE = 0.85
"""Correlation from which a column may be what it is compared with."""


def strangers(
    known: Recording, unknown: Sequence[MapEntry], numbers: Mapping[str, Array], settled: set[str]
) -> list[MapEntry]:
    """The unknown columns, each as the signal that it agrees best with; those that agree with nothing only if named.

    Parameters
    ----------
    known : the signals that are known, in SI units.
    unknown : columns with a doubtful name, or (signal "") without a telling one.
    numbers : (n,) values of each.
    settled : signals that are decided: no column without a telling name is compared with them.
    """
    speed = sizes_of(known).get("v_x", 0.0)
    found = []
    for entry in unknown:
        sought = (entry.signal,) if entry.signal else tuple(s for s in SOUGHT if s not in settled)
        values = numbers[entry.column]
        matches = [(s, m) for s in sought if len(values) == len(known) for m in _matches(known, s, values)]
        if matches:
            signal, best = max(matches, key=lambda own: abs(own[1].agreed.correlation))
            found.append(_described(entry, signal, best, speed))
        elif entry.signal:
            found.append(entry)
    return found


def _matches(known: Recording, signal: str, values: Array) -> list[Met]:
    if signal not in SOUGHT or not np.isfinite(values).any():
        return []
    agreed = met(known.with_signals(**{signal: values}))
    return [m for m in agreed if signal in m.pair.nodes and abs(m.agreed.correlation) >= ALIKE]


def _described(entry: MapEntry, signal: str, best: Met, speed: float) -> MapEntry:
    left = best.pair.nodes[0] == signal
    why = f"agrees with {best.pair.right if left else best.pair.left} (correlation {best.agreed.correlation:.2f})"
    units = tuple(
        unit
        for unit in USUAL.get(SIGNALS[signal].unit, ())
        if misfit(_in_unit(best, signal, unit), speed=speed) < MARGIN
    ) or (SIGNALS[signal].unit,)
    sign = 1 if best.agreed.correlation > 0 else -1
    name = () if entry.reasons else ("its name says nothing",)
    return replace(entry, signal=signal, sign=sign, units=entry.units or units, reasons=(*name, *entry.reasons, why))


def _in_unit(best: Met, signal: str, unit: str) -> Met:
    """The agreement as it would be with the column in a unit."""
    factor = to_si(unit, SIGNALS[signal].unit).factor
    gain = best.agreed.gain * (factor if best.pair.nodes[0] == signal else 1 / factor)
    return replace(best, agreed=replace(best.agreed, gain=gain))
