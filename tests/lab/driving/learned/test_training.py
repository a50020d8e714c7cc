"""Actuator networks learn a vehicle, say what they lack, and come back from their file as they were."""

import json
from dataclasses import replace

import numpy as np
import pytest
from actuator_networks import network

from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import Recording
from greybox_id.fitting.requested_model import RequestedModel
from greybox_id.models.registry import with_effects
from greybox_id.models.vehicle import vehicle
from greybox_lab.driving.learned.injection import injected
from greybox_lab.driving.learned.net import VARIANTS, SquaredError, drawn, load_actuator_net
from greybox_lab.driving.learned.open_loop import OpenLoop, errors_ahead
from greybox_lab.driving.learned.training import train_actuator_net
from greybox_lab.driving.learned.windows import resampled, windows
from greybox_lab.driving.racing.network import elu

pytestmark = pytest.mark.usefixtures("_uncompiled")


@pytest.fixture(scope="module")
def car():
    return RequestedModel("single_track", vehicle("roboracer")).model()


@pytest.fixture(scope="module")
def slow(car, lap):
    """A model whose servo is slower than the vehicle's, as one that has to learn."""
    return with_effects(car, {"steering_lag": 0.08})


def test_the_gradient_is_the_losss():
    rng = np.random.default_rng(1)
    net = drawn((6, 5, 4, 2), rng)
    loss = SquaredError(net, rng.normal(size=(30, 6)), rng.normal(size=(30, 2)))
    q = net.vector + 0.1 * rng.normal(size=len(net.vector))
    slope, h = loss(q)[1], 1e-6
    measured = [(loss(q + h * one)[0] - loss(q - h * one)[0]) / (2 * h) for one in np.eye(len(q))]
    assert np.allclose(slope, measured, atol=1e-8)
    assert loss(q)[0] == pytest.approx(0.5 * np.mean(loss.errors(q) ** 2), rel=1e-12)
    own, x = net.at(q), rng.normal(size=(7, 6))
    W, b = own.weights, own.biases
    h = elu(elu(x @ W[0] + b[0]) @ W[1] + b[1]) @ W[2] + b[2]
    assert np.allclose(own.each(x), h, atol=1e-12)
    assert np.array_equal(own.each(x)[3], own.each(x[3:4])[0])


@pytest.mark.parametrize("variant", ["paper", "abstract", "residual"])
def test_what_is_learned_foretells_a_vehicle_better_than_the_model_beside_it(car, slow, lap, variant):
    train, other = lap.rows(0, 1500), lap.rows(1500, 2000)
    beside = slow if variant == "residual" else None
    net = train_actuator_net(train, variant=variant, model=beside, seed=3, steps=60)
    before = errors_ahead(slow, [other], (0.1, 0.5))
    after = errors_ahead(injected(slow, net), [other], (0.1, 0.5))
    assert after[0.1]["yaw_rate"] < 0.5 * before[0.1]["yaw_rate"]
    assert after[0.5]["yaw_rate"] < 0.5 * before[0.5]["yaw_rate"]
    assert net.sigma[0] < 0.1 * np.std(other["yaw_rate"])


def test_a_network_is_kept_in_its_file_and_comes_back_to_the_bit(lap, tmp_path):
    net = train_actuator_net(lap.rows(0, 600), members=2, seed=5, steps=3)
    net.save(tmp_path / "net.json")
    back = load_actuator_net(tmp_path / "net.json")
    seen, own = np.random.default_rng(0).normal(size=(4, 3, 3)), np.zeros((4, 1))
    assert np.array_equal(net.following(seen, own), back.following(seen, own))
    assert back.text() == net.text()
    assert (back.inputs, back.history, back.sample_time) == (("steer", "yaw_rate", "v_x"), 3, 0.02)
    assert [one["seed"] for one in back.trained["members"]] == [5, 6]
    again = train_actuator_net(lap.rows(0, 600), members=2, seed=5, steps=3)
    assert again.text() == net.text()
    other = train_actuator_net(lap.rows(0, 600).with_signals(v_x=1.001 * lap["v_x"][:600]), seed=5, steps=3)
    assert other.data != net.data


def test_a_damaged_or_foreign_file_is_told(tmp_path):
    net = network("abstract")
    body = json.loads(net.text())
    (tmp_path / "cut.json").write_text(net.text()[:500])
    body["scales"][0] = 2.0
    (tmp_path / "changed.json").write_text(json.dumps(body))
    (tmp_path / "other.json").write_text('{"format": "greybox-id policy"}')
    for name, told in (
        ("cut", "is damaged"),
        ("changed", "does not match its checksum"),
        ("other", "is not an actuator"),
    ):
        with pytest.raises(BadInput, match=told):
            load_actuator_net(tmp_path / f"{name}.json")


