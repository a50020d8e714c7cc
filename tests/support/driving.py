"""Drive a motion model over commands, segment by segment: a plain free run that effects are examined with."""

from dataclasses import replace

import numpy as np

from greybox_id.engine.kernel import Kernel
from greybox_id.engine.motion.trace import MotionTrace


def on_vehicle(model, vehicle):
    """The model with the parameters of a vehicle, those it has."""
    return model.with_parameters(*(model[name].with_value(value) for name, value in vehicle.items() if name in model))


def driven(model, commands, start, hold="zero", longest=np.inf):
    """Outputs of a model from true states at the first row: name -> (n,) as the sensors read them.

    Commands are time and inputs by name; `longest` is the longest segment [s].
    """
    trace, p = MotionTrace(model), model.values
    time = np.asarray(commands["time"], float)
    shift = np.asarray(trace.timing(p)).ravel()
    delay = {name: shift[k] for k, name in enumerate(trace.delayed)}
    latency = {name: shift[len(delay) + k] for k, name in enumerate(trace.late)}
    when = {name: np.maximum(time - latency.get(name, 0.0), time[0]) for name in model.outputs}

    parts = max(1, int(np.ceil(np.max(np.diff(time)) / longest - 1e-9)))
    between = [time[:-1] + np.diff(time) * k / parts for k in range(1, parts)]
    events = np.unique(np.concatenate([time, *between, *(time + by for by in delay.values()), *when.values()]))
    events = events[(events >= time[0]) & (events <= time[-1])]
    events = events[np.diff(events, prepend=-np.inf) > 1e-9]
    lengths = np.append(np.diff(events), 0.0)
    values = np.zeros((len(events), len(model.inputs)))
    slopes = np.zeros_like(values)
    for k, name in enumerate(model.inputs):
        own, given = time + delay.get(name, 0.0), np.asarray(commands[name], float)
        if name in model.commands and hold == "zero":
            values[:, k] = given[np.maximum(np.searchsorted(own, events + 1e-9, side="right") - 1, 0)]
        else:
            values[:, k] = np.interp(events, own, given)
            slopes[:-1, k] = np.diff(values[:, k]) / lengths[:-1]
    still = np.zeros((len(events), 2 * len(shift)))
    segments = np.column_stack([lengths, values, slopes, still, np.broadcast_to(shift, (len(events), len(shift)))])

    z = np.asarray(trace.start(tuple(start), tuple(start))(list(start.values()), values[0], p)).ravel()
    kernel = Kernel(trace.step, trace.output, compiled=False)
    _, read = kernel.simulate(z[None], segments[None], p, np.ones(len(events), dtype=bool))
    found = {name: np.searchsorted(events, when[name] + 1e-9, side="right") - 1 for name in model.outputs}
    return {name: read[0, found[name], k] for k, name in enumerate(model.outputs)}


def read(model, names, states, inputs, **parameters):
    """Readings and quantities of a model by name, just after inputs have been applied; other states are zero."""
    model = replace(model, outputs=tuple(names), latencies=())
    model = model.with_parameters(*(model[name].with_value(value) for name, value in parameters.items()))
    trace = MotionTrace(model)
    z = [states.get(state.name, 0.0) for state in model.states]
    z += [inputs[actuator.signal] for actuator in model.actuators] + [0.0 for _ in model.relaxations]
    segment = np.concatenate([[0.01], [inputs[name] for name in model.inputs], np.zeros(len(model.inputs))])
    shifts = np.asarray(trace.timing(model.values)).ravel()
    segment = np.concatenate([segment, np.zeros(2 * len(shifts)), shifts])
    return dict(zip(names, np.asarray(trace.output(z, segment, model.values)).ravel(), strict=True))
