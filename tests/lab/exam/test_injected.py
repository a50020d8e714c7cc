"""Real recordings altered as an effect would have altered them: exactly, and nothing else."""

import json
from itertools import product

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import Recording
from greybox_id.fitting.how import quiet
from greybox_id.gap.estimation.calibration import provenance
from greybox_id.models.effects import EFFECTS
from greybox_lab.cli.exam import diagnose_case
from greybox_lab.exam import changed
from greybox_lab.exam.altering import INJECTIONS, altered, scatter_between
from greybox_lab.exam.answers import read_answer
from greybox_lab.exam.folder import unbroken
from greybox_lab.exam.injected import DEVELOPMENT, EXAMINATION, SOURCES, make_injected, sources


@pytest.fixture
def window():
    time = np.concatenate([np.arange(100) * 0.02, np.arange(80) * 0.02])
    wave = np.sin(1.7 * np.arange(180) * 0.02)
    signals = {"v_x": 5.0 + wave, "v_y": 0.1 * wave, "yaw_rate": wave, "a_x": 0.3 * wave, "a_y": 2.0 * wave,
               "steer": 0.1 * wave}  # fmt: skip
    return Recording("drive", time, signals, runs=((0, 100), (100, 180)))


def test_every_injection_is_an_effect_and_its_null_is_nothing(window):
    assert set(INJECTIONS) <= set(EFFECTS)
    for name, own in INJECTIONS.items():
        same = altered(window, name, own.null)
        for signal, values in window.signals.items():
            np.testing.assert_allclose(same[signal], values, atol=1e-12)


def test_a_delay_means_that_the_command_was_given_earlier(window):
    late = altered(window, "steering_delay", 0.04)
    np.testing.assert_allclose(late["steer"][:98], window["steer"][2:100], atol=1e-12)
    np.testing.assert_allclose(late["steer"][100:178], window["steer"][102:180], atol=1e-12)  # not across the join
    assert late["yaw_rate"] is window["yaw_rate"] or np.array_equal(late["yaw_rate"], window["yaw_rate"])


def test_a_latency_reads_what_was(window):
    late = altered(window, "sensor_latency_yaw", 0.06)
    np.testing.assert_allclose(late["yaw_rate"][3:100], window["yaw_rate"][:97], atol=1e-12)
    np.testing.assert_allclose(late["yaw_rate"][103:], window["yaw_rate"][100:177], atol=1e-12)
    assert late["yaw_rate"][100] == window["yaw_rate"][100]


def test_a_ratio_and_an_offset_are_those_of_the_vehicle(window):
    np.testing.assert_allclose(1.2 * altered(window, "steering_ratio", 1.2)["steer"], window["steer"])
    np.testing.assert_allclose(altered(window, "steering_offset", 0.02)["steer"] + 0.02, window["steer"])


def test_a_turned_accelerometer_keeps_what_it_measures_in_all(window):
    turned = altered(window, "imu_mount_yaw", 0.2)
    before, after = (np.hypot(own["a_x"], own["a_y"]) for own in (window, turned))
    np.testing.assert_allclose(after, before)
    assert not np.allclose(turned["a_x"], window["a_x"])


def drive(lag=0.1, ratio=1.0, offset=0.0, bias=0.0, seed=0):
    """A car that steers with a lag, of which plain regressions know the understeer alone."""
    time = np.arange(1500) * 0.02
    rng = np.random.default_rng(seed)
    v = 6.0 + 3.0 * np.sin(0.4 * time + rng.uniform(0, 6))
    phase = rng.uniform(0, 6)
    steer, acted = (0.1 * np.sin(1.3 * (time - late) + phase) for late in (0.0, lag))
    yaw_rate = v * (acted / ratio - offset) / (2.5 * (1.0 + 0.002 * v**2))
    signals = {"v_x": v, "v_y": 0.4 * yaw_rate - 0.01 * v**2 * yaw_rate, "yaw_rate": yaw_rate,
               "a_x": np.gradient(v, time), "a_y": v * yaw_rate + bias, "steer": steer}  # fmt: skip
    return Recording("drive", time, signals, runs=((0, len(time)),))


def test_scatter_between_recordings_is_what_was_put_into_them():
    lags, ratios, offsets, biases = (0.06, 0.1, 0.14), (1.0, 1.1, 1.2), (-0.01, 0.0, 0.01), (0.0, 0.2, 0.4)
    told = scatter_between(
        [drive(*own, seed=k) for k, own in enumerate(zip(lags, ratios, offsets, biases, strict=True))]
    )
    assert told["steering_delay"] == pytest.approx(0.04, abs=0.006)
    assert told["steering_ratio"] == pytest.approx(np.std(np.log(ratios), ddof=1), rel=0.1)
    assert told["steering_offset"] == pytest.approx(np.std(np.array(offsets) * ratios, ddof=1), rel=0.2)
    assert told["accel_bias_y"] == pytest.approx(0.2, rel=0.01)
    assert told["velocity_lever_arm"] < 1e-9  # one car
    assert set(told) <= set(INJECTIONS)


