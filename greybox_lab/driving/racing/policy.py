"""A driver that was learned: what it sees becomes what it does, and the file it is kept in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from greybox_id.base.files import write_atomically
from greybox_id.base.json_data import Kind
from greybox_id.base.shorthands import Array

from .network import sizes_of
from .world import Observations

ACTIONS = 2
"""Steering, and drive or speed."""

POLICY = Kind("greybox-id policy", 1, "a policy", "greybox_lab.driving.learn_policy", "learn again")

Layer = NDArray[np.float32]


@dataclass(frozen=True)
class Policy:
    """A network of layers of tanh, whose last layer is linear and clamped to -1 to 1.

    Attributes
    ----------
    weights : of the layers, (in, out) each; the first takes an observation of `racing.world.World`.
    biases : of the layers, (out,) each; the last gives steering, and drive or speed.
    about : what it was learned on, in words and numbers: vehicle, effects, rules, steps, seed.

    Raises
    ------
    ValueError : shapes that do not follow each other, or what is no number.
    """

    weights: tuple[Layer, ...]
    biases: tuple[Layer, ...]
    about: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        sizes = sizes_of(self.weights, self.biases)
        if sizes[-1] != ACTIONS:
            raise ValueError(f"{sizes[-1]} actions instead of {ACTIONS}")

    @property
    def size(self) -> int:
        """Numbers of an observation."""
        return len(self.weights[0])

    def act(self, seen: Observations) -> Array:
        """(L, 2) what drivers do who see (L, size)."""
        h = seen
        for W, b in zip(self.weights[:-1], self.biases[:-1], strict=True):
            h = np.tanh(h @ W + b)
        done: Array = np.clip(h @ self.weights[-1] + self.biases[-1], -1.0, 1.0)
        return done

    def plain(self) -> dict[str, Any]:
        """As plain data."""
        return {"about": dict(self.about), "layers": plain_layers(self.weights, self.biases)}

    def text(self) -> str:
        """The text of its file."""
        return POLICY.text(self.plain())

    def save(self, path: str | Path) -> None:
        """Write its file."""
        write_atomically(Path(path), self.text())


def load_policy(path: str | Path) -> Policy:
    """The policy of a file. Raises `BadInput`."""
    return POLICY.load(path, policy_of)


def policy_of(body: Mapping[str, Any]) -> Policy:
    """A policy of the plain data of its file. Raises `LookupError`, `TypeError` or `ValueError` where it is none."""
    return Policy(*layers_of(body["layers"]), dict(body["about"]))


def plain_layers(weights: Sequence[Layer], biases: Sequence[Layer]) -> list[dict[str, Any]]:
    """Layers as plain data, in as many digits as single precision has."""
    return [{"weights": _short(W), "biases": _short(b)} for W, b in zip(weights, biases, strict=True)]


def layers_of(plain: Sequence[Mapping[str, Any]]) -> tuple[tuple[Layer, ...], tuple[Layer, ...]]:
    """Weights and biases of plain data."""
    weights = tuple(np.array(layer["weights"], dtype=np.float32) for layer in plain)
    return weights, tuple(np.array(layer["biases"], dtype=np.float32) for layer in plain)


def _short(numbers: Layer) -> Any:
    return numbers.astype(str).astype(float).tolist()
