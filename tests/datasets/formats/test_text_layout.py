"""Text files as loggers write them: names, units and values are found behind preambles, whatever separates them."""

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets.column_map import column_map, parse_column_map
from greybox_id.datasets.formats import contents
from greybox_id.datasets.formats.text import layout_of
from greybox_id.datasets.mapping import propose
from greybox_id.datasets.read import read

ROWS = [[0.02 * k, 54.5 + k, -0.5 * k, 0.002 * k] for k in range(30)]
TEXT = [[f"{value:.4f}" for value in row] for row in ROWS]
MOTEC = """"Format","MoTeC CSV File",,,"Workbook",""
"Venue","test",,,"Worksheet",""
"Sample Rate","50.000","Hz",,"End Time","30.000","s"
"Range","entire outing",,,"End Distance","600","m"


"Time","Ground Speed","Steered Angle","G Force Lat"
"s","km/h","deg","G"


"""
AIM = """"Format","AIM CSV File"
"Session","Test"
"Racer","A, B"
"Sample Rate","50"
"Beacon Markers","12.3","60.1"

"Time","GPS Speed","Steer_Pos","GPS LatAcc"
"s","km/h","deg","g"

"""
RACECHRONO_3 = """This file is created using RaceChrono Pro ( http://racechrono.com/ ).
Format,3
Session title,"X, Y"
Created,01/01/2025,00:00

timestamp,speed,bearing,speed
unix time,km/h,deg,m/s
,100: gps,100: gps,200: obd
"""
RACECHRONO_2 = """This file is created using RaceChrono v7.
Session title,X
Track name,"Y"

Time (s),Speed (km/h),Bearing (deg),Lateral acceleration (G)
"""
STATISTICS = (
    MOTEC.rstrip()
    + """
"Min","54.5","-15.0","0.0"
"Max","84.5","0.0","0.06"
"Avg","70.0","-7.5","0.03"

"""
)
NUMBERED = AIM.replace('"s","km/h"', '"1","2","3","4"\n"s","km/h"')
COMMENTED = "# RaceRender Data: TrackAddict\n# Vehicle: car\n# Mode: 1\nTime [s],Speed [km/h],Steer [deg],Ay [g]\n"
UNITS_ROW = "TIME,SPEED,STEERINGANGLE,LATACC\ns,km/h,°,g\n"
MATLAB = "% time speed steer ay\n"


@pytest.mark.parametrize(
    ("head", "names", "units"),
    [
        (MOTEC, ("Time", "Ground Speed", "Steered Angle", "G Force Lat"), ("s", "km/h", "deg", "g")),
        (AIM, ("Time", "GPS Speed", "Steer_Pos", "GPS LatAcc"), ("s", "km/h", "deg", "g")),
        (STATISTICS, ("Time", "Ground Speed", "Steered Angle", "G Force Lat"), ("s", "km/h", "deg", "g")),
        (NUMBERED, ("Time", "GPS Speed", "Steer_Pos", "GPS LatAcc"), ("s", "km/h", "deg", "g")),
        (RACECHRONO_3, ("timestamp", "speed gps", "bearing", "speed obd"), ("s", "km/h", "deg", "m/s")),
        (RACECHRONO_2, ("Time (s)", "Speed (km/h)", "Bearing (deg)", "Lateral acceleration (G)"), ("", "", "", "")),
        (COMMENTED, ("Time [s]", "Speed [km/h]", "Steer [deg]", "Ay [g]"), ("", "", "", "")),
        (UNITS_ROW, ("TIME", "SPEED", "STEERINGANGLE", "LATACC"), ("s", "km/h", "deg", "g")),
        ("t,v,steer,v\n", ("t", "v", "steer", "v 2"), ("", "", "", "")),
        ("# t,v,steer,ay\n", ("t", "v", "steer", "ay"), ("", "", "", "")),
    ],
)
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_names_and_units_are_found_by_width(head, names, units, separator):
    quoted = head.replace('"A, B"', '"A"').replace('"X, Y"', '"X"')
    lines = [*(quoted if separator != "," else head).replace(",", separator).splitlines(), *map(separator.join, TEXT)]
    found = layout_of(lines, "", "")
    assert (found.separator, found.names, found.units) == (separator, names, units)
    assert lines[found.first] == separator.join(TEXT[0])


def test_blanks_between_columns_are_a_separator():
    lines = [MATLAB.strip(), *("  ".join(row) for row in TEXT)]
    found = layout_of(lines, "", "")
    assert (found.names, found.first) == (("time", "speed", "steer", "ay"), 1)


def test_labels_among_values_are_no_line_of_names(tmp_path):
    file = tmp_path / "lap.csv"
    file.write_text("time,phase,v_x\n" + "".join(f"{k},turn {k % 2},{k}\n" for k in range(20)))
    np.testing.assert_array_equal(read(file)["v_x"], np.arange(20))


