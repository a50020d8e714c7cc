"""Learning to drive: proximal policy optimisation (Schulman et al., 2017) over the lanes of a world."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from greybox_id.base.errors import BadInput, must_be_whole, near_or_all
from greybox_id.base.files import write_atomically

from .network import Adam, Floats, Perceptron, drawn, sizes_of
from .policy import ACTIONS, POLICY, Policy, layers_of, plain_layers, policy_of
from .world import World

HIDDEN = (64, 64)
"""Sizes of the hidden layers of policy and value, as customary for PPO and as published for a 1:10 car."""
LEAST_SD = 1e-8
"""Of advantages, below which they are not divided by it."""


@dataclass(frozen=True)
class Settings:
    """How is learned.

    Attributes
    ----------
    rate : of the first step of Adam; it falls linearly to zero with the last one.
    rollout : periods that every lane drives between two updates of the policy.
    epochs : times that the rollout is gone through for an update.
    batch : steps of the rollout that are averaged for one step of Adam.
    discount : of the reward, a period.
    trace : lambda of generalised advantage estimation (Schulman et al., 2016).
    clip : how far the probability of an action may go from what it was, as a share, and still be paid for.
    entropy : reward of the entropy of actions.
    kl_stop : divergence of the policy from the one that drove the rollout at which an update ends.
    sd : of actions, where learning begins; of a policy that it goes on from, at least.
    least_sd : of actions, below which it never falls: what is not tried is not learned.
    largest_gradient : length to which longer gradients are cut.

    Raises
    ------
    BadInput : a number makes no sense.
    """

    rate: float = 1e-3
    rollout: int = 128
    epochs: int = 10
    batch: int = 512
    discount: float = 0.99
    trace: float = 0.95
    clip: float = 0.2
    entropy: float = 0.001
    kl_stop: float = 0.03
    sd: float = 0.5
    least_sd: float = 0.03
    largest_gradient: float = 0.5

    def __post_init__(self) -> None:
        for name in ("rollout", "epochs", "batch"):
            must_be_whole(getattr(self, name), name, 1)
        for name in ("rate", "clip", "kl_stop", "sd", "least_sd", "largest_gradient"):
            if not getattr(self, name) > 0:
                raise BadInput(f"{name}: a number above zero is needed, not {getattr(self, name)!r}.")
        for name in ("discount", "trace"):
            if not 0 <= getattr(self, name) < 1:
                raise BadInput(f"{name}: a number from 0 to below 1 is needed, not {getattr(self, name)!r}.")
        if not self.entropy >= 0:
            raise BadInput(f"entropy: a number of 0 or more is needed, not {self.entropy!r}.")


FINE_TUNING = Settings(rate=7e-4, rollout=64, batch=512, kl_stop=0.02, sd=0.1, least_sd=0.05)
"""What is used where learning goes on from a policy: a divergence as published for this, and actions that vary again.

