"""What a user chooses about a model, as written on a command line."""
