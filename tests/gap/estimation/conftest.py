"""A drive and its bench, with the effects that a test module has in HERE."""

import pytest
from driven import driven
from gap_cases import CAR

from greybox_id.gap.estimation.bench import Bench
from greybox_id.models.registry import build


@pytest.fixture(scope="module")
def drive(request):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GREYBOX_COMPILE", "0")
        return driven("single_track", runs=2, seconds=5.0, effects=request.module.HERE)


@pytest.fixture
def bench(request, drive):
    return Bench(build("single_track", None, request.module.HERE, CAR), [drive])
