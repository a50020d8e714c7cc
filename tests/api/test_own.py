"""A model of at most 20 lines and an effect of at most 10 go all the way, and no file runs code by itself."""

import json
import shutil
from importlib.metadata import EntryPoint
from pathlib import Path

import casadi
import pytest
from calling import greybox

import greybox_id as gb
from greybox_id.models import registry
from greybox_id.models.effects import EFFECTS

HERE = Path(__file__).parent
SHIPPED = HERE.parents[1] / "greybox_id" / "datasets" / "shipped"
OTHERS = ("steering_delay", "steering_lag", "steering_ratio")
pytestmark = pytest.mark.usefixtures("nothing_stays_known")
OWN = ("--own", "my_car.py:own_model", "--own", "my_effects.py:soft_steering")


def lines(file):
    return [line for line in (HERE / file).read_text(encoding="utf-8").splitlines() if line.strip()]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    shutil.copy(HERE / "own_car.py", tmp_path / "my_car.py")
    shutil.copy(HERE / "own_effects.py", tmp_path / "my_effects.py")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def lap():
    return gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 600)


def test_they_are_short():
    assert len(lines("own_car.py")) <= 20
    assert len(lines("own_effects.py")) <= 10


def test_they_go_all_the_way_in_python(folder, lap):
    model, soft = gb.models.own("my_car.py:own_model"), gb.effects.own("my_effects.py:soft_steering")
    for name in ("slow_turner", "soft_steering"):
        registry.MODELS.pop(name, None), EFFECTS.pop(name, None)  # objects alone are to do
    fit = gb.fit(model + soft.free(), lap)
    path = fit.save("fit.json")
    again = gb.load(path, models=model, effects=soft)
    assert again.params.equals(fit.params)
    assert again.model["soft_steering"].null == 0.0
    gap = gb.diagnose(gb.fit(model, lap), lap, effects=[soft, *OTHERS])
    assert gap.ranking
    assert {cause.effect for cause in gap.ranking} <= {"soft_steering", *OTHERS, "timestamp_jitter", "held_samples"}
    assert gb.report(fit, "fit.html").read_text(encoding="utf-8").count("slow_turner")
    assert gb.report(gap, "gap.html", effects=[soft]).exists()
    assert (folder / "car" / "car.c") in [file.resolve() for file in gb.export(fit, "car")]
    assert "slow_turner" not in registry.MODELS
    assert "soft_steering" not in EFFECTS


def test_they_go_all_the_way_on_the_command_line(folder):
    recording = (str(SHIPPED / "racer_valid.csv"), "--columns", "roboracer")
    asked = ("--model", "my_car.py:own_model", "--with", "my_effects.py:soft_steering")
    assert greybox("fit", *asked, *recording, "--out", "run").code in {0, 3}  # a rough model: its verdict may be that
    record = json.loads(Path("run/fit.json").read_text(encoding="utf-8"))["model"]["origins"]
    assert {name: own["file"] for name, own in record.items()} == {
        "slow_turner": "my_car.py", "soft_steering": "my_effects.py",
    }  # fmt: skip
    assert all(len(own["sha256"]) == 64 for own in record.values())
    for command in (
        ("validate", "run/fit.json", *recording),
        ("report", "run/fit.json", "--out", "run/fit.html"),
        ("export", "run/fit.json", "--target", "c", "--out", "run/car"),
    ):
        assert greybox(*command, *OWN).code in {0, 3}


@pytest.mark.slow
def test_the_gap_of_an_own_model_is_closed_by_an_own_effect_on_the_command_line(folder):
    lap = gb.read(str(SHIPPED / "racer_valid.csv"), columns="roboracer").rows(0, 600)
    lap.to_pandas().to_csv("lap.csv", index=False)
    assert greybox("fit", "--model", "my_car.py:own_model", "lap.csv", "--out", "run").code in (0, 3)
    registry.MODELS.pop("slow_turner")
    called = greybox("gap", "lap.csv", "--fit", "run/fit.json", *OWN, "--out", "gap", "--json")
    assert called.code == 0, called.err
    assert "soft_steering" in {cause["effect"] for cause in called.told["ranking"]} | {*called.told["not_excited"]} | {
        *called.told["absorbed"]
    }
    assert greybox("report", "gap/gap.json", *OWN, "--out", "gap.html").code == 0
    registry.MODELS.pop("slow_turner"), EFFECTS.pop("soft_steering")
    said = greybox("gap", "lap.csv", "--fit", "run/fit.json").err
    assert "slow_turner in my_car.py" in said
    assert "--own" in said


def test_a_fits_file_runs_nothing_and_says_what_it_lacks(folder, lap):
    model = gb.models.own("my_car.py:own_model")
    path = gb.fit(model, lap, options=gb.FitOptions(solver="gauss-newton")).save("fit.json")
    registry.MODELS.pop("slow_turner")
    Path("my_car.py").write_text("raise SystemExit('this ran')", encoding="utf-8")
    with pytest.raises(gb.BadInput, match=r"slow_turner in my_car\.py \(sha256 [0-9a-f]{12}.*never runs code"):
        gb.load(path)
    called = greybox("validate", str(path), str(SHIPPED / "racer_valid.csv"), "--columns", "roboracer")
    assert called.code == 2
    assert "my_car.py" in called.err
    assert "this ran" not in called.err


