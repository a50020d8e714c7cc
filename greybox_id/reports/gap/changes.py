"""What changed between recordings of one vehicle, as parts of a report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...base.numbers import listed
from ...gap.gap import Gap
from ..document import Part, Table, Text, titled
from .words import before_words, magnitude_words, probability_words, unchanged_words


def what_changed(gap: Gap, answer: Mapping[str, Any]) -> tuple[Part, ...]:
    """What changed, what did not, and of what recordings do not say whether it did.

    Parameters
    ----------
    gap : the diagnosis of what changed.
    answer : its `since`, `changed`, `not_changed` and `not_seen`, as `Changed.to_json` gives them.
    """
    of, changed = {each.effect: each for each in gap.ranking}, answer["changed"]
    rows = tuple(
        (cause.effect, before_words(cause, mean), magnitude_words(cause), probability_words(cause.probability))
        for cause, mean in ((of[each["effect"]], each["before"]) for each in changed)
    )
    same = [unchanged_words(each["effect"], each["within"]) for each in answer["not_changed"]]
    others = (
        ("Not changed, to two standard deviations:", same),
        ("Not known, as a usual change is below the detection limit:", answer["not_seen"]),
    )
    return titled(
        f"Changed since {listed(answer['since'])}",
        Table(("effect", "before", "after", "probability"), rows, "LLLL"),
        Text("" if rows else "Nothing beyond the scatter of the drives from before.", small=False),
        *(Text(f"{listed(names)}.", lead=lead, small=False) for lead, names in others if names),
        level=2,
    )
