"""Foreign vehicles: what is withheld shows, what is stated fits, and what calibrates never examines."""

import builtins
import re
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import greybox_id.gap
from greybox_id.base.errors import BadInput
from greybox_id.datasets.read import read
from greybox_id.fitting.how import quiet
from greybox_id.models.vehicle import vehicle
from greybox_lab.exam.aliases import always_alike, group_of
from greybox_lab.exam.answers import read_answer
from greybox_lab.exam.folder import unbroken
from greybox_lab.exam.foreign.case import FORM_MOST, accelerations, driven, identified, readings, replayed
from greybox_lab.exam.foreign.double_track import DoubleTrack, curve
from greybox_lab.exam.foreign.families import (
    DEVELOPMENT,
    EXAMINATION,
    FAMILIES,
    OF_SENSORS,
    OUTSIDE,
    ROUGH,
    able,
    dealt_out,
    families,
    magnitude,
    roughened,
    withheld,
)
from greybox_lab.exam.foreign.suspended_car import SuspendedCar
from greybox_lab.exam.foreign.vehicles import single_track
from greybox_lab.exam.make import make_foreign
from greybox_lab.exam.plan import Counts
from greybox_lab.virtual.virtual_vehicle import EFFECTS, random_vehicle

needs_slipx = pytest.mark.skipif(find_spec("slipx") is None, reason="slipx is not installed")


def drawn(family="tmeasy", number=0):
    return FAMILIES[family].draw(np.random.default_rng(5), number)


def ride(own, seconds=8.0, seed=2, rate=50.0, **effects):
    numbers = withheld(own.numbers, effects, own.about)
    gusts = np.random.default_rng(1).standard_normal(1000)
    return driven(FAMILIES[own.family].build(numbers, gusts), own.about, seconds, rate, seed)


def test_what_calibrates_never_examines():
    assert not set(DEVELOPMENT) & {*EXAMINATION, *ROUGH}
    assert {*DEVELOPMENT, *EXAMINATION, *ROUGH} == set(FAMILIES)
    assert families(()) == EXAMINATION
    assert families(("development", "slipx")) == (*DEVELOPMENT, "slipx")
    with pytest.raises(BadInput, match='no family "bike"'):
        families(("bike",))


@pytest.mark.parametrize("family", sorted({*DEVELOPMENT, *EXAMINATION}))
def test_what_lacks_nothing_has_hardly_anything_that_could_be_named(family):
    traces = {"load_exponent": "load_sensitivity", "height": "longitudinal_load_transfer", "ellipse": "combined_slip"}
    for number in range(8):
        foreign = drawn(family, number)
        assert all(0.0 <= foreign.numbers[key] <= 0.1 * EFFECTS[name].low for key, name in traces.items())
        assert (
            foreign.numbers.get("relaxation", 0.0)
            <= 0.3 * EFFECTS["tyre_relaxation"].sizes(foreign.about.size, "car")[0]
        )
        assert foreign.numbers.get("steer_time", 0.0) <= 0.2 * EFFECTS["steering_lag"].low


def test_no_diagnosis_knows_a_foreign_simulator():
    files = sorted(Path(greybox_id.gap.__file__).parent.rglob("*.py"))
    assert files
    for file in files:
        assert not re.search(r"(import|from) .*(\bexam\b|slipx|vehiclemodels)", file.read_text()), file.name


def test_cases_are_dealt_to_families_that_can_be_made_to_have_them():
    cases = dealt_out(Counts(nulls=5, singles=60, pairs=30, outside=20), "foreign", 3, ())
    assert all(case.family in able(EXAMINATION, case.effects) for case in cases)
    assert {case.family for case in cases} == set(EXAMINATION)
    of_one = dealt_out(Counts(nulls=0, singles=40, pairs=5, outside=5), "foreign", 3, ("slipx",))
    assert {name for own in of_one for name in own.effects} <= {*FAMILIES["slipx"].effects, *FAMILIES["slipx"].outside}
    with pytest.raises(BadInput, match="at least one case"):
        dealt_out(Counts(0, 0, 0, 0), "foreign", 3, ())


def test_many_effects_are_dealt_to_virtual_and_foreign_vehicles_alike():
    cases = dealt_out(Counts(0, 0, 0, 0, many=80), "many", 4, ())
    assert {case.family for case in cases} == {"", *EXAMINATION}
    assert 0.4 < np.mean([not case.family for case in cases]) < 0.8
    for case in cases:
        groups = Counter(map(group_of, case.effects))
        assert 3 <= len(case.effects) <= 6
        assert max(groups.values()) <= 2
        assert not any(other in always_alike(name) for name in case.effects for other in case.effects)
    assert {case.family for case in dealt_out(Counts(0, 0, 0, 0, many=8), "many", 4, ("workshop",))} == {""}