Chosen on the virtual vehicle 13, case 1 of `greybox bench loop`, 300 000 steps, two seeds: a rate of 5e-4, batches of
256 and a standard deviation of 0.1 throughout leave the oracle 9.5 and 10.0 mm from the path, these 7.6 and 8.5.
On a vehicle far from what the shipped policy knows (`benchmarks/fine_tuning.py`) they lead to 18 of 20 laps at 80 % of
the grip; where actions begin as they ended, with 0.05, to none.
"""


@dataclass(frozen=True)
class Learned:
    """A policy and what learning needs to go on with it.

    Attributes
    ----------
    policy : what drives; it does what is most probable.
    value : takes an observation, gives the discounted reward that is expected from there, times 1 - discount.
    log_sd : (2,) logarithm of the standard deviation of actions that are tried.

    Raises
    ------
    ValueError : shapes that do not belong together, or what is no number.
    """

    policy: Policy
    value: Perceptron
    log_sd: Floats

    def __post_init__(self) -> None:
        sizes = sizes_of(self.value.weights, self.value.biases)
        if self.log_sd.shape != (ACTIONS,) or sizes[0] != self.policy.size or sizes[-1] != 1:
            raise ValueError("policy, value and standard deviations of different sizes")
        if not np.all(np.isfinite(self.log_sd)):
            raise ValueError("a standard deviation is not a number")

    def text(self) -> str:
        """The text of its file: that of a policy, which `load_policy` reads too, and what is learned on with."""
        more = {
            "value": plain_layers(self.value.weights, self.value.biases),
            "log_sd": [float(str(v)) for v in self.log_sd],
        }
        return POLICY.text(self.policy.plain() | more)

    def save(self, path: str | Path) -> None:
        """Write its file."""
        write_atomically(Path(path), self.text())


def load_learned(path: str | Path) -> Learned:
    """What was learned, of a file. Raises `BadInput`, also for a policy without what learning needs to go on."""

    def made(body: dict[str, Any]) -> Learned:
        if "value" not in body:
            raise BadInput(f"{path} holds only a policy, from which learning cannot continue. Name what `learn` wrote.")
        return Learned(
            policy_of(body), Perceptron(*layers_of(body["value"])), np.array(body["log_sd"], dtype=np.float32)
        )

    return POLICY.load(path, made)


def shipped_learned(name: str = "roboracer") -> Learned:
    """What was learned for a shipped vehicle. Raises `BadInput` where there is none."""
    folder = files(__package__) / "policies"
    known = sorted(path.name.removesuffix(".json") for path in folder.iterdir() if path.name.endswith(".json"))
    if name not in known:
        raise BadInput(f"No policy is shipped for {name!r}.{near_or_all(name, known)}")
    with as_file(folder / f"{name}.json") as path:
        return load_learned(path)


def learn(
    world: World,
    steps: int,
    *,
    start: Learned | None = None,
    seed: int = 0,
    settings: Settings | None = None,
    say: Callable[[str], None] = lambda sentence: None,
    stopped: Callable[[], bool] = lambda: False,
) -> Learned:
    """Learn to drive in a world.

    Parameters
    ----------
    world : where all lanes drive; it begins anew.
    steps : periods of driving over all lanes, filled up to whole rollouts.
    start : what to go on from; None: networks that are drawn.
    seed : of everything that is drawn: lane k has seed + k, as in `make_vec`.
    settings : None: `Settings()`, and `FINE_TUNING` with a start.
    say : called with a sentence on how learning goes, every tenth of it.
    stopped : asked between rollouts; where it says so, what was learned until then is returned.

    Returns
    -------
    What was learned; `policy.about` says from what: model, rules, steps, seed, settings.

    Raises
    ------
    BadInput : the number of steps makes no sense, or the start sees something else than the world shows.
    """
    if not steps > 0:
        raise BadInput(f"steps: a number above zero is needed, not {steps!r}.")
    if start is not None and start.policy.size != world.size:
        raise BadInput(
            f"The policy takes {start.policy.size} numbers, but the track gives {world.size}; learn a new policy."
        )
    result = settings or (Settings() if start is None else FINE_TUNING)
    with threadpool_limits(1):  # matrices are small: further threads only wait for each other
        return _Learning(world, result, start, seed).run(steps, say, stopped)


class _Learning:
    """Learning under way.

    Parameters
    ----------
    world, settings, start, seed : see `learn`.
    """

    def __init__(self, world: World, settings: Settings, start: Learned | None, seed: int) -> None:
        self.world, self.settings, self.seed, self.start = world, settings, seed, start
        self.generator = np.random.default_rng(seed)
        if start is None:
            self.policy = drawn((world.size, *HIDDEN, ACTIONS), 0.01, self.generator)
            self.value = drawn((world.size, *HIDDEN, 1), 1.0, self.generator)
            self.log_sd = np.full(ACTIONS, np.log(settings.sd), dtype=np.float32)
        else:
            self.policy = Perceptron(start.policy.weights, start.policy.biases)
            self.value, self.log_sd = Perceptron(start.value.weights, start.value.biases), start.log_sd.copy()
            np.maximum(self.log_sd, np.float32(np.log(settings.sd)), out=self.log_sd)
        self.least = np.float32(np.log(settings.least_sd))
        np.maximum(self.log_sd, self.least, out=self.log_sd)
        largest = settings.largest_gradient
        self._adams = [Adam(vector, largest) for vector in (self.policy.vector, self.log_sd, self.value.vector)]
        lanes = len(world.lanes)
        world.reset(np.ones(lanes, dtype=bool), [seed + k for k in range(lanes)])
        self._seen = world.observe()

    def run(self, steps: int, say: Callable[[str], None], stopped: Callable[[], bool]) -> Learned:
        """Drive and update until the steps are driven; what was learned."""
        a_rollout = self.settings.rollout * len(self.world.lanes)
        rollouts = -(-int(steps) // a_rollout)
        every, begun, done = max(1, rollouts // 10), time.monotonic(), 0
        for k in range(rollouts):
            if stopped():
                break
            rollout = rollout_of(self.world, self.policy, self.log_sd, self._seen, self.settings, self.generator)
            self._seen = rollout.seen[-1]
            rate = self.settings.rate * (1.0 - k / rollouts)
            divergence = self._update(rollout, rate)
            done += 1
            if done % every == 0 or done == rollouts:
                reward = np.mean(rollout.reward) / (1.0 - self.settings.discount)
                crashes, sd = 1e3 * np.mean(rollout.ended), np.exp(self.log_sd)
                say(
                    f"{done * a_rollout} of {rollouts * a_rollout} steps: reward {reward:.3f} a step, {crashes:.2g} "
                    f"crashes in 1000, divergence {divergence:.2g}, sd {sd[0]:.2f} and {sd[1]:.2f}, "
                    f"{time.monotonic() - begun:.0f} s"
                )
        return self._learned(done * a_rollout)

    def _update(self, rollout: Rollout, rate: float) -> float:
        """Follow the clipped objective; the divergence from the policy before."""
        settings, lanes = self.settings, rollout.seen.shape[1]
        seen = rollout.seen.reshape(-1, self.world.size)
        values = self.value.forward(seen)[-1].reshape(-1, lanes)
        advantages, returns = estimated(rollout, values, settings, self._beyond(rollout))
        seen, done = seen[:-lanes], rollout.done.reshape(-1, ACTIONS)
        before, advantages, returns = rollout.log_p.ravel(), advantages.ravel(), returns.ravel()
        divergence = 0.0
        for _ in range(settings.epochs):
            order, result = self.generator.permutation(len(seen)), []
            for first in range(0, len(order), settings.batch):
                rows = order[first : first + settings.batch]
                by_mean, by_log_sd, off, layers = surrogate(
                    self.policy, self.log_sd, seen[rows], done[rows], before[rows], advantages[rows], settings
                )
                result.append(off)
                self._adams[0].step(self.policy.backward(layers, by_mean), rate)
                self._adams[1].step(by_log_sd, rate)
                np.maximum(self.log_sd, self.least, out=self.log_sd)
                layers = self.value.forward(seen[rows])
                lacking = (layers[-1] - returns[rows, None]) / np.float32(len(rows))
                self._adams[2].step(self.value.backward(layers, lacking), rate)
            divergence = float(np.mean(result))
            if divergence > settings.kl_stop:
                break
        return divergence

    def _beyond(self, rollout: Rollout) -> Floats:
        """(T, L) values of where episodes were cut off, zero elsewhere."""
        result = np.zeros(rollout.cut.shape, dtype=np.float32)
        if np.any(rollout.cut):
            result[rollout.cut] = self.value.forward(rollout.at_cut)[-1][:, 0]
        return result

    def _learned(self, steps: int) -> Learned:
        about: dict[str, Any] = {
            "model": self.world.stage.equations.model.name,
            "rules": asdict(self.world.rules),
            "units": self.world.units,
            "drawn": list(self.world.draws.names),
            "lanes": len(self.world.lanes),
            "steps": steps,
            "seed": self.seed,
            "settings": asdict(self.settings),
        }
        if self.start is not None:
            about["start"] = dict(self.start.policy.about)
        policy = Policy(_copied(self.policy.weights), _copied(self.policy.biases), about)
        return Learned(policy, Perceptron(self.value.weights, self.value.biases), self.log_sd.copy())


@dataclass(frozen=True)
class Rollout:
    """Driving between two updates.

    Attributes
    ----------
    seen : (T + 1, L, size) observations; the last ones are after it.
    done : (T, L, 2) actions as they were drawn.
    log_p : (T, L) logarithm of their probability densities.
    reward : (T, L) times 1 - discount.
    ended : (T, L) whether the episode ended with the step.
    cut : (T, L) whether it was cut off after the step, and would have gone on.
    at_cut : (cuts, size) what was seen there, in the order of `cut`.
    """

    seen: Floats
    done: Floats
    log_p: Floats
    reward: Floats
    ended: Any
    cut: Any
    at_cut: Floats


def rollout_of(
    world: World, policy: Perceptron, log_sd: Floats, seen: Floats, settings: Settings, generator: np.random.Generator
) -> Rollout:
    """Drive a rollout with actions that are drawn; lanes whose episode is over begin anew at once.

    Parameters
    ----------
    world : where.
    policy, log_sd : means of actions, and logarithm of their standard deviations.
    seen : (L, size) what drivers see now.
    settings : how long, and the discount.
    generator : what actions are drawn from.
    """
    T, (L, size) = settings.rollout, seen.shape
    all_seen, done = np.empty((T + 1, L, size), dtype=np.float32), np.empty((T, L, ACTIONS), dtype=np.float32)
    all_seen[0] = seen
    reward, ended, cut = np.empty((T, L), dtype=np.float32), np.zeros((T, L), dtype=bool), np.zeros((T, L), dtype=bool)
    noise, at_cut = generator.standard_normal((T, L, ACTIONS), dtype=np.float32), []
    for t in range(T):
        done[t] = policy.forward(all_seen[t])[-1] + np.exp(log_sd) * noise[t]
        reward[t], ended[t], cut[t] = world.step(done[t])
        over = ended[t] | cut[t]
        if np.any(cut[t]):
            at_cut.append(world.observe()[cut[t]])
        if np.any(over):
            world.reset(over)
        all_seen[t + 1] = world.observe()
    log_p = -0.5 * np.sum(noise * noise, axis=2) - np.sum(log_sd)
    reward *= np.float32(1.0 - settings.discount)
    beyond = np.concatenate(at_cut) if at_cut else np.empty((0, size), dtype=np.float32)
    return Rollout(all_seen, done, log_p, reward, ended, cut, beyond)


def estimated(rollout: Rollout, values: Floats, settings: Settings, beyond: Floats) -> tuple[Floats, Floats]:
    """Generalised advantage estimates, and the returns that follow from them.

    Parameters
    ----------
    rollout : T periods of L lanes.
    values : (T + 1, L) of what was seen.
    settings : discount and trace.
    beyond : (T, L) values of where an episode was cut off: what would have followed; zero elsewhere.

    Returns
    -------
    advantages, returns : (T, L).
    """
    T, onwards = len(rollout.reward), ~(rollout.ended | rollout.cut)
    following = np.where(rollout.cut, beyond, np.where(rollout.ended, np.float32(0.0), values[1:]))
    surprise = (rollout.reward + settings.discount * following - values[:-1]).astype(values.dtype)
    advantages: Floats = np.empty_like(surprise)
    last = np.zeros_like(surprise[0])
    for t in reversed(range(T)):
        last = surprise[t] + np.float32(settings.discount * settings.trace) * onwards[t] * last
        advantages[t] = last
    return advantages, advantages + values[:-1]


def surrogate(
    policy: Perceptron,
    log_sd: Floats,
    seen: Floats,
    done: Floats,
    before: Floats,
    advantages: Floats,
    settings: Settings,
) -> tuple[Floats, Floats, float, list[Floats]]:
    """Gradients of the clipped objective, to be made small, with advantages set to mean 0 and standard deviation 1.

    Parameters
    ----------
    policy, log_sd : means of actions, and logarithm of their standard deviations.
    seen, done, before, advantages : (N, ...) a batch of a rollout; `before` are the log densities of `done` then.
    settings : clip and entropy.

    Returns
    -------
    by_mean : (N, 2) by the means.
    by_log_sd : (2,).
    divergence : estimated Kullback-Leibler divergence from the policy that drove.
    layers : what the policy's layers gave.
    """
    layers = policy.forward(seen)
    sd = np.exp(log_sd)
    off = (done - layers[-1]) / sd
    change = -0.5 * np.sum(off * off, axis=1) - np.sum(log_sd) - before
    ratio = np.exp(np.clip(change, -20.0, 20.0))
    scaled = (advantages - np.mean(advantages)) / (np.std(advantages) + np.float32(LEAST_SD))
    paid = np.where(scaled > 0, ratio < 1.0 + settings.clip, ratio > 1.0 - settings.clip)
    by_log_p = (-scaled * ratio * paid / np.float32(len(seen)))[:, None]
    by_log_sd = np.sum(by_log_p * (off * off - 1.0), axis=0) - np.float32(settings.entropy)
    return by_log_p * off / sd, by_log_sd, float(np.mean(ratio - 1.0 - change)), layers


def _copied(pieces: tuple[Floats, ...]) -> tuple[Floats, ...]:
    return tuple(piece.copy() for piece in pieces)
