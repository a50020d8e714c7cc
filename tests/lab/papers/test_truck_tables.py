"""The truck's tables: chunks of a recording stay together, intervals are over recordings, bad folders are sentences."""

import json

import numpy as np
import pandas as pd
import pytest
from calling import greybox, refused
from json_pages import PAGE, agree
from made_up_truck import truck_file

from greybox_id.base.errors import BadInput
from greybox_id.base.json_data import finite
from greybox_id.datasets.recording import Recording
from greybox_id.fitting import hybrid, pretraining
from greybox_lab.papers import truck as bench
from greybox_lab.papers import truck_comparisons, truck_sets
from greybox_lab.papers.bench import KeptBench
from greybox_lab.papers.truck import TruckOptions, grey_box, truck_tables
from greybox_lab.papers.truck_comparisons import redrawn, standard_error
from greybox_lab.papers.truck_grey_boxes import CANDIDATES
from greybox_lab.papers.truck_inputs import Chunks, by_speed, chunks, raw, splits
from greybox_lab.papers.truck_networks import LESSONS


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


def test_a_split_by_speed_trains_on_slow_recordings_alone():
    speed = np.repeat([5.0, 9.0, 5.0, 5.0, 9.0, 5.0], 3)
    runs = tuple((k, k + 3) for k in range(0, 18, 3))
    whole = Chunks(Recording("all", np.arange(18.0), {"v_x": speed}, runs=runs), np.array([0.0, 0, 1, 2, 3, 4]))
    first = np.arange(6) < 3
    found = {"train": whole.of(first, "train"), "val": whole.of(~first, "val")}
    own = by_speed(found, 6.0, 8.0)
    assert {split: each.piece_of.tolist() for split, each in own.items()} == {
        "train": [1.0], "val": [2.0, 4.0], "fast": [0.0, 3.0]
    }  # fmt: skip
    assert set(own["fast"].recording["v_x"]) == {9.0}
    assert by_speed(found, 6.0, 10.0) == {}


def test_an_angle_is_held_by_what_train_alone_told(three):
    own = bench.TruckSets(three).chunks(bench.ANGLE_HELD)
    plain = bench.TruckSets(three).chunks(bench.AS_PUBLISHED)
    for split in ("train", "val", "test"):
        np.testing.assert_array_equal(own[split].recording["v_y"], plain[split].recording["v_y"])
        assert np.any(own[split].recording["steer"] != plain[split].recording["steer"])
    truck_file(three / "val.parquet", 2, 17)
    again = bench.TruckSets(three).chunks(bench.ANGLE_HELD)
    np.testing.assert_array_equal(again["test"].recording["steer"], own["test"].recording["steer"])


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
    assert standard_error(each, piece)[0] == pytest.approx(1 / np.sqrt(50), rel=0.25)
    assert np.mean(redrawn(each, piece)) == pytest.approx(np.mean(each), abs=0.02)


def test_folders_without_the_recordings_are_refused(tmp_path):
    assert "is not a folder" in refused("bench", "truck", "--data", tmp_path / "none")
    assert "train.parquet is not there" in refused("bench", "truck", "--data", tmp_path, "--quick", "--json")
    for split in ("train", "val"):
        (tmp_path / f"{split}.parquet").write_bytes(b"no parquet")
    assert "train.parquet" in refused("bench", "truck", "--data", tmp_path, "--quick")


def altered(folder, split, change):
    file = folder / f"{split}.parquet"
    change(pd.read_parquet(file)).to_parquet(file)


@pytest.fixture
def three(tmp_path):
    for k, split in enumerate(("train", "val", "test")):
        truck_file(tmp_path / f"{split}.parquet", 2, k)
    return tmp_path


def test_a_model_whose_inputs_were_not_recorded_is_left_out(three):
    said, (causal, both) = [], (CANDIDATES[2], CANDIDATES[4])
    altered(three, "test", lambda table: table.drop(columns=["alpha2", "long", "lat"]))
    assert {row["split"] for row in grey_box(causal, three, False)[0]} == {"train", "val", "test"}
    assert {row["split"] for row in grey_box(both, three, False, said.append)[0]} == {"train", "val"}
    assert said == ["best with both angles is left out: test has no alpha2"]
    altered(three, "val", lambda table: table.drop(columns=["alpha2"]))
    assert grey_box(both, three, False, said.append) is None
    assert said[1:] == ["best with both angles is left out: val has no alpha2"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda table: table.iloc[::2], "number 1 lasts 10 s at 100 Hz"),
        (lambda table: table[table["time"] < 8.0], "number 1 lasts 8 s at 200 Hz"),
        (lambda table: table.assign(vy=table["vy"].where(table["time"] > 1.0)), "no reading of v_y in 42 of 400 rows"),
        (lambda table: table.drop(columns=["alpha1"]), "alpha1"),
    ],
)
def test_what_the_metric_cannot_be_taken_of_is_a_sentence(three, change, words):
    altered(three, "test", lambda table: change(table).reset_index(drop=True))
    with pytest.raises(BadInput, match=words):
        splits(three, raw, by_recording=False)


