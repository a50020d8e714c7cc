"""The waterfall goes down from the whole gap; a cause alone is the model with that cause and nothing else."""

import numpy as np

import greybox_id as gb
from greybox_lab.app.charts import waterfall
from greybox_lab.app.why import UNNAMED, alone, headline, steps, unseen

RANKED = [
    {"effect": "steering_delay", "probability": 0.98, "magnitude": 0.031, "unit": "s", "interval": [0.028, 0.034],
     "others": {}, "reason": "", "indistinguishable_from": []},
    {"effect": "grip_scale", "probability": 0.4, "magnitude": 0.9, "unit": "1", "interval": [0.8, 1.0], "others": {},
     "reason": "not sure", "indistinguishable_from": []},
]  # fmt: skip
GAP = {
    "gap_detected": True, "ranking": RANKED, "applied": ["steering_delay"], "unknown": "", "doubts": [],
    "budget": [{"effect": "steering_delay", "share": 0.62, "low": 0.55, "high": 0.69},
               {"effect": "grip_scale", "share": 0.18, "low": 0.12, "high": 0.25},
               {"unnamed": 0.20, "low": 0.14, "high": 0.27}],
    "where": {"channel": "yaw_rate", "channels": {"yaw_rate": 3.1}}, "held_out": {"closed": 0.8},
    "gap": {"closed": 0.9},
    "not_excited": {"road_bank": "±3°"}, "absorbed": ["yaw_rate_bias"],
    "limits": {"mass_change": {"size": 0.3, "typical": 0.1, "unit": "1", "share": 3.0, "told": 1.0},
               "roll_dynamics": {"size": None, "typical": 0.1, "unit": "s", "share": None, "told": 1.0}},
}  # fmt: skip


def test_steps_go_down_to_nothing():
    budget = steps(GAP)
    assert [step.name for step in budget] == ["steering_delay", "grip_scale", UNNAMED]
    np.testing.assert_allclose([step.start for step in budget], [1.0, 0.38, 0.20])
    assert [step.applied for step in budget] == [True, False, False]
    assert budget[0].words == "0.0310 [0.0280, 0.0340] s, probability 0.98"
    bars = waterfall(budget)["series"]
    np.testing.assert_allclose(np.add(bars[0]["data"], [bar["value"] for bar in bars[1]["data"]]), [100, 100, 38, 20])


def test_the_headline_says_what_the_simulation_lacks():
    assert headline(GAP) == (
        "The simulation lacks steering_delay, which closes 80 % of the gap on what was held out; yaw_rate is off by "
        "3.1 times its noise."
    )
    assert headline(GAP | {"gap_detected": False}).startswith("No gap")
    changed = GAP | {"since": ["dry1", "dry2"], "changed": [{"effect": "grip_scale"}]}
    assert headline(changed) == "grip_scale changed since dry1, dry2."
    assert headline(changed | {"changed": []}).startswith("Nothing changed since dry1")
    assert "no name is sure" in headline(GAP | {"applied": []})


def test_what_could_not_be_seen_is_said_with_why():
    assert [name for name, _ in unseen(GAP)] == ["road_bank", "yaw_rate_bias", "mass_change"]


def test_a_cause_alone_is_that_cause_and_no_other():
    base = gb.models.lateral(vehicle="roboracer")
    model = alone(base, RANKED, "steering_delay")
    assert model.effects == ("steering_delay",)
    assert float(model["steering_delay"].array) == 0.031
    assert alone(base, RANKED, "none of them").effects == ()
