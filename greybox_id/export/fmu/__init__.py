"""Functional mock-up units: the exported C behind the interfaces FMI 2.0 and FMI 3.0, zipped."""
