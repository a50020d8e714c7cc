"""Text on checks of recordings and on proposed column maps: tables for people, plain data for `--json`."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.text import Text

from ...base.json_data import attributes
from ...base.numbers import counted
from ...datasets.checks import Finding, Severity, distrusted
from ...datasets.checks.finding import condition_without
from ...datasets.recording import Recording
from .screen import plain_table

if TYPE_CHECKING:
    from ...datasets.mapping import MapEntry, Proposal

DISTRUSTED = "bold red"
"""Style of a finding that makes a recording unusable."""
MOST_ROWS = 20
"""Most row numbers given for one finding in the JSON output; their count is complete."""


def show_findings(recording: Recording, findings: Sequence[Finding], out: Console) -> None:
    """Print the header line of a recording and a table of its findings."""
    out.print(Text(recording.source.path or recording.name, style="bold"), header(recording), sep=": ")
    if not findings:
        out.print("nothing noteworthy found\n")
        return
    table = plain_table("severity", "channel", "run", "finding", fold=True)
    for finding in findings:
        run = "all" if finding.where.run is None else str(finding.where.run)
        words = (finding.severity.value, finding.where.channel, run, finding.sentence)
        table.add_row(*words, style=DISTRUSTED if finding.severity is Severity.DISTRUST else None)
    out.print(table)
    if condition := condition_without(recording, findings):
        source = recording.source
        given = [("--columns", source.columns), ("--between", source.between), ("--where", condition)]
        options = [word for option, value in given if value for word in (option, value)]
        command = shlex.join(["greybox", "data", "check", source.path, *options])
        out.print(Text(f"rows left out: {command}"), soft_wrap=True)
    verdict = "is not to be trusted" if distrusted(findings) else "is usable with care: see the warnings"
    if not any(finding.severity is not Severity.NOTE for finding in findings):
        verdict = "can be used"
    out.print(f"recording {recording.name} {verdict}\n")


def header(recording: Recording) -> str:
    """Rows, runs, duration and sample rate in one line."""
    runs = f"{len(recording.runs)} run{'s' if len(recording.runs) != 1 else ''}"
    dt = recording.sample_time
    rate = f"{1 / dt:.4g} Hz" if dt > 0 else "no sample rate"
    return f"{len(recording)} rows, {runs}, {recording.duration:.1f} s at {rate}"


def as_dict(recording: Recording, findings: Sequence[Finding]) -> dict[str, Any]:
    """Header and findings of a recording as plain data."""
    dt = recording.sample_time
    return {
        "path": recording.source.path,
        "sha256": recording.source.sha256,
        "columns": recording.source.columns,
        "rows": len(recording),
        "runs": len(recording.runs),
        "duration_s": recording.duration,
        "sample_rate_hz": 1 / dt if dt > 0 else None,
        "trusted": not distrusted(findings),
        "where": condition_without(recording, findings) or None,
        "findings": [
            {
                "kind": finding.kind,
                "severity": finding.severity.value,
                "channel": finding.where.channel,
                "run": finding.where.run,
                "rows": list(finding.where.rows[:MOST_ROWS]),
                "row_count": len(finding.where.rows),
                **attributes(finding, "sentence", "value", "uncertainty", "unit"),
                "repair": {name: list(source) for name, source in finding.repair.items()},
            }
            for finding in findings
        ],
    }


def show_proposal(proposal: Proposal, out: str | None, screen: Console) -> None:
    """Print a proposed column map as a table, with open decisions and next steps."""
    table = plain_table("signal", "column", "unit", "why", fold=True)
    if proposal.time:
        table.add_row(*_row(proposal.time))
    for entry in sorted(proposal.entries, key=lambda item: not item.decided):
        table.add_row(*_row(entry), style=None if entry.decided else "yellow")
    screen.print(Text(proposal.file, style="bold"))
    screen.print(table)
    if proposal.rig:
        screen.print(
            f"slip angle, load and side force are those of a tyre on a rig: greybox fit --model tyre {proposal.file}"
        )
        return
    if proposal.time is None and not proposal.rate:
        screen.print("no column looks like a time; name the one that holds it, or state the rows per second: --rate")
    if proposal.others:
        screen.print(f"unused: {', '.join(proposal.others)}")
        if proposal.lacking:
            screen.print(f"no column looks like {', '.join(proposal.lacking)}; if there is one, name it in the map")
    if proposal.without_drive:
        screen.print(
            "no column looks like a drive signal (throttle, motor_current, drive_force or ax_cmd), "
            "which single_track needs"
        )
    if proposal.left_assumed:
        turning = ", ".join(proposal.left_assumed)
        screen.print(
            f"nothing in the file shows whether left is positive: check the signs of {turning} in a turn "
            "of known direction"
        )
    for finding in proposal.findings:
        sentence = finding.sentence.removeprefix(f"{finding.where.channel}: ")
        channel = "" if sentence.startswith(finding.where.channel) else f"{finding.where.channel}: "
        screen.print(f"{finding.severity.value}: {channel}{sentence}")
    undecided = {entry.signal for entry in proposal.open}
    if undecided:
        screen.print(
            f"{counted(len(undecided), 'signal')} marked ? above must be decided: {', '.join(sorted(undecided))}. In "
            "the "
            "column map, choose one of the lines that begin with #? and remove its #?."
        )
    if out:
        joined = f"join {proposal.file} --columns {out} --out drive.csv"
        then = joined if proposal.files else f"check {proposal.file} --columns {out}"
        screen.print(f"written  {out}; then: greybox data {then}")


def proposal_as_dict(proposal: Proposal, out: str | None) -> dict[str, Any]:
    """A proposed column map as plain data."""
    return {
        "path": proposal.file,
        "written": out,
        "time": _as_dict(proposal.time) if proposal.time else None,
        "rate_hz": proposal.rate or None,
        "runs": proposal.run or None,
        "signals": [_as_dict(entry) for entry in proposal.entries],
        "others": list(proposal.others),
        "left_assumed": list(proposal.left_assumed),
        "findings": [{"kind": f.kind, "channel": f.where.channel, "sentence": f.sentence} for f in proposal.findings],
    }


def _row(entry: MapEntry) -> tuple[str, str, str, str]:
    unit = entry.unit if entry.decided else " or ".join(entry.units or (entry.unit,)) or "?"
    if entry.divide_by != 1.0:
        unit += f" · {entry.divide_by:g}"
    return (
        ("" if entry.decided else "? ") + entry.signal,
        entry.column,
        ("− " if entry.sign < 0 else "") + unit,
        ("; ".join(entry.reasons)),
    )


def _as_dict(entry: MapEntry) -> dict[str, Any]:
    return {
        **attributes(entry, "signal", "column"),
        "unit": entry.unit or None,
        **attributes(entry, "units", "sign", "divide_by"),
        "sign_column": entry.sign_column or None,
        "negative": entry.negative if entry.sign_column else None,
        **attributes(entry, "missing", "decided", "reasons"),
    }
