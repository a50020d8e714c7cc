"""Measurement files of ASAM MDF 3 and 4: every channel group has a clock of its own.

A channel goes by its name, or where several groups have one of that name by group/channel.
"""

from __future__ import annotations

import gc
import sys
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from ...errors import BadInput
from ..column_map import ColumnMap
from ..table import Table
from .columns import Columns
from .contents import Contents, Group, needed, sound

KIND = "MDF"
MASTER = "t"
"""The clock of files we write; the column time keeps the recording's own, which may restart."""


def contents(file: Path, _: ColumnMap) -> Contents:
    """Channels with numbers, by channel group.

    Raises
    ------
    BadInput
        asammdf is not installed, or the file is damaged.
    """
    asammdf = needed("asammdf", "mdf", str(file), KIND)
    with _opened(asammdf, file) as opened:
        channels = [
            [(channel.name, number) for number, channel in enumerate(group.channels)] for group in opened.groups
        ]
        titles = [getattr(group.channel_group, "acq_name", "") or str(k) for k, group in enumerate(opened.groups)]
        masters = [opened.masters_db.get(k) for k in range(len(opened.groups))]
        units = [[channel.unit or "" for channel in group.channels] for group in opened.groups]
    seen = Counter(name for own in channels for name in {name for name, _ in own})
    twice = {title for title, count in Counter(titles).items() if count > 1}
    groups = []
    for k, own in enumerate(channels):
        title = f"{titles[k]}#{k}" if titles[k] in twice else titles[k]
        names = {(name if seen[name] == 1 else f"{title}/{name}"): (k, number) for name, number in own}
        if not names:
            continue
        clock = next((name for name, (_, number) in names.items() if number == masters[k]), "")
        stated = {name: units[k][number] for name, (_, number) in names.items() if units[k][number]}
        groups.append(
            Group(title, tuple(names), _loader(asammdf, file, names), f"{title}/", clock, "s" if clock else "", stated)
        )
    return Contents(str(file), tuple(groups), KIND)


@contextmanager
def _opened(asammdf: Any, file: Path) -> Iterator[Any]:
    """The file, opened. Of a damaged one asammdf keeps a temporary file until nobody remembers the error."""
    sentence, before, folder = "", sys.unraisablehook, TemporaryDirectory()
    try:
        with sound(str(file), KIND), asammdf.MDF(file, temporary_folder=folder.name) as opened:
            yield opened
    except BadInput as error:
        sentence = str(error)
        sys.unraisablehook = _overheard  # what was half opened complains when it is closed
        if error.__cause__:
            traceback.clear_frames(error.__cause__.__traceback__)
    if sentence:
        gc.collect()
        sys.unraisablehook = before
    folder.cleanup()
    if sentence:
        raise BadInput(sentence)


def _overheard(_: object) -> None:
    return


def _loader(asammdf: Any, file: Path, names: dict[str, tuple[int, int]]) -> Any:
    def load(wanted: Sequence[str]) -> Table:
        chosen = [name for name in names if name in wanted]
        with _opened(asammdf, file) as opened:
            signals = [_channel(opened, *names[name]) for name in chosen]
            columns = tuple(_series(signal) for signal in signals)
        return Table(str(file), tuple(chosen), columns, 1)

    return load


def _channel(opened: Any, group: int, index: int) -> Any:
    return opened.get(group=group, index=index, ignore_invalidation_bits=True)  # else invalid rows are left out


def _series(signal: Any) -> pd.Series[Any]:
    """A channel's values, NaN where the file marks them as invalid."""
    values = np.asarray(signal.samples)
    if values.ndim != 1:
        return pd.Series([""] * len(values))
    values = values.astype(values.dtype.newbyteorder("="))
    if signal.invalidation_bits is not None and values.dtype.kind in "iuf":
        values = np.where(np.asarray(signal.invalidation_bits, dtype=bool), np.nan, values)
    return pd.Series(values)


def write(columns: Columns, path: Path) -> None:
    """Write columns as one channel group of an MDF 4 file, with units."""
    asammdf = needed("asammdf", "mdf", str(path), KIND)
    with asammdf.MDF(version="4.10") as made:
        made.append(
            [
                asammdf.Signal(
                    np.asarray(values), columns.steady, columns.units.get(name, ""), name, master_metadata=(MASTER, 1)
                )
                for name, values in columns.values.items()
            ]
        )
        made.save(path, overwrite=True)
