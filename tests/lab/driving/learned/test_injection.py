"""A network that acts in a model: as it says, not at all where it says what the model says, and never unasked."""

from dataclasses import replace

import numpy as np
import pytest
from actuator_networks import network

from greybox_id.base.errors import BadInput
from greybox_id.fitting.requested_model import RequestedModel
from greybox_id.fitting.scores.metrics import simulate
from greybox_id.models.registry import with_effects
from greybox_id.models.vehicle import vehicle
from greybox_lab.driving.learned.injection import LEARNED, injected
from greybox_lab.driving.learned.net import ActuatorNet
from greybox_lab.driving.learned.open_loop import OpenLoop
from greybox_lab.driving.racing.stage import Period, stage
from greybox_lab.driving.racing.worlds import world

pytestmark = pytest.mark.usefixtures("_uncompiled")
STEP = 0.02


@pytest.fixture(scope="module")
def car():
    return RequestedModel("single_track", vehicle("roboracer")).model()


class Scaled(ActuatorNet):
    """Says what the model of motion says, times something."""

    by = 1.0

    def following(self, seen, own):
        return np.stack([self.by * own] * len(self.members))


def scaled(by, variant="paper"):
    plain = network(variant)
    made = Scaled(**{name: getattr(plain, name) for name in plain.__dataclass_fields__})
    object.__setattr__(made, "by", by)
    return made


def wiggling(own, steps, lanes, seed=0):
    """Commands of vehicles that steer to and fro, driving on."""
    rng = np.random.default_rng(seed)
    t, phase = own.period * np.arange(steps)[:, None], rng.uniform(0, 6, lanes)
    acting = np.zeros((steps, lanes, len(own.inputs)))
    acting[..., own.inputs.index("steer")] = 0.15 * np.sin(7.0 * t + phase)
    acting[..., own.inputs.index(own.drive)] = 0.3 * own.per_drive(own.equations.values)[0] ** -1
    return acting


def driven(own, acting, v_x=2.5):
    """(steps + 1, L, n + 3) states along commands, on a bend."""
    p = np.tile(own.equations.values, (acting.shape[1], 1))
    x = own.begun(v_x, own.equations.values)[0]
    z = [np.tile(np.concatenate([x, [0.0, 0.05, 0.02]]), (acting.shape[1], 1))]
    for commands in acting:
        z.append(own.advance(z[-1], commands, np.tile([0.2, 0.01, 0.0], (len(commands), 1)), p))
    return np.array(z)


def test_a_network_that_says_what_the_model_says_changes_nothing(car):
    plain, learned = Period(car, STEP), stage(injected(car, scaled(1.0)), STEP)
    acting, n = wiggling(plain, 100, 3), plain.size
    a, b = driven(plain, acting), driven(learned, acting)
    assert np.max(np.abs(a[..., plain.states.index("yaw_rate")])) > 0.5
    assert np.max(np.abs(a[..., :n] - b[..., :n])) < 1e-6
    assert np.max(np.abs(a[..., n:] - b[..., learned.size :])) < 1e-6


@pytest.mark.parametrize("weight", [1.0, 0.3])
def test_a_fifth_more_yaw_rate_arrives_as_said_and_the_rest_follows(car, weight):
    plain, learned = Period(car, STEP), stage(injected(car, scaled(1.2), weight), STEP)
    acting, r = wiggling(plain, 100, 2), plain.states.index("yaw_rate")
    z = driven(learned, acting)
    free, turned, straight = [], [], np.zeros((2, 3))
    for own, commands in zip(z[:-1], acting, strict=True):
        start = np.delete(own, np.s_[plain.size : learned.size], axis=1)
        free.append(plain.advance(start, commands, straight, np.empty((2, 0))))
        turned.append(learned.advance(own, commands, straight, np.empty((2, 0)))[:, -1] - free[-1][:, -1])
    free = np.array(free)
    more = z[1:, :, r] - free[..., r]
    assert np.allclose(more, 0.2 * weight * free[..., r], atol=1e-9)
    assert np.max(np.abs(more)) > 0.05 * weight
    assert np.allclose(turned, 0.5 * STEP * more, atol=1e-9)  # what comes on top grows evenly over the step
    v_y = plain.states.index("v_y")
    assert np.max(np.abs(z[1:, :, v_y] - free[..., v_y])) > 1e-4 * weight


