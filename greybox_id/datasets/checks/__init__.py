"""Data checks: findings about clock, values, agreement between channels, offsets at rest and delays."""

from .checking import check, doubts
from .finding import Finding, FoundAt, Severity, distrusted

__all__ = ["Finding", "FoundAt", "Severity", "check", "distrusted", "doubts"]
