"""`greybox fit --model tyre`: a magic formula from the recordings of a tyre rig, and its tyre property file."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.text import Text

from ..base.files import ensure_writable, write_atomically
from ..base.guard import claim
from ..base.numbers import number
from ..reports.text.screen import plain_table
from .output import console, print_json, working

if TYPE_CHECKING:
    from ..fitting.tyre_rig import TyreFit

NOT_USABLE = 3
"""Exit code of a fit that is written, but is not usable."""


def fit_tyre_command(files: Sequence[str], out: str | None, as_json: bool) -> None:
    """Fit a tyre to rig recordings, print it and write its tyre property file."""
    from ..fitting.tyre_rig import fit_tyre, tyre_text

    target = Path(out or "tyre.tir")
    if target.suffix.lower() != ".tir":
        target = target / "tyre.tir"
    claim(target, becomes="a tyre property file")
    ensure_writable(target.parent)
    with working(f"fitting a tyre to {len(files)} files"):
        found = fit_tyre(files)
    write_atomically(target, tyre_text(found, " ".join(Path(file).name for file in files)))
    if as_json:
        print_json(_as_dict(found) | {"written": str(target)})
    else:
        _show(found, target)
    sys.exit(0 if found.usable else NOT_USABLE)


def _show(found: TyreFit, target: Path) -> None:
    screen = console()
    share = f"{100 * found.explained:.1f} % of the side force's variance explained, RMSE {number(found.rmse, 3)} N"
    word = "usable as a prior" if found.usable else "not usable"
    screen.print(Text(f"verdict  {word}: {share}", style="bold"))
    screen.print(f"         to slip angles of {number(found.largest_slip, 2)} rad; beyond, the formula extrapolates")
    screen.print(f"data     {found.rows} rows; {found.left_out} of another camber, or without numbers, left out")
    for note in found.notes:
        screen.print(f"         {note}")
    table = plain_table("coefficient", "estimate", "sd")
    for key, value in found.numbers.items():
        sd = found.sd.get(key)
        table.add_row(key, number(value, 4), "" if sd is None else number(sd, 2))
    screen.print(table)
    if found.bands:
        table = plain_table("temperature and pressure", "rows", "friction", "stiffness")
        for band in found.bands:
            table.add_row(band.words, str(band.rows), f"x {band.friction:.3f}", f"x {band.stiffness:.3f}")
        screen.print(table)
    if len(found.bands) > 1:
        screen.print(
            f"spread   between temperatures and pressures: friction ± {100 * found.friction_spread:.1f} %, cornering "
            f"stiffness ± {100 * found.stiffness_spread:.1f} %"
        )
    else:
        screen.print("spread   unknown: no column of temperature or pressure varies")
    screen.print(
        f'\nwritten  {target}   in a vehicle file: tyre_file = "{target}"; friction of a road: ± 30 % of the belt\'s'
    )


def _as_dict(found: TyreFit) -> dict[str, object]:
    """The fit as plain data."""
    finite = {"friction_spread": found.friction_spread, "stiffness_spread": found.stiffness_spread}
    return {
        "usable": found.usable,
        "coefficients": {key: {"value": v, "sd": found.sd.get(key)} for key, v in found.numbers.items()},
        "rmse_n": found.rmse,
        "explained": found.explained,
        "rows": found.rows,
        "left_out": found.left_out,
        "largest_slip_rad": found.largest_slip,
        **{key: value if value == value else None for key, value in finite.items()},
        "bands": [
            {"words": own.words, "rows": own.rows, "friction": own.friction, "stiffness": own.stiffness}
            for own in found.bands
        ],
        "notes": list(found.notes),
    }
