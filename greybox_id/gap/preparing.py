"""What a diagnosis starts from: the model with its tolerances, and with everything that it may lack at its null."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..effect import Effect
from ..errors import BadInput
from ..memory_model import MemoryModel
from ..models.roughness import with_roughness
from ..models.vehicles import with_tolerances
from ..motion_model import MotionModel
from ..parameter import Parameter, Prior
from ..recording import Recording
from ..vehicle import Vehicle
from .bench import Bench
from .kinds import AnyBench, Diagnosed
from .memory_bench import MemoryBench
from .observer import SEEN, observed, with_seen

OBSERVED = {"v_x": 0.3, "yaw_rate": 0.0}
"""States that an observer keeps near their readings, and its rate, 1/s. That of the yaw rate is raised only where
simulations would spin otherwise."""
OF_VARIANCE = ("timestamp_jitter", "dropped_samples")
"""Effects that change no expected reading: what tells them is how readings scatter (variance.py)."""


@dataclass(frozen=True)
class Prepared:
    """What is diagnosed.

    Attributes
    ----------
    nominal : the model with its tolerances; what is not believed is held.
    everything : the same with all candidates at their null; equations of motion with an observer.
    effects : candidates by name.
    """

    nominal: Diagnosed
    everything: Diagnosed
    effects: Mapping[str, Effect]

    def bench(self, recordings: Sequence[Recording]) -> AnyBench:
        """What simulates everything over recordings."""
        if isinstance(self.everything, MemoryModel):
            return MemoryBench(self.everything, recordings)
        return Bench(self.everything, self.seen(recordings))

    def seen(self, recordings: Sequence[Recording]) -> list[Recording]:
        """Recordings with what the observer reads."""
        found = list(recordings)
        for state in OBSERVED:
            if SEEN.format(state) in self.everything.inputs:
                found = [with_seen(recording, state) for recording in found]
        return found


def prepare(
    model: Diagnosed, recordings: Sequence[Recording], effects: Mapping[str, Effect], vehicle: Vehicle | None
) -> Prepared:
    """Put everything a model may lack on it.

    Parameters
    ----------
    model : to be diagnosed, at its nominal values.
    recordings : of the vehicle.
    effects : what may be the cause, by name.
    vehicle : what is stated of it; a number stated without an sd is exact here. None: all beliefs of equations of
        motion count; priors of a map with memory do not, for these are about weights as they were before a fit.
    """
    nominal = _with_beliefs(model, recordings, effects, vehicle)
    everything, concerned = nominal, {}
    for name, effect in effects.items():
        if name in OF_VARIANCE or not (name in nominal.effects or effect.concerns(nominal)):
            continue
        concerned[name] = effect
        if name not in nominal.effects:
            everything = everything + effect.at(float(effect.parameter.array))
    if not concerned:
        raise BadInput(f"Nothing is known that {model.name} may lack: no effect acts on it.")
    return Prepared(nominal, _observed(everything, recordings), concerned)


def prepare_plain(
    model: Diagnosed, recordings: Sequence[Recording], effects: Mapping[str, Effect], vehicle: Vehicle | None
) -> Prepared:
    """The same without candidates, for a model that is not diagnosed any further."""
    nominal = _with_beliefs(model, recordings, effects, vehicle)
    return Prepared(nominal, _observed(nominal, recordings), {})


def _with_beliefs(
    model: Diagnosed, recordings: Sequence[Recording], effects: Mapping[str, Effect], vehicle: Vehicle | None
) -> Diagnosed:
    if vehicle is None and isinstance(model, MemoryModel):
        vehicle = Vehicle(model.name)
    nominal = model.with_parameters(*(_held(model, parameter, vehicle) for parameter in model.parameters))
    if vehicle is None:
        return nominal
    return with_roughness(with_tolerances(nominal, vehicle, effects), vehicle, _usual_speed(recordings))


def _usual_speed(recordings: Sequence[Recording]) -> float:
    """Median speed, m/s; 1 where nothing is driven."""
    speeds = [np.abs(own["v_x"][np.isfinite(own["v_x"])]) for own in recordings if "v_x" in own]
    found = float(np.median(np.concatenate(speeds))) if any(len(own) for own in speeds) else 0.0
    return found if found > 0 else 1.0


def _observed(model: Diagnosed, recordings: Sequence[Recording]) -> Diagnosed:
    if not isinstance(model, MotionModel):
        return model
    states = [state.name for state in model.states]
    for state, rate in OBSERVED.items():
        if state in states and state in model.outputs and all(state in own for own in recordings):
            model = observed(model, state, rate)
    return model


def _held(model: Diagnosed, parameter: Parameter, vehicle: Vehicle | None) -> Parameter:
    """A parameter, held unless something is believed of it: an effect of the model is as it stands."""
    if vehicle is None:
        return replace(parameter, fixed=parameter.fixed or parameter.prior is None)
    stated = vehicle.values.get(parameter.name)
    if stated is None or stated.sd is None:
        return replace(parameter, fixed=True)
    value = float(parameter.array) if stated.value is None else stated.value
    return replace(parameter, value=value, prior=Prior(stated.sd, mean=value), fixed=False)
