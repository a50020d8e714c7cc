"""The verdict on a fit: how it predicts, how it was estimated, and whether its data are reliable.

Each rule gives a reason and the best verdict that it permits, from an engineer's point of view: "not usable" is a fit
that predicts no better than no fit would, or one of meaningless data; "usable with care" is one of which something must
be known before it is used. A fit without held-out data is usable with care at best: errors on training data prove
nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import stdtrit

from ...base.numbers import listed, number, quantity
from ...datasets.checks import check
from ...datasets.checks.finding import Finding, Severity
from ...datasets.recording import Recording
from ...models.model import Model
from ..fit import NOT_USABLE, USABLE, WITH_CARE, Fit, Reason, Verdict, weighed
from ..provenance import DataRecord
from .estimation import estimation
from .metrics import FREE_RUN, Error, Scores, ahead, standard_error
from .misfit import misfit

TRAINED, HELD_OUT = "train", "validate"
SHORTEST = 0.5
"""Horizons below this, s, are not compared with persistence: over a tenth of a second nothing moves."""
WORSE = 1.1
"""Ratio of errors that counts as worse; over stretches of minutes errors vary by less."""
BY_CHANCE, BLOCK = 0.01, 2
"""Significance level for errors larger than the unfitted model's; length, s, of the stretches whose differences are
tested, that of the longest horizon."""
FOREIGN = 1.5
"""Ratio of held-out errors to training errors above which the fit does not carry over."""
UNEXPLAINED = 0.5
"""Unexplained share of an output's variance that is reported."""
DOUBTS = ("explained", "unrelated", "slides")
"""Kinds of findings on a fit's data that are reported even without other evidence."""
HOLES = 0.05
"""Largest share of missing rows in a channel before its recording counts as broken."""
MANY = 100
"""Largest ratio that is printed as a number."""
MEAN = 1.0
"""Unexplained share of variance of a prediction by the mean of the readings."""
MOST_RUNS, MOST_PREDICTIONS = 0.5, 0.1
"""Largest share of diverging runs, and of diverging predictions over a horizon, of a usable fit."""


def judged(
    fit: Fit,
    value: Mapping[str, Scores],
    *,
    persistence: Mapping[str, Scores] | None = None,
    unfitted: Mapping[str, Scores] | None = None,
    findings: Mapping[str, Sequence[Finding]] | None = None,
    data: Sequence[DataRecord] | None = None,
    more: Sequence[Reason] = (),
) -> Verdict:
    """The verdict on a fit.

    Parameters
    ----------
    fit : the fit.
    value : role or recording -> protocol -> output -> its error; "train" is the training data, all others were held
        out.
    persistence : the same for persistence, if it was compared.
    unfitted : the same for the model before the fit, if it was compared.
    findings : role or recording -> findings of the data checks, as from `distrust`.
    data : records of the held-out data; None takes those of the fit.
    more : further reasons.
    """
    persistence, unfitted, findings = persistence or {}, unfitted or {}, findings or {}
    comparison = _compared(value, persistence, unfitted)
    roles = [role for role in value if role != TRAINED] or list(value)
    reasons = [
        *_trusted(fit, findings),
        *estimation(fit),
        *_held_out(fit, fit.data if data is None else data),
        *more,
    ]
    for role in roles:
        what = _called(role, roles)
        reasons += _predicted(value[role], persistence.get(role, {}), unfitted.get(role, {}), what)
        if role != TRAINED:
            reasons += _carried_over(value.get(TRAINED) or _trained(fit), value[role], what)
    reasons += misfit(fit)
    if roles == [TRAINED]:
        reasons.append(
            Reason(WITH_CARE, "Not validated: no recording was held out; validate the fit on another recording.")
        )
    return weighed(reasons, comparison)


def conditional(fit: Fit, verdict: Verdict) -> Verdict:
    """The verdict with its conditions: stated values that the recordings do not determine."""
    sentences = []
    for name, scaled in fit.how.get("scaling", {}).items():
        stated = quantity(float(fit.model[name].array), fit.model[name].unit, 4)
        sentences.append(
            f"The recordings do not determine {name}. {listed(scaled)} {'is' if len(scaled) == 1 else 'are'} "
            f"proportional to {name}: {'its interval holds' if len(scaled) == 1 else 'their intervals hold'} only if "
            f"the stated value, {stated}, is right."
        )
    return replace(verdict, reasons=tuple(dict.fromkeys([*verdict.reasons, *sentences])))


