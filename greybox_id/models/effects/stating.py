"""Constructors of effects: name, unit, null, bounds and meaning as in a table, then the transform."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ..effect import Effect
from ..memory_model import MemoryModel
from ..model import Namespace, Symbol
from ..motion_model import MotionModel, Quantities
from ..parameter import Parameter


def speed(q: Quantities) -> Symbol:
    """Forward speed, m/s: a state of some models, an input of others."""
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
    group, name, touches, apply, typical : as in `Effect`.
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
    apply_to_memory: Callable[[MemoryModel], MemoryModel] | None = None,
    in_memory: str = "",
    by_name: bool = False,
    rounds: str = "",
    **changes: Callable[[Symbol, Quantities], Symbol],
) -> Effect:
    """An effect that alters parameters, inputs or quantities: name=(its value, q) -> its altered value.

    Parameters
    ----------
    group, name, typical, gradual, needs, others : as in `Effect`.
    unit, null, bounds, about : of its magnitude.
    passes : number of evaluations of the dynamics, for changes that read q.before.
    apply_to_memory : transform of models with memory, if defined for them.
    in_memory : name that it acts on there, if different.
    by_name, rounds : as in `Effect`.
    changes : alterations by name; those whose name the model lacks are ignored.

    Returns
    -------
    Effect
        To be added to a model of motion: `model + effect.free()`, or `model + effect.at(0.5)`.

    Raises
    ------
    BadInput : the null value is outside the bounds.

    Examples
    --------
    >>> import greybox_id as gb
    >>> soft = gb.effects.alteration(
    ...     "steering", "soft_steering", "1/rad", 0.0, (-1.0, 5.0), "steering angle lost", typical=0.5,
    ...     steer=lambda steer, q: steer / (1 + q.p.soft_steering * steer**2),
    ... )
    >>> (gb.models.lateral() + soft.free()).effects
    ('soft_steering',)
    """

    def apply(model: MotionModel) -> MotionModel:
        return model.altered(**changes).gone_through(passes)

    return effect(
        group, name, unit, null, bounds, about,
        touches=(*changes, *([in_memory] if in_memory else [])), apply=apply, typical=typical, gradual=gradual,
        needs=needs, others=others, apply_to_memory=apply_to_memory, by_name=by_name,
        rounds=rounds,
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
    by_name: bool = False,
    **changes: Callable[[Namespace, Quantities], Symbol],
) -> Effect:
    """An effect on sensor readings: output=(readings so far, q) -> altered reading.

    Parameters
    ----------
    group, name, typical, needs, by_name : as in `Effect`.
    unit, null, bounds, about : of its magnitude.
    changes : altered readings by output; those of outputs that the model lacks are ignored.
    """

    def apply(model: MotionModel) -> MotionModel:
        result = {output: change for output, change in changes.items() if output in model.outputs}

        def sensor(read: Namespace, q: Quantities) -> Mapping[str, Symbol]:
            return {output: change(read, q) for output, change in result.items()}

        return model.sensed(sensor)

    return effect(
        group, name, unit, null, bounds, about, touches=tuple(changes), apply=apply, typical=typical, needs=needs,
        by_name=by_name, reads_only=True,
    )  # fmt: skip
