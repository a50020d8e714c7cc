"""One case's answer beside its diagnosis: what was right and what was wrong."""

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
"""A diagnosis whose unknown probability is above this says that the cause is unknown."""
NAMED = 0.5
"""A probability from which on an effect is named."""
IN_A_CLASS = 0.05
"""Probability from which on a member of a class of causes, stated as what is applied, counts as named with it."""
LIBRARY = ("single", "double", "many")
"""Kinds of cases whose effects are all of the vocabulary."""
SCATTERING = ("timestamp_jitter", "dropped_samples")
"""Effects that scatter readings: there is nothing of them that a simulation could add, so that to name them is all."""
NEEDED = ("gap_detected", "unknown_probability", "ranking", "applied", "gap")


@dataclass(frozen=True)
class Size:
    """A magnitude beside the true one.

    Attributes
    ----------
    effect : name.
    error : distance from the truth over the truth's from its null; over the truth where that null is infinite.
    off : distance from the truth.
    covered : whether the truth lies in the stated interval.
    """

    effect: str
    error: float
    off: float
    covered: bool


@dataclass(frozen=True)
class ExamFinding:
    """What came of one case. What a diagnosis that ended in an error could get wrong, it got wrong.

    Attributes
    ----------
    answer : the truth.
    error : sentence of a diagnosis that ended in one; "" else.
    detected : whether a gap was named; for nulls an error is a false alarm.
    unknown : whether it said that the cause is unknown.
    unknown_probability : that it stated.
    choices : effect -> probability, as ranked; none where no gap was named.
    first, first_strictly : the first choice is right, up to what cannot be distinguished, and by name.
    among_three : every effect that is there stands among the first three, up to what cannot be distinguished.
    sizes : of effects that are there and rank as high as there are effects, by name.
    applied : names that were applied, or named where nothing can be, see `SCATTERING`.
    beside : of these, the ones that are not there, up to what cannot be distinguished; of a case outside the
        vocabulary, also any that was given a probability of one half.
    applied_right : how many of the effects that are there were applied, each by a name of its own.
    classes : probability of every class of causes that was stated, and whether it holds one that is there.
    misplaced : share of the excess error that the budget gives to names that are not there; NaN without a budget.
    told : probability of every effect that was ranked, and whether it is there.
    claimed, verified : how far the gap closes, by its own account and on the recording that was held out; NaN where
        nothing was applied.
    of_truth : how far it closes on that recording over how far the effects that are there close it, at their true
        magnitudes; zero where nothing was applied, NaN where it is not known.
    cpu : CPU seconds; NaN where they are not known.
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
    told: tuple[tuple[float, bool], ...] = ()
    claimed: float = nan
    verified: float = nan
    of_truth: float = nan
    cpu: float = nan

    @property
    def right(self) -> bool:
        """Whether what is there was applied and nothing else, up to what cannot be distinguished."""
        return bool(self.applied) and not self.beside and self.applied_right == len(self.answer.effects)

    @property
    def wrong(self) -> str:
        """What was wrong, in a word; "" where nothing was."""
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
    """Join an answer and a diagnosis.

    Parameters
    ----------
    answer, diagnosis : of one case.
    verified, by_truth : how far the gap closes on what was held out, with what was applied and with what is there.

    Raises
    ------
    BadInput : the diagnosis lacks what it must say.
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
        told=tuple(
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
    """Names that were applied, and those named of which nothing can be."""
    named = [str(item["effect"]) for item in ranking if item["effect"] in SCATTERING and item["probability"] >= NAMED]
    return tuple(dict.fromkeys([*map(str, diagnosis["applied"]), *named]))


def _stands_for(diagnosis: Mapping[str, Any]) -> dict[str, set[str]]:
    """Applied name -> itself, and the likely members of the class of causes of which it is the one applied."""
    result = {str(name): {str(name)} for name in diagnosis["applied"]}
    for item in diagnosis.get("classes") or ():
        if item.get("applied") in result:
            each = item.get("each") or {}
            result[item["applied"]] |= {name for name in item["members"] if (each.get(name) or 0.0) >= IN_A_CLASS}
    return result


def _matched(answer: Answer, names: Sequence[str], stands_for: Mapping[str, set[str]]) -> int:
    """How many effects are named, each by a name of its own, up to what cannot be distinguished."""
    if not names or not answer.effects:
        return 0
    fits = [[bool(answer.alike(effect) & (stands_for.get(name) or {name})) for name in names]
            for effect in answer.effects]  # fmt: skip
    return int(np.sum(maximum_bipartite_matching(csr_array(np.array(fits, dtype=int)), perm_type="column") >= 0))


def _beside(answer: Answer, diagnosis: Mapping[str, Any], ranking: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """Names that the diagnosis stands by and that are not there."""
    given = [*_stood_by(diagnosis, ranking)]
    if answer.kind == "outside":
        given += [str(item["effect"]) for item in ranking if float(item["probability"]) >= NAMED]
    right, stands_for = _right(answer), _stands_for(diagnosis)
    return tuple(name for name in dict.fromkeys(given) if not right & (stands_for.get(name) or {name}))


def _misplaced(answer: Answer, budget: Sequence[Mapping[str, Any]]) -> float:
    """Share of the excess that a budget gives to names that are not there; NaN where there is no budget."""
    shares = {str(item["effect"]): float(item["share"]) for item in budget if item.get("effect") and item.get("share")}
    right = _right(answer)
    return sum(abs(share) for name, share in shares.items() if name not in right) if budget else nan


def _right(answer: Answer) -> set[str]:
    """Names that are right for something that is there, by what was done to the vehicle or by its nature."""
    return {name for effect in (*answer.effects, *answer.nature) for name in answer.alike(effect)}


def _size(answer: Answer, ranked: Mapping[str, Any], scatter: Mapping[str, Any]) -> Size:
    """Of what changed, how far from where it was before."""
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
