"""The verdict: how good a fit is, against what, and how it was chosen, in three sentences that hold for any numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...fit import Fit
from ...scores.metrics import Protocol
from ...signals import unit_of
from ..content import circumstances
from ..convergence import ended, ipopt_words
from ..numbers import listed, number, percent, pretty_unit, signal_words, with_sd
from ..recordings import Seen, of_role
from .seen import memory_model

EARLY = "early stopping"


@dataclass(frozen=True)
class Yardstick:
    """What one output's error can be held against, on one role's recordings.

    Attributes
    ----------
    held : RMSE of holding the last measured value for one sample, in the output's unit.
    held_fvu : its fraction of variance unexplained.
    """

    held: float
    held_fvu: float


def yardsticks(fit: Fit, recordings: Sequence[Seen]) -> dict[str, dict[str, Yardstick]]:
    """Role -> output -> what its error can be held against."""
    found: dict[str, dict[str, Yardstick]] = {}
    for role in dict.fromkeys(one.role for one in recordings):
        found[role] = {}
        for k, name in enumerate(fit.model.outputs):
            steps, values = [], []
            for one in of_role(recordings, role):
                scored = one.predicted["honest"]
                values.append(scored.measured[:, k])
                steps.append(one.recording[name][scored.rows] - one.recording[name][scored.rows - 1])
            moved, variance = np.concatenate(steps), float(np.var(np.concatenate(values)))
            fvu = float(np.var(moved)) / variance if variance > 0 else float("nan")
            found[role][name] = Yardstick(float(np.sqrt(np.mean(moved**2))), fvu)
    return found


def verdict(fit: Fit, recordings: Sequence[Seen], measures: Mapping[str, Mapping[str, Yardstick]]) -> tuple[str, ...]:
    """Three sentences: how good, against what, how chosen."""
    role = "validate" if "validate" in fit.metrics else "train"
    return _how_good(fit, recordings, role), _against_what(fit, role, measures[role]), _how_chosen(fit)


def main_protocol(fit: Fit) -> Protocol:
    """The protocol a fit is judged by: on its own predictions where the model has a loop."""
    return "closed_loop" if memory_model(fit).feedback is not None else "honest"


def _how_good(fit: Fit, recordings: Sequence[Seen], role: str) -> str:
    scores = fit.metrics[role][main_protocol(fit)]
    where = circumstances(fit, recordings, role, chose="when to stop" if fit.mode == EARLY else "")
    how = "running on its own predictions" if main_protocol(fit) == "closed_loop" else "one sample ahead"
    each = [
        f"{with_sd(e['rmse'], e['rmse_sd'])} {pretty_unit(unit_of(name))} in {signal_words(name)} ({_unexplained(e)})"
        for name, e in scores.items()
    ]
    return f"{where}, {fit.model.name} errs, {how}, by an RMSE of {listed(each)}."


def _unexplained(error: Mapping[str, float]) -> str:
    fvu = error["fvu"]
    if not np.isfinite(fvu):
        return "a signal that does not vary"
    if fvu >= 1.0:
        return f"{percent(fvu)} of the variance: no better than the signal's mean"
    return f"{percent(fvu)} of the variance unexplained"


def _against_what(fit: Fit, role: str, measures: Mapping[str, Yardstick]) -> str:
    held = [
        f"{_factor(fit.metrics[role]['honest'][name]['rmse'], measure.held)} in {signal_words(name)}"
        for name, measure in measures.items()
    ]
    text = (
        "One sample ahead on measured inputs, the ratio of its error to that of holding the last measured value is "
        f"{listed(held)} (below 1 the model is better)"
    )
    if role == "train":
        return f"{text}; how the error grows on a recording it has not seen is not known."
    protocol = main_protocol(fit)
    own = "on its own predictions" if protocol == "closed_loop" else "one sample ahead"
    grown = [
        f"{_factor(error['rmse'], fit.metrics['train'][protocol][name]['rmse'])} in {signal_words(name)}"
        for name, error in fit.metrics[role][protocol].items()
    ]
    return f"{text}; {own}, the ratio of its error to that on the training data is {listed(grown)}."


def _factor(value: float, reference: float) -> str:
    return number(value / reference, 3) if reference > 0 else "infinite"


def _how_chosen(fit: Fit) -> str:
    last = fit.stages[-1]
    strength = {
        "cross-validation": "chosen by blocked cross-validation on the training data",
        EARLY: "left weak and fitting stopped where the error on the validation recording was least",
        "given": "given, not chosen by the data",
    }.get(fit.mode, fit.mode)
    return f"The strength of regularisation was {strength}; {ended(last)}, and {ipopt_words(last)}."
