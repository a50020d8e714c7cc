"""Reading: what is in the file arrives in SI units, and what is wrong with it is said in a sentence."""

import gzip
import hashlib
import os
import stat
from contextlib import suppress

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from greybox_id.base.errors import BadInput, GreyboxError
from greybox_id.datasets.column_map import column_map, parse_column_map
from greybox_id.datasets.read import read

ROWS = 6
CSV = "t,Speed,accx,accy,yaw_rate,steering_angle,current\n" + "".join(
    f"{0.05 * k:.2f},{4244 * k},0.1,-0.2,{10 * k},0.0{k},1.5\n" for k in range(ROWS)
)


@pytest.fixture
def write(tmp_path):
    def write(content, name="lap.csv"):
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


def sentence(path, columns="roboracer"):
    with pytest.raises(BadInput) as error:
        read(path, columns)
    return str(error.value)


def test_values_arrive_in_si_units(write):
    path = write(CSV)
    recording = read(path, "roboracer")
    np.testing.assert_allclose(recording["v_x"], np.arange(ROWS), rtol=1e-12)
    np.testing.assert_allclose(recording["yaw_rate"], np.radians(10 * np.arange(ROWS)), rtol=1e-12)
    np.testing.assert_allclose(recording["a_x"], 0.980665)
    assert recording.name == "lap"
    assert recording.source.path == str(path)
    assert recording.source.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert recording.source.columns == "roboracer"


def test_gzip_and_parquet_hold_the_same_recording(write, tmp_path):
    plain = read(write(CSV), "roboracer")
    zipped = read(write(gzip.compress(CSV.encode()), "lap.csv.gz"), "roboracer")
    pd.read_csv(tmp_path / "lap.csv").to_parquet(tmp_path / "lap.parquet")
    parquet = read(tmp_path / "lap.parquet", "roboracer")
    for other in (zipped, parquet):
        assert other.name == "lap"
        for name in plain.signals:
            np.testing.assert_array_equal(plain[name], other[name])


def test_scale_sign_unit_and_offset_apply_in_that_order(write):
    mapping = parse_column_map(
        '[time]\nunit="s"\n[signals.yaw_rate]\ncolumn="w"\nunit="deg/s"\nscale=2\ndivide_by=4\nsign=-1\noffset=0.5',
        "m.toml",
    )
    recording = read(write("time,w\n0,180\n1,360\n"), mapping)
    np.testing.assert_allclose(recording["yaw_rate"], [0.5 - np.pi / 2, 0.5 - np.pi], rtol=1e-12)


def test_runs_end_where_time_restarts_and_where_the_run_column_changes(write):
    recording = read(write("time,v_x,run\n0,1,a\n1,1,a\n2,1,b\n3,1,b\n0,1,b\n1,1,b\n"))
    assert recording.runs == ((0, 2), (2, 4), (4, 6))


def test_empty_and_infinite_cells_are_nan_and_no_error(write):
    recording = read(write("time,v_x,steer\n0,1,\n1,inf,0.1\n2,nan,-inf\n3,1e300,NA\n4, ,0.2\n\n"))
    np.testing.assert_array_equal(recording["v_x"], [1, np.nan, np.nan, np.nan, np.nan])
    np.testing.assert_array_equal(recording["steer"], [np.nan, 0.1, np.nan, np.nan, 0.2])


def test_an_optional_column_may_lack_and_extra_ones_keep_their_unit(write):
    recording = read(write(CSV), "roboracer")
    assert "x" not in recording
    head, *rest = CSV.splitlines()
    wide = "\n".join([head + ",velocity_vehicle_x", *(f"{row},1.0" for row in rest)])
    recording = read(write(wide), "roboracer")
    assert recording.unit("velocity_vehicle_x") == "m/s"


def test_semicolons_and_decimal_commas_are_seen_and_may_be_stated(write):
    text = "time;v_x\n0,0;1,5\n0,1;2,5\n"
    np.testing.assert_array_equal(read(write(text))["v_x"], [1.5, 2.5])
    mapping = parse_column_map('separator=";"\ndecimal=","\n[time]\nunit="s"\n[signals.v_x]\nunit="m/s"', "m.toml")
    np.testing.assert_array_equal(read(write(text), mapping)["v_x"], [1.5, 2.5])


