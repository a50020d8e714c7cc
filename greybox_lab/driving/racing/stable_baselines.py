"""`greybox/Track-v0` as Stable-Baselines3 has it: an episode begins in the step that ends the one before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from greybox_id.base.errors import BadInput
from greybox_id.base.shorthands import Array, Mask

from .environment import spaces_of
from .policy import Policy
from .world import Observations
from .worlds import world

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise BadInput("stable-baselines3 is not installed; pip install 'greybox-id[rl]'.") from error


class TrackVecEnv(VecEnv):  # type: ignore[misc]
    """Vehicles side by side; one whose episode is over begins anew in the same step.

    What was seen last of an episode is `terminal_observation` of its lane's info, and `TimeLimit.truncated` there says
    whether it would have gone on.

    Parameters
    ----------
    num_envs : how many.
    options : see `world`.
    """

    def __init__(self, num_envs: int = 1, **options: Any) -> None:
        self.world = world(num_envs, **options)
        super().__init__(num_envs, *spaces_of(self.world))
        self._actions: Array = np.zeros((num_envs, 2))

    def reset(self) -> Observations:
        """Begin everywhere; lane k draws from what `seed` said, plus k."""
        self.world.reset(np.ones(self.num_envs, dtype=bool), self._seeds)
        self._reset_seeds()
        self._reset_options()
        return self.world.observe()

    def step_async(self, actions: Array) -> None:
        """Say what is done next."""
        self._actions = actions

    def step_wait(self) -> tuple[Observations, Array, Mask, list[dict[str, Any]]]:
        """Drive a period everywhere."""
        reward, ended, cut = self.world.step(self._actions)
        seen, over = self.world.observe(), ended | cut
        infos: list[dict[str, Any]] = [{"TimeLimit.truncated": late} for late in cut.tolist()]
        if np.any(over):
            for k in np.flatnonzero(over).tolist():
                infos[k]["terminal_observation"] = seen[k]
            self.world.reset(over)
            seen = self.world.observe()
        return seen, reward.astype(np.float32), over, infos

    def close(self) -> None:
        """Nothing is open."""

    def get_attr(self, attr_name: str, indices: int | Sequence[int] | None = None) -> list[Any]:
        """An attribute, the same for all lanes."""
        result = None if attr_name == "render_mode" else getattr(self.world, attr_name)
        return [result for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: int | Sequence[int] | None = None) -> None:
        """Lanes share one world: nothing is set."""
        raise BadInput(
            f"{attr_name} cannot be set: the parallel environments share one world. Set it when the "
            f"environment is made."
        )

    def env_method(self, method_name: str, *given: Any, indices: int | Sequence[int] | None = None, **more: Any) -> Any:
        """Lanes share one world: no lane has methods of its own."""
        raise BadInput(
            f"{method_name}: a single parallel environment has no methods of its own; use those of "
            f".world, which all environments share."
        )

    def env_is_wrapped(self, wrapper_class: type[Any], indices: int | Sequence[int] | None = None) -> list[bool]:
        """Nothing is wrapped around a lane."""
        return [False for _ in self._get_indices(indices)]


def policy_of(learner: Any) -> Policy:
    """What was learned in a `TrackVecEnv`, as `gb.export` and the loop take it.

    Parameters
    ----------
    learner : of Stable-Baselines3, on-policy, with an MlpPolicy of tanh: PPO as it comes.

    Raises
    ------
    BadInput : its network is another.
    """
    trained, vehicles = learner.policy, learner.get_env().unwrapped
    layers = [*getattr(getattr(trained, "mlp_extractor", None), "policy_net", ()), getattr(trained, "action_net", None)]
    if [type(one).__name__ for one in layers] != ["Linear", "Tanh"] * (len(layers) // 2) + ["Linear"]:
        raise BadInput("Only networks of tanh layers can be converted to a policy; learn with PPO and its MlpPolicy.")
    weights = tuple(one.weight.detach().cpu().numpy().T.astype(np.float32) for one in layers[::2])
    biases = tuple(one.bias.detach().cpu().numpy().astype(np.float32) for one in layers[::2])
    about = {
        "model": vehicles.world.stage.equations.model.name,
        "rules": asdict(vehicles.world.rules),
        "units": vehicles.world.units,
        "drawn": list(vehicles.world.draws.names),
        "steps": learner.num_timesteps,
        "learner": f"stable-baselines3 {type(learner).__name__}",
    }
    return Policy(weights, biases, about)
