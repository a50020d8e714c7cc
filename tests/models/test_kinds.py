"""A kind of model that the package does not know goes through its verbs by what it registers here, once per floor."""

import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from calling import greybox, refused

import greybox_id as gb
from greybox_id.datasets.recording import join
from greybox_id.engine.simulation import Prediction, equations_of_motion
from greybox_id.fitting.fit import Fit
from greybox_id.fitting.provenance import Stage
from greybox_id.fitting.scores.metrics import simulate
from greybox_id.fitting.verb import FitTask, estimated
from greybox_id.models.effect import acting
from greybox_id.models.memory_model import MemoryModel
from greybox_id.models.model import Model, by_kind, must_be
from greybox_id.models.motion_model import MotionModel
from greybox_id.models.parameter import unpack
from greybox_id.models.registry import build, known


@dataclass(frozen=True, kw_only=True, repr=False)
class Formula(Model):
    """Outputs that are a sum of terms, each a parameter times something that was recorded."""

    called: ClassVar[str] = "a formula"

    terms: Mapping[str, Callable[[SimpleNamespace], Mapping[str, np.ndarray]]]

    def of(self, recording, output):
        """(n, parameters) what each parameter is multiplied by, zero where it is not in an output."""
        own = self.terms[output](SimpleNamespace(**recording.signals))
        return np.array([own.get(p.name, np.zeros(len(recording))) for p in self.parameters]).T


@simulate.register(Formula)
def _simulated(model, recording, start=None):
    measured = [recording[name] if name in recording else np.full(len(recording), np.nan) for name in model.outputs]
    predicted = [model.of(recording, name) @ model.values for name in model.outputs]
    run = np.concatenate([np.full(stop - begin, k) for k, (begin, stop) in enumerate(recording.runs)])
    return Prediction(np.arange(len(recording)), np.array(predicted).T, np.array(measured).T, run)


@estimated.register(Formula)
def _estimated(model, task: FitTask):
    data = join(task.recordings, "training data")
    A = np.vstack([model.of(data, name) for name in model.outputs])
    y = np.concatenate([data[name] for name in model.outputs])
    x, _, _, _ = np.linalg.lstsq(A, y, rcond=None)
    left = y - A @ x
    covariance = np.linalg.inv(A.T @ A) * (left @ left) / (len(y) - len(x))
    fitted = model.with_parameters(*unpack(model.parameters, x))
    stage = Stage(
        model=model.name, closed_loop=False, status="converged", converged=True, steps=1, history=(float(left @ left),),
        starts=(float(left @ left),), strengths={}, strengths_from="", tried=(),
        noise={name: float(np.std(left)) for name in model.outputs},
        cpu_seconds=0.0, cross_validation_seconds=0.0, certificate=None,
    )  # fmt: skip
    sd = {p.name: np.sqrt(covariance[k, k]) for k, p in enumerate(model.parameters)}
    return Fit(
        model=fitted, sd=sd, per_run={}, stages=(stage,), metrics={}, data=(), mode="given", seed=task.how.seed,
        covariance=covariance,
    )  # fmt: skip


def turning(kind=Formula):
    return kind(
        name="turning",
        about="yaw rate as the wheels point, less what understeer takes",
        inputs=("v_x", "steer"),
        outputs=("yaw_rate",),
        parameters=(
            gb.models.Parameter("curvature", "1/m", 2.0, (0.1, 10.0), about="one over the wheelbase"),
            gb.models.Parameter("understeer", "s^2/m^3", 0.0, (-10.0, 10.0), about="what it loses with speed"),
        ),
        terms={
            "yaw_rate": lambda u: {"curvature": u.v_x * np.tan(u.steer), "understeer": -(u.v_x**3) * np.tan(u.steer)}
        },
    )


@pytest.fixture(scope="module")
def laps():
    one, other = (gb.read(gb.datasets.shipped(f"racer_{name}"), columns="roboracer") for name in ("train", "valid"))
    return one.rows(0, 800), other.rows(0, 400)


@pytest.fixture(scope="module")
def fit(laps):
    return gb.fit(turning(), laps[0], validation=laps[1])


def test_it_is_fitted_judged_and_scored(fit, laps):
    data = laps[0]
    A = turning().of(data, "yaw_rate")
    assert fit.params.to_numpy() == pytest.approx(np.linalg.solve(A.T @ A, A.T @ data["yaw_rate"]), rel=1e-6)
    assert fit.stderr.to_numpy() == pytest.approx(np.sqrt(np.diag(fit.covariance)))
    left = data["yaw_rate"] - A @ fit.params.to_numpy()
    score = fit.score(data)
    assert score["protocol"].tolist() == ["free run"]
    assert score["rmse"].tolist() == pytest.approx([np.sqrt(np.mean(left**2))])
    assert set(fit.metrics) == {"train", "validate"}
    assert fit.verdict is not None
    np.testing.assert_allclose(fit.residuals(data)["yaw_rate"], left, atol=1e-12)
    assert "curvature" in fit.summary()
    assert "free run of whole manoeuvres" in " ".join(fit.summary().split())


