"""Cases: dealt out evenly, seen by the recording alone, and told apart as far as the recording can."""

from collections import Counter
from math import inf
from types import SimpleNamespace

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets.read import read
from greybox_id.fitting.how import quiet
from greybox_id.models.effects import EFFECTS as KNOWN
from greybox_id.models.vehicle import vehicle
from greybox_lab.exam.aliases import GROUPS, Cause, View, always_alike, group_of, indistinguishable, partners
from greybox_lab.exam.answers import Answer, read_answer, write_answer
from greybox_lab.exam.folder import unbroken
from greybox_lab.exam.make import make
from greybox_lab.exam.plan import plan
from greybox_lab.exam.world import _VirtualCase
from greybox_lab.virtual.virtual_vehicle import EFFECTS, OUTSIDE


def planned(cases=300, nulls=50, seed=1):
    return plan(cases, nulls, "clean", seed, tuple(EFFECTS), tuple(OUTSIDE))


def test_the_examiner_knows_every_effect():
    assert sorted(name for names in GROUPS.values() for name in names) == sorted(EFFECTS)
    assert all(other in EFFECTS for name in EFFECTS for other in partners(name))
    assert all(other in KNOWN for name in EFFECTS for other in always_alike(name))  # models know more than this vehicle


def test_cases_are_dealt_out_evenly():
    cases = planned()
    assert Counter(case.kind for case in cases) == {"single": 171, "double": 75, "outside": 54, "null": 50}
    singles = Counter(case.effects[0] for case in cases if case.kind == "single")
    assert set(singles) == set(EFFECTS)
    assert max(singles.values()) - min(singles.values()) <= 1
    outside = Counter(case.effects[0] for case in cases if case.kind == "outside")
    assert set(outside) == set(OUTSIDE)


def test_two_effects_are_mostly_of_different_groups_and_never_always_alike():
    pairs = [case.effects for case in planned(1000) if case.kind == "double"]
    assert all(a != b and b not in always_alike(a) for a, b in pairs)
    assert np.mean([group_of(a) != group_of(b) for a, b in pairs]) > 0.85


def test_names_tell_nothing():
    kinds = [case.kind for case in planned()]
    assert [case.case for case in planned()] == [f"case_{k:03d}" for k in range(350)]
    assert 3 < sum(kind == "null" for kind in kinds[:70]) < 20
    assert planned(seed=1) == planned(seed=1) != planned(seed=2)


def test_no_cases_are_no_examination():
    with pytest.raises(BadInput, match="at least one case"):
        planned(0, 0)


TIME = np.linspace(0, 10, 1000)
SHAPES = {"steering_delay": np.sin(TIME), "steering_lag": np.sin(TIME) + 1e-2 * TIME, "yaw_inertia": np.cos(TIME)}
CAUSES = {name: Cause(0.0, lambda deviation: deviation, 0.1, "up") for name in SHAPES}


def look(effects):
    return sum((value * SHAPES[name] for name, value in effects.items()), np.zeros(len(TIME)))


def product(a, b):
    return float(np.sum(a * b))


def test_what_explains_as_well_is_alike():
    weak = indistinguishable({"steering_delay": 1.0}, CAUSES, [View(look, product)])
    assert weak == {"steering_delay": ("steering_lag",)}
    strong = indistinguishable({"steering_delay": 10.0}, CAUSES, [View(look, product)])
    assert strong == {"steering_delay": ()}


def test_an_effect_that_can_only_be_positive_explains_nothing_negative():
    assert indistinguishable({"steering_delay": -1.0}, CAUSES, [View(look, product)]) == {"steering_delay": ()}
    both = {name: Cause(0.0, lambda deviation: deviation, 0.1, "both") for name in SHAPES}
    assert indistinguishable({"steering_delay": -1.0}, both, [View(look, product)]) == {
        "steering_delay": ("steering_lag",)
    }


def test_what_tolerances_take_up_tells_nothing_apart():
    ramp = TIME / np.linalg.norm(TIME)

    def beside(a, b):
        return product(a, b) - product(a, ramp) * product(ramp, b)

    assert indistinguishable({"steering_delay": 10.0}, CAUSES, [View(look, beside)]) == {
        "steering_delay": ("steering_lag",)
    }


