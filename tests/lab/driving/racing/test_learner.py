"""Learning to drive: gradients, advantages, what is drawn, files, and that it learns."""

import json

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_lab.driving.racing.environment import world
from greybox_lab.driving.racing.laps import drive
from greybox_lab.driving.racing.learner import (
    FINE_TUNING,
    Learned,
    Rollout,
    Settings,
    estimated,
    learn,
    load_learned,
    rollout_of,
    shipped_learned,
    surrogate,
)
from greybox_lab.driving.racing.network import Adam, Perceptron, drawn
from greybox_lab.driving.racing.policy import POLICY, load_policy

pytestmark = pytest.mark.usefixtures("_uncompiled")

SMALL = Settings(rollout=16, epochs=2, batch=64)


def network(seed=0, sizes=(5, 8, 7, 2), activation="tanh"):
    """In double precision, so that finite differences mean something."""
    net = drawn(sizes, 1.0, np.random.default_rng(seed))
    return Perceptron(*([part.astype(float) for part in parts] for parts in (net.weights, net.biases)), activation)


def differences(loss, vector, step=1e-6):
    found = np.empty_like(vector)
    for k in range(len(vector)):
        at, values = vector[k], []
        for sign in (1, -1):
            vector[k] = at + sign * step
            values.append(loss())
        vector[k] = at
        found[k] = (values[0] - values[1]) / (2 * step)
    return found


def batch(seed=1, count=40):
    """Observations, actions, log densities of the policy before, and advantages, of which some are clipped."""
    generator = np.random.default_rng(seed)
    return [generator.normal(size=(count, 5)), generator.normal(size=(count, 2)), generator.normal(size=count)]


@pytest.mark.parametrize("activation", ["tanh", "elu"])
def test_gradients_of_a_network_are_its_finite_differences(activation):
    net, (seen, done, _) = network(activation=activation), batch()

    def loss():
        return float(0.5 * np.sum((net.forward(seen)[-1] - done) ** 2))

    layers = net.forward(seen)
    found = net.backward(layers, layers[-1] - done).copy()
    np.testing.assert_allclose(found, differences(loss, net.vector), rtol=1e-6, atol=1e-7)