def test_text_in_a_number_column_is_named_with_its_row(write):
    path = write(CSV.replace("0.10,8488", "0.10,broken"))
    assert sentence(path) == (
        f"{path}: column \"Speed\", row 4: 'broken' is not a number. "
        "Mend the cell, or leave it empty if the value is missing."
    )
    assert 'decimal = ","' in sentence(write(CSV.replace("0.10,8488", '0.10,"8,5"')))
    assert "row 4: 'True'" in sentence(write("time,v_x\n0,1\n1,2\n2,True\n"), "canonical")


def test_text_in_parquet_is_named_with_its_row(tmp_path):
    pd.DataFrame({"time": [0.0, 1.0], "v_x": ["1.0", "fast"]}).to_parquet(tmp_path / "a.parquet")
    assert "column \"v_x\", row 2: 'fast'" in sentence(tmp_path / "a.parquet", "canonical")


def test_a_missing_column_is_answered_with_what_there_is(write):
    words = sentence(write(CSV.replace("yaw_rate", "yawrate")))
    assert 'no column "yaw_rate"' in words
    assert "Did you mean yawrate?" in words
    assert "steering_angle" in words
    assert 'column map "roboracer" fits this file' in sentence(write(CSV), "canonical")
    assert "none of its signals" in sentence(write("time,a\n0,1\n"), "canonical")


@pytest.mark.parametrize(
    ("content", "name", "words"),
    [
        (b"", "lap.csv", "is empty"),
        (CSV.splitlines()[0], "lap.csv", "no rows"),
        (CSV.splitlines()[0] + "\n\n\n", "lap.csv", "no rows"),
        (CSV.replace("accy", "accx"), "lap.csv", "accx 2"),
        (b"\x89PNG\r\n\x1a\n\x00\x00", "lap.csv", "not a text file"),
        (CSV.encode().replace(b"accx", b"acc\x81"), "lap.csv", "byte 0x81 in row 1"),
        (CSV + "1,2,3,4,5,6,7,8\n", "lap.csv", f"row {ROWS + 2} has more cells"),
        (CSV + "1,2,3,4,5,6,7,8,9,10\n", "lap.csv", f"row {ROWS + 2} has more cells"),
        (CSV.replace("\n", "\n1,2,3,4,5,6,7,8,9,10\n", 1), "lap.csv", "row 2 has more cells"),
        (CSV + '"1,2', "lap.csv", f"row {ROWS + 2}: a quotation mark"),
        (CSV, "lap.csv.gz", "cannot be unzipped"),
        (gzip.compress(CSV.encode())[:-20], "lap.csv.gz", "cannot be unzipped"),
        (b"PAR1 and no more", "lap.parquet", "not a sound Parquet file"),
        (CSV, "lap.xlsx", "cannot tell the kind of file"),
    ],
)
def test_a_bad_file_is_answered_with_a_sentence(write, content, name, words):
    path = write(content, name)
    answer = sentence(path)
    assert words in answer
    assert answer.startswith(str(path))
    assert answer.endswith((".", "?"))


def test_folders_lacking_files_and_locked_files_are_answered(write, tmp_path):
    assert "is a folder" in sentence(tmp_path)
    assert "no such file" in sentence(tmp_path / "none.csv")
    assert "valid path" in sentence(str(tmp_path / "a\0b.csv"))
    locked = write(CSV)
    locked.chmod(0)
    if not os.access(locked, os.R_OK):  # the superuser may read anything
        assert "permission denied" in sentence(locked)
    locked.chmod(stat.S_IRUSR | stat.S_IWUSR)


@settings(max_examples=200)
@given(
    position=st.integers(0, len(CSV)),
    length=st.integers(0, 60),
    junk=st.one_of(
        st.binary(max_size=8),
        st.sampled_from(
            [b",", b"\n", b'"', b"\r", b"1e999", b"inf", b"True", b"-", b"9" * 30, b"abc", b",,,,,,,,,", b" "]
        ),
    ),
)
def test_a_mutated_csv_never_ends_in_a_traceback(tmp_path, position, length, junk):
    path = tmp_path / "lap.csv"
    data = CSV.encode()
    path.write_bytes(data[:position] + junk + data[position + length :])
    with suppress(GreyboxError):
        assert len(read(path, "roboracer")) > 0


