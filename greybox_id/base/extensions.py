"""What installed packages bring by entry points: the laboratory's commands and recordings, other people's models.

An entry point is looked up when its group is first needed and loaded when it is used, so that nobody waits for it.
"""

from __future__ import annotations

from functools import cache
from typing import Any

COMMANDS = "greybox.commands"
"""Tables of commands: heading -> command -> (module, line of help), as `cli/commands.py` has its own."""
RECORDINGS = "greybox.recordings"
"""Tables of synthetic recordings: name -> (what it is, function of a folder and a seed that writes it)."""
EXPORTERS = "greybox.exporters"
"""What writes results that are no models for controllers elsewhere: `export/elsewhere.py`."""


@cache
def extensions(group: str) -> dict[str, Any]:
    """Name -> what the entry points of a group name, loaded; in the order of their names."""
    from importlib.metadata import entry_points

    return {point.name: point.load() for point in sorted(entry_points(group=group), key=lambda point: point.name)}
