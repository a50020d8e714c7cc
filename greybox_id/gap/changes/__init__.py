"""What changed between recordings of one vehicle, judged by its own recordings from before."""
