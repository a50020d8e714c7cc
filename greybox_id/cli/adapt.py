"""`greybox adapt`: adaptation of a fit to a car that may have changed."""

from __future__ import annotations

from pathlib import Path

from .defaults import command_line
from .options import ABOVE_ZERO, CALIBRATE, COLUMNS, FILE, JSON_AND_OWN, argument, command, option, read_part
from .output import console, print_json, progress, show


@command("adapt")
def adapt(
    fit_file: str = argument("FIT", type=FILE),
    file: str = argument("RECORDING", type=FILE),
    columns: str = COLUMNS,
    seconds: float = option(
        "Length of the part to which the fit is adapted, counted while the vehicle moves; the rest is scored.",
        "SECONDS",
        type=ABOVE_ZERO,
        default=20.0,
    ),
    free: str = option(
        "Parameters that may change: auto (chosen by cross-validation), all, or names such as D_f,D_r. For fits "
        "of msnn_... and gnn also one of these sets: few (steering ratio and offset, motor gain), F (impulse "
        "responses), "
        "physical (single numbers), paper (as in the paper on these networks).",
        "WORDS",
        default="auto",
    ),
    validate: str | None = option(
        "Recording on which the adapted fit is scored; default: the rest of RECORDING.", "RECORDING", type=FILE
    ),
    calibrate: str | None = CALIBRATE,
    out: str | None = option("Folder to which fit.json is written; default: MODEL_adapted.", "FOLDER"),
    as_json: bool = JSON_AND_OWN,
) -> None:
    """Adapt FIT to the first seconds of RECORDING, because the car may have changed.

    Cross-validation within these seconds chooses which parameters change and how far; it may also keep the fit
    unchanged. The adapted fit is then scored on the rest of the recording, with predictions 0.5 s ahead. Fits of
    msnn_... and gnn are scored one sample ahead, and their delays may be estimated anew.

    \b
    greybox adapt run/fit.json new_tyres.csv --columns roboracer --seconds 20 --out adapted
    """
    from dataclasses import replace

    from ..api.adapting import adapted
    from ..base.files import ensure_writable
    from ..base.guard import claim
    from .options import fit_of

    fit = fit_of(fit_file)
    target = Path(out or f"{fit.model.name}_adapted") / "fit.json"
    claim(target, becomes=f"a fit of {fit.model.name}")
    recording = read_part(file, columns)
    scored = None if validate is None else read_part(validate, columns)
    ensure_writable(target.parent)
    with progress() as say:
        result = adapted(fit, recording, seconds, free, scored, [calibrate] if calibrate else [], Path(fit_file), say)
    path = replace(result.fit, command=command_line()).save(target)
    if as_json:
        print_json(result.as_dict() | {"written": str(path)})
        return
    show(result.parts())
    console().print(f"\nwritten  {path}   adapted in {result.cpu_seconds:.1f} CPU s")
