"""Proposing a column map: possible signals of a file's columns, and the evidence."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from ...base.errors import BadInput
from ...base.numbers import exact, number
from ...base.shorthands import Array
from ...base.signals import COMMANDS, DRIVE_SIGNALS, SIGNALS, unit_of
from ...base.toml_file import quoted
from ...base.units import DEGREES_AND_MINUTES, to_si
from ..alignment import aligned
from ..checks import Finding, Severity, check
from ..column_map import Column, ColumnMap
from ..formats import Contents, contents
from ..instants import is_instants
from ..joining import LONGEST, SHARE, join_files
from ..read import Part, contents_together, one_signal, read, read_together
from ..recording import Recording
from ..repair import column_fields, repaired
from .evidence import USUAL, MapEntry, met, with_signs, with_units
from .names import HAND_WHEEL, RUN, TIME, Guess, counts_clockwise, guess_in, is_north_of, of_a_tyre_rig, time_of
from .readings import by_gravity, in_no_unit, readings, with_codes
from .sign_columns import with_sign_columns
from .steering import with_steering
from .unknown_columns import SOUGHT, ambiguous, headings, strangers

MOSTLY = 0.8
"""Share of numeric cells from which a column is meant to be numeric."""
SIGNALS_OF = {HAND_WHEEL: "steer"}
MEASURED = "steer_measured"
ALIKE = 2.0
"""Largest ratio of a steering angle to its command in the same unit."""


@dataclass(frozen=True)
class Proposal:
    """A column map to be edited, with its open questions.

    Attributes
    ----------
    file : the file it is for.
    time : the clock; None if no column looks like one.
    rate : rows per second, Hz, as stated for a file without a clock; 0 for a file with one.
    files : the files, if several of one drive.
    entries : decided and open ones.
    others : unused columns with numbers.
    run : the column whose change begins a new run; empty if there is none.
    findings : warnings and worse about the recording as read through the decided entries.
    rig : whether it holds a tyre's slip angle, load and side force, and no vehicle's signals.
    """

    file: str
    time: MapEntry | None
    entries: tuple[MapEntry, ...]
    others: tuple[str, ...]
    run: str = ""
    rate: float = 0.0
    files: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    rig: bool = False

    @property
    def open(self) -> tuple[MapEntry, ...]:
        """Entries on which the user is asked."""
        return tuple(entry for entry in self.entries if not entry.decided)

    @property
    def lacking(self) -> tuple[str, ...]:
        """Signals that most models use and that no column seems to hold."""
        return tuple(name for name in SOUGHT if name not in {entry.signal for entry in self.entries})

    @property
    def left_assumed(self) -> tuple[str, ...]:
        """Signals whose signs were only checked against each other: no position shows which way is left."""
        taken = {entry.signal: entry.sign for entry in self.entries if entry.decided}
        if {"latitude", "longitude"} <= set(taken) or {"x", "y"} <= set(taken):
            return ()
        return tuple(name for name in taken if name != "curvature" and SIGNALS[name].mirrors)

    @property
    def without_drive(self) -> bool:
        """Whether no column looks like a drive signal."""
        return not any(entry.signal in DRIVE_SIGNALS for entry in self.entries)

    def mapping(self, name: str = "proposed", everything: bool = False) -> ColumnMap:
        """The decided entries as a column map; `everything` adds the first open one of each other signal."""
        time = self.time.as_column() if self.time else Column(TIME, "", "s", "s")
        chosen: dict[str, Column] = {}
        for entry in sorted(self.entries, key=lambda e: not e.decided):
            if entry.decided or everything:
                chosen.setdefault(entry.signal, entry.as_column())
        return ColumnMap(name, time, chosen, run_column=self.run, rate=self.rate, hold_stated=False)


def propose(path: str | Path | Sequence[str | Path], wheelbase: float | None = None, rate: float = 0.0) -> Proposal:
    """Propose a column map for a file, or for several files of one drive.

    Parameters
    ----------
    path : any file that `read` reads, or several that `data join` joins.
    wheelbase : in m, if known: it helps to interpret steering in degrees or of the hand wheel.
    rate : rows per second, Hz, of a file without a time column; 0 looks for that column.

    Raises
    ------
    BadInput
        A file cannot be read.
    """
    files = tuple(map(str, path)) if not isinstance(path, str | Path) else ()
    plain = ColumnMap("none", Column(TIME, TIME, "s", "s"), {})
    result = contents_together(files, plain) if len(files) > 1 else contents(Path(*(files or (str(path),))), plain)
    rig = of_a_tyre_rig(result.names)
    guesses = _guesses(result, rig)
    numbers, labels, texts = _numbers(result, guesses)
    numbers, codes = readings(result, guesses, numbers)
    clocks = [t for g in result.groups if (t := time_of(g, guesses, numbers, texts))] if not rate else []
    time = _one_time(result, clocks)
    run = next((n for n, guess in guesses.items() if guess.signal == RUN and (n in numbers or n in labels)), "")
    taken = {run, *(name for clock in clocks for name in (clock.column, clock.rest))}
    units = {name: unit for group in result.groups for name, unit in group.units.items()}
    stated = {name: guess.unit or units.get(name, "") for name, guess in guesses.items()}
    chosen, rivals = _candidates(guesses, stated, numbers, taken)
    chosen, rivals = ([with_codes(entry, codes) for entry in entries] for entries in (chosen, rivals))
    chosen = with_sign_columns(chosen, result, numbers, labels)
    rivals = [entry for entry in rivals if entry.column not in {known.sign_column for known in chosen}]
    used = taken | {name for entry in (*chosen, *rivals) for name in (entry.column, entry.sign_column)}
    others = tuple(name for name in numbers if name not in used)
    named = " ".join(files) if files else str(path)
    draft = Proposal(named, time, (*chosen, *rivals), others, run, rate, files if len(files) > 1 else (), rig=rig)
    if (time is None and not rate) or not chosen:
        open_ones = tuple(replace(e, decided=False, reasons=(*e.reasons, "nothing to check it with")) for e in chosen)
        return replace(draft, entries=(*open_ones, *rivals))
    raw = _raw(draft, chosen)
    chosen, raw = headings(chosen, guesses, raw)
    decided = _decided(chosen, raw, guesses, stated, numbers, wheelbase)
    if len(result.groups) == 1:
        unknown = [*rivals, *(MapEntry("", name, "", decided=False) for name in others if len(others) <= 40)]
        rivals = strangers(_in_si(raw, decided), unknown, numbers, {e.signal for e in decided if e.decided})
        rivals = [in_no_unit(with_codes(entry, codes)) for entry in rivals]
        others = tuple(name for name in others if name not in {entry.column for entry in rivals})
    if draft.files:
        decided, rivals = _shared(decided, rivals, guesses, result, draft)
    final = replace(draft, entries=(*decided, *rivals), others=others)
    return replace(final, findings=_findings(final, wheelbase))


def _guesses(result: Contents, rig: bool) -> dict[str, Guess]:
    """What columns may hold, by their names; of a tyre rig the time alone, as its forces are no vehicle's."""
    guesses = {name: value for group in result.groups for name in group.names if (value := guess_in(group, name))}
    if rig:
        return {name: guess for name, guess in guesses.items() if guess.signal == TIME}
    if not any(guess.signal in ("steer", HAND_WHEEL) for guess in guesses.values()):  # no command to go with it
        guesses = {n: replace(g, signal="steer") if g.signal == MEASURED else g for n, g in guesses.items()}
    return guesses