@pytest.mark.parametrize(
    "change",
    [{"history": 4}, {"variant": "own"}, {"sample_time": 0.0}, {"scales": np.zeros(3)}, {"members": ()},
     {"means": np.array([0.0, np.nan, 0.0])}, {"channel": "motor_current"}, {"model": "a"}, {"sigma": np.ones(2)}],
)  # fmt: skip
def test_parts_that_do_not_go_together_make_no_network(change):
    with pytest.raises(ValueError, match=r"\w"):
        replace(network("paper"), **change)


def test_rows_are_brought_to_the_sample_time_and_that_is_said(lap):
    fast = Recording("fast", 0.005 * np.arange(4000), {"steer": np.repeat(lap["steer"][:1000], 4),
                                                       "v_x": 2.0 + 0.1 * np.arange(4000) * 0.005,
                                                       "yaw_rate": np.sin(0.02 * np.arange(4000))})  # fmt: skip
    slow = resampled(fast, 0.02)
    assert np.allclose(slow["steer"], lap["steer"][:1000])
    assert np.allclose(slow["v_x"], 2.0 + 0.1 * slow.time)
    assert slow.notes[-1] == "fast was resampled from 0.005 s to 0.02 s."
    net = train_actuator_net(fast, sample_time=0.02, steps=1)
    assert net.sample_time == 0.02
    assert net.trained["notes"] == ["fast was resampled from 0.005 s to 0.02 s."]
    between = resampled(fast, 0.007)  # commands keep their mean over a step
    assert np.sum(between["steer"]) * 0.007 == pytest.approx(np.sum(fast["steer"]) * 0.005, abs=1e-3)
    assert resampled(fast, 0.005) is fast
    with pytest.raises(BadInput, match=r"recorded every 0\.005 s"):
        train_actuator_net(fast, sample_time=0.002)


def test_what_is_held_out_is_not_seen_beside_it(lap):
    found = windows([lap], VARIANTS["abstract"], "motor_current", 0.02, [np.zeros((len(lap), 2))])
    assert np.array_equal(found.seen[10, 0, 2:], [lap[name][24] for name in ("yaw_rate", "v_x", "v_y")])
    assert np.array_equal(found.seen[10, 14, :1], lap["steer"][10:11])
    assert np.array_equal(found.following[10], [lap["yaw_rate"][25], lap["v_y"][25]])
    inside, outside = found.split(np.random.default_rng(0))
    rows = [np.flatnonzero(own)[:, None] + np.arange(16) for own in (inside, outside)]  # from the oldest to the next
    assert not np.intersect1d(*rows).size
    assert 0.05 < np.sum(outside) / len(found) < 0.1


def test_rows_that_are_missing_are_left_out_and_runs_are_not_joined(lap):
    steer = lap["steer"].copy()
    steer[700] = np.nan
    holed = Recording("holed", np.concatenate([lap.time[:1000], lap.time[1000:] + 5.0]),
                      {**lap.signals, "steer": steer})  # fmt: skip
    found = windows([holed], VARIANTS["paper"], "", 0.02, [np.zeros((2000, 1))])
    assert len(found) == 2 * (1000 - 3) - 3


def test_what_cannot_be_learned_is_said(car, lap):
    short, still = lap.rows(0, 60), lap.with_signals(yaw_rate=np.zeros(2000))
    bare = Recording("bare", lap.time, {name: lap[name] for name in ("steer", "yaw_rate", "v_x")})
    for told, recordings, options in (
        ("too few to train on some and hold others out", short, {}),
        ("a run of 4 steps is needed", lap.rows(0, 3), {}),
        ("yaw_rate is constant", still, {}),
        ("Fewer than two windows", lap.with_signals(v_x=np.full(2000, np.nan)), {}),
        ("holds no drive command", bare, {"variant": "abstract"}),
        ("lacks v_y, which an actuator network .abstract. needs",
         replace(bare, signals={**bare.signals, "ax_cmd": lap["steer"]}), {"variant": "abstract"}),
        ("lacks yaw_rate", Recording("a", lap.time, {"steer": lap["steer"], "v_x": lap["v_x"]}), {}),
        ("no variant 'papr' of actuator networks. Did you mean paper", lap, {"variant": "papr"}),
        ("adds to a model", lap, {"variant": "residual"}),
        ("add to no model", lap, {"model": car}),
        ("members and steps are 1 or more", lap, {"members": 0}),
        ("above zero are needed", lap, {"sample_time": -1.0}),
        ("no recording to train on", [], {}),
    ):  # fmt: skip
        with pytest.raises(BadInput, match=told):
            train_actuator_net(recordings, **options)


def test_a_residual_network_learns_what_the_model_lacks_in_the_same_steps_it_acts_in(car, slow, lap):
    open_loop = OpenLoop(slow, lap)
    assert np.all(np.isnan(open_loop.foretold[0]))
    error = open_loop.foretold[1:, 2] - lap["yaw_rate"][1:]
    assert 1e-3 < np.std(error) < np.std(lap["yaw_rate"])
    assert np.nanmax(np.abs(OpenLoop(car, lap).foretold[:, 2] - lap["yaw_rate"])) < 1e-9
