"""What is handed over is checked where it enters: one sentence that names the argument."""

import numpy as np
import pandas as pd
import pytest

import greybox_id as gb
from greybox_id.fitting.how import FitOptions


@pytest.fixture(scope="module")
def lap():
    return gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 200)


def turner(dynamics, **more):
    return gb.models.MotionModel(
        name="turner", about="turns", states=(gb.models.State("yaw_rate", "rad/s"),), inputs=("steer", "v_x"),
        outputs=("yaw_rate",), dynamics=dynamics,
        parameters=(gb.models.Parameter("L", "m", 0.33, (0.1, 1.0)),
                    gb.models.Parameter("lag", "s", 0.1, (0.01, 1.0))), **more,
    )  # fmt: skip


WRONG = [
    ("model: there is no model 'laterl'. Did you mean lateral?", lambda lap: gb.fit("laterl", lap)),
    ("model: a Model or its name is needed, not 3.", lambda lap: gb.fit(3, lap)),
    ('There is no vehicle "roboracr". Did you mean roboracer?',
     lambda lap: gb.fit("lateral", lap, vehicle="roboracr")),
    ("vehicle: a Vehicle, a shipped name or a path is needed", lambda lap: gb.fit("lateral", lap, vehicle=3)),
    ("recordings: a Recording, a path or a list of them is needed, not the int 3", lambda lap: gb.fit("lateral", 3)),
    ("a recording of it: gb.Recording.from_pandas(table)", lambda lap: gb.fit("lateral", pd.DataFrame({"v_x": [1.0]}))),
    ("recordings: there is no recording", lambda lap: gb.fit("lateral", [])),
    ("recordings: no file matches 'no*.csv'", lambda lap: gb.fit("lateral", "no*.csv")),
    ("nothing.csv: there is no such file", lambda lap: gb.fit("lateral", "nothing.csv")),
    ("horizon: seconds above zero are needed", lambda lap: gb.FitOptions(horizon=-1)),
    ("solver: there is no 'newton'.", lambda lap: gb.FitOptions(solver="newton")),
    ("starts: a whole number from 1 on is needed, not 0.", lambda lap: gb.FitOptions(starts=0)),
    ("options: gb.FitOptions(...) is needed", lambda lap: gb.fit("lateral", lap, options={"horizon": 1})),
    ("There is no effect 'steering_dely'. Did you mean steering_delay?",
     lambda lap: gb.fit("lateral", lap, effects="steering_dely")),
    ("There is no effect 'steering_dely'. Did you mean steering_delay?", lambda lap: gb.effects.steering_dely),
    ("fix I_zz: lateral has no parameter I_zz. Did you mean I_z?", lambda lap: gb.fit("lateral", lap, fix=["I_zz"])),
    ("fix I_z: a number or a text", lambda lap: gb.fit("lateral", lap, fix={"I_z": [1]})),
    ("prior I_z=3.0: how well is it known?", lambda lap: gb.fit("lateral", lap, prior={"I_z": 3.0})),
    ("free: names are needed", lambda lap: gb.fit("lateral", lap, free=[3])),
    ("start yawrate: kinematic has no state yawrate. Did you mean yaw_rate?",
     lambda lap: gb.simulate("kinematic", lap, start={"yawrate": 0.0})),
    ("horizon: seconds above zero are needed, or None for the free run, not -1",
     lambda lap: gb.predict("kinematic", lap, -1)),
    ("horizon: seconds above zero are needed", lambda lap: gb.predict("kinematic", lap, "0.5")),
    ("readings: a list of names is needed, as in readings=['a_y'], not the text 'a_y'",
     lambda lap: gb.TrackOptions(readings="a_y")),
    ("filter: there is no 'kf'.", lambda lap: gb.TrackOptions(filter="kf")),
    ("effects: a list is needed, as in effects=['steering_lag']",
     lambda lap: gb.diagnose("kinematic", lap, effects="steering_lag")),
    ("effects: there is no effect 'steering_lg'. Did you mean steering_lag?",
     lambda lap: gb.diagnose("kinematic", lap, effects=["steering_lg"])),
    ("which is diagnosed. Hold out another recording", lambda lap: gb.diagnose("kinematic", lap, held_out=lap)),
    ("results: a Fit, a Gap, a Track", lambda lap: gb.report(lap, "x.pdf")),
    ("There is no target 'cc'.", lambda lap: gb.export(gb.models.lateral(), "car", target="cc")),
    ("wheelbase: metres are needed", lambda lap: gb.check(lap, wheelbase=-1)),
    ("There is no tyre 'pacejca'", lambda lap: gb.models.single_track(tyre="pacejca")),
    ("has no parameter 'I_zz'; it has", lambda lap: gb.models.lateral()["I_zz"]),
    ("its equations read p.Lag, but it has no parameter Lag. Did you mean lag?",
     lambda lap: gb.simulate(turner(lambda x, u, p, q: {"yaw_rate": (u.steer - x.yaw_rate) / p.Lag}), lap)),
    ("give yaw_rate as NaN. Functions of math",
     lambda lap: gb.simulate(turner(lambda x, u, p, q: {"yaw_rate": __import__("math").tan(u.steer) / p.lag}), lap)),
    ("branch on a symbol", lambda lap: gb.simulate(turner(lambda x, u, p, q: {"yaw_rate": max(u.steer, 0)}), lap)),
    ("do not give the derivative of yaw_rate. They give yawrate, which is not a state.",
     lambda lap: gb.simulate(turner(lambda x, u, p, q: {"yawrate": u.steer}), lap)),
    ("must give a mapping", lambda lap: gb.simulate(turner(lambda x, u, p, q: None), lap)),
]  # fmt: skip


