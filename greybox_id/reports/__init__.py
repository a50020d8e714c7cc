"""Reports of results: content, figures, and output as PDF, HTML and text."""
