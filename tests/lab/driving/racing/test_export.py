"""Policies written for controllers do what they do in Python."""

import json

import numpy as np
import pytest
from calling import greybox
from compiled import compiled, run

import greybox_id as gb
from greybox_id.base.errors import BadInput
from greybox_lab.driving.racing.export import PolicySubject, export_policy, observations
from greybox_lab.driving.racing.laps import drive
from greybox_lab.driving.racing.learner import shipped_learned
from greybox_lab.driving.racing.policy import Policy
from greybox_lab.driving.racing.world import SEEN
from greybox_lab.driving.racing.worlds import world

pytestmark = pytest.mark.usefixtures("_uncompiled")


@pytest.fixture(scope="module")
def policy():
    return shipped_learned().policy


@pytest.fixture(scope="module")
def file(policy, tmp_path_factory):
    found = tmp_path_factory.mktemp("policies") / "racer.json"
    policy.save(found)
    return found


def seen_while_driving(policy):
    """2 560 observations of driving, some of them hasty."""
    racing, rows = world(64, action="speed", usage=(0.5, 0.95), noise=True), []
    for k in range(40):
        rows.append(racing.observe())
        racing.step(policy.act(rows[-1]) + np.random.default_rng(k).normal(size=(64, 2)) * 0.1)
    return np.concatenate(rows)


def test_the_graph_does_what_the_policy_does_on_10_000_observations(policy, tmp_path):
    onnx = pytest.importorskip("onnx")
    onnxruntime = pytest.importorskip("onnxruntime")
    export_policy(PolicySubject(policy, "racer"), "onnx", tmp_path / "racer")
    path = tmp_path / "racer" / "racer.onnx"
    model = onnx.load(path)
    assert model.opset_import[0].version >= 17
    assert {weights.data_type for weights in model.graph.initializer} == {onnx.TensorProto.FLOAT}
    told = {own.key: own.value for own in model.metadata_props}
    assert json.loads(told["seen"]) == [name.replace("sin_e_psi", "e_psi") for name in SEEN]
    assert json.loads(told["units"]) == policy.about["units"]
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    subject = PolicySubject(policy, "racer")
    driving = seen_while_driving(policy)
    given = driving / subject.scales
    given[:, 4] = np.arcsin(driving[:, 4])
    assert np.max(np.abs(subject.observation(given) - driving)) <= 1e-6  # scaled and clamped as the environment does
    for seen in (given, observations(10_000, policy.size, 1) / subject.scales):
        expected = policy.act(subject.observation(seen))
        found = session.run(None, {"seen": seen})[0]
        assert found.dtype == np.float32
        assert np.max(np.abs(found - expected)) <= 1e-6
    assert np.any(np.abs(expected) == 1)  # clamped within the graph


def test_the_c_does_what_the_policy_does(policy, tmp_path):
    export_policy(PolicySubject(policy, "racer"), "c", tmp_path / "racer")
    folder = tmp_path / "racer"
    program = compiled([folder / "racer.c", folder / "racer_test.c"], tmp_path / "test")
    assert "100 observations, largest difference" in run(program)
    example = run(compiled([folder / "racer.c", folder / "main.c"], tmp_path / "example"))
    straight = np.zeros((1, policy.size), dtype=np.float32)
    straight[0, 0] = 0.5  # of the top speed
    words = example.replace(",", "").split()
    np.testing.assert_allclose([float(words[1]), float(words[3])], policy.act(straight)[0], atol=2e-6)
    assert "microseconds a call" in example


def test_the_self_test_in_c_fails_where_a_weight_is_another(policy, tmp_path):
    weights = list(policy.weights)
    export_policy(PolicySubject(policy, "racer"), "c", tmp_path / "racer")
    weights[1] = weights[1].copy()
    weights[1][3, 5] += 1e-2
    other = Policy(tuple(weights), policy.biases)
    export_policy(PolicySubject(other, "racer"), "c", tmp_path / "other")
    program = compiled([tmp_path / "other" / "racer.c", tmp_path / "racer" / "racer_test.c"], tmp_path / "test")
    with pytest.raises(AssertionError):
        run(program)


def test_a_policys_file_is_exported_from_the_command_line_and_python(file, policy, tmp_path):
    called = greybox("export", file, "--target", "c", "--out", tmp_path / "car", "--json")
    assert called.code == 0
    assert called.told["model"] == "policy"
    manifest = json.loads((tmp_path / "car" / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["learned"]["steps"] == policy.about["steps"]
    assert manifest["model"]["inputs"] == [name.replace("sin_e_psi", "e_psi") for name in SEEN]
    written = gb.export(file, tmp_path / "car2", name="car")
    assert (tmp_path / "car2" / "car.c").read_text().splitlines()[1:] == (
        tmp_path / "car" / "car.c"
    ).read_text().splitlines()[1:]
    assert [own.name for own in written][-1] == "manifest.json"


def test_what_a_policy_is_not_written_for_is_refused(file, policy, tmp_path):
    for words, said in (
        (("--target", "fmu"), "not written for 'fmu'"),
        (("--target", "c", "--vehicle", "roboracer"), "exported as it is"),
        (("--target", "c", "--name", "2x"), "cannot name C functions"),
    ):
        called = greybox("export", file, "--out", tmp_path / "car", *words)
        assert called.code == 2
        assert said in called.err
    assert not (tmp_path / "car").exists()
    with pytest.raises(BadInput, match="not written for"):
        gb.export(policy, tmp_path / "car", target="fmu")


def test_laps_are_counted_timed_and_lost(policy):
    racing = world(4, action="speed")
    found = drive(racing, policy, 6, seed=3)
    assert found.tried == 6
    assert len(found.lap_times) == 6
    ideal = racing.track.length * float(np.mean(1.0 / racing.track.speed))
    assert ideal < found.lap_time < 1.2 * ideal
    assert found.speed == pytest.approx(racing.track.length / found.lap_time, rel=0.02)
    assert found.path_error_rms < found.path_error_p95

    class Blind:
        def act(self, seen):
            return np.tile([0.0, 1.0], (len(seen), 1))

    lost = drive(racing, Blind(), 6, seed=3)
    assert (lost.crashes, len(lost.lap_times)) == (6, 0)
    assert np.isnan(lost.lap_time)
    with pytest.raises(BadInput, match="laps"):
        drive(racing, policy, 0)
