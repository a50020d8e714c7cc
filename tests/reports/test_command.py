"""`greybox report` reads the recordings from where the fit found them, and says a sentence where they moved."""

import json
import shutil
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from calling import greybox, refused
from click.testing import CliRunner
from driven import written
from made_gaps import clear

import greybox_id as gb
from greybox_id.api.estimates import found_again
from greybox_id.api.fitting import load as load_again
from greybox_id.base.errors import BadInput
from greybox_id.cli.report import report
from greybox_id.datasets.read import read
from greybox_id.datasets.shipped import shipped
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.posterior.verb import SampleOptions, sample
from greybox_id.fitting.provenance import data_record
from greybox_id.fitting.verb import fit
from greybox_id.models.msnn_lat import LateralSettings, covering_lat, msnn_lat
from greybox_id.reports.gap.saved import Made, as_text


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fit")
    data = shutil.copy(shipped("racer_valid"), folder / "drive.csv")
    recording = read(data, "roboracer")
    model = msnn_lat(covering_lat(LateralSettings(n_delta=3, q=5), recording))
    how = FitOptions(strengths=1.0, solver="gauss-newton")
    return fit(model, [recording], how=how).save(folder / "fit.json")


def test_the_recordings_are_found_where_the_fit_found_them(fitted):
    (recording,) = load_again(fitted).seen()
    assert recording.source.path == str(fitted.parent / "drive.csv")


@pytest.mark.usefixtures("_uncompiled")
def test_of_a_part_of_a_recording_the_part_is_found_again(tmp_path):
    lap = gb.read(shipped("racer_train"), columns="roboracer").between(2.0, 12.0).where("v_x > 2")
    path = gb.fit("kinematic", lap, vehicle="roboracer", options=FitOptions(solver="gauss-newton")).save(
        tmp_path / "fit.json"
    )
    (again,) = load_again(path).seen("train")
    assert len(again) == len(lap)
    np.testing.assert_array_equal(again.time, lap.time)


def test_a_fit_in_a_folder_of_its_own_finds_its_recording_beside_that(fitted, tmp_path):
    record = replace(load_again(fitted).data[0], path="lap_beside.csv")
    (tmp_path / "lap_beside.csv").touch()
    assert found_again(record, tmp_path / "out" / "fit.json") == (tmp_path / "lap_beside.csv").resolve()


def test_a_moved_recording_is_a_sentence_and_can_be_named(fitted, tmp_path):
    elsewhere = tmp_path / "fit.json"
    shutil.copy(fitted, elsewhere)
    drive = fitted.parent / "drive.csv"
    moved = tmp_path / "moved.csv"
    drive.rename(moved)
    try:
        with pytest.raises(BadInput, match=r"no longer there.*new path with train"):
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
    can_be_used, *three = body["verdict"]
    assert can_be_used.startswith("Usable with care. Not validated")
    assert len(three) == 3


@pytest.mark.usefixtures("_uncompiled")
def test_equations_of_motion_have_a_report_too(motion_fit, laps, tmp_path):
    files = [written(lap, tmp_path / f"lap{k}.csv") for k, lap in enumerate(laps)]
    made = zip(motion_fit.data, [read(file, "canonical") for file in files], strict=True)
    data = tuple(data_record(recording, record.role) for record, recording in made)
    path = replace(motion_fit, data=data).save(tmp_path / "fit.json")
    result = CliRunner().invoke(report, [str(path), "--figures", str(tmp_path / "figures")], catch_exceptions=False)
    assert result.exit_code == 0
    assert result.stdout.splitlines()[0].startswith("Usable with care.")
    assert "On the held-out recording lap2 (" in result.stdout
    assert (tmp_path / "fit.pdf").read_bytes().startswith(b"%PDF")
    assert (tmp_path / "figures" / "tyres.svg").is_file()


