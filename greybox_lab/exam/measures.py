"""Measures of an examination with their uncertainty, and their bars."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import floor, inf, isfinite, isnan, nan

import numpy as np
from scipy import stats

from .answers import Tier
from .findings import LIBRARY, ExamFinding, Size

BINS = 10


def wilson(hits: int, of: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson, Journal of the American Statistical Association 22, 1927); NaN of nothing."""
    if of == 0:
        return nan, nan
    low, high = stats.binomtest(hits, of).proportion_ci(method="wilson")
    return float(low), float(high)


def median(values: Sequence[float]) -> tuple[float, tuple[float, float]]:
    """Median and its 95 % interval between order statistics; the interval is NaN below six values."""
    if not values:
        return nan, (nan, nan)
    ordered = sorted(values)
    n = len(ordered)
    k = floor(stats.binom.ppf(0.025, n, 0.5))
    interval = (ordered[k - 1], ordered[n - k]) if k >= 1 else (nan, nan)
    return float(np.median(ordered)), interval


def calibration_error(known: Sequence[tuple[float, bool]]) -> float:
    """Mean difference between probabilities and frequencies over ten bins, weighted by their counts."""
    if not known:
        return nan
    probabilities, true = np.array([item for item, _ in known]), np.array([item for _, item in known], float)
    bins = np.clip((probabilities * BINS).astype(int), 0, BINS - 1)
    apart = [np.sum(bins == k) * abs(np.mean((probabilities - true)[bins == k])) for k in set(bins.tolist())]
    return float(sum(apart) / len(known))


Bar = tuple[float, float]
"""Least and largest value that passes."""

_NAMES = {
    "false_alarms": "false alarms on nulls",
    "detection": "gaps above a tenth of the noise: share detected",
    "changed_first": "real changes: first and applied",
    "changed_off": "real changes: largest error of a magnitude",
    "first": "single effect: first choice right, or not distinguishable from the right one",
    "first_strictly": "single effect: first choice right by name",
    "among_three": "single effect: among the first three",
    "doubles": "two effects: both among the first three",
    "double_first": "two effects: first choice right",
    "double_right": "two effects: share in which both and no other are applied",
    "causes": "present effects: share applied, or replaced by one that cannot be distinguished",
    "everything": "share of cases with all present effects applied and no other",
    "extra": "absent effects applied, per case",
    "of_truth": "held-out gap: share closed, divided by that of the true effects, median",
    "classes": "calibration error of classes of causes",
    "unknown": "outside the vocabulary: called unknown",
    "beside": "share of cases with an absent effect applied",
    "null_names": "nulls with a name applied",
    "right": "single effect: share in which it alone is applied",
    "silent": "single effect: nothing applied",
    "above": "single effect above scatter: share in which it alone is applied",
    "outside_named": "outside the vocabulary: share with an effect applied or of probability one half",
    "misplaced": "mean share of the excess error attributed to absent effects",
    "wrongly_unknown": "within the vocabulary: called unknown",
    "magnitude": "magnitude: relative error, median",
    "coverage": "magnitude: 95 % intervals that hold the truth",
    "closed": "gap closed, held out: median",
    "claim": "error of the stated share of the gap that closes, median",
    "calibration": "calibration error of probabilities",
    "cpu": "CPU seconds a case, mean",
}

