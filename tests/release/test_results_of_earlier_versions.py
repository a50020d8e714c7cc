"""Results that earlier versions wrote are read for ever, with the numbers that they had."""

import json

import pytest
from write_results import RESULTS, numbers

from greybox_id.base.version import __version__

VERSIONS = sorted(folder.name for folder in RESULTS.iterdir())


def test_results_of_the_first_and_of_this_version_are_kept():
    assert {"0.1", __version__} <= set(VERSIONS)


@pytest.mark.parametrize("version", VERSIONS)
def test_fits_gaps_and_vehicles_are_read_with_the_numbers_that_they_had(version):
    kept = json.loads((RESULTS / version / "numbers.json").read_text(encoding="utf-8"))
    assert kept["version"].startswith(version)
    assert numbers(RESULTS / version) == {
        name: value if isinstance(value, str) else _approx(value) for name, value in kept.items()
    }


def _approx(value):
    if isinstance(value, dict):
        return {name: _approx(inner) for name, inner in value.items()}
    return pytest.approx(value, rel=1e-12)
