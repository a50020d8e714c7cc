"""Results as text: what the command line prints, and what their `summary()` returns."""