def test_rows_are_counted_as_in_the_file(tmp_path):
    file = tmp_path / "lap.csv"
    rows = [",".join(row) for row in TEXT]
    rows[4] = rows[4].replace("58.5000", "")
    file.write_text(MOTEC + "\n".join(rows))
    mapping = parse_column_map(
        '[time]\ncolumn="Time"\nunit="s"\n[signals]\nv_x={column="Ground Speed",unit="km/h"}', "m.toml"
    )
    recording = read(file, mapping)
    assert recording["v_x"][1] == pytest.approx(55.5 / 3.6)
    from greybox_id.datasets.checks.finding import file_row

    assert file_row(recording, 4) == f"row {1 + file.read_text().splitlines().index(rows[4])} of the file"


def test_comments_among_rows_are_passed_over(tmp_path):
    file = tmp_path / "lap.csv"
    file.write_text("time,v_x\n0,1\n# Lap 1: 00:01:03\n1,2\n2,3\n")
    np.testing.assert_array_equal(read(file)["v_x"], [1, 2, 3])


def test_a_degree_sign_in_windows_letters_is_read(tmp_path):
    file = tmp_path / "lap.csv"
    file.write_bytes(UNITS_ROW.encode("cp1252") + "\n".join(",".join(row) for row in TEXT).encode())
    (group,) = contents(file, column_map("canonical")).groups
    assert group.units["STEERINGANGLE"] == "deg"


VBO = """File created on 01/01/2025 at 10:01:45

[header]
satellites
time
latitude
longitude
velocity kmh
long accel g
yaw rate

[channel units]
deg/s

[comments]
Log Rate (Hz) : 20.00

[column names]
sats time lat long velocity longacc yawrate

[data]
011 235959.95 +3120.0 -00060.0 036.0 -0.5 1.0E+01
011 000000.00 +3120.6 -00060.6 072.0 +0.5 2.0E+01
"""


def test_racelogic_writes_minutes_west_positive_and_a_clock(tmp_path):
    file = tmp_path / "lap.vbo"
    file.write_text(VBO)
    (group,) = contents(file, column_map("canonical")).groups
    table = group.load(group.names)
    assert group.units["velocity"] == "km/h"
    assert (group.units["yawrate"], group.units["longacc"]) == ("deg/s", "g")
    np.testing.assert_allclose(np.diff(table.numbers("time")), [0.05], atol=1e-6)
    np.testing.assert_allclose(table.numbers("lat"), [52.0, 52.01])
    np.testing.assert_allclose(table.numbers("long"), [1.0, 1.01])


def test_rows_at_the_end_that_sum_up_are_no_samples(tmp_path):
    file = tmp_path / "lap.csv"
    file.write_text(MOTEC + "\n".join(map(",".join, TEXT)) + '\n\n"Minimum","54.5","-15.0","0.0"\nMaximum,1,2,3\n')
    table = contents(file, column_map("canonical")).groups[0].load(["Time"])
    np.testing.assert_allclose(table.numbers("Time"), [row[0] for row in ROWS])


@pytest.mark.parametrize("code", ["utf-16", "utf-16-le", "utf-16-be"])
def test_text_in_two_bytes_a_letter_is_read_with_and_without_a_mark(tmp_path, code):
    file = tmp_path / "lap.csv"
    file.write_bytes((UNITS_ROW.replace("°", "deg") + "\n".join(map(",".join, TEXT))).encode(code))
    assert contents(file, column_map("canonical")).names == ("TIME", "SPEED", "STEERINGANGLE", "LATACC")


@pytest.mark.parametrize(
    "text",
    [
        "time,name,value,unit\n{t},speed,{v},km/h\n{t},mode,eco,\n",
        "signal_name;timestamp;signal_value;unit\nspeed;{t};{v};km/h\nmode;{t};eco;-\n",
        "Time [s],CAN ID,Signal Name,Physical Value,Unit\n{t},0x1f,speed,{v},km/h\n{t},0x1f,mode,eco,\n",
        "metric\tWert\tZeit\tEinheit\nspeed\t{v}\t{t}\tkm/h\nmode\teco\t{t}\t\n",
    ],
)
def test_long_tables_are_known_by_words_in_their_names(tmp_path, text):
    file, (head, *rows) = tmp_path / "long.csv", text.splitlines(keepends=True)
    file.write_text(head + "".join("".join(rows).format(t=0.1 * k, v=36 + k) for k in range(100)))
    (group,) = contents(file, column_map("canonical")).groups
    table = group.load(group.names)
    assert (group.name, dict(group.units)) == ("speed", {"speed": "km/h"})
    np.testing.assert_allclose(table.numbers("speed"), 36 + np.arange(100))
    np.testing.assert_allclose(table.numbers("speed/time"), 0.1 * np.arange(100))


