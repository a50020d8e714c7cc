"""An actuator network: what a vehicle's yaw rate, and its lateral speed, will be a sample later, and its file.

It reads the last steps of commands and motion and says the next one, in place of tyres and actuators. Source of the
variant `paper`: "Online dynamics model learning and policy fine-tuning for autonomous racing"; `abstract` is what that
paper's abstract says in place of its section on methods.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from greybox_id.base.files import write_atomically
from greybox_id.base.json_data import Kind
from greybox_id.base.shorthands import Array

from ..racing.network import Perceptron


def drawn(sizes: Sequence[int], rng: np.random.Generator) -> Perceptron:
    """A network whose weights keep the variance of what goes through (Glorot & Bengio 2010); biases are zero."""
    weights = [rng.normal(0.0, np.sqrt(2.0 / (a + b)), (a, b)) for a, b in pairwise(sizes)]
    return Perceptron(weights, [np.zeros(b) for b in sizes[1:]], "elu")


class SquaredError:
    """Half the mean squared error of a network on rows, and its gradient.

    Parameters
    ----------
    net : of that form.
    x, y : (n, in) and (n, out) rows.
    """

    def __init__(self, net: Perceptron, x: Array, y: Array) -> None:
        self._x, self._y = np.ascontiguousarray(x), y
        self._net = net.at(net.vector)

    def __call__(self, q: Array) -> tuple[float, Array]:
        """Loss and gradient at a network's numbers, `Perceptron.vector`."""
        *layers, error = self._through(q)
        slope = self._net.backward(layers, error / error.size).copy()
        return 0.5 * float(np.sum(error**2)) / error.size, slope

    def errors(self, q: Array) -> Array:
        """(n, out) what the network says, less what it should."""
        return self._through(q)[-1]

    def _through(self, q: Array) -> list[Array]:
        """What each layer reads, and the errors of the last one."""
        self._net.vector[:] = q
        *layers, stated = self._net.forward(self._x)
        return [*layers, stated - self._y]


DRIVE = "drive"
"""What the drive or speed command is called among a network's inputs, whichever signal it is recorded as."""

NET = Kind("greybox-id actuator network", 1, "an actuator network", "train_actuator_net", "train again")


