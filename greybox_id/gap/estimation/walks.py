"""Two searches by steps of different lengths: causes count as far as both agree about them.

The evidence has many optima where a vehicle is far from its stated parameters. What two such walks disagree about then
depends on the path of the search: a cause on which they differ must gain, on top of its price, the difference of the
walks' log evidences. That is zero where they end in the same place.
"""

from __future__ import annotations

import numpy as np

from ...base.shorthands import Array, Mask
from .calibration import CAL
from .together import JointSearch, JointStage


def walked(search: JointSearch) -> tuple[JointStage, Array]:
    """The better end of one walk or two, and the log-likelihood that disputed causes must gain in addition.

    The second walk is started where the first one moved tolerances away from their stated values: if these are right,
    the sum of squared deviations in standard deviations is about the number of tolerances.

    Returns
    -------
    stage : the end of the walk with more evidence.
    disputed : (causes,) log-likelihood; zero for causes that both walks have at one size, or neither has.
    """
    first, *others = CAL.strides
    ends = [_end(search, first)]
    if _far_off(search, ends[0]):
        ends += [_end(search, stride) for stride in others]
    best, *rest = sorted(ends, key=lambda stage: -stage.evidence)
    search.problem.set_error_scale(best.error_scale)
    search.problem.forget()
    disputed = np.zeros(len(best.included))
    for other in rest:
        apart = best.evidence - other.evidence
        disputed[~_of_one_size(best, other, search.problem.null)] += apart if np.isfinite(apart) else 0.0
    return best, disputed


def _end(search: JointSearch, stride: float) -> JointStage:
    return max(search.by_steps(stride).annealed(), key=lambda stage: stage.evidence)


def _far_off(search: JointSearch, stage: JointStage) -> bool:
    """Whether tolerances are, together, further from their stated values than their number of degrees of freedom."""
    problem = search.problem
    problem.set_error_scale(stage.error_scale)
    off = (stage.state.theta - problem.theta_mean) / problem.theta_sd
    return float(off @ off) > len(off)


def _of_one_size(one: JointStage, other: JointStage, null: Array) -> Mask:
    """(causes,) whether two stages have a cause at one size, or neither has it.

    Sizes are one within their sds, or within what a magnitude may differ between parts of a drive.
    """
    (at, sd), (elsewhere, its_sd) = (stage.sets.sizes(stage.included) for stage in (one, other))
    open_to = np.maximum(
        CAL.tolerated_sd * np.hypot(sd, its_sd), CAL.varies_inexact * np.abs(0.5 * (at + elsewhere) - null)
    )
    same = np.abs(at - elsewhere) <= open_to
    return np.asarray(np.where(one.included & other.included, same, one.included == other.included), dtype=bool)
