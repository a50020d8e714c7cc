"""Tests of filters find the cases they share beside them, and a cache of their own for what they compile."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="session")
def _libraries(tmp_path_factory):
    return tmp_path_factory.mktemp("libraries")


@pytest.fixture(scope="module", autouse=True)
def _own_cache(_libraries):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GREYBOX_CACHE", str(_libraries))
        patch.delenv("GREYBOX_COMPILE", raising=False)
        yield
