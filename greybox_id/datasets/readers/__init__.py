"""Readers that run in a process of their own, since damaged files end the C libraries beneath them.

They import nothing of the package but `contained`: `formats/apart.py` starts one for every file, which has to be quick.
Each module has a class `Reader(file, folder)`, whose methods answer with what JSON holds, or with one array.
"""
