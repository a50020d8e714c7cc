"""Published papers again: their tables by their own protocols, and by ones that nothing leaks through."""
