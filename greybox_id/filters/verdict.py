"""The verdict on a track: whether its innovations are what the filter said of them.

A filter states how far readings may lie from what it expects. Where they lie further, or hang together, the model or
its noise is wrong and bands are too narrow; where they lie much closer, bands are too wide. Rules as in Bar-Shalom, Li
& Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, Sec. 5.4; sizes are those from which bands
are wrong by half or more.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ..base.numbers import number
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


def verdict(track: Track) -> Verdict:
    """Whether a track can be used, and why."""
    checked = [sentence for sentence in track.sentences if sentence.startswith("Data check:")]
    lost = {name: _lost(track, name) for name in track.consistency}
    return of_innovations(track.consistency, lost, track.widened, [Reason(WITH_CARE, item) for item in checked])


def of_innovations(
    channels: Mapping[str, Consistency], lost: Mapping[str, float], widened: float, more: Sequence[Reason] = ()
) -> Verdict:
    """The verdict that innovations leave.

    Parameters
    ----------
    channels : reading -> what its innovations say.
    lost : reading -> share of windows in which they are far beyond what is expected.
    widened : by how much bands were widened for them.
    more : further reasons.
    """
    reasons = [reason for name, item in channels.items() for reason in _channel(name, item, lost[name], widened)]
    reasons += more
    if not any(item.count for item in channels.values()):
        reasons.append(Reason(NOT_USABLE, "No reading was taken: nothing is tracked."))
    words = "The innovations are what the filter expects: NIS {} (1 is due)."
    listed = ", ".join(f"{number(one.nis, 2)} of {name}" for name, one in channels.items() if np.isfinite(one.nis))
    return weighed([*reasons, Reason(USABLE, words.format(listed))], {})


def _channel(name: str, value: Consistency, share: float, widened: float) -> Iterator[Reason]:
    bands = f"bands were widened {number(widened, 2)} times" if widened > 1.0 else "bands are too narrow"
    if share > MOSTLY_LOST:
        yield Reason(
            NOT_USABLE,
            f"{name} lies far from what the filter expects for {100 * share:.0f} % of the time: the filter has lost "
            "the vehicle. Check units and signs with greybox data check, and the vehicle's numbers.",
        )
    elif value.nis > NARROW:
        yield Reason(
            WITH_CARE,
            f"{name}: innovations scatter {number(np.sqrt(value.nis), 2)} times as far as expected "
            f"(NIS {number(value.nis, 2)}): "
            f"{bands}. State its noise, or fit the vehicle first.",
        )
    elif value.nis < WIDE:
        yield Reason(
            WITH_CARE,
            f"{name}: innovations scatter {number(np.sqrt(value.nis), 2)} times as far as expected "
            f"(NIS {number(value.nis, 2)}): "
            f"its noise is overstated and bands are too wide. State noise_{name}, or tune it (‹tune›).",
        )
    elif value.inside < INSIDE:
        yield Reason(
            WITH_CARE,
            f"{name}: only {100 * value.inside:.0f} % of the windows lie within their 95 % bounds: its noise varies.",
        )
    if value.correlation > max(TOGETHER, value.correlation_bound):
        yield Reason(
            WITH_CARE,
            f"{name}: successive innovations correlate ({value.correlation:.2f}): the model lacks something and "
            "bands are too narrow. greybox gap looks for it; ‹coloured› lets a reading err slowly.",
        )


def _lost(track: Track, name: str) -> float:
    """Share of windows in which a channel's innovations are far beyond what is expected."""
    off, sd = track.innovations.get(name), track.expected.get(name)
    if off is None or sd is None:
        return 0.0
    squares = (off / sd) ** 2
    squares = squares[np.isfinite(squares)]
    windows = windowed(squares, window_rows(track.recording.sample_time))
    return float(np.mean(windows > LOST)) if len(windows) else 0.0