def test_it_is_saved_and_loaded(fit, laps, tmp_path):
    again = gb.load(fit.save(tmp_path / "fit.json"), models=[turning()])
    assert type(again.model) is Formula
    assert again.model.origin.file.endswith("test_kinds.py")
    assert (again.params == fit.params).all()
    ahead = gb.predict(again, laps[1])["yaw_rate"]
    np.testing.assert_array_equal(ahead, gb.simulate(fit, laps[1])["yaw_rate"])


def test_it_is_reported_and_compared(fit, laps, tmp_path):
    page = gb.report(fit, tmp_path / "fit.html").read_text(encoding="utf-8")
    assert all(words in page for words in ("Errors in free run", "Residual analysis", "one over the wheelbase"))
    kinematic = gb.fit("kinematic", laps[0], validation=laps[1], vehicle="roboracer")
    both = gb.report([fit, kinematic], tmp_path / "both.html").read_text(encoding="utf-8")
    assert "turning" in both
    assert "kinematic" in both


def test_what_it_cannot_is_a_sentence(fit, laps, tmp_path):
    lap = laps[0]
    for asked, words in (
        (
            lambda: gb.fit(turning(), lap, options=gb.FitOptions(horizon=1.0)),
            "cannot be used with turning, which is a f",
        ),
        (lambda: gb.predict(fit, lap, horizon=0.5), "turning runs freely from the start of each run"),
        (lambda: gb.profile(fit, "curvature"), "turning is a formula; its fits solve no least-squares problem"),
        (lambda: gb.track(fit, lap), "turning is a formula; filters track equations of motion"),
        (lambda: gb.diagnose(fit, lap), "turning is no model of motion; a gap can be diagnosed for these"),
        (lambda: gb.adapt(fit, lap, seconds=12), "A fit of turning cannot be adapted"),
        (lambda: gb.export(fit, tmp_path / "c", target="c"), "turning is no model of motion; this target takes"),
        (lambda: fit.linearise(v_x=2.0), "turning is no model of motion; only these are linearised"),
        (lambda: turning() + gb.effects.steering_delay, "Effect steering_delay acts on"),
    ):
        with pytest.raises((gb.BadInput, gb.BadModel), match=words):
            asked()


def test_it_is_exported_where_it_says_what_motion_it_amounts_to(tmp_path):
    class Moving(Formula):
        called = "a formula that moves"

    @equations_of_motion.register(Moving)
    def moved(model, wanted=""):
        def dynamics(x, u, p, q):
            return {"yaw_rate": 10.0 * (p.curvature * u.v_x * u.steer - x.yaw_rate)}

        return MotionModel(
            name=model.name, about=model.about, inputs=model.inputs, outputs=model.outputs,
            parameters=model.parameters, states=(gb.models.State("yaw_rate", "rad/s"),), dynamics=dynamics,
        )  # fmt: skip

    gb.export(turning(Moving), tmp_path / "c", target="c")
    manifest = json.loads((tmp_path / "c" / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["parameters"]["curvature"]["value"] == 2.0


def test_an_effect_acts_on_a_kind_that_says_how():
    class Scaled(Formula):
        pass

    @acting.register(Scaled)
    def scaled(model, effect):
        return (effect.parameter, lambda own: own) if effect.name == "steering_ratio" else None

    model = turning(Scaled)
    assert (model + gb.effects.steering_ratio).effects == ("steering_ratio",)
    assert not gb.effects.steering_ratio.concerns(turning())


def test_a_kind_answers_for_its_subclasses_and_others_are_told_so():
    @by_kind
    def asked(model: Model, more: str = "") -> str:
        """What is asked."""
        return f"nobody{more}"

    asked.register(Formula)(lambda model, more="": f"formula{more}")

    class Special(Formula):
        pass

    special = turning(Special)
    assert asked(build("lateral"), more="!") == "nobody!"
    assert asked(turning()) == asked(special) == "formula"
    asked.register(Special)(lambda model, more="": "special")
    assert (asked(turning()), asked(special)) == ("formula", "special")
    assert asked.__doc__ == "What is asked."
    with pytest.raises(gb.BadInput, match="lateral is a model of motion; a model with memory is needed here"):
        must_be(MemoryModel, build("lateral"))


def test_a_kind_is_imported_when_a_model_of_it_is_first_asked_about():
    code = (
        "import sys; from greybox_id.models.registry import build;"
        "from greybox_id.fitting.scores.metrics import predicted_how;"
        "assert 'greybox_id.fitting.scores.motion' not in sys.modules;"
        "assert predicted_how(build('kinematic'), 0.5, False)"
        " == ('0.5 s ahead', {'horizon': 0.5}); assert 'greybox_id.fitting.scores.memory' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_commands_take_it_from_its_file(fit, tmp_path):
    path, lap = fit.save(tmp_path / "fit.json"), gb.datasets.shipped("racer_valid")
    assert "turning" in refused("validate", path, lap, "--columns", "roboracer")
    with known():  # no longer than for this
        done = greybox("validate", path, lap, "--columns", "roboracer", "--own", f"{__file__}:turning", "--json")
    assert [list(metric) for metric in done.told["metrics"].values()] == [["free run"]], done.err
