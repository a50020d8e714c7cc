"""Synthetic recordings are made from a seed."""

from pathlib import Path

import pytest
from calling import greybox, refused

from greybox_id.datasets.read import read
from greybox_id.datasets.shipped import shipped


@pytest.mark.slow
def test_the_racer_of_the_package_is_made_again(tmp_path):
    told = greybox("datasets", "make", "racer", "--out", tmp_path, "--json").told
    for path in told["files"]:
        name = path.rsplit("/", 1)[-1]
        again, before = read(path, "roboracer"), read(shipped(name.removesuffix(".csv")), "roboracer")
        assert len(again) == len(before)


@pytest.mark.slow
def test_a_lap_of_a_virtual_vehicle_depends_on_its_seed_alone(tmp_path):
    def lap(place, seed):
        told = greybox("datasets", "make", "virtual_lap", "--out", tmp_path / place, "--seed", seed, "--json").told
        return Path(told["files"][0])

    first, again, other = lap("a", 3), lap("b", 3), lap("c", 4)
    assert first.read_bytes() == again.read_bytes() != other.read_bytes()
    assert {"v_x", "yaw_rate", "steer"} <= set(read(first).signals)


def test_what_cannot_be_made_is_named(tmp_path):
    assert "Did you mean racer?" in refused("datasets", "make", "racr", "--out", tmp_path)
