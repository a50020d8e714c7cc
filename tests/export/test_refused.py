"""A model that a target cannot be written for is refused with a sentence."""

from importlib import import_module

import pytest

from greybox_id.base.errors import BadInput
from greybox_id.export.subject import Subject
from greybox_id.models.registry import build

WITHOUT_TYRES = [(target, name) for target in ("autoware", "f1tenth", "opendbc")
                 for name in ("kinematic", "longitudinal", "msnn_lat")]  # fmt: skip
NO_MOTION = [(target, "msnn_lat") for target in ("fmu", "ros2", "simulink")]


@pytest.mark.parametrize(
    ("target", "name", "words"),
    [(*case, "has no tyres") for case in WITHOUT_TYRES] + [(*case, "no model of motion") for case in NO_MOTION],
)
def test_a_model_that_is_none_for_a_target_is_refused(target, name, words):
    with pytest.raises(BadInput, match=words):
        import_module(f"greybox_id.export.target_{target}").files(Subject(build(name), "car", None))
