"""The sim-to-real gap: where it lies, which unmodelled effect causes it, how far it shrinks once that is added."""

from .gap import CHANNELS, REGIMES, Closure, Errors, Gap, Limit, Ranked, Strip, Where

__all__ = ["CHANNELS", "REGIMES", "Closure", "Errors", "Gap", "Limit", "Ranked", "Strip", "Where"]
