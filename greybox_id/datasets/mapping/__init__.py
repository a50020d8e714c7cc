"""Proposing a column map for a file whose columns nobody has mapped: from names, units and cross-checks.

A wrong guess given with confidence is worse than a question: what cannot be decided is left to the user, with what
speaks for each alternative.
"""

from .evidence import MapEntry
from .proposal import Proposal, as_toml, propose

__all__ = ["MapEntry", "Proposal", "as_toml", "propose"]
