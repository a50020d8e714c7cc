"""Several starts of a fit: where each ended beside the estimate, in its standard deviations."""

from dataclasses import replace

import numpy as np
import pytest
from letters_of import troubles

from greybox_id.reports.content import starts_table as starts
from greybox_id.reports.figures.estimates import REACH, spread_of
from greybox_id.reports.figures.estimates import starts as picture


@pytest.fixture(scope="module")
def three(motion_fit):
    """Three starts: one at the estimate, one as good but 2.5 standard deviations off in I_z, one far off and worse."""
    own, sd = motion_fit.model, motion_fit.sd
    at = {name: float(own[name].array) for name in ("I_z", "steering_delay")}
    off = {**at, "I_z": at["I_z"] + 2.5 * float(sd["I_z"])}
    far = {"I_z": at["I_z"], "steering_delay": at["steering_delay"] - 9.0 * float(sd["steering_delay"])}
    return replace(motion_fit.stages[-1], starts=(100.0, 100.01, 120.0), ended_at=(at, off, far))


def test_a_fit_keeps_where_its_starts_ended(motion_fit):
    stage = motion_fit.stages[-1]
    assert len(stage.starts) == len(stage.ended_at) == 2
    free = {p.name for p in motion_fit.model.parameters if not p.fixed}
    assert all(set(own) == free for own in stage.ended_at)
    for name, value in stage.ended_at[0].items():  # Ipopt only polishes what the best one found
        assert abs(value - float(motion_fit.model[name].array)) < 0.1 * float(motion_fit.sd[name])


def test_ends_are_counted_in_standard_deviations_and_known_as_good_or_not(motion_fit, three):
    found = spread_of(motion_fit, three)
    np.testing.assert_allclose([off for off, _ in found["I_z"]], [0, 2.5, 0], atol=1e-9)
    np.testing.assert_allclose([off for off, _ in found["steering_delay"]], [0, 0, -9], atol=1e-9)
    assert [same for _, same in found["I_z"]] == [True, True, False]


def test_every_start_has_a_row_with_what_is_furthest_off(motion_fit, three):
    rows = starts(motion_fit, three).rows
    assert rows[0][2:] == ("–", "–", "–")
    assert rows[1][2:] == ("0.010 %", "I_z", "2.5 sd")
    assert rows[2][2:] == ("20 %", "steering_delay", "−9.0 sd")


def test_a_single_start_and_files_that_kept_none_have_no_picture(motion_fit, three):
    for stage in (replace(three, ended_at=()), replace(three, starts=(100.0,), ended_at=three.ended_at[:1])):
        assert picture(motion_fit, stage) is None
        assert not starts(motion_fit, stage).rows


def test_what_is_far_off_lies_at_the_edge_beside_an_arrow(motion_fit, three):
    figure = picture(motion_fit, three)
    (ax,) = figure.axes
    assert [tick.get_text() for tick in ax.get_yticklabels()] == ["steering delay", "I_z"]
    _, other, same = ax.lines
    assert (-REACH, 0.0) in zip(*other.get_data(), strict=True)
    assert sorted(same.get_xdata()) == pytest.approx([0, 0, 0, 2.5], abs=1e-9)
    assert [text.get_text() for text in ax.texts] == ["<"]
    assert troubles(figure.svg()) == []
