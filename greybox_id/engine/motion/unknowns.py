"""The unknowns of fitting a motion model: parameters first, then each interval's free starts.

Free starts are deviations: of measured states from their readings, and of states with a guessed start from the model's
guess.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ...base.shorthands import Array, Index, Mask
from ...models.motion_model import MotionModel
from ..least_squares import Layout, lay_out, limits, prior_system
from .schedule import MotionRun


@dataclass(frozen=True)
class Unknowns:
    """Places, bounds and priors of the unknowns.

    Attributes
    ----------
    parameters : per run, places of its parameters.
    loose : states with a free start.
    layout : per interval, places of its parameters and its free starts.
    bounds, free, R, r : as in `LeastSquares`.
    stated : arguments that determine the layout: whether starts are free, and the strengths.
    """

    parameters: Layout
    loose: Index
    layout: Layout
    bounds: tuple[Array, Array]
    free: Mask
    R: sp.csr_matrix
    r: Array
    stated: tuple[bool, dict[str, float]]


def lay_out_unknowns(
    model: MotionModel,
    runs: Sequence[MotionRun],
    run_of: Index,
    free_starts: bool,
    strengths: Mapping[str, float] | None,
    known: Unknowns | None = None,
) -> Unknowns:
    """Lay out the unknowns of some runs.

    Parameters
    ----------
    model, runs : the model and its runs.
    run_of : (intervals,) the run of each interval.
    free_starts : whether intervals start freely.
    strengths : factor by which each group of priors is tightened beyond its stated strength.
    known : unknowns of the same model, runs and intervals, reused if the other arguments are the same.
    """
    stated = (free_starts, dict(strengths or {}))
    if known is not None and known.stated == stated:
        return known
    parameters = lay_out(model, len(runs), len(runs))
    read, size = [run.states_read(model) for run in runs], parameters.size
    free_states = [k for k, s in enumerate(model.states) if callable(s.start) or any(s.name in names for names in read)]
    loose: Index = np.array(free_states if free_starts else [], dtype=np.intp)
    places = size + np.arange(len(run_of) * len(loose)).reshape(len(run_of), -1)
    index = np.concatenate((np.asarray(parameters.index)[run_of], places), axis=1).astype(np.intp)
    count_of_starts = places.size
    layout = Layout(tuple(index), size + count_of_starts)
    (low, high), free = limits(model, parameters)
    bounds = (np.append(low, np.full(count_of_starts, -np.inf)), np.append(high, np.full(count_of_starts, np.inf)))
    R, r = prior_system(model, replace(parameters, size=layout.size), len(runs), strengths)
    guessed = [  # deviations of states without a reading get a prior
        (place[j], 1.0 / model.states[state].scale)
        for j, state in enumerate(loose)
        for run, names in enumerate(read)
        if model.states[state].name not in names
        for place in places[run_of == run]
    ]
    if guessed:
        at, weights = np.array([a for a, _ in guessed]), np.array([b for _, b in guessed])
        rows = sp.csr_matrix((weights, (np.arange(len(guessed)), at)), shape=(len(guessed), layout.size))
        R, r = sp.vstack([R, rows], format="csr"), np.append(r, np.zeros(len(guessed)))
    return Unknowns(
        parameters, loose, layout, bounds, np.append(free, np.ones(count_of_starts, dtype=bool)), R, r, stated
    )
