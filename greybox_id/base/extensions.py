"""Extensions by entry points of installed packages: commands, synthetic recordings, exporters.

A group's entry points are looked up and loaded when the group is first needed, so that nothing else waits for them.
"""

from __future__ import annotations

from functools import cache
from typing import Any

COMMANDS = "greybox.commands"
"""Tables of commands: heading -> command -> (module, line of help), as in `cli/commands.py`."""
RECORDINGS = "greybox.recordings"
"""Tables of synthetic recordings: name -> (what it is, function of a folder and a seed that writes it)."""
EXPORTERS = "greybox.exporters"
"""Exporters of results that are not models, such as learned controllers."""


@cache
def extensions(group: str) -> dict[str, Any]:
    """Name -> loaded object of each entry point of a group, sorted by name."""
    from importlib.metadata import entry_points

    return {point.name: point.load() for point in sorted(entry_points(group=group), key=lambda point: point.name)}
