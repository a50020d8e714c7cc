"""Quantities that depend on what they lead to, through passes over the equations."""

import numpy as np
import pytest

from greybox_id.engine.motion.trace import MotionTrace
from greybox_id.models.motion_model import MotionModel, State
from greybox_id.models.parameter import Parameter


def softening():
    def dynamics(x, u, p, q):
        q.grip = 1.0
        q.a = q.grip * u.u
        return {"x": q.a}

    return MotionModel(
        name="softening", about="", states=(State("x", "1"),), inputs=("u",), outputs=("a",), quantities=("grip", "a"),
        parameters=(Parameter("k", "1", 0.1),), dynamics=dynamics,
    )  # fmt: skip


def found(passes):
    """a = (1 - k a) u, u = 2."""
    model = softening().altered(grip=lambda grip, q: grip * (1 - q.p.k * q.before.a)).gone_through(passes)
    return float(MotionTrace(model).output([0.0], [0.01, 2.0, 0.0], [0.1]))


def test_the_first_pass_finds_nothing_before_it():
    assert found(1) == 2.0


def test_every_further_pass_finds_the_one_before():
    assert found(2) == pytest.approx(2.0 * (1 - 0.1 * 2.0))
    assert found(3) == pytest.approx(2.0 * (1 - 0.1 * 1.6))


def test_passes_converge_on_what_depends_on_itself():
    assert found(20) == pytest.approx(2.0 / 1.2, rel=1e-9)


def test_effects_that_need_different_numbers_of_passes_get_the_larger():
    assert softening().gone_through(3).gone_through(2).passes == 3


def test_alterations_act_once_per_pass():
    model = softening().altered(a=lambda a, q: a + 1.0).gone_through(4)
    np.testing.assert_allclose(MotionTrace(model).output([0.0], [0.01, 2.0, 0.0], [0.1]), 3.0)
