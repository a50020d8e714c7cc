"""Options that several commands share, and conversion of their values: models, effects, vehicles, a fit.

`greybox completion`: completion of commands, options, models, effects, vehicles and column maps in a shell.
"""

from __future__ import annotations

import json
import re
import sys
from collections import abc
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from glob import escape
from inspect import signature
from pathlib import Path
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Any, Literal, Union, get_args, get_origin

import click
from click.shell_completion import CompletionItem, get_completion_class

from ..models import MODEL_NAMES
from .terminal import tell

if TYPE_CHECKING:
    from ..api.fit_result import FitResult
    from ..datasets.column_map import ColumnMap
    from ..datasets.recording import Recording
    from ..fitting.requested_model import RequestedModel

PROGRAM = "greybox"
SHELLS = ("bash", "zsh", "fish")
LOADED = "(( $+functions[compdef] )) || { autoload -Uz compinit && compinit }"
"""Loads the function of zsh that registers completions, which not every configuration loads."""
Complete = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def names(known: Collection[str] | Callable[[], Collection[str]], files: str = "") -> Complete:
    """Completion for an option that takes a known name or a file of the working folder.

    Parameters
    ----------
    known : the names, or a function that returns them.
    files : suffix of files that the option also accepts, such as .toml; empty if none.
    """

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        del ctx, param
        known_names = known() if callable(known) else known
        result = [name for name in known_names if name.startswith(incomplete)]
        if files:
            result += sorted(str(path) for path in Path().glob(f"{escape(incomplete)}*{files}") if path.is_file())
        return [CompletionItem(name) for name in result]

    return complete


@click.command()
@click.argument("shell", metavar="bash|zsh|fish", type=click.Choice(SHELLS))
@click.pass_context
def completion(ctx: click.Context, shell: str) -> None:
    """Print the script that makes a shell complete commands, options and names.

    \b
    greybox completion bash >> ~/.bashrc                                 # zsh: >> ~/.zshrc
    greybox completion fish > ~/.config/fish/completions/greybox.fish

    Open a new shell afterwards.
    """  # fmt: skip
    of_shell = get_completion_class(shell)
    assert of_shell is not None
    script = of_shell(ctx.find_root().command, {}, PROGRAM, f"_{PROGRAM.upper()}_COMPLETE").source()
    if shell == "zsh":
        first, rest = script.split("\n", 1)  # "#compdef" must remain the first line
        script = f"{first}\n\n{LOADED}\n{rest}"
    sys.stdout.write(script)


def _vehicles() -> tuple[str, ...]:
    from ..models.vehicle import shipped_vehicles

    return shipped_vehicles()


def _maps() -> tuple[str, ...]:
    from ..datasets.column_map import shipped_maps

    return shipped_maps()


Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]
FILE, PATH = click.Path(), click.Path(path_type=Path)
ABOVE_ZERO, FROM_ZERO, FROM_ONE = click.FloatRange(min=0, min_open=True), click.IntRange(min=0), click.IntRange(min=1)


@dataclass(frozen=True)
class Declared:
    """Declaration of an option or argument, used as the default of a parameter of a command's function.

    Attributes
    ----------
    made : name of the parameter and its type -> click's decorator.
    is_option : False for an argument.
    before, after : additional options, whose values are not parameters.
    """

    made: Callable[[str, Any], Decorator]
    is_option: bool = True
    before: tuple[Decorator, ...] = ()
    after: tuple[Decorator, ...] = ()


def option(help: str, metavar: str | None = None, *, name: str = "", default: Any = None, **more: Any) -> Any:
    """An option named like its parameter, or `name`; `more` is passed to click.

    The parameter's type determines whether it is a switch, can be repeated, is a number, or has fixed choices.
    """

    def made(parameter: str, kind: Any) -> Decorator:
        keywords = {"show_default": default not in (None, ""), **_of_type(kind, {"multiple": True}), **more}
        if keywords.get("is_flag") and "show_default" not in more:
            keywords["show_default"] = False
        keywords |= {} if default is None else {"default": default}
        return click.option(
            name or f"--{parameter.replace('_', '-')}", parameter, help=help or None, metavar=metavar, **keywords
        )

    return Declared(made)


def argument(metavar: str, **more: Any) -> Any:
    """An argument, which can be repeated if its parameter is a sequence; `more` is passed to click."""
    return Declared(
        lambda name, kind: click.argument(name, metavar=metavar, **_of_type(kind, {"nargs": -1}) | more), False
    )


def command(
    name: str, *, of: click.Group | None = None, cls: type[click.Command] | None = None, more: Sequence[Decorator] = ()
) -> Callable[[Callable[..., None]], click.Command]:
    """Make a command from a function whose parameters are declared by their defaults.

    Parameters
    ----------
    name : of the command.
    of : group of the command.
    cls : click's class of the command.
    more : further options, placed after the arguments and passed to the function's `**options`.
    """

    def decorated(function: Callable[..., None]) -> click.Command:
        options, arguments = list[Decorator](), list[Decorator]()
        for key, parameter in signature(function, eval_str=True).parameters.items():
            declared = parameter.default
            if isinstance(declared, Declared):
                made = declared.made(key, parameter.annotation)
                (options if declared.is_option else arguments).extend((*declared.before, made, *declared.after))
        callback: Callable[..., Any] = function
        for decorator in reversed((*arguments, *more, *options)):
            callback = decorator(callback)
        made = click.command(name, cls=cls)(callback)
        if of is not None:
            of.add_command(made)
        return made

    return decorated


