"""Options that say which model is meant, shared by the commands that build one."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import click

from ..models import MODEL_NAMES
from .completion import names
from .options import VEHICLES, settings_of
from .own import named_effects, named_model

if TYPE_CHECKING:
    from ..choices.wanted import Wanted

Command = TypeVar("Command", bound=Callable[..., Any])


def _effects() -> Collection[str]:
    from ..models.effects import EFFECTS

    return EFFECTS


_MODEL = (
    click.option(
        "--model", "name", metavar="NAME", shell_complete=names(MODEL_NAMES), callback=named_model,
        help=f"One of {', '.join(MODEL_NAMES)}, or FILE.py:NAME, which is run; default: the vehicle's own.",
    ),
    click.option(
        "--vehicle", metavar="VEHICLE", shell_complete=VEHICLES,
        help="Numbers to start from: a shipped vehicle or a file.",
    ),
    click.option(
        "--set", "settings", multiple=True, metavar="NAME=VALUE",
        help="A hyperparameter, such as tyre=brush or lat.q=14.",
    ),
)  # fmt: skip
_EFFECTS = click.option(
    "--with", "effects", multiple=True, metavar="EFFECT[=VALUE]", shell_complete=names(_effects),
    callback=named_effects,
    help="Add an effect or FILE.py:NAME: free, held at a VALUE[unit], or free with a prior MEAN±SD[unit].",
)  # fmt: skip
_FIX = click.option(
    "--fix", multiple=True, metavar="NAME[=VALUE]",
    help="Hold a parameter where it stands or at a VALUE[unit]: m=3.5kg.",
)  # fmt: skip
_ESTIMATED = (
    click.option("--free", multiple=True, metavar="NAME", help="Estimate a parameter that is held otherwise."),
    click.option("--prior", multiple=True, metavar="NAME=MEAN±SD", help="Prior of a parameter: B_f=6±3 or B_f=6+-3."),
    click.option("--start", multiple=True, metavar="NAME=VALUE", help="Where a parameter's estimation starts."),
    click.option("--per-run", multiple=True, metavar="NAME", help="One value for each unbroken run."),
)


def model_options(command: Command) -> Command:
    """What a model to be fitted is made of."""
    return _with((*_MODEL, _EFFECTS, _FIX, *_ESTIMATED), command)


def simulated_model_options(command: Command) -> Command:
    """What a model to be simulated is made of."""
    return _with((*_MODEL, _EFFECTS, _FIX), command)


def wanted(
    name: str | None,
    vehicle: str | None,
    settings: Sequence[str],
    effects: Sequence[str],
    fix: Sequence[str],
    free: Sequence[str] = (),
    prior: Sequence[str] = (),
    start: Sequence[str] = (),
    per_run: Sequence[str] = (),
) -> Wanted:
    """What these options ask for."""
    from ..choices.parameters import Choices, magnitudes, wanted_vehicle
    from ..choices.wanted import Wanted

    choices = Choices(fix, free, prior, start, per_run)
    return Wanted(name, wanted_vehicle(vehicle), settings_of(settings), magnitudes(effects), choices)


def _with(options: Sequence[Callable[[Command], Command]], command: Command) -> Command:
    for option in reversed(options):
        command = option(command)
    return command
