"""Models made elsewhere: networks saved by nnodely become fits of our own, and nothing in their files is executed."""

from .verb import Imported, import_network

__all__ = ["Imported", "import_network"]
