"""States along a recording: those that are read as they are read, the others as the model carries them there."""

from __future__ import annotations

import numpy as np

from ...parameter import Array
from .runs import MotionRun
from .schedule import Schedule
from .simulator import Simulator


def observed(simulator: Simulator, run: MotionRun, plan: Schedule, p: Array) -> Array:
    """(n, nz) states at every row, after the model was run along a recording and set back to every reading.

    It is set back where all states that are read at all have a reading, and begins at their first ones.

    Parameters
    ----------
    simulator : the model.
    run : the run.
    plan : its segments.
    p : (parameters,).
    """
    model = simulator.trace.model
    names = run.states_read(model)
    states = [simulator.trace.names.index(name) for name in names]
    readings = run.measured[:, [model.outputs.index(name) for name in names]]
    complete = np.all(np.isfinite(readings), axis=1)
    first = [own[np.isfinite(own)][0] for own in readings.T]
    given = np.where(complete[:, None], readings, first)
    corrected, _ = simulator.start(names, given, run.inputs, p)
    z = corrected.copy()
    starts = plan.row_segment
    carries = len(states) < z.shape[1]
    stops = np.union1d(np.flatnonzero(complete[1:]) + 1, len(run) - 1)
    simulated, last = simulator.kernel.along(plan.segments, p), 0
    with np.errstate(all="ignore"):
        for row in stops:
            if carries or row > last + 1 or not complete[row]:
                begin = int(starts[last])
                found = simulated(z[last], begin, int(starts[row]))
                z[last + 1 : row + 1] = found[starts[last + 1 : row + 1] - begin]
                if complete[row]:
                    z[row, states] = corrected[row, states]
            last = row
    return z
