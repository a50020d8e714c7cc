"""The verdict on a fit: whether it can be used, and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

Usability = Literal["usable", "usable with care", "not usable"]
USABILITIES: tuple[Usability, ...] = get_args(Usability)
"""Best first."""
USABLE, WITH_CARE, NOT_USABLE = USABILITIES


@dataclass(frozen=True)
class Verdict:
    """What becomes of a fit.

    Attributes
    ----------
    usability : "usable", "usable with care" or "not usable".
    reasons : short sentences, the gravest first; those of a usable fit say what speaks for it.
    comparison : role or recording -> horizon -> output -> {rmse, fit_percent, fvu, persistence, unfitted}: errors
        beside those of persistence and of the model as it was before it was fitted. fit_percent is
        100 (1 - rmse / standard deviation of the readings); what was not compared is missing.
    """

    usability: Usability
    reasons: tuple[str, ...]
    comparison: Mapping[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """The verdict as plain data."""
        return {"verdict": self.usability, "reasons": list(self.reasons), "comparison": dict(self.comparison)}


def from_dict(body: Mapping[str, Any]) -> Verdict | None:
    """A verdict as `Verdict.as_dict` left it; None where there is none. Raises `ValueError` for an unknown one."""
    word = body.get("verdict")
    if word is None:
        return None
    if word not in USABILITIES:
        raise ValueError(f"its verdict {word!r} is not one of {', '.join(USABILITIES)}")
    return Verdict(word, tuple(str(item) for item in body.get("reasons", ())), dict(body.get("comparison") or {}))


@dataclass(frozen=True)
class Reason:
    """One thing for or against a fit, and the best that can be said of a fit of which it holds."""

    at_best: Usability
    sentence: str


def with_reason(verdict: Verdict, reason: Reason | None) -> Verdict:
    """The verdict with one more reason against it."""
    if reason is None:
        return verdict
    worse = USABILITIES.index(reason.at_best) >= USABILITIES.index(verdict.usability)
    kept = verdict.reasons if verdict.usability != USABLE else ()
    known = (reason.sentence, *kept) if worse else (*kept, reason.sentence)
    return Verdict(reason.at_best if worse else verdict.usability, known, verdict.comparison)


def weighed(reasons: Sequence[Reason], comparison: Mapping[str, Any]) -> Verdict:
    """The verdict that the gravest reason leaves; reasons that speak for a fit are only told of a usable one."""
    worst = max((USABILITIES.index(reason.at_best) for reason in reasons), default=0)
    against = sorted(
        (reason for reason in reasons if reason.at_best != USABLE), key=lambda item: -USABILITIES.index(item.at_best)
    )
    known = against or list(reasons)
    return Verdict(USABILITIES[worst], tuple(dict.fromkeys(item.sentence for item in known)), comparison)
