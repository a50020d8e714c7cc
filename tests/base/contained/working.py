"""Units of work that end in all ways."""

import os
import signal
import time


def well(job, tell):
    tell({"a": 1})
    tell({"told": job["word"]})


def raising(job, tell):
    tell({"a": 1})
    raise ZeroDivisionError("division")


def sleeping(job, tell):
    tell({"a": 1})
    time.sleep(600)


def spinning(job, tell):
    while True:
        pass


def eating(job, tell):
    held = [bytearray(20_000_000)]
    while len(held) < 40_000:
        held.append(bytearray(20_000_000))
        for own in held[-1:]:
            own[::4096] = b"x" * len(own[::4096])


def reserving(job, tell):
    bytearray(10**12)


def crashing(job, tell):
    tell({"a": 1})
    os.kill(os.getpid(), signal.SIGSEGV)


def leaving_children(job, tell):
    if os.fork() == 0:
        time.sleep(600)
    tell({"a": 1})


def slowly(job, tell):
    tell({"at": 1})
    time.sleep(1.0)
    tell({"at": 2})
