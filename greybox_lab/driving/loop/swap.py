"""The policy in force, and how another one takes its place while it drives.

Whoever drives asks one reference, which is replaced in one assignment: a call is answered by the old policy or by the
new one, never by parts of both. What is offered to take its place is read and probed in a process of its own before: a
thread would hold up who drives, since one at a time runs Python. Where no twin tells how it drives, it is asked what it
would have done in the last minute, and has to agree with the one in force.
"""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from greybox_id.base.contained.process import Contained, Failed, Lost
from greybox_id.base.errors import BadInput
from greybox_id.base.files import replacing
from greybox_id.base.numbers import counted
from greybox_id.base.shorthands import Array

from ..racing.learner import Learned, load_learned
from ..racing.network import Perceptron, unpacked
from ..racing.policy import Policy, load_policy
from ..racing.world import AHEAD, LARGEST, OWN, Observations
from .protocol import digest_of
from .state import of_bytes

PROBES = 1000
LATENCY = 0.002
"""s of the processor that 99 % of calls take at most: a tenth of a period of 20 ms."""
WORSE = 1.1
"""How many times the path error of the present policy that of another one may be in the twin."""
MINUTE = 3000
"""Rows of a minute, at periods of 20 ms."""
SIZE = OWN + 2 * len(AHEAD)
"""Numbers of an observation."""
PATIENCE, MOST = 60.0, 2**26
"""s by the clock and bytes that reading and probing a policy take at most."""


Twin = Callable[[Policy, Policy], None]


class NotSwapped(BadInput):
    """A policy that does not take the place of the one in force, and why."""


class InForce(NamedTuple):
    """A policy that drives, and the SHA-256 of its file."""

    policy: Policy
    sha: str


def must_drive_as_well(crashes: int, after: float | None, before: float | None) -> None:
    """Refuse a policy that crashes in the twin, or has a path error of more than `WORSE` times the present one's, m.

    Raises
    ------
    NotSwapped : it does.
    """
    if crashes:
        raise NotSwapped(f"In the twin {counted(crashes, 'vehicle')} crash{'es' if crashes == 1 else ''}.")
    if before is not None and after is not None and after > WORSE * before:
        raise NotSwapped(
            f"In the twin, the path error is {after:.3f} m with the new policy, {before:.3f} m with the present one."
        )


class Seat:
    """Where the policy in force sits.

    Parameters
    ----------
    body : bytes of the first policy's file.
    folder : where the file of the one in force is kept, policy.json, so that a restart begins with it.
    """

    def __init__(self, body: bytes, folder: Path) -> None:
        self._folder = folder
        self._now = InForce(read_policy(body, folder), digest_of(body))
        self._minute: deque[Observations] = deque(maxlen=MINUTE)
        self._loader = ThreadPoolExecutor(1, "loader")
        self._prober: Contained | None = None

    @property
    def now(self) -> InForce:
        """What drives."""
        return self._now

    def act(self, seen: Observations) -> Array:
        """What the policy in force does."""
        self._minute.append(seen.copy())
        return self._now.policy.act(seen)

    def offer(self, body: bytes, sha: str, twin: Twin | None = None) -> Future[InForce]:
        """Let a policy be tried while the one in force drives, and take over if nothing speaks against it.

        Parameters
        ----------
        body, sha : bytes of its file, and the SHA-256 that was announced.
        twin : raises `NotSwapped` where a policy drives worse in the twin than the one in force (new, present); where
            there is none, see `agree`.

        The future raises `BadInput` where something does: what was in force still is.
        """
        return self._loader.submit(self._seated, body, sha, twin, self._probed_apart)

    def swap(self, body: bytes, sha: str, twin: Twin | None = None) -> InForce:
        """As `offer`, here and now."""
        return self._seated(body, sha, twin, probed)

    def refusal(self, body: bytes, sha: str, twin: Twin | None = None) -> str:
        """As `swap`; why it does not take over, or ""."""
        try:
            self.swap(body, sha, twin)
        except NotSwapped as error:
            return str(error)
        return ""

    def _seated(self, body: bytes, sha: str, twin: Twin | None, read: Callable[[bytes, Path], Policy]) -> InForce:
        if digest_of(body) != sha:
            raise NotSwapped("The policy is not the one that was announced: its SHA-256 differs.")
        policy = read(body, self._folder)
        if twin is None:
            agree(policy, self._now.policy, list(self._minute))
        else:
            twin(policy, self._now.policy)
        with replacing(self._folder / "policy.json", continued=True) as beside:
            beside.write_bytes(body)
        in_force = InForce(policy, sha)
        self._now = in_force
        return in_force

    def _probed_apart(self, body: bytes, folder: Path) -> Policy:
        """As `probed`, in a process that is started with the first policy that is offered."""
        if self._prober is None or not self._prober.alive:
            self._prober = Contained(f"{__name__}:Prober", str(folder))
        prober, about = self._prober, list[dict[str, Any]]()
        try:
            _, numbers = of_bytes(body, folder, ".json", "The policy", lambda file: prober.ask(
                "probed", str(file), patience=PATIENCE, most=MOST, hear=about.append
            ))  # fmt: skip
        except (Failed, Lost) as error:
            ended = f"The policy could not be tested ({error})." if isinstance(error, Lost) else str(error)
            raise NotSwapped(ended) from error
        assert numbers is not None
        return Policy(*unpacked(numbers.astype(np.float32), about[0]["sizes"]), about[0]["about"])

    def close(self) -> None:
        """Wait for the loader."""
        self._loader.shutdown()
        if self._prober is not None:
            self._prober.close()


