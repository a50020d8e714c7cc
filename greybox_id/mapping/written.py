"""A proposal as a column map to be edited: every line says why it stands there."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Sequence

from ..signals import SIGNALS, unit_of
from .entry import MapEntry
from .proposal import Proposal

WIDTH = 110


def as_toml(proposal: Proposal, name: str) -> str:
    """TOML text: what is decided stands as it is, what is open is commented out."""
    lines = [
        *_comment(f"A column map for {proposal.file}, proposed from names, units and cross-checks."),
        "# Lines that begin with #? are questions: remove the #? from the right one and complete it.",
        "# Signs: x forward, y left, z up; yaw rate and steering are positive to the left. Channels can tell that they",
        "# agree with each other, not which way is left: look at one turn you know.",
        "",
        f"name = {quoted(name)}",
        'hold = "zero"  # what commands do between rows: "zero" holds them, "linear" if they were measured',
    ]
    if proposal.separator != ",":
        lines.append(f"separator = {quoted(proposal.separator)}")
    if proposal.decimal != ".":
        lines.append(f"decimal = {quoted(proposal.decimal)}")
    lines += ["", "[time]", *_time(proposal.time)]
    if proposal.run:
        lines += ["", f"[runs]  # a change begins a new run\ncolumn = {quoted(proposal.run)}"]
    lines += ["", "[signals]"]
    for entry in sorted(proposal.entries, key=lambda own: (list(SIGNALS).index(own.signal), not own.decided)):
        lines += ["", *_signal(entry)]
    if proposal.others:
        listed, lacking = ", ".join(proposal.others), proposal.lacking
        which = "If one of them is a signal below, name it there. " if lacking else ""
        lines += ["", *_comment(f"Taken for nothing: {listed}. {which}What else you want to keep goes under [extra].")]
        lines += [f'#? {signal} = {{ column = "...", unit = {quoted(unit_of(signal))} }}' for signal in lacking]
    return "\n".join(lines) + "\n"


def _time(time: MapEntry | None) -> list[str]:
    if time is None:
        return ['#? column = "..."  # no column looks like a time', '#? unit = "s"']
    unit = f"unit = {quoted(time.unit)}" if time.decided else f'#? unit = "{time.units[0]}"'
    return [*_comment("; ".join(time.reasons)), f"column = {quoted(time.column)}", unit]


def _signal(entry: MapEntry) -> list[str]:
    mark = "" if entry.decided else "#? "
    units = (entry.unit,) if entry.unit and not entry.units else entry.units or (unit_of(entry.signal),)
    return [*_comment("; ".join(entry.reasons)), *(f"{mark}{entry.signal} = {_table(entry, unit)}" for unit in units)]


def _table(entry: MapEntry, unit: str) -> str:
    parts = [f"column = {quoted(entry.column)}", f"unit = {quoted(unit)}"]
    if entry.sign != 1:
        parts.append(f"sign = {entry.sign}")
    if entry.divide_by != 1.0:
        parts.append(f"divide_by = {entry.divide_by:g}")
    return f"{{ {', '.join(parts)} }}"


def _comment(text: str) -> Sequence[str]:
    printable = "".join(c if c.isprintable() else " " for c in text)
    return textwrap.wrap(printable, WIDTH, initial_indent="# ", subsequent_indent="#   ")


def quoted(text: str) -> str:
    """Text as TOML writes it; JSON's escapes are TOML's, but for what lies beyond 16 bits, which stays as it is."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
