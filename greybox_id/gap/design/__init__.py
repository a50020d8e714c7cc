"""Manoeuvres that tell more: what to drive so that parameters are precise, or so that explanations are told apart."""