@pytest.mark.parametrize(
    "whole",
    [
        {"time": [0.0, 0.1], "v": [1.0, 2.0]},
        {"car": "x", "data": [{"time": 0.0, "v": 1.0}, {"time": 0.1, "v": 2.0}]},
        {"meta": {"laps": [1]}, "log": {"time": [0.0, 0.1], "v": [1.0, 2.0]}},
    ],
)
@pytest.mark.parametrize("indent", [None, 2])
def test_one_json_object_of_columns_or_around_rows_is_read(tmp_path, whole, indent):
    import json

    file = tmp_path / "lap.json"
    file.write_text(json.dumps(whole, indent=indent))
    (group,) = contents(file, column_map("canonical")).groups
    table = group.load(group.names)
    np.testing.assert_allclose([table.numbers("time"), table.numbers("v")], [[0.0, 0.1], [1.0, 2.0]])


@pytest.mark.parametrize("kind", ["long.csv", "trace.json", "list.json"])
def test_a_row_for_every_reading_becomes_a_group_for_every_channel(tmp_path, kind):
    file = tmp_path / kind
    readings = [
        (1.5e9 + 0.01 * k, name, 0.1 * k)
        for k in range(200)
        for name in (("vehicle_speed",), ("vehicle_speed", "yaw_rate"))[k % 2]
    ]
    readings.insert(3, (1.5e9, "gear", "first"))
    if kind == "long.csv":
        text = "timestamp,name,value\n" + "".join(f"{t},{n},{v}\n" for t, n, v in readings)
    else:
        import json

        lines = [json.dumps({"timestamp": t, "name": n, "value": v}) for t, n, v in readings]
        text = "\n".join(lines) if kind == "trace.json" else f"[{','.join(lines)}]"
    file.write_text(text)
    mapping = parse_column_map(
        '[time]\nunit="s"\n[signals]\nv_x={column="vehicle_speed",unit="km/h"}\nyaw_rate={column="yaw_rate",unit="deg/s"}',
        "m.toml",
    )
    recording = read(file, mapping)
    assert recording.sample_time == pytest.approx(0.01, rel=1e-3)
    np.testing.assert_allclose(recording["v_x"][50], recording.time[50] * 10 / 3.6, rtol=1e-3)
    assert any("gear" in note for note in recording.notes)


def test_a_file_without_time_is_read_at_its_rate(tmp_path):
    file = tmp_path / "lap.csv"
    file.write_text("v_x,steer\n" + "1,0\n" * 10)
    mapping = parse_column_map('rate = 20\n[signals]\nv_x={unit="m/s"}', "m.toml")
    np.testing.assert_allclose(read(file, mapping).time, np.arange(10) / 20)


def test_a_table_without_names_is_a_sentence(tmp_path):
    file = tmp_path / "lap.csv"
    file.write_text("\n".join(map(",".join, TEXT)))
    with pytest.raises(BadInput, match="row 1 holds values in place of column names"):
        contents(file, column_map("canonical"))


def table(separator=",", numbers="{:g}", decimals=str, behind=("", "", "")):
    """40 rows at 10 Hz of a speed above a thousand and a yaw rate."""
    rows = [[decimals(numbers.format(v)) for v in (0.1 * k, 1000.5 + k, 0.01 * k)] for k in range(40)]
    cells = [[cell + unit for cell, unit in zip(row, behind, strict=True)] for row in rows]
    return [separator.join(row) for row in (["t", "v", "r"], *cells)]


def german(text):
    return text.translate(str.maketrans(",.", ".,"))


BODIES = {
    "names again where a logger began anew": [*table()[:20], "t,v,r", "s,m/s,rad/s", *table()[20:]],
    "words at the end": [*table(), "end of data,,", ",,closed"],
    "units in cells": table(behind=(" sec", "", " rad/s")),
    "marks of thousands": table(";", "{:,.2f}"),
    "marks of thousands and decimal commas": table(";", "{:,.2f}", german),
    "decimal commas in quotes": table(numbers="{:.4f}", decimals=lambda text: f'"{german(text)}"'),
    "exponents of Fortran": table(" ", "{:.6E}", lambda text: text.replace("E", "D")),
    "the minus of print": [*table()[:11], "0.95,,−3", *table()[11:]],
    "dashes for nothing": [*table()[:11], "0.95,---,-", "0.96,n/a,-", *table()[11:]],
}


@pytest.mark.parametrize("body", BODIES)
def test_rows_as_loggers_write_them_are_numbers(tmp_path, body):
    (tmp_path / "log.csv").write_text("\n".join(BODIES[body]) + "\n")
    text = '[time]\ncolumn="t"\nunit="s"\n[signals]\nv_x={column="v",unit="m/s"}\nyaw_rate={column="r",unit="rad/s"}'
    recording = read(tmp_path / "log.csv", parse_column_map(text, "own.toml"))
    known = np.isfinite(recording["v_x"])
    assert recording["v_x"][known] == pytest.approx(1000.5 + np.arange(40))
    assert recording["yaw_rate"][known] == pytest.approx(0.01 * np.arange(40))
    assert recording.time[known] == pytest.approx(0.1 * np.arange(40))


def test_one_strange_cell_is_named(tmp_path):
    (tmp_path / "log.csv").write_text("\n".join([*table()[:11], "0.95,fast,0.1", *table()[11:]]))
    with pytest.raises(BadInput, match="row 12: 'fast' is not a number"):
        propose(tmp_path / "log.csv")
