"""`greybox fit --model tyre`: a magic formula from recordings of a tyre rig, and its tyre property file."""

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
        result = fit_tyre(files)
    write_atomically(target, tyre_text(result, " ".join(Path(file).name for file in files)))
    if as_json:
        print_json(_as_dict(result) | {"written": str(target)})
    else:
        _show(result, target)
    sys.exit(0 if result.usable else NOT_USABLE)


def _show(fit: TyreFit, target: Path) -> None:
    screen = console()
    share = f"explains {100 * fit.explained:.1f} % of the variance of the side force, RMSE {number(fit.rmse, 3)} N"
    word = "usable as a prior" if fit.usable else "not usable"
    screen.print(Text(f"verdict  {word}: {share}", style="bold"))
    screen.print(
        f"         valid up to slip angles of {number(fit.largest_slip, 2)} rad; at larger ones the formula "
        "extrapolates"
    )
    screen.print(
        f"data     {fit.rows} rows used; {fit.left_out} rows left out (another camber angle, or missing values)"
    )
    for note in fit.notes:
        screen.print(f"         {note}")
    table = plain_table("coefficient", "estimate", "sd")
    for key, value in fit.numbers.items():
        sd = fit.sd.get(key)
        table.add_row(key, number(value, 4), "" if sd is None else number(sd, 2))
    screen.print(table)
    if fit.bands:
        table = plain_table("temperature and pressure", "rows", "friction", "stiffness")
        for band in fit.bands:
            table.add_row(band.words, str(band.rows), f"x {band.friction:.3f}", f"x {band.stiffness:.3f}")
        screen.print(table)
    if len(fit.bands) > 1:
        screen.print(
            f"spread   over temperatures and pressures: friction ± {100 * fit.friction_spread:.1f} %, cornering "
            f"stiffness ± {100 * fit.stiffness_spread:.1f} %"
        )
    else:
        screen.print("spread   not known over temperature and pressure: no column of either varies")
    screen.print(
        f'\nwritten  {target}   in a vehicle file: tyre_file = "{target}"; '
        "on a road, assume the friction of the rig ± 30 %"
    )


def _as_dict(tyre_fit: TyreFit) -> dict[str, object]:
    """The fit as plain data."""
    finite = {"friction_spread": tyre_fit.friction_spread, "stiffness_spread": tyre_fit.stiffness_spread}
    return {
        "usable": tyre_fit.usable,
        "coefficients": {key: {"value": v, "sd": tyre_fit.sd.get(key)} for key, v in tyre_fit.numbers.items()},
        "rmse_n": tyre_fit.rmse,
        "explained": tyre_fit.explained,
        "rows": tyre_fit.rows,
        "left_out": tyre_fit.left_out,
        "largest_slip_rad": tyre_fit.largest_slip,
        **{key: value if value == value else None for key, value in finite.items()},
        "bands": [
            {"words": band.words, "rows": band.rows, "friction": band.friction, "stiffness": band.stiffness}
            for band in tyre_fit.bands
        ],
        "notes": list(tyre_fit.notes),
    }