def _decided(
    chosen: Sequence[MapEntry],
    raw: Recording,
    guesses: Mapping[str, Guess],
    stated: Mapping[str, str],
    numbers: Mapping[str, Array],
    wheelbase: float | None,
) -> list[MapEntry]:
    """Entries with the units and signs for which channels agree; a question where several do."""
    present = [entry for entry in chosen if entry.signal in raw and np.isfinite(raw[entry.signal]).any()]
    hand_wheel = any(e.signal == "steer" and guesses[e.column].signal == HAND_WHEEL for e in present)
    decided = by_gravity(with_units(present, raw, wheelbase, hand_wheel), numbers)
    agreed, columns = met(_in_si(raw, decided)), {entry.signal: entry.column for entry in decided}
    compass = counts_clockwise(columns.get("yaw", ""))
    decided = with_signs(decided, agreed, compass, is_north_of(columns.get("x", ""), columns.get("y", "")))
    decided = [_asked(entry, guesses[entry.column], stated[entry.column]) for entry in decided]
    if compass and not any("yaw" in item.pair.channels for item in agreed):
        decided = [_of_a_compass(entry) if entry.signal == "yaw" else entry for entry in decided]
    decided = [
        _steering(e, decided, raw, hand_wheel, wheelbase, e.unit == stated[e.column] != "")
        if e.signal == "steer"
        else e
        for e in decided
    ]
    decided = [_as_commanded(entry, decided, raw) for entry in decided]
    return [ambiguous(entry, guesses[entry.column], raw) for entry in decided]


