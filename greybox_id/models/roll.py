"""A body that rolls on its springs, as part of a single track: roll angle and roll rate, which a gyro reads.

    (I_x + m h_cg^2) roll'' = m h_cg (a_y + g roll) - roll_stiffness roll - roll_damper roll'

about an axis on the road, positive where the left side rises, as it does in a left turn. Springs are stated in N m/rad,
so that how far and how fast a body rolls tells its mass, which lateral motion alone tells only together with the
tyres' forces. An accelerometer on the body reads g roll more and h_cg roll'' less of a_y, as one of `roll_dynamics`
does, which is the same body by its roll gradient and natural frequency.
Source: Rajamani, Vehicle Dynamics and Control, 2nd ed., Sec. 15.2, with the axis on the road.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ..base.errors import BadInput
from ..base.numbers import quantity
from .model import Model, Namespace, Symbol
from .motion_model import MotionModel, Quantities, State
from .parameter import Parameter
from .single_track import G

PARAMETERS = (
    Parameter("I_x", "kg m^2", 550.0, (1e-5, 100000.0), fixed=True, about="roll inertia about the centre of gravity"),
    Parameter("roll_stiffness", "N m/rad", 9e4, (0.1, 5e6), about="moment of springs and stabilisers per roll angle"),
    Parameter("roll_damper", "N m s/rad", 5e3, (1e-3, 5e5), about="moment of the dampers per roll rate"),
)


def with_roll(model: MotionModel) -> MotionModel:
    """The model with a body that rolls, and its roll rate as an output.

    Parameters
    ----------
    model : `single_track` or `lateral`.
    """

    def rolling(q: Quantities) -> dict[str, Symbol]:
        moment = q.p.m * q.p.h_cg * (q.a_y + G * q.x.roll)
        back = q.p.roll_stiffness * q.x.roll + q.p.roll_damper * q.x.roll_rate
        return {"roll": q.x.roll_rate, "roll_rate": (moment - back) / (q.p.I_x + q.p.m * q.p.h_cg**2)}

    def on_the_body(read: Namespace, q: Quantities) -> Mapping[str, Symbol]:
        return {"a_y": read.a_y + G * q.x.roll - q.p.h_cg * q.rates.roll_rate}

    def steady(x: Namespace, u: Namespace, p: Namespace) -> Symbol:
        """The roll angle of a steady turn."""
        weight = p.m * p.h_cg
        return weight * x.yaw_rate * (x.v_x if hasattr(x, "v_x") else u.v_x) / (p.roll_stiffness - weight * G)

    states = (State("roll", "rad", 0.03, start=steady), State("roll_rate", "rad/s", 0.05))
    result = model.with_states(rolling, *states).sensed(on_the_body).with_parameters(*PARAMETERS)
    return replace(result, outputs=(*result.outputs, "roll_rate"), settings=dict(result.settings) | {"body": "rolling"})


def must_stand(model: Model) -> None:
    """Raise `BadInput` where a body that rolls has no equilibrium: its weight tips it further than springs hold."""
    if model.settings.get("body") != "rolling":
        return
    stiffness, m, h_cg = (float(model[name].array) for name in ("roll_stiffness", "m", "h_cg"))
    if stiffness <= m * h_cg * G:
        stiff, weight = quantity(stiffness, "N m/rad"), quantity(m * h_cg * G, "N m/rad")
        raise BadInput(
            f"{model.name}: the body tips over: roll_stiffness is {stiff}, and its weight, m · h_cg · g, needs more "
            f"than {weight}. State a larger roll_stiffness in the vehicle file, or set body=stiff."
        )
