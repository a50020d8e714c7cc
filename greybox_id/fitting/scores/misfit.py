"""Reasons against a fit from its residuals: too short, nothing moved, nothing explained, or model-form error.

`fitting/uncertainty/form.py` measures these; this module puts them in sentences.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ...base.errors import BadInput
from ...base.numbers import listed, number, quantity
from ...base.signals import unit_of
from ...datasets.checks.drive import FEWEST_ROWS, MOVES, SHORTEST, moves
from ...datasets.recording import Recording
from ...models.model import Model
from ...models.motion_model import MotionModel
from ..fit import CLEARLY, EIGHTHS, NOT_USABLE, USABLE, WITH_CARE, Fit, Reason

TRAINED = "train"
UNEXPLAINED = 0.5
"""Unexplained share of an output's variance, noise removed, beyond which half of the outputs disqualify a fit."""
OF_FORM, DOUBTFUL, FOREIGN_FORM = 0.1, 0.13, 0.2
"""Model-form error over an output's spread that is reported, that suggests another vehicle, and that disqualifies a
fit: good fits of vehicles within tolerances, with other tyres and with delays of milliseconds, have up to 0.13 (median
0.08)."""
TIMES_NOISE = 5.0
"""Ratio of residuals to their noise that is reported if functions of the drive explain most of them."""
ALSO = 0.25
"""Share of the strongest explanation that a second one must reach to be named."""
SMALL_HALVES = 0.01
"""Smallest error, over the spread, explained by other parameters in the second half that is reported."""


def must_tell(model: Model, recordings: Sequence[Recording]) -> None:
    """Raise `BadInput` if recordings cannot support a fit of equations of motion: they are too short, or nothing moves.

    Parameters
    ----------
    model : the model to fit; one with memory counts its windows itself.
    recordings : training data.
    """
    if not isinstance(model, MotionModel):
        return
    names = listed(list(dict.fromkeys(recording.name for recording in recordings)))
    rows, seconds = sum(len(one) for one in recordings), sum(one.duration for one in recordings)
    if rows < FEWEST_ROWS or seconds < SHORTEST:
        raise BadInput(
            f"{names}: {rows} rows ({number(seconds, 2)} s) are too few for a fit of {model.name}: its "
            f"intervals need {FEWEST_ROWS} rows and {SHORTEST:g} s. Record more."
        )
    outputs = {
        name: [one[name][start:stop] for one in recordings if one.has(name) for start, stop in one.runs]
        for name in model.outputs
    }
    outputs = {name: parts for name, parts in outputs.items() if any(np.isfinite(part).any() for part in parts)}
    if outputs and not any(moves(parts) for parts in outputs.values()):
        raise BadInput(
            f"{names}: nothing moves. {listed(list(outputs))} contain only noise, so {model.name} cannot be fitted. "
            f"Record a drive that excites them."
        )


def misfit(fit: Fit) -> Iterator[Reason]:
    """Reasons against a fit of equations of motion; residuals are compared with the stated noise, if any."""
    if not isinstance(fit.model, MotionModel) or "imported" in fit.how:
        return
    yield from _short(fit)
    if stood := fit.how.get("stood"):
        yield Reason(
            USABLE,
            f"{quantity(stood, 's', 2)} in which the vehicle stood still with its brake on were left out of the fit.",
        )
    form: Mapping[str, Any] = fit.how.get("form", {})
    outputs: Mapping[str, Mapping[str, Any]] = form.get("outputs", {})
    if not outputs:
        return
    moving = {
        name: one for name, one in outputs.items() if one["spread"] > 0 and not one["spread"] < MOVES * one["noise"]
    }
    if not moving:
        yield Reason(
            NOT_USABLE,
            f"Nothing moves: {listed(list(outputs))} contain only noise. Record a drive that excites them.",
        )
        return
    unknown = [name for name, one in moving.items() if _unexplained(one) > UNEXPLAINED]
    if unknown and len(unknown) >= 0.5 * len(moving):
        shares = [f"{100 * min(_unexplained(moving[name]), 1.0):.0f} % of the variance of {name}" for name in unknown]
        yield Reason(
            NOT_USABLE,
            f"Noise aside, the fit leaves unexplained {listed(shares)}. Either an input is missing that moves the "
            "vehicle, or the inputs are of another vehicle. See greybox data check.",
        )
    worst = max(moving, key=lambda name: _of_form(moving[name]))
    halves = list(_of_halves(form, _of_form(moving[worst])))
    drive = list(_dependence(worst, moving[worst], fit.how.get("sensors", {})))
    explained_by_drive = max(moving[worst]["on"].values(), default=0.0)
    yield from (*drive, *halves) if explained_by_drive > form.get("halves", 0.0) else (*halves, *drive)


