"""Foundations of all rooms: errors, units, numbers, files, processes."""