def times_as_large(scores: Scores, other: Scores) -> float:
    """Ratio of errors to those of another model on the same rows: geometric mean over outputs and judged horizons."""
    judged = [name for name in scores if name != ahead(0.1)] or list(scores)
    return _mean_ratio(
        _ratio(scores[name][output], other[name][output])
        for name in judged
        for output in scores[name]
        if output in other.get(name, {})
    )


def distrust(fit_inputs: Iterable[str], recording: Recording, *, faults: bool = False) -> list[Finding]:
    """Findings of the checks against a recording that concern some signals.

    Parameters
    ----------
    fit_inputs : the signals.
    recording : the checked recording.
    faults : include faults of some size without other evidence: a fit of such data is used with care.
    """
    used = set(fit_inputs)
    return [
        item
        for item in check(recording)
        if (item.severity is Severity.DISTRUST or (faults and item.kind in DOUBTS))
        and (item.where.channel == "time" or used & set(_channels(item)))
    ]


def doubted(model: Model, recordings: Iterable[Recording]) -> tuple[str, ...]:
    """Sentences on recordings that the checks distrust, if they concern the signals of a model."""
    used = used_signals(model)
    return tuple(
        f"Data check of {recording.name}: {item.sentence}"
        for recording in recordings
        for item in distrust(used, recording)
    )


def used_signals(model: Model) -> tuple[str, ...]:
    """A model's inputs and outputs, with all names under which they may be recorded."""
    inputs = [signal for name in model.inputs for signal in (name, *model.aliases.get(name, ()))]
    return tuple(dict.fromkeys([*inputs, *model.outputs]))


def _channels(finding: Finding) -> list[str]:
    return finding.where.channel.replace(",", " ").replace("·", " ").split()


def _trusted(fit: Fit, findings: Mapping[str, Sequence[Finding]]) -> Iterator[Reason]:
    """Reasons from the data checks: data that are wrong throughout disqualify the fit."""
    for role, finding in findings.items():
        where = "" if role == TRAINED else f" (held out{'' if role == HELD_OUT else f', {role}'})"
        for item in finding:
            if item.kind == "explained" and any(effect in item.sentence for effect in fit.model.effects):
                continue  # the fit has the effect that the check proposes
            holes = item.kind == "missing" and (item.value or 0.0) <= HOLES * _rows(fit, role)
            throughout = item.where.run is None and not holes and role == TRAINED and item.severity is Severity.DISTRUST
            yield Reason(NOT_USABLE if throughout else WITH_CARE, f"Data check{where}: {item.sentence}")


def _held_out(fit: Fit, data: Sequence[DataRecord]) -> Iterator[Reason]:
    """Reasons if held-out data are part of the training data."""
    for one, trained in fitted_to(fit, data):
        yield Reason(
            WITH_CARE, f"{one.name} is the data that the fit was made with ({trained.name}): nothing was held out."
        )


def fitted_to(fit: Fit, data: Sequence[DataRecord]) -> Iterator[tuple[DataRecord, DataRecord]]:
    """Held-out records whose file is that of a training record, with the latter."""
    trained = [item for item in fit.data if item.role == TRAINED and item.sha256]
    for one in data:
        part = [
            item
            for item in trained
            if item.sha256 == one.sha256 and (item.between, item.where) in (("", ""), (one.between, one.where))
        ]
        if one.role != TRAINED and part:
            yield one, part[0]


def _rows(fit: Fit, role: str) -> int:
    return sum(record.samples for record in fit.data if record.role == role) or 1


def _predicted(scores: Scores, persistence: Scores, unfitted: Scores, what: str) -> Iterator[Reason]:
    """Reasons from predictions, compared with persistence and with the unfitted model."""
    judged = [name for name in scores if name not in {ahead(h) for h in (0.1, 0.2) if h < SHORTEST}] or list(scores)
    outputs = list(dict.fromkeys(output for name in judged for output in scores[name]))
    yield from _divergences(scores, judged, what)
    useless, beaten, noisy = _poor_outputs(scores, persistence, judged, outputs)
    poor = [*useless, *(name for name, _ in beaten), *(name for name, share in noisy if share >= MEAN)]
    mostly = len(poor) >= max(0.5 * len(outputs), 2.0)
    if useless:
        yield Reason(
            NOT_USABLE if mostly or len(useless) > 0.5 * len(outputs) else WITH_CARE,
            f"{what}{listed(useless)} {'is' if len(useless) == 1 else 'are'} predicted no better than by the mean of "
            f"the readings or by the last reading.",
        )
    for output, times in beaten:
        yield Reason(
            NOT_USABLE if len(beaten) + len(useless) == len(outputs) > 1 else WITH_CARE,
            f"{what}predictions of {output} {_beside(times)} persistence, which keeps the last reading.",
        )
    if mostly and not useless:
        yield Reason(
            NOT_USABLE,
            f"{what}half of the outputs or more ({listed(poor)}) are predicted no better than by the mean of the "
            "readings or by the last reading.",
        )
    for output, share in noisy:
        yield Reason(WITH_CARE, f"{what}predictions leave {100 * share:.0f} % of the variance of {output} unexplained.")
    yield from _beside_unfitted(scores, unfitted, judged, outputs, what)
    best = _accuracy(scores, judged)
    if best:
        yield Reason(USABLE, f"{what}{best}.")


