"""MDF by asammdf: list of the channels, and their values."""

from __future__ import annotations

from typing import Any

import asammdf
import numpy as np
from numpy.typing import NDArray

from ...base.contained.inside import KINDS


class MdfReader:
    """An opened file."""

    def __init__(self, file: str, folder: str) -> None:
        self._opened: Any = asammdf.MDF(file, temporary_folder=folder)

    def groups(self) -> list[dict[str, Any]]:
        """All channel groups: title, channel names and units, index of the time channel."""
        return [
            {
                "title": getattr(group.channel_group, "acq_name", "") or str(k),
                "channels": [[channel.name, channel.unit or ""] for channel in group.channels],
                "clock": self._opened.masters_db.get(k),
            }
            for k, group in enumerate(self._opened.groups)
        ]

    def values(self, group: int, index: int) -> NDArray[Any]:
        """(n,) a channel's values, NaN where the file marks them as invalid; empty texts if it is no plain column."""
        signal = self._opened.get(group=group, index=index, ignore_invalidation_bits=True)  # otherwise rows are dropped
        values = np.asarray(signal.samples)
        if values.dtype.kind == "O" and values.ndim == 1:
            values = np.array([str(value) for value in values], dtype=str)
        if values.ndim != 1 or values.dtype.kind not in KINDS or not values.dtype.itemsize:
            return np.zeros(len(values), dtype="U1")
        values = values.astype(values.dtype.newbyteorder("="))
        if signal.invalidation_bits is not None and values.dtype.kind in "iuf":
            values = np.where(np.asarray(signal.invalidation_bits, dtype=bool), np.nan, values)
        return values
