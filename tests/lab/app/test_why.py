"""The waterfall goes down from the whole gap; a cause alone is the model with that cause and nothing else."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from made_gaps import none

import greybox_id as gb
from greybox_id.gap.gap import Budget, Ranked, Share
from greybox_lab.app.beneath import change_parts, gap_parts
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


def test_what_changed_what_did_not_and_what_is_not_known_are_stated():
    gap = SimpleNamespace(ranking=[Ranked("steering_delay", 0.98, 0.031, "s", (0.0251, 0.0369))])
    answer = {
        "since": ["dry1"], "changed": [{"effect": "steering_delay", "before": 0.0123}],
        "not_changed": [{"effect": "mass_change", "within": 0.07}], "not_seen": ["grip_scale"],
    }  # fmt: skip
    words = re.sub(r"<[^>]+>", "|", change_parts(gap, answer))
    assert "|12 ms|" in words
    assert "|31 ± 3 ms|" in words
    assert "Unchanged within two standard deviations:| mass_change (± 7.0\u00a0%)." in words
    assert "below the detection limit:| grip_scale." in words
    nothing = change_parts(gap, {"since": ["dry1"], "changed": [], "not_changed": [], "not_seen": []})
    assert "No change exceeds the scatter between the earlier drives." in nothing
    assert "table" not in nothing


def test_where_nothing_is_known_of_what_could_be_there_unseen_nothing_is_drawn():
    assert gap_parts(replace(none(), limits={}, advice=()))[1] == ""
