"""Many recordings of many vehicles: units of work on engines, results on disk, and what they say together."""
