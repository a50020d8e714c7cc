"""Reports of physics with a network inside."""
