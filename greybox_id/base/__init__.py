"""What every room stands on: errors, units, numbers, files, processes."""
