"""The waterfall goes down from the whole gap; a cause alone is the model with that cause and nothing else."""

from types import SimpleNamespace

import numpy as np

import greybox_id as gb
from greybox_id.gap.gap import Budget, Ranked, Share
from greybox_lab.app.charts import UNNAMED, waterfall
from greybox_lab.app.model import alone, steps

SHARES = (Share("steering_delay", 0.62, 0.55, 0.69), Share("grip_scale", 0.18, 0.12, 0.25))
BUDGET = Budget(SHARES, Share("unexplained", 0.20, 0.14, 0.27), ("lap",), True)


def test_steps_go_down_to_nothing():
    budget = steps(SimpleNamespace(budget=BUDGET, applied=("steering_delay",)))
    assert [step.name for step in budget] == ["steering_delay", "grip_scale", UNNAMED]
    np.testing.assert_allclose([step.start for step in budget], [1.0, 0.38, 0.20])
    assert [step.applied for step in budget] == [True, False, False]
    bars = waterfall(budget)["series"]
    np.testing.assert_allclose(np.add(bars[0]["data"], [bar["value"] for bar in bars[1]["data"]]), [100, 100, 38, 20])
    ends = [mark["coord"][0] for line in bars[1]["markLine"]["data"] for mark in line]
    np.testing.assert_allclose(ends, [31, 45, 13, 26])
    assert steps(SimpleNamespace(budget=None, applied=())) == []


def test_a_cause_alone_is_that_cause_and_no_other():
    base = gb.models.lateral(vehicle="roboracer")
    causes = [Ranked("steering_delay", 0.98, 0.031, "s", (0.028, 0.034))]
    model = alone(base, causes, "steering_delay")
    assert model.effects == ("steering_delay",)
    assert float(model["steering_delay"].array) == 0.031
    assert alone(base, causes, "none of them").effects == ()
