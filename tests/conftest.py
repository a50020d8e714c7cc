"""What all tests share: the folder of real recordings, and the --slow option."""

import os
import signal
from pathlib import Path

import pytest


def pytest_configure():
    """Let interrupts through where tests run in the background of a shell, which has them ignored."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser):
    parser.addoption("--slow", action="store_true", help="also run tests that take more than a few seconds")


def pytest_collection_modifyitems(config, items):
    if config.getoption("--slow"):
        return
    for item in items:
        if "slow" in item.keywords:
            item.add_marker(pytest.mark.skip(reason="slow; run with --slow"))


@pytest.fixture(scope="module")
def _uncompiled():
    """Small problems are solved sooner than C is compiled."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GREYBOX_COMPILE", "0")
        yield


@pytest.fixture
def nothing_stays_known():
    """Models and effects of one's own that a test lets be known are unknown after it."""
    from greybox_id.models import registry

    tables = (registry.MODELS, registry.EFFECTS)
    before = [dict(table) for table in tables]
    yield
    for table, own in zip(tables, before, strict=True):
        table.clear()
        table.update(own)


@pytest.fixture
def real_data() -> Path:
    """Folder of the real recordings, from the environment variable GREYBOX_DATA."""
    folder = os.environ.get("GREYBOX_DATA")
    if not folder:
        pytest.skip("GREYBOX_DATA is not set; it names the folder with the real recordings.")
    return Path(folder)