@settings(max_examples=60)
@given(position=st.floats(0, 1), length=st.integers(0, 60), junk=st.binary(max_size=8))
def test_a_mutated_parquet_or_gzip_never_ends_in_a_traceback(tmp_path, position, length, junk):
    frame = pd.DataFrame({"time": np.arange(50.0), "v_x": np.ones(50)})
    frame.to_parquet(tmp_path / "good.parquet")
    sound = {
        "bad.parquet": (tmp_path / "good.parquet").read_bytes(),
        "bad.csv.gz": gzip.compress(frame.to_csv().encode()),
    }
    for name, data in sound.items():
        start = int(position * len(data))
        (tmp_path / name).write_bytes(data[:start] + junk + data[start + length :])
        with suppress(GreyboxError):
            read(tmp_path / name)


def test_roboracer_files_hold_what_their_map_says(real_data):
    train = read(real_data / "roboracer" / "train.csv", "roboracer")
    assert train.runs == ((0, 698), (698, 1639), (1639, 2082), (2082, 2531))
    assert train.sample_time == pytest.approx(0.05)
    assert np.corrcoef(train["a_x"][:-1], np.diff(train["v_x"]))[0, 1] > 0.5  # +accx is dv/dt
    valid = read(real_data / "roboracer" / "valid.csv", "roboracer")
    assert [start for start, _ in valid.runs] == [0, 492, 790, 1016]
    tires = read(real_data / "roboracer" / "tire_set_1.csv", "roboracer")
    assert [start for start, _ in tires.runs] == [0, 408]


def test_truck_files_hold_what_their_map_says(real_data):
    truck = read(real_data / "truck" / "val.parquet", "truck")
    assert len(truck) == 102_000
    assert len(truck.runs) == 51
    assert {truck.unit("alpha2"), truck.unit("alpha")} == {"rad"}


def test_lateral_acceleration_of_the_250lm_has_the_sign_of_its_turns(real_data):
    ferrari = read(real_data / "revs_250lm" / "run1_first400s.csv.gz", "revs_250lm")
    slope = np.polyfit(ferrari["v_x"] * ferrari["yaw_rate"], ferrari["a_y"], 1)[0]
    assert slope == pytest.approx(1.0, abs=0.05)
    np.testing.assert_allclose(ferrari["sideslip"], np.arctan2(ferrari["v_y"], ferrari["v_x"]), atol=1e-6)


def test_a_map_object_can_be_given_as_well(write):
    assert read(write(CSV), column_map("roboracer")).source.columns == "roboracer"


def test_a_file_without_columns_is_told(tmp_path):
    pd.DataFrame(index=range(3)).to_parquet(tmp_path / "lap.parquet", index=False)
    assert "no columns of numbers" in sentence(tmp_path / "lap.parquet", "canonical")


def test_a_column_may_have_other_names_in_other_files(write):
    mapping = parse_column_map(
        '[time]\ncolumn=["t", "s"]\nunit="s"\n[signals.v_x]\ncolumn=["v", "speed"]\nunit="m/s"', "m.toml"
    )
    assert read(write("s,speed\n0,1\n1,2\n"), mapping)["v_x"][1] == 2.0
    assert read(write("t,speed,v\n0,1,3\n1,2,4\n"), mapping)["v_x"][1] == 4.0
    assert 'no column "v"' in sentence(write("t,w\n0,1\n1,2\n"), mapping)


def test_rows_before_the_start_are_left_out_and_counted(write):
    mapping = parse_column_map(
        '[start]\ncolumn="n"\n[time]\ncolumn="t"\nunit="s"\n[signals.v_x]\ncolumn="v"\nunit="m/s"', "m.toml"
    )
    found = read(write("t,n,v\n0,0,9\n1,0,9\n2,3,1\n3,0,2\n"), mapping)
    np.testing.assert_array_equal(found["v_x"], [1.0, 2.0])
    assert '2 rows before "n"' in found.notes[0]
    assert "is zero in all rows" in sentence(write("t,n,v\n0,0,9\n1,0,9\n"), mapping)
    assert 'no column "n"' in sentence(write("t,v\n0,9\n1,9\n"), mapping)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf_16_is_read(write, encoding):
    text = CSV if encoding == "utf-16" else "\ufeff" + CSV
    np.testing.assert_allclose(read(write(text.encode(encoding)), "roboracer")["v_x"], np.arange(ROWS))
    assert "begins like UTF-16 text, but cannot be decoded as such" in sentence(write(text.encode(encoding)[:-1]))


