"""The vehicle's memory of what it drove."""

import json

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import Recording
from greybox_lab.driving.loop import buffer as room
from greybox_lab.driving.loop.buffer import RowBuffer, continued
from greybox_lab.driving.loop.client import Unanswered


def drive(rows, begins=0.0, runs=()):
    times = begins + 0.02 * np.arange(rows)
    return Recording("drive", times, {"v_x": np.arange(rows, dtype=float), "steer": np.zeros(rows)}, runs=runs)


def test_parts_are_one_drive_again_and_runs_stay_apart(tmp_path):
    buffer = RowBuffer(tmp_path)
    buffer.add(drive(1230), "a" * 64, 0.6)
    buffer.add(drive(500, runs=((0, 200), (200, 500))), "b" * 64, 0.66)
    assert [part.rows for part in buffer.parts] == [410, 410, 410, 200, 300]
    first, second, third = buffer.recordings(buffer.last)
    assert np.array_equal(first["v_x"], np.arange(1230))
    assert np.allclose(np.diff(first.time), 0.02)
    assert (len(second), len(third)) == (200, 300)
    assert second.time[0] == pytest.approx(first.time[-1] + room.PAUSE)
    assert len(buffer.recordings(3)) == 1
    told = json.loads((tmp_path / "buffer.json").read_text())
    assert (told[-1]["policy"], told[-1]["cap"], told[-1]["sent"]) == ("b" * 64, 0.66, False)


def test_the_oldest_rows_go_where_there_are_too_many(tmp_path, monkeypatch):
    monkeypatch.setattr(room, "MOST", 1000)
    buffer = RowBuffer(tmp_path)
    for _ in range(3):
        buffer.add(drive(400), "a", 0.6)
    assert [part.number for part in buffer.parts] == [2, 3]
    assert sorted(file.name for file in tmp_path.glob("*.csv")) == ["rows_000002.csv", "rows_000003.csv"]


def test_what_a_broken_connection_left_is_sent_the_next_time_by_another_process_too(tmp_path):
    buffer, had = RowBuffer(tmp_path), []

    def post(body):
        if len(had) == 1:
            raise Unanswered("nobody")
        had.append(body)

    buffer.add(drive(1000), "a", 0.6)
    with pytest.raises(Unanswered):
        buffer.send(post)
    again = RowBuffer(tmp_path)
    again.send(had.append)
    again.send(had.append)
    assert had == [(tmp_path / f"rows_00000{k}.csv").read_bytes() for k in (1, 2)]


def test_a_drive_that_is_done_once_more_has_the_same_bytes(tmp_path):
    buffer = RowBuffer(tmp_path)
    buffer.add(drive(400), "a", 0.6)
    buffer.add(drive(300), "a", 0.6)
    before = (tmp_path / "rows_000002.csv").read_bytes()
    buffer.forget(1)
    buffer.add(drive(300), "a", 0.6)
    assert (tmp_path / "rows_000002.csv").read_bytes() == before


def test_parts_of_other_sensors_or_with_joins_are_left_as_they_are():
    other = Recording("other", 8.0 + 0.02 * np.arange(10), {"v_x": np.ones(10)})
    joint = drive(10, begins=8.2, runs=((0, 4), (4, 10)))
    assert len(continued([drive(400), other, joint])) == 3


def test_a_damaged_list_is_a_sentence(tmp_path):
    (tmp_path / "buffer.json").write_text('[{"rows": 3}]')
    with pytest.raises(BadInput, match="is damaged; remove it"):
        RowBuffer(tmp_path)