def _of_type(kind: Any, several: dict[str, Any]) -> dict[str, Any]:
    """Settings of an option or argument that follow from the type of its parameter."""
    (kind,) = (
        [item for item in get_args(kind) if item is not NoneType] if get_origin(kind) in (Union, UnionType) else [kind]
    )
    if kind is bool:
        return {"is_flag": True}
    if get_origin(kind) is abc.Sequence:
        return several
    if get_origin(kind) is Literal:
        return {"type": click.Choice(get_args(kind))}
    return {"type": kind} if kind in (int, float) else {}


MOVED = "Name the file's new path as RECORDING."
"""Advice if a recording of a fit is not found, for commands with a recording as argument."""
VEHICLES = names(_vehicles, files=".toml")
"""Completion of names of vehicles."""
PART = "part of each recording"
"""Key under which a command stores --between and --where until recordings are read."""


def _kept(ctx: click.Context, option: click.Parameter, value: Any) -> None:
    ctx.meta.setdefault(PART, {})[option.name] = value


def _span(ctx: click.Context, option: click.Parameter, value: str | None) -> None:
    from ..base.condition import span
    from ..base.errors import BadInput

    try:
        _kept(ctx, option, None if value is None else span(value))
    except BadInput as error:
        raise click.BadParameter(str(error)) from error


CALIBRATE: Any = option(
    "Only models msnn_... and gnn: estimate the delay of the outputs in the first SECONDS (default: 5) of each "
    "new run, correct it, and score the rest of the run.",
    "timing[=SECONDS]",
)
_COLUMNS = option(
    "Column map, which says what each column holds and in which unit: a shipped name or a .toml file.", "MAP",
    default="canonical",
    shell_complete=names(_maps, files=".toml"),
)  # fmt: skip
COLUMNS: Any = replace(
    _COLUMNS,
    after=(
        click.option(
            "--between", metavar="START:STOP", callback=_span, expose_value=False,
            help="Use only the rows from START to STOP, in s; START or STOP may be omitted.",
        ),
        click.option(
            "--where", metavar="CONDITION", callback=_kept, expose_value=False,
            help='Use only the rows at which this condition holds, such as "v_x > 5 and abs(steer) < 0.1".',
        ),
    ),
)  # fmt: skip
"""How recordings are read: --columns, and --between and --where, which `read_part` applies."""


def read_part(file: str | Path, columns: str | Path | ColumnMap = "canonical") -> Recording:
    """A recording, restricted to the rows selected by --between and --where of the running command."""
    from ..datasets.read import read

    return part_asked(read(file, columns))


def part_asked(recording: Recording) -> Recording:
    """A recording restricted to the rows that the running command selects."""
    ctx = click.get_current_context(silent=True)
    requested = ctx.meta.get(PART, {}) if ctx is not None else {}
    between, where = requested.get("between"), requested.get("where")
    recording = recording if between is None else recording.between(*between)
    return recording if where is None else recording.where(where)


json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of text.")
JSON: Any = Declared(lambda name, annotation: json_option)
JOBS: Any = option("Number of parallel processes (on Linux).", type=click.IntRange(min=1), default=1)

WORD = re.compile(r"[A-Za-z_][\w-]*")
"""A setting that is a name, such as that of a tyre model."""


def settings_of(pairs: Sequence[str]) -> dict[str, Any]:
    """NAME=VALUE pairs as nested plain data: `lat.q=14` becomes {"lat": {"q": 14}}; values are JSON or single words."""
    result: dict[str, Any] = {}
    for pair in pairs:
        name, equals, text = pair.partition("=")
        if not equals or not name:
            raise click.UsageError(f"{pair!r} is not NAME=VALUE.")
        try:
            value = json.loads(text)
        except (ValueError, RecursionError) as error:
            if not WORD.fullmatch(text):
                raise click.UsageError(f"{pair!r}: {text!r} must be a number, word, true, false or [list].") from error
            value = text
        *groups, last = name.split(".")
        inner = result
        for group in groups:
            inner = inner.setdefault(group, {})
            if not isinstance(inner, dict):
                raise click.UsageError(f"{pair!r}: {group} is given as a value and as a group.")
        inner[last] = value
    return result


MARK = ".py:"
"""Distinguishes a place in a file from a name."""


def named_model(ctx: click.Context, param: click.Parameter, value: str | None) -> str | None:
    """The name of a model, or of the model in a file, which is registered."""
    del ctx, param
    if value is None or MARK not in value:
        return value
    from ..models.registry import own_model

    return own_model(value).name


