"""Reading recordings from files, and the recordings that come with the package."""
