"""A policy takes another one's place while it drives: no call is dropped, none is answered by parts of both."""

import json
import threading

import numpy as np
import pytest
from hand import by_hand
from hostile_mutations import mutated

from greybox_id.base.errors import BadInput
from greybox_id.models.registry import motion_model_of
from greybox_lab.driving.loop.adapting import foretold, world_of
from greybox_lab.driving.loop.arms import Twin
from greybox_lab.driving.loop.demo import twin_of
from greybox_lab.driving.loop.protocol import digest_of
from greybox_lab.driving.loop.scene import Hands, Scene, driven
from greybox_lab.driving.loop.swap import MINUTE, SIZE, NotSwapped, Seat, probe
from greybox_lab.driving.racing.learner import shipped_learned
from greybox_lab.driving.racing.policy import Policy


def constant(value):
    """A policy of three layers that always does the same, which goes through all of them."""
    shapes = ((SIZE, 8), (8, 8), (8, 2))
    layers = tuple(np.full(shape, value / 100, dtype=np.float32) for shape in shapes)
    return Policy(layers, tuple(np.full(shape[1], value, dtype=np.float32) for shape in shapes))


def fine(new, present):
    """A twin in which everybody drives well."""


def body_of(policy):
    return policy.text().encode()


@pytest.mark.slow
@pytest.mark.parametrize(("calls", "swaps"), [(10_000, 20), pytest.param(100_000, 200, marks=pytest.mark.examination)])
def test_no_call_is_dropped_or_mixed_during_swaps(calls, swaps, tmp_path):
    bodies = [body_of(constant(value)) for value in (0.1, 0.2)]
    seat, seen = Seat(bodies[0], tmp_path), np.zeros((1, SIZE), dtype=np.float32)
    known = {constant(value).act(seen).tobytes() for value in (0.1, 0.2)}
    assert len(known) == 2
    answers, over = [], threading.Event()

    def drive():
        while len(answers) < calls or not over.is_set():
            answers.append(seat.act(seen).tobytes())

    driver = threading.Thread(target=drive)
    driver.start()
    for k in range(swaps):
        body = bodies[(k + 1) % 2]
        seat.offer(body, digest_of(body), fine).result()
    over.set()
    driver.join()
    assert len(answers) >= calls
    assert set(answers) == known
    assert seat.now.sha == digest_of(bodies[0])
    seat.close()


def test_what_is_in_force_stays_where_something_speaks_against_another(tmp_path):
    body = body_of(by_hand())
    seat = Seat(body, tmp_path)
    small = Policy((np.zeros((5, 2), dtype=np.float32),), (np.zeros(2, dtype=np.float32),))

    def crashes(new, present):
        raise NotSwapped("In the twin it crashes.")

    refused = {
        "SHA-256": (body_of(constant(0.1)), "0" * 64, None),
        "27": (body_of(small), None, None),
        "twin": (body_of(constant(0.1)), None, crashes),
        "not": (b"{}", None, None),
    }
    for word, (other, sha, twin) in refused.items():
        with pytest.raises(BadInput, match=word):
            seat.swap(other, sha or digest_of(other), *([twin] if twin else []))
        with pytest.raises(BadInput, match=word):
            seat.offer(other, sha or digest_of(other), *([twin] if twin else [])).result()
        assert seat.now.sha == digest_of(body)
    assert not (tmp_path / "policy.json").exists()
    seat.close()


@pytest.fixture(scope="module")
def minute():
    """What a driver sees in a minute."""
    scene, seen = Scene(1), []
    world = world_of(motion_model_of(scene.vehicle), scene.vehicle, 1, 0.6)

    def act(observations):
        seen.append(observations.copy())
        return shipped_learned_policy.act(observations)

    shipped_learned_policy = shipped_learned().policy
    driven(scene, Hands(world, act), MINUTE + 10, 0)
    return seen


def with_last(policy, factors):
    """A policy whose last layer is multiplied, (steering, drive)."""
    scale = np.array(factors, dtype=np.float32)
    return Policy((*policy.weights[:-1], policy.weights[-1] * scale), (*policy.biases[:-1], policy.biases[-1] * scale))


@pytest.mark.parametrize("factors", [(-1, -1), (-1, 1), (1, -1), (1e30, 1e30), (0, 1)])
def test_without_a_twin_a_policy_has_to_agree_in_the_last_minute(factors, minute, tmp_path):
    policy = shipped_learned().policy
    seat, body = Seat(body_of(policy), tmp_path), body_of(with_last(policy, factors))
    with pytest.raises(NotSwapped, match="drive for a minute"):
        seat.swap(body, digest_of(body))
    for seen in minute:
        seat.act(seen)
    with pytest.raises(NotSwapped, match="last minute"):
        seat.swap(body, digest_of(body))
    assert seat.now.sha == digest_of(body_of(policy))
    near = body_of(with_last(policy, (0.9, 0.9)))
    assert seat.swap(near, digest_of(near)).sha == digest_of(near)
    seat.close()


def sound(damaged, body):
    """Whether what is damaged, blanks say, does not matter to what a file holds."""
    try:
        return json.loads(damaged) == json.loads(body)
    except (ValueError, RecursionError):
        return False


@pytest.mark.parametrize("cases", [150, pytest.param(1000, marks=pytest.mark.slow)])
def test_damaged_policies_are_refused_with_a_sentence(cases, tmp_path):
    body = body_of(by_hand())
    seat = Seat(body, tmp_path)
    for case in range(cases):
        damaged = mutated(body, "columns", 3, case)
        if damaged == body:
            continue
        with pytest.raises(BadInput):
            seat.swap(damaged, digest_of(body))
        if not sound(damaged, body):
            with pytest.raises(BadInput, match=r"[.)]$"):
                seat.swap(damaged, digest_of(damaged))
    seat.close()


@pytest.mark.parametrize("done", [[[np.nan, 0.0]], [[0.0, 1.5]], [[0.0, 0.0, 0.0]]])
def test_what_is_no_action_is_refused(done):
    class Wild:
        def act(self, seen):
            return np.array(done)

    with pytest.raises(NotSwapped, match="is not a number from -1 to 1"):
        probe(Wild())


def test_a_slow_policy_is_refused():
    with pytest.raises(NotSwapped, match="ms"):
        probe(by_hand(), latency=1e-9)


def test_the_twin_refuses_who_drives_worse():
    vehicle = Scene(1).vehicle
    model = motion_model_of(vehicle)
    units = world_of(model, vehicle, 1, 0.6)
    base = shipped_learned()
    tried = twin_of(Twin(vehicle, model), vehicle, units, 0.6)
    tried(base.policy, base.policy)
    with pytest.raises(NotSwapped, match="crash"):
        tried(constant(0.9), base.policy)
    assert foretold(model, vehicle, by_hand().act, units, 0.6).crashes == 0
    with pytest.raises(NotSwapped, match="path error"):
        tried(by_hand(), base.policy)
