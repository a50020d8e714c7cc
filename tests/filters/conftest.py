"""Tests of filters find the cases they share beside them, and a cache of their own for what they compile."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GREYBOX_CACHE", str(tmp_path_factory.mktemp("libraries")))
        patch.delenv("GREYBOX_COMPILE", raising=False)
        yield