def test_exact_aliases_are_named_without_a_look():
    view = View(lambda effects: np.ones(3) * sum(effects.values()), product)
    assert indistinguishable({"imu_mount_roll": 1.0}, {}, [view]) == {"imu_mount_roll": ("accel_bias_y",)}


def test_answers_survive_the_file(tmp_path):
    answer = Answer("case_000", "single", "clean", {"steering_rate_limit": 0.4}, {"steering_rate_limit": inf},
                    {"steering_rate_limit": ("steering_lag",)}, {"yaw_rate": 1.0}, {"yaw_rate": 0.5}, seed=7,
                    car={"kind": "car"})  # fmt: skip
    assert read_answer(write_answer(answer, tmp_path / "answer.json")) == answer


@pytest.mark.slow
@pytest.mark.parametrize("tier", ["clean", "workshop"])
def test_an_examination_is_written_and_sealed(tmp_path, tier):
    made = make(tmp_path / "exam", 5, tier, 1, 1, 1, quiet)
    assert sum(made.counts.values()) == 2
    assert unbroken(made.folder, made.seal) == made.seal
    for case in ("case_000", "case_001"):
        given = made.folder / "cases" / case
        assert sorted(file.name for file in given.iterdir()) == ["recording.csv", "vehicle.toml"]
        recording, stated = read(given / "recording.csv"), vehicle(given / "vehicle.toml")
        answer = read_answer(made.folder / "sealed" / case / "answer.json")
        assert 60 <= recording.duration <= 120
        assert 49.9 < 1 / recording.sample_time < 100.1
        assert len(recording.runs) == 1
        assert 40 <= read(made.folder / "sealed" / case / "held_out.csv").duration <= 60
        assert stated.noise.keys() == answer.car["noise"].keys()
        assert bool(stated.effects) == (tier == "workshop")
        assert str(answer.seed) not in (given / "vehicle.toml").read_text()
        if tier == "clean":
            assert {name: own.value for name, own in stated.values.items()} == answer.car["parameters"]
        if answer.kind == "null":
            assert answer.largest == 0.0
            assert not answer.sizable
        else:
            assert answer.sizable


def test_no_examination_is_written_over(tmp_path):
    (tmp_path / "something").write_text("")
    with pytest.raises(BadInput, match="not empty"):
        make(tmp_path, 5, "clean", 1, 1, 1, quiet)


def test_an_examination_that_was_interrupted_is_gone_on_with(tmp_path):
    folder, whole = tmp_path / "exam", make(tmp_path / "whole", 5, "clean", 0, 3, 1, quiet)

    def interrupted(line, **_):
        if line.startswith("2/3"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make(folder, 5, "clean", 0, 3, 1, interrupted)
    first = folder / "cases" / "case_000" / "recording.csv"
    written = first.stat().st_mtime_ns
    with pytest.raises(BadInput, match=r"unfinished examination .*seed 5.* Repeat those options"):
        make(folder, 6, "clean", 0, 3, 1, quiet)
    told = []
    made = make(folder, 5, "clean", 0, 3, 1, lambda line, **_: told.append(line))
    assert told[0] == "2/3 were made before"
    assert first.stat().st_mtime_ns == written
    assert made.seal == whole.seal == unbroken(folder)
    with pytest.raises(BadInput, match="is not empty"):  # finished ones are never gone on with
        make(folder, 5, "clean", 0, 3, 1, quiet)


@pytest.mark.parametrize(("form", "lags"), [("soft_play", True), ("play", False)])
def test_what_a_car_has_beyond_its_tolerances_is_its_nature(form, lags):
    case = object.__new__(_VirtualCase)
    case.tolerances = SimpleNamespace(effects={"steering_offset": 0.001, "steering_ratio": 0.01})
    case.car = SimpleNamespace(small={"steering_offset": 0.0021, "steering_ratio": 1.019})
    case.effects, case.truth = {"steering_backlash": 0.003}, SimpleNamespace(forms=SimpleNamespace(backlash=form))
    assert case._nature() == ("steering_offset", *(["steering_lag"] if lags else []))
