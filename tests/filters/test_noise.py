"""Where the sizes of noises start from."""

import numpy as np
import pytest
from filter_cases import driven_space

from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import Recording
from greybox_id.filters.tuning import origins, resolution_of, scatter_of, start_levels, units


@pytest.fixture(scope="module")
def space():
    return driven_space(parameters=("C_alpha_f", "F_yr"), disturbances=("road_bank",), coloured=("a_y",))[0]


READ = ("yaw_rate", "a_y")
SCATTER = {"yaw_rate": 0.004, "a_y": 0.3}


def levels(space, **stated):
    found = start_levels(space, SCATTER, READ, stated)
    return dict(zip(space.noises, found.values, strict=True)), found.open


def test_readings_are_as_noisy_as_they_scatter(space):
    sizes, _ = levels(space)
    assert sizes["noise_yaw_rate"] == 0.004
    assert sizes["noise_a_y"] == 0.3
    assert sizes["colour_a_y"] == pytest.approx(0.3 * 0.3)
    assert sizes["memory_a_y"] == 1.0


def test_states_and_what_is_tracked_walk_by_a_share_of_their_size(space):
    sizes, _ = levels(space)
    assert sizes["walk_v_x"] == pytest.approx(0.1)
    assert sizes["walk_yaw_rate"] == pytest.approx(0.1 * 0.1)
    assert sizes["walk_stiffness_f"] == pytest.approx(0.1 * 0.2)
    assert sizes["walk_F_yr"] == pytest.approx(0.3 * 1457.2 * 9.81)  # as much as it is not known in a second
    assert sizes["memory_road_bank"] == 5.0


def test_what_is_stated_stays_and_the_rest_is_open(space):
    sizes, left = levels(space, walk_v_y=0.05, noise_a_y=1.2)
    assert (sizes["walk_v_y"], sizes["noise_a_y"]) == (0.05, 1.2)
    assert "walk_v_y" not in left
    assert "noise_a_y" not in left
    assert {"walk_v_x", "noise_yaw_rate", "memory_road_bank", "colour_a_y"} <= set(left)


def test_noise_of_what_is_not_read_is_not_open(space):
    assert {"noise_v_x", "noise_v_y", "noise_a_x"}.isdisjoint(levels(space)[1])


def test_every_noise_has_a_unit_and_an_origin(space):
    told = units(space)
    assert set(told) == set(space.noises)
    assert (told["walk_v_y"], told["walk_stiffness_f"], told["walk_F_yr"]) == ("m/s", "1", "N")
    assert (told["noise_a_y"], told["colour_a_y"], told["memory_a_y"]) == ("m/s^2", "m/s^2", "s")
    found = origins(space, {"walk_v_y": 0.1}, ["noise_a_y"])
    assert (found["walk_v_y"], found["noise_a_y"], found["noise_v_x"]) == ("stated", "tuned", "guessed")


@pytest.mark.parametrize("size", [0.0, -1.0, np.nan, np.inf])
def test_a_size_that_is_no_number_above_zero_is_refused(space, size):
    with pytest.raises(BadInput, match=r"The noise walk_v_y = .* must be a number above zero"):
        levels(space, walk_v_y=size)


def test_a_noise_there_is_not_is_refused_with_what_was_meant(space):
    with pytest.raises(BadInput, match=r"There is no noise walk_vy\. Did you mean walk_v_y\?"):
        levels(space, walk_vy=0.1)


def scattering(held=1):
    """White noise of 0.05 on something smooth, missing now and then."""
    random, time = np.random.default_rng(0), 0.01 * np.arange(30_000)
    values = np.sin(time) + 0.05 * random.standard_normal(len(time))
    values = np.repeat(values[::held], held)[: len(time)]
    values[random.random(len(values)) < 0.1] = np.nan
    return scatter_of(Recording("r", time, {"yaw_rate": values}), ("yaw_rate",))["yaw_rate"]


def test_scatter_is_that_of_white_noise_on_something_smooth():
    assert scattering() == pytest.approx(0.05, rel=0.02)


def test_where_a_reading_is_held_between_updates_its_scatter_is_told_within_a_factor_of_two():
    assert 0.025 < scattering(held=3) < 0.1


def test_what_never_changes_has_some_scatter_all_the_same():
    recording = Recording("r", 0.01 * np.arange(50), {"yaw_rate": np.zeros(50), "a_y": np.full(50, np.nan)})
    found = scatter_of(recording, ("yaw_rate", "a_y"))
    assert all(0 < size < np.inf for size in found.values())


def test_the_least_noise_is_a_step_over_the_root_of_twelve_and_a_share_of_the_scatter():
    rng, time = np.random.default_rng(0), 0.01 * np.arange(2000)
    fine = np.sin(time) + 0.01 * rng.standard_normal(len(time))
    floors = resolution_of(
        Recording("r", time, {"a_y": fine, "yaw_rate": np.round(np.sin(time), 2)}), ["a_y", "yaw_rate"]
    )
    assert floors["a_y"] == pytest.approx(0.2 * 0.01, rel=0.1)
    assert floors["yaw_rate"] == pytest.approx(0.01 / np.sqrt(12), rel=0.05)
