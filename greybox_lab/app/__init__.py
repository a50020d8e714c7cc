"""`greybox app`: look, drag, fit, see why; a page in the browser, every step of which is a command."""
