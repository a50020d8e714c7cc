"""The sim-to-real gap: where it lies, which unmodelled effect causes it, how far it shrinks once that is added."""

from ..fitting.scores.horizons import Errors
from .estimation.strip import Strip
from .gap import CHANNELS, REGIMES, Budget, Closure, Gap, Limit, Moved, Ranked, Share, Unnamed, Where

__all__ = [
    "CHANNELS", "REGIMES", "Budget", "Closure", "Errors", "Gap", "Limit", "Moved", "Ranked", "Share", "Strip",
    "Unnamed", "Where",
]  # fmt: skip
