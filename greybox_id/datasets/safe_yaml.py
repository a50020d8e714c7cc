"""YAML of strangers: plain data of bounded size and depth, without aliases, tags or keys that are there twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..base.errors import BadInput
from ..base.files import small_file
from .formats.contents import needed

DEEPEST, MOST = 20, 20_000
"""Tables within tables, and entries in all."""


def read_yaml(path: str | Path) -> Any:
    """The data of a YAML file.

    Raises
    ------
    BadInput : it cannot be read, is no YAML, too large or too deep, holds aliases or tags, or PyYAML is not installed.
    """
    held = small_file(path, "parameter file")
    try:
        return parse_yaml(held.decode("utf-8-sig"), str(path))
    except UnicodeDecodeError as error:
        raise BadInput(f"{path}: not UTF-8 text; save it as UTF-8.") from error


def parse_yaml(text: str, where: str) -> Any:
    """The data of a YAML text. Raises `BadInput` as `read_yaml` does."""
    yaml = needed("yaml", "yaml", where, "YAML")
    try:
        _bounded(yaml.parse(text, Loader=yaml.SafeLoader), where, yaml)
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        _no_key_twice(node, where, yaml)
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f" (line {mark.line + 1})" if mark is not None else ""
        problem = " ".join(str(getattr(error, "problem", None) or "it is no valid text").split())
        raise BadInput(f"{where}: not valid YAML{place}: {problem:.100}. Mend that line.") from error
    except (ValueError, OverflowError, RecursionError) as error:  # dates that are none, numbers of thousands of digits
        raise BadInput(f"{where}: not valid YAML: {str(error) or 'a value cannot be read':.100}. Mend it.") from error


def _bounded(events: Any, where: str, yaml: Any) -> None:
    depth = 0
    for count, event in enumerate(events):
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            line = event.start_mark.line + 1
            raise BadInput(f"{where}: line {line}: anchors and aliases are not followed; write the value out.")
        if getattr(event, "tag", None):
            raise BadInput(f"{where}: line {event.start_mark.line + 1}: tags are not followed; take it out.")
        if isinstance(event, yaml.MappingStartEvent | yaml.SequenceStartEvent):
            depth += 1
        elif isinstance(event, yaml.MappingEndEvent | yaml.SequenceEndEvent):
            depth -= 1
        if depth > DEEPEST or count > MOST:
            raise BadInput(
                f"{where}: tables lie deeper than {DEEPEST} or there are more than {MOST} entries; that is no "
                "parameter file."
            )


def _no_key_twice(node: Any, where: str, yaml: Any) -> None:
    """A later key would replace an earlier one in silence."""
    if isinstance(node, yaml.MappingNode):
        seen = set()
        for key, value in node.value:
            if key.value.__hash__ is None or key.value in seen:
                raise BadInput(f"{where}: line {key.start_mark.line + 1}: a key is there twice or is none; mend it.")
            seen.add(key.value)
            _no_key_twice(value, where, yaml)
    elif isinstance(node, yaml.SequenceNode):
        for value in node.value:
            _no_key_twice(value, where, yaml)
