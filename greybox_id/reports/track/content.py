"""What the report of a track says: tables and sentences."""

from __future__ import annotations

from ...signals import unit_of
from ..content import recorded_in
from ..document import Table
from ..numbers import listed, number, percent, pretty_unit, signal_words, with_sd
from .digest import Digest
from .verdict import method

READING, INPUT = "reading", "input"
NOISES = {
    "walk": "{} walks by so much in the root of a second",
    "noise": "white noise of the readings of {}",
    "colour": "slow part of the error of {}",
    "memory": "how long {} lasts",
}
"""Kind of noise -> what its size says."""


def provenance(found: Digest) -> tuple[Table, tuple[tuple[str, str], ...]]:
    """The recording, and what reproduces the track."""
    made = found.made
    pairs = (
        ("version", f"greybox-id {made.version}"),
        ("command", made.command or "not recorded (tracked from Python)"),
        ("vehicle", made.vehicle or "none named"),
        ("filter", f"{method(found)} on {found.model}"),
        ("walks for good", listed([_walks(found, name) for name in found.parameters]) or "nothing"),
        ("comes and goes", listed(found.disturbances) or "nothing"),
        ("effects added", listed([*found.effects]) or "none"),
    )
    return recorded_in([found.data], {"track": "tracked"}), pairs


def _walks(found: Digest, name: str) -> str:
    return name if name in found.estimates else f"the input {name}, which was not recorded"


def estimates(found: Digest) -> Table:
    """A row for each estimate."""
    walks = any(own.told is not None for own in found.estimates.values())
    rows = tuple(
        (
            signal_words(name), number(own.low), number(own.median), number(own.high), number(own.sd, 2),
            pretty_unit(own.unit), *(("" if own.told is None else percent(own.told),) if walks else ()),
        )
        for name, own in found.estimates.items()
    )  # fmt: skip
    head = ("estimate", "5 %", "median", "95 %", "median sd", "unit", *(("identifiable in",) if walks else ()))
    return Table(head, rows, "lRRRRlR"[: len(head)])


def truth(found: Digest) -> Table:
    """A row for each estimate that was measured and did not enter the filter."""
    rows = tuple(
        (
            signal_words(name), number(own.rmse), number(own.bias, 2), number(own.worst, 2), number(own.size),
            pretty_unit(own.unit), percent(own.inside), f"{own.rows:,}".replace(",", "\u00a0"),
        )
        for name, own in found.truth.items()
    )  # fmt: skip
    head = ("estimate", "RMSE", "mean error", "largest", "RMS measured", "unit", "within two sd", "rows")
    return Table(head, rows, "lRRRRlRR")


def readings(found: Digest) -> Table:
    """A row for each reading: whether the filter expected it."""
    rows = tuple(
        (
            signal_words(name), f"{own.count:,}".replace(",", "\u00a0"), number(own.rms), pretty_unit(unit_of(name)),
            number(own.nis), percent(own.inside), number(own.correlation, 2), f"± {number(own.correlation_bound, 2)}",
            str(own.gated),
        )
        for name, own in found.consistency.items()
    )  # fmt: skip
    head = ("reading", "taken", "innovation RMS", "unit", "NIS", "windows within", "next to next", "chance", "gated")
    return Table(head, rows, "lRRlRRRRR")


def noises(found: Digest) -> Table:
    """A row for each noise that has a part in the estimates."""
    rows = []
    for name, own in found.noise.items():
        kind, _, of = name.partition("_")
        shares = " (a share of itself)" if kind == "walk" and own.unit in ("", "1") else ""
        unit = f"{'1' if shares else pretty_unit(own.unit)}/√s" if kind == "walk" else pretty_unit(own.unit)
        said = NOISES[kind].format(signal_words(of)) + shares
        origin = f"{own.origin} on the first {found.made.tuned_on:g} s" if own.origin == "tuned" else own.origin
        rows.append((name, said, number(own.size), unit, origin))
    return Table(("noise", "meaning", "size", "unit", "from"), tuple(rows), "lLrll")


def calibrated(found: Digest) -> Table:
    """A row for each parameter of the model that was tuned along."""
    rows = tuple((name, with_sd(value, sd)) for name, (value, sd) in found.calibrated.items())
    return Table(("parameter", "estimate ± sd, SI units"), rows, "lL")


def signals(found: Digest) -> Table:
    """A row for each channel that went in, with the range that was driven."""
    rows = tuple(
        (signal_words(name), role, *(number(own) for own in ends), pretty_unit(unit))
        for name, (unit, role, ends) in found.signals.items()
    )
    return Table(("channel", "taken as", "0.5 %", "median", "99.5 %", "unit"), rows, "lLRRRl")