def named_effects(ctx: click.Context, param: click.Parameter, values: Sequence[str]) -> tuple[str, ...]:
    """EFFECT[=VALUE] with names for effects in files, which are registered."""
    del ctx, param
    result = []
    for value in values:
        place, equals, magnitude = value.partition("=")
        if MARK in place:
            from ..models.registry import own_effect

            place = own_effect(place.strip()).name
        result.append(f"{place}{equals}{magnitude}")
    return tuple(result)


def named_effect(ctx: click.Context, param: click.Parameter, value: str | None) -> str | None:
    """The name of an effect, or of the effect in a file, which is registered."""
    return value if value is None else named_effects(ctx, param, [value])[0]


def _known(ctx: click.Context, param: click.Parameter, values: Sequence[str]) -> None:
    del ctx, param
    for value in values:
        from ..models.registry import own

        own(value)


JSON_AND_OWN: Any = replace(
    JSON,
    before=(
        click.option(
            "--own", multiple=True, metavar="FILE.py:NAME", expose_value=False, callback=_known, is_eager=True,
            help="Load your own model or effect NAME from FILE.py, such as one with which the fit was made. The file "
            "is executed.",
        ),
    ),
)  # fmt: skip


def _effects() -> Collection[str]:
    from ..models.effects import EFFECTS

    return EFFECTS


_MODEL = (
    click.option(
        "--model", "name", metavar="NAME", shell_complete=names(MODEL_NAMES), callback=named_model,
        help=f"Model: {', '.join(MODEL_NAMES)}; or your own, as FILE.py:NAME (the file is executed). "
        "Default: the model that the vehicle file names.",
    ),
    click.option(
        "--vehicle", metavar="VEHICLE", shell_complete=VEHICLES,
        help="Vehicle that gives the values of the parameters (in a fit: start values and priors): a shipped name or a "
        "vehicle file.",
    ),
    click.option(
        "--set", "settings", multiple=True, metavar="NAME=VALUE",
        help="Setting of the model, such as tyre=brush or lat.q=14; greybox models NAME lists its settings.",
    ),
)  # fmt: skip
_EFFECTS = click.option(
    "--with", "effects", multiple=True, metavar="EFFECT[=VALUE]", shell_complete=names(_effects),
    callback=named_effects,
    help="Add an effect, such as steering_delay=30ms, or your own as FILE.py:NAME. With VALUE its magnitude is fixed; "
    "without VALUE it is estimated; with MEAN±SD it is estimated with this prior.",
)  # fmt: skip
_FIX = click.option(
    "--fix", multiple=True, metavar="NAME[=VALUE]",
    help="Keep a parameter fixed at VALUE, as in m=3.5kg; without VALUE, at its present value.",
)  # fmt: skip
_ESTIMATED = (
    click.option("--free", multiple=True, metavar="NAME", help="Estimate a parameter that would otherwise be fixed."),
    click.option(
        "--prior",
        multiple=True,
        metavar="NAME=MEAN±SD",
        help="Prior of a parameter, its mean and standard deviation: B_f=6±3 or B_f=6+-3.",
    ),
    click.option(
        "--start",
        multiple=True,
        metavar="NAME=VALUE",
        help="Value of a parameter at which the solver starts, as in I_z=0.05.",
    ),
    click.option(
        "--per-run",
        multiple=True,
        metavar="NAME",
        help="Estimate one value of this parameter for each run; a new run begins after each gap in time.",
    ),
)


SIMULATED_MODEL = (*_MODEL, _EFFECTS, _FIX)
"""Options of a model to simulate."""
MODEL = (*SIMULATED_MODEL, *_ESTIMATED)
"""Options of a model to fit."""


def parameter_values(
    fix: Sequence[str] = (),
    free: Sequence[str] = (),
    prior: Sequence[str] = (),
    start: Sequence[str] = (),
    per_run: Sequence[str] = (),
) -> dict[str, Any]:
    """Options on parameters, as arguments of `gb.fit`."""
    from ..base.units import pairs  # not needed for --help

    return {
        "fix": pairs(fix, "NAME or NAME=VALUE, as in ‹fix› m=3.5kg", alone=True),
        "free": free,
        "prior": pairs(prior, "NAME=MEAN±SD, as in ‹prior› B_f=6±3"),
        "start": pairs(start, "NAME=VALUE, as in ‹start› I_z=0.05"),
        "per_run": per_run,
    }


def requested(
    name: str | None, vehicle: str | None, settings: Sequence[str], effects: Sequence[str], **of_parameters: Any
) -> RequestedModel:
    """The model that these options request."""
    from ..api import given  # not needed for --help, since it imports all models

    chosen = given.choices(**parameter_values(**of_parameters))
    return given.requested(name, vehicle, settings_of(settings), effects, chosen)


def fit_of(file: str | Path) -> FitResult:
    """The fit in a file, with a warning if its verdict is that it is not usable. Raises `BadInput`."""
    from ..api.fitting import load
    from ..fitting.fit import NOT_USABLE

    fit = load(file)
    if fit.verdict is not None and fit.verdict.usability == NOT_USABLE:
        tell(
            f'warning: the verdict on {file} is "{NOT_USABLE}", so results of this fit are not usable either. '
            f"Reason: {' '.join(fit.verdict.reasons[:1])}"
        )
    return fit