def test_a_rough_file_is_off_in_its_peaks_and_not_in_its_slopes():
    stated = drawn("suspended").about
    for seed in range(12):
        off, named = roughened(stated, np.random.default_rng(seed))
        p, q = stated.parameters, off.parameters
        peaks = [q[f"D_{axle}"] / p[f"D_{axle}"] - 1.0 for axle in "fr"]
        assert all(0.05 <= abs(peak) <= 0.1 for peak in peaks)
        assert all(q[f"B_{a}"] * q[f"D_{a}"] == pytest.approx(p[f"B_{a}"] * p[f"D_{a}"], rel=1e-4) for a in "fr")
        assert ("grip_scale" in named) == (np.sign(peaks[0]) == np.sign(peaks[1]))
        longer = (q["l_f"] + q["l_r"]) / (p["l_f"] + p["l_r"])
        assert (0.019 < abs(longer - 1.0) < 0.041) != ("yaw_inertia" in named)


@pytest.mark.slow
def test_a_car_on_springs_leans_out_of_a_turn_and_loads_its_outer_wheels():
    foreign = drawn("suspended", 4)
    found = ride(foreign, 20.0)
    at = found.truth()
    lean = np.polyfit(at["a_y"], at["roll"], 1)[0]
    assert 0.3 * foreign.numbers["gradient"] < lean < 3.0 * foreign.numbers["gradient"]
    assert np.corrcoef(at["a_y"], at["roll"])[0, 1] > 0.9
    car = foreign.about
    # little steer: the yaw rate of a linear single track, from its understeer gradient
    v, delta, rows = 0.4 * car.top_speed, 0.004, 600
    commands = np.stack([np.full(rows, delta), np.zeros(rows)], axis=1)
    free = foreign.numbers | {"c_0": 0.0, "c_1": 0.0, "c_2": 0.0, "bump_steer": 0.0}
    turned = replayed(FAMILIES["suspended"].build(free, np.zeros(1)), car, commands, 0.01,
                      {"v_x": v, "v_y": 0.0, "yaw_rate": 0.0}).truth()  # fmt: skip
    L = foreign.numbers["l_f"] + foreign.numbers["l_r"]
    gradient = (1.0 / foreign.numbers["slope_f"] - 1.0 / foreign.numbers["slope_r"]) / 9.81
    speed = turned["v_x"][-1]
    assert turned["yaw_rate"][-1] == pytest.approx(speed * delta / (L + gradient * speed**2), rel=0.04)


def test_a_wheel_leaves_the_ground_where_the_road_cannot_hold_it():
    foreign = drawn("suspended", 4)
    tall = foreign.numbers | {"h_cg": 4.0 * foreign.numbers["h_cg"]}
    commands = np.stack([np.full(300, 0.12), np.zeros(300)], axis=1)
    start = {"v_x": 0.6 * foreign.about.top_speed, "v_y": 0.0, "yaw_rate": 0.0}
    found = replayed(SuspendedCar(tall), foreign.about, commands, 0.01, start).truth()
    flat = replayed(SuspendedCar(foreign.numbers), foreign.about, commands, 0.01, start).truth()
    assert np.max(found["roll"]) > 3.0 * np.max(flat["roll"])  # beyond what springs alone would do


@pytest.mark.parametrize("tyre", range(5))
def test_a_tyre_begins_with_its_stiffness_and_reaches_its_friction(tyre):
    slips = np.linspace(0.0, 12.0, 2000)
    forces = np.array([curve(tyre, s, 3.0, 1.4, 0.2) for s in slips])
    assert (forces[1] - forces[0]) / (slips[1] - slips[0]) == pytest.approx(1.0, rel=0.02)
    assert 0.9 < forces.max() <= 1.0 + 1e-9
    assert curve(tyre, -1.3, 3.0, 1.4, 0.2) == -curve(tyre, 1.3, 3.0, 1.4, 0.2)


@pytest.mark.slow
def test_a_double_track_without_width_and_height_is_the_single_track():
    car = random_vehicle(3, "car")
    own = driven(DoubleTrack(single_track(car, True)), car, 8.0, 50.0, 1)
    at = own.truth(0.5 * own.period)
    told = accelerations(dict(car.parameters), at, own.arriving(0, 0.5), own.arriving(1, 0.5))
    for name in ("a_x", "a_y", "yaw_acceleration"):
        assert np.std(told[name] - at[name]) < 0.01 * np.std(at[name])


