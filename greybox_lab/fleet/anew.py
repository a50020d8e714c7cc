"""Recordings that an earlier run has done and that are done again since something else is asked of them: why."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from greybox_id.base.numbers import counted

from .manifest import FleetEntry

NOT_GIVEN = "not given"


def anew(
    todo: Sequence[FleetEntry], earlier: Mapping[str, tuple[str, str]], done: Collection[str], why: Sequence[str]
) -> str:
    """How many of the recordings to be done are as they were and were done before, and why they are done again.

    Parameters
    ----------
    todo : what is to be done.
    earlier : path -> hash and key of the last run's recordings.
    done : keys that have a result.
    why : what differs from the last run, as `differences` says it.

    Returns
    -------
    A sentence; "" where there are none.
    """
    count = 0
    for entry in todo:
        digest, key = earlier.get(entry.path, ("", ""))
        count += bool(entry.sha256) and entry.sha256 == digest and entry.key != key and key in done
    if not count:
        return ""
    verb = "is" if count == 1 else "are"
    reason = "; ".join(why) or "a vehicle file, or a recording's vehicle, is not what it was"
    return f"{counted(count, 'recording')} done by an earlier run {verb} done again: {reason}."


def origin_of(file: Path) -> dict[str, Any]:
    """What the last run was asked for; nothing where that cannot be read."""
    try:
        body = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return body if isinstance(body, dict) else {}


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """What is asked of every recording now and was not before, in words."""
    if not before:
        return []
    result = [
        _said(name, before.get(name), now[name]) for name in ("version", "steps") if before.get(name) != now[name]
    ]
    for step in now["steps"]:
        old, new = (_options(item, step) for item in (before, now))
        names = [name for name in sorted({*old, *new}) if old.get(name) != new.get(name)]
        result += [_said(f"[{step}] {name}", old.get(name), new.get(name)) for name in names]
    if before.get("columns") != now["columns"]:
        result.append(_said("columns", before.get("columns"), now["columns"]))
    elif before.get("map", now["map"]) != now["map"]:
        result.append(f"the column map {now['columns']} is not what it was")
    return result


def _options(origin: Mapping[str, Any], step: str) -> Mapping[str, Any]:
    options = origin.get("options")
    chosen = options.get(step) if isinstance(options, dict) else None
    return chosen if isinstance(chosen, dict) else {}


def _said(name: str, old: Any, new: Any) -> str:
    was, now = (NOT_GIVEN if item is None else json.dumps(item, ensure_ascii=False, default=str) for item in (old, new))
    return f"{name} was {was} and is {now}"
