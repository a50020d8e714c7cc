"""Figures as plain data, and their drawing as SVG: fast, the same everywhere, in letters of the page they stand on."""
