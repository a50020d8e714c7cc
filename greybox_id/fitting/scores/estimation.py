"""Reasons of a verdict from how a fit was estimated: optimum, bounds, stated values and priors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...base.numbers import listed, number
from ...models.hybrid_model import HybridModel
from ...models.motion_model import MotionModel
from ...models.parameter import Parameter
from ..fit import NOT_USABLE, SURPRISING, UNDETERMINED, USABLE, WITH_CARE, Fit, Reason, conflict
from ..provenance import Stage
from .misfit import foreign_form

FOREIGN_PRIOR, FARTHEST = 8.0, 10.0
"""Distance of an estimate from its prior mean, in prior standard deviations, that means another vehicle: the first if
it is also three of its own standard deviations, the second in any case. Within tolerances, model errors move estimates
by up to six."""
ANOTHER = 0.14
"""Relative change of a wheelbase or a steering ratio that means another vehicle: twice as far as model errors moved
true wheelbases (`uncertainty/stated.py`)."""
CORNER = 0.5
"""Share of free parameters at bounds above which an optimum is a corner, not a vehicle's."""
ALIKE = 0.01
"""Relative difference of objectives within which two starts count as having the same optimum."""


def estimation(fit: Fit) -> Iterator[Reason]:
    """Reasons from the estimation: optimum, starts, bounds, stated values and priors."""
    free = [p for p in fit.model.parameters if not p.fixed]
    scalars = [p for p in free if p.shape == ()]
    if not all(np.all(np.isfinite(p.array)) for p in free):
        yield Reason(NOT_USABLE, "An estimate is not a finite number.")
    for stage in fit.stages[-1:]:
        yield from _optimum(fit, stage)
    yield from _at_bounds(fit, scalars)
    yield from _undetermined(fit, scalars)
    yield from _steps(fit)
    yield from _facts(fit)
    yield from _prior_conflicts(fit, scalars)


def _moved(fit: Fit) -> bool:
    """Whether any parameter changed in the fit: after short horizons, the last solve may need no step."""
    before = fit.how.get("unfitted", {})
    return any(not np.isclose(float(fit.model[name].array), item, rtol=1e-9, atol=0.0) for name, item in before.items())


def _optimum(fit: Fit, stage: Stage) -> Iterator[Reason]:
    """Reasons from the optimum, and from the starting points that led to it."""
    if stage.steps == 0 and not stage.confirmed and not _moved(fit):
        yield Reason(NOT_USABLE, "The solver took no step and no optimum is confirmed: nothing was estimated.")
    elif "interrupted" in stage.status:
        yield Reason(WITH_CARE, "The fit was interrupted; there are no intervals.")
    elif not stage.confirmed and isinstance(fit.model, MotionModel):
        yield Reason(WITH_CARE, f"The optimum is not confirmed ({stage.status}); there are no intervals.")
    elif stage.certificate is None and fit.how.get("solver") == "gauss-newton":
        yield Reason(WITH_CARE, "Ipopt was not asked to confirm the optimum (the solver auto does this).")
    elif stage.confirmed and isinstance(fit.model, HybridModel):
        yield Reason(USABLE, "Training stopped where the held-out error was smallest.")
    elif stage.confirmed:
        yield Reason(USABLE, "The optimum is confirmed.")
    if len(stage.starts) > 2:
        best = min(stage.starts)
        alike = sum(start <= best + ALIKE * abs(best) for start in stage.starts)
        if alike < 0.5 * len(stage.starts):
            yield Reason(WITH_CARE, f"Only {alike} of {len(stage.starts)} starting points led to the best optimum.")


def _at_bounds(fit: Fit, scalars: Sequence[Parameter]) -> Iterator[Reason]:
    """A reason if estimates are at bounds; effects may be."""
    bound = [p.name for p in scalars if not p.bounds[0] < float(p.array) < p.bounds[1]]
    bound = [name for name in bound if name not in fit.model.effects]
    if not bound:
        return
    text = f"{listed(bound)} {'is at a bound' if len(bound) == 1 else 'are at bounds'}"
    if len(scalars) > 2 and len(bound) > CORNER * len(scalars):
        yield Reason(NOT_USABLE, f"{text}: more than half of the estimates follow the bounds, not the data.")
    else:
        yield Reason(WITH_CARE, f"{text}.")


def _undetermined(fit: Fit, scalars: Sequence[Parameter]) -> Iterator[Reason]:
    """A reason if no estimate is determined, by readings or priors."""
    known = all(p.name in fit.sd for p in scalars)
    if not scalars or not known or len(fit.from_prior) < sum(p.prior is not None for p in scalars) or foreign_form(fit):
        return
    if not any(float(np.max(fit.sd[p.name])) < UNDETERMINED * abs(float(p.array)) for p in scalars):
        yield Reason(NOT_USABLE, f"The recording determines none of the {len(scalars)} estimates.")


def _prior_conflicts(fit: Fit, scalars: Sequence[Parameter]) -> Iterator[Reason]:
    """A reason if estimates are far from their priors."""
    conflicting, foreign, wider = [], False, conflict(fit.model)
    for p in scalars:
        if p.prior is not None and p.prior.mean is not None:
            off = abs(float(p.array) - float(np.asarray(p.prior.mean)))
            away, sd = off / float(np.max(np.asarray(p.prior.sd))), float(fit.sd.get(p.name, np.nan)) / wider
            if away > SURPRISING:
                conflicting.append((away, p.name))
            foreign = foreign or away > FARTHEST or (away > FOREIGN_PRIOR and not off < SURPRISING * sd)
    if not conflicting:
        return
    conflicting.sort(reverse=True)
    text = listed([f"{name} by {number(away, 2)} sd of the prior" for away, name in conflicting])
    wide = [name for _, name in conflicting if name in fit.from_prior]
    both = (
        f" Model errors widen the interval{'s' if wide[1:] else ''} of {listed(wide)}, hence the low precision."
        if wide
        else ""
    )
    yield Reason(
        NOT_USABLE if foreign else WITH_CARE,
        f"Estimates conflict with their priors: {text}. The data may be of another vehicle than stated, or the "
        f"model structure is wrong.{both}",
    )


def _steps(fit: Fit) -> Iterator[Reason]:
    """A reason if an effect that rounds an input may as well be absent."""
    rounded = fit.model.rounded if isinstance(fit.model, MotionModel) else {}
    sizes = [(name, fit.model[name], fit.interval(name)) for name in rounded if name in fit.sd]
    none = [name for name, p, (low, high) in sizes if p.null is not None and low <= p.null <= high]
    if none:
        yield Reason(
            WITH_CARE,
            f"The recording does not determine {listed(none)}: predictions without it are equally good, within chance.",
        )


def _facts(fit: Fit) -> Iterator[Reason]:
    """Reasons from stated values that the recording contradicts."""
    for name, (change, sd) in fit.how.get("contradicted", {}).items():
        other = "the steering ratio is not the stated one, or " if name == "wheelbase" else ""
        size = f"{number(100 * abs(change), 2)} ± {number(100 * sd, 2)} % {'larger' if change > 0 else 'smaller'}"
        yield Reason(
            NOT_USABLE if name != "m" and abs(change) > ANOTHER else WITH_CARE,
            f"The recording contradicts the stated {name}: a value {size} explains the recording better. "
            f"Check the stated value. If it is right, {other}the model lacks an effect.",
        )
