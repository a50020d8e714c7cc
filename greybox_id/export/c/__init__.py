"""C99 of a model: no heap, no static state, no library other than the mathematical one."""
