"""Readers that run in a process of their own, since damaged files end the C libraries beneath them.

They import nothing else of the package: `formats/apart.py` starts one for every file, and starting has to be quick.
Each module has a class `Reader(file, folder)`, whose methods answer with what JSON holds, or with one array.
"""
