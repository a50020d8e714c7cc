"""A track as `gb.track` returns it: a table, a figure."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ..base.numbers import pretty_unit, with_sd
from ..base.version import __version__
from ..datasets.recording import Recording
from ..filters.how import TrackOptions
from ..filters.track import Track
from ..reports.text.screen import as_text
from ..reports.text.track import parts
from ..reports.track.digest import Digest, TrackMade, digest

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_SHOWN = 6
"""Estimates that a track's `repr` shows."""


@dataclass(frozen=True, repr=False)
class TrackResult(Track):
    """Estimates along a recording, each with its standard deviation.

    `gb.track` returns it. What it is as a record (`values`, `sds`, `units`, `innovations`, `consistency`, `sentences`
    ...) is documented at `greybox_id.filters.Track`.

    Attributes
    ----------
    as_read : the recording before glitches of inputs were bridged.
    how : filter, readings and noise as they were asked for.
    made : what it was made with, for its report.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 300)
    >>> track = gb.track("lateral", lap, ["C_alpha_f"], vehicle="roboracer", options=gb.TrackOptions(tune=0.0))
    >>> len(track.to_pandas()) == len(track.rows)
    True
    """

    as_read: Recording | None = field(default=None, compare=False)
    how: TrackOptions = field(default_factory=TrackOptions, compare=False)
    made: TrackMade = field(default_factory=lambda: TrackMade("", "", __version__), compare=False)

    @classmethod
    def of(cls, track: Track, as_read: Recording, how: TrackOptions, made: TrackMade) -> TrackResult:
        """A track with what it can do."""
        value = {one.name: getattr(track, one.name) for one in fields(Track)}
        return cls(**value, as_read=as_read, how=how, made=made)

    @cached_property
    def digest(self) -> Digest:
        """What its summary, its file and its report are made from."""
        return digest(self, self.as_read if self.as_read is not None else self.recording, self.made)

    def summary(self) -> str:
        """What `greybox track` prints: estimates, innovations, what must be known of them."""
        return as_text(parts(self, self.digest))

    def to_pandas(self) -> pd.DataFrame:
        """A row per sample: time [s], run, and every estimate in its SI unit as NAME, its standard deviation as
        NAME_sd.

        Returns
        -------
        pandas.DataFrame
            (n, 2 + 2 estimates); units are in its `attrs["units"]`.
        """
        table = self.table()
        table.attrs["units"] = dict(self.units)
        return table

    def plot(self, *names: str, axes: Any = None) -> Axes | np.ndarray[Any, Any]:
        """Estimates over time with bands of two standard deviations, and what was measured of them.

        Parameters
        ----------
        names : estimates; all unless given.
        axes : matplotlib Axes to draw into, one for each name.

        Returns
        -------
        matplotlib Axes, or (names,) of them.

        Raises
        ------
        BadInput : it has no estimate of that name.
        """
        from .plots import along_track

        return along_track(self, names, axes)

    def __repr__(self) -> str:
        return "\n".join(self._lines())

    def _repr_html_(self) -> str:
        return f"<pre>{escape(repr(self))}</pre>"

    def _lines(self) -> list[str]:
        kind = f"{self.kind.upper()}{', smoothed' if self.smoothed else ''}"
        lines = [f"Track of {self.recording.name} by {self.model.name}: {kind}, {len(self.rows)} rows"]
        for name in list(self.values)[:MOST_SHOWN]:
            mean, sd = float(np.nanmean(self.values[name])), float(np.nanmedian(self.sds[name]))
            lines.append(f"  {name} = {with_sd(mean, sd)} {pretty_unit(self.units[name])} (mean, median sd)")
        more = len(self.values) - MOST_SHOWN
        if more > 0:
            lines.append(f"  and {more} more: .to_pandas()")
        if self.sentences:
            lines.append(f"  {self.sentences[0]:.120}")
        return lines
