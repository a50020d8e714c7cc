"""Equations of hybrid models, about what their network says."""

from __future__ import annotations

from types import SimpleNamespace

from ...models.hybrid_model import FeedForwardNetwork, HybridModel
from .expression import Equation, Symbol
from .tracing import Reader, traced

SAID = "z"
"""What the network says."""


@traced.register(HybridModel)
def hybrid_equations(model: HybridModel) -> tuple[Equation, ...]:
    """Outputs and estimates, then the derivatives of the states."""
    read = Reader()
    x = SimpleNamespace(**{state.name: read.named(Symbol(state.name)) for state in model.states})
    u = SimpleNamespace(**{name: read.named(Symbol(name)) for name in model.inputs})
    p = SimpleNamespace(
        **{
            parameter.name: read.named(Symbol(parameter.name))
            for parameter in model.parameters
            if parameter.shape == ()
        }
    )
    z = [read.named(Symbol(SAID, (k + 1,))) for k in range(model.network.outputs)]
    rates, quantities = model.physics(x, u, p, z)
    target = [*model.estimates, *(name for name in model.outputs if name not in model.estimates)]
    result = [Equation(Symbol(name), read(quantities[name])) for name in target if name in quantities]
    result += [Equation(Symbol(name, dots=1), read(rate)) for name, rate in rates.items()]
    return tuple(item for item in result if item.right != Symbol(item.left.name))


def network_words(model: HybridModel) -> str:
    """What the network reads and how large it is, in a sentence."""
    network = model.network
    if isinstance(network, FeedForwardNetwork):
        units = {"tanh": "hyperbolic tangents", "relu": "rectified linear units"}[network.activation]
        layers = ", ".join(map(str, network.hidden))
        mirrored = " It is odd: a right turn gives the mirror image of a left one." if network.mirrored else ""
        return (
            f"z is the output of a feed-forward network of {layers} {units} that reads {network.features} features of "
            f"states and inputs; its last layer is linear.{mirrored}"
        )
    layers = ", ".join(map(str, network.hidden))
    skip = " and reads the features directly, too" if network.skip else ""
    return (
        f"z is the output of a recurrent network of {layers} rectified linear units. At every row it reads "
        f"{network.features} features of states and inputs, and its layers' outputs of the row before; its last layer "
        f"is linear{skip}."
    )
