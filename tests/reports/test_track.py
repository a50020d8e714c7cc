"""What tracking finds: digest, pictures, file and report."""

import json
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pypdfium2 as pdfium
import pytest
from driven import without
from letters_of import troubles
from linear_bicycle import VEHICLE, recorded
from pdf_boxes import over_others

from greybox_id.base.errors import BadInput
from greybox_id.base.json_data import checksum
from greybox_id.datasets.recording import join
from greybox_id.filters.verb import track
from greybox_id.models.effects import EFFECTS
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle
from greybox_id.reports.document import write_drawings
from greybox_id.reports.figures.characteristics import forces_over_slip
from greybox_id.reports.html import page
from greybox_id.reports.pdf import rendered, write_pdf
from greybox_id.reports.track.digest import TrackMade, as_text, digest, load_track
from greybox_id.reports.track.report import drawings, over_time, track_report, verdict

MADE = TrackMade("car", "greybox track lap.csv", "0.1.0", tuned_on=2.0)


@pytest.fixture(scope="module")
def lap():
    time = np.arange(200) / 50.0
    runs = [recorded(0.03 * np.sin(2.5 * time), 14.0, 60e3, 75e3, rate=50.0, seed=seed) for seed in (0, 1)]
    return join(runs, "lap")


@pytest.fixture(scope="module")
def found(lap):
    model = build("lateral", {"tyre": "linear"}, None, VEHICLE)
    return track(model, lap, ("C_alpha_f", "C_alpha_r"), disturbances=("road_bank",), effects=EFFECTS, tune=2,
                 smooth=True, noise={"noise_a_y": 0.2})  # fmt: skip


@pytest.fixture(scope="module")
def told(found, lap):
    return digest(found, lap, MADE)


def test_there_is_a_picture_of_estimates_of_forces_and_of_innovations(told, tmp_path):
    made = drawings(told)
    assert [own.name for own in made] == ["estimates", "forces_over_slip", "innovations", "whiteness"]
    assert [trouble for own in made for trouble in troubles(own.svg)] == []
    paths = write_drawings(made, tmp_path)
    assert all(path.read_text("utf-8").startswith("<svg") for path in paths)


def test_estimates_are_drawn_run_by_run_with_what_was_measured(told, found, lap):
    ax = over_time(told).first()
    one, border, two, measured = ax.lines
    drawn = np.concatenate([own.get_ydata() for own in (one, two)])
    np.testing.assert_allclose(drawn, found.values["sideslip"], rtol=1e-5)
    np.testing.assert_allclose(measured.get_ydata(), np.arctan2(lap["v_y"], lap["v_x"]), rtol=1e-5)
    assert border.get_xdata()[0] == two.get_xdata()[0]
    assert len(ax.collections) == 2  # bands
    assert troubles(over_time(told).svg()) == []


def test_runs_whose_clocks_begin_anew_are_drawn_one_behind_the_other(told, found):
    assert np.any(np.diff(found.time) < 0)
    assert np.all(np.diff(told.course.time) > 0)
    assert all(np.all(np.diff(channel.time) > 0) for channel in told.innovations.values())


def test_stiffness_and_forces_have_a_panel_each(told):
    assert [*told.course.sds] == ["sideslip", "C_alpha_f", "C_alpha_r", "F_yf", "F_yr", "road_bank"]
    assert "N/rad" in over_time(told).grid[1, 0].get_ylabel()
    assert told.estimates["C_alpha_f"].told is not None
    assert told.estimates["F_yf"].told is None


def test_a_stiffness_stands_in_the_place_of_the_factor_that_walks(lap):
    model = build("lateral", None, None, vehicle("full_size_car"))
    found = track(model, lap, ("C_alpha_f",), tune=0)
    told = digest(found, lap, MADE)
    assert "stiffness_f" in found.told
    assert "stiffness_f" not in told.estimates
    assert told.estimates["C_alpha_f"].told == found.told["stiffness_f"]
    assert "C_alpha_f" in told.course.sds


def test_what_does_not_move_is_not_drawn(found, lap):
    still = replace(found, values={**found.values, "C_alpha_f": np.full(len(found.rows), 6e4)})
    assert "C_alpha_f" not in digest(still, lap, MADE).course.sds


def test_a_model_without_axle_forces_has_no_picture_of_them(found, lap):
    bare = digest(replace(found, values={n: v for n, v in found.values.items() if not n.startswith("F_y")}), lap, MADE)
    assert forces_over_slip(bare.course.values) is None
    assert [drawing.name for drawing in drawings(bare)] == ["estimates", "innovations", "whiteness"]


