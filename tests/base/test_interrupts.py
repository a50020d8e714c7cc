"""Ctrl-C waits for the end of what must be whole."""

import os
import signal
import threading

import pytest

from greybox_id.base.interrupts import uninterrupted


@uninterrupted()
def written(to, fails=False):
    os.kill(os.getpid(), signal.SIGINT)
    to.append("written")
    if fails:
        raise OSError("full")


def test_ctrl_c_waits_for_the_end():
    before, done = signal.getsignal(signal.SIGINT), []
    with pytest.raises(KeyboardInterrupt):
        written(done)
    assert done == ["written"]
    assert signal.getsignal(signal.SIGINT) is before


def test_an_error_is_not_hidden_by_ctrl_c():
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(OSError, match="full"):
        written([], fails=True)
    assert signal.getsignal(signal.SIGINT) is before


def test_ignored_interrupts_and_other_threads_stay_as_they_are():
    before, seen = signal.signal(signal.SIGINT, signal.SIG_IGN), []
    try:
        with uninterrupted():
            seen.append(signal.getsignal(signal.SIGINT))
    finally:
        signal.signal(signal.SIGINT, before)

    def elsewhere():
        with uninterrupted():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert seen == [signal.SIG_IGN, before]