def _poor_outputs(
    scores: Scores, persistence: Scores, judged: Sequence[str], outputs: Sequence[str]
) -> tuple[list[str], list[tuple[str, float]], list[tuple[str, float]]]:
    """Outputs that are predicted no better than by the mean or by persistence; than by persistence, with the ratio of
    errors; and of which much is unexplained, with the share of variance.
    """
    useless, beaten, noisy = [], [], []
    for output in outputs:
        errors = {name: scores[name][output] for name in judged if output in scores[name]}
        unexplained = [_unexplained(error) for error in errors.values()]
        by_hold = [_ratio(e, persistence.get(n, {}).get(output)) for n, e in errors.items() if n in persistence]
        if min(unexplained) >= MEAN and (not by_hold or min(by_hold) >= 1.0):
            useless.append(output)
        elif by_hold and np.nanmedian(by_hold) > 1.0:
            beaten.append((output, float(np.nanmax(by_hold))))
        elif float(np.nanmedian(unexplained)) > UNEXPLAINED:
            noisy.append((output, float(np.nanmedian(unexplained))))
    return useless, beaten, noisy


def _beside_unfitted(
    scores: Scores, unfitted: Scores, judged: Sequence[str], outputs: Sequence[str], what: str
) -> Iterator[Reason]:
    """Reasons if the fit made the model worse."""
    ratios = {
        output: _mean_ratio(
            _ratio(scores[name][output], unfitted[name][output])
            for name in judged
            if output in scores[name] and output in unfitted.get(name, {})
        )
        for output in outputs
    }
    ratios = {output: ratio for output, ratio in ratios.items() if not np.isnan(ratio)}
    if not ratios:
        return
    over_all = float(np.exp(np.mean(np.log(list(ratios.values())))))
    if over_all > WORSE:
        surely = _surely_worse(scores, unfitted, judged)
        doubt = "" if surely else " This may be chance: the difference varies as much between stretches of the drive."
        yield Reason(
            NOT_USABLE if surely else WITH_CARE,
            f"{what}the errors of the fit are {_times(over_all)} those of the unfitted model.{doubt}",
        )
    for output, ratio in ratios.items():
        if ratio > WORSE:
            yield Reason(WITH_CARE, f"{what}the RMSE of {output} is {_times(ratio)} that of the unfitted model.")