def test_innovations_are_drawn_as_means_over_two_seconds(found, told):
    figure = next(drawing for drawing in drawings(told) if drawing.name == "innovations").figure
    assert len(figure.axes) == len(found.innovations) == 2
    off, expected = found.innovations["yaw_rate"], found.expected["yaw_rate"]
    (line,) = figure.first().lines
    np.testing.assert_allclose(line.get_ydata()[0], np.mean((off / expected)[:100] ** 2), rtol=1e-5)


def test_the_correlation_of_innovations_with_the_next_is_that_of_the_filter_s_own_judgement(told):
    for name, own in told.innovations.items():
        assert own.correlation[0] == 1.0
        assert own.correlation[1] == pytest.approx(told.consistency[name].correlation, abs=0.03)


def test_what_was_measured_and_read_is_no_truth(told, found, lap):
    assert set(told.truth) == {"sideslip", "v_y"}
    off = found.values["v_y"] - lap["v_y"]
    assert told.truth["v_y"].rmse == pytest.approx(np.sqrt(np.mean(off**2)))
    assert told.truth["v_y"].worst == off[np.argmax(np.abs(off))]
    assert told.truth["v_y"].inside == np.mean(np.abs(off) <= 2 * found.sds["v_y"])
    blind = digest(found, without(lap, "v_y"), MADE)
    assert not blind.truth
    assert "so the error of the estimates is not known" in verdict(blind)[2]


def test_noise_has_a_unit_and_says_where_it_is_from(told):
    assert told.noise["noise_a_y"].origin == "stated"
    assert (told.noise["noise_a_y"].size, told.noise["noise_a_y"].unit) == (0.2, "m/s^2")
    assert told.noise["noise_yaw_rate"].origin == "tuned"
    assert "noise_v_y" not in told.noise
    units = {name: own.unit for name, own in told.noise.items()}
    assert (units["walk_v_y"], units["walk_C_alpha_f"], units["memory_road_bank"]) == ("m/s", "1", "s")


def test_long_recordings_are_thinned_for_pictures_and_counted_whole(found, lap, monkeypatch):
    monkeypatch.setattr("greybox_id.reports.track.digest.MOST_ROWS", 100)
    thin = digest(found, lap, MADE)
    assert (thin.course.every, len(thin.course.time), thin.rows) == (4, 100, 400)
    assert "One of 4 rows is drawn" in drawings(thin)[0].caption


def words_of(document):
    return page(document)


def test_the_report_says_what_was_estimated_and_how_far_to_trust_it(told):
    document = track_report(told)
    said = words_of(document)
    for title in ("Provenance", "What was estimated", "Against what was measured", "standard deviations right", "noise",
                  "Signals used", "Equations of the model", "Limits"):  # fmt: skip
        assert title in said
    assert len(document.verdict) == 3
    assert "greybox track lap.csv" in said
    assert "tuned on the first 2 s" in said
    assert rendered(document).startswith(b"%PDF")


def saved(digest, folder):
    file = folder / "lap.json"
    file.write_text(as_text(digest), encoding="utf-8")
    return file


def test_the_report_of_a_saved_track_is_that_of_the_track(told, tmp_path):
    file = saved(told, tmp_path)
    again = load_track(file)
    assert page(track_report(again)) == page(track_report(told))
    assert as_text(again) == as_text(told)


@pytest.mark.parametrize("name", ["2026-11-05_proving_ground_north_wet_tyres_third_try", "W" * 120])
def test_the_title_names_car_and_file_and_lies_over_nothing(name, told, tmp_path):
    data = replace(told.data, path=f"{name}.csv")
    document = track_report(replace(told, data=data, made=replace(told.made, vehicle=name)))
    assert document.title == f"Track of {name}: {name}.csv"
    with pdfium.PdfDocument(write_pdf(document, tmp_path / "track.pdf")) as pdf:
        assert [trouble for sheet in pdf for trouble in over_others(sheet)] == []


def test_other_files_are_no_tracks(tmp_path):
    for name, text in (("fit.json", '{"format": "greybox-fit"}'), ("x.json", "{")):
        (tmp_path / name).write_text(text)
        with pytest.raises(BadInput):
            load_track(tmp_path / name)


@pytest.mark.parametrize("name", ["made", "data", "estimates", "truth", "noise", "signals", "course", "innovations"])
@pytest.mark.parametrize("value", [None, 7, "x", [1], {"a": 1}])
def test_hostile_content_with_a_right_checksum_is_a_sentence_or_read(name, value, told, tmp_path):
    body = json.loads(as_text(told)) | {name: value}
    del body["checksum"]
    body["checksum"] = checksum(body)
    file = tmp_path / "lap.json"
    file.write_text(json.dumps(body), encoding="utf-8")
    with suppress(BadInput):
        load_track(file)
