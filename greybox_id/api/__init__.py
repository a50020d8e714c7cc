"""The top level: what `import greybox_id as gb` offers, on the floor below the command line.

`verbs.py` takes what people have at hand (names, paths, one recording or several) and calls the verbs of the floors
below. What these return knows only its own floor; here it becomes a result that also scores, simulates, plots and
reports itself (`FitResult` is a `Fit`, `GapResult` a `Gap`, `TrackResult` a `Track`, `KnownVehicle` a `Vehicle`): the
floors below import nothing from above, and take a result wherever they take the record it is.
"""
