"""What was understood of a file: settings and values of a model of ours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from greybox_id.base.shorthands import Array
from greybox_id.models.msnn_lat import LateralSettings
from greybox_id.models.msnn_long import LongitudinalSettings

from .network import Network


@dataclass(frozen=True)
class NetworkPart:
    """An output of a file as a model of ours.

    Attributes
    ----------
    model : its name in the registry.
    settings : its hyperparameters.
    values : parameter -> value.
    relation : what the file computes it with.
    output : signal that it is.
    roles : input of the file -> signal.
    """

    model: str
    settings: LateralSettings | LongitudinalSettings
    values: Mapping[str, Array]
    relation: str
    output: str
    roles: Mapping[str, str]


def put(network: Network, into: Array, at: Any, values: ArrayLike) -> None:
    """Fill a place of an array of NaN. Raises `BadInput` where the file fills it twice or it does not fit."""
    if not np.all(np.isnan(into[at])):
        raise network.wrong("two local models or impulse responses have the same memberships.")
    into[at] = values


def padded(weights: Array, length: int) -> Array:
    """An impulse response over a longer window: what is older does not count."""
    return np.concatenate([np.zeros(length - len(weights)), weights])
