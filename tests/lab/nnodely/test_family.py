"""Networks are known by their shape: by any names, in any words; what is another network is refused by its relation."""

import json
import re

import numpy as np
import pytest
from networks import FOREIGN, NAMES, body_of, imported, said, stated

from greybox_id.base.errors import BadInput


def renaming(body, keep=()):
    """The file with every name in it replaced, those of nnodely's operations and of inputs apart."""
    names = [*body["Relations"], *body["Functions"], *body["Parameters"], *body["Constants"], *body["Outputs"]]
    fresh = {name: f"n{k}" for k, name in enumerate(names) if name not in keep}
    return json.loads(
        json.dumps(body), object_pairs_hook=lambda pairs: {fresh.get(k, k): _new(v, fresh) for k, v in pairs}
    )


def _new(value, fresh):
    if isinstance(value, str):
        return fresh.get(value, value)
    return [_new(own, fresh) for own in value] if isinstance(value, list) else value


def function_of(body, word):
    """The function whose source holds a word."""
    return next(function for function in body["Functions"].values() if word in str(function.get("code")))


def of(body, operation):
    return {name: own for name, own in body["Relations"].items() if own[0] == operation}


@pytest.mark.parametrize("name", NAMES)
def test_names_count_for_nothing(tmp_path, name):
    body = body_of(name)
    signals = stated(name)["roles"]
    for key in list(body["Inputs"]):
        fresh = f"signal {list(body['Inputs']).index(key)}"
        text = json.dumps(body).replace(f'"{key}"', f'"{fresh}"')
        body = json.loads(text)
        signals = {fresh if own == key else own: signal for own, signal in signals.items()}
    pairs = [f"{signal}={own}" for own, signal in signals.items()]
    found = imported(tmp_path, renaming(body), pairs)
    np.testing.assert_array_equal(
        found.fit.model.values, imported(tmp_path, body_of(name), said(name)).fit.model.values
    )
    assert found.fit.model.settings == imported(tmp_path, body_of(name), said(name)).fit.model.settings


@pytest.mark.parametrize(
    "code",
    [
        "def g(d, v, d0, v0, a, a0, p, q, r, s):\n return v*p + v*q*d - q*v*d0 + r*v*v - r*v0*v + s*a*v - a0*v*s\n",
        "def g(a, b, c, d, e, f, g, h, i, j):\n"
        " slope = torch.mul(h, a - c) + torch.mul(i, torch.sub(b, d))\n"
        " rest = j * (e - f)\n"
        " return torch.mul(b, g + slope + rest)\n",
    ],
)
def test_a_local_model_in_other_words_is_the_same(tmp_path, code):
    body = body_of("lat_small")
    wanted = imported(tmp_path, body).fit.model.values
    function_of(body, "curvature")["code"] = code
    np.testing.assert_allclose(imported(tmp_path, body).fit.model.values, wanted, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize(
    "change",
    [
        ("k2 * (steer - steer_0)", "k2 * torch.sin(steer - steer_0)"),
        ("return v *", "return v**2 *"),
        ("v *", "0.1 + v *"),
    ],
)
def test_another_local_model_is_refused_with_the_form_that_is_read(tmp_path, change):
    body = body_of("lat_small")
    function = function_of(body, "curvature")
    function["code"] = function["code"].replace(*change)
    with pytest.raises(BadInput, match=r"local model ParamFun\d+ is not of the form v_x \(k1 \+ k2"):
        imported(tmp_path, body)


def test_newtons_law_in_other_words_is_the_same(tmp_path):
    body = body_of("long")
    wanted = imported(tmp_path, body).fit.model.values
    function_of(body, "newton")["code"] = (
        "def n(T, v, F, d, r, m, a, b, c, I):\n"
        " heavy = m + 4*I/r**2\n"
        " return 2*T/(r*heavy) - (a*v.square() + b*v + torch.sin(d)*F + c*m*9.81)/heavy\n"
    )
    np.testing.assert_allclose(imported(tmp_path, body).fit.model.values, wanted, rtol=1e-12, atol=1e-13)


def test_factors_of_newtons_terms_go_into_the_numbers(tmp_path):
    body = body_of("long")
    before = imported(tmp_path, body).fit.model
    function = function_of(body, "newton")
    function["code"] = (
        function["code"].replace("k_a * v**2", "0.5 * k_a * v**2").replace("2 * (torque", "torch.neg(torque")
    )
    function["code"] = (
        function["code"].replace("(torch.neg(torque / r)", "(torch.neg(torque / r)").replace("- F_y", "+ 3 * F_y")
    )
    after = imported(tmp_path, body).fit.model
    assert float(after["k_a"].array) == pytest.approx(0.5 * float(before["k_a"].array), rel=1e-12)
    np.testing.assert_allclose(after["G_2t"].array, -0.5 * before["G_2t"].array, rtol=1e-12)
    np.testing.assert_allclose(after["F_y"].array, -3 * before["F_y"].array, rtol=1e-12)


@pytest.mark.parametrize(
    "change", [("v**2", "v**3"), ("sin", "tanh"), ("r**2.0", "r**3"), ("c_r * gravity", "c_r * gravity * v")]
)
def test_another_law_is_refused_by_its_relation(tmp_path, change):
    body = body_of("long")
    function = function_of(body, "newton")
    function["code"] = function["code"].replace(*change)
    output = body["Outputs"]["acceleration"]
    with pytest.raises(BadInput, match=f"relation {output} is not Newton's law of the family"):
        imported(tmp_path, body)


def test_the_numbers_are_told_apart_in_any_order(tmp_path):
    wanted = imported(tmp_path, body_of("long")).fit.model
    body = body_of("long")
    function = function_of(body, "newton")
    function["params_and_consts"].reverse()
    function["code"] = function["code"].replace("r, m, k_a, c_l, c_r, I_w", "I_w, c_r, c_l, k_a, m, r")
    np.testing.assert_array_equal(imported(tmp_path, body).fit.model.values, wanted.values)


def _current(body):
    function = function_of(body, "driving")
    function["code"] = function["code"].replace(", 0)", ", 1)")


def _centres(body):
    own = [function for function in body["Functions"].values() if function.get("centers", [0])[0] == -0.3]
    own[0]["centers"] = [-0.4, 3.9]


def _lacking(body):
    name, own = next((name, own) for name, own in of(body, "Add").items() if own[1][0].startswith("Mul"))
    body["Relations"][name] = ["Identity", own[1][:1]]


def _doubled(body):
    next(own for own in of(body, "Select").values() if own[-2:] == [3, 2])[-1] = 1


def _operation(body):
    next(iter(of(body, "Fuzzify").values()))[0] = "Interpolation"


def _early(body):
    for own in of(body, "SamplePart").values():
        own[-1] = [-5, -1] if own[-1] == [-4, 0] else own[-1]


def _newest(body):
    next(own for own in of(body, "SamplePart").values() if own[-1] == [0, 1])[-1] = [-1, 0]


def _across(body):
    body["Relations"][body["Outputs"]["across"]][0] = "Add"


def _twin(body):
    body["Relations"]["Twin"] = list(body["Relations"][body["Outputs"]["yaw_rate_"]])
    body["Outputs"]["twin"] = "Twin"


def _connected(body):
    body["Inputs"]["acc"] = {**body["Inputs"]["acc"], "connect": "Add1"}


def _looped(body):
    body["Inputs"]["vel"]["closedLoop"] = body["Outputs"]["acceleration"]


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("long", _current, "neither the positive nor the negative part of a window of crt"),
        ("lat", _centres, "input vx has different centres in its steady"),
        ("lat_small", _lacking, "lacks local models or impulse responses.*3 × 2 × 1"),
        ("lat_small", _doubled, "have the same memberships"),
        ("lat_small", _operation, r"relation Select\d+ selects from something else than memberships"),
        ("lat_small", _early, None),
        ("lat_small", _newest, r"trained to give the newest sample of yaw_rate.*next\(\)"),
        ("full", _across, r"output \w+ depends on another output"),
        ("lat_small", _twin, "2 outputs are msnn_lat"),
        ("full_closed", _connected, "addClosedLoop in place of addConnect"),
        ("full_closed", _looped, "input vel is fed back from"),
    ],
)
def test_what_is_no_network_of_the_family_is_refused(tmp_path, name, change, words):
    body = body_of(name)
    change(body)
    with pytest.raises(BadInput, match=words):
        imported(tmp_path, body)


