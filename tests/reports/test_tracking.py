"""Pictures of tracking hold what was estimated."""

from dataclasses import replace

import numpy as np
import pytest
from letters_of import troubles
from linear_bicycle import VEHICLE, recorded

from greybox_id.filters import track
from greybox_id.models.registry import build
from greybox_id.recording import join
from greybox_id.reports.drawing import write_drawings
from greybox_id.reports.figures.slips import forces_over_slip
from greybox_id.reports.plot.marks import Band, Curve
from greybox_id.reports.tracking import drawings
from greybox_id.reports.tracking.bands import over_time


@pytest.fixture(scope="module")
def lap():
    time = np.arange(200) / 50.0
    runs = [recorded(0.03 * np.sin(2.5 * time), 14.0, 60e3, 75e3, rate=50.0, seed=seed) for seed in (0, 1)]
    return join(runs, "lap")


@pytest.fixture(scope="module")
def found(lap):
    model = build("lateral", {"tyre": "linear"}, None, VEHICLE)
    return track(model, lap, ("C_alpha_f", "C_alpha_r"), tune=0, smooth=True)


def test_there_is_a_picture_of_estimates_of_forces_and_of_innovations(found, lap, tmp_path):
    made = drawings(found, lap)
    assert [own.name for own in made] == ["estimates", "forces_over_slip", "innovations"]
    paths = write_drawings(made, tmp_path)
    assert all(path.read_text("utf-8").startswith("<svg") for path in paths)


def test_estimates_are_drawn_run_by_run_with_what_was_measured(found, lap):
    figure = over_time(found, lap, ("sideslip",))
    (panel,) = figure.panels
    *estimates, measured = (mark for mark in panel.marks if isinstance(mark, Curve))
    np.testing.assert_array_equal(np.concatenate([own.y for own in estimates]), found.values["sideslip"])
    np.testing.assert_array_equal(measured.y, np.arctan2(lap["v_y"], lap["v_x"]))
    assert sum(isinstance(mark, Band) for mark in panel.marks) == len(estimates) == 2
    assert troubles(figure.svg()) == []


def test_stiffness_and_forces_have_a_panel_each(found, lap):
    figure = over_time(found, lap)
    assert len(figure.panels) == 5
    assert "N/rad" in figure.panels[1].y.label


def test_a_model_without_axle_forces_has_no_picture_of_them(found, lap):
    bare = replace(found, values={n: v for n, v in found.values.items() if not n.startswith("F_y")})
    assert forces_over_slip(bare.values) is None
    assert [own.name for own in drawings(bare, lap)] == ["estimates", "innovations"]


def test_innovations_are_drawn_as_means_over_two_seconds(found, lap):
    figure = drawings(found, lap)[-1].figure
    assert len(figure.panels) == len(found.innovations) == 2
    off, expected = found.innovations["yaw_rate"], found.expected["yaw_rate"]
    (line,) = (mark for mark in figure.panels[0].marks if isinstance(mark, Curve))
    squares = (off / expected) ** 2
    np.testing.assert_allclose(line.y[0], np.mean(squares[:100]), rtol=1e-12)