def test_gradients_of_the_clipped_objective_are_its_finite_differences():
    net, log_sd, settings = network(), np.log([0.5, 0.8]), Settings(entropy=0.01)
    seen, done, advantages = batch()

    def densities():
        off = (done - net.forward(seen)[-1]) / np.exp(log_sd)
        return -0.5 * np.sum(off**2, axis=1) - np.sum(log_sd)

    before = densities() + np.random.default_rng(2).normal(size=len(seen)) * 0.3
    scaled = (advantages - np.mean(advantages)) / np.std(advantages)

    def loss():
        ratio = np.exp(densities() - before)
        paid = np.minimum(ratio * scaled, np.clip(ratio, 1 - settings.clip, 1 + settings.clip) * scaled)
        return float(-np.mean(paid) - settings.entropy * np.sum(log_sd))

    ratio = np.exp(densities() - before)
    clipped = np.where(scaled > 0, ratio > 1 + settings.clip, ratio < 1 - settings.clip)
    assert 5 < np.sum(clipped) < 35
    by_mean, by_log_sd, divergence, layers = surrogate(net, log_sd, seen, done, before, advantages, settings)
    by_weights = net.backward(layers, by_mean).copy()
    np.testing.assert_allclose(by_weights, differences(loss, net.vector), rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(by_log_sd, differences(loss, log_sd), rtol=1e-5, atol=1e-7)
    assert divergence == pytest.approx(np.mean(ratio - 1 - np.log(ratio)))


def test_adam_goes_down_a_bowl_and_cuts_long_gradients():
    vector = np.array([3.0, -2.0], dtype=np.float32)
    optimizer = Adam(vector, 0.5)
    optimizer.step(np.array([1e6, 0.0], dtype=np.float32), 0.01)
    assert vector[0] == pytest.approx(2.99, abs=1e-4)
    assert optimizer._mean[0] == pytest.approx(0.1 * 0.5)
    for _ in range(2000):
        optimizer.step(vector * np.array([1.0, 10.0], dtype=np.float32), 0.01)
    np.testing.assert_allclose(vector, 0.0, atol=1e-2)


def test_advantages_are_sums_of_surprises_until_episodes_end_and_go_on_where_they_are_cut():
    generator, T, L = np.random.default_rng(3), 30, 4
    ended = generator.random((T, L)) < 0.1
    cut = (generator.random((T, L)) < 0.1) & ~ended
    assert np.any(ended)
    assert np.any(cut)
    reward, values, beyond = generator.normal(size=(T, L)), generator.normal(size=(T + 1, L)), np.zeros((T, L))
    beyond[cut] = generator.normal(size=int(np.sum(cut)))
    settings = Settings(discount=0.9, trace=0.8)
    nothing = np.empty(0)
    rollout = Rollout(nothing, nothing, nothing, reward, ended, cut, nothing)
    found, returns = estimated(rollout, values, settings, beyond)
    for lane in range(L):
        for t in range(T):
            expected, weight = 0.0, 1.0
            for later in range(t, T):
                over = ended[later, lane] or cut[later, lane]
                goes_on = beyond[later, lane] if over else values[later + 1, lane]
                following = 0.0 if ended[later, lane] else goes_on
                expected += weight * (reward[later, lane] + 0.9 * following - values[later, lane])
                weight *= 0.9 * 0.8
                if over:
                    break
            assert found[t, lane] == pytest.approx(expected, rel=1e-5, abs=1e-5)
    np.testing.assert_allclose(returns, found + values[:-1])


def test_a_rollout_shows_where_episodes_were_cut_off_and_where_the_next_begin():
    racing = world(6, action="speed", seconds=0.1)
    racing.reset(np.ones(6, dtype=bool), list(range(6)))
    still = Perceptron([np.zeros((racing.size, 2), dtype=np.float32)], [np.zeros(2, dtype=np.float32)])
    found = rollout_of(racing, still, np.log(np.full(2, 0.01)), racing.observe(), SMALL, np.random.default_rng(0))
    assert np.array_equal(np.flatnonzero(found.cut[:, 0]), [4, 9, 14])
    assert not np.any(found.ended)
    assert found.at_cut.shape == (18, racing.size)
    begun = found.seen[5]
    assert np.all(begun[:, 5:7] == 0)  # last actions of an episode that begins
    assert np.all(found.at_cut[:6, 6] == found.done[4, :, 1])
    assert not np.any(np.all(found.at_cut[:6] == begun, axis=1))
    np.testing.assert_allclose(
        found.log_p[0], -0.5 * np.sum((found.done[0] / 0.01) ** 2, axis=1) - 2 * np.log(0.01), rtol=1e-4
    )


def test_the_same_seed_gives_the_same_bytes_and_another_one_others():
    texts = [learn(world(4, action="speed"), 256, seed=seed, settings=SMALL).text() for seed in (1, 1, 2)]
    assert texts[0] == texts[1]
    assert texts[0] != texts[2]


def test_its_file_is_that_of_a_policy_with_which_learning_goes_on(tmp_path):
    racing = world(4, action="speed")
    learned = learn(racing, 128, settings=SMALL)
    learned.save(tmp_path / "learned.json")
    again = load_learned(tmp_path / "learned.json")
    assert again.text() == learned.text()
    assert load_policy(tmp_path / "learned.json").text() == learned.policy.text()
    further = [learn(racing, 128, start=start, settings=SMALL, seed=5).text() for start in (learned, again)]
    assert further[0] == further[1]
    about = learn(racing, 64, start=again).policy.about
    assert about["start"]["steps"] == 128
    assert about["steps"] == FINE_TUNING.rollout * 4  # filled up to a rollout
    assert about["settings"]["kl_stop"] == 0.02
    learned.policy.save(tmp_path / "policy.json")
    with pytest.raises(BadInput, match=r"policy\.json holds only a policy"):
        load_learned(tmp_path / "policy.json")


@pytest.mark.parametrize("spoilt", ["value", "log_sd", "nan"])
def test_what_does_not_belong_together_is_nothing_learned(spoilt):
    learned = learn(world(2, action="speed"), 32, settings=SMALL)
    value, log_sd = Perceptron(learned.value.weights, learned.value.biases), learned.log_sd
    if spoilt == "value":
        value = drawn((9, 4, 1), 1.0, np.random.default_rng(0))
    elif spoilt == "log_sd":
        log_sd = log_sd[:1]
    else:
        value.vector[3] = np.nan
    with pytest.raises(ValueError, match="not a number" if spoilt == "nan" else "different sizes"):
        Learned(learned.policy, value, log_sd)


def test_damaged_files_are_refused(tmp_path):
    learned = learn(world(2, action="speed"), 32, settings=SMALL)
    body = json.loads(learned.text())
    del body["checksum"]
    changed = POLICY.text(body | {"log_sd": [0.0]})
    for text in (changed, learned.text().replace("0.0", "0.1"), learned.text()[:-100], "[]", ""):
        (tmp_path / "learned.json").write_text(text)
        with pytest.raises(BadInput, match=r"learned\.json"):
            load_learned(tmp_path / "learned.json")


def test_what_makes_no_sense_is_refused():
    racing = world(2, action="speed")
    with pytest.raises(BadInput, match="steps"):
        learn(racing, 0)
    for wrong in (
        {"rate": 0.0},
        {"rollout": 0},
        {"epochs": 1.5},
        {"discount": 1.0},
        {"entropy": -1.0},
        {"clip": np.nan},
    ):
        with pytest.raises(BadInput, match=next(iter(wrong))):
            Settings(**wrong)
    other = learn(racing, 32, settings=SMALL)
    racing.size += 1
    with pytest.raises(BadInput, match="takes 27 numbers, but the track gives 28"):
        learn(racing, 32, start=other)
    with pytest.raises(BadInput, match="No policy is shipped"):
        shipped_learned("bicycle")


def test_who_is_stopped_returns_what_was_learned_until_then():
    asked, told = [], []

    def stopped():
        asked.append(1)
        return len(asked) > 2

    found = learn(world(4, action="speed"), 10 * 64, settings=SMALL, stopped=stopped, say=told.append)
    assert found.policy.about["steps"] == 2 * 64
    assert len(told) == 2
    assert "of 640 steps" in told[0]


def test_a_shipped_policy_is_learned_with_what_it_was_made_with():
    about = shipped_learned().policy.about
    assert about["rules"]["action"] == "speed"
    assert about["steps"] <= 3_010_000
    assert len(shipped_learned().text()) < 300_000


@pytest.mark.examination
@pytest.mark.slow
def test_drivers_get_better_within_100_000_steps():
    racing = world(32, action="speed", reward="path")
    before, after = (
        drive(world(8, action="speed"), learn(racing, steps, seed=3).policy, 8, seed=50) for steps in (32, 100_000)
    )
    assert len(before.lap_times) == 0
    assert len(after.lap_times) == 8


@pytest.mark.examination
@pytest.mark.slow
def test_the_shipped_policy_drives_20_of_20_laps_of_its_nominal_model():
    for noise in (False, True):
        found = drive(world(20, action="speed", noise=noise), shipped_learned("roboracer").policy, 20, seed=77)
        assert found.crashes == found.given_up == 0
        assert len(found.lap_times) == 20
        assert found.path_error_rms < 0.1
