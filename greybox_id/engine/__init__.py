"""The engine: models applied to recordings, their derivatives, and the least-squares problem of fitting them."""