def test_seconds_and_nanoseconds_may_stand_apart(write):
    mapping = parse_column_map(
        '[time]\ncolumn="s"\nnanoseconds="n"\nunit="s"\n[signals.v_x]\ncolumn="v"\nunit="m/s"', "m.toml"
    )
    rows = "".join(f"{1_731_000_000 + k // 4},{k % 4 * 250_000_001},{k}\n" for k in range(9))
    np.testing.assert_allclose(np.diff(read(write("s,n,v\n" + rows), mapping).time), 0.25, atol=4e-9)
    assert 'no column "n"' in sentence(write("s,v\n1,2\n"), mapping)


LINES = [f"{0.02 * k:.2f},{5 + 0.1 * k:.1f},0.{k % 7}\n" for k in range(40)]
OWN = (
    '[time]\ncolumn="t"\nunit="s"\n[signals.v_x]\ncolumn="v"\nunit="m/s"\n[signals.yaw_rate]\ncolumn="r"\nunit="rad/s"'
)


@pytest.mark.parametrize(
    ("more", "note"),
    [
        (LINES[11], "left out: 1 repetition of the row before, its time included."),
        (",,\n", "left out: 1 empty row."),
    ],
)
def test_rows_that_say_nothing_new_are_left_out(write, more, note):
    mapping = parse_column_map(OWN, "own.toml")
    once = read(write("t,v,r\n" + "".join(LINES)), mapping)
    more = read(write("t,v,r\n" + "".join([*LINES[:12], more, *LINES[12:]]), "more.csv"), mapping)
    np.testing.assert_array_equal(more.time, once.time)
    np.testing.assert_array_equal(more["v_x"], once["v_x"])
    assert note in more.notes


def test_repeated_rows_are_left_out_of_a_clock_that_also_lost_some(write):
    rows = [f"{0.02 * k:.2f},{5 + 0.01 * k:.2f},0.{k % 7}\n" for k in range(400) if k % 9]
    recording = read(write("t,v,r\n" + "".join([*rows[:50], rows[49], *rows[50:]])), parse_column_map(OWN, "own.toml"))
    assert "left out: 1 repetition of the row before, its time included." in recording.notes
    np.testing.assert_allclose(np.diff(recording.time), 0.02, rtol=1e-6)
    np.testing.assert_allclose(recording["v_x"], 5 + 0.5 * recording.time, atol=1e-3)


def test_rows_of_one_packet_are_no_repetitions(write):
    packets = "".join(f"{0.04 * (k // 2):.2f},5.0,0.{k // 3}\n" for k in range(40))
    assert len(read(write("t,v,r\n" + packets), parse_column_map(OWN, "own.toml"))) == 40


def test_columns_of_slower_sensors_are_laid_between_their_own_cells(write):
    """Blank in most rows: measured ones lie on lines, commands are held; what is missing in one piece stays so."""
    time = np.arange(400) / 100
    v = np.where(np.arange(400) % 5 == 2, 10 + time, np.nan)
    steer = np.where(np.arange(400) % 10 == 0, time, np.nan)
    gyro = np.where((time > 1) & (time < 2), np.nan, 0.1)
    file = write(pd.DataFrame({"time": time, "v_x": v, "steer": steer, "yaw_rate": gyro}).to_csv(index=False))
    found = read(file)
    rows = np.interp(found.time, time, np.arange(400)).round().astype(int)
    assert (rows[0], len(rows)) == (2, 396)
    np.testing.assert_allclose(found["v_x"], 10 + time[rows])
    np.testing.assert_allclose(found["steer"], time[rows // 10 * 10])
    assert np.array_equal(np.isnan(found["yaw_rate"]), np.isnan(gyro[rows]))
    assert (found.resampled["v_x"].method, found.resampled["steer"].method) == ("linear", "held")
    assert found.resampled["v_x"].rate == pytest.approx(20)
    assert "yaw_rate" not in found.resampled
