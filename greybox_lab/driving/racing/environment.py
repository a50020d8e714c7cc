"""`greybox/Track-v0`: the world as Gymnasium has it, one vehicle or many."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from greybox_id.base.errors import BadInput
from greybox_id.base.shorthands import Array, Mask

from .world import LARGEST, Observations, World
from .worlds import STEER_MAX as STEER_MAX
from .worlds import world as world


class TrackEnv(gymnasium.Env[Observations, Array]):
    """One vehicle on a track.

    Observations are 27 numbers: v_x and v_y over the track's top speed, yaw rate over that in the narrowest bend, e_y
    over the half width, sin e_psi, the last two actions, then curvature times half width and wanted over top speed at
    ten places 0.1 to 1 s ahead. Actions are two numbers from -1 to 1: steering, and drive or wanted speed.

    Parameters
    ----------
    options : see `world`.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 - Gymnasium's own name and form

    def __init__(self, render_mode: str | None = None, **options: Any) -> None:
        if render_mode is not None:
            raise BadInput("This environment has no rendering: render_mode must be None.")
        self.world = world(1, **options)
        self.observation_space, self.action_space = spaces_of(self.world)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Begin an episode; with a seed, everything that follows is drawn from it."""
        super().reset(seed=seed)
        self.world.reset(np.ones(1, dtype=bool), [seed])
        return self.world.observe()[0], self._told()

    def step(self, action: Array) -> tuple[Observations, float, bool, bool, dict[str, Any]]:
        """Drive a period."""
        reward, ended, cut = self.world.step(np.asarray(action)[None])
        return self.world.observe()[0], float(reward[0]), bool(ended[0]), bool(cut[0]), self._told()

    def _told(self) -> dict[str, Any]:
        return {name: float(item[0]) for name, item in self.world.situation().items()}


class TrackVectorEnv(VectorEnv[Observations, Array, Mask]):
    """Vehicles side by side; one whose episode is over begins anew with the next step, which its action is not for.

    Parameters
    ----------
    num_envs : how many.
    options : see `world`.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(self, num_envs: int = 1, render_mode: str | None = None, **options: Any) -> None:
        if render_mode is not None:
            raise BadInput("This environment has no rendering: render_mode must be None.")
        self.num_envs = num_envs
        self.world = world(num_envs, **options)
        self.single_observation_space, self.single_action_space = spaces_of(self.world)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._over = np.zeros(num_envs, dtype=bool)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Begin everywhere; lane k draws from its own seed, or from seed + k."""
        first = seed if seed is None or isinstance(seed, int | np.integer) else None
        super().reset(seed=first)
        one_each = [None if first is None else first + k for k in range(self.num_envs)]
        seeds = one_each if seed is first else list(cast(Sequence[int | None], seed))
        which = (options or {}).get("reset_mask", np.ones(self.num_envs, dtype=bool))
        self.world.reset(which, seeds)
        self._over &= ~which
        return self.world.observe(), dict(self.world.situation())

    def step(self, actions: Array) -> tuple[Observations, Any, Mask, Mask, dict[str, Any]]:
        """Drive a period everywhere, but where an episode begins."""
        begins = self._over
        self.world.reset(begins)
        reward, ended, cut = self.world.step(np.asarray(actions), still=begins)
        self._over = ended | cut
        return self.world.observe(), reward, ended, cut, dict(self.world.situation())


def spaces_of(world: World) -> tuple[Any, Any]:
    """Of what is seen, and of what is done."""
    return spaces.Box(-LARGEST, LARGEST, (world.size,), np.float32), spaces.Box(-1.0, 1.0, (2,), np.float32)
