"""Presentation of a diagnosis: sentences, a page of figures, a report."""
