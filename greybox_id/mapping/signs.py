"""Which channels count the other way round: those on the smaller side of a contradiction, or away from an anchor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from .entry import MapEntry
from .evidence import Met

ANCHORS = ("course over ground (latitude, longitude)", "v_x")
"""What has its sign from elsewhere: a course from north and east, and a vehicle that drives forward."""
CLEAR = 3
"""So many channels on one side against a single one settle which is wrong."""


def with_signs(entries: Sequence[MapEntry], agreed: Sequence[Met]) -> list[MapEntry]:
    """The entries with signs that agree with each other, or left open where two sides are as likely."""
    found = {entry.signal: entry for entry in entries}
    for sides in _components(agreed):
        words = [own.pair.left + (" agrees with " if own.agreed.correlation > 0 else " contradicts ") + own.pair.right
                 for own in agreed if own.pair.nodes[0] in sides]  # fmt: skip
        right, wrong, sure = _judged(sides)
        for name in wrong:
            if name not in found:  # the course of x and y: one of them is mirrored, or all the rest is
                name = "y"
            if name in found:
                why = "; ".join(word for word in words if name in word) or "; ".join(words)
                asked = "" if sure else "; either this column counts the other way round or " + " and ".join(right)
                found[name] = replace(
                    found[name], sign=-found[name].sign, decided=found[name].decided and sure,
                    reasons=(*found[name].reasons, f"sign: {why}{asked}"),
                )  # fmt: skip
    return list(found.values())


def _components(agreed: Sequence[Met]) -> list[dict[str, int]]:
    """Channels that are tied to each other, each with its side, 1 or -1; the strongest ties decide."""
    groups: list[dict[str, int]] = []
    for own in sorted(agreed, key=lambda m: -abs(m.agreed.correlation)):
        a, b = own.pair.nodes
        same = 1 if own.agreed.correlation > 0 else -1
        left = next((g for g in groups if a in g), None)
        right = next((g for g in groups if b in g), None)
        if left is None:
            left = {a: 1}
            groups.append(left)
        if right is None:
            left[b] = left[a] * same
        elif right is not left:
            turn = left[a] * same * right[b]
            left.update({name: side * turn for name, side in right.items()})
            groups.remove(right)
    return groups


def _judged(sides: dict[str, int]) -> tuple[list[str], list[str], bool]:
    """The channels that are right, those that are wrong, and whether that is certain."""
    anchor = next((name for name in ANCHORS if name in sides), None)
    if anchor:
        right = [name for name, side in sides.items() if side == sides[anchor]]
        return right, [name for name in sides if name not in right], True
    first = [name for name, side in sides.items() if side == 1]
    second = [name for name, side in sides.items() if side == -1]
    right, wrong = sorted((first, second), key=lambda own: (-len(own), "yaw_rate" not in own))
    return right, wrong, len(wrong) == 0 or (len(wrong) == 1 and len(right) >= CLEAR)
