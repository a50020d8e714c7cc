"""The report of breaks names what callers would notice, and nothing else."""

import importlib.util
from pathlib import Path

import pytest

griffe = pytest.importorskip("griffe", reason="griffe is not installed; make test installs it")
TABLE = "_PLACES = {'fit': 'api.fitting:fit', 'read': 'api.reading:read'}\n"


@pytest.fixture(scope="module")
def report():
    file = Path(__file__).parents[2] / ".ci" / "api_breaks.py"
    spec = importlib.util.spec_from_file_location("api_breaks", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _package(folder, fit):
    room = folder / "greybox_id" / "api"
    room.mkdir(parents=True)
    for file in (room / "__init__.py", room.parent / "__init__.py"):
        file.write_text("", encoding="utf-8")
    (room / "fitting.py").write_text(fit + "\n\ndef helper(a): ...\n", encoding="utf-8")
    return griffe.load("greybox_id", search_paths=[folder], try_relative_path=False)


def test_a_parameter_that_is_gone_and_a_name_that_is_gone_are_reported(report, tmp_path):
    old = _package(tmp_path / "old", "def fit(model, data, jobs=1): ...")
    new = _package(tmp_path / "new", "def fit(model, data): ...")
    said = report.breaks(TABLE, TABLE.replace(", 'read': 'api.reading:read'", ""), old, new)
    assert said[0] == "gb.read is no longer at the top level"
    assert len(said) == 2
    assert said[1].startswith("gb.fit: parameter was removed, [positional or keyword] jobs")


def test_the_same_is_no_break(report, tmp_path):
    old, new = (_package(tmp_path / name, "def fit(model): ...") for name in ("one", "two"))
    assert report.breaks(TABLE, TABLE, old, new) == []