@pytest.mark.parametrize(("sentence", "call"), WRONG, ids=[sentence[:40] for sentence, _ in WRONG])
def test_one_sentence_names_the_argument(sentence, call, lap, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises((gb.GreyboxError, AttributeError)) as error:
        call(lap)
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


def test_one_may_hand_over_a_recording_a_list_a_path_or_a_pattern(tmp_path, lap):
    lap.to_pandas()[["time", "v_x", "steer", "yaw_rate"]].to_csv(tmp_path / "lap1.csv", index=False)
    lap.to_pandas()[["time", "v_x", "steer", "yaw_rate"]].to_csv(tmp_path / "lap2.csv", index=False)
    assert len(gb.read(tmp_path / "lap1.csv")) == len(lap)
    assert [recording.name for recording in gb.read(str(tmp_path / "lap*.csv"))] == ["lap1", "lap2"]
    options = gb.FitOptions(solver="gauss-newton")
    one, several = (
        gb.fit("kinematic", given, vehicle="roboracer", options=options)
        for given in (str(tmp_path / "lap*.csv"), gb.read([tmp_path / "lap1.csv", tmp_path / "lap2.csv"]))
    )
    assert one.params.equals(several.params)
    assert [record.name for record in one.data] == ["lap1", "lap2"]


def test_numbers_may_carry_units_and_priors_are_pairs(lap):
    fast = gb.FitOptions(solver="gauss-newton")
    fit = gb.fit(
        "kinematic", lap, vehicle="roboracer", fix={"l_f": "16 cm"}, prior={"yaw_lag": (0.1, 0.02)}, options=fast
    )
    assert fit.params["l_f"] == 0.16
    assert (fit.model["yaw_lag"].prior.mean, fit.model["yaw_lag"].prior.sd) == (0.1, 0.02)


def test_a_table_becomes_a_recording_and_back():
    table = pd.DataFrame(
        {"t": [0.0, 100.0, 200.0], "speed": [36.0, 36.0, 72.0], "v_x": [10, 10, 20], "note": list("abc")}
    )
    found = gb.Recording.from_pandas(table, units={"t": "ms", "speed": "km/h"}, time="t", name="lap")
    assert found.time == pytest.approx([0.0, 0.1, 0.2])
    assert found["speed"] == pytest.approx([10.0, 10.0, 20.0])
    assert found.unit("speed") == "m/s"
    assert "note" not in found
    again = gb.Recording.from_pandas(found.to_pandas().drop(columns="run"), units={"speed": "m/s"})
    assert np.array_equal(again["speed"], found["speed"])


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"units": {"sped": "m/s"}}, "units: table has no column 'sped'. Did you mean speed?"),
        ({"units": {"v_x": "deg/s"}}, "units['v_x']: unit \"deg/s\" is not a unit of this quantity"),
        ({"time": "stamp"}, "time: table has no column 'stamp'."),
        ({"units": {"note": "m"}}, "column 'note' holds something that is not a number"),
    ],
)
def test_a_table_that_is_no_recording_is_said(given, sentence):
    table = pd.DataFrame({"time": [0.0, 0.1], "speed": [1.0, 2.0], "v_x": [1.0, 1.0], "note": list("ab")})
    with pytest.raises(gb.BadInput) as error:
        gb.Recording.from_pandas(table, **given)
    assert sentence in str(error.value)


def test_the_options_of_the_command_line_are_those_of_the_top_level():
    assert FitOptions is gb.FitOptions
