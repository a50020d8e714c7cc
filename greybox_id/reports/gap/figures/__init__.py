"""Pictures of a gap: how far, which, along time and path, in frequency."""
