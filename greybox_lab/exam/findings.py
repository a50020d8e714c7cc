"""Comparison of one case's answer with its diagnosis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite, nan
from typing import Any

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

from greybox_id.base.errors import BadInput

from .answers import Answer

UNKNOWN = 0.5
"""Unknown probability above which a diagnosis counts as saying that the cause is unknown."""
NAMED = 0.5
"""Least probability with which an effect counts as named."""
IN_A_CLASS = 0.05
"""Least probability with which a member of the applied effect's class of causes counts as named with it."""
LIBRARY = ("single", "double", "many")
"""Kinds of cases whose effects are all in the vocabulary."""
SCATTERING = ("timestamp_jitter", "dropped_samples")
"""Effects that only scatter readings: they cannot be simulated and applied, so naming them is sufficient."""
NEEDED = ("gap_detected", "unknown_probability", "ranking", "applied", "gap")


@dataclass(frozen=True)
class Size:
    """A magnitude compared with the true one.

    Attributes
    ----------
    effect : name.
    error : distance from the truth, relative to the truth's distance from its null, or to the truth if that is
        infinite.
    off : distance from the truth.
    covered : whether the interval contains the truth.
    """

    effect: str
    error: float
    off: float
    covered: bool


@dataclass(frozen=True)
class ExamFinding:
    """Evaluation of one case. A diagnosis that ended in an error counts as wrong in every respect.

    Attributes
    ----------
    answer : the truth.
    error : message of a diagnosis that ended in an error; otherwise "".
    detected : whether a gap was detected; for nulls, an error counts as a false alarm.
    unknown : whether the diagnosis says that the cause is unknown.
    unknown_probability : stated probability of that.
    choices : effect -> probability, as ranked; empty if no gap was detected.
    first, first_strictly : whether the first choice is right, up to indistinguishable effects, and by name.
    among_three : whether all present effects are among the first three, up to indistinguishable ones.
    sizes : of present effects that rank within the number of present effects, by name.
    applied : names that were applied, or named if they cannot be applied, see `SCATTERING`.
    beside : those of them that are absent, up to indistinguishable ones; for a case outside the vocabulary, also any
        with a probability of at least one half.
    applied_right : number of present effects that were applied, each under a different name.
    classes : probability of each stated class of causes, and whether it contains a present effect.
    misplaced : share of the excess error that the budget gives to absent effects; NaN without a budget.
    ranked : probability of each ranked effect, and whether it is present.
    claimed, verified : closed share of the gap as stated, and on the held-out recording; NaN if nothing was applied.
    of_truth : closed share on that recording relative to that of the present effects at their true magnitudes; zero if
        nothing was applied, NaN if unknown.
    cpu : CPU seconds; NaN if unknown.
    """

    answer: Answer
    error: str
    detected: bool
    unknown: bool
    unknown_probability: float = nan
    choices: Mapping[str, float] = field(default_factory=dict)
    first: bool = False
    first_strictly: bool = False
    among_three: bool = False
    sizes: tuple[Size, ...] = ()
    applied: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    applied_right: int = 0
    classes: tuple[tuple[float, bool], ...] = ()
    misplaced: float = nan
    ranked: tuple[tuple[float, bool], ...] = ()
    claimed: float = nan
    verified: float = nan
    of_truth: float = nan
    cpu: float = nan

    @property
    def right(self) -> bool:
        """Whether exactly the present effects were applied, up to indistinguishable ones."""
        return bool(self.applied) and not self.beside and self.applied_right == len(self.answer.effects)

    @property
    def wrong(self) -> str:
        """The mistake in a few words; "" if there was none."""
        if self.error:
            return "error"
        kind = self.answer.kind
        if kind == "null":
            return "false alarm" if self.detected else ""
        if not self.detected:
            return "not detected"
        if kind == "outside":
            return "" if self.unknown else "not called unknown"
        if kind == "double":
            return "" if self.among_three else "not both among the first three"
        if kind == "many":
            return "" if self.right else f"{self.applied_right} of {len(self.answer.effects)} applied"
        return "" if self.first else ("second or third" if self.among_three else "not among the first three")


