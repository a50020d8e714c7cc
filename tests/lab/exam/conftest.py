"""A small examination, written by hand."""

import pytest

from greybox_lab.exam.answers import Answer, write_answer
from greybox_lab.exam.make import finish

ANSWERS = (
    Answer("case_000", "null", "clean", {}),
    Answer("case_001", "single", "clean", {"steering_delay": 0.03}, {"steering_delay": 0.0}, size={"yaw_rate": 2.0},
           left={"a_y": 1.0}),
    Answer("case_002", "double", "clean", {"mass_change": 1.1, "road_slope": 0.02},
           {"mass_change": 1.0, "road_slope": 0.0}, size={"v_x": 3.0}, left={"a_y": 1.0}),
    Answer("case_003", "outside", "clean", {"puncture": 0.3}, {"puncture": 0.0}, size={"a_y": 1.0}, left={"a_y": 1.0}),
)  # fmt: skip


@pytest.fixture
def exam(tmp_path):
    """Folder of an examination of four cases."""
    folder = tmp_path / "exam"
    for answer in ANSWERS:
        case, kept = folder / "cases" / answer.case, folder / "sealed" / answer.case
        case.mkdir(parents=True)
        (case / "recording.csv").write_text("time,v_x,steer\n0,1,0\n0.01,1,0\n")
        (case / "vehicle.toml").write_text('name = "car"\n')
        write_answer(answer, kept / "answer.json")
        (kept / "held_out.csv").write_text("time,v_x,steer\n0,1,0\n0.01,1,0\n")
    finish(folder, "clean", 3, list(ANSWERS))
    return folder
