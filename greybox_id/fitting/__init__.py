"""The verb `fit`: from recordings and a model to a `Fit`."""
