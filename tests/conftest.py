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


@pytest.fixture
def real_data() -> Path:
    """Folder of the real recordings, from the environment variable GREYBOX_DATA."""
    folder = os.environ.get("GREYBOX_DATA")
    if not folder:
        pytest.skip("GREYBOX_DATA is not set; it names the folder with the real recordings.")
    return Path(folder)