class Prober:
    """What reads and probes policies in a process of its own; `folder`: for what lies there for a moment."""

    def __init__(self, folder: str) -> None:
        self._folder = Path(folder)
        if hasattr(os, "nice"):
            os.nice(10)  # who drives comes first

    def probed(self, file: str) -> Generator[dict[str, Any], None, Array]:
        """Numbers of the policy of a file, after its sizes and what it is about. Raises `NotSwapped`."""
        policy = probed(Path(file).read_bytes(), self._folder)
        net = Perceptron(policy.weights, policy.biases)
        yield {"sizes": net.sizes, "about": policy.about}
        return np.asarray(net.vector, dtype=np.float64)


def probed(body: bytes, folder: Path) -> Policy:
    """A driver's policy from the bytes of its file, that answers as it should. Raises `NotSwapped`."""
    policy = read_policy(body, folder)
    probe(policy)
    return policy


def drivers_policy(file: Path) -> Policy:
    """A policy that sees what a `World` shows. Raises `BadInput`."""
    policy = load_policy(file)
    if policy.size != SIZE:
        raise BadInput(f"The policy takes observations of {policy.size} numbers; drivers of this server take {SIZE}.")
    return policy


def read_policy(body: bytes, folder: Path) -> Policy:
    """A driver's policy from the bytes of its file. Raises `NotSwapped`."""
    try:
        return of_bytes(body, folder, ".json", "The policy", drivers_policy)
    except BadInput as error:
        raise NotSwapped(str(error)) from error


def read_learned(body: bytes, folder: Path) -> Learned:
    """What learning can go on with, from the bytes of its file. Raises `BadInput`."""
    return of_bytes(body, folder, ".json", "The policy", load_learned)


def agree(new: Policy, present: Policy, minute: Sequence[Observations]) -> None:
    """Ask a policy what it would have done in the last minute.

    It has to be nearer to what the one in force would have done than a command that never changes, in steering and in
    drive: policies that were learned for changed vehicles are within 0.2 of those squares, reversed ones beyond 4.

    Parameters
    ----------
    minute : `MINUTE` observations, (1, size) each.

    Raises
    ------
    NotSwapped : it is not, or there is no minute to ask about.
    """
    if len(minute) < MINUTE:
        raise NotSwapped(
            "Without a twin, a policy is tried on the last minute of driving: drive for a minute, then offer it again."
        )
    seen = np.concatenate(minute)
    with np.errstate(all="ignore"):
        before, after = present.act(seen), new.act(seen)
    apart, spread = np.mean((after - before) ** 2, axis=0), np.var(before, axis=0)
    for name, square, most in zip(("steering", "drive"), apart, spread, strict=True):
        if not square <= most:
            raise NotSwapped(
                f"In the last minute, the {name} of the new policy would have differed from that of the present "
                f"policy by {np.sqrt(square):.2f} (RMS, on a scale of 1). The actions of the present policy vary by "
                f"{np.sqrt(most):.2f} only. Try the new policy in a twin first."
            )


def probe(policy: Policy, latency: float = LATENCY) -> None:
    """Ask a policy what it does about `PROBES` observations of all kinds, one at a time.

    Raises
    ------
    NotSwapped : an answer is no number, is beyond -1 to 1, or takes too long.
    """
    generator = np.random.default_rng(0)
    spread = np.where(np.arange(PROBES) % 10 == 0, LARGEST, 1.0)[:, None]  # some as far off as observations go
    seen = np.clip(spread * generator.standard_normal((PROBES, SIZE)), -LARGEST, LARGEST).astype(np.float32)
    took = np.zeros(PROBES)
    for k in range(PROBES):
        begun = time.thread_time()
        with np.errstate(all="ignore"):
            done = policy.act(seen[k : k + 1])
        took[k] = time.thread_time() - begun
        if done.shape != (1, 2) or not np.all(np.isfinite(done)) or np.any(np.abs(done) > 1.0):
            raise NotSwapped("The policy's action for an observation is not a number from -1 to 1.")
    late = float(np.quantile(took, 0.99))
    if late > latency:
        raise NotSwapped(f"The policy takes {1e3 * late:.1f} ms for an action; {1e3 * latency:g} ms are allowed.")