def finding(answer: Answer, diagnosis: Mapping[str, Any], verified: float = nan, by_truth: float = nan) -> ExamFinding:
    """Compare an answer with a diagnosis.

    Parameters
    ----------
    answer, diagnosis : of one case.
    verified, by_truth : closed share of the gap on the held-out recording, with the applied and with the present
        effects.

    Raises
    ------
    BadInput : if the diagnosis lacks a required entry.
    """
    cpu = (diagnosis.get("cost") or {}).get("cpu_s")
    cpu = nan if cpu is None else float(cpu)
    library = answer.kind in LIBRARY
    if "error" in diagnosis:
        null = answer.kind == "null"
        return ExamFinding(
            answer, error=str(diagnosis["error"]), detected=null, unknown=library, cpu=cpu,
            of_truth=0.0 if library and not np.isnan(by_truth) else nan,
        )  # fmt: skip
    if lacking := [key for key in NEEDED if key not in diagnosis]:
        raise BadInput(f"The diagnosis of {answer.case} does not say {', '.join(lacking)}. Remove it and run again.")
    ranking = [item for item in diagnosis["ranking"] if isinstance(item, Mapping)]
    detected = bool(diagnosis["gap_detected"])
    names = [str(item["effect"]) for item in ranking] if detected else []
    applied = _stood_by(diagnosis, ranking if detected else [])
    stands_for = _stands_for(diagnosis)
    first = names[0] if names else ""
    return ExamFinding(
        answer=answer,
        error="",
        detected=detected,
        unknown=float(diagnosis["unknown_probability"]) > UNKNOWN,
        unknown_probability=float(diagnosis["unknown_probability"]),
        choices={name: float(item["probability"]) for name, item in zip(names, ranking, strict=False)},
        first=any(first in answer.alike(name) for name in answer.effects),
        first_strictly=first in answer.effects,
        among_three=_matched(answer, names[:3], {}) == len(answer.effects),
        sizes=tuple(
            _size(answer, item, diagnosis.get("scatter") or {})
            for item in ranking[: len(answer.effects)]
            if item["effect"] in answer.effects
        )
        if detected and (library or answer.kind == "changed")
        else (),
        applied=applied,
        beside=_beside(answer, diagnosis, ranking if detected else []),
        applied_right=_matched(answer, applied, stands_for),
        classes=tuple(
            (float(item["probability"]), bool(_right(answer) & {*item["members"]}))
            for item in diagnosis.get("classes") or ()
        ),
        misplaced=_misplaced(answer, diagnosis.get("budget") or ()),
        ranked=tuple(
            (float(item["probability"]), item["effect"] in answer.effects)
            for item in ranking
            if item["effect"] not in answer.nature
        ),
        claimed=_closed(diagnosis["gap"]) if diagnosis["applied"] else nan,
        verified=verified if diagnosis["applied"] else nan,
        of_truth=(max(verified, 0.0) if diagnosis["applied"] else 0.0) / by_truth if by_truth > 0 else nan,
        cpu=cpu,
    )


def _stood_by(diagnosis: Mapping[str, Any], ranking: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """Names that were applied, and those named that cannot be applied."""
    named = [str(item["effect"]) for item in ranking if item["effect"] in SCATTERING and item["probability"] >= NAMED]
    return tuple(dict.fromkeys([*map(str, diagnosis["applied"]), *named]))


def _stands_for(diagnosis: Mapping[str, Any]) -> dict[str, set[str]]:
    """Applied name -> itself and the likely members of its class of causes."""
    result = {str(name): {str(name)} for name in diagnosis["applied"]}
    for item in diagnosis.get("classes") or ():
        if item.get("applied") in result:
            each = item.get("each") or {}
            result[item["applied"]] |= {name for name in item["members"] if (each.get(name) or 0.0) >= IN_A_CLASS}
    return result


def _matched(answer: Answer, names: Sequence[str], stands_for: Mapping[str, set[str]]) -> int:
    """Number of present effects that are named, each under a different name, up to indistinguishable ones."""
    if not names or not answer.effects:
        return 0
    fits = [[bool(answer.alike(effect) & (stands_for.get(name) or {name})) for name in names]
            for effect in answer.effects]  # fmt: skip
    return int(np.sum(maximum_bipartite_matching(csr_array(np.array(fits, dtype=int)), perm_type="column") >= 0))


def _beside(answer: Answer, diagnosis: Mapping[str, Any], ranking: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """Applied or named effects that are absent."""
    given = [*_stood_by(diagnosis, ranking)]
    if answer.kind == "outside":
        given += [str(item["effect"]) for item in ranking if float(item["probability"]) >= NAMED]
    right, stands_for = _right(answer), _stands_for(diagnosis)
    return tuple(name for name in dict.fromkeys(given) if not right & (stands_for.get(name) or {name}))


def _misplaced(answer: Answer, budget: Sequence[Mapping[str, Any]]) -> float:
    """Share of the excess that a budget gives to absent effects; NaN if there is no budget."""
    shares = {str(item["effect"]): float(item["share"]) for item in budget if item.get("effect") and item.get("share")}
    right = _right(answer)
    return sum(abs(share) for name, share in shares.items() if name not in right) if budget else nan


def _right(answer: Answer) -> set[str]:
    """Names that are right for a present effect, whether injected or inherent to the vehicle."""
    return {name for effect in (*answer.effects, *answer.nature) for name in answer.alike(effect)}


def _size(answer: Answer, ranked: Mapping[str, Any], scatter: Mapping[str, Any]) -> Size:
    """Magnitude compared with the truth; for a change, relative to the mean before it."""
    name = str(ranked["effect"])
    true, null = answer.effects[name], answer.nulls[name]
    before = scatter[name]["mean"] if name in scatter else null

    def beyond(value: float | None, unknown: float) -> float:
        if value is None or before == null:
            return unknown if value is None else float(value)
        return float(value) / before if null == 1.0 else float(value) - before + null

    low, high = (beyond(end, side * inf) for end, side in zip(ranked["interval"], (-1, 1), strict=True))
    result = beyond(ranked["magnitude"], inf)
    apart = abs(result - true) if isfinite(result) else inf
    return Size(name, apart / (abs(true) if null == inf else abs(true - null)), apart, low <= true <= high)


def _closed(closure: Mapping[str, Any]) -> float:
    value = closure.get("closed")
    return nan if value is None else float(value)
