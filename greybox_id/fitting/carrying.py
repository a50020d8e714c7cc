"""Do parameters carry over: the fit on a recording it has not seen, beside the same model fitted to that recording.

Errors on held-out data alone do not say whether a fit is as good as its model can be: one that was found on a straight
road may beat every baseline on a winding one, and be far from what the model can do there.
"""

from __future__ import annotations

from ..base.errors import BadInput
from ..base.numbers import number
from ..datasets.recording import Recording
from ..engine.motion.simulator import Simulator
from ..models.motion_model import MotionModel
from .attempt import refitted
from .fit import Fit
from .how import FitOptions
from .scores.motion import score_motion
from .scores.verdict import times_as_large
from .verdict import WITH_CARE, Reason

HORIZONS = (0.5, 1.0, 2.0)
AHEAD = 1.0
"""Horizon, s, over which the model is fitted to the held-out recording: fast, and hardly any start is too far off."""
MOST_ROWS = 6000
"""Of a held-out recording, its first rows are enough."""
LESS = 1.35
"""Errors so many times those of the refitted model are more than refitting gains by chance, which is a few percent: a
model has ten parameters, a recording hundreds of independent readings. Less than the 1.5 of the best known that a
usable fit must not exceed, since the best known need not be found."""


def carries_over(model: MotionModel, fit: Fit, recording: Recording, name: str = "") -> list[Reason]:
    """See `judging.carried`."""
    if all(p.fixed for p in model.parameters):
        return []
    part = recording if len(recording) <= MOST_ROWS else recording.rows(0, MOST_ROWS)
    simulator, best = Simulator(model), float("nan")
    before = {n: v for n, v in fit.how.get("unfitted", {}).items() if n in model}
    unfitted = model.with_parameters(*(model[n].with_value(v) for n, v in before.items()))
    value = score_motion(simulator, part, model.values, HORIZONS)
    how = FitOptions(solver="gauss-newton", horizon=AHEAD, start_from="measured")
    for start in (model.values, unfitted.values):
        try:
            p = refitted(simulator, [part], start, how)
        except BadInput:  # no row to begin from: nothing can be said
            continue
        if p is not None:
            ratio = times_as_large(value, score_motion(simulator, part, p, HORIZONS))
            best = ratio if not best >= ratio else best
    if not best > LESS:
        return []
    what = f"On {name}" if name else "Held out"
    return [
        Reason(
            WITH_CARE,
            f"{what}, errors are {number(best, 2)} times those of the same model fitted to that recording: the "
            "parameters do not carry over.",
        )
    ]
