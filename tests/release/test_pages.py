"""Pages that are made of something else are current."""

import importlib.util
import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def _module(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_results_are_drawn_from_what_was_measured():
    build = _module(DOCS / "results" / "build.py")
    shown = 0
    for page, text in build.pages().items():
        assert page.read_text(encoding="utf-8") == text, "python docs/results/build.py"
        assert len(text.encode()) < 12_000
        shown += text.count("\n## ")
    assert shown == len(list((DOCS / "results").glob("*.json")))


@pytest.mark.parametrize("file", sorted((DOCS / "results").glob("*.json")), ids=lambda file: file.stem)
def test_every_table_says_what_was_measured_when_with_which_version_and_on_how_many(file):
    kept = json.loads(file.read_text(encoding="utf-8"))
    assert {"version", "date", "seed", "n"} <= set(kept["measured"])
    assert kept["commands"]
    if "rows" in kept:
        assert {len(row) for row in kept["rows"]} == {len(kept["columns"])}


def test_a_bench_becomes_a_table():
    build = _module(DOCS / "results" / "build.py")
    row = {
        "task": "t",
        "model": "m",
        "value": 0.5,
        "unit": "mm",
        "spread": 0.1,
        "cpu_seconds": None,
        "published": True,
        "parameters": 4,
    }
    kept = {
        "title": "T",
        "about": "",
        "commands": ["greybox bench t"],
        "measured": {"date": "", "version": "", "seed": 0, "n": 1},
    }
    made = build.section(build.of_bench({**kept, "result": {"rows": [row], "answers": ["So."]}}))
    assert "| m, 4 parameters (published) | 0.500 ± 0.10 | – |" in made
    assert "| model | t [mm] | CPU s |" in made


def test_what_agents_read_is_made_of_help_and_json_pages():
    agents = _module(DOCS / "agents.py")
    made = agents.pages()
    assert {name: (ROOT / name).read_text(encoding="utf-8") == text for name, text in made.items()} == {
        "llms.txt": True,
        "SKILL.md": True,
    }, "python docs/agents.py"


def test_the_skill_has_every_command_its_options_and_its_keys():
    skill = (ROOT / "SKILL.md").read_text(encoding="utf-8")
    section = skill[skill.index("### greybox gap\n") :].split("\n### ")[0]
    for word in ("--held-out", "--since", "JSON: ", "ranking"):
        assert word in section
