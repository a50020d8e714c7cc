"""Noise and parameters from the data, of vehicles whose noise and parameters are known."""

from dataclasses import replace

import numpy as np
import pytest
from compiled import needs_compiler
from filter_cases import C_R, NOISES, WALKS, changed, shaken, true_simrod
from linear_bicycle import SIMROD

from greybox_id.base.errors import BadInput
from greybox_id.filters.filtering import filtering, laid
from greybox_id.filters.kernel import SigmaPoints
from greybox_id.filters.state_space import StateSpace
from greybox_id.filters.tuning import _Search, model_coordinates, noise_coordinates, scatter_of, start_levels, tuned
from greybox_id.filters.verb import track

pytestmark = needs_compiler

READ = ("yaw_rate", "a_y")


def searched(recording, model, stated=None):
    space = StateSpace(model, ())
    made = filtering(space, "ekf", SigmaPoints())
    levels = start_levels(space, scatter_of(recording, READ), READ, stated or {})
    p = np.concatenate([model.values, levels.values])
    return made, laid(space, recording, model.values, READ), p, levels


def test_the_noise_of_a_vehicle_is_found():
    """All four sizes within 20 %, from 40 s."""
    recording, _ = shaken(40.0)
    found = track(true_simrod(), recording, tune=40.0).noise
    for name, size in (WALKS | NOISES).items():
        assert found[name] == pytest.approx(size, rel=0.2)


def test_stated_noise_is_not_tuned():
    recording, _ = shaken(10.0)
    found = track(true_simrod(), recording, noise={"noise_a_y": 0.4}, known={"walk_v_y": 0.07, "walk_roll": 1.0}).noise
    assert (found["noise_a_y"], found["walk_v_y"]) == (0.4, 0.07)
    assert found["noise_yaw_rate"] != pytest.approx(0.01, rel=1e-6)


def test_nothing_is_tuned_behind_the_beginning():
    """What comes later tells no more than where tuning starts from, by how it scatters."""
    recording, _ = shaken(20.0)
    later = np.arange(len(recording)) >= 500
    other = changed(recording, a_y=np.where(later, 2 * recording["a_y"], recording["a_y"]))
    found, again = (track(true_simrod(), own, tune=10.0).noise for own in (recording, other))
    assert found == pytest.approx(again, rel=1e-3)


def test_tuning_makes_what_was_read_more_likely():
    recording, _ = shaken(20.0)
    made, runs, p, levels = searched(recording, true_simrod())
    found = tuned(made, runs, p, noise_coordinates(made, p, levels.open), [])
    assert found.cost[1] < found.cost[0]
    assert found.cost[1] == float(made.costs(runs, found.p[None])[0])
    np.testing.assert_array_equal(found.p[: true_simrod().size], p[: true_simrod().size])
    assert len(found.moves) == 0


def test_slopes_are_those_of_the_costs():
    recording, _ = shaken(5.0)
    model = true_simrod()
    model = model.with_parameters(replace(model["I_z"], fixed=False))
    made, runs, p, levels = searched(recording, model)
    coordinates = [*noise_coordinates(made, p, levels.open), *model_coordinates(model, ())]
    search = _Search(made, runs, p, coordinates)
    at = np.array([c.of(p[c.place]) for c in coordinates]) + 0.1
    _, slope = search.surprise(at)
    step = 1e-4
    expected = [(search.surprise(at + step * e)[0] - search.surprise(at - step * e)[0]) / (2 * step)
                for e in np.eye(len(at))]  # fmt: skip
    np.testing.assert_allclose(slope, expected, rtol=1e-3, atol=1e-3 * np.max(np.abs(expected)))


@pytest.mark.parametrize("name", ["I_z", "C_alpha_r"])
def test_a_parameter_is_calibrated_along_and_its_sd_covers(name):
    recording, _ = shaken(40.0, amplitude=0.04)
    truth = {"I_z": SIMROD["I_z"], "C_alpha_r": C_R}[name]
    model = true_simrod(**{name: 0.8 * truth})
    model = model.with_parameters(replace(model[name], fixed=False))
    found = track(model, recording, noise=NOISES, calibrate=40.0)
    ((own, (value, sd)),) = found.calibrated.items()
    assert own == name
    assert abs(value - truth) < 3 * sd
    assert sd < 0.1 * truth


def test_what_is_held_is_not_calibrated():
    recording, _ = shaken(5.0)
    assert track(true_simrod(), recording, calibrate=5.0, noise=WALKS | NOISES).calibrated == {}


def test_a_filter_that_diverges_from_the_start_is_a_sentence():
    recording, _ = shaken(5.0)
    made, runs, p, levels = searched(recording, true_simrod())
    p[0] = np.nan
    with pytest.raises(BadInput, match="The filter diverges before anything is tuned"):
        tuned(made, runs, p, noise_coordinates(made, p, levels.open), [])
