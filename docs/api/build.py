"""Pages of docs/api/, one for every name of `greybox_id.__all__`, made of their docstrings.

`python docs/api/build.py` writes them; with --check it says what is missing in a docstring or out of date in a
page, and exits with 1.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import greybox_id as gb

HERE = Path(__file__).parent
SECTION = re.compile(r"^(\w[\w ]*)\n(-{3,})$", re.MULTILINE)


def pages() -> dict[str, str]:
    """File name -> text."""
    names = list(gb.__all__)
    lines = ["# The top level, `import greybox_id as gb`", "", "| name | what it is |", "|---|---|"]
    for name in names:
        first = (inspect.getdoc(getattr(gb, name)) or "").split("\n\n")[0].replace("\n", " ").replace("|", "\\|")
        lines.append(f"| [`gb.{name}`]({name}.md) | {first} |")
    return {"README.md": "\n".join(lines) + "\n"} | {f"{name}.md": page(name) for name in names}


def page(name: str) -> str:
    """The page of one name."""
    thing = getattr(gb, name)
    parts = [f"# `gb.{name}`", *entry(name, thing)]
    if inspect.isclass(thing):
        for inner, member in members(thing):
            parts += [f"## `{inner}{signature(member)}`", *body(inspect.getdoc(member) or "", 3)]
    if isinstance(thing, ModuleType):
        for inner in thing.__all__:
            member = getattr(thing, inner)
            parts += [f"## `gb.{name}.{inner}{signature(member)}`", *body(inspect.getdoc(member) or "", 3)]
    return "\n\n".join(parts) + "\n"


def entry(name: str, thing: Any) -> list[str]:
    """Signature and docstring of a name itself."""
    head = [f"```python\ngb.{name}{signature(thing)}\n```"] if inspect.isfunction(thing) else []
    return [*head, *body(inspect.getdoc(thing) or "", 2)]


def members(own: type) -> Iterator[tuple[str, Any]]:
    """Public methods and properties with a docstring, inherited ones of this package too."""
    for name, member in inspect.getmembers(own):
        found = member.fget if isinstance(member, property) else getattr(member, "__func__", member)
        ours = inspect.isfunction(found) and found.__module__.startswith("greybox_id")
        if not name.startswith("_") and ours and found.__doc__:
            yield name, member if isinstance(member, property) else found


def signature(thing: Any) -> str:
    """What it is called with, by names; nothing for properties."""
    if not callable(thing) or inspect.isclass(thing):
        return ""
    shown = []
    for own in inspect.signature(thing).parameters.values():
        if own.name in ("self", "cls"):
            continue
        star = {own.VAR_POSITIONAL: "*", own.VAR_KEYWORD: "**"}.get(own.kind, "")
        if own.kind is own.KEYWORD_ONLY and "*" not in shown and not any(part.startswith("*") for part in shown):
            shown.append("*")
        default = "" if own.default is own.empty else f"={own.default!r}"
        shown.append(f"{star}{own.name}{default}")
    return f"({', '.join(shown)})"


def body(text: str, level: int) -> list[str]:
    """A docstring as Markdown: its sections as headings, names of parameters as a list, examples as code."""
    found = SECTION.split(text.strip())
    parts = [prose(found[0])]
    for title, _, inside in zip(found[1::3], found[2::3], found[3::3], strict=True):
        parts.append(f"{'#' * level} {title}")
        parts.append(code(inside) if title == "Examples" else listed(inside))
    return [part for part in parts if part]


def prose(text: str) -> str:
    """Paragraphs, their examples as code."""
    return "\n\n".join(
        f"```python\n{inspect.cleandoc(own)}\n```" if own.startswith("    ") else own.strip()
        for own in text.strip("\n").split("\n\n")
    )


def listed(text: str) -> str:
    """Lines "name : what it is", which may go on indented, as a list."""
    items: list[str] = []
    for line in text.strip("\n").splitlines():
        if not line.strip():
            continue
        if line.startswith(" ") and items:
            items[-1] += f" {line.strip()}" if ": " in items[-1] else f": {line.strip()}"
        else:
            name, colon, what = line.partition(" : ")
            items.append(f"- `{name}`: {what}" if colon else f"- {line}")
    return "\n".join(items)


def code(text: str) -> str:
    """An example."""
    return f"```pycon\n{text.strip()}\n```"


def lacking() -> list[str]:
    """What a docstring does not say: an example of every name; arguments, returns and errors of every function."""
    found = []
    for name in gb.__all__:
        thing = getattr(gb, name)
        text = inspect.getdoc(thing) or ""
        wanted = ["Examples"]
        if inspect.isfunction(thing):
            takes = bool(inspect.signature(thing).parameters)
            wanted += ["Returns", *(["Parameters", "Raises"] if takes else [])]
        found += [f"gb.{name}: no section {own}" for own in wanted if f"{own}\n{'-' * len(own)}" not in text]
    return found


def main() -> int:
    """Write or check the pages."""
    made = pages()
    wrong = lacking()
    if "--check" not in sys.argv:
        for file, text in made.items():
            (HERE / file).write_text(text, encoding="utf-8")
    there = {file.name for file in HERE.glob("*.md")}
    wrong += [f"docs/api/{file} is of no name" for file in sorted(there - set(made))]
    wrong += [
        f"docs/api/{file} is out of date: python docs/api/build.py"
        for file, text in made.items()
        if file not in there or (HERE / file).read_text(encoding="utf-8") != text
    ]
    for sentence in wrong:
        print(sentence, file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