def _candidates(
    guesses: Mapping[str, Guess], stated: Mapping[str, str], numbers: Mapping[str, Array], taken: set[str]
) -> tuple[list[MapEntry], list[MapEntry]]:
    """The best-named column for each signal, and the others with a possible name."""
    by_signal: dict[str, list[str]] = {}
    for name, guess in guesses.items():
        if guess.signal not in (TIME, RUN) and name in numbers and name not in taken and np.any(numbers[name]):
            by_signal.setdefault(SIGNALS_OF.get(guess.signal, guess.signal), []).append(name)
    chosen, rivals = [], []
    for signal, names in by_signal.items():
        ordered = sorted(names, key=lambda n: (guesses[n].wish, guesses[n].signal == HAND_WHEEL, guesses[n].rank))
        for place, name in enumerate(ordered):
            unit = stated[name] if stated[name] and _fits(stated[name], signal) else ""
            reasons = [f'"{name}" is a usual name of {signal}' if name != signal else "the column has this name"]
            if stated[name] and not unit:
                reasons.append(f"the file says {stated[name]}, which is no unit of {signal}")
            entry = MapEntry(signal, name, unit, reasons=tuple(reasons))
            if place:
                other = f"{ordered[0]} is nearer by its name"
                rivals.append(replace(entry, decided=False, reasons=(*reasons, other)))
            else:
                chosen.append(entry)
    return chosen, rivals


def _as_commanded(entry: MapEntry, entries: Sequence[MapEntry], raw: Recording) -> MapEntry:
    """The measured steering, in the unit of the command that it follows."""
    steer = next((item for item in entries if item.signal == "steer" and item.decided), None)
    if entry.signal != MEASURED or entry.decided or steer is None:
        return entry
    rows = np.isfinite(raw[MEASURED]) & np.isfinite(raw["steer"])
    commanded, measured = raw["steer"][rows], raw[MEASURED][rows]
    gain = float(np.vdot(commanded, measured) / max(float(np.vdot(commanded, commanded)), 1e-300))
    if not 1 / ALIKE < abs(gain) < ALIKE:
        return entry
    why = f"unit: that of {steer.column}; this column is {number(gain, 2)} times as large"
    return replace(entry, unit=steer.unit, units=(), divide_by=steer.divide_by, sign=steer.sign, decided=True,
                   reasons=(entry.reasons[0], why))  # fmt: skip


def _of_a_compass(entry: MapEntry) -> MapEntry:
    """A heading whose sign is unknown and whose name is that of angles counted clockwise."""
    why = "sign: a compass counts clockwise, which is sign = -1; nothing in the file tells which this is"
    return replace(entry, sign=-1, decided=False, reasons=(*entry.reasons, why))


def _steering(
    entry: MapEntry,
    entries: Sequence[MapEntry],
    raw: Recording,
    hand_wheel: bool,
    wheelbase: float | None,
    stated: bool,
) -> MapEntry:
    """The entry of `steer` as `with_steering` decides; a question if it is one for any possible unit of v_x."""
    speeds = [e for e in entries if e.signal == "v_x"]
    others = [e for e in entries if e.signal != "v_x"]
    readings = [[replace(e, unit=unit)] for e in speeds for unit in (e.units or (e.unit,))] or [[]]
    known = (_in_si(raw, [*others, *reading]) for reading in readings)
    results = [with_steering(entry, recording, hand_wheel, wheelbase, stated) for recording in known]
    return next((result for result in results if not result.decided), results[0])


