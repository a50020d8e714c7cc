"""Known physics with a network for the unknown part.

    def physics(x, u, p, z):
        F_yf = stiffness(z[0]) * alpha_f                  # z: outputs of the network, of order one
        ...
        return {"v_y": a_y - u.v_x * x.yaw_rate, ...}, {"F_yf": F_yf, "a_y": a_y, ...}

At every sample the network computes z from features of states and inputs, and from its memory if it is recurrent; the
physics compute the states' derivatives and named quantities from z. Only outputs of the physics are compared with a
recording: outputs of the network, such as tyre forces, are never measured.

Source: "Tire cornering stiffness estimation using hybrid modeling", Sec. 2 and 3.2, Fig. 2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import ClassVar, Literal

from ..base.errors import BadModel
from ..base.shorthands import Array
from ..datasets.recording import Recording
from .model import Model, Namespace, Symbol

Physics = Callable[
    [Namespace, Namespace, Namespace, Sequence[Symbol]], tuple[Mapping[str, Symbol], Mapping[str, Symbol]]
]
"""(x, u, p, z) -> derivatives by state, quantities by name. Symbols are rows of numbers, one per window."""


@dataclass(frozen=True)
class Carried:
    """A state of the physics: a signal that recordings may hold, and its SI unit."""

    name: str
    unit: str


@dataclass(frozen=True)
class RecurrentNetwork:
    """Layers that feed back their output of the previous step, and a linear one on top (Elman; rectified linear units).

        h_l = max(0, W_l h_(l-1) + R_l h_l(a step before) + b_l),    z = W_out h_last + b_out + W_skip features

    Attributes
    ----------
    features : number of inputs.
    hidden : units of each hidden layer.
    outputs : number of outputs.
    skip : whether features also enter the output directly, W_skip.
    """

    features: int
    hidden: tuple[int, ...]
    outputs: int
    skip: bool = False

    @property
    def shapes(self) -> Mapping[str, tuple[int, ...]]:
        """Parameter name -> its shape."""
        result: dict[str, tuple[int, ...]] = {}
        before = self.features
        for number, units in enumerate(self.hidden, 1):
            result |= {f"W_{number}": (units, before), f"R_{number}": (units, units), f"b_{number}": (units,)}
            before = units
        result |= {"W_out": (self.outputs, before), "b_out": (self.outputs,)}
        return result | ({"W_skip": (self.outputs, self.features)} if self.skip else {})


@dataclass(frozen=True)
class FeedForwardNetwork:
    """Layers without memory, and a linear one on top.

        h_l = activation(W_l h_(l-1) + b_l),    z = W_out h_last + b_out

    Attributes
    ----------
    features : number of inputs.
    hidden : units of each hidden layer.
    outputs : number of outputs.
    activation : of the hidden layers.
    mirrored : for each feature, whether it changes sign under reflection. If given, the output is
        z(f) - z(mirrored f), so that left and right turns are treated alike.
    """

    features: int
    hidden: tuple[int, ...]
    outputs: int
    activation: Literal["tanh", "relu"] = "tanh"
    mirrored: tuple[bool, ...] = ()
    skip: bool = False

    @property
    def shapes(self) -> Mapping[str, tuple[int, ...]]:
        """Parameter name -> its shape."""
        result: dict[str, tuple[int, ...]] = {}
        before = self.features
        for number, units in enumerate(self.hidden, 1):
            result |= {f"W_{number}": (units, before), f"b_{number}": (units,)}
            before = units
        return result | {"W_out": (self.outputs, before), "b_out": (self.outputs,)}


Integrator = Literal["euler", "ab2", "rk4"]
"""Integration from one sample to the next: Euler, second-order Adams-Bashforth, or classical Runge-Kutta, which
evaluates the network four times."""


@dataclass(frozen=True, kw_only=True, repr=False)
class HybridModel(Model):
    """Physics with a network inside.

    Attributes
    ----------
    states : in order.
    commands : inputs that are held between rows if the recording says that commands are.
    network : its architecture; its weights are parameters named as in its `shapes`.
    features : (x, u, p) -> inputs of the network, each of order one.
    physics : see `Physics`. Outputs are states or quantities by name.
    estimates : quantities that an estimator can return, name -> SI unit.
    untold : estimate -> (quantity, threshold): the estimate is not identifiable where the quantity is smaller.
    readings : state or output -> function that computes it from a recording without it; it returns None if impossible.
    least : input -> smallest value at which the physics hold.
    carried_on : parameters freed when training is continued for a changed vehicle.
    sample_time : s; recordings must have it.
    substeps : number of integration steps per sample.
    integrator : integration scheme; a recurrent network requires "ab2".
    window, warm_up : rows predicted from one start in training, and how many of them are not compared, so that the
        network's memory fills and the start is forgotten.
    """

    kind: ClassVar[str] = "hybrid"
    called: ClassVar[str] = "a hybrid model"

    states: tuple[Carried, ...]
    commands: tuple[str, ...] = ()
    network: RecurrentNetwork | FeedForwardNetwork
    features: Callable[[Namespace, Namespace, Namespace], Sequence[Symbol]]
    physics: Physics
    estimates: Mapping[str, str]
    untold: Mapping[str, tuple[str, float]] = field(default_factory=lambda: MappingProxyType({}))
    readings: Mapping[str, Callable[[Recording], Array | None]] = field(default_factory=lambda: MappingProxyType({}))
    least: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    carried_on: tuple[str, ...] = ()
    sample_time: float
    substeps: int = 1
    integrator: Integrator = "ab2"
    window: int = 60
    warm_up: int = 20

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.sample_time > 0:
            raise BadModel(f"Model {self.name} needs a sample time above zero; {self.sample_time} s was given.")
        if not 0 <= self.warm_up < self.window:
            raise BadModel(
                f"Model {self.name}: its window of {self.window} rows must be longer than its warm_up of "
                f"{self.warm_up} rows."
            )

    @property
    def recurrent(self) -> bool:
        """Whether the network has a memory."""
        return isinstance(self.network, RecurrentNetwork)

    @property
    def remembered(self) -> int:
        """Total number of memory values of the network's layers."""
        return sum(self.network.hidden) if self.recurrent else 0

    def read(self, name: str, recording: Recording) -> Array | None:
        """A state or output as recorded, or computed from other signals; None if neither is possible."""
        if name in recording:
            return recording[name]
        return self.readings[name](recording) if name in self.readings else None
