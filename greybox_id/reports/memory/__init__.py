"""Reports of maps with memory."""
