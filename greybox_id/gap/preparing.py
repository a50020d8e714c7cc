"""What a diagnosis starts from: the model with its tolerances, and with everything that it may lack at its null."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ..effect import Effect
from ..errors import BadInput
from ..models.vehicles import with_tolerances
from ..motion_model import MotionModel
from ..parameter import Parameter
from ..recording import Recording
from ..vehicle import Vehicle
from .observer import observed, with_seen

OBSERVED, RATE = "v_x", 0.3
"""The state that a weak observer keeps near its reading, and the observer's rate, 1/s."""
PASSES = 2
"""How often equations are gone through for what depends on what it leads to: a third time changes loads by less than
1 % of what the second did, and costs half as much again."""
OF_VARIANCE = ("timestamp_jitter", "dropped_samples")
"""Effects that change no expected reading: what tells them is how readings scatter (variance.py)."""


@dataclass(frozen=True)
class Prepared:
    """What is diagnosed.

    Attributes
    ----------
    nominal : the model with its tolerances; what is not believed is held.
    everything : the same with all candidates at their null, and an observer.
    effects : candidates by name.
    """

    nominal: MotionModel
    everything: MotionModel
    effects: Mapping[str, Effect]

    def seen(self, recordings: Sequence[Recording]) -> list[Recording]:
        """Recordings with what the observer reads."""
        is_observed = len(self.everything.inputs) > len(self.nominal.inputs)
        return [with_seen(recording, OBSERVED) for recording in recordings] if is_observed else list(recordings)


def prepare(
    model: MotionModel, recordings: Sequence[Recording], effects: Mapping[str, Effect], vehicle: Vehicle | None
) -> Prepared:
    """Put everything a model may lack on it.

    Parameters
    ----------
    model : to be diagnosed, at its nominal values.
    recordings : of the vehicle.
    effects : what may be the cause, by name.
    vehicle : what is stated of it; a number stated without an sd is exact here. None: all beliefs of the model count.
    """
    nominal = _with_beliefs(model, effects, vehicle)
    everything, concerned = nominal, {}
    for name, effect in effects.items():
        if name in OF_VARIANCE or not (name in nominal.effects or effect.concerns(nominal)):
            continue
        concerned[name] = effect
        if name not in nominal.effects:
            everything = everything + replace(effect, parameter=replace(effect.parameter, fixed=True))
    if not concerned:
        raise BadInput(f"Nothing is known that {model.name} may lack: no effect acts on it.")
    everything = replace(everything, passes=min(everything.passes, PASSES))
    return Prepared(nominal, _observed(everything, recordings), concerned)


def prepare_plain(
    model: MotionModel, recordings: Sequence[Recording], effects: Mapping[str, Effect], vehicle: Vehicle | None
) -> Prepared:
    """The same without candidates, for a model that is not diagnosed any further."""
    nominal = _with_beliefs(model, effects, vehicle)
    return Prepared(nominal, _observed(nominal, recordings), {})


def _with_beliefs(model: MotionModel, effects: Mapping[str, Effect], vehicle: Vehicle | None) -> MotionModel:
    nominal = model.with_parameters(*(_held(model, parameter, vehicle) for parameter in model.parameters))
    return nominal if vehicle is None else with_tolerances(nominal, vehicle, effects)


def _observed(model: MotionModel, recordings: Sequence[Recording]) -> MotionModel:
    states = [state.name for state in model.states]
    if OBSERVED in states and OBSERVED in model.outputs and all(OBSERVED in own for own in recordings):
        return observed(model, OBSERVED, RATE)
    return model


def _held(model: MotionModel, parameter: Parameter, vehicle: Vehicle | None) -> Parameter:
    """A parameter, held unless something is believed of it: an effect of the model is as it stands."""
    if vehicle is None:
        return replace(parameter, fixed=parameter.fixed or parameter.prior is None)
    stated = vehicle.values.get(parameter.name)
    believed = stated is not None and stated.sd is not None
    return parameter if believed else replace(parameter, fixed=True)