def test_memberships_of_another_form_are_refused(tmp_path):
    for form, word in (("Rectangular", "rectangular"), ("def f(x):\n  return x\n", "membership functions of its own")):
        body = body_of("lat_small")
        next(function for function in body["Functions"].values() if len(function.get("centers", ())) > 1)[
            "functions"
        ] = form
        with pytest.raises(BadInput, match=word):
            imported(tmp_path, body)


def test_a_window_that_is_longer_in_one_part_is_filled_with_zeros(tmp_path):
    body = body_of("long_by_axle")
    own = next(own for own in of(body, "Fir").values() if own[3] is not None)
    weights = body["Parameters"][own[2]]["values"]
    del weights[:2]
    part = body["Relations"][own[1][0]][1][0]
    body["Relations"][part][3] = [-3, 0]
    model = imported(tmp_path, body).fit.model
    assert np.any([np.all(model[name].array[:, :2] == 0) for name in ("G_1t", "G_1b")])


def test_loops_are_said(tmp_path):
    closed, opened = imported(tmp_path, body_of("full_closed")), imported(tmp_path, body_of("full"))
    assert len(closed.notes) == 1
    assert "the file does not close the loops" in opened.notes[0]
    assert closed.fit.model.feedback is not None


def test_names_that_do_not_tell_are_asked_for(tmp_path):
    with pytest.raises(BadInput, match=r"do not show.*inputs SIGNAL=INPUT"):
        imported(tmp_path, body_of("renamed"))
    with pytest.raises(BadInput, match=r"say what imu_long, handwheel are|say what handwheel, imu_long are"):
        imported(tmp_path, body_of("renamed"), FOREIGN[:1])
    assert imported(tmp_path, body_of("renamed"), FOREIGN[:2]).roles["imu_long"] == "a_x"


@pytest.mark.parametrize(
    ("pairs", "word"),
    [
        (["v_x"], "write SIGNAL=INPUT"),
        (["speed=omega_rear"], "one of v_x, steer"),
        (["v_x=omega"], "there is no input omega; the inputs are"),
        (["v_x=omega_rear", "steer=omega_rear"], "both v_x and steer"),
        (["v_x=omega_rear", "v_x=handwheel"], "one input for each"),
        (["motor_current=omega_rear"], "is motor_current, but"),
        (["steer=omega_rear", "v_x=handwheel", "a_x=imu_long"], "is not of the form"),
    ],
)
def test_what_is_said_of_inputs_is_checked(tmp_path, pairs, word):
    with pytest.raises(BadInput, match=re.escape(word)):
        imported(tmp_path, body_of("renamed"), pairs)