@dataclass(frozen=True)
class Variant:
    """What a network reads and says.

    Attributes
    ----------
    inputs : signals of a step.
    outputs : what it says of the next one.
    history : steps that it reads, the newest first.
    residual : whether it says the difference to a model's prediction of that step.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    history: int
    residual: bool = False


_ALL = ("steer", DRIVE, "yaw_rate", "v_x", "v_y")
VARIANTS: Mapping[str, Variant] = {
    "paper": Variant(("steer", "yaw_rate", "v_x"), ("yaw_rate",), 3),
    "abstract": Variant(_ALL, ("yaw_rate", "v_y"), 15),
    "residual": Variant(_ALL, ("yaw_rate", "v_y"), 15, residual=True),
}
HIDDEN = (64, 64, 32)
"""Units of the hidden layers, as published."""


@dataclass(frozen=True)
class ActuatorNet:
    """Networks of one variant, trained on the same recordings from several seeds.

    Attributes
    ----------
    variant : one of `VARIANTS`.
    inputs, outputs, history : see `Variant`.
    sample_time : s, between steps.
    members : the networks; they read and say standardised numbers.
    means, scales : (inputs,) of what is read, in SI units.
    out_means, out_scales : (outputs,) of what is said.
    sigma : (outputs,) root mean square error of a step that was not trained on.
    channel : signal that the drive command was recorded as; empty where it is not read.
    model : of `residual`, the fingerprint of the model that it adds to (`fingerprint`); empty otherwise.
    data : hash of the rows it was trained on.
    trained : how, for people: rows, split, seeds, steps, what was resampled.

    Raises
    ------
    ValueError : parts that do not go together.
    """

    variant: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    history: int
    sample_time: float
    members: tuple[Perceptron, ...]
    means: Array
    scales: Array
    out_means: Array
    out_scales: Array
    sigma: Array
    channel: str = ""
    model: str = ""
    data: str = ""
    trained: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        value = VARIANTS.get(self.variant)
        if value is None:
            raise ValueError(f"there is no variant {self.variant!r}; choose one of {', '.join(VARIANTS)}")
        if (self.inputs, self.outputs, self.history) != (value.inputs, value.outputs, value.history):
            raise ValueError(f"inputs, outputs or history are not those of the variant {self.variant}")
        if not (self.members and np.isfinite(self.sample_time) and self.sample_time > 0):
            raise ValueError("a network must have a sample time above zero, and at least one member")
        if value.residual != bool(self.model) or (DRIVE in self.inputs) != bool(self.channel):
            raise ValueError("the model it adds to, or the drive's channel, is missing")
        ends = (self.history * len(self.inputs), len(self.outputs))
        if any((one.sizes[0], one.sizes[-1]) != ends for one in self.members):
            raise ValueError(f"networks of {ends[0]} numbers in and {ends[1]} out are needed")
        for name, size in (("means", len(self.inputs)), ("scales", len(self.inputs)), ("out_means", ends[1]),
                           ("out_scales", ends[1]), ("sigma", ends[1])):  # fmt: skip
            numbers = getattr(self, name)
            if numbers.shape != (size,) or not np.all(np.isfinite(numbers)):
                raise ValueError(f"{name}: {size} finite numbers are needed")
            if "mean" not in name and not np.all(numbers > 0):
                raise ValueError(f"{name}: numbers above zero are needed")

    @property
    def residual(self) -> bool:
        """Whether it adds to a model's prediction."""
        return VARIANTS[self.variant].residual

    def following(self, seen: Array, value: Array) -> Array:
        """What every member says of the next step.

        Parameters
        ----------
        seen : (L, history, inputs) in SI units, the newest step first.
        value : (L, outputs) what the model of motion says of it.

        Returns
        -------
        (members, L, outputs) in SI units.
        """
        x = ((seen - self.means) / self.scales).reshape(len(seen), -1)
        stated = np.stack([one.each(x) for one in self.members]) * self.out_scales + self.out_means
        return np.asarray(stated + value if self.residual else stated)

    def text(self) -> str:
        """The text of its file."""
        members = [
            [{"weights": W, "biases": b} for W, b in zip(one.weights, one.biases, strict=True)] for one in self.members
        ]
        plain = {name: getattr(self, name) for name in self.__dataclass_fields__ if name not in ("members", "trained")}
        return NET.text({**plain, "trained": dict(self.trained), "members": members})

    def save(self, path: str | Path) -> None:
        """Write its file."""
        write_atomically(Path(path), self.text())


def load_actuator_net(path: str | Path) -> ActuatorNet:
    """The actuator network of a file.

    Parameters
    ----------
    path : of a file that `ActuatorNet.save` wrote.

    Raises
    ------
    BadInput : it is no such file, or is damaged.

    Examples
    --------
    >>> import tempfile
    >>> import greybox_id as gb
    >>> from greybox_lab.driving.learned.net import load_actuator_net
    >>> from greybox_lab.driving.learned.training import train_actuator_net
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 400)
    >>> file = f"{tempfile.mkdtemp()}/net.json"
    >>> train_actuator_net(lap, steps=3).save(file)
    >>> load_actuator_net(file).variant
    'paper'
    """
    return NET.load(path, _of)


def _of(body: dict[str, Any]) -> ActuatorNet:
    members = tuple(
        Perceptron([np.array(item["weights"], dtype=float) for item in one],
                   [np.array(item["biases"], dtype=float) for item in one], "elu")
        for one in body["members"]
    )  # fmt: skip
    numbers = {
        name: np.array(body[name], dtype=float) for name in ("means", "scales", "out_means", "out_scales", "sigma")
    }
    return ActuatorNet(
        variant=str(body["variant"]), inputs=tuple(body["inputs"]), outputs=tuple(body["outputs"]),
        history=int(body["history"]), sample_time=float(body["sample_time"]), members=members, **numbers,
        channel=str(body["channel"]), model=str(body["model"]), data=str(body["data"]), trained=dict(body["trained"]),
    )  # fmt: skip
