"""Where equations come from that greybox-id does not ship is told from the functions themselves."""

import hashlib
from pathlib import Path

import greybox_id as gb
from greybox_id.base.origin import origin_of
from greybox_id.models import MODEL_NAMES
from greybox_id.models.effects import EFFECTS
from greybox_id.models.registry import MODELS, build


def turner(dynamics):
    return gb.models.MotionModel(
        name="turner", about="turns", states=(gb.models.State("yaw_rate", "rad/s"),), inputs=("steer", "v_x"),
        outputs=("yaw_rate",), dynamics=dynamics, parameters=(gb.models.Parameter("L", "m", 0.33, (0.1, 1.0)),),
    )  # fmt: skip


def test_shipped_equations_have_none():
    for name in MODEL_NAMES:
        assert build(name).origin is None
    model = build("single_track")
    for effect in EFFECTS.values():
        if effect.concerns(model):
            assert not (model + effect).origins


def test_ones_own_are_where_their_functions_are_defined():
    model = turner(lambda x, u, p, q: {"yaw_rate": u.steer / p.L})
    here = Path(__file__)
    assert model.origin.sha256 == hashlib.sha256(here.read_bytes()).hexdigest()
    assert Path(model.origin.file).resolve() == here
    assert origin_of(model.dynamics) == model.origin


def test_those_that_helpers_of_the_package_wrap_are_found_in_their_closures():
    soft = gb.effects.alteration(
        "steering", "soft", "1", 0.0, (0.0, 1.0), "lost", typical=0.1, steer=lambda s, q: s * q.p.soft
    )
    model = build("lateral") + soft
    assert list(model.origins) == ["soft"]
    assert Path(model.origins["soft"].file).resolve() == Path(__file__)


def test_what_was_typed_into_a_session_has_no_file():
    names = {"__name__": "__main__"}
    exec("def dynamics(x, u, p, q):\n    return {'yaw_rate': u.steer / p.L}", names)
    origin = turner(names["dynamics"]).origin
    assert (origin.file, origin.sha256) == ("", "")
    assert "session" in origin.words


def test_an_effects_parameter_keeps_its_null():
    for effect in EFFECTS.values():
        assert effect.parameter.null == float(effect.parameter.array)
        low, high = effect.parameter.bounds
        moved = effect.free(min(max(effect.typical, low), high))
        assert moved.parameter.null == effect.parameter.null
        if effect.memory_parameter is not None:
            assert moved.memory_parameter.null == float(effect.memory_parameter.array)


def test_names_are_those_of_the_registry():
    assert tuple(MODELS) == MODEL_NAMES