def test_what_is_developed_on_is_not_examined():
    """Recordings that are diagnosed are of either development or examination; those from before both may have."""
    stretches = {name: SOURCES[name].after for name in SOURCES}
    for one, other in product(DEVELOPMENT, EXAMINATION):
        for (file, low, high), (another, from_, to) in product(stretches[one], stretches[other]):
            assert file != another or high <= from_ or to <= low
    assert not set(DEVELOPMENT) & set(EXAMINATION)
    assert set(DEVELOPMENT) | set(EXAMINATION) == set(SOURCES)
    assert sources(()) == EXAMINATION
    assert sources(("development", "truck")) == (*DEVELOPMENT, "truck")
    with pytest.raises(BadInput, match='no source "trucks"'):
        sources(("trucks",))


def test_numbers_of_a_diagnosis_were_chosen_on_no_recording_that_is_diagnosed():
    """But scatter between runs, which was learned on laps of DART as well: of that car there are no others."""
    chosen = " ".join(data for _, _, data in provenance().values()).lower()
    assert "dart" in chosen
    for name in DEVELOPMENT:  # scatters of other vehicles were learned on these; none is diagnosed here
        chosen = chosen.replace(name.replace("_", " "), "")
    assert not any(word in chosen for word in ("roboracer", "truck", "ferrari", "revs"))
    known = [part for name in DEVELOPMENT for part in (*SOURCES[name].before, *SOURCES[name].after)]
    for name in EXAMINATION:
        for file, begin, end in SOURCES[name].after:
            assert not [one for one in known if one[0] == file and begin < one[2] and one[1] < end]
    assert [name for name in EXAMINATION if SOURCES[name].vehicle == "dart"] == ["dart_laps"]
    chosen_on = {part.partition("/")[0] for own in changed.DEVELOPMENT.values() for part in own.recordings}
    examined = {file for name in EXAMINATION for file, _, _ in SOURCES[name].after}
    assert not {f"dart/{name}.csv.gz" for name in chosen_on} & examined


def test_pairs_that_numbers_were_chosen_on_are_no_cases_of_known_changes():
    told = [(frozenset(own.before), own.after, own.held_out) for own in changed.DEVELOPMENT.values()]
    assert not {(frozenset(case.before), case.after, case.held_out) for case in changed.CASES.values()} & set(told)
    assert not any(own.grip or own.faults for own in changed.DEVELOPMENT.values())
    for case in changed.CASES.values():
        if case.grip:  # no change was ever seen
            before, after = ({part.partition("/")[0] for part in parts if part}
                             for parts in (case.before, (case.after, case.held_out)))  # fmt: skip
            for pair in changed.DEVELOPMENT.values():
                parts = {part.partition("/")[0] for part in pair.recordings}
                assert not (parts & before and parts & after)


def test_recordings_that_are_not_there_are_told(tmp_path):
    with pytest.raises(BadInput, match=r"holds no .*roboracer/train\.csv"):
        make_injected(tmp_path / "exam", tmp_path, 1, 2, ["roboracer"], 1, quiet)
    with pytest.raises(BadInput, match=r"holds no dart/"):
        changed.make_changed(tmp_path / "exam", tmp_path, 1, [], 1, quiet)
    with pytest.raises(BadInput, match=r'no case "slipery".*Did you mean slippery'):
        changed.make_changed(tmp_path / "exam", tmp_path, 1, ["slipery"], 1, quiet)
    assert not (tmp_path / "exam").exists()
    assert {source.columns for source in SOURCES.values()} >= {"roboracer", "truck"}


def test_altered_recordings_stand_beside_themselves_unaltered(tmp_path, real_data):
    exam = make_injected(tmp_path / "exam", real_data, 3, 2, ["ferrari"], 1, quiet)
    assert exam.counts == {"single": 2, "null": 2}
    assert unbroken(exam.folder) == exam.seal
    answers = [read_answer(file) for file in sorted(exam.folder.glob("sealed/*/answer.json"))]
    for answer in answers:
        given = sorted(file.name for file in (exam.folder / "cases" / answer.case).iterdir())
        assert given == ["after.csv", "before_1.csv", "before_2.csv", "before_3.csv", "columns.toml", "recording.csv",
                         "vehicle.toml"]  # fmt: skip
        (beside,) = [other for other in answers if other.about == answer.about and other.kind != answer.kind]
        assert bool(answer.effects) != bool(beside.effects)
        if answer.kind == "single":
            (name,), (sd,) = answer.effects, answer.scatter.values()
            null = INJECTIONS[name].null
            away = abs(np.log(answer.effects[name])) if null == 1.0 else abs(answer.effects[name])
            assert min(3.0 * sd, INJECTIONS[name].most) - 1e-12 <= away <= 8.0 * sd
            assert answer.above == (away >= 4.0 * sd)
    again = make_injected(tmp_path / "again", real_data, 3, 2, ["ferrari"], 1, quiet)
    assert again.seal == exam.seal


@pytest.mark.slow
def test_a_real_change_is_examined_as_a_case(tmp_path, real_data):
    exam = changed.make_changed(tmp_path / "exam", real_data, 0, ["slippery"], 1, quiet)
    assert exam.counts == {"changed": 1}
    (answer,) = [read_answer(file) for file in exam.folder.glob("sealed/*/answer.json")]
    assert answer.effects["grip_scale"] == pytest.approx(0.51, abs=0.01)
    found = diagnose_case(exam.folder / "cases" / "case_000")
    assert tuple(found["applied"]) == ("grip_scale", "velocity_lever_arm")  # the pose differs, too
    assert {*found["applied"]} <= {*answer.effects, *answer.nature}
    assert json.dumps(found)
