"""A track as text: estimates, innovations, what must be known of them; and as one JSON object."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np
from rich.console import RenderableType

from ...base.numbers import alike, counted, pretty_unit
from ...base.numbers import number as decimal
from ...base.signals import unit_of
from ...filters.track import Track
from ...filters.verdict import verdict
from ..track.digest import Digest
from .fit import verdict_table
from .screen import plain_table

COVERED = 0.8
"""Share of the truth within two standard deviations, of 95 % that are due, below which bands mislead."""


def parts(found: Track, told: Digest) -> Iterator[RenderableType]:
    """What a track says, part by part."""
    yield verdict_table(verdict(found))
    yield ""
    how = f"{found.kind.upper()}{' and smoother' if found.smoothed else ''}"
    yield f"{how}: {counted(len(found.rows), 'row')} in {counted(len(np.unique(found.run)), 'run')}\n"
    quantiles = ("5 %", "median", "95 %", "± median sd")
    table = plain_table("estimate", *quantiles, "unit", "identifiable in", right=(*quantiles, "identifiable in"))
    for name, values in found.values.items():
        low, middle, high = np.nanquantile(values, [0.05, 0.5, 0.95])
        share = f"{100 * found.told[name]:.0f} % of rows" if name in found.told else ""
        sd = float(np.nanmedian(found.sds[name]))
        table.add_row(name, *alike(low, middle, high, sd, by=sd), pretty_unit(found.units[name]), share)
    yield table
    yield ""
    tests = ("NIS (1)", "windows within 95 %", "next to next", "gated")
    counts = ("taken", "innovation rms")
    checks = plain_table("reading", *counts, "unit", *tests, right=(*counts, *tests))
    for name, own in found.consistency.items():
        checks.add_row(
            name, str(own.count), f"{own.rms:.3g}", pretty_unit(unit_of(name)), f"{own.nis:.2f}",
            f"{100 * own.inside:.0f} %", f"{own.correlation:+.2f}", str(own.gated),
        )  # fmt: skip
    yield checks
    yield ""
    for sentence in beside_truth(told):
        yield f"truth    {sentence}"
    for sentence in found.sentences:
        yield f"mind     {sentence}"


def beside_truth(told: Digest) -> list[str]:
    """How far estimates are from what was measured of them and did not enter the filter, as sentences."""
    found = []
    for name, own in told.truth.items():
        sentence = (
            f"{name}: RMSE {decimal(own.rmse)} {own.unit} beside what was measured and did not enter the filter "
            f"({decimal(own.size)} {own.unit} rms); {100 * own.inside:.2g} % of it is within two sd, where 95 % is due"
        )
        if own.inside < COVERED:
            sentence += ": the bands are too narrow, do not trust them"
        if own.rmse > own.size:
            sentence += "; zero would be nearer"
        found.append(f"{sentence}.")
    if "sideslip" not in told.truth:
        found.append("A better likelihood is not always a better sideslip; nothing here measures the sideslip itself.")
    return found


def as_dict(found: Track, told: Digest) -> dict[str, Any]:
    """A track as plain data."""
    judged = verdict(found)
    return {
        "verdict": judged.usability,
        "reasons": list(judged.reasons),
        "filter": found.kind,
        "smoothed": found.smoothed,
        "rows": len(found.rows),
        "runs": len(np.unique(found.run)),
        "estimates": {
            name: {
                "unit": found.units[name],
                "mean": float(np.nanmean(values)),
                "sd_median": float(np.nanmedian(found.sds[name])),
                **({"identifiable_in": found.told[name]} if name in found.told else {}),
            }
            for name, values in found.values.items()
        },
        "noise": dict(found.noise),
        "innovations": {name: vars(own) for name, own in found.consistency.items()},
        "widened": found.widened,
        "log_likelihood": found.log_likelihood,
        "findings": list(found.sentences),
        "filter_seconds": found.seconds,
        "truth": {name: asdict(own) for name, own in told.truth.items()},
    }
