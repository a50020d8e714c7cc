"""Solvers: condensed Gauss-Newton finds an optimum, Ipopt certifies it."""
