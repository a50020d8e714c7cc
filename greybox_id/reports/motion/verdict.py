"""The verdict on equations of motion in three sentences: how good, against what, how sure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...fit import SURPRISING, Fit
from ...parameter import Parameter
from ...scores.metrics import FREE_RUN, ahead
from ...signals import unit_of
from ...uncertainty.identifiability import left_open
from ..content import circumstances
from ..convergence import ended, ipopt_words
from ..driven import Driven, Errors
from ..figures.style import NEAR
from ..numbers import capital, counted, listed, number, pretty_unit, short_with_sd, signal_words

MOST_PAIRS = 3
"""Pairs of parameters identifiable only in combination that are named."""


def verdict(fit: Fit, recordings: Sequence[Driven], held: Mapping[str, Errors]) -> tuple[str, ...]:
    """Three sentences.

    Parameters
    ----------
    fit, recordings : the fit and what it saw.
    held : role -> errors of holding the last reading.
    """
    role = "validate" if "validate" in fit.metrics else "train"
    scores, near = fit.metrics[role], _near(fit.metrics[role])
    return (
        f"{circumstances(fit, recordings, role)}, {fit.model.name} errs {_how_good(scores, near)}.",
        f"{_against_hold(scores, held[role], near)}; {_against_noise(scores, fit.stages[-1].noise)}"
        f"{_against_training(fit) if role == 'validate' else ''}.",
        f"{capital(ended(fit.stages[-1]))}, and {ipopt_words(fit.stages[-1])}; {_not_determined(fit)}.",
    )


def _near(scores: Mapping[str, Any]) -> str | None:
    """The horizon to name beside the free run; None where runs are too short for any."""
    horizons = [protocol for protocol in scores if protocol != FREE_RUN]
    return ahead(NEAR) if ahead(NEAR) in horizons else next(reversed(horizons), None)


def _how_good(scores: Mapping[str, Any], near: str | None) -> str:
    each = []
    for name, error in scores[FREE_RUN].items():
        soon = scores[near].get(name) if near else None
        beside = f" ({short_with_sd(soon['rmse'], soon['rmse_sd'])})" if soon else ""
        whole = short_with_sd(error["rmse"], error["rmse_sd"])
        each.append(f"{whole}{beside} {pretty_unit(unit_of(name))} in {signal_words(name)}")
    return f"in free run{f' ({near})' if near else ''} by an RMSE of {listed(each)}"


def _against_hold(scores: Mapping[str, Any], held: Errors, near: str | None) -> str:
    protocol = near or FREE_RUN
    ratios = {
        name: _ratio(held[protocol][name].rmse, error["rmse"])
        for name, error in scores[protocol].items()
        if name in held.get(protocol, {})
    }
    what = f"for {protocol.removesuffix(' ahead')}" if near else "of a run's first row"
    return f"Holding the last reading {what} errs {_times(ratios, 'as much')}"


def _against_noise(scores: Mapping[str, Any], noise: Mapping[str, float]) -> str:
    ratios = {name: _ratio(error["rmse"], noise[name]) for name, error in scores[FREE_RUN].items() if name in noise}
    return f"in free run the error is {_times(ratios, 'the residuals of the fit')}"


def _against_training(fit: Fit) -> str:
    own, train = fit.metrics["validate"][FREE_RUN], fit.metrics["train"][FREE_RUN]
    ratios = {name: _ratio(own[name]["rmse"], train[name]["rmse"]) for name in own if name in train}
    return f", and {_times(ratios, 'that on the training data')}" if ratios else ""


def _times(ratios: Mapping[str, str], of: str) -> str:
    """1.6 times as much in v_x, 3.1 in yaw rate and 2.3 in a_y."""
    each = [
        f"{ratio}{f' times {of}' if k == 0 else ''} in {signal_words(name)}"
        for k, (name, ratio) in enumerate(ratios.items())
    ]
    return listed(each)


def _ratio(value: float, reference: float) -> str:
    return number(value / reference, 2) if reference > 0 else "infinite"


def _not_determined(fit: Fit) -> str:
    """What of the free parameters the recordings do not tell, as a clause."""
    free = [p for p in fit.model.parameters if p.shape == () and not p.fixed]
    if not free:
        return "no parameter was free"
    bound = [p.name for p in free if not p.bounds[0] < float(p.array) < p.bounds[1]]
    found = left_open(fit)
    if found is None:
        return "how well its parameters are determined is not known, as the fit kept no covariance"
    untold = [each.name for each in found.undetermined if each.name not in bound]
    pairs = [f"{pair.first} with {pair.second}" for pair in found.pairs[:MOST_PAIRS]]
    far = [p.name for p in free if _far(p)]
    clauses = [
        f"the recordings do not determine {listed(untold)}" if untold else "",
        f"they tell only together {listed(pairs)}" if pairs else "",
        f"{listed(bound)} {'lies' if len(bound) == 1 else 'lie'} at a bound" if bound else "",
        f"{listed(far)} {'lies' if len(far) == 1 else 'lie'} far from their priors" if far else "",
    ]
    said = [clause for clause in clauses if clause]
    if not said:
        return f"{'each of the ' if len(free) > 1 else 'its '}{counted(len(free), 'free parameter')} is determined"
    return f"of {counted(len(free), 'free parameter')}, {'; '.join(said)}"


def _far(parameter: Parameter) -> bool:
    prior = parameter.prior
    if prior is None or prior.mean is None:
        return False
    away = abs(float(parameter.array) - float(np.asarray(prior.mean)))
    return away > SURPRISING * float(np.asarray(prior.sd))
