"""Work side by side: what comes back, in which order, and what Ctrl-C leaves."""

import itertools
import os
import signal
import sys
import threading
import time
import weakref
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children

import casadi as cs
import numpy as np
import pytest

from greybox_id.base import processes
from greybox_id.base.errors import GreyboxError
from greybox_id.base.interrupts import interrupt, interrupts_return
from greybox_id.base.processes import FORKS, apart, elsewhere, side_by_side
from greybox_id.datasets.read import read
from greybox_id.datasets.shipped import shipped
from greybox_id.engine.compiler import CannotCompile
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.verb import fit
from greybox_id.models.registry import build, prepared
from greybox_id.models.vehicle import vehicle

forks = pytest.mark.skipif(not FORKS, reason="this system does not fork safely")


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_back_in_the_order_of_their_numbers(jobs):
    held = np.arange(5.0)  # forked processes begin with it
    order = []
    done = side_by_side(lambda k: 2 * held[k], 5, jobs, lambda k, _: order.append(k) is None)
    assert done.results == [0, 2, 4, 6, 8]
    assert sorted(order) == list(range(5))
    assert not done.interrupted
    assert (done.cpu_seconds > 0) == (apart(5, jobs))


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_goes_wrong_is_raised_here(jobs):
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda k: 1 // (k - 1), 3, jobs)


@pytest.mark.skipif(not FORKS, reason="all is done here")
def test_a_worker_that_is_killed_is_a_sentence():
    with pytest.raises(GreyboxError, match="fewer jobs"):
        side_by_side(lambda k: os.kill(os.getpid(), signal.SIGKILL) if k == 1 else k, 4, 2)


@pytest.mark.parametrize("jobs", [1, 2])
def test_nothing_more_is_begun_once_it_is_told_to_end(jobs):
    done = side_by_side(lambda k: k, 50, jobs, lambda k, _: False)
    assert 1 <= len(done.by_number) < 50


@forks
def test_an_interrupt_reaches_those_at_work_and_keeps_what_they_hand_in():
    def work(k):
        try:
            time.sleep(0.0 if k == 0 else 60.0)
        except KeyboardInterrupt:
            return -k
        return k

    def told(k, _):
        threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
        return True

    begun = time.monotonic()
    done = side_by_side(work, 4, 2, told)
    assert time.monotonic() - begun < 30
    assert done.interrupted
    assert done.by_number[0] == 0
    assert set(done.results) <= {0, -1, -2}


@forks
def test_an_interrupt_before_anything_is_done_is_one():
    def work(k):
        time.sleep(60.0)

    threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        side_by_side(work, 2, 2)


@forks
@pytest.mark.parametrize("early", [True, False])
def test_an_interrupt_while_processes_are_begun_ends_them_too(early, monkeypatch):
    submit = ProcessPoolExecutor.submit

    def interrupted(*call):
        if early:
            signal.raise_signal(signal.SIGINT)
        begun = submit(*call)
        signal.raise_signal(signal.SIGINT)
        return begun

    monkeypatch.setattr(ProcessPoolExecutor, "submit", interrupted)
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        side_by_side(lambda _: time.sleep(60.0), 4, 2)
    while active_children() and time.monotonic() - begun < 30:  # the pool waits for them too, in a thread of its own
        time.sleep(0.05)
    assert not active_children()
    assert time.monotonic() - begun < 30


@forks
@pytest.mark.parametrize("line", range(1, 7))
def test_an_interrupt_at_any_line_before_work_is_begun_keeps_it_from_beginning(line, monkeypatch):
    begun, lines = [], itertools.count(1)
    monkeypatch.setattr(processes, "_child", {"work": begun.append, "working": False, "stopped": False})
    before = signal.signal(signal.SIGUSR1, processes._interrupted)

    def trace(frame, event, _):
        if frame.f_code is processes._do.__code__:
            if event == "line" and next(lines) == line:
                signal.raise_signal(signal.SIGUSR1)
            return trace
        return None

    usual = sys.gettrace()
    sys.settrace(trace)
    try:
        with pytest.raises(KeyboardInterrupt):
            processes._do(0)
    finally:
        sys.settrace(usual)
        signal.signal(signal.SIGUSR1, before)
    assert not begun


@forks
@pytest.mark.parametrize("name", ["kinematic", "msnn_lat"])
def test_a_fit_does_not_depend_on_how_many_work_at_it(name):
    lap = read(shipped("racer_train"), "roboracer").rows(0, 500)
    model = prepared(name, lap) if name == "msnn_lat" else build(name, vehicle=vehicle("roboracer"))
    found = [fit(model, [lap], how=FitOptions(starts=3, seed=4, jobs=jobs, solver="gauss-newton")) for jobs in (1, 2)]
    alone, together = (own.stages[-1] for own in found)
    np.testing.assert_allclose(found[1].model.values, found[0].model.values, rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(together.starts, alone.starts, rtol=1e-9)
    assert len(alone.starts) == 3
    assert together.strengths == alone.strengths
    assert together.tried == alone.tried
    assert together.cpu_seconds > 0.2 * alone.cpu_seconds  # of other processes too


def test_threads_fork_nothing():
    """A lock of CasADi that another thread held stayed locked in the child: a compilation waited for ever."""
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(elsewhere, os.getpid).result() == os.getpid()


def test_what_is_done_elsewhere_is_handed_over():
    assert (elsewhere(os.getpid) != os.getpid()) == FORKS

    def fails():
        raise CannotCompile("There is no C for it.")

    with pytest.raises(CannotCompile, match="no C for it"):
        elsewhere(fails)


@contextmanager
def interrupted(after):
    """An interrupt so many seconds later, as the command takes it."""
    before = signal.signal(signal.SIGUSR2, lambda _, frame: interrupt(frame))
    waiting = threading.Timer(after, os.kill, (os.getpid(), signal.SIGUSR2))
    waiting.start()
    try:
        with interrupts_return():
            yield
    finally:
        waiting.join()
        signal.signal(signal.SIGUSR2, before)


@forks
def test_what_is_done_elsewhere_ends_with_an_interrupt(monkeypatch):
    children, fork = [], os.fork
    monkeypatch.setattr(os, "fork", lambda: children.append(fork()) or children[-1])
    begun = time.monotonic()
    with interrupted(0.2), pytest.raises(KeyboardInterrupt):
        elsewhere(lambda: time.sleep(60))
    assert time.monotonic() - begun < 30
    (child,) = children
    with pytest.raises(ChildProcessError):  # it is not left behind
        os.waitpid(child, os.WNOHANG)


def pause(seconds):
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        pass


class Slow:
    def __SX__(self):
        pause(0.3)
        return cs.SX(1)


class SlowToGo:
    def __del__(self):
        pause(0.3)


def seen_to_go():
    class Plain:
        pass

    plain = Plain()
    watched = weakref.ref(plain, lambda _: pause(0.3))
    del plain
    return watched


@forks
@pytest.mark.parametrize("work", [lambda: cs.sin(Slow()), lambda: SlowToGo() and None, seen_to_go])
def test_interrupts_are_not_lost_where_python_swallows_them(work):
    with interrupted(0.1), pytest.raises(KeyboardInterrupt):
        _ = work(), pause(1.0)