def test_lateral_speed_is_that_of_a_network_that_says_it(car):
    learned = stage(injected(car, scaled(1.2, "abstract")), STEP)
    plain = Period(car, STEP)
    acting = wiggling(plain, 40, 2)
    z, columns = driven(learned, acting), [plain.states.index(name) for name in ("yaw_rate", "v_y")]
    for own, after, commands in zip(z[:-1], z[1:], acting, strict=True):
        start = np.delete(own, np.s_[plain.size : learned.size], axis=1)
        free = plain.advance(start, commands, np.tile([0.2, 0.01, 0.0], (2, 1)), np.empty((2, 0)))
        assert np.allclose(after[:, columns], 1.2 * free[:, columns], atol=1e-9)


def test_the_injection_is_no_empty_one(car):
    """What the published code computes and never uses."""
    for variant in ("paper", "abstract", "residual"):
        net = network(variant, car if variant == "residual" else None, size=0.3)
        plain, learned = Period(car, STEP), stage(injected(car, net), STEP)
        acting, r = wiggling(plain, 30, 2), plain.states.index("yaw_rate")
        apart = np.abs(driven(plain, acting)[..., r] - driven(learned, acting)[..., r])
        assert np.max(apart) > 0.05, variant


def test_the_network_sees_what_was_commanded_and_how_the_vehicle_moved(car):
    seen = []

    class Watching(Scaled):
        def following(self, windows, own):
            seen.append(windows.copy())
            return super().following(windows, own)

    plain = network("abstract")
    learned = stage(injected(car, Watching(**{n: getattr(plain, n) for n in plain.__dataclass_fields__})), STEP)
    acting = wiggling(learned, 20, 1)
    z = driven(learned, acting)
    states = [learned.states.index(name) for name in ("yaw_rate", "v_x", "v_y")]
    last = seen[-1][0]
    assert last.shape == (15, 5)
    for step in range(15):
        k = len(acting) - 1 - step
        assert np.allclose(last[step, :2], acting[k, 0, [learned.inputs.index("steer"), learned.inputs.index("drive")]])
        assert np.allclose(last[step, 2:], z[k, 0, states])
    first = seen[0][0]
    assert np.all(first[:, 3] == 2.5)  # the past it begins with is the model's straight on, not zeros


def test_several_networks_that_part_leave_the_model_as_it_is(car):
    far = network("paper", members=3, size=0.3, sigma=1e-6)
    plain, learned = Period(car, STEP), stage(injected(car, far), STEP)
    acting = wiggling(plain, 30, 2)
    assert np.max(np.abs(driven(plain, acting)[..., :3] - driven(learned, acting)[..., :3])) < 1e-3
    near = stage(injected(car, replace(far, sigma=np.array([1e6]))), STEP)
    mean = stage(injected(car, far, 1.0), STEP)
    assert np.allclose(driven(near, acting), driven(mean, acting), atol=1e-6)
    assert np.max(np.abs(driven(plain, acting)[..., :3] - driven(mean, acting)[..., :3])) > 0.05


def test_a_world_drives_with_it_and_a_lane_is_the_same_alone_or_among_others(car):
    twin = injected(car, network("abstract", size=0.02, members=2))
    many, alone = (world(n, model=twin, action="speed", randomise="hand", noise=True) for n in (4, 1))
    many.reset(np.ones(4, dtype=bool), [20, 21, 22, 23])
    alone.reset(np.ones(1, dtype=bool), [22])
    for k in range(60):
        action = np.tile([0.2 * np.sin(0.2 * k), 0.1], (4, 1))
        assert np.array_equal(many.observe()[2], alone.observe()[0])
        steps = many.step(action), alone.step(action[:1])
        assert [column[2] for column in steps[0]] == [column[0] for column in steps[1]]


def test_a_network_of_a_shorter_step_acts_several_times_a_period(car):
    half = injected(car, scaled(1.2), 1.0)
    half = injected(car, replace(half.net, sample_time=0.01), 1.0)
    twice, once = stage(half, 0.02), stage(half, 0.01)
    acting = wiggling(twice, 10, 2)
    fine = np.repeat(acting, 2, axis=0)
    assert np.allclose(driven(twice, acting)[-1], driven(once, fine)[-1], atol=1e-12)