def test_a_page_is_written_where_the_format_or_the_name_asks_for_it(fitted, tmp_path):
    asked = CliRunner().invoke(report, [str(fitted), "--format", "html"], catch_exceptions=False)
    assert asked.exit_code == 0
    named = CliRunner().invoke(report, [str(fitted), "--out", str(tmp_path / "x.html")], catch_exceptions=False)
    assert named.exit_code == 0
    assert (tmp_path / "x.html").read_bytes() == fitted.with_suffix(".html").read_bytes()


def test_fits_side_by_side(fitted, tmp_path):
    other = tmp_path / "other" / "fit.json"
    other.parent.mkdir()
    shutil.copy(fitted, other)
    arguments = [str(fitted), str(other), "--out", str(tmp_path / "both.html"), "--json"]
    result = CliRunner().invoke(report, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    assert json.loads(result.stdout)["report"] == str(tmp_path / "both.html")
    with pytest.raises(BadInput, match="named twice"):
        CliRunner().invoke(report, [str(fitted), str(fitted)], catch_exceptions=False)


def test_a_diagnosis_has_a_report_and_stands_after_a_fit(fitted, tmp_path):
    gap = tmp_path / "gap.json"
    gap.write_text(as_text(clear(), Made("car", "greybox gap x", 0, "0.1.0")), encoding="utf-8")
    result = CliRunner().invoke(report, [str(gap)], catch_exceptions=False)
    assert result.stdout.startswith("The simulation deviates from the vehicle")
    assert (tmp_path / "gap.pdf").read_bytes().startswith(b"%PDF")
    arguments = [str(fitted), str(gap), "--out", str(tmp_path / "both.html")]
    both = CliRunner().invoke(report, arguments, catch_exceptions=False)
    assert both.stdout.startswith("Usable with care")
    assert "The simulation deviates from the vehicle" in (tmp_path / "both.html").read_text()


@pytest.mark.parametrize("out", ["report.docx", "fit.json"])
def test_a_report_of_another_name_is_refused_before_anything_is_read(out, fitted):
    with pytest.raises(BadInput, match=r"a \.pdf or a \.html file"):
        CliRunner().invoke(report, [str(fitted), "--out", str(fitted.parent / out)], catch_exceptions=False)
    assert fitted.is_file()


@pytest.mark.slow
def test_draws_of_a_posterior_add_bands_and_a_corner_plot(motion_fit, laps, tmp_path):
    names = [f"lap{k}.csv" for k in range(3)]
    read_again = [read(written(lap, tmp_path / name), "canonical") for lap, name in zip(laps[:3], names, strict=True)]
    how = FitOptions(horizon=2.0, start_from="measured", solver="gauss-newton")
    free = ("I_z", "B_f", "B_r")
    model = motion_fit.model.with_parameters(
        *(replace(p, fixed=p.name not in free) for p in motion_fit.model.parameters)
    )
    found = fit(model, read_again[:2], validate=read_again[2], how=how)
    found.save(tmp_path / "fit.json")
    drawn = sample(found, read_again[:2], SampleOptions("laplace", 200))
    drawn.save(tmp_path / "posterior.parquet")
    told = greybox(
        "report", tmp_path / "fit.json", "--posterior", tmp_path / "posterior.parquet", "--out", tmp_path / "own.html",
        "--figures", tmp_path / "figures", "--json",
    ).told  # fmt: skip
    assert {str(tmp_path / "figures" / f"{name}.svg") for name in ("corner", "bands")} < set(told["figures"])
    page = (tmp_path / "own.html").read_text()
    assert "200 draws from the fit's normal distribution, weighted by the posterior" in unescape(page)
    assert "of the readings are expected" in page
    fit(model, read_again[1:2], how=how).save(tmp_path / "other.json")
    arguments = ("--posterior", tmp_path / "posterior.parquet", "--out", tmp_path / "none.pdf")
    assert "another fit" in refused("report", tmp_path / "other.json", *arguments)
    two = (tmp_path / "fit.json", tmp_path / "other.json")
    assert "is the posterior of one fit" in refused("report", *two, *arguments)
