"""What a fit of a motion model is to find: parameters, and where predictions start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ...motion_model import MotionModel
from ...parameter import Array
from ..layout import Layout, beliefs, lay_out, limits
from .lanes import Interval
from .runs import Index, Mask, MotionRun


@dataclass(frozen=True)
class Unknowns:
    """The unknowns of a problem: parameters first, then each interval's free starts.

    Attributes
    ----------
    parameters : per run, where its parameters stand.
    layout : per interval, where its parameters and its free starts stand.
    loose : states that start freely, as deviations from their readings or from what the model says.
    bounds : (unknowns,) lowest and highest values.
    free : (unknowns,) whether an unknown moves.
    R, r : priors, residuals R x - r in standard deviations.
    """

    parameters: Layout
    layout: Layout
    loose: Index
    bounds: tuple[Array, Array]
    free: Mask
    R: sp.csr_matrix
    r: Array


def unknowns(
    model: MotionModel,
    runs: Sequence[MotionRun],
    intervals: Sequence[Interval],
    strengths: Mapping[str, float] | None,
    *,
    free_starts: bool,
) -> Unknowns:
    """Lay out the unknowns of a problem.

    Parameters
    ----------
    model : the model.
    runs : the recordings' runs.
    intervals : what is predicted from one start.
    strengths : how much stronger than stated each group of priors is taken.
    free_starts : whether starts are unknown: of states that are read, with noise, and of those whose start is a guess.
    """
    parameters = lay_out(model, len(runs), len(runs))
    read = [run.states_read(model) for run in runs]
    open_ones = [k for k, s in enumerate(model.states) if callable(s.start) or any(s.name in names for names in read)]
    loose = np.array(open_ones if free_starts else [], dtype=np.intp)
    own_starts = parameters.size + np.arange(len(intervals) * len(loose)).reshape(len(intervals), -1)
    index = tuple(
        np.concatenate((parameters.index[i.run], own)).astype(np.intp)
        for i, own in zip(intervals, own_starts, strict=True)
    )
    layout = Layout(index, parameters.size + len(loose) * len(intervals))
    (low, high), free = limits(model, parameters)
    more = layout.size - parameters.size
    bounds = (np.append(low, np.full(more, -np.inf)), np.append(high, np.full(more, np.inf)))
    R, r = beliefs(model, parameters, len(runs), strengths)
    R = sp.hstack([R, sp.csr_matrix((R.shape[0], more))], format="csr")
    guessed = [  # deviations that no reading tells
        (own[model.size + j], 1.0 / model.states[state].scale)
        for own, interval in zip(layout.index, intervals, strict=True)
        for j, state in enumerate(loose)
        if model.states[state].name not in read[interval.run]
    ]
    if guessed:
        places, weights = np.array([a for a, _ in guessed]), np.array([b for _, b in guessed])
        rows = sp.csr_matrix((weights, (np.arange(len(guessed)), places)), shape=(len(guessed), layout.size))
        R, r = sp.vstack([R, rows], format="csr"), np.append(r, np.zeros(len(guessed)))
    return Unknowns(parameters, layout, loose, bounds, np.append(free, np.ones(more, dtype=bool)), R, r)
