"""The truck's tables: chunks of a recording stay together, intervals are over recordings, bad folders are sentences."""

import numpy as np
import pytest
from calling import refused

from greybox_id.bench.truck import Chunks, _redrawn, _spread, chunks, splits
from greybox_id.bench.truck_inputs import raw
from greybox_id.recording import Recording


def test_a_split_by_recording_shares_no_recording(real_data):
    found = splits(real_data / "truck", raw, by_recording=True)
    assert not set(found["train"].piece_of) & set(found["val"].piece_of)
    assert "test" not in found
    published = splits(real_data / "truck", raw, by_recording=False)
    assert set(published["train"].piece_of) & set(published["val"].piece_of)
    count = sum(len(own.recording.runs) for own in found.values())
    assert count == 137 == sum(len(published[s].recording.runs) for s in ("train", "val"))


def test_chunks_are_told_by_their_first_second(real_data):
    own = chunks(real_data / "truck" / "train.parquet")
    assert len(own.piece_of) == 86
    assert list(own.piece_of[:4]) == [0, 2, 2, 2]  # numbers 0, 2, 5, 6, begun at 0, 0, 30, 40 s


def test_some_chunks_keep_their_rows():
    time = np.concatenate([np.arange(4.0), np.arange(3.0), np.arange(5.0)])
    whole = Recording("all", time, {"v_y": np.arange(12.0)}, runs=((0, 4), (4, 7), (7, 12)))
    own = Chunks(whole, np.array([0.0, 0.0, 1.0])).of(np.array([True, False, True]), "some")
    assert own.recording.runs == ((0, 4), (4, 9))
    assert own.recording["v_y"].tolist() == [0, 1, 2, 3, 7, 8, 9, 10, 11]
    assert own.piece_of.tolist() == [0.0, 1.0]


def test_standard_errors_are_over_recordings():
    rng = np.random.default_rng(0)
    each = np.repeat(rng.standard_normal((50, 1)), 4, axis=0)  # chunks of a recording repeat each other
    piece = np.repeat(np.arange(50.0), 4)
    assert _spread(each, piece)[0] == pytest.approx(1 / np.sqrt(50), rel=0.25)
    assert np.mean(_redrawn(each, piece)) == pytest.approx(np.mean(each), abs=0.02)


def test_folders_without_the_recordings_are_refused(tmp_path):
    assert "is no folder" in refused("bench", "truck", "--data", tmp_path / "none")
    assert "train.parquet is not there" in refused("bench", "truck", "--data", tmp_path, "--quick", "--json")
    for split in ("train", "val"):
        (tmp_path / f"{split}.parquet").write_bytes(b"no parquet")
    assert "train.parquet" in refused("bench", "truck", "--data", tmp_path, "--quick")