@pytest.fixture
def made_up(tmp_path, monkeypatch):
    """A folder of small recordings, and a bench of small networks that are hardly trained."""
    for k, split in enumerate(("train", "val")):
        truck_file(tmp_path / f"{split}.parquet", 4, k)
    monkeypatch.setattr(bench, "CANDIDATES", bench.CANDIDATES[:2])
    for part in (bench, truck_comparisons):
        monkeypatch.setattr(part, "SIZES", (2, 2, 2))
    for name in ("ADAM", "SHORT_STEPS", "STEPS"):
        monkeypatch.setattr(hybrid, name, 3)
        monkeypatch.setattr(pretraining, name, 3, raising=False)
    return tmp_path


def told_but_for_time(found):
    return finite([{name: own for name, own in row.items() if name != "cpu_seconds"} for row in found["rows"]])


@pytest.mark.slow
def test_test_is_scored_and_never_fitted_or_selected_on(made_up, monkeypatch):
    """Altering test.parquet alters what is said of test, and nothing else."""
    monkeypatch.setattr(bench, "METHODS", ("learning", "transfer"))
    without = truck_tables(made_up, TruckOptions(quick=True))
    found = []
    for seed in (7, 8):
        truck_file(made_up / "test.parquet", 3, seed)
        found.append(truck_tables(made_up, TruckOptions(quick=True)))
    one, other = map(told_but_for_time, found)
    assert [row for row in one if row["split"] != "test"] == told_but_for_time(without)
    assert len([row for row in one if row["split"] == "test"]) == 5
    for before, after in zip(one, other, strict=True):
        assert (before == after) == (before["split"] != "test")
    for name in ("identified", "learning_curves", "lessons"):
        assert found[0][name] == found[1][name] == without[name]
    beside = [own for own in without["comparisons"] if own["against"] == bench.CANDIDATES[1].name]
    assert {own["model"] for own in beside if not own["by_recording"]} == {
        bench.CANDIDATES[0].name, "MLP, 4 x 2, 1 s", "MLP, transfer learning, 4 x 2, 1 s",
        "bicycle and MLP, 4 x 2, 1 s, angle held",
    }  # fmt: skip
    pairs = [[own for own in each["comparisons"] if own["split"] != "test"] for each in (without, *found)]
    assert pairs[0] == pairs[1] == pairs[2] != []


@pytest.mark.slow
def test_trainings_are_kept_and_carried_on(made_up, tmp_path, monkeypatch):
    """Ctrl-C loses the training under way; the next run makes what is missing, and says what one run would."""
    count, real = 0, bench.trained

    def counted(*given):
        nonlocal count
        count += 1
        if count == 3:
            raise KeyboardInterrupt
        return real(*given)

    monkeypatch.setattr(bench, "trained", counted)
    file = tmp_path / "kept" / "truck.json"
    with pytest.raises(KeyboardInterrupt):
        truck_tables(made_up, TruckOptions(quick=True), kept=KeptBench("truck", tmp_path / "kept"))
    assert len(json.loads(file.read_text())["trainings"]) == 2
    nothing = truck_tables(made_up, TruckOptions(quick=True), kept=KeptBench("truck", file, minutes=0.0))
    assert (count, nothing["left_out"]) == (3, 5)
    found = truck_tables(made_up, TruckOptions(quick=True), kept=KeptBench("truck", file))
    assert (count, found["left_out"]) == (8, 0)
    again = truck_tables(made_up, TruckOptions(quick=True), kept=KeptBench("truck", file))
    whole = truck_tables(made_up, TruckOptions(quick=True))
    assert told_but_for_time(again) == told_but_for_time(found) == told_but_for_time(whole)
    with pytest.raises(BadInput, match="bench of 'truck'"):
        KeptBench("msnn", file)
    truck_file(made_up / "train.parquet", 4, 9)  # other data: nothing that is kept is of them
    before = count
    truck_tables(made_up, TruckOptions(quick=True), kept=KeptBench("truck", file))
    assert count == before + 7


@pytest.mark.slow
def test_the_report_holds_tables_figures_and_curves(made_up, tmp_path, monkeypatch):
    for part in (bench, truck_comparisons):
        monkeypatch.setattr(part, "SHARES", (0.5, 1.0))
        monkeypatch.setattr(part, "TAUGHT_ON", (0.5,))
    monkeypatch.setattr(truck_sets, "SLOW", 12.6)
    monkeypatch.setattr(truck_sets, "FAST", 12.6)
    page = tmp_path / "page"
    told = greybox(
        "bench", "truck", "--data", made_up, "--curves", "--seeds", 2, "--report", page, "--out", tmp_path / "own.json",
        "--json",
    ).told  # fmt: skip
    agree(told, PAGE["bench truck"], "bench truck")
    assert told["report"] == [str(page / "truck.html"), str(page / "truck.pdf")]
    assert {own["share"] for own in told["learning_curves"]} == {0.5, 1.0}
    assert {own["taught"] for own in told["lessons"]} == set(LESSONS)
    beyond = [own for own in told["out_of_range"] if own["output"] == "v_y"]
    assert [own["ratio"] == 1.0 for own in beyond] == [True, *[False] * 5]
    assert all(own["low"] <= own["ratio"] <= own["high"] for own in beyond)
    assert all(0 <= share <= 1 for own in told["traces"]["lines"] for share in own["coverage"])
    text = (page / "truck.html").read_text()
    for words in ("As Fig. 3", "As Fig. 4", "Table IV", "a passenger car", "Seeds: 2", "tyres half as stiff"):
        assert words in text
    assert (page / "truck.pdf").read_bytes().startswith(b"%PDF")
