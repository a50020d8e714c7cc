"""Functional mock-up units: the exported C behind the FMI 2.0 and FMI 3.0 interfaces, zipped."""
