"""Readers that run in an isolated process, since damaged files crash the C libraries that they use.

They import nothing of the package but `contained`: `formats/apart.py` starts one for every file, which must be quick.
Each module has one class with arguments (file, folder), whose methods return plain JSON data or one array.
"""
