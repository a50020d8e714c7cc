"""Deriving the numbers of a diagnosis again, on examinations whose answers are known."""

import json
from pathlib import Path

import numpy as np
import pytest

from greybox_id.gap.estimation.calibration import CAL, SEARCHED, Calibration, provenance
from greybox_lab.exam.answers import Answer, write_answer
from greybox_lab.exam.calibrate import curves, main, search, thresholds

KINDS = [("null", {}), ("single", {"steering_delay": 0.05}), ("outside", {"torque_vectoring": 0.5})]


def diagnosis(gain, share, effect="steering_delay"):
    ranked = [{"effect": effect, "magnitude": 0.05, "interval": [0.04, 0.06], "gain": gain}]
    return {"ranking": ranked, "applied": [effect] if gain > 12 else [], "gap_detected": gain > 12,
            "model_error": {"F_y": {"share": share}}}  # fmt: skip


def diagnose(folder):
    """What a diagnoser is asked: the gain shows with which number it was diagnosed."""
    assert (folder / "recording.csv").is_file()
    return diagnosis(20.0 if CAL.refits >= Calibration.refits else 5.0, 0.01)


@pytest.fixture
def exam(tmp_path):
    rng = np.random.default_rng(1)
    for k in range(60):
        kind, effects = KINDS[k % 3]
        case = f"case_{k:03d}"
        folder = tmp_path / "cases" / case
        folder.mkdir(parents=True)
        (folder / "recording.csv").write_text("time\n")
        gain = rng.exponential(2.0) if kind == "null" else 40.0 + k
        share = float(np.exp(rng.normal(np.log(0.03 if kind == "outside" else 0.008), 0.3)))
        (folder / "diagnosis.json").write_text(json.dumps(diagnosis(gain, share)))
        (tmp_path / "sealed" / case).mkdir(parents=True)
        write_answer(
            Answer(case, kind, "workshop", effects, left={"yaw_rate": 1.0}), tmp_path / "sealed" / case / "answer.json"
        )
    return tmp_path


def test_what_curves_are_off_is_of_the_size_that_is_believed():
    found = curves()
    off = np.concatenate(list(found["off"].values()))
    assert 0.5 * CAL.curve_off < np.min(off) < np.max(off) < 3 * CAL.curve_off


def test_the_cost_is_what_one_null_in_fifty_gains(exam):
    found = thresholds([exam])
    assert found["nulls"] == 20
    assert found["cost"]["one in fifty"] == pytest.approx(-2.0 * np.log(0.02), rel=0.5)  # of an exponential
    assert found["causes gain"]["least"][0] == 41.0
    assert 0.8 < found["unnamed"]["share"] < 3.0
    assert found["unnamed"]["wrong"] <= 0.05


@pytest.mark.slow
def test_numbers_of_the_search_are_halved_and_doubled_in_processes_of_their_own(exam, monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    for case in sorted((exam / "cases").iterdir())[2:]:
        (case / "recording.csv").unlink()
    found = search([exam], draws=3, seed=2, jobs=1, diagnoser="test_calibrate:diagnose")
    assert found["numbers"] == sum(data == SEARCHED for _, _, data in provenance().values())
    assert found["cases"] == 2
    assert found["of"] == 6
    halved = {row["draw"] for row in found["rows"]}
    assert found["verdicts changed"] == 2 * len(halved)
    assert 0 < len(halved) < 3
    assert CAL.refits == Calibration.refits  # here nothing was changed


def test_folders_are_asked_for(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["thresholds"])
    assert ended.value.code == 2
    assert "folders of examinations" in capsys.readouterr().err


@pytest.mark.parametrize("part", ["thresholds", "search"])
def test_a_folder_that_is_no_examination_is_a_sentence(tmp_path, capsys, part):
    with pytest.raises(SystemExit) as ended:
        main([part, str(tmp_path / "nothing")])
    assert ended.value.code == 2
    assert "holds no cases" in capsys.readouterr().err
