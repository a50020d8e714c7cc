"""`greybox/Track-v0` as Stable-Baselines3 has it; it is in the extra rl, which brings torch and is no part of dev."""

import importlib.util
import sys

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_lab.driving.racing.policy import load_policy

INSTALLED = importlib.util.find_spec("stable_baselines3") is not None
needed = pytest.mark.skipif(not INSTALLED, reason="stable-baselines3 is not installed; pip install '.[rl]'")


def vehicles(lanes, **options):
    from greybox_lab.driving.racing.stable_baselines import TrackVecEnv

    return TrackVecEnv(lanes, vehicle="roboracer", action="speed", **options)


def test_without_it_a_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    monkeypatch.setitem(sys.modules, "stable_baselines3.common.vec_env", None)
    monkeypatch.delitem(sys.modules, "greybox_lab.driving.racing.stable_baselines", raising=False)
    with pytest.raises(BadInput, match=r"pip install 'greybox-id\[rl\]'"):
        importlib.import_module("greybox_lab.driving.racing.stable_baselines")


@needed
def test_its_own_check_finds_nothing():
    import gymnasium
    from stable_baselines3.common.env_checker import check_env

    import greybox_id  # noqa: F401 - makes the environment known

    check_env(gymnasium.make("greybox/Track-v0", vehicle="roboracer").unwrapped)


@needed
def test_an_episode_ends_and_begins_in_one_step():
    many, alone = vehicles(3, seconds=1.0), vehicles(1, seconds=1.0)
    many.seed(7)
    alone.seed(9)
    seen, own = many.reset(), alone.reset()
    assert np.array_equal(seen[2], own[0])
    action = np.tile(np.float32([0.0, 0.2]), (3, 1))
    for k in range(50):
        seen, reward, done, told = many.step(action)
        own = alone.step(action[:1])[0]
        assert np.array_equal(seen[2], own[0])
        assert np.all(done == (k == 49))
    assert reward.dtype == np.float32
    assert all(one["TimeLimit.truncated"] for one in told)
    last = np.stack([one["terminal_observation"] for one in told])
    assert np.all(last[:, 6] == np.float32(0.2))  # what was done last
    assert np.all(seen[:, 5:7] == 0.0)  # nothing was done yet


@needed
def test_a_crash_is_no_cut():
    racing = vehicles(1)
    racing.seed(0)
    racing.reset()
    for _ in range(600):
        _, reward, done, told = racing.step(np.float32([[1.0, 1.0]]))
        if done[0]:
            break
    assert reward[0] == -10.0
    assert not told[0]["TimeLimit.truncated"]
    assert "terminal_observation" in told[0]


@needed
@pytest.mark.examination
@pytest.mark.slow
def test_its_ppo_learns_here_and_its_policy_is_one_of_ours(tmp_path):
    from stable_baselines3 import PPO, SAC

    from greybox_lab.driving.racing.stable_baselines import policy_of

    own = vehicles(16, reward="path")
    learner = PPO("MlpPolicy", own, n_steps=128, batch_size=256, seed=0, device="cpu", policy_kwargs={"net_arch": [32]})
    earned = []
    for _ in range(2):
        learner.learn(20_000, reset_num_timesteps=False)
        rewards = []
        seen = own.reset()
        for _ in range(300):
            seen, reward, _, _ = own.step(learner.predict(seen, deterministic=True)[0])
            rewards.append(np.mean(reward))
        earned.append(float(np.mean(rewards)))
    assert earned[1] > earned[0]
    policy = policy_of(learner)
    assert np.allclose(policy.act(seen), learner.predict(seen, deterministic=True)[0], atol=1e-5)
    assert policy.about["units"] == own.world.units
    policy.save(tmp_path / "policy.json")
    assert np.array_equal(load_policy(tmp_path / "policy.json").act(seen), policy.act(seen))
    with pytest.raises(BadInput, match="learn with PPO"):
        policy_of(SAC("MlpPolicy", own, buffer_size=100))