_BARS: Mapping[str, Mapping[str, Bar]] = {
    "clean": {
        "false_alarms": (0.0, 0.02), "detection": (0.99, 1.0), "first": (0.98, 1.0), "first_strictly": (0.94, 1.0),
        "among_three": (0.99, 1.0), "doubles": (0.96, 1.0), "unknown": (0.85, 1.0), "wrongly_unknown": (0.0, 0.04),
        "magnitude": (0.0, 0.01), "coverage": (0.90, 0.98), "closed": (0.99, inf), "claim": (0.0, 0.02),
        "calibration": (0.0, 0.02), "cpu": (0.0, 10.0),
    },
    "workshop": {
        "false_alarms": (0.0, 0.05), "detection": (0.97, 1.0), "first": (0.95, 1.0), "first_strictly": (0.91, 1.0),
        "among_three": (0.98, 1.0), "doubles": (0.94, 1.0), "unknown": (0.80, 1.0), "wrongly_unknown": (0.0, 0.05),
        "magnitude": (0.0, 0.05), "coverage": (0.88, 0.98), "closed": (0.97, inf), "claim": (0.0, 0.05),
        "calibration": (0.0, 0.03), "cpu": (0.0, 10.0),
    },
    "foreign": {
        "false_alarms": (0.0, 0.05), "first": (0.90, 1.0), "beside": (0.0, 0.08), "outside_named": (0.0, 0.15),
        "calibration": (0.0, 0.04),
    },
    "many": {
        "causes": (0.80, 1.0), "everything": (0.50, 1.0), "extra": (0.0, 0.15), "of_truth": (0.90, inf),
        "coverage": (0.92, 0.98), "calibration": (0.0, 0.03), "classes": (0.0, 0.03), "cpu": (0.0, 10.0),
    },
    "rough": {"causes": (0.60, 1.0), "beside": (0.0, 0.05), "null_names": (0.0, 0.05)},
    "injected": {"first": (0.85, 1.0), "null_names": (0.0, 0.05), "beside": (0.0, 0.05)},
    "changed": {
        "changed_first": (1.0, 1.0), "changed_off": (0.0, 0.12), "null_names": (0.0, 0.0), "right": (0.45, 1.0),
        "beside": (0.0, 0.05),
    },
}  # fmt: skip
"""Bars by tier; `beside` counts singles and pairs; first choices are evaluated for effects above the scatter between
recordings, if that is known."""
_CHANGES = ("right", "silent", "above", "changed_first", "changed_off", "double_first", "double_right")
"""Measures for the question of what changed; not used for the question about one recording."""
_ALONE = ("clean", "workshop", "foreign", "many", "rough")

_ROUNDING = 1e-9
STRETCH = 2.0
"""CPU seconds per case to aim for."""


@dataclass(frozen=True)
class Measure:
    """One line of the score.

    Attributes
    ----------
    key, name : for programs and for people.
    value, interval : with 95 % interval; NaN if there is none.
    of : number of items that it was measured on.
    bar : least and largest value that passes; None if there is none.
    """

    key: str
    name: str
    value: float
    interval: tuple[float, float]
    of: int
    bar: Bar | None

    @property
    def passed(self) -> bool | None:
        """Whether the value passes; None if that cannot be determined."""
        if self.bar is None or not isfinite(self.value):
            return None
        return self.bar[0] - _ROUNDING <= self.value <= self.bar[1] + _ROUNDING


