"""Docstrings of the top level say what they must, and the reference lists every name."""

import importlib.util
import re
from pathlib import Path

import pytest

import greybox_id as gb

DOCS = Path(__file__).parents[1] / "docs"


@pytest.fixture(scope="module")
def docstrings():
    spec = importlib.util.spec_from_file_location("docstrings", DOCS / "docstrings.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_docstring_says_what_goes_in_what_comes_out_and_what_is_refused(docstrings):
    assert docstrings.lacking() == []


def test_what_lacks_is_found(docstrings, monkeypatch):
    def score(model):
        """No sections at all."""

    monkeypatch.setattr(gb, "score", score)
    said = docstrings.lacking()
    assert [own for own in said if own.startswith("gb.score:")] == [
        f"gb.score: no section {own}" for own in ("Examples", "Returns", "Parameters", "Raises")
    ]


def test_the_reference_lists_every_name():
    page = (DOCS / "reference.md").read_text(encoding="utf-8").partition("## Models and effects of one's own")[0]
    listed = re.findall(r"^   (?:api\.)?(\w+)$", page, re.MULTILINE)
    assert sorted(listed) == sorted(gb.__all__)
