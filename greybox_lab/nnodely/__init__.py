"""Models and vehicles made elsewhere become fits and vehicle files of our own; nothing in their files is executed."""

from .vehicles import ImportedVehicle, import_vehicle
from .verb import Imported, import_network

__all__ = ["Imported", "ImportedVehicle", "import_network", "import_vehicle"]
