"""Sentences name arguments, and a command line calls them by its options."""

import ast
import re
from pathlib import Path

from calling import greybox

from greybox_id.base.errors import BadInput

PACKAGE = Path(__file__).parents[2] / "greybox_id"
FLAG = re.compile(r"(?<![\w-])--[a-z]")
PARSED = ("synthetic_simrod/__main__.py", "synthetic_racer/__main__.py", "synthetic_simrod/__init__.py",
          "synthetic_racer/__init__.py", "export/target_c.py", "exam/calibrate.py",
          "reports/text/recordings.py")  # fmt: skip
"""Modules that have a command line, or write one for CMake."""


def literals(file):
    """Texts in a module that are no docstrings, with their lines."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    said = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in said:
            yield node.lineno, node.value


def test_no_sentence_of_the_library_names_an_option():
    files = {file.relative_to(PACKAGE).as_posix(): file for file in sorted(PACKAGE.rglob("*.py"))}
    found = {
        f"{name}:{line}": text
        for name, file in files.items() if not name.startswith("cli/") and not name.endswith(PARSED)
        for line, text in literals(file) if FLAG.search(text)
    }  # fmt: skip
    assert found == {}


def test_the_search_finds_options():
    assert FLAG.search("name it with --out.")
    assert not FLAG.search("a -- b, x--y, --- z")


def test_functions_and_options_call_an_argument_by_their_own_names():
    error = BadInput("Map it (‹columns›), or hand it over (‹own|models=›).")
    assert str(error) == "Map it (columns), or hand it over (models=)."
    assert error.said(lambda name: f"--{name}") == "Map it (--columns), or hand it over (--own)."


def test_the_command_line_names_its_options(tmp_path):
    file = tmp_path / "lap.csv"
    file.write_text("time,v_x\n" + "".join(f"{k / 10},{1 + k / 100}\n" for k in range(30)), encoding="utf-8")
    said = greybox("fit", "--model", "lateral", file, "--vehicle", "full_size_car").err
    assert "column map (--columns)" in " ".join(said.split())
