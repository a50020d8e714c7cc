"""Results as text, for the command line and `summary()` methods."""
