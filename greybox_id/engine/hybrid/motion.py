"""Hybrid models whose network has no memory, as equations of motion for exports and diagnoses."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace

import casadi as cs

from ...base.errors import BadInput
from ...models.hybrid_model import FeedForwardNetwork, HybridModel
from ...models.model import Namespace, Symbol
from ...models.motion_model import MotionModel, Quantities, State
from ..simulation import equations_of_motion
from .cell import network_outputs


@equations_of_motion.register(HybridModel)
def as_motion(model: HybridModel, text: str = "") -> MotionModel:
    """The model as equations of motion, with the network's weights as constants.

    Raises
    ------
    BadInput : the network has a memory, or was trained with an integrator other than rk4.
    """
    network = model.network
    if not isinstance(network, FeedForwardNetwork):
        raise BadInput(
            f"{model.name} has a recurrent network, and equations of motion have no place for its memory. Give a "
            "single track the stiffnesses it estimates, or fit mlp_lateral or bicycle_mlp."
        )
    if model.integrator != "rk4":
        raise BadInput(
            f"This {model.name} was trained with the integrator {model.integrator}: its network is valid only for "
            f"steps of {model.sample_time:g} s. Train it with integrator=rk4."
        )
    weights = {name: cs.DM(model[name].array) for name in network.shapes}
    physical = tuple(parameter for parameter in model.parameters if parameter.name not in weights)

    def dynamics(x: Namespace, u: Namespace, p: Namespace, q: Quantities) -> Mapping[str, Symbol]:
        inputs = SimpleNamespace(**{name: getattr(u, name) for name in model.inputs})
        for name, least in model.least.items():  # below this the equations are not valid, but must stay finite
            setattr(inputs, name, cs.fmax(getattr(inputs, name), least))
        z = network_outputs(network, cs.vertcat(*model.features(x, inputs, p)), weights)
        rates, quantities = model.physics(x, inputs, p, [z[k] for k in range(network.outputs)])
        for name in others:
            setattr(q, name, quantities[name])
        return rates

    states = tuple(State(state.name, state.unit, 1.0) for state in model.states)
    names = [state.name for state in states]
    others = tuple(name for name in model.estimates if name not in names)
    return MotionModel(
        name=model.name,
        about=model.about,
        inputs=model.inputs,
        commands=model.commands,
        outputs=model.outputs,
        parameters=physical,
        states=states,
        dynamics=dynamics,
        quantities=others,
        settings=model.settings,
        learnt=True,
    )
