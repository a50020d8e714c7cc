"""The notebook goes from CSV to C in a dozen lines, and says what it says it does."""

import json
from pathlib import Path

import matplotlib as mpl
import pytest

NOTEBOOK = Path(__file__).parents[3] / "examples" / "notebook.ipynb"


def cells():
    """Text of every code cell, in order."""
    body = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    return ["".join(cell["source"]) for cell in body["cells"] if cell["cell_type"] == "code"]


def test_it_takes_a_dozen_lines():
    _, *own = cells()  # the first makes the recordings
    assert sum(bool(line.strip()) for cell in own for line in cell.splitlines()) <= 12


@pytest.mark.slow
def test_it_runs_and_closes_the_gap(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mpl.use("Agg")
    names = {}
    for cell in cells():
        exec(compile(cell, NOTEBOOK.name, "exec"), names)
    gap = names["gap"]
    assert "steering_delay" in gap.applied
    assert float(gap.closed_model["steering_delay"].value) == pytest.approx(0.06, abs=0.01)
    assert gap.held_out.closed > 0.8
    assert names["fit"].conf_int().loc["I_z"].notna().all()
    assert (tmp_path / "car" / "car.c").exists()
