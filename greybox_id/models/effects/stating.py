"""How the effects of this package are stated: name, unit, null, bounds and meaning as in a table, then what they do."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ...effect import Effect
from ...model import Namespace, Symbol
from ...motion_model import MotionModel, Quantities
from ...parameter import Parameter


def speed(q: Quantities) -> Symbol:
    """Speed forwards, m/s: a state of some models, an input of others."""
    return q.x.v_x if hasattr(q.x, "v_x") else q.u.v_x


def effect(
    group: str,
    name: str,
    unit: str,
    null: float,
    bounds: tuple[float, float],
    about: str,
    *,
    touches: tuple[str, ...],
    apply: Callable[[MotionModel], MotionModel],
    typical: float,
    **more: Any,
) -> Effect:
    """An effect whose magnitude has the effect's name.

    Parameters
    ----------
    group, name, touches, apply, typical : as of `Effect`.
    unit, null, bounds, about : of its magnitude.
    more : further attributes of `Effect`.
    """
    magnitude = Parameter(name, unit, null, bounds, about=about)
    return Effect(name, magnitude, touches, apply, typical=typical, group=group, **more)


def alteration(
    group: str,
    name: str,
    unit: str,
    null: float,
    bounds: tuple[float, float],
    about: str,
    *,
    typical: float,
    gradual: bool = True,
    passes: int = 1,
    needs: tuple[str, ...] = (),
    others: tuple[Parameter, ...] = (),
    **changes: Callable[[Symbol, Quantities], Symbol],
) -> Effect:
    """An effect that alters parameters, inputs or quantities: name=(its value, q) -> its altered value.

    Parameters
    ----------
    group, name, typical, gradual, needs, others : as of `Effect`.
    unit, null, bounds, about : of its magnitude.
    passes : how often the dynamics are gone through, for changes that read q.before.
    changes : those the model has act, the others do nothing.
    """

    def apply(model: MotionModel) -> MotionModel:
        return model.altered(**changes).gone_through(passes)

    return effect(
        group, name, unit, null, bounds, about,
        touches=tuple(changes), apply=apply, typical=typical, gradual=gradual, needs=needs, others=others,
    )  # fmt: skip


def reading(
    group: str,
    name: str,
    unit: str,
    null: float,
    bounds: tuple[float, float],
    about: str,
    *,
    typical: float,
    needs: tuple[str, ...] = (),
    **changes: Callable[[Namespace, Quantities], Symbol],
) -> Effect:
    """An effect on what sensors read: output=(readings so far, q) -> what is read instead.

    Parameters
    ----------
    group, name, typical, needs : as of `Effect`.
    unit, null, bounds, about : of its magnitude.
    changes : those of the model's outputs act, the others do nothing.
    """

    def apply(model: MotionModel) -> MotionModel:
        found = {output: change for output, change in changes.items() if output in model.outputs}

        def sensor(read: Namespace, q: Quantities) -> Mapping[str, Symbol]:
            return {output: change(read, q) for output, change in found.items()}

        return model.sensed(sensor)

    return effect(
        group, name, unit, null, bounds, about, touches=tuple(changes), apply=apply, typical=typical, needs=needs
    )  # fmt: skip
