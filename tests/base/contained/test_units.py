"""Whatever ends a unit of work ends nothing else, and is told."""

import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest

from greybox_id.base.contained.process import Broken
from greybox_id.base.contained.units import Nursery

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes are forked on Linux")


@pytest.fixture(scope="module")
def nursery():
    sys.path.insert(0, str(Path(__file__).parent))
    own = Nursery()
    yield own
    own.close()
    sys.path.remove(str(Path(__file__).parent))


def done(nursery, name, seconds=20.0, memory=200e6):
    return nursery.unit(f"working:{name}", {"word": "ä"}, seconds, memory)


def test_a_unit_tells_what_it_found(nursery):
    ended = done(nursery, "well")
    assert (ended.how, ended.messages) == ("done", [{"a": 1}, {"told": "ä"}])
    assert ended.peak_mb > 1


@pytest.mark.parametrize(
    ("name", "how"),
    [
        ("raising", "ZeroDivisionError: division"), ("crashing", "ended by SIGSEGV"), ("eating", "memory"),
        ("reserving", "memory"), ("leaving_children", "done"),
    ],
)  # fmt: skip
def test_what_ends_a_unit_is_told_and_the_next_one_is_done(nursery, name, how):
    assert done(nursery, name).how == how
    assert done(nursery, "well").how == "done"


def test_what_a_unit_told_before_it_ended_is_kept(nursery):
    assert done(nursery, "crashing").messages == [{"a": 1}]


def test_what_a_unit_tells_is_heard_while_it_goes_on(nursery):
    heard = []
    ended = nursery.unit("working:slowly", {}, 20.0, 200e6, lambda body: heard.append((time.monotonic(), body)))
    (first, one), (second, two) = heard
    assert [one, two] == ended.messages == [{"at": 1}, {"at": 2}]
    assert second - first > 0.5


def test_a_nursery_that_is_closed_meanwhile_begins_nothing_more():
    nursery = Nursery()
    threading.Timer(3.0, nursery.close).start()
    began = time.monotonic()
    assert done(nursery, "sleeping", seconds=300.0).how != "done"
    assert time.monotonic() - began < 60


@pytest.mark.parametrize(("name", "hows"), [("sleeping", {"clock"}), ("spinning", {"time", "clock"})])
def test_what_hangs_meets_the_limit(nursery, name, hows):
    began = time.monotonic()
    assert done(nursery, name, seconds=0.5).how in hows  # on a busy machine what spins may meet either first
    assert time.monotonic() - began < 30


def test_work_that_is_not_there_is_a_sentence(nursery):
    with pytest.raises(Broken, match="No work can be done here"):
        done(nursery, "nothing")


def test_a_nursery_that_is_killed_is_started_again(nursery):
    done(nursery, "well")
    os.kill(nursery._held._process.pid, signal.SIGKILL)
    assert done(nursery, "well").how == "done"


def test_nothing_is_left_where_a_nursery_ends():
    nursery = Nursery()
    assert done(nursery, "well").how == "done"
    pid = nursery._held._process.pid
    nursery.close()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
