"""Two walks through everything at once: what a search finds counts as far as another one finds it, too.

The evidence has many optima where a vehicle is far from what is stated of it. What two walks with steps of other
lengths disagree about is then decided by where a search happened to go: a cause that is not alike in both must gain, on
top of its price, what the walks' evidences differ by. Where they end in the same place that is nothing.
"""

from __future__ import annotations

import numpy as np

from ...base.shorthands import Array, Mask
from .calibration import CAL
from .together import JointSearch, JointStage


def walked(search: JointSearch) -> tuple[JointStage, Array]:
    """The better end of one walk or two, and what causes must gain more since the walks disagree.

    A second one starts where the first one left what is stated: numbers that are as they are believed to be are in all
    as many squared standard deviations off as there are of them.

    Returns
    -------
    stage : the stage of either walk that explains best.
    disputed : (causes,) log-likelihood, zero for causes that both walks have alike, or neither has.
    """
    first, *others = CAL.strides
    ends = [_end(search, first)]
    if _far_off(search, ends[0]):
        ends += [_end(search, stride) for stride in others]
    best, *rest = sorted(ends, key=lambda stage: -stage.evidence)
    search.problem.roughly(best.rough)
    search.problem.forget()
    disputed = np.zeros(len(best.there))
    for other in rest:
        apart = best.evidence - other.evidence
        disputed[~_of_one_size(best, other, search.problem.null)] += apart if np.isfinite(apart) else 0.0
    return best, disputed


def _end(search: JointSearch, stride: float) -> JointStage:
    return max(search.by_steps(stride).annealed(), key=lambda stage: stage.evidence)


def _far_off(search: JointSearch, stage: JointStage) -> bool:
    """Whether tolerances are, together, further from what is stated than it says."""
    problem = search.problem
    problem.roughly(stage.rough)
    off = (stage.state.theta - problem.theta_mean) / problem.theta_sd
    return float(off @ off) > len(off)


def _of_one_size(one: JointStage, other: JointStage, null: Array) -> Mask:
    """(causes,) whether two stages have a cause of one size, or neither has it.

    One size is what sds leave open, or what may differ between parts of one drive.
    """
    (at, sd), (elsewhere, its_sd) = (stage.sets.sizes(stage.there) for stage in (one, other))
    open_to = np.maximum(
        CAL.alike_in_both * np.hypot(sd, its_sd), CAL.varies_rough * np.abs(0.5 * (at + elsewhere) - null)
    )
    same = np.abs(at - elsewhere) <= open_to
    return np.asarray(np.where(one.there & other.there, same, one.there == other.there), dtype=bool)
