"""`greybox completion`: a shell learns the names of commands, options, models, effects, vehicles and column maps."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection
from glob import escape
from pathlib import Path

import click
from click.shell_completion import CompletionItem, get_completion_class

PROGRAM = "greybox"
SHELLS = ("bash", "zsh", "fish")
LOADED = "(( $+functions[compdef] )) || { autoload -Uz compinit && compinit }"
"""In zsh, what registers a completion is a function that not every set-up loads."""
Complete = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def names(known: Collection[str] | Callable[[], Collection[str]], files: str = "") -> Complete:
    """What completes an option that takes one of the known names, or a file of the working folder.

    Parameters
    ----------
    known : the names, or what tells them when they are wanted.
    files : ending of files that the option takes as well, such as .toml; empty where it takes none.
    """

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        del ctx, param
        there = known() if callable(known) else known
        result = [name for name in there if name.startswith(incomplete)]
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
        first, rest = script.split("\n", 1)  # "#compdef" has to stay the first line
        script = f"{first}\n\n{LOADED}\n{rest}"
    sys.stdout.write(script)
