"""Recordings are found and told apart; what is wrong with one is its own affair."""

import math

import pandas as pd
import pytest

from greybox_id.base.errors import BadInput
from greybox_lab.fleet import manifest as manifest_module
from greybox_lab.fleet.manifest import entries
from greybox_lab.fleet.plan import plan_of


def fleet(folder, recordings, vehicle='"full_size_car"', files=("a.csv", "b.csv")):
    for k, name in enumerate(files):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(f"time\n{k}\n")
    text = f'recordings = "{recordings}"\nvehicle = {vehicle}\nsteps = ["check"]\n'
    (folder / "fleet.toml").write_text(text, encoding="utf-8")
    return plan_of(folder / "fleet.toml")


def test_places_in_a_pattern_are_vehicle_and_time(tmp_path):
    files = ("d/V1/2026-03-01.csv", "d/V2/2026-03-02.csv", "d/readme.csv")
    found = entries(fleet(tmp_path, "d/{vehicle}/{time}.csv", files=files))
    assert [(own.vehicle, own.time) for own in found] == [("V1", 1772323200.0), ("V2", 1772409600.0)]
    assert len({own.key for own in found}) == 2


def test_the_vehicle_file_is_that_of_the_name_then_of_the_first_pattern(tmp_path):
    for name in ("one", "two"):
        (tmp_path / f"{name}.toml").write_text(f'name = "{name}"\n[parameters]\nm = 1500.0\n')
    table = '{"V1*" = "one.toml", "V12" = "two.toml", "*" = "{vehicle}.toml"}'
    files = ("V11/a.csv", "V12/a.csv", "V9/a.csv")
    found = {own.vehicle: own for own in entries(fleet(tmp_path, "{vehicle}/a.csv", table, files))}
    assert found["V11"].vehicle_file.endswith("one.toml")
    assert found["V12"].vehicle_file.endswith("two.toml")
    assert "V9.toml" in found["V9"].problem
    assert not found["V11"].problem


def manifest(folder, *rows, kind="csv"):
    table = pd.DataFrame(rows)
    if kind == "csv":
        table.to_csv(folder / "m.csv", index=False)
    else:
        table.to_parquet(folder / "m.parquet")
    return fleet(folder, f"m.{kind}")


def test_a_manifest_says_when_and_at_which_odometer(tmp_path):
    row = {"path": "a.csv", "vehicle": "V1", "time": "2026-03-01T08:00:00+00:00", "odometer": "12 km", "tags": "wet"}
    (own,) = entries(manifest(tmp_path, row))
    assert (own.vehicle, own.time, own.odometer, own.tags) == ("V1", 1772352000.0, 12000.0, "wet")
    row = {"path": "a.csv", "vehicle": "V1", "time": pd.Timestamp("2026-03-01T08:00:00"), "odometer": 12000.0}
    (own,) = entries(manifest(tmp_path, row, kind="parquet"))
    assert (own.time, own.odometer) == (1772352000.0, 12000.0)


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ({"path": "missing.csv", "vehicle": "V1"}, "missing.csv cannot be read: No such file"),
        ({"path": "", "vehicle": "V1"}, "names no path"),
        ({"path": "b.csv", "vehicle": "V1", "time": "yesterday"}, "is not a date"),
        ({"path": "b.csv", "vehicle": "V1", "odometer": "12 kg"}, "kg"),
        ({"path": "b.csv", "vehicle": "V1", "odometer": "-3"}, "is not a distance"),
        ({"path": ".", "vehicle": "V1"}, ""),
    ],
)
def test_a_row_that_is_wrong_has_a_sentence_and_the_others_are_done(tmp_path, row, said):
    good, bad = entries(manifest(tmp_path, {"path": "a.csv", "vehicle": "V1", "time": "", "odometer": ""}, row))
    assert not good.problem
    assert math.isnan(good.time)
    assert said in bad.problem
    assert bool(bad.problem) == bool(said)


def test_a_recording_is_of_one_vehicle(tmp_path):
    rows = [{"path": "a.csv", "vehicle": own} for own in ("V1", "V2", "V1")]
    (own,) = entries(manifest(tmp_path, *rows))
    assert own.problem == "a.csv is listed for V1 and V2; a recording is of one vehicle."
    (tmp_path / "same.csv").write_text("time\n0\n")
    first, second = entries(
        manifest(tmp_path, {"path": "a.csv", "vehicle": "V1"}, {"path": "same.csv", "vehicle": "V2"})
    )
    assert not first.problem
    assert "same bytes as a.csv" in second.problem


def test_the_same_twice_is_one(tmp_path):
    assert len(entries(manifest(tmp_path, *[{"path": "a.csv", "vehicle": "V1"}] * 2))) == 1


def test_a_manifest_that_cannot_be_read_is_a_sentence(tmp_path):
    with pytest.raises(BadInput, match=r"m\.csv: the manifest cannot be read"):
        entries(fleet(tmp_path, "m.csv"))
    (tmp_path / "m.csv").write_bytes(b"path,vehicle\n\xff\xfe,1\n")
    with pytest.raises(BadInput, match="cannot be read"):
        entries(fleet(tmp_path, "m.csv"))
    (tmp_path / "m.csv").write_text("path,car\na.csv,V1\n")
    with pytest.raises(BadInput, match="not car"):
        entries(fleet(tmp_path, "m.csv"))
    (tmp_path / "m.parquet").write_bytes(b"PAR1 nothing")
    with pytest.raises(BadInput, match="cannot be read"):
        entries(fleet(tmp_path, "m.parquet"))


def test_no_recordings_is_a_sentence(tmp_path):
    with pytest.raises(BadInput, match="no recordings match"):
        entries(fleet(tmp_path, "*.mf4"))


def test_files_whose_size_and_date_are_known_are_not_read(tmp_path, monkeypatch):
    plan = fleet(tmp_path, "*.csv")
    first = entries(plan)
    known = {own.path: (own.size, own.changed, own.sha256) for own in first}
    monkeypatch.setattr(manifest_module, "hash_of", lambda file: pytest.fail(f"{file} was read"))
    assert [own.key for own in entries(plan, known)] == [own.key for own in first]