def test_equations_that_have_changed_since_are_warned_of(folder, lap):
    path = gb.fit(gb.models.own("my_car.py:own_model"), lap, options=gb.FitOptions(solver="gauss-newton")).save(
        "fit.json"
    )
    text = Path("my_car.py").read_text(encoding="utf-8")
    Path("my_car.py").write_text(text.replace("ca.tan", "ca.sin"), encoding="utf-8")
    with pytest.warns(UserWarning, match=r"saved with slow_turner in my_car\.py .* Fit again"):
        gb.load(path, models="my_car.py:own_model")


def test_a_file_of_defaults_may_not_name_code(folder):
    Path("greybox.toml").write_text('[fit]\nmodel = "my_car.py:own_model"\n', encoding="utf-8")
    called = greybox("fit", str(SHIPPED / "racer_valid.csv"))
    assert called.code == 2
    assert "names a file to run" in called.err


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("x = 1\n", "my_car.py has no own_model. It has no model and no effect."),
        ("def own_model(:\n", "my_car.py, line 1: SyntaxError"),
        ("x = 1\n\ny = 1 / 0\n", "my_car.py, line 3: ZeroDivisionError: division by zero"),
        ("own_model = 3\n", "my_car.py:own_model must give a model, but gives 3"),
    ],
)
def test_what_is_wrong_with_a_file_is_a_sentence(folder, text, sentence):
    Path("my_car.py").write_text(text, encoding="utf-8")
    with pytest.raises(gb.BadInput) as error:
        gb.models.own("my_car.py:own_model")
    assert sentence in str(error.value)


def test_a_function_may_make_the_model(folder):
    Path("made.py").write_text(
        Path("my_car.py").read_text(encoding="utf-8") + "\ndef make():\n    return own_model\n", encoding="utf-8"
    )
    assert gb.models.own("made.py:make").name == "slow_turner"


def test_a_shipped_name_is_not_taken(folder):
    text = Path("my_car.py").read_text(encoding="utf-8").replace("slow_turner", "lateral")
    Path("my_car.py").write_text(text, encoding="utf-8")
    with pytest.raises(gb.BadInput, match="is called lateral"):
        gb.models.own("my_car.py:own_model")


def test_installed_packages_bring_models_and_effects(folder, monkeypatch):
    model, soft = gb.models.own("my_car.py:own_model"), gb.effects.own("my_effects.py:soft_steering")
    registry.MODELS.pop("slow_turner"), EFFECTS.pop("soft_steering")

    class Point(EntryPoint):
        def load(self):
            return {"m": model, "e": soft}[self.name]

    points = {
        "greybox_id.models": [Point("m", "pkg:m", "greybox_id.models"), Point("broken", "pkg:b", "greybox_id.models")],
        "greybox_id.effects": [Point("e", "pkg:e", "greybox_id.effects")],
    }
    monkeypatch.setattr(registry, "entry_points", lambda group: points[group])
    registry.install.cache_clear()
    with pytest.warns(UserWarning, match="broken"):
        assert "slow_turner" in gb.models.names()
    assert gb.models.slow_turner().name == "slow_turner"
    assert gb.effects.soft_steering is soft
    registry.install.cache_clear()
    monkeypatch.undo()
    registry.install()


@pytest.mark.parametrize(
    ("code", "says"),
    [
        ("def made(): return 1 / 0", "line 1: ZeroDivisionError"),
        ("import sys; sys.exit(3)", "line 1: SystemExit: 3"),
        ("def made():\n    raise SystemExit", "line 2: SystemExit"),
    ],
)
def test_a_file_that_fails_is_a_sentence_with_its_line(code, says, tmp_path):
    (tmp_path / "failing.py").write_text(code)
    with pytest.raises(gb.BadInput, match=says):
        gb.models.own(f"{tmp_path / 'failing.py'}:made")


def test_an_effect_that_fails_is_a_sentence_with_its_line(lap):
    failing = gb.effects.alteration(
        "steering", "failing", "1", 0.0, (0.0, 1.0), "nothing", typical=0.1, steer=lambda steer, q: steer / int("a")
    )
    with pytest.raises(gb.BadModel, match=r"test_own.py, line \d+\).*ValueError"):
        gb.fit(gb.models.kinematic(vehicle="roboracer") + failing, lap)


def test_equations_that_give_no_numbers_are_a_sentence(lap):
    lost = gb.models.MotionModel(
        name="lost", about="", states=(gb.models.State("yaw_rate", "rad/s"),), inputs=("steer",), outputs=("yaw_rate",),
        parameters=(gb.models.Parameter("L", "m", 0.3, (0.1, 1.0)),),
        dynamics=lambda x, u, p, q: {"yaw_rate": casadi.sqrt(-1 - x.yaw_rate**2) * p.L},
    )  # fmt: skip
    with pytest.raises(gb.BadInput, match="gives no finite predictions"):
        gb.fit(lost, lap)
