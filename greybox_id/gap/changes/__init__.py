"""What changed between recordings of one vehicle, which its own recordings from before decide."""
