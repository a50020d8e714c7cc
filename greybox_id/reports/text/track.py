"""A track as text: estimates, innovations, checks and notes; and as a JSON object."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np
from rich.console import RenderableType

from ...base.numbers import alike, counted, percent, pretty_unit, signed
from ...base.numbers import number as decimal
from ...base.signals import unit_of
from ...filters.track import Track, verdict
from ..track.digest import Digest
from .fit import verdict_table
from .screen import led, plain_table

COVERED = 0.8
"""Share of the truth within two standard deviations, 0.95 if correct, below which bands count as too narrow."""


def parts(track: Track, digest: Digest) -> Iterator[RenderableType]:
    """The text of a track, part by part."""
    yield verdict_table(verdict(track))
    yield ""
    how = f"{track.kind.upper()}{' and smoother' if track.smoothed else ''}"
    yield f"{how}: {counted(len(track.rows), 'row')} in {counted(len(np.unique(track.run)), 'run')}\n"
    quantiles = ("5 %", "median", "95 %", "± median sd")
    table = plain_table("estimate", *quantiles, "unit", "identifiable in", right=(*quantiles, "identifiable in"))
    for name, values in track.values.items():
        low, middle, high = np.nanquantile(values, [0.05, 0.5, 0.95])
        share = f"{100 * track.told[name]:.0f} % of rows" if name in track.told else ""
        sd = float(np.nanmedian(track.sds[name]))
        table.add_row(name, *alike(low, middle, high, sd, by=sd), pretty_unit(track.units[name]), share)
    yield table
    yield ""
    tests = ("NIS (1)", "2 s means of NIS in 95 % band", "autocorrelation", "gated")
    counts = ("samples used", "innovation rms")
    checks = plain_table("reading", *counts, "unit", *tests, right=(*counts, *tests))
    for name, item in track.consistency.items():
        checks.add_row(
            name, str(item.count), decimal(item.rms), pretty_unit(unit_of(name)), f"{item.nis:.2f}",
            f"{100 * item.inside:.0f} %", signed(item.correlation, 2), str(item.gated),
        )  # fmt: skip
    yield checks
    yield ""
    for sentence in beside_truth(digest):
        yield led("checked", sentence)
    for sentence in track.sentences:
        yield led("note", sentence)


def beside_truth(digest: Digest) -> list[str]:
    """Errors of the estimates relative to measurements that the filter did not use, as sentences."""
    result = []
    for name, one in digest.truth.items():
        sentence = (
            f"{name} has an RMSE of {decimal(one.rmse)} {one.unit} against measurements that the filter did not use "
            f"(their rms: {decimal(one.size)} {one.unit}). {percent(one.inside)} of them are within two sd of the "
            "estimate; "
            "95 % are expected"
        )
        if one.inside < COVERED:
            sentence += ", so the bands are too narrow"
        if one.rmse > one.size:
            sentence += ". An estimate of zero would have a smaller error"
        result.append(f"{sentence}.")
    if "sideslip" not in digest.truth:
        result.append("No sideslip was measured, so its estimate cannot be checked.")
    return result


def as_dict(track: Track, digest: Digest) -> dict[str, Any]:
    """A track as plain data."""
    judged = verdict(track)
    return {
        "verdict": judged.usability,
        "reasons": list(judged.reasons),
        "filter": track.kind,
        "smoothed": track.smoothed,
        "rows": len(track.rows),
        "runs": len(np.unique(track.run)),
        "estimates": {
            name: {
                "unit": track.units[name],
                "mean": float(np.nanmean(values)),
                "sd_median": float(np.nanmedian(track.sds[name])),
                **({"identifiable_in": track.told[name]} if name in track.told else {}),
            }
            for name, values in track.values.items()
        },
        "noise": dict(track.noise),
        "innovations": {name: vars(item) for name, item in track.consistency.items()},
        "widened": track.widened,
        "log_likelihood": track.log_likelihood,
        "findings": list(track.sentences),
        "filter_seconds": track.seconds,
        "truth": {name: asdict(item) for name, item in digest.truth.items()},
    }
