"""What all tests share: the folder of real recordings, and the --slow option."""

import os
import signal
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from order import slow_first, third

# how long an example takes, or drawing one, is a matter of the machine and what else runs on it; fixtures that tests
# with examples share are folders that every example may write over
settings.register_profile(
    "any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture]
)
settings.load_profile("any machine")


def pytest_configure():
    """Let interrupts through where tests run in the background of a shell, which has them ignored."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser):
    parser.addoption("--slow", action="store_true", help="also run tests that take more than a few seconds")
    parser.addoption(
        "--sample",
        metavar="TEXT",
        help="with --slow: of examinations, the third that this text, such as a commit, draws",
    )


def pytest_collection_modifyitems(config, items):
    if config.getoption("--slow"):
        if config.getoption("--sample"):
            kept = third(items, config.getoption("--sample"))
            config.hook.pytest_deselected(items=[item for item in items if item not in kept])
            items[:] = [item for item in items if item in kept]
        items[:] = slow_first(items, int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")))
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