def foreign_form(fit: Fit) -> bool:
    """Whether model-form error disqualifies a fit: it then widens the intervals, not a lack of excitation."""
    outputs = fit.how.get("form", {}).get("outputs", {}).values()
    return any(_of_form(one) > FOREIGN_FORM for one in outputs if not one["spread"] < MOVES * one["noise"])


def _of_halves(form: Mapping[str, Any], error: float) -> Iterator[Reason]:
    """A reason if a later part of the data prefers other parameters; refits test whether it needs them (`carrying`)."""
    if not (form.get("halves_gain", 0.0) > CLEARLY and form.get("halves", 0.0) ** 0.5 * error > SMALL_HALVES):
        return
    gain = f"(log-likelihood higher by {form['halves_gain']:.0f})"
    if not (form.get("apart") or form.get("mixed")):
        yield Reason(
            WITH_CARE,
            f"Other parameters fit parts of the data better {gain}, early and late parts alike. The model lacks an "
            f"effect that acts only in some parts. The intervals include this error; greybox gap looks for its cause.",
        )
        return
    first = EIGHTHS[form.get("first", 4)]
    later = "the second half of the data better than those of the first half"
    if first != "half":
        later = f"the rest of the drive better than those of its first {first}"
    yield Reason(
        WITH_CARE,
        f"Other parameters fit {later} {gain}. The vehicle may have changed, or the recordings are of two vehicles. "
        "Fit each part by itself.",
    )


def _short(fit: Fit) -> Iterator[Reason]:
    trained = [one for one in fit.data if one.role == TRAINED]
    rows, seconds = sum(one.samples for one in trained), sum(one.duration for one in trained)
    if trained and (rows < FEWEST_ROWS or seconds < SHORTEST):
        yield Reason(
            NOT_USABLE,
            f"{rows} rows ({number(seconds, 2)} s) are too few: intervals need {FEWEST_ROWS} rows and {SHORTEST:g} "
            "s. Record more.",
        )


def _depends(on: Sequence[str]) -> str:
    """The variables with which residuals vary, and the input errors that they resemble."""
    input_errors = [word for word in on if word.startswith(("a ", "an "))]
    variables = [word for word in on if word not in input_errors]
    varies = f" The error varies with {listed(variables)}." if variables else ""
    return varies + (f" It could come from {' or '.join(input_errors)}." if input_errors else "")


def _dependence(name: str, one: Mapping[str, Any], stated: Mapping[str, float]) -> Iterator[Reason]:
    """The dependence of residuals, if it is large enough to report."""
    error, noise = _of_form(one), stated.get(name, one["noise"])
    times = one["residual"] / noise if noise > 0 else 0.0
    on = [word for word, part in one["on"].items() if part > ALSO * max(one["on"].values())][:2]
    what = "the stated noise" if name in stated else "the noise between rows"
    against = f", {number(times, 2)} times {what}" if times > 1.5 else ""
    left = quantity(one["residual"], unit_of(name), 2)
    if error > OF_FORM or (times > TIMES_NOISE and one["explained"] > UNEXPLAINED):
        depends = " Its mean is not zero." if on[:1] == ["none of the drive"] else _depends(on) if on else ""
        yield Reason(
            NOT_USABLE if error > FOREIGN_FORM else WITH_CARE,
            f"The error of {name} is {left}{against}.{depends} The model lacks an effect"
            f"{', or the data are of another vehicle' if error > DOUBTFUL else ''}. The intervals include this error; "
            "greybox gap looks for its cause.",
        )
    else:
        yield Reason(
            USABLE,
            f"The error from effects that the model lacks is at most {100 * error:.0f} % of the standard "
            f"deviation of {name}; the intervals include this error.",
        )


def _of_form(one: Mapping[str, Any]) -> float:
    """Model-form error over the output's spread."""
    return float((one["explained"] ** 0.5) * one["residual"] / one["spread"]) if one["spread"] > 0 else 0.0


def _unexplained(one: Mapping[str, Any]) -> float:
    """Unexplained share of an output's variance, noise removed."""
    noise = one["noise"] if one["noise"] == one["noise"] else 0.0
    left, all_of_it = (max(one[key] ** 2 - noise**2, 0.0) for key in ("residual", "spread"))
    return left / all_of_it if all_of_it > 0 else 0.0
