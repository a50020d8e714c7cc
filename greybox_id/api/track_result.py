"""Result of `gb.track`: a table, a figure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from rich.console import RenderableType

from ..base.errors import BadInput
from ..base.files import at_once, write_atomically
from ..base.guard import claim
from ..base.numbers import pretty_unit, with_sd
from ..base.version import __version__
from ..datasets.recording import Recording
from ..datasets.result_table import claimed_table, write_table
from ..filters.how import TrackOptions
from ..filters.track import Track, tracked_vehicle, verdict
from ..fitting.fit import Verdict
from ..models.effects import EFFECTS
from ..models.vehicle import Vehicle, write_vehicle
from ..reports.document import write_drawings
from ..reports.text.screen import as_text
from ..reports.text.track import as_dict, parts
from ..reports.track.digest import Digest, TrackMade, digest
from ..reports.track.digest import as_text as text_of
from . import given
from .given import VehicleLike

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WORDS = "a table of estimates"
"""Kind of file, for messages."""
MOST_SHOWN = 6
"""Most estimates that a track's `repr` shows."""


@dataclass(frozen=True, repr=False)
class TrackResult(Track):
    """Estimates along a recording, each with its standard deviation.

    `gb.track` returns it. Attributes of the base class (`values`, `sds`, `units`, `innovations`, `consistency`,
    `sentences` ...) are documented at `greybox_id.filters.Track`.

    Attributes
    ----------
    as_read : the recording before glitches of inputs were bridged.
    how : filter, readings and noise as requested.
    made : provenance, for its report.
    named : parameters and disturbances as requested.

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
    named: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())

    @classmethod
    def of(cls, track: Track, **more: Any) -> TrackResult:
        """Wrap a track."""
        return cls(**{one.name: getattr(track, one.name) for one in fields(Track)}, **more)

    @cached_property
    def verdict(self) -> Verdict:
        """Whether the track can be used, and why."""
        return verdict(self)

    @cached_property
    def digest(self) -> Digest:
        """Content of its summary, its file and its report."""
        return digest(self, self.as_read if self.as_read is not None else self.recording, self.made)

    def parts(self) -> Iterator[RenderableType]:
        """The text of the track, part by part."""
        return parts(self, self.digest)

    def summary(self) -> str:
        """The text that `greybox track` prints: estimates, innovations, notes."""
        return as_text(self.parts())

    def as_dict(self) -> dict[str, Any]:
        """All attributes except the rows, as plain data."""
        return as_dict(self, self.digest)

    def vehicle(self, before: VehicleLike) -> Vehicle:
        """The vehicle with its calibrated numbers, their uncertainty, and the noise.

        Parameters
        ----------
        before : the vehicle with the initial values of the model.

        Raises
        ------
        BadInput : if the vehicle is unknown.
        """
        stated = given.vehicle(before)
        if stated is None:
            raise BadInput("before: the vehicle that the model started from is needed.")
        return tracked_vehicle(stated, self, *self.named, EFFECTS)

    def save(
        self, path: str | Path, *, figures: str | Path | None = None, vehicle: VehicleLike = None,
        to: str | Path | None = None,
    ) -> list[Path]:  # fmt: skip
        """Write the table, and next to it a .json file from which `gb.report` makes a report: all or none of them.

        Parameters
        ----------
        path : a .csv, .parquet, .mf4 or .mcap file.
        figures : folder for figures, as SVG.
        vehicle, to : write this vehicle with the tuned numbers to this file.

        Returns
        -------
        list of Path
            The written files.

        Raises
        ------
        BadInput : if a file cannot be written.
        """
        target, beside = track_target(path)
        with at_once():
            write_atomically(beside, text_of(self.digest))
            write_table(self.table(copy=False), target, WORDS)
            written = [target, beside]
            if to is not None:
                written.append(write_vehicle(self.vehicle(vehicle), to))
            if figures is not None:
                from ..reports.track.report import drawings  # matplotlib

                written += write_drawings(drawings(self.digest), figures)
        return written

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
        """Estimates over time with bands of two standard deviations, and measurements of the same quantities.

        Parameters
        ----------
        names : estimates; all by default.
        axes : matplotlib Axes to draw into, one per name.

        Returns
        -------
        matplotlib Axes, or (names,) of them.

        Raises
        ------
        BadInput : if there is no estimate with a name.
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


def track_target(out: str | Path) -> tuple[Path, Path]:
    """The files of a track's table and of its report's content. Raises `BadInput` for another kind of file."""
    target = claimed_table(str(out), WORDS)
    return target, claim(target.with_suffix(".json"), "‹out›", "a track")
