"""The verdict on a track: innovations that are what was said of them, and those that are not."""

from types import SimpleNamespace

import numpy as np
import pytest
from simulated import clean

from greybox_id.datasets.recording import Recording
from greybox_id.filters.findings import consistency, widening
from greybox_id.filters.track import verdict
from greybox_id.fitting.fit import NOT_USABLE, USABLE, WITH_CARE

NOTHING_ELSE = Recording("drive", 0.02 * np.arange(3000), {})
MODEL = SimpleNamespace(inputs=("steer", "v_x"), outputs=("yaw_rate", "a_y"), aliases={})


def tracked(recording=NOTHING_ELSE, walk=0.01, origin="tuned", **channels):
    """What a filter leaves of channels: innovations (n,) of each, where it expected a standard deviation of one."""
    judged = {name: consistency(off, np.ones(len(off)), 100, 5.0) for name, off in channels.items()}
    return SimpleNamespace(
        consistency=judged, innovations=channels, expected={name: np.ones(len(off)) for name, off in channels.items()},
        sentences=(), widened=widening(judged.values()), recording=recording, model=MODEL,
        tracked=("stiffness_r",), noise={"walk_stiffness_r": walk}, noise_from={"walk_stiffness_r": origin},
    )  # fmt: skip


def white(sd, seed=0, count=3000):
    return sd * np.random.default_rng(seed).standard_normal(count)


def hanging(count=3000):
    off = white(1.0, 1, count)
    for k in range(1, count):
        off[k] = 0.9 * off[k - 1] + np.sqrt(1 - 0.81) * off[k]
    return off


def test_innovations_that_are_what_the_filter_expects_are_usable():
    found = verdict(tracked(yaw_rate=white(1.0), a_y=white(1.0, 1)))
    assert found.usability == USABLE
    assert "NIS 1" in found.reasons[0] or "NIS 0.9" in found.reasons[0]


@pytest.mark.parametrize(
    ("off", "words"),
    [
        (white(0.2), "bands are too wide"),
        (white(1.8), "bands were widened"),
        (hanging(), "Successive innovations of"),
    ],
    ids=["NIS .04", "NIS 3", "coloured"],
)
def test_innovations_outside_their_band_are_to_be_used_with_care(off, words):
    found = verdict(tracked(yaw_rate=white(1.0), a_y=off))
    assert found.usability == WITH_CARE
    assert any(words in reason and "a_y" in reason for reason in found.reasons)


def test_a_filter_that_has_lost_the_vehicle_is_not_usable():
    found = verdict(tracked(yaw_rate=white(1.0), a_y=6.0 + white(1.0)))
    assert found.usability == NOT_USABLE
    assert "no longer follows the vehicle" in found.reasons[0]


@pytest.mark.parametrize(
    ("walk", "origin", "due"), [(0.02, "tuned", USABLE), (0.09, "tuned", WITH_CARE), (0.09, "stated", USABLE)]
)
def test_a_stiffness_that_is_tuned_to_walk_further_than_tyres_do_is_told(walk, origin, due):
    found = verdict(tracked(walk=walk, origin=origin, yaw_rate=white(1.0)))
    assert found.usability == due
    assert ("The tuned noise lets C_alpha_r change by 70 % in a minute" in found.reasons[0]) is (due == WITH_CARE)


FAULTS = {
    "some rows are missing": (
        lambda r: {"yaw_rate": np.where(np.arange(len(r)) % 3, r["yaw_rate"], np.nan)},
        WITH_CARE,
    ),
    "a wrong sign": (lambda r: {"yaw_rate": -r["yaw_rate"]}, NOT_USABLE),
    "steering shuffled": (lambda r: {"steer": np.random.default_rng(0).permutation(r["steer"])}, NOT_USABLE),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_what_the_data_check_says_counts_and_most_where_it_holds_of_all_rows(fault):
    r, (change, due) = clean(3), FAULTS[fault]
    assert verdict(tracked(r, yaw_rate=white(1.0))).usability == USABLE
    found = verdict(tracked(r.with_signals(**change(r)), yaw_rate=white(1.0)))
    assert found.usability == due
    assert found.reasons[0].startswith("Data check: ")
