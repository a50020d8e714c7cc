"""Faults that `greybox data check` finds, and clean recordings that it distrusts.

    python benchmarks/checks.py [--json] [--clean 300] [--seeds results|NUMBER] [--only clean|power|bar|planted]

Every fault of benchmarks/checks_recordings.py is put into every recording that has the channels it spoils. It counts as
found where the recording is distrusted for something that it is not distrusted for without the fault; as named where a
sentence says what it is. Thresholds were chosen on the seeds "choice"; what is reported comes from others.
"""

from __future__ import annotations

import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

from checks_recordings import FAULTS, PLANTED, clean, possible, twelve, with_heading
from running import options, tell

from greybox_id.datasets.checks import Finding, Severity, check
from greybox_id.datasets.recording import Recording

SEEDS = {"choice": 100_000, "results": 400_000}
"""First seed of each set."""
KINDS = ("car", "racer", "truck", "sports")
"""Vehicles that the 31 faults are planted in."""
EVERY = 20
"""One clean recording in so many is spoilt by every fault that it can have."""


def main() -> None:
    """Run the benchmark."""
    given = options(
        __doc__, clean={"type": int, "default": 300, "help": "recordings with nothing wrong"},
        seeds={"default": "results", "help": "choice, results, or a first seed"},
        only={"choices": ("clean", "power", "bar", "planted"), "help": "one part of it"},
    )  # fmt: skip
    first = SEEDS[given.seeds] if given.seeds in SEEDS else int(given.seeds)
    found: dict[str, Any] = {}
    if given.only in (None, "clean"):
        found |= false_alarms(given.clean, first)
    if given.only in (None, "power"):
        found |= power(given.clean, first)
    if given.only in (None, "bar"):
        found |= bar()
    if given.only in (None, "planted"):
        found |= {"planted": [planted(kind, first + k) for k, kind in enumerate(KINDS)]}
    tell(found if given.json else dict(shown(found)), given.json)


def accusations(recording: Recording) -> list[Finding]:
    """What a recording is distrusted for."""
    return [finding for finding in check(recording) if finding.severity is Severity.DISTRUST]


def _new(recording: Recording, known: list[Finding]) -> list[Finding]:
    """What a recording is distrusted for beyond what it was without the fault."""
    keys = {(finding.kind, finding.where.channel, finding.where.run) for finding in known}
    return [own for own in accusations(recording) if (own.kind, own.where.channel, own.where.run) not in keys]


def false_alarms(count: int, first: int) -> dict[str, Any]:
    """Clean recordings that are distrusted."""
    alarms, seconds = [], 0.0
    for seed in range(first, first + count):
        recording = clean(seed)
        began = time.process_time()
        found = accusations(recording)
        seconds += time.process_time() - began
        alarms += [{"recording": recording.name, "sentences": [f.sentence for f in found]}] if found else []
        progress(f"{seed - first + 1} of {count} clean recordings, {len(alarms)} distrusted")
    return {"clean": count, "distrusted": alarms, "seconds": seconds}


def power(count: int, first: int) -> dict[str, Any]:
    """Faults in one clean recording of `EVERY`: found, named, tried."""
    cases: dict[str, list[int]] = defaultdict(lambda: [0, 0, 0])
    for seed in range(first, first + count, EVERY):
        recording = clean(seed)
        known = accusations(recording)
        for name, fault in FAULTS.items():
            if possible(fault, recording):
                new = _new(fault.apply(recording), known)
                named = any(fault.named(own.sentence) for own in new)
                cases[name] = [a + b for a, b in zip(cases[name], (bool(new), named, 1), strict=True)]
        progress(f"{seed - first + 1} of {count} clean recordings spoilt")
    return {"power": dict(cases)}


def progress(words: str) -> None:
    """How far it is, where somebody looks."""
    if sys.stderr.isatty():
        sys.stderr.write(words + "\n")


def bar() -> dict[str, Any]:
    """Faults in twelve recordings: which are found, and how the recordings stand without."""
    cases, before = [], []
    for recording in twelve():
        own = accusations(recording)
        before.append({"recording": recording.name, "sentences": [f.sentence for f in own]})
        for name, fault in FAULTS.items():
            if possible(fault, recording):
                new = _new(fault.apply(recording), own)
                named = any(fault.named(f.sentence) for f in new)
                cases.append({"recording": recording.name, "fault": name, "found": bool(new), "named": named,
                              "sentence": new[0].sentence if new else ""})  # fmt: skip
        progress(f"{recording.name} spoilt by {len(FAULTS)} faults")
    return {"before": before, "cases": cases}


def planted(kind: str, seed: int) -> dict[str, Any]:
    """The 31 faults in one drive: which are found, and of which the first finding names the cause."""
    recording = with_heading(kind, seed)
    known = {(item.kind, item.where.channel) for item in check(recording) if item.severity is not Severity.NOTE}
    missed, other = [], {}
    for name, fault in PLANTED.items():
        left = [item for item in check(fault.apply(recording)) if item.severity is not Severity.NOTE]
        new = [item for item in left if (item.kind, item.where.channel) not in known]
        if not new:
            missed.append(name)
        elif not fault.named(new[0].sentence):
            other[name] = new[0].sentence
    right = len(PLANTED) - len(missed) - len(other)
    return {"recording": recording.name, "faults": len(PLANTED), "found": len(PLANTED) - len(missed),
            "right_first": right, "missed": missed, "other_first": other, "without": len(known)}  # fmt: skip


def shown(found: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """For people."""
    if "clean" in found:
        yield "clean recordings distrusted", f"{len(found['distrusted'])} of {found['clean']}"
        yield "ms of the processor each", 1000 * found["seconds"] / found["clean"]
        yield "distrusted", found["distrusted"]
    yield "planted", found.get("planted", [])
    yield "without a fault", [own for own in found.get("before", []) if own["sentences"]]
    cases = found.get("cases", [])
    if cases or "power" in found:
        yield "faults", [_row(name, [own for own in cases if own["fault"] == name], found) for name in FAULTS]
    yield "all faults in twelve recordings", _counts(cases)


def _row(name: str, here: list[dict[str, Any]], found: dict[str, Any]) -> dict[str, Any]:
    hit, named, of = found.get("power", {}).get(name, (0, 0, 0))
    missed = [own["recording"] for own in here if not own["found"]]
    return {"fault": name, "12 recordings: found, named": _counts(here), "clean ones": f"{hit}, {named} of {of}",
            "missed in": missed}  # fmt: skip


def _counts(cases: list[dict[str, Any]]) -> str:
    return f"{sum(own['found'] for own in cases)}, {sum(own['named'] for own in cases)} of {len(cases)}"


if __name__ == "__main__":
    main()
