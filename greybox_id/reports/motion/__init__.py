"""Reports of equations of motion."""
