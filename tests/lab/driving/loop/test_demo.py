"""The loop is closed on a car in simulation: what is withheld is named, and the car is driven better for it."""

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from calling import greybox, refused
from hand import by_hand
from serving import START

from greybox_id.models.registry import motion_model_of
from greybox_lab.driving.loop.adapting import world_of
from greybox_lab.driving.loop.demo import Watched
from greybox_lab.driving.loop.safety import Cap, Log
from greybox_lab.driving.loop.scene import CASES, Hands, Scene, driven, effect_words
from greybox_lab.driving.loop.swap import Seat
from greybox_lab.driving.racing.learner import shipped_learned

SCENE = Scene(1)


@pytest.fixture(scope="module")
def units():
    return world_of(motion_model_of(SCENE.vehicle), SCENE.vehicle, 1, 0.6)


def test_what_drives_the_car_sees_and_is_recorded(units):
    one, same = (driven(SCENE, Hands(units, by_hand().act), 600, 3) for _ in range(2))
    assert one.rows == 600
    assert one.crashes == 0
    (own,) = one.recordings
    assert set(SCENE.car.noise) | {"steer", SCENE.car.drive_channel} == set(own.signals)
    assert np.array_equal(own["v_x"], same.recordings[0]["v_x"])
    assert one.path_error == same.path_error < 0.2


def test_who_crashes_begins_anew(units):
    found = driven(SCENE, Hands(units, lambda seen: np.array([[1.0, 1.0]])), 300, 0)
    assert found.crashes >= 1
    assert found.rows == 300
    assert np.isnan(found.lap_time)


def test_who_leaves_the_envelope_is_driven_by_the_last_good_policy_and_slower(units, tmp_path):
    seat, cap = Seat(by_hand().text().encode(), tmp_path), Cap(0.6)
    good = shipped_learned().policy

    def at(share):
        return world_of(motion_model_of(SCENE.vehicle), SCENE.vehicle, 1, share)

    hands = Watched(units, seat, good, cap, at, 1e-4, Log(tmp_path / "log.jsonl"))
    driven(SCENE, hands, 400, 0)
    assert hands.events == 1
    assert cap.share == pytest.approx(0.48)
    assert hands.act == good.act
    assert hands.world.rules.usage_cap == pytest.approx(0.48)
    (line,) = (tmp_path / "log.jsonl").read_text().splitlines()
    assert json.loads(line)["kind"] == "envelope"


def test_a_command_that_comes_too_late_is_braking(units, tmp_path):
    seat, cap = Seat(by_hand().text().encode(), tmp_path), Cap(0.6)
    hands = Watched(units, seat, shipped_learned().policy, cap, lambda _: units, 1.0, Log(tmp_path / "log.jsonl"))
    given, quick, calls = [], hands.act, iter(range(10**6))

    def act(seen):
        if next(calls) == 100:
            begun = time.thread_time()
            while time.thread_time() - begun < 0.04:
                pass
        return quick(seen)

    hands.act = act
    watched = hands.watch
    hands.watch = lambda row: (given.append(row), watched(row))
    driven(SCENE, hands, 150, 0)
    (line,) = (tmp_path / "log.jsonl").read_text().splitlines()
    assert json.loads(line)["kind"] == "watchdog"
    channel = SCENE.car.drive_channel
    before, late = given[100], given[101]
    assert late["steer"] == before["steer"]
    assert late[channel] < before[channel]


@pytest.mark.parametrize("case", range(len(CASES)))
def test_every_case_is_a_car_with_effects(case):
    scene = Scene(case)
    assert set(scene.effects) == set(CASES[case])
    assert scene.vehicle.steer_max == pytest.approx(scene.car.steer_max)


def test_what_is_there_already_is_a_sentence(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    assert "something else" in refused("loop", "demo", "--quick", "--out", tmp_path)
    begun = tmp_path / "begun"
    begun.mkdir()
    (begun / "demo.json").write_text(json.dumps({"format": "greybox-loop-demo", "asked": {"case": 5}}))
    assert "another demo (case 5)" in refused("loop", "demo", "--quick", "--out", begun)
    assert "token" in refused("serve", "--out", tmp_path / "state")
    assert "cannot be read" in refused("serve", "--token-file", tmp_path / "no", "--out", tmp_path / "state")
    (tmp_path / "token").write_text("0123456789abcdef")
    assert "something else" in refused("serve", "--token-file", tmp_path / "token", "--out", tmp_path)
    call = ("serve", "--token-file", tmp_path / "token", "--out", tmp_path / "state")
    assert "cannot be listened at" in refused(*call, "--host", "192.0.2.1", "--port", "0")


@pytest.mark.examination
@pytest.mark.slow
def test_a_demo_that_a_kill_interrupts_carries_on_and_drives_better(tmp_path):
    call = ["loop", "demo", "--quick", "--cycles", "1", "--case", "1", "--out", str(tmp_path / "loop"), "--json"]
    process = subprocess.Popen(
        [sys.executable, "-c", START.format(sys.path), *call], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    while not (tmp_path / "loop" / "cycle_1" / "rows.csv").exists():
        assert process.poll() is None
        time.sleep(0.1)
    process.send_signal(signal.SIGKILL)
    process.wait()
    base = (tmp_path / "loop" / "base.json").stat().st_mtime_ns
    called = greybox(*call)
    assert called.code == 0, called.err
    found = json.loads(called.out)
    assert (tmp_path / "loop" / "base.json").stat().st_mtime_ns == base
    (cycle,) = found["cycles"]
    assert "steering_lag" in cycle["applied"]  # a lap of two minutes names the grip as well or not
    assert set(cycle["applied"]) <= set(SCENE.effects)
    assert cycle["swapped"]
    errors = {name: own["first"]["path_error_rms"] for name, own in found["arms"].items()}
    assert errors["named"] < 0.8 * errors["base"]
    assert "cycle 1" in (tmp_path / "loop" / "index.html").read_text()


def test_magnitudes_are_told_with_their_units():
    both = effect_words({"steering_delay": 0.04, "front_stiffness": 0.76923})
    assert both == "steering_delay 0.0400 s, front_stiffness 0.769"
    assert effect_words({"rear_steer": 0.05}) == "rear_steer 0.0500"
    assert effect_words({}) == "nothing"
