"""`greybox report` reads the recordings from where the fit found them, and says a sentence where they moved."""

import json
import shutil
from dataclasses import replace

import pytest
from click.testing import CliRunner
from driven import written

from greybox_id.cli.report import recordings_of, report
from greybox_id.datasets.read import read
from greybox_id.datasets.shipped import shipped
from greybox_id.errors import BadInput
from greybox_id.fit import load
from greybox_id.fitting import How, fit
from greybox_id.models.msnn_lat import LateralSettings, covering_lat, msnn_lat
from greybox_id.models.registry import build
from greybox_id.provenance import data_record


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fit")
    data = shutil.copy(shipped("racer_valid"), folder / "drive.csv")
    recording = read(data, "roboracer")
    model = msnn_lat(covering_lat(LateralSettings(n_delta=3, q=5), recording))
    how = How(strengths=1.0, solver="gauss-newton")
    return fit(model, [recording], how=how).save(folder / "fit.json")


def test_the_recordings_are_found_where_the_fit_found_them(fitted):
    (recording,) = recordings_of(load(fitted, build), fitted)
    assert recording.source.path == str(fitted.parent / "drive.csv")


def test_a_moved_recording_is_a_sentence_and_can_be_named(fitted, tmp_path):
    elsewhere = tmp_path / "fit.json"
    shutil.copy(fitted, elsewhere)
    drive = fitted.parent / "drive.csv"
    moved = tmp_path / "moved.csv"
    drive.rename(moved)
    try:
        with pytest.raises(BadInput, match=r"no longer there.*--train"):
            CliRunner().invoke(report, [str(elsewhere)], catch_exceptions=False)
        arguments = [str(elsewhere), "--train", str(moved), "--figures", str(tmp_path / "figures"), "--json"]
        result = CliRunner().invoke(report, arguments, catch_exceptions=False)
    finally:
        moved.rename(drive)
    assert result.exit_code == 0
    body = json.loads(result.stdout)
    assert body["report"] == str(tmp_path / "fit.pdf")
    assert (tmp_path / "fit.pdf").read_bytes().startswith(b"%PDF")
    assert str(tmp_path / "figures" / "traces.svg") in body["figures"]
    assert len(body["verdict"]) == 3


@pytest.mark.usefixtures("_uncompiled")
def test_equations_of_motion_have_a_report_too(motion_fit, laps, tmp_path):
    files = [written(lap, tmp_path / f"lap{k}.csv") for k, lap in enumerate(laps)]
    made = zip(motion_fit.data, [read(file, "canonical") for file in files], strict=True)
    data = tuple(data_record(recording, record.role) for record, recording in made)
    path = replace(motion_fit, data=data).save(tmp_path / "fit.json")
    result = CliRunner().invoke(report, [str(path), "--figures", str(tmp_path / "figures")], catch_exceptions=False)
    assert result.exit_code == 0
    assert "lap2" in result.stdout.splitlines()[0]
    assert (tmp_path / "fit.pdf").read_bytes().startswith(b"%PDF")
    assert (tmp_path / "figures" / "tyres.svg").is_file()