def test_what_does_not_go_together_is_said(car):
    net = network("paper")
    with pytest.raises(BadInput, match=r"steps of 0\.02 s, and a period of 0.05 s is not a whole number"):
        world(1, model=injected(car, net), period=0.05)
    with pytest.raises(BadInput, match="not a whole number"):
        world(1, model=injected(car, net), period=0.01)
    with pytest.raises(BadInput, match=r"delays commands .delay of steer 30 ms"):
        injected(with_effects(car, {"steering_delay": 0.03}), net)
    with pytest.raises(BadInput, match="has a network already"):
        injected(injected(car, net), net)
    with pytest.raises(BadInput, match="has other parameter values"):
        injected(with_effects(car, {"grip_scale": 0.8}), network("residual", car))
    with pytest.raises(BadInput, match="cannot drive along a track"):
        injected(RequestedModel("lateral", vehicle("roboracer")).model(), net)
    with pytest.raises(BadInput, match="has no equations of motion"):
        injected(RequestedModel("msnn_lat", None).model(), net)
    with pytest.raises(BadInput, match="from 0 to 1"):
        injected(car, net, 1.5)
    with pytest.raises(BadInput, match="one network has no spread"):
        injected(car, net, "spread")
    with pytest.raises(BadInput, match="reads ax_force"):
        injected(car, replace(network("abstract"), channel="ax_force"))


def test_whatever_needs_continuous_time_refuses_it_and_its_physics_is_the_model(car, lap):
    twin = injected(car, network("paper"))
    assert twin.effects == (*car.effects, LEARNED)
    assert repr(twin).startswith("Model single_track + learned_yaw")
    with pytest.raises(BadInput, match="no equations in continuous time"):
        simulate(twin, lap)
    assert twin.physics == car
    late = with_effects(twin, {"grip_scale": 0.9})
    assert late.physics.effects == ("grip_scale",)
    assert late.net is twin.net


def test_open_loop_is_the_models_free_run_and_needs_what_was_before(car, lap):
    found = OpenLoop(car, lap).horizons((0.02, 1.0))
    assert max(found[1.0].rms().values()) < 1e-6  # the lap is driven by this very model
    assert max(OpenLoop(injected(car, scaled(1.0)), lap).ahead(1.0).rms().values()) < 1e-6
    assert OpenLoop(injected(car, scaled(1.2)), lap).ahead(1.0).rms()["yaw_rate"] > 0.05
    with pytest.raises(BadInput, match="need 25 rows before them"):
        OpenLoop(car, lap.rows(0, 60)).ahead(1.0)
    with pytest.raises(BadInput, match=r"recorded every 0\.02 s"):
        OpenLoop(injected(car, replace(network("paper"), sample_time=0.01)), lap, 0.01)
    with pytest.raises(BadInput, match="not a whole number"):
        OpenLoop(injected(car, replace(network("paper"), sample_time=0.03)), lap)


def test_open_loop_delays_commands_as_the_model_does(car, lap):
    late = with_effects(car, {"steering_delay": 0.034, "steering_lag": 0.05})
    expected = simulate(late, lap, {"v_x": 2.5, "v_y": 0.0, "yaw_rate": 0.0})
    r = late.outputs.index("yaw_rate")
    read = lap.with_signals(**{n: expected.predicted[:, late.outputs.index(n)] for n in ("v_x", "v_y", "yaw_rate")})
    found = OpenLoop(late, read).ahead(1.0)
    assert np.allclose(found.predicted[:, 2], expected.predicted[found.rows, r], atol=5e-3)


def test_gymnasium_makes_environments_of_it(car):
    gymnasium = pytest.importorskip("gymnasium")
    twin = injected(car, network("paper", size=0.05))
    env = gymnasium.make("greybox/Track-v0", vehicle="roboracer", model=twin)
    cars = gymnasium.make_vec("greybox/Track-v0", num_envs=2, vehicle="roboracer", model=twin)
    first, _ = env.reset(seed=3)
    many, _ = cars.reset(seed=3)
    assert np.array_equal(first, many[0])
    action = np.array([0.3, 0.1], dtype=np.float32)
    assert np.array_equal(env.step(action)[0], cars.step(np.tile(action, (2, 1)))[0][0])
