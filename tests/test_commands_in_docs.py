"""Every command that README and docs name is there, and knows the options it is given."""

import argparse
import importlib.util
import re
import shlex
import sys
from contextlib import suppress
from pathlib import Path
from unittest.mock import MagicMock

import click
import pytest
from documents import DOCS, fenced

from greybox_id.cli import greybox as root

HOUSE = DOCS.parent
PAGES = (HOUSE / "README.md", *sorted(DOCS.glob("*.md")), HOUSE / "examples" / "nmpc" / "README.md")
NOT_INSTALLED = ("nnodely", "torch")


def lines(program):
    """Page and words of every command line that starts with a program, comments left out."""
    for file in PAGES:
        text = file.read_text(encoding="utf-8")
        shown = re.findall(rf"^(?: {{4}}|\$ )(?:.* \| )?({program} .*)$", text, re.MULTILINE)
        for line in (*shown, *re.findall(rf"`({program} [^`]+)`", text)):
            words = shlex.split(line, comments=True)
            if not any(character in line for character in "…>"):
                yield pytest.param(words[1:], id=f"{file.name}: {' '.join(words)}")


class Parsed(Exception):
    """The options were understood."""


@pytest.mark.parametrize("words", list(lines("greybox")))
def test_greybox_knows_what_a_page_asks_of_it(words, tmp_path, monkeypatch, nothing_stays_known):
    monkeypatch.chdir(tmp_path)
    for file, name in re.findall(r"(\w+\.py):(\w+)", " ".join(words)):
        shown = [
            own.text for page in ("own_model.md", "own_effect.md") for own in fenced((DOCS / page).read_text("utf-8"))
        ]
        Path(file).write_text(next(own for own in shown if f"{name} = " in own and "import" in own), encoding="utf-8")
    command, context = root, click.Context(root, info_name="greybox")
    while isinstance(command, click.Group) and words:
        name, *words = words
        command = command.get_command(context, name)
        assert command is not None, name
    if words:
        with suppress(click.MissingParameter):  # what is said in passing need not be whole
            command.make_context(command.name, list(words))


@pytest.mark.parametrize("words", list(lines("python")))
def test_scripts_know_what_a_page_asks_of_them(words, monkeypatch):
    place, *options = words
    if place == "-m":
        assert importlib.util.find_spec(options[0]) is not None
        return
    script = HOUSE / place
    for name in NOT_INSTALLED:
        if importlib.util.find_spec(name) is None:
            monkeypatch.setitem(sys.modules, name, MagicMock(Tensor=type("Tensor", (), {})))  # SciPy asks for the class
    monkeypatch.setattr(sys, "path", [str(script.parent), *sys.path])
    parse = argparse.ArgumentParser.parse_args

    def parsed(parser, args=None, namespace=None):
        parse(parser, options, namespace)
        raise Parsed

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parsed)
    spec = importlib.util.spec_from_file_location(f"script_{script.stem}", script)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)  # dataclasses look their module up
    spec.loader.exec_module(module)
    with pytest.raises(Parsed):
        module.main()


def test_every_table_of_results_has_its_command_above_it():
    text = "".join(page.read_text(encoding="utf-8") for page in sorted(DOCS.glob("results*.md")))
    sections = re.split(r"^## ", text, flags=re.MULTILINE)[1:]
    assert len(sections) > 10
    for section in sections:
        table, command = section.find("\n|"), re.search(r"^ {4}(?:greybox|python) ", section, re.MULTILINE)
        assert table < 0 or (command is not None and command.start() < table), section.splitlines()[0]
