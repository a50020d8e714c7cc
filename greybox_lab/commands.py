"""The laboratory's commands, for the entry point `greybox.commands`; nothing is imported before one is called."""

from __future__ import annotations

GROUPS: dict[str, dict[str, tuple[str, str]]] = {
    "Gap": {
        "exam": (
            "greybox_lab.cli.exam",
            "Test how well greybox gap finds the causes of deviations, on cases whose causes are hidden from it.",
        )
    },
    "Deploy": {
        "import": (
            "greybox_lab.cli.import_",
            "Import a network saved by nnodely, or a file of vehicle parameters.",
        )
    },
    "Fleet": {
        "fleet": (
            "greybox_lab.cli.fleet",
            "Fit thousands of recordings of many vehicles; find unusual vehicles and changes over time.",
        ),
    },
    "Race": {
        "loop": (
            "greybox_lab.cli.loop",
            "Train a driving policy in simulation, and correct the simulation with the effects that greybox gap finds.",
        ),
        "serve": (
            "greybox_lab.cli.loop",
            "Run a server that receives samples from vehicles and sends them driving policies.",
        ),
    },
    "This tool": {"app": ("greybox_lab.app.command", "Check, fit and diagnose recordings in the browser.")},
    "Papers": {"bench": ("greybox_lab.cli.bench", "Reproduce tables of published papers.")},
}
"""Heading -> command -> module that holds it, and its line of help."""