def measures(exam_findings: Sequence[ExamFinding], tier: Tier) -> tuple[Measure, ...]:
    """All lines of the score of one tier."""
    kinds = {
        kind: [item for item in exam_findings if item.answer.kind == kind]
        for kind in ("null", "single", "double", "many", "outside", "changed")
    }
    above = [item for item in kinds["single"] if item.answer.above]
    off = [size.off for item in kinds["changed"] for size in item.sizes if isfinite(size.off)]
    library = kinds["single"] + kinds["double"] + kinds["many"]
    sizes = [size for item in library for size in item.sizes]
    applied = [item for item in library + kinds["outside"] if isfinite(item.claimed) and not isnan(item.verified)]
    ranked = [pair for item in exam_findings for pair in item.ranked]
    classes = [pair for item in exam_findings for pair in item.classes]
    truly = [item.of_truth for item in library if not isnan(item.of_truth)]
    causes = [k < item.applied_right for item in library for k in range(len(item.answer.effects))]
    cpu = [item.cpu for item in exam_findings if isfinite(item.cpu)]
    values = {
        "false_alarms": _share(item.detected for item in kinds["null"]),
        "detection": _share(item.detected for item in exam_findings if item.answer.sizable),
        "changed_first": _share(item.first and item.right for item in kinds["changed"]),
        "changed_off": _plain(max(off, default=nan), off),
        "first": _share(item.first for item in above),
        "first_strictly": _share(item.first_strictly for item in above),
        "among_three": _share(item.among_three for item in above),
        "doubles": _share(item.among_three for item in kinds["double"]),
        "double_first": _share(item.first and bool(item.applied) for item in kinds["double"]),
        "double_right": _share(item.right for item in kinds["double"]),
        "causes": _share(causes),
        "everything": _share(item.right for item in library),
        "extra": _mean([float(len(item.beside)) for item in library]),
        "of_truth": _median(truly),
        "unknown": _share(item.unknown for item in kinds["outside"]),
        "beside": _share(bool(item.beside) for item in library),
        "null_names": _share(bool(item.beside) for item in kinds["null"]),
        "right": _share(item.right for item in kinds["single"]),
        "silent": _share(not item.applied for item in kinds["single"]),
        "above": _share(item.right for item in above),
        "outside_named": _share(bool(item.beside) for item in kinds["outside"]),
        "misplaced": _mean([item.misplaced for item in library if isfinite(item.misplaced)]),
        "wrongly_unknown": _share(item.unknown for item in library),
        "magnitude": _median([size.error for size in sizes]),
        "coverage": _share(size.covered for size in sizes),
        "closed": _median([item.verified for item in applied if item.answer.kind in LIBRARY]),
        "claim": _median([abs(item.claimed - item.verified) for item in applied]),
        "calibration": _plain(calibration_error(ranked), ranked),
        "classes": _plain(calibration_error(classes), classes),
        "cpu": _mean(cpu),
    }
    bars = _BARS.get(tier, {})
    aside = {*_CHANGES} if tier in _ALONE else set()
    aside |= {"false_alarms"} if tier == "rough" else set()  # a gap is inherent to such cars
    requested = [key for key in values if key in bars or (values[key][2] and key not in aside)]
    return tuple(Measure(key, _NAMES[key], *values[key], bars.get(key)) for key in requested)


_Value = tuple[float, tuple[float, float], int]


def _share(which: Iterable[bool]) -> _Value:
    hits = list(which)
    return (sum(hits) / len(hits) if hits else nan), wilson(sum(hits), len(hits)), len(hits)


def _median(values: Sequence[float]) -> _Value:
    return *median(values), len(values)


def _mean(values: Sequence[float]) -> _Value:
    return _plain(float(np.mean(values)) if values else nan, values)


def _plain(value: float, of: Sequence[object]) -> _Value:
    return value, (nan, nan), len(of)


def confusions(exam_findings: Sequence[ExamFinding]) -> dict[str, dict[str, int]]:
    """Present effect -> first choice -> count; for cases with one effect, in or outside the vocabulary."""
    table: dict[str, Counter[str]] = {}
    for item in exam_findings:
        if item.answer.kind in ("single", "outside", "changed"):
            (true,) = item.answer.effects
            first = next(iter(item.choices), "error" if item.error else "nothing" if item.detected else "no gap")
            if item.answer.kind == "outside" and item.unknown:
                first = "unknown"
            table.setdefault(true, Counter())[first] += 1
    return {true: dict(choices.most_common()) for true, choices in sorted(table.items())}


def sizes_by_effect(exam_findings: Sequence[ExamFinding]) -> dict[str, tuple[Size, ...]]:
    """Effect -> its estimated magnitudes."""
    table: dict[str, tuple[Size, ...]] = {}
    for item in exam_findings:
        for size in item.sizes:
            table[size.effect] = (*table.get(size.effect, ()), size)
    return dict(sorted(table.items()))
