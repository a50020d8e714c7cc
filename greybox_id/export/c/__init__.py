"""C99 of a model: no heap, no state of its own, nothing but the mathematical library."""
