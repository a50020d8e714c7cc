"""A policy: what it does, and its file."""

import json

import numpy as np
import pytest

from greybox_id.base.errors import BadInput
from greybox_lab.driving.racing.policy import Policy, load_policy

DRAWN = np.random.default_rng(1)
SIZES = (27, 8, 2)


def drawn(sizes=SIZES):
    weights = [DRAWN.normal(size=own).astype(np.float32) for own in zip(sizes[:-1], sizes[1:], strict=True)]
    return Policy(tuple(weights), tuple(DRAWN.normal(size=n).astype(np.float32) for n in sizes[1:]), {"seed": 1})


def test_a_policy_is_layers_of_tanh_clamped():
    policy, seen = drawn(), DRAWN.normal(size=(5, 27)).astype(np.float32)
    expected = np.tanh(seen @ policy.weights[0] + policy.biases[0]) @ policy.weights[1] + policy.biases[1]
    assert np.any(np.abs(expected) > 1)
    assert np.array_equal(policy.act(seen), np.clip(expected, -1, 1))


def test_its_file_gives_the_same_bytes_back(tmp_path):
    policy = drawn()
    policy.save(tmp_path / "policy.json")
    again = load_policy(tmp_path / "policy.json")
    assert again.text() == policy.text()
    assert again.about == {"seed": 1}


@pytest.mark.parametrize("sizes", [(27, 8, 3), (27, 2)])
def test_shapes_that_do_not_follow_are_refused(sizes, tmp_path):
    if sizes[-1] == 3:
        with pytest.raises(ValueError, match="3 actions"):
            drawn(sizes)
        return
    policy = drawn(sizes)
    policy.save(tmp_path / "policy.json")
    body = json.loads((tmp_path / "policy.json").read_text())
    body["layers"][0]["biases"].append(0.0)
    (tmp_path / "policy.json").write_text(json.dumps(body))
    with pytest.raises(BadInput, match="damaged"):
        load_policy(tmp_path / "policy.json")
