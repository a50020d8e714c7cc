"""The laboratory's commands, for the entry point `greybox.commands`; nothing is imported before one is called."""

from __future__ import annotations

GROUPS: dict[str, dict[str, tuple[str, str]]] = {
    "Gap": {
        "exam": ("greybox_lab.cli.exam", "Examine the diagnosis of gaps on cases whose true causes are hidden from it.")
    },
    "Deploy": {
        "import": (
            "greybox_lab.cli.import_",
            "Import a network saved by nnodely (as a fit), or a file of vehicle parameters.",
        )
    },
    "Fleet": {
        "fleet": (
            "greybox_lab.cli.fleet",
            "Fit thousands of recordings of many vehicles; find population, outliers and drift.",
        ),
    },
    "Race": {
        "loop": ("greybox_lab.cli.loop", "Let a learned driver adapt to its vehicle by the effects that gap names."),
        "serve": ("greybox_lab.cli.loop", "Serve vehicles that send rows, and learn policies for them."),
    },
    "This tool": {"app": ("greybox_lab.app.command", "Check, fit and diagnose a recording in a page of the browser.")},
    "Papers": {"bench": ("greybox_lab.cli.bench", "Reproduce tables of published papers.")},
}
"""Heading -> command -> module that holds it, and its line of help."""
