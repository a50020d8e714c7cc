"""llms.txt and SKILL.md at the top of the repository, from the commands' own help, docs/json.md and docs/tasks.toml.

`python docs/agents.py` writes them, `--check` exits with 1 where one is not current.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import click

from greybox_id.base.version import __version__
from greybox_id.cli import greybox

DOCS = Path(__file__).parent
ROOT = DOCS.parent
GUIDE = [
    "tutorial",
    "recordings",
    "models",
    "own_model",
    "own_effect",
    "verdicts",
    "gap",
    "design",
    "tracking",
    "posterior",
    "adapt",
    "export",
    "reports",
    "fleets",
    "loop",
    "racing",
    "import",
    "json",
    "glossary",
    "mathematics",
    "architecture",
    "results",
]
HEAD = """---
name: greybox-id
description: Identify vehicle models from recordings with the greybox command, say whether a recording can be trusted,
  which unmodelled effect makes a simulation deviate from a vehicle, and export the model to a controller.
---

# greybox-id {version}

Call `greybox COMMAND ... --json`: one object on standard output, progress on standard error. Numbers are in SI units
unless a key beside them names the unit. Exit codes:

- 0: done
- 1: a check says no (`data check`, `gap --check`)
- 2: bad input; a sentence on standard error says what to do
- 3: written, but the fit is not usable

Check a recording before you fit it. Read `verdict` before estimates. An effect of a gap counts where `applied` lists
it; an unmodelled effect is an answer. Say how far a gap closes only with `--held-out`. `--overwrite` replaces
results, never recordings.

## Questions

| question | command (add `--json`) | key |
|---|---|---|
"""


def pages() -> dict[str, str]:
    """File name -> text."""
    return {"llms.txt": overview(), "SKILL.md": skill()}


def overview() -> str:
    """What there is to read, a line for each page."""
    lines = ["# greybox-id", "", f"> {about()}", "", "## Pages", ""]
    for name in GUIDE:
        title, first = opening((DOCS / f"{name}.md").read_text(encoding="utf-8"))
        lines.append(f"- [{title}](docs/{name}.md): {first}")
    lines += ["", "## Commands", "", *(f"- `{name}`: {line}" for name, _, line in commands()), ""]
    return "\n".join(lines)


def about() -> str:
    """The first paragraph of the README."""
    return (ROOT / "README.md").read_text(encoding="utf-8").split("\n\n")[1].replace("\n", " ")


def opening(text: str) -> tuple[str, str]:
    """Title and first sentence of a page."""
    title, _, rest = text.partition("\n")
    prose = next((part for part in rest.split("\n\n") if re.match(r"\n?[A-Za-z*`\[]", part)), "")
    first = re.split(r"(?<=[.:])\s", " ".join(prose.split()))[0]
    return title.removeprefix("# "), re.sub(r"\[([^\]]+)\]\([^)]+\)", r"\1", first)


def commands() -> Iterator[tuple[str, list[str], str]]:
    """Every command: its name, its options, and what it is for."""
    pending: list[tuple[str, click.Command]] = [("greybox", greybox)]
    while pending:
        name, command = pending.pop(0)
        context = click.Context(command, info_name=name)
        if isinstance(command, click.Group):
            inner = [(f"{name} {key}", command.get_command(context, key)) for key in command.list_commands(context)]
            pending += [(key, one) for key, one in inner if one is not None]
        else:
            options = [one.opts[-1] for one in command.params if isinstance(one, click.Option) and not one.hidden]
            text = (command.help or "").split("\n\n")[0]
            yield name, sorted(options), re.split(r"(?<=\.)\s", " ".join(text.split()))[0]


def skill() -> str:
    """Rules, questions, commands with their options and the keys of their JSON."""
    tasks = tomllib.loads((DOCS / "tasks.toml").read_text(encoding="utf-8"))["task"]
    lines = [HEAD.format(version=__version__).rstrip("\n")]
    lines += [f"| {one['question']} | `{one['command']}` | `{one['answer']}` |" for one in tasks]
    keys = json_keys((DOCS / "json.md").read_text(encoding="utf-8"))
    lines += ["", "## Commands", ""]
    for name, options, what in sorted(commands()):
        lines += [f"### {name}", "", what, "", f"Options: {', '.join(f'`{one}`' for one in options)}"]
        lines += ["", f"JSON: {', '.join(f'`{one}`' for one in keys[name])}"] if keys.get(name) else []
        lines.append("")
    return "\n".join(lines)


def json_keys(text: str) -> dict[str, list[str]]:
    """Command -> the keys that docs/json.md has for it, in order."""
    result: dict[str, list[str]] = {}
    for section in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        name = re.split(r",| [A-Z]", section.splitlines()[0])[0].strip()
        keys = re.findall(r"^\| `([^`]+)` \|", section, re.MULTILINE)
        result.setdefault(name, []).extend(key for key in keys if key not in result.get(name, []))
    return result


def main() -> int:
    """Write or check both files."""
    made = pages()
    if "--check" not in sys.argv:
        for name, text in made.items():
            (ROOT / name).write_text(text, encoding="utf-8")
        return 0
    stale = [name for name, text in made.items() if (ROOT / name).read_text(encoding="utf-8") != text]
    for name in stale:
        print(f"{name} is out of date: python docs/agents.py", file=sys.stderr)
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
