"""Pages of docs/ as blocks, and running them as a reader would."""

import re
import shlex
import shutil
import subprocess
import textwrap
from dataclasses import dataclass
from pathlib import Path

import pytest
from calling import greybox

DOCS = Path(__file__).parents[2] / "docs"
NUMBER = re.compile(r"[-−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
FILE = re.compile(r"(?:#|//) (\S+\.(?:toml|c))\n")


@dataclass(frozen=True)
class Block:
    """One block of a page: its language, empty where it is only indented, and its text."""

    language: str
    text: str


def page(name):
    """The text of a page."""
    return (DOCS / name).read_text(encoding="utf-8")


def indented(text):
    """Blocks that are indented by four spaces."""
    return [Block("", textwrap.dedent(own)) for own in re.findall(r"(?:^ {4}.*\n|^\n(?= {4}))+", text, re.MULTILINE)]


def fenced(text):
    """Blocks between fences, with their language."""
    return [Block(*own) for own in re.findall(r"^```(\w+)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)]


def run_page(name):
    """Run every fenced block of a page in the working folder, in order; the names that its Python leaves."""
    names = {}
    for block in fenced(page(name)):
        if block.language == "python":
            exec(compile(block.text, f"docs/{name}", "exec"), names)
        elif block.language == "console":
            _run_console(block.text)
        else:
            (file,) = FILE.match(block.text).groups()
            Path(file).write_text(block.text, encoding="utf-8")
    return names


def _run_console(text):
    """Run each line after `$`, and find the lines below it in what it says, in order, whatever their figures."""
    for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
        line, *shown = part.splitlines()
        said = [_without_figures(own) for own in _said(shlex.split(line)).splitlines()]
        for wanted in (_without_figures(own) for own in shown if own != "..."):
            assert wanted in said, f"$ {line}\ndoes not say: {wanted}\nbut: {said}"
            said = said[said.index(wanted) + 1 :]


def _said(words):
    if words[0] == "greybox":
        called = greybox(*words[1:])
        assert called.code in (0, 3), called.err  # 3: written, and not usable, which a page may be about
        return called.err + called.out
    if words[0] == "gcc" and shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    return subprocess.run(words, check=True, capture_output=True, text=True).stdout


def _without_figures(line):
    return " ".join(NUMBER.sub("#", line).split())
