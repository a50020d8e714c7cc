"""What is wrong with the inputs of a filter, found before it runs.

A filter believes its inputs. A glitch of one sample in the steering angle would pass for a kick of the vehicle, and
smoothing the input would hide it and delay everything else: glitches are found against their neighbours, said, and
bridged. Glitches in readings are no matter here; the filter weighs each against what it expects.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..checks.values import outlying
from ..parameter import Array
from ..recording import Recording

LONGEST_GAP = 0.5
"""Gaps in an input up to this long are bridged, s; the filter starts anew behind longer ones."""


def guarded(recording: Recording, inputs: Sequence[str]) -> tuple[Recording, list[str]]:
    """The recording with glitches and short gaps of its inputs bridged by straight lines, and sentences on them."""
    signals, told = {}, []
    for name in inputs:
        if name not in recording:
            continue
        bridged, lost = _bridged(recording, recording[name])
        gaps = int(np.count_nonzero(~np.isfinite(recording[name]))) - lost
        there, rows = np.isfinite(bridged), np.arange(len(bridged))
        whole = np.interp(rows, rows[there], bridged[there]) if np.any(there) else np.zeros(len(bridged))
        finding = outlying(recording.with_signals(**{name: whole}), name)
        if finding is not None:
            without = bridged.copy()
            without[list(finding.where.rows)] = np.nan
            bridged, _ = _bridged(recording, without)
            told.append(f"{finding.sentence.removesuffix(' Leave such rows out.')} Taken as missing and bridged.")
        if gaps > 0:
            told.append(f"{name}: {gaps} missing values in gaps of up to {LONGEST_GAP:g} s were bridged.")
        if lost:
            told.append(f"{name}: {lost} values are missing in longer gaps, behind which the filter starts anew.")
        signals[name] = bridged
    return recording.with_signals(**signals), told


def _bridged(recording: Recording, values: Array) -> tuple[Array, int]:
    """Values with short gaps inside runs filled, and how many stay missing."""
    found = values.copy()
    for start, stop in recording.runs:
        own, time = values[start:stop], recording.time[start:stop]
        there = np.flatnonzero(np.isfinite(own))
        if len(there) == 0:
            continue
        after = np.searchsorted(there, np.arange(len(own)))
        inside = (after > 0) & (after < len(there))
        width = np.full(len(own), np.inf)
        width[inside] = time[there[after[inside]]] - time[there[after[inside] - 1]]
        fill = np.isnan(own) & (width <= LONGEST_GAP + recording.sample_time)
        found[start:stop][fill] = np.interp(time[fill], time[there], own[there])
    return found, int(np.count_nonzero(np.isnan(found)))
