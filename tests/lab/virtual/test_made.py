"""Synthetic recordings are made from a seed."""

from pathlib import Path

import pytest
from calling import greybox, refused

from greybox_id.datasets.read import read
from greybox_id.datasets.shipped import shipped
from greybox_lab.virtual.made import MADE


def made(name, folder, *more):
    """Relative path -> content of what the command makes in a folder of its own."""
    told = greybox("datasets", "make", name, "--out", folder, "--json", *more).told
    assert {Path(path) for path in told["files"]} <= set(folder.rglob("*"))
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.slow
@pytest.mark.parametrize("name", MADE)
def test_what_is_made_twice_is_the_same_to_the_last_byte(name, tmp_path):
    first = made(name, tmp_path / "a")
    assert first
    assert made(name, tmp_path / "b") == first


@pytest.mark.slow
def test_the_racer_of_the_package_is_made_again(tmp_path):
    for path, content in made("racer", tmp_path).items():
        assert content == shipped(path.stem).read_bytes()


@pytest.mark.slow
def test_another_seed_is_another_vehicle(tmp_path):
    (lap,) = made("virtual_lap", tmp_path / "a", "--seed", 3).values()
    assert [lap] != list(made("virtual_lap", tmp_path / "b", "--seed", 4).values())
    assert {"v_x", "yaw_rate", "steer"} <= set(read(tmp_path / "a" / "virtual_lap_3.csv").signals)


def test_what_cannot_be_made_is_named(tmp_path):
    assert "Did you mean racer?" in refused("datasets", "make", "racr", "--out", tmp_path)