def _fits(unit: str, signal: str) -> bool:
    try:
        MapEntry(signal, "", unit).as_column().convert(np.ones(1))
    except BadInput:
        return False
    return True


def _one_time(result: Contents, clocks: Sequence[MapEntry]) -> MapEntry | None:
    """The clock of a file, or the common clock of several files, with its alternative names."""
    if not clocks or len(result.groups) == 1 or not isinstance(result.groups[0], Part):
        return clocks[0] if clocks else None
    named: dict[str, str] = {}
    for clock in clocks:
        named.setdefault(clock.column.partition("/")[2], clock.unit)
    first, *others = named
    units = tuple(named[name] for name in others) if len(set(named.values())) > 1 else ()
    rest = clocks[0].rest.partition("/")[2]
    return replace(clocks[0], column=first, otherwise=tuple(others), other_units=units, rest=rest)


SCALE = 1.3
"""Largest ratio of the scatter of two readings of one signal."""


def _shared(
    decided: list[MapEntry], rivals: list[MapEntry], guesses: Mapping[str, Guess], result: Contents, draft: Proposal
) -> tuple[list[MapEntry], list[MapEntry]]:
    """The entries, with both names for a signal that the first file and another share: it aligns their clocks."""
    first = result.groups[0]
    parts = {name: group for group in result.groups if isinstance(group, Part) for name in group.names}
    entries, left = [], list(rivals)
    for entry in decided:
        for rival in rivals:
            both = [parts.get(rival.column), parts.get(entry.column)]
            measured = entry.signal not in COMMANDS and not guesses[rival.column].wish
            if rival.signal == entry.signal and measured and first in both and both[0] is not both[1]:
                candidates = [entry] if entry.decided else [_in_its(entry, unit) for unit in entry.units if rival.unit]
                found = [(one, _alike_unit(one, rival, parts, draft.mapping())) for one in candidates]
                entry, unit = next((item for item in found if item[1]), (entry, ""))
                if unit:
                    why = (
                        f"{rival.column} holds the same signal, in {unit}: comparing both columns shows the offset "
                        f"between their clocks"
                    )
                    entry = replace(
                        entry, otherwise=(*entry.otherwise, rival.column), reasons=(*entry.reasons, why),
                        other_units=(*(entry.other_units or (entry.unit,) * len(entry.otherwise)), unit),
                    )  # fmt: skip
                    left.remove(rival)
        entries.append(entry if set(entry.other_units) - {entry.unit} else replace(entry, other_units=()))
    return entries, left


def _in_its(entry: MapEntry, unit: str) -> MapEntry:
    """An entry with an undecided unit, decided by another file's column."""
    return replace(entry, unit=unit, units=(), decided=True, reasons=entry.reasons[:-1])


def _alike_unit(entry: MapEntry, rival: MapEntry, parts: Mapping[str, Part], mapping: ColumnMap) -> str:
    """The unit in which a column equals another one on a different clock; empty if there is none."""
    times, values = one_signal(parts[entry.column], entry.as_column(), mapping)
    for unit in (rival.unit,) if rival.unit else USUAL.get(SIGNALS[entry.signal].unit, (entry.unit,)):
        column = replace(rival, unit=unit, sign=entry.sign).as_column()
        others, beside = one_signal(parts[rival.column], column, mapping)
        scale = float(np.std(beside)) / max(float(np.std(values)), 1e-300) if len(beside) and len(values) else 0.0
        longest = min(LONGEST, SHARE * float(min(np.ptp(times), np.ptp(others)))) if scale else 0.0
        if 1 / SCALE < scale < SCALE and aligned(times, values, others, beside, longest) is not None:
            return unit
    return ""


def _joined(draft: Proposal, mapping: ColumnMap) -> Recording:
    """The file as read, or the files joined with their clocks aligned."""
    return join_files(draft.files, mapping)[0] if draft.files else read(draft.file, mapping)


