"""What could be there unseen: how large an effect must be to show on these recordings, and what takes it up."""

from __future__ import annotations

from math import inf, isfinite

from ..estimation.calibration import CAL
from .examining import TINY, Examined
from .gap import Limit


def not_excited(found: Examined) -> tuple[dict[str, str], tuple[str, ...]]:
    """Effects this recording does not excite, with what would be seen, and those that tolerances take up."""
    weak, absorbed = {}, []
    for own in found.selection.promised:
        name, axis = own.candidate.effect, own.candidate.axes[0]
        typical = found.effects[name].typical
        size = abs(axis.coordinate(typical) - axis.null)
        if name in found.best.names or not isfinite(own.sd) or 2 * own.sd < size:
            continue
        if own.told < CAL.hidden:
            absorbed.append(name)
        elif 2 * own.sd > axis.high - axis.low:
            weak[name] = "any size"
        elif not axis.inverse:
            weak[name] = f"±{2 * own.sd:.2g} {axis.unit}".replace(" 1", "").strip()
    return weak, tuple(absorbed)


def limits(found: Examined) -> dict[str, Limit]:
    """What would show of every effect that was not applied, the least visible first; limits that only a refit tells are
    left out.
    """
    sizes = {}
    for own in found.selection.promised:
        name, axis, reach = own.candidate.effect, own.candidate.axes[0], 2 * own.sd
        if name in found.best.names or not isfinite(own.sd):
            continue
        typical = found.effects[name].typical
        usual = abs(axis.coordinate(typical) - axis.null)
        beyond = reach > axis.high - axis.low
        size = (0.0 if beyond else 1 / reach) if axis.inverse else (inf if beyond else reach)
        sizes[name] = Limit(size, typical, axis.unit, reach / max(usual, TINY), own.told)
    return dict(sorted(sizes.items(), key=lambda item: -item[1].share))
