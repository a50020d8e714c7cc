"""The Python interface: what `import greybox_id as gb` offers, and what the command line is built on.

The functions here accept names, paths, one recording or several, and call the functions of the packages below. Results
of those are wrapped in classes that can also score, simulate, plot and report (`FitResult` is a `Fit`, `GapResult` a
`Gap`, `TrackResult` a `Track`, `KnownVehicle` a `Vehicle`): the packages below import nothing from here, and accept a
result wherever they accept its base class.
"""
