"""A lidar on a track, beside walls that are lines."""

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_lab.driving.racing.lidar import BEAMS, FIELD_OF_VIEW, RANGE, Lidar
from greybox_lab.driving.racing.rules import Rules
from greybox_lab.driving.racing.worlds import world

pytestmark = pytest.mark.usefixtures("_uncompiled")
ANGLES = np.linspace(-0.5, 0.5, BEAMS) * FIELD_OF_VIEW


def walled(track, x, y, heading):
    """m along a beam to where it crosses a wall, both drawn as polygons."""
    beam, normal = np.array([np.cos(heading), np.sin(heading)]), np.stack([-np.sin(track.yaw), np.cos(track.yaw)], 1)
    shortest = RANGE
    for side in (-1.0, 1.0):
        wall = np.stack([track.x, track.y], 1) + side * track.half_width * normal
        edge, off = np.roll(wall, -1, axis=0) - wall, wall - [x, y]
        crossing = beam[0] * edge[:, 1] - beam[1] * edge[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            along = (off[:, 0] * edge[:, 1] - off[:, 1] * edge[:, 0]) / crossing
            share = (off[:, 0] * beam[1] - off[:, 1] * beam[0]) / crossing
        hit = (along > 0) & (share >= 0) & (share <= 1)
        shortest = min(shortest, np.min(along[hit], initial=RANGE))
    return shortest


def test_ranges_are_those_to_the_walls():
    track, generator = world(1).track, np.random.default_rng(3)
    lidar, errors = Lidar(track), []
    for _ in range(20):
        place = [3 * generator.random() * track.length, generator.uniform(-0.7, 0.7) * track.half_width, 0.3]
        s = np.array(place[:1])
        x, y = (float(track.line(name, s)[0][0]) for name in ("x", "y"))
        yaw = float(np.interp(s[0] % track.length, track.s, track.yaw))
        x, y = x - place[1] * np.sin(yaw), y + place[1] * np.cos(yaw)
        found = lidar.scan(np.array([place]))[0]
        errors.append(found - [walled(track, x, y, yaw + place[2] + angle) for angle in ANGLES])
    assert np.quantile(np.abs(errors), 0.95) < 0.005
    assert np.mean(np.abs(errors) > 0.05) < 0.002  # a beam that grazes a wall passes it or does not


def test_the_published_observation_has_112_numbers_and_no_step_of_yaw_where_a_lap_ends():
    racing = world(2, observation="lidar", action="speed")
    assert racing.size == 112
    seen = racing.observe()
    assert seen.shape == (2, 112)
    assert np.all((seen[:, :108] >= 0) & (seen[:, :108] <= 1))
    lidar, end = Lidar(racing.track), racing.track.length
    around = lidar.scan(np.array([[end + off, 0.0, 0.0] for off in (-0.02, -0.01, 0.0, 0.01)]))
    assert np.max(np.abs(np.diff(around, axis=0))) < 0.1


def test_noise_is_a_lanes_own_and_beams_are_lost():
    many, alone = (world(n, observation="lidar", noise=True, action="speed") for n in (3, 1))
    many.reset(np.ones(3, dtype=bool), [4, 5, 6])
    alone.reset(np.ones(1, dtype=bool), [6])
    for _ in range(20):
        assert np.array_equal(many.observe()[2], alone.observe()[0])
        many.step(np.tile([0.1, 0.5], (3, 1)))
        alone.step(np.array([[0.1, 0.5]]))
    lidar, ranges = Lidar(many.track), np.full((200, BEAMS), 3.0)
    read = lidar.noisy(ranges, [np.random.default_rng(k) for k in range(200)])
    lost = read == RANGE
    assert np.mean(lost) == pytest.approx(0.02, abs=0.005)
    assert np.std(read[~lost]) == pytest.approx(0.04, rel=0.05)


def test_there_is_no_third_observation():
    with pytest.raises(BadInput, match="no observation 'camera'"):
        Rules(observation="camera")
