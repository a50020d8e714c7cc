"""Named quantities: what effects do to them, in which order, and what is not there yet."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from greybox_id.engine.motion.quantities import NamedQuantities
from greybox_id.motion_model import MotionModel, Relaxation, State
from greybox_id.parameter import Parameter

MODEL = MotionModel(
    name="toy", about="", inputs=("steer",), outputs=("speed",), parameters=(Parameter("m", "kg", 2.0),),
    states=(State("speed", "m/s"),), quantities=("force",), dynamics=lambda x, u, p, q: {"speed": 0.0},
)  # fmt: skip


def quantities(model, relax=lambda name, value, q: value, before=None):
    x, u, p = SimpleNamespace(speed=3.0), SimpleNamespace(steer=0.1), SimpleNamespace(m=2.0)
    return NamedQuantities(model, x, u, p, relax, before)


def test_what_is_assigned_is_read_back():
    q = quantities(MODEL)
    q.force = 5.0
    assert q.force == 5.0
    assert (q.x.speed, q.u.steer, q.p.m) == (3.0, 0.1, 2.0)


def test_an_alteration_acts_before_anything_reads_the_quantity_back():
    q = quantities(MODEL.altered(force=lambda force, q: force + q.p.m))
    q.force = 5.0
    assert q.force == 7.0


def test_alterations_act_in_the_order_in_which_they_were_added():
    model = MODEL.altered(force=lambda force, q: force + 1).altered(force=lambda force, q: force * 10)
    q = quantities(model)
    q.force = 5.0
    assert q.force == 60.0


def test_parameters_and_inputs_are_altered_at_once_and_the_caller_keeps_his():
    model = MODEL.altered(m=lambda m, q: m * 2, steer=lambda steer, q: steer + q.x.speed)
    p = SimpleNamespace(m=2.0)
    q = NamedQuantities(model, SimpleNamespace(speed=3.0), SimpleNamespace(steer=0.1), p, lambda n, v, q: v)
    assert (q.p.m, q.u.steer, p.m) == (4.0, 3.1, 2.0)


def test_only_relaxed_quantities_follow_with_a_lag_and_they_do_so_after_alterations():
    model = MODEL.altered(force=lambda force, q: force + 1)
    model = replace(model, quantities=("force", "moment"), relaxations=(Relaxation("force", lambda q: 0.1),))
    q = quantities(model, relax=lambda name, value, q: 100 * value)
    q.force, q.moment = 1.0, 1.0
    assert (q.force, q.moment) == (200.0, 1.0)


def test_before_the_first_pass_everything_is_zero_and_then_it_is_the_pass_before():
    first = quantities(MODEL)
    assert first.before.a_y == 0.0
    first.force = 5.0
    assert quantities(MODEL, before=first).before.force == 5.0


def test_a_quantity_that_is_not_there_yet_is_a_sentence():
    with pytest.raises(AttributeError, match="The quantity F_z is not there yet"):
        _ = quantities(MODEL).F_z
