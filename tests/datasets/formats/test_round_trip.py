"""A recording written in any format is the same recording when it is read again."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from greybox_id.base.errors import BadInput
from greybox_id.base.signals import SIGNALS
from greybox_id.datasets.column_map import Column, ColumnMap
from greybox_id.datasets.formats import WRITTEN, write
from greybox_id.datasets.read import read
from greybox_id.datasets.recording import Recording

ONE_MICROSECOND = 1e-6
NAMES = st.sampled_from(["lap", "Länge 7", "周回", "a.b", "lap[1]"])
VALUES = st.one_of(st.floats(-1e6, 1e6, allow_subnormal=False), st.just(np.nan))


@st.composite
def recordings(draw):
    runs = draw(st.lists(st.integers(2, 12), min_size=1, max_size=4))
    step = draw(st.integers(1, 500_000)) * 1e-6
    starts = [draw(st.integers(0, 10**9)) * 1e-6 for _ in runs]
    time = np.concatenate([start + step * np.arange(n) for start, n in zip(starts, runs, strict=True)])
    edges = np.concatenate([[0], np.cumsum(runs)]).tolist()
    names = draw(st.lists(st.sampled_from(sorted(SIGNALS)), min_size=1, max_size=5, unique=True))
    rows = int(sum(runs))
    signals = {name: np.array(draw(st.lists(VALUES, min_size=rows, max_size=rows))) for name in names}
    return Recording(draw(NAMES), time, signals, tuple(zip(edges, edges[1:], strict=False)))


@pytest.mark.slow
@pytest.mark.parametrize("suffix", WRITTEN)
@given(recording=recordings())
@settings(max_examples=12)
def test_every_format_gives_back_what_was_written(tmp_path, suffix, recording):
    file = tmp_path / f"{recording.name}{suffix}"
    write(recording, file)
    again = read(file)
    assert again.name == recording.name
    assert again.runs == recording.runs
    assert set(again.signals) == set(recording.signals)
    np.testing.assert_allclose(again.time, recording.time, rtol=0, atol=ONE_MICROSECOND)
    for name, values in recording.signals.items():
        np.testing.assert_array_equal(again[name], values)  # all of them hold doubles
    assert not again.resampled


@pytest.mark.parametrize("suffix", [s for s in WRITTEN if s not in (".mat", ".mcap")])
def test_channels_of_any_name_return_with_their_units(tmp_path, suffix):
    time = np.arange(5) * 0.01
    recording = Recording("lap", time, {"v_x": time, "größe, α": 2 * time}, extra_units={"größe, α": "m"})
    write(recording, tmp_path / f"lap{suffix}")
    mapping = ColumnMap(
        "own",
        Column("time", "time", "s", "s"),
        {"v_x": Column("v_x", "v_x", "m/s", "m/s")},
        {"größe": Column("größe", "größe, α", "m", "m")},
    )
    again = read(tmp_path / f"lap{suffix}", mapping)
    np.testing.assert_array_equal(again["größe"], 2 * time)


@pytest.mark.parametrize("suffix", [".mat", ".mcap"])
def test_a_name_that_a_format_cannot_hold_is_refused_and_leaves_no_file(tmp_path, suffix):
    recording = Recording("lap", np.arange(3.0), {"größe": np.zeros(3)}, extra_units={"größe": "m"})
    with pytest.raises(BadInput, match="größe"):
        write(recording, tmp_path / f"lap{suffix}")
    assert not list(tmp_path.iterdir())


def test_what_is_no_known_kind_is_not_written(tmp_path):
    with pytest.raises(BadInput, match="such a file with out"):
        write(Recording("lap", np.arange(3.0), {"v_x": np.zeros(3)}), tmp_path / "lap.txt")


@pytest.mark.parametrize("suffix", WRITTEN)
def test_content_goes_before_the_name(tmp_path, suffix):
    write(Recording("lap", np.arange(3.0), {"v_x": np.arange(3.0)}), tmp_path / f"lap{suffix}")
    if suffix == ".mcap":  # rosbags goes by the name
        return
    other = tmp_path / "lap.csv"
    (tmp_path / f"lap{suffix}").rename(other)
    np.testing.assert_array_equal(read(other)["v_x"], np.arange(3.0))
