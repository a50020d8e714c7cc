"""The same digits however many processes share the work, and whether or not the cache holds compiled code."""

import json

import pytest
from calling import greybox
from driven import driven, written

from greybox_id.base.processes import FORKS


@pytest.fixture(scope="module")
def lap(tmp_path_factory):
    return written(driven("lateral", runs=2, seconds=4.0, seed=3), tmp_path_factory.mktemp("lap") / "lap.csv")


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("GREYBOX_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("GREYBOX_COMPILE", raising=False)


def fitted(lap, folder, *more):
    called = greybox("fit", "--model", "lateral", "--vehicle", "full_size_car", lap, "--starts", "4", "--out", folder,
                     *more)  # fmt: skip
    assert called.code == 0, called.err
    body = json.loads((folder / "fit.json").read_text())
    for stage in body["stages"]:
        del stage["cpu_seconds"], stage["certificate"]["cpu_seconds"]
    return {name: own for name, own in body.items() if name not in ("command", "checksum")}


def test_a_fit_has_the_same_digits_from_a_cold_cache_and_from_a_warm_one(lap, tmp_path, cache):
    assert fitted(lap, tmp_path / "cold") == fitted(lap, tmp_path / "warm")


@pytest.mark.skipif(not FORKS, reason="everything is done in one process here")
def test_a_fit_has_the_same_digits_from_one_process_and_from_several(lap, tmp_path, cache):
    one, two = fitted(lap, tmp_path / "one"), fitted(lap, tmp_path / "two", "--jobs", "2")
    assert one == two


@pytest.mark.skipif(not FORKS, reason="everything is done in one process here")
def test_profiles_have_the_same_digits_from_one_process_and_from_several(lap, tmp_path, cache):
    fitted(lap, tmp_path)
    call = ["profile", tmp_path / "fit.json", "--parameter", "I_z", "--parameter", "m", "--json"]
    assert greybox(*call).told == greybox(*call, "--jobs", "2").told
