"""Reports: what a fit says, as data, as figures and as a PDF."""
