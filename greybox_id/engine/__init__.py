"""The engine: models laid over recordings, their derivatives, and the least-squares problem of fitting them."""
