"""CasADi functions, serialised, and a Python module that loads them with named symbols."""