def _surely_worse(scores: Scores, unfitted: Scores, judged: Sequence[str]) -> bool:
    """Whether a fit's errors exceed the unfitted model's by more than the difference varies along the drive.

    Differences of mean squares, stretch by stretch, are divided by the sum of both, so that one stretch with a
    diverging model decides nothing. Standard errors of protocols and outputs are averaged, as errors are correlated.
    """
    differences, errors, fewest = [], [], np.inf
    for name in judged:
        for output, error in scores[name].items():
            other = unfitted.get(name, {}).get(output)
            if other is None or not np.isfinite(error.rmse + other.rmse):
                if other is not None and np.isfinite(other.rmse):
                    return True  # it diverges where the unfitted model does not
                continue
            if len(error.blocks) != len(other.blocks) or len(error.blocks) < 2 * BLOCK:
                return True  # chance cannot be estimated
            both = error.rmse**2 + other.rmse**2
            relative = (error.rmse**2 * error.blocks - other.rmse**2 * other.blocks) / both
            relative = relative[: len(relative) // BLOCK * BLOCK].reshape(-1, BLOCK).mean(axis=1)
            differences.append(float(np.mean(relative)))
            errors.append(standard_error(relative))
            fewest = min(fewest, len(relative))
    if not differences:
        return True
    return float(np.mean(differences)) > -float(stdtrit(fewest - 1, BY_CHANCE)) * float(np.mean(errors))


def _divergences(scores: Scores, judged: Sequence[str], what: str) -> Iterator[Reason]:
    for name in judged:
        astray = {output: e.diverges for output, e in scores[name].items() if e.diverges is not None}
        if not astray:
            continue
        first = min(astray.values(), key=lambda d: (d.run, d.after))
        output = next(o for o, d in astray.items() if d is first)
        mostly = first.share > (MOST_RUNS if name == FREE_RUN else MOST_PREDICTIONS)
        yield Reason(
            NOT_USABLE if mostly and (name != FREE_RUN or len(judged) == 1) else WITH_CARE,
            f"{what}{output} {'in free run ' if first.free else ''}{first.words}.",
        )


def _carried_over(trained: Mapping[str, Any], scores: Scores, what: str) -> Iterator[Reason]:
    """A reason if held-out errors exceed those on the training data."""
    ratios = []
    for name, errors in scores.items():
        for output, error in errors.items():
            before = trained.get(name, {}).get(output)
            if before is not None and name != ahead(0.1):
                left_before = _unexplained(before) if isinstance(before, Error) else before["fvu"]
                rmse = before.rmse if isinstance(before, Error) else before["rmse"]
                ratio = error.rmse / rmse if rmse and rmse > 0 else np.nan
                by_share = np.sqrt(_unexplained(error) / left_before) if left_before and left_before > 0 else np.nan
                ratios.append(np.nanmin([ratio, by_share]) if np.isfinite(ratio) or np.isfinite(by_share) else np.nan)
    ratios = [ratio for ratio in ratios if not np.isnan(ratio)]
    if ratios and np.median(ratios) > FOREIGN:
        yield Reason(
            WITH_CARE,
            f"{what}errors are {_times(float(np.median(ratios)))} those on the training data: the fit does not carry "
            "over to other data.",
        )


def _trained(fit: Fit) -> Mapping[str, Any]:
    result: Mapping[str, Any] = fit.metrics.get(TRAINED, {})
    return result


def _accuracy(scores: Scores, judged: Sequence[str]) -> str:
    """Accuracy of the predictions, over the shortest judged horizon."""
    name = judged[0]
    words = {"honest": "one sample ahead", FREE_RUN: "in free run"}.get(name, name.replace("_", " "))
    each = [f"{e.fit_percent:.0f} % in {output}" for output, e in scores[name].items() if np.isfinite(e.fit_percent)]
    return f"predictions {words} reach a fit of {listed(each)} (100 % means no error)" if each else ""


def _unexplained(error: Error) -> float:
    """Mean square of the error over the variance of the readings; infinite if unknown."""
    if not np.isfinite(error.rmse):
        return np.inf
    return (error.rmse / error.spread) ** 2 if error.spread > 0 else (error.fvu if np.isfinite(error.fvu) else np.inf)


def _ratio(error: Error, other: Error | None) -> float:
    if other is None:
        return np.nan
    if not np.isfinite(error.rmse):
        return np.inf if np.isfinite(other.rmse) else 1.0
    if not np.isfinite(other.rmse):
        return 0.0
    return error.rmse / other.rmse if other.rmse > 0 else (np.inf if error.rmse > 0 else 1.0)


def _mean_ratio(ratios: Iterable[float]) -> float:
    """Geometric mean of the positive ones; NaN if there are none."""
    each = [ratio for ratio in ratios if ratio > 0 and not np.isnan(ratio)]
    return float(np.exp(np.mean(np.log(np.clip(each, 1e-6, 1e6))))) if each else np.nan


def _compared(
    value: Mapping[str, Scores], persistence: Mapping[str, Scores], unfitted: Mapping[str, Scores]
) -> dict[str, dict[str, dict[str, dict[str, float]]]]:
    result: dict[str, dict[str, dict[str, dict[str, float]]]] = {}
    for role, protocols in value.items():
        for name, errors in protocols.items():
            for output, error in errors.items():
                row = {"rmse": error.rmse, "fit_percent": error.fit_percent, "fvu": error.fvu}
                for word, others in (("persistence", persistence), ("unfitted", unfitted)):
                    other = others.get(role, {}).get(name, {}).get(output)
                    if other is not None:
                        row[word] = other.rmse
                result.setdefault(role, {}).setdefault(name, {})[output] = row
    return result


def _times(ratio: float) -> str:
    return f"{number(ratio, 2)} times" if ratio < MANY else f"over {MANY} times"


def _beside(times: float) -> str:
    if not np.isfinite(times):
        return "diverge, and are worse than"
    return f"have up to {_times(times)} the RMSE of" if times >= WORSE else "are no better than"


def _called(role: str, roles: Sequence[str]) -> str:
    if role == TRAINED:
        return "On the training data, "
    return "On held-out data, " if len(roles) == 1 else f"On {role}, "
