"""Repairs that a check proposes: the map with them reads the recording as it is, and is the same as text."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from calling import greybox
from motion import recorded

from greybox_id.datasets.checks import check
from greybox_id.datasets.column_map import column_map, parse_column_map
from greybox_id.datasets.read import read
from greybox_id.datasets.repair import map_text, repaired

MAP = """name = "mine"
about = "an IMU"
hold = "linear"
[time]
column = "t"
unit = "s"
[signals]
v_x = { column = "v", unit = "m/s" }
steer = { column = "delta", unit = "rad" }
yaw_rate = { column = "gz", unit = "rad/s" }
a_y = { column = "ay", unit = "m/s^2" }
[extra]
"a battery" = { column = "u", unit = "V", optional = true }
"""


@pytest.fixture
def lap(tmp_path):
    """A drive with its columns called otherwise, and a change made to it."""

    def lap(change):
        drive = recorded("lateral", seconds=20.0)
        table = pd.DataFrame({"t": drive.time, "v": drive["v_x"], "delta": drive["steer"], "gz": drive["yaw_rate"],
                              "ay": drive["a_y"]})  # fmt: skip
        change(table).to_csv(tmp_path / "lap.csv", index=False)
        (tmp_path / "mine.toml").write_text(MAP)
        return tmp_path / "lap.csv", tmp_path / "mine.toml", drive

    return lap


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda d: d.assign(gz=np.degrees(d.gz)), 'unit = "deg/s"'),
        (lambda d: d.assign(ay=-d.ay), "sign = -1"),
    ],
)
def test_a_map_is_mended_and_the_recording_is_then_as_it_was(lap, change, line):
    file, mapping, drive = lap(change)
    mended = mapping.with_name("mended.toml")
    done = greybox("data", "check", file, "--columns", mapping, "--repair", mended)
    assert done.code == 0, done.out
    assert line in mended.read_text()
    after = read(file, mended)
    for name in ("yaw_rate", "a_y", "steer", "v_x"):
        assert np.corrcoef(after[name], drive[name])[0, 1] > 0.999
    assert after.hold == "linear"


def test_a_map_is_mended_in_its_place_and_each_earlier_one_is_kept(lap):
    file, mapping, _ = lap(lambda d: d.assign(ay=-d.ay))
    for name in ("mine.toml.bak", "mine.toml.bak1"):
        mapping.write_text(MAP + f"# {name}\n")
        done = greybox("data", "check", file, "--columns", mapping, "--repair", mapping)
        assert done.code == 0, done.out
        assert "a_y: sign = -1" in done.out
        assert name in done.out
        assert column_map(mapping).signals["a_y"].sign == -1
        assert mapping.with_name(name).read_text() == MAP + f"# {name}\n"
    done = greybox("data", "check", file, "--columns", mapping, "--repair", mapping)
    assert "no finding has a repair" in done.out
    assert len(list(mapping.parent.glob("*.bak*"))) == 2


def test_where_nothing_is_wrong_nothing_is_written(lap):
    file, mapping, _ = lap(lambda table: table)
    assert repaired(column_map(mapping), check(read(file, mapping))) is None
    done = greybox("data", "check", file, "--columns", mapping, "--repair", mapping.with_name("mended.toml"))
    assert "no finding has a repair" in done.out
    assert not mapping.with_name("mended.toml").exists()


@pytest.mark.parametrize("name", ["canonical", "dart", "roboracer", "truck", "revs_250lm"])
def test_a_map_as_text_is_read_again_as_it_is(name):
    mapping = column_map(name)
    again = parse_column_map(map_text(mapping), "again.toml")
    assert again == replace(mapping, where=again.where, text=again.text)


def test_a_drive_that_only_reverses_has_the_wrong_sign_and_a_servo_its_offset(lap):
    file, mapping, drive = lap(lambda d: d.assign(v=-d.v, delta=0.5 - d.delta))
    (first, *_) = check(read(file, mapping))
    assert first.where.channel == "v_x"
    mended = mapping.with_name("mended.toml")
    done = greybox("data", "check", file, "--columns", mapping, "--repair", mended)
    assert done.code == 0, done.out
    assert np.allclose(read(file, mended)["steer"], drive["steer"], atol=5e-3)


def test_a_unit_that_the_map_states_is_not_advised_again(lap):
    file, mapping, _ = lap(lambda d: d.assign(gz=np.degrees(d.gz)))
    mapping.write_text(MAP.replace('"gz", unit = "rad/s" }', '"gz", unit = "deg/s", scale = 57.29578 }'))
    (first, *_) = check(read(file, mapping))
    assert "scale = 1" in first.sentence
    assert 'Set unit = "deg/s"' not in first.sentence


def test_a_question_that_the_map_leaves_open_is_a_warning(lap):
    file, mapping, _ = lap(lambda table: table)
    mapping.write_text(MAP.replace("yaw_rate =", "#? yaw_rate ="))
    (question,) = [item for item in check(read(file, mapping)) if item.kind == "question"]
    assert "does not yet state the column or unit of yaw_rate" in question.sentence
    assert question.severity.value == "warning"
