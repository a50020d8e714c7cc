"""The verdict on a track: whether its innovations are what the filter said of them.

A filter states how far readings may lie from what it expects. Where they lie further, or hang together, the model or
its noise is wrong and bands are too narrow; where they lie much closer, bands are too wide. Rules as in Bar-Shalom, Li
& Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, Sec. 5.4; sizes are those from which bands
are wrong by half or more.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..fitting.verdict import NOT_USABLE, USABLE, WITH_CARE, Reason, Verdict, weighed
from .findings import LOST, Consistency, window_rows, windowed
from .track import Track

NARROW, WIDE = 2.25, 0.45
"""Mean NIS (1 is due) from which standard deviations are 1.5 times too small, and 1.5 times too large."""
INSIDE = 0.5
"""Share of windows within their 95 % bounds below which the noise is not what the filter takes it for."""
TOGETHER = 0.5
"""Correlation of each innovation with the next from which they are no noise: (1 + c) / (1 - c) is 3 then."""
MOSTLY_LOST = 0.5
"""Share of the windows in which a channel is lost, from which nothing is tracked."""


def verdict(found: Track) -> Verdict:
    """Whether a track can be used, and why."""
    reasons = [reason for name, own in found.consistency.items() for reason in _channel(found, name, own)]
    checked = [own for own in found.sentences if own.startswith("Data check:")]
    reasons += [Reason(WITH_CARE, own) for own in checked]
    if not found.consistency:
        reasons.append(Reason(NOT_USABLE, "No reading was taken: nothing is tracked."))
    words = "The innovations are what the filter expects: NIS {} (1 is due)."
    listed = ", ".join(f"{own.nis:.2g} of {name}" for name, own in found.consistency.items() if np.isfinite(own.nis))
    return weighed([*reasons, Reason(USABLE, words.format(listed))], {})


def _channel(found: Track, name: str, own: Consistency) -> Iterator[Reason]:
    share = _lost(found, name)
    if share > MOSTLY_LOST:
        yield Reason(
            NOT_USABLE,
            f"{name} lies far from what the filter expects for {100 * share:.0f} % of the time: the filter has lost "
            "the vehicle. Check units and signs with greybox data check, and the vehicle's numbers.",
        )
    elif own.nis > NARROW:
        yield Reason(
            WITH_CARE,
            f"{name}: innovations scatter {np.sqrt(own.nis):.2g} times as far as expected (NIS {own.nis:.2g}): "
            f"bands were widened {found.widened:.2g} times. State its noise, or fit the vehicle first.",
        )
    elif own.nis < WIDE:
        yield Reason(
            WITH_CARE,
            f"{name}: innovations scatter {np.sqrt(own.nis):.2g} times as far as expected (NIS {own.nis:.2g}): "
            f"its noise is overstated and bands are too wide. State noise_{name}, or tune it (‹tune›).",
        )
    elif own.inside < INSIDE:
        yield Reason(
            WITH_CARE,
            f"{name}: only {100 * own.inside:.0f} % of the windows lie within their 95 % bounds: its noise varies.",
        )
    if own.correlation > max(TOGETHER, own.correlation_bound):
        yield Reason(
            WITH_CARE,
            f"{name}: innovations hang together (correlation {own.correlation:.2f} with the next): the model lacks "
            "something and bands are too narrow. greybox gap looks for it; ‹coloured› lets a reading err slowly.",
        )


def _lost(found: Track, name: str) -> float:
    """Share of windows in which a channel's innovations are far beyond what is expected."""
    off, sd = found.innovations.get(name), found.expected.get(name)
    if off is None or sd is None:
        return 0.0
    squares = (off / sd) ** 2
    squares = squares[np.isfinite(squares)]
    windows = windowed(squares, window_rows(found.recording.sample_time))
    return float(np.mean(windows > LOST)) if len(windows) else 0.0