def _raw(draft: Proposal, chosen: Sequence[MapEntry]) -> Recording:
    """The signals in the file's units: factor 1, sign 1."""
    columns = {e.signal: e.as_column() for e in chosen}
    plain = {
        signal: replace(
            column, unit=column.unit if column.unit == DEGREES_AND_MINUTES else column.si_unit, scale=1.0, optional=True
        )
        for signal, column in columns.items()
    }
    mapping = replace(draft.mapping(), signals=plain)
    return read_together(draft.files, mapping) if draft.files else read(draft.file, mapping)


def _in_si(raw: Recording, entries: Sequence[MapEntry]) -> Recording:
    return raw.with_signals(**{e.signal: raw[e.signal] * e.factor * e.sign for e in entries})


def _asked(entry: MapEntry, guess: Guess, stated: str) -> MapEntry:
    """An entry as a question if its name means a command, or its stated unit does not fit."""
    if guess.wish and entry.signal in ("v_x", "v_y", "a_x", "a_y", "yaw_rate"):
        why = "its name says that it is a command, not a measurement"
        return replace(entry, decided=False, reasons=(*entry.reasons, why))
    if stated and not _fits(stated, entry.signal):
        why = "set divide_by: how many of the file's units make one SI unit"
        if entry.signal.startswith("wheel_speed") and (rim := _of_the_rim(stated)):
            why = f"it is the speed of the wheel's rim: divide_by is {rim} the wheel's radius in m"
        return replace(entry, decided=False, reasons=(*entry.reasons, why))
    return entry


def _of_the_rim(stated: str) -> str:
    """Factor on the radius for a wheel speed in a unit of speed, in words; empty for other units."""
    return f"{1 / to_si(stated, 'm/s').factor:.4g} times" if _fits(stated, "v_x") else ""


def _findings(proposal: Proposal, wheelbase: float | None) -> tuple[Finding, ...]:
    clocked = proposal.rate or (proposal.time and proposal.time.decided)
    if not any(entry.decided for entry in proposal.entries) or not clocked:
        return ()
    result = [
        item for item in check(_joined(proposal, proposal.mapping()), wheelbase) if item.severity is not Severity.NOTE
    ]
    known = {item.sentence for item in result}
    decided = {entry.signal for entry in proposal.entries if entry.decided}
    if proposal.open:  # exchanged columns can be recognised whatever the units of the open ones
        for item in check(_joined(proposal, proposal.mapping(everything=True)), wheelbase):
            exchanged = any(source != name for name, (source, *_) in item.repair.items())
            if exchanged and set(item.repair) <= decided and item.sentence not in known:
                result.append(item)
    return tuple(result)


def _numbers(result: Contents, guesses: Mapping[str, Guess]) -> tuple[dict[str, Array], set[str], set[str]]:
    """Numeric columns, other columns, and those of the latter with dates or clock times; of files with many groups only
    the columns with a known name.
    """
    numbers: dict[str, Array] = {}
    labels, texts = set[str](), set[str]()
    for group in result.groups:
        few = len(result.groups) == 1 or isinstance(group, Part)
        target = [name for name in group.names if few or name in guesses]
        table = group.load(target) if target else None
        for name in table.names if table else ():
            try:
                assert table is not None
                numbers[name] = table.numbers(name)
            except (BadInput, TypeError, ValueError):
                cells = pd.to_numeric(table.column(name).dropna(), errors="coerce") if table is not None else None
                if name in guesses and cells is not None and cells.notna().mean() > MOSTLY:
                    raise
                labels.add(name)
                if table is not None and is_instants(table.column(name)):
                    texts.add(name)
    return numbers, labels, texts


WIDTH = 110


