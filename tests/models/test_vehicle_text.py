"""Vehicles written and read back."""

import math
import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from greybox_id import __version__
from greybox_id.base.errors import BadInput
from greybox_id.base.guard import VEHICLE_MARK
from greybox_id.models.vehicle import (
    ChosenModel,
    Stated,
    StatedModelError,
    TrackingPlan,
    Vehicle,
    shipped_vehicles,
    vehicle,
    write_vehicle,
)

NUMBER = st.floats(allow_nan=False, allow_infinity=False, min_value=-1e99, max_value=1e99)
ABOVE_ZERO = st.floats(min_value=1e-300, max_value=1e99)
TEXT = st.text(alphabet=st.characters(exclude_categories=["Cs"]), max_size=20)
VALUE = st.builds(Stated, NUMBER, st.none() | ABOVE_ZERO, source=TEXT)
NAME = TEXT.filter(bool)
MODEL = st.builds(
    ChosenModel,
    TEXT.filter(str.strip),
    st.dictionaries(
        NAME.filter(lambda n: n not in ("name", "effects")),
        st.booleans() | st.integers(-9, 9) | NUMBER | TEXT | st.lists(NUMBER, max_size=3),
        max_size=3,
    ),
    st.dictionaries(NAME, VALUE, max_size=2),
)
TRACKING = st.builds(
    TrackingPlan, st.lists(NAME, min_size=1, max_size=2).map(tuple), st.lists(NAME, max_size=2).map(tuple),
    st.dictionaries(NAME, ABOVE_ZERO, max_size=2),
)  # fmt: skip
VEHICLE = st.builds(
    Vehicle,
    TEXT.filter(str.strip),
    st.dictionaries(NAME, VALUE, max_size=4),
    st.dictionaries(NAME, st.builds(Stated, st.none() | NUMBER, ABOVE_ZERO, source=TEXT), max_size=3),
    st.dictionaries(st.sampled_from(["v_x", "yaw_rate"]), ABOVE_ZERO),
    st.none() | ABOVE_ZERO,
    st.none() | MODEL,
    st.none() | TRACKING,
    st.dictionaries(st.sampled_from(["F_y", "F_x"]), st.builds(StatedModelError, *[st.none() | ABOVE_ZERO] * 3)),
    TEXT,
)


@pytest.mark.parametrize("suffix", ["toml", "json"])
@pytest.mark.parametrize("name", shipped_vehicles())
def test_a_shipped_vehicle_is_read_back_as_it_was(tmp_path, name, suffix):
    path = write_vehicle(vehicle(name), tmp_path / f"car.{suffix}")
    assert vehicle(path) == vehicle(name)


@pytest.mark.parametrize("suffix", ["toml", "json"])
@settings(max_examples=100)
@given(car=VEHICLE)
def test_any_vehicle_is_read_back_as_it_was(tmp_path, car, suffix):
    assert vehicle(write_vehicle(car, tmp_path / f"car.{suffix}")) == car


def test_it_reads_as_a_person_would_write_it(tmp_path):
    car = Vehicle(
        "car",
        {"m": Stated(1457.2, 4.4, source="scale"), "l_f": Stated(1.3), "I_z": Stated(2e3, min=1e3, max=math.inf)},
        {"steering_lag": Stated(sd=0.003)},
        {"yaw_rate": 0.01},
        0.5,
        ChosenModel(
            "single_track", {"tyre": "brush"}, {"steering_delay": Stated(0.03, 0.002), "mass_change": Stated(1.1)}
        ),
    )
    assert write_vehicle(car, tmp_path / "car.toml").read_text() == (
        f"{VEHICLE_MARK} {__version__}\n"
        'name = "car"\n'
        "steer_max = 0.5\n"
        "\n"
        "[model]\n"
        'name = "single_track"\n'
        'tyre = "brush"\n'
        "effects = { steering_delay = { value = 0.03, sd = 0.002 }, mass_change = 1.1 }\n"
        "\n"
        "[parameters]\n"
        'm = { value = 1457.2, sd = 4.4, source = "scale" }\n'
        "l_f = 1.3\n"
        "I_z = { value = 2000.0, min = 1000.0, max = inf }\n"
        "\n"
        "[effects]\n"
        "steering_lag = { sd = 0.003 }\n"
        "\n"
        "[noise]\n"
        "yaw_rate = 0.01\n"
    )


def test_settings_a_model_leaves_open_are_left_out(tmp_path):
    chosen = ChosenModel("msnn_lat", {"v_x": None, "n_v": 2, "lat": {"steer": [0.1], "q": None}})
    path = write_vehicle(Vehicle("car", model=chosen), tmp_path / "car.toml")
    assert tomllib.loads(path.read_text())["model"] == {"name": "msnn_lat", "n_v": 2, "lat": {"steer": [0.1]}}


def test_a_file_already_there_is_replaced_whole(tmp_path):
    path = tmp_path / "car.toml"
    path.write_text("name = 'old'\n" * 1000)
    write_vehicle(Vehicle("new"), path)
    assert path.read_text() == f'{VEHICLE_MARK} {__version__}\nname = "new"\n'
    assert list(tmp_path.iterdir()) == [path]


def test_other_files_than_vehicle_files_are_not_written(tmp_path):
    with pytest.raises(BadInput, match=r"ends in .toml or .json"):
        write_vehicle(Vehicle("car"), tmp_path / "car.txt")
    assert not list(tmp_path.iterdir())
