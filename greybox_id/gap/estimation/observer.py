"""A weak observer: a simulated state is drawn slowly towards its reading.

Speed is the integral of all forces before: a simulation of two minutes drifts away from a vehicle that is a little
heavier, and then takes corners differently. Drawn towards the reading at a rate far below that of the motion, it stays
on the vehicle's path, and the error by which it is drawn shows in the residuals.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType, SimpleNamespace

import numpy as np

from ...datasets.recording import Recording
from ...models.model import Symbol
from ...models.motion_model import MotionModel, Quantities, Shift
from ...models.parameter import Parameter

SEEN = "{}_seen"
"""Name of the input that carries the reading."""
PULLED = "observer_{}"
"""Name of the parameter that is the observer's rate."""


def observed(model: MotionModel, state: str, rate: float) -> MotionModel:
    """The model with an observer of one state: it corrects by the prediction error after sensors and latencies.

    Parameters
    ----------
    model : with all its effects: the observer does not account for sensors and latencies that are added later.
    state : a state that is an output.
    rate : 1/s, of the observer's correction; a parameter of the model from then on.
    """
    seen = SEEN.format(state)

    def corrected(q: Quantities) -> Mapping[str, Symbol]:
        read = SimpleNamespace(**{name: getattr(q.x, name, getattr(q, name, None)) for name in model.outputs})
        for sensor in model.sensors:
            vars(read).update(sensor(read, q))
        pull = getattr(q.p, parameter.name) * (getattr(q.u, seen) - getattr(read, state))
        return {state: getattr(q.rates, state) + pull}

    parameter = Parameter(
        PULLED.format(state), "1/s", rate, (0.0, np.inf), fixed=True, about=f"rate of an observer of {state}"
    )
    late = tuple((seen, _ahead(by)) for name, by in model.latencies if name == state)
    return replace(
        model.with_parameters(parameter),
        inputs=(*model.inputs, seen),
        delays=(*model.delays, *late),
        extra_rates=(*model.extra_rates, corrected),
        aliases=MappingProxyType({**model.aliases, seen: (seen,)}),
    )


def with_seen(recording: Recording, state: str) -> Recording:
    """The recording with the observer's input: the reading, interpolated linearly between rows that have one."""
    reading = recording[state]
    filled = np.array(reading)
    for start, stop in recording.runs:
        rows = slice(start, stop)
        there = np.isfinite(reading[rows])
        if np.any(there):
            filled[rows] = np.interp(recording.time[rows], recording.time[rows][there], reading[rows][there])
    return recording.with_signals(**{SEEN.format(state): filled})


def _ahead(by: Shift) -> Shift:
    return lambda p: -by(p)
