"""Proposing a column map for a new file, from column names, units and cross-checks.

A confident wrong guess is worse than a question: what cannot be decided is left to the user, with the evidence for
each alternative.
"""

from .evidence import MapEntry
from .proposal import Proposal, as_toml, propose

__all__ = ["MapEntry", "Proposal", "as_toml", "propose"]
