"""What tests of commands read: a recording, a vehicle file and a fit."""

from pathlib import Path

import pytest
from calling import greybox
from driven import driven, written


@pytest.fixture(scope="session")
def made_files():
    """(folder, seed) -> files to read in the folder: lap, car and fit; those of another seed lead to other results."""

    def made(folder, seed=1):
        lap, car = written(driven("lateral", runs=1, seconds=4.0, seed=seed), folder / "lap.csv"), folder / "car.toml"
        car.write_bytes(Path("greybox_id/datasets/vehicles/full_size_car.toml").read_bytes())
        call = ["fit", "--model", "lateral", "--vehicle", car, lap, "--solver", "gauss-newton", "--horizon", "1"]
        assert greybox(*call, "--out", folder).code == 0
        return {"lap": lap, "car": car, "fit": folder / "fit.json"}

    return made