def as_toml(proposal: Proposal, name: str) -> str:
    """TOML text with decided entries in force and open ones commented out."""
    lines = [
        *_comment(f"A column map for {proposal.file}, proposed from names, units and cross-checks."),
        "# Lines that begin with #? are questions: remove the #? from the right one and complete it.",
        "# Signs: x forward, y left, z up; yaw rate and steering are positive to the left. Comparing channels shows "
        "whether they",
        "# agree with each other, not which way is left: check one turn that you know.",
        "",
        f"name = {quoted(name)}",
        '#? hold = "zero"    # commanded: steering and drive keep their value from one row to the next',
        '#? hold = "linear"  # measured: they are linear between rows. Without hold, both are compared.',
    ]
    if proposal.rate:
        lines.append(f"rate = {proposal.rate:g}  # rows per second: the file has no time")
    if not proposal.rate:
        lines += ["", "[time]", *_time(proposal.time)]
    if proposal.run:
        lines += ["", f"[runs]  # a change begins a new run\ncolumn = {quoted(proposal.run)}"]
    lines += ["", "[signals]"]
    for entry in sorted(proposal.entries, key=lambda item: (list(SIGNALS).index(item.signal), not item.decided)):
        lines += ["", *_signal(entry)]
    lines += _proposed_repair(proposal)
    if proposal.others:
        listed, lacking = ", ".join(proposal.others), proposal.lacking
        which = "If one of them is a signal below, name it there. " if lacking or proposal.without_drive else ""
        lines += ["", *_comment(f"Unused columns: {listed}. {which}What else you want to keep goes under [extra].")]
        lines += [f'#? {signal} = {{ column = "...", unit = {quoted(unit_of(signal))} }}' for signal in lacking]
    if proposal.without_drive:
        lines += ["# single_track and longitudinal need a drive: throttle, or motor_current in A, drive_force in N,"]
        lines += ["#   ax_cmd in m/s^2.", '#? throttle = { column = "...", unit = "%" }']
    return "\n".join(lines) + "\n"


def _proposed_repair(proposal: Proposal) -> list[str]:
    """Changes proposed by the check, as lines to replace those above."""
    if not proposal.findings or not (proposal.time or proposal.rate):
        return []
    mapping = proposal.mapping()
    better = repaired(mapping, proposal.findings)
    if better is None:
        return []
    changed = [signal for name, signal in better.mapping.signals.items() if signal != mapping.signals[name]]
    known = next(finding.sentence for finding in proposal.findings if finding.repair)
    return [
        "",
        *_comment(f"Repair: {known}"),
        "# Take these lines in place of those of the same name, or let greybox data check repair the map.",
        *(f"#? {item.signal} = {{ {', '.join(column_fields(item))} }}" for item in changed),
    ]


def _time(time: MapEntry | None) -> list[str]:
    if time is None:
        return ['#? column = "..."  # no column looks like a time', '#? unit = "s"', "#? rate = 20  # or rows a second"]
    unit = time.as_column().unit_field if time.decided else f'#? unit = "{time.units[0]}"'
    names = [quoted(name) for name in (time.column, *time.otherwise)]
    column = f"column = [{', '.join(names)}]" if time.otherwise else f"column = {names[0]}"
    return [*_comment("; ".join(time.reasons)), column, *time.as_column().rest_fields, unit]


def _signal(entry: MapEntry) -> list[str]:
    mark = "" if entry.decided else "#? "
    units = (entry.unit,) if entry.unit and not entry.units else entry.units or (unit_of(entry.signal),)
    return [*_comment("; ".join(entry.reasons)), *(f"{mark}{entry.signal} = {_table(entry, unit)}" for unit in units)]


def _table(entry: MapEntry, unit: str) -> str:
    names = [quoted(name) for name in (entry.column, *entry.otherwise)]
    column = replace(entry, unit=unit).as_column()
    parts = [f"column = {names[0] if len(names) == 1 else '[' + ', '.join(names) + ']'}", column.unit_field]
    if entry.sign != 1:
        parts.append(f"sign = {entry.sign}")
    if entry.ends:
        low, centre, high = (exact(end, 6) for end in entry.ends)
        parts.append(f"lookup = [[{low}, {centre}, {high}], [..., 0, ...]]")
    parts += column.sign_fields + column.missing_fields
    if entry.divide_by != 1.0:
        parts.append(f"divide_by = {entry.divide_by:g}")
    return f"{{ {', '.join(parts)} }}"


def _comment(text: str) -> Sequence[str]:
    printable = "".join(c if c.isprintable() else " " for c in text)
    return textwrap.wrap(printable, WIDTH, initial_indent="# ", subsequent_indent="#   ")
