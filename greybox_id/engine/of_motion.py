"""The equations of motion that a model is made of, or amounts to: what exports and linear systems take."""

from __future__ import annotations

from ..base.errors import BadInput
from ..models.kinds import by_kind
from ..models.model import Model
from ..models.motion_model import MotionModel


@by_kind
def equations_of_motion(model: Model, text: str = "") -> MotionModel:
    """The model as equations of motion; a network without a memory is part of them, its weights are constants.

    Parameters
    ----------
    model : at its values.
    text : what takes equations of motion only, as the end of a sentence.

    Raises
    ------
    BadInput : it is nothing of the kind.
    """
    raise BadInput(f"{model.name} is no model of motion{text}.")


@equations_of_motion.register(MotionModel)
def _itself(model: MotionModel, text: str = "") -> MotionModel:
    return model
