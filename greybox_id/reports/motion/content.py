"""What a report of equations of motion says."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...fit import Fit
from ...provenance import Stage
from ...signals import unit_of
from ...uncertainty.identifiability import absent, told_together
from ..content import ROLE_WORDS, Content, made_with, noise_words, recorded
from ..convergence import stages
from ..document import Table
from ..driven import Driven, Errors, held_errors, motion_model
from ..noise import Noise
from ..numbers import (
    counted,
    interval,
    number,
    percent,
    pretty_unit,
    quantity,
    raised,
    short_with_sd,
    signal_words,
    with_sd,
)
from ..parameters import scalars
from .verdict import verdict


@dataclass(frozen=True, kw_only=True)
class MotionContent(Content):
    """Everything a report of equations of motion says.

    Attributes
    ----------
    held : sentences on parameters that were not estimated.
    effects : their magnitudes; combinations : what is told together.
    open : sentences on what the recordings leave open.
    """

    held: tuple[str, ...]
    effects: Table
    combinations: Table
    open: tuple[str, ...]


def motion_content(fit: Fit, recordings: Sequence[Driven], noise: Noise | None) -> MotionContent:
    """What a report of a fit says.

    Parameters
    ----------
    fit : the fit.
    recordings : what it saw, with predictions.
    noise : where the sensors' noise can be heard, if anywhere.
    """
    model, held = motion_model(fit), held_errors(recordings)
    free = [p for p in model.parameters if not p.fixed and p.name not in model.effects]
    outputs = [name for name in model.outputs if any(name in one.outputs for one in recordings)]
    return MotionContent(
        model=model.name,
        about=model.about,
        verdict=verdict(fit, recordings, held),
        errors=_errors(fit, held),
        noise=noise_words(outputs, noise),
        recordings=recorded(fit),
        provenance=made_with(
            fit,
            ("solved over", _horizon(fit.how.get("horizon"))),
            ("starts of predictions", _starts_from(fit.how)),
            *_settings(model.settings),
            (
                "size",
                f"{counted(model.size, 'parameter')}, {sum(p.size for p in model.parameters if not p.fixed)} free",
            ),
        ),
        parameters=scalars(fit, free),
        held=_held(fit),
        effects=scalars(fit, [model[name] for name in model.effects], absent(fit)),
        combinations=_combinations(fit),
        open=tuple(_printed(sentence) for sentence in told_together(fit)),
        together=tuple(raised(sentence) for sentence in model.together),
        stages=stages(fit, lambda stage: _stage_name(stage, fit)),
    )


def _errors(fit: Fit, held: Mapping[str, Errors]) -> Table:
    """A row for each output of each role, and one for holding the last reading below it."""
    roles = [role for role in ROLE_WORDS if role in fit.metrics]
    protocols = list(dict.fromkeys(protocol for role in roles for protocol in fit.metrics[role]))
    noise = fit.stages[-1].noise
    head = ("output", "prediction", *(p.removesuffix(" ahead") for p in protocols))
    rows = []
    for name in fit.model.outputs:
        output = f"{signal_words(name)} [{pretty_unit(unit_of(name))}]"
        for role in roles:
            own = fit.metrics[role]
            if not any(name in of for of in own.values()):
                continue
            errors = [own.get(p, {}).get(name) for p in protocols]
            rows.append((output, f"model, {ROLE_WORDS[role]}", *(_rmse(error) for error in errors)))
            output = f"residual sd {number(noise[name], 2)}" if name in noise and role == roles[0] else ""
            still = [held[role].get(p, {}).get(name) for p in protocols]
            rows.append((output, f"held, {ROLE_WORDS[role]}", *(number(e.rmse) if e else "–" for e in still)))
            output = ""
    return Table(head, tuple(rows), "ll" + "R" * len(protocols))


def _rmse(error: Mapping[str, Any] | None) -> str:
    return "–" if error is None else short_with_sd(error["rmse"], error["rmse_sd"])


def _horizon(horizon: float | None) -> str:
    return "whole runs" if horizon is None else f"{horizon:g} s from each start"


def _starts_from(how: Mapping[str, Any]) -> str:
    words = {"free": "free to deviate from their readings", "measured": "at their readings"}
    robust = how.get("robust")
    loss = f"; residuals beyond {robust:g} standard deviations count linearly" if robust else ""
    return f"{words.get(how.get('start_from', ''), 'not recorded')}{loss}"


def _settings(settings: Mapping[str, object]) -> tuple[tuple[str, str], ...]:
    return tuple(
        (name.replace("_", " "), ("no", "yes")[value] if isinstance(value, bool) else str(value))
        for name, value in settings.items()
    )


def _stage_name(stage: Stage, fit: Fit) -> str:
    return f"{stage.model}, {_horizon(fit.how.get('horizon'))}"


def _held(fit: Fit) -> tuple[str, ...]:
    held = [p for p in fit.model.parameters if p.fixed and p.shape == () and p.name not in fit.model.effects]
    known = [f"{p.name} = {quantity(float(p.array), p.unit)}" for p in held if float(p.array)]
    nothing = [p.name for p in held if not float(p.array)]
    said = [f"Held: {', '.join(known)}."] if known else []
    return (*said, f"Held at zero: {', '.join(nothing)}.") if nothing else tuple(said)


def _printed(sentence: str) -> str:
    """A sentence with true minus signs and a space before percent signs."""
    return re.sub(r"(?<=\d)%", " %", re.sub(r"-(?=\d)", "−", sentence))


def _combinations(fit: Fit) -> Table:
    told = [one for one in fit.combined() if np.isfinite(one.sd) and one.sd > 0]
    rows = tuple(
        (
            one.name, one.about, with_sd(one.value, one.sd), interval(one.low, one.high, one.sd), pretty_unit(one.unit),
            percent(one.sd / abs(one.value)) if one.value else "–",
        )
        for one in told
    )  # fmt: skip
    return Table(("combination", "meaning", "estimate ± sd", "95 % interval", "unit", "sd"), rows, "lLrrlr")
