"""Results as CSV, Parquet, MDF 4 and MCAP: opened again by the libraries that plotting tools use."""

import json
from pathlib import Path
from xml.etree import ElementTree

import asammdf
import numpy as np
import pandas as pd
import pytest
from calling import greybox, refused
from mcap.reader import make_reader

from greybox_id.base.errors import BadInput
from greybox_id.base.guard import content_of
from greybox_id.datasets.result_table import TOPIC, target_of, write_table
from greybox_id.models.registry import build

TABLE = pd.DataFrame(
    {
        "time": [0.0, 0.1, 0.2, 0.0, 0.1],
        "run": [1, 1, 1, 2, 2],
        "yaw_rate": [0.1, np.nan, 0.3, 0.4, 0.5],
        "yaw_rate_predicted": [0.11, 0.21, 0.31, 0.41, 0.51],
    }
)


def messages(path):
    with path.open("rb") as opened:
        reader = make_reader(opened)
        return [(message.log_time, json.loads(message.data)) for _, _, message in reader.iter_messages()]


def test_mdf_has_signals_units_and_a_clock_that_never_steps_back(tmp_path):
    write_table(TABLE, tmp_path / "p.mf4", "a table of predictions")
    with asammdf.MDF(tmp_path / "p.mf4") as opened:
        found = opened.get("yaw_rate_predicted")
        assert found.unit == "rad/s"
        np.testing.assert_array_equal(found.samples, TABLE["yaw_rate_predicted"])
        np.testing.assert_array_equal(opened.get("time").samples, TABLE["time"])
        assert np.all(np.diff(found.timestamps) > 0)


def test_mcap_has_a_message_a_row_with_its_schema(tmp_path):
    write_table(TABLE, tmp_path / "p.mcap", "a table of predictions")
    found = messages(tmp_path / "p.mcap")
    assert len(found) == len(TABLE)
    assert [told["yaw_rate_predicted"] for _, told in found] == TABLE["yaw_rate_predicted"].tolist()
    assert "yaw_rate" not in found[1][1]  # JSON knows no NaN
    assert np.all(np.diff([at for at, _ in found]) > 0)
    with (tmp_path / "p.mcap").open("rb") as opened:
        summary = make_reader(opened).get_summary()
    (schema,) = summary.schemas.values()
    assert json.loads(schema.data)["properties"]["yaw_rate"]["description"] == "rad/s"


@pytest.mark.parametrize("suffix", [".mf4", ".mcap", ".csv", ".parquet"])
def test_what_we_wrote_is_known_again_and_may_be_replaced(tmp_path, suffix):
    write_table(TABLE, tmp_path / f"p{suffix}", "a table of predictions")
    assert content_of(tmp_path / f"p{suffix}").words == "a table of predictions"
    assert content_of(tmp_path / f"p{suffix}").derived


def test_measurements_of_others_are_not_taken_for_results(tmp_path):
    with asammdf.MDF(version="4.10") as made:
        made.append([asammdf.Signal(np.arange(5.0), np.arange(5.0), "", "speed")])
        made.save(tmp_path / "own.mf4")
    assert not content_of(tmp_path / "own.mf4").derived


def test_other_kinds_are_refused():
    with pytest.raises(BadInput, match=r"\.csv, \.parquet, \.mf4 or \.mcap"):
        target_of("out.xlsx")


@pytest.mark.parametrize(("module", "file", "extra"), [("asammdf", "p.mf4", "mdf"), ("mcap.writer", "p.mcap", "mcap")])
def test_a_missing_extra_is_named_before_any_work(monkeypatch, module, file, extra):
    import sys

    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(BadInput, match=rf"pip install 'greybox-id\[{extra}\]'"):
        target_of(file)


def test_commands_write_them(tmp_path):
    from greybox_id.datasets.shipped import shipped

    lap = shipped("racer_train")
    asked = ("--columns", "roboracer")
    for suffix in ("csv", "mf4", "mcap"):
        out = tmp_path / f"s.{suffix}"
        called = greybox("simulate", "--model", "kinematic", "--vehicle", "roboracer", lap, *asked, "--out", out)
        assert called.code == 0, called.err
    ours = pd.read_csv(tmp_path / "s.csv")
    with asammdf.MDF(tmp_path / "s.mf4") as opened:
        np.testing.assert_allclose(opened.get("yaw_rate_simulated").samples, ours["yaw_rate_simulated"], rtol=1e-12)
    told = [row["yaw_rate_simulated"] for _, row in messages(tmp_path / "s.mcap")]
    np.testing.assert_allclose(told, ours["yaw_rate_simulated"], rtol=1e-12)
    again = ("simulate", "--model", "kinematic", "--vehicle", "roboracer", lap, *asked, "--out", tmp_path / "s.mf4")
    assert greybox(*again).code == 0
    assert "tables are written as" in refused(*again[:-1], tmp_path / "s.xlsx")


def test_layouts_in_the_documents_name_columns_that_there_are():
    docs = Path(__file__).parents[2] / "docs"
    foxglove = json.loads((docs / "foxglove_layout.json").read_text())
    named = [path["value"] for plot in foxglove["configById"].values() for path in plot["paths"]]
    juggler = [own.get("name") for own in ElementTree.parse(docs / "plotjuggler_layout.xml").iter("curve")]
    columns = {name.removesuffix("_simulated") for name in build("single_track").outputs}
    columns |= {f"{name}_simulated" for name in columns}
    assert {own.removeprefix(f"{TOPIC}.") for own in named} <= columns
    assert {own.removeprefix(f"{TOPIC}/") for own in juggler} <= columns
    assert len(named) == len(juggler) == 6
