"""Figures: labelled with units, the same every time, and drawn only where the model gives them a meaning."""

import re

import numpy as np
import pytest
from letters_of import troubles

from greybox_id.datasets.recording import Recording
from greybox_id.engine.series import runs
from greybox_id.engine.trace import Trace
from greybox_id.models.memory_model import MemoryModel
from greybox_id.models.msnn_full import msnn_full
from greybox_id.models.msnn_lat import msnn_lat
from greybox_id.models.msnn_long import msnn_long
from greybox_id.reports.document import write_drawings
from greybox_id.reports.figures.characteristics import has_steering, responses, steady_yaw_rate
from greybox_id.reports.figures.predictions import psd
from greybox_id.reports.recordings import noise, typical_stretch
from greybox_id.reports.report import prepared

UNIT = re.compile(r"\[.+\]")


def test_there_is_every_figure_that_the_model_gives_a_meaning(made):
    assert [one.name for one in made] == [
        *("errors", "traces", "traces_training", "residuals", "spectrum"),
        *("steering", "impulse_responses", "excitation"),
    ]
    assert not has_steering(msnn_long())


def test_every_axis_is_labelled_with_a_unit(made, motion_made):
    for one in (*made, *motion_made):
        if one.name == "correlation":  # its axes hold names
            continue
        kept = [[ax for ax in row if ax in one.figure.axes] for row in one.figure.grid]
        for row in kept:
            labels = [ax.get_ylabel() for ax in row]
            named = one.name == "starts"  # a row for each parameter
            assert named or any(UNIT.search(label) for label in labels), f"{one.name}: {labels}"
        for ax in kept[-1]:
            assert UNIT.search(ax.get_xlabel()), f"{one.name}: {ax.get_xlabel()!r}"


def test_no_letters_are_cut_off_or_meet(made, motion_made):
    for one in (*made, *motion_made):
        assert troubles(one.svg) == [], one.name


def test_files_are_the_same_every_time_and_need_nothing_but_themselves(made, small_fit, train, validate, tmp_path):
    again = prepared(small_fit, [train, validate]).drawings
    files = write_drawings(again, tmp_path / "new")
    assert [file.name for file in files] == [f"{one.name}.svg" for one in made]
    for one, file in zip(made, files, strict=True):
        assert file.read_text("utf-8") == one.svg
        assert not re.search(r"href=\"(?!#)|url\((?!#)", one.svg)  # all it refers to is in it
        assert one.svg.count("http") == 1  # the name of the format
    assert sorted((tmp_path / "new").iterdir()) == sorted(files)


def test_impulse_responses_are_found_by_their_use_not_their_name():
    assert [p.name for p in responses(msnn_lat())] == ["F"]
    assert [p.name for p in responses(msnn_full())] == ["F", "G_1t", "G_1b", "F_y"]


def test_the_steering_characteristic_is_what_a_long_constant_drive_ends_in(small_fit):
    steer, v_x = np.array([-0.2, 0.0, 0.15]), 2.0
    trace = Trace(small_fit.model)
    rows = trace.memory + 1
    ends = []
    for angle in steer:
        held = {"v_x": v_x, "steer": angle, "a_x": 0.0, "yaw_rate": 0.0}
        drive = Recording("held", 0.05 * np.arange(rows), {n: np.full(rows, v) for n, v in held.items()})
        ends.append(runs(trace, drive)[0].predict(small_fit.model.values)[-1, 0])
    np.testing.assert_allclose(steady_yaw_rate(trace, steer, v_x), ends, rtol=1e-12)


def test_inputs_that_follow_from_outputs_settle_in_the_steady_state():
    def equations(u, p, past):
        del p
        return {"yaw_rate": 2.0 * u.v_x * u.steer - 0.1 * past(u.a_y, [0.5, 0.5])}

    model = MemoryModel(
        name="leaning", about="", inputs=("v_x", "steer", "a_y"), outputs=("yaw_rate",), parameters=(),
        equations=equations, sample_time=0.05,
        feedback=lambda y, u: {"a_y": y.yaw_rate * u.v_x},
    )  # fmt: skip
    rate = steady_yaw_rate(Trace(model), np.array([0.1]), 3.0)
    assert rate[0] == pytest.approx(2.0 * 3.0 * 0.1 / (1 + 0.1 * 3.0))


def test_the_spectrum_of_white_noise_holds_its_variance():
    parts = [np.random.default_rng(k).standard_normal(n) * 0.3 for k, n in enumerate((700, 400, 40))]
    frequency, density = psd(parts, 20.0)
    assert np.sum(density) * frequency[1] == pytest.approx(0.09, rel=0.1)


def test_noise_that_does_not_vary_has_no_spectrum(small_fit, train, validate):
    """A speed that reads zero at rest: the axis of its spectrum would have no end."""
    still = [one.with_signals(yaw_rate=np.where(np.abs(one["v_x"]) < 0.01, 0.0, one["yaw_rate"]))
             for one in (train, validate)]  # fmt: skip
    drawn = next(one for one in prepared(small_fit, still).drawings if one.name == "spectrum")
    assert drawn.svg.startswith("<svg")
    assert drawn.figure.first().get_ylim()[0] > 1e-30


def test_no_stretch_is_more_typical_than_the_one_shown(found):
    one = found[1]
    start, stop = typical_stretch(one)
    assert any(a <= start and stop <= b for a, b in one.recording.runs)
    scored = one.predicted[one.main]
    squares = ((scored.predicted - scored.measured) ** 2).mean(axis=1)

    def distance(first):
        inside = (scored.rows >= first) & (scored.rows < first + stop - start)
        return abs(np.log(squares[inside].mean() / squares.mean()))

    others = [a for low, high in one.recording.runs for a in range(low + 6, high - (stop - start) + 1, 7)]
    assert distance(start) <= min(map(distance, others)) + 1e-12


def test_noise_is_heard_driving_straight_where_that_lasts_and_else_at_rest(simple):
    random = np.random.default_rng(0)
    time = np.arange(0, 60, 0.05)
    weave = np.where((time > 20) & (time < 40), 0.0, np.sin(time))
    straight = simple(v_x=np.full(len(time), 2.0), yaw_rate=weave + 0.001 * random.standard_normal(len(time)))
    heard = noise([straight])
    assert heard.where == "straight at constant speed"
    assert heard.sd("yaw_rate") == pytest.approx(0.001, rel=0.15)

    stops = simple(v_x=2.0 * (time > 10) * (1 + 0.3 * np.sin(time)), yaw_rate=np.sin(time) * (time > 10))
    assert noise([stops]).where == "at rest"
    assert noise([simple(v_x=2.0 + np.sin(time), yaw_rate=np.sin(2 * time))]) is None


def test_a_fit_without_spread_in_its_recordings_is_drawn_all_the_same(small_fit, train, validate):
    """Recordings that stand still: no curvature can be measured."""
    still = [one.with_signals(v_x=np.zeros(len(one))) for one in (train, validate)]
    for one in prepared(small_fit, still).drawings:
        assert one.svg.startswith("<svg")