@pytest.mark.slow
@pytest.mark.parametrize("family", ["tmeasy", pytest.param("slipx", marks=needs_slipx)])
def test_what_is_identified_fits_what_lacks_nothing(family):
    foreign = drawn(family, 4)
    stated = identified(foreign.about, [ride(foreign, 40.0, seed) for seed in (1, 2)])
    proof = ride(foreign, 30.0, 3)
    flat = DoubleTrack(single_track(stated, proof.linear_hold))
    model = replayed(flat, stated, proof.commands, proof.period, proof.start)
    real, said_ = readings(proof, stated, {}, 0), readings(model, stated, {}, 0)
    for name in ("v_x", "yaw_rate", "a_x", "a_y"):
        assert np.std(real[name] - said_[name]) < 1.5 * FORM_MOST * np.std(real[name])


@pytest.fixture(scope="module")
def replay():
    """(effects) -> what sensors read of one vehicle that has them, under the same commands."""
    foreign = drawn(number=0)
    base = ride(foreign, 25.0)

    def again(effects):
        numbers = withheld(foreign.numbers, effects, foreign.about)
        gusts = np.random.default_rng(1).standard_normal(3000)
        found = replayed(DoubleTrack(numbers, gusts), foreign.about, base.commands, base.period, base.start)
        return readings(found, foreign.about, effects, 0)

    without = again({})
    return lambda effects: (again(effects), without)


@pytest.mark.parametrize("name", sorted({*EFFECTS, *OUTSIDE} - set(OF_SENSORS)))
def test_every_effect_of_the_vehicle_changes_how_it_moves(name, replay):
    about = drawn(number=0).about
    with_it, without = replay({name: magnitude(name, about, np.random.default_rng(4))})
    shows = max(np.sqrt(np.mean((with_it[c] - without[c]) ** 2)) / sd for c, sd in about.noise.items())
    assert shows > 0.1


def test_a_delay_moves_the_motion_by_itself():
    foreign = drawn(number=0)
    base = ride(foreign, 10.0)
    late = withheld(foreign.numbers, {"steering_delay": 0.04}, foreign.about)
    found = replayed(DoubleTrack(late), foreign.about, base.commands, base.period, base.start)
    straight = foreign.numbers | {"force_per_unit": 1e-9, "c_0": 0.0, "c_2": 0.0}
    at_once = replayed(DoubleTrack(straight), foreign.about, base.commands, base.period, base.start)
    later = replayed(
        DoubleTrack(straight | {"steer_delay": 0.04}), foreign.about, base.commands, base.period, base.start
    )
    assert np.all(np.isfinite(found.truth()["yaw_rate"]))
    a, b = at_once.truth()["yaw_rate"], later.truth()["yaw_rate"]
    shift = [np.sum((a[5 : 100 - k] - b[5 + k : 100]) ** 2) for k in range(5)]
    assert int(np.argmin(shift)) == 2  # rows of 20 ms


def test_a_simulator_that_is_not_installed_is_told(monkeypatch):
    real = builtins.__import__

    def without(name, *rest, **more):
        if name.startswith(("slipx", "vehiclemodels")):
            raise ImportError(name)
        return real(name, *rest, **more)

    foreign = drawn("slipx")
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(BadInput, match=r"greybox-id\[exam\]"):
        FAMILIES["slipx"].build(withheld(foreign.numbers, {}, foreign.about), np.zeros(1))


@needs_slipx
def test_slipx_follows_its_commands():
    foreign = drawn("slipx")
    found = ride(foreign, 6.0)
    at = found.truth()
    assert np.all(np.isfinite(at["yaw_rate"]))
    turns = np.abs(found.commands[:, 0]) > 0.05
    assert np.mean(np.sign(at["yaw_rate"][turns]) == np.sign(found.commands[turns, 0])) > 0.7


@pytest.mark.slow
def test_a_foreign_examination_is_written_and_sealed(tmp_path):
    made = make_foreign(tmp_path / "exam", 5, "foreign", Counts(1, 1, 0, 0), ("fiala",), 1, quiet)
    assert made.counts == {"null": 1, "single": 1}
    assert unbroken(made.folder, made.seal) == made.seal
    for case in ("case_000", "case_001"):
        given = made.folder / "cases" / case
        assert sorted(file.name for file in given.iterdir()) == ["columns.toml", "recording.csv", "vehicle.toml"]
        recording, stated = read(given / "recording.csv", given / "columns.toml"), vehicle(given / "vehicle.toml")
        answer = read_answer(made.folder / "sealed" / case / "answer.json")
        assert 59 <= recording.duration <= 101
        assert recording.hold_stated
        assert recording.hold == ("linear" if answer.car["numbers"]["linear_hold"] else "zero")
        assert stated.noise.keys() == answer.car["noise"].keys()
        assert max(answer.about["form_error"].values()) <= FORM_MOST
        assert answer.sizable == (answer.kind == "single")
        assert str(answer.seed) not in (given / "vehicle.toml").read_text()
