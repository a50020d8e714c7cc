"""Steps of a unit of work, and how a recording ended."""

CHECK, FIT, GAP = STEPS = ("check", "fit", "gap")
OK, NOT_TRUSTED, FAILED, TIMEOUT, MEMORY = STATUSES = ("ok", "not trusted", "failed", "timeout", "memory")
"""How a recording ended: all steps done; its check forbids trusting it; a step cannot be done, as the sentence says; it
took longer, or more memory, than the limits allow."""
BROKEN = (FAILED, TIMEOUT, MEMORY)
"""Without a result, which another try may have."""
WAITING = "waiting"
"""Said of a recording that has not ended."""
