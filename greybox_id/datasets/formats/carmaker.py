"""IPG CarMaker's .erg files with their .erg.info, which names the quantities; read by cmerg."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...base.errors import BadInput
from ...base.units import known_unit
from ..column_map import ColumnMap
from . import Contents, Group, loader, needed, sound

KIND = "CarMaker ERG"
TIME = "Time"


def contents(file: Path, _: ColumnMap) -> Contents:
    """The quantities of a file.

    Raises
    ------
    BadInput
        cmerg is not installed, the .info file is missing, or the file is damaged.
    """
    cmerg = needed("cmerg", "carmaker", str(file), KIND)
    info = Path(f"{file}.info")
    if not info.is_file():
        raise BadInput(f"{file}: {info.name}, which names its quantities, is missing from its folder; copy it there.")
    with sound(str(file), KIND):
        signals = cmerg.ERG(str(file)).signals
    numeric = {name: signal for name, signal in signals.items() if np.issubdtype(signal.data.dtype, np.number)}
    if TIME not in numeric:
        raise BadInput(f"{file} has no quantity {TIME}; write it again with {TIME} among its quantities.")
    units = {name: unit for name, item in numeric.items() if (unit := known_unit(item.unit))}
    load = loader(str(file), numeric, lambda name: numeric[name].data)
    return Contents(str(file), (Group("", tuple(numeric), load, "", TIME, "s", units),), KIND)
