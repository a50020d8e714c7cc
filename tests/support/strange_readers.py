"""Readers that do what damaged files make C libraries do, to be run apart."""

import ctypes
import json
import os
import signal
import sys
import time
from pathlib import Path

import numpy as np


class Reader:
    def __init__(self, file, folder):
        self.file, self.folder = Path(file), Path(folder)

    def echo(self, *of):
        return {"of": of, "file": str(self.file)}

    def array(self, dtype, shape):
        return np.arange(int(np.prod(shape)) * np.dtype(dtype).itemsize, dtype=np.uint8).view(dtype).reshape(shape)

    def modules(self):
        return sorted(sys.modules)

    def own_id(self):
        return os.getpid()

    def crash(self):
        (self.folder / "left behind").touch()
        ctypes.string_at(0)

    def hang(self):
        self.file.write_text(json.dumps(os.getpid()))
        time.sleep(100)

    def spin(self):
        while True:
            pass

    def eat(self):
        return len(bytearray(10**9))

    def eat_unnoticed(self):
        eaten = []
        while True:
            eaten.append(np.ones(10**6))

    def is_killed(self, name):
        signal.raise_signal(signal.Signals[name])

    def gabble(self):
        for descriptor in range(3, 16):  # whichever the answers go to
            try:
                os.write(descriptor, b"\x05\0\0\0\0\0\0\0{[,,}" * 10)
            except OSError:
                continue
        time.sleep(100)

    def print(self):
        os.write(1, b"a library says something\n")
        return "heard"

    def gives(self):
        return np.array([object()])

    def fails(self, message):
        raise RuntimeError(message)

    def needs(self):
        import nothing_of_this_name

        return nothing_of_this_name
