"""docs/api/ has a page for every name of the top level, made of docstrings that say what they must."""

import importlib.util
from pathlib import Path

import pytest

import greybox_id as gb

PAGES = Path(__file__).parents[1] / "docs" / "api"


@pytest.fixture(scope="module")
def build():
    spec = importlib.util.spec_from_file_location("build_api_pages", PAGES / "build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_pages_are_up_to_date(build):
    made = build.pages()
    assert set(made) == {f"{name}.md" for name in gb.__all__} | {"README.md"}
    assert {file: text for file, text in made.items() if (PAGES / file).read_text(encoding="utf-8") != text} == {}
    assert {file.name for file in PAGES.glob("*.md")} == set(made)


def test_every_docstring_says_what_goes_in_what_comes_out_and_what_is_refused(build):
    assert build.lacking() == []


def test_what_lacks_is_found(build, monkeypatch):
    def score(model):
        """No sections at all."""

    monkeypatch.setattr(gb, "score", score)
    said = build.lacking()
    assert [own for own in said if own.startswith("gb.score:")] == [
        f"gb.score: no section {own}" for own in ("Examples", "Returns", "Parameters", "Raises")
    ]
