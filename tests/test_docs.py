"""What the pages of docs/ show runs, and says what they say it does."""

import json
import re
from ast import literal_eval
from importlib import import_module
from pathlib import Path

import matplotlib as mpl
import pytest
from documents import DOCS, page, run_page

from greybox_id.fitting.uncertainty.identifiability import TOGETHER
from greybox_lab.virtual.synthetic_racer.car import Car

PACKAGE = DOCS.parent / "greybox_id"
CAR = Car()
"""What the tutorial's recordings are of."""


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("GREYBOX_CONFIG", "GREYBOX_COMPILE"):  # as a reader has it, whatever fixtures of a session are up
        monkeypatch.delenv(name, raising=False)


@pytest.mark.slow
def test_the_tutorial_leads_from_a_csv_to_c_code():
    run_page("tutorial.md")
    fitted = json.loads(Path("run/fit.json").read_text(encoding="utf-8"))["parameters"]
    for name, truth in {"m": CAR.m, "I_z": CAR.I_z, "l_f": CAR.l_f, "l_r": CAR.l_r}.items():
        low, high = fitted[name]["interval"]
        assert low < truth < high, name
    low, high = fitted["steering_lag"]["interval"]
    assert low < CAR.steer_lag + CAR.steer_delay < high
    rows = re.findall(r"^\| (\w+) \| ([\d.]+) (?:kg m²|kg|m) \|", page("tutorial.md"), re.MULTILINE)
    assert {name: float(value) for name, value in rows} == {n: getattr(CAR, n) for n in ("m", "I_z", "l_f", "l_r")}
    assert Path("run/report.pdf").read_bytes().startswith(b"%PDF")


def test_a_model_of_ones_own_is_fitted_and_read_back():
    names = run_page("own_model.md")
    assert names["again"].model.values == pytest.approx(names["found"].model.values)
    assert 0.2 < float(names["found"].model["L"].array) < 0.4
    assert names["found"].metrics["validate"]["free run"]["yaw_rate"]["rmse"] < 0.2


def test_an_effect_of_ones_own_is_estimated():
    low, high = run_page("own_effect.md")["found"].conf_int().loc["soft_steering"]
    assert low < 3.733e-4 < high < 5e-4  # m (l_r C_r - l_f C_f) / (L^2 C_f C_r) of full_size_car


@pytest.mark.slow
def test_the_readmes_python_runs():
    mpl.use("Agg")
    names = run_page("../README.md")
    assert 0.02 < names["fit"].params["steering_delay"] < 0.2
    assert Path("run/fit.json").exists()
    assert "C_alpha_f_sd" in names["track"]
    assert Path("car/car.c").exists()
    assert Path("lap.pdf").read_bytes().startswith(b"%PDF")


def test_the_numbers_of_the_mathematics_are_those_of_the_code():
    rows = re.findall(r"^\| `([\w.]+)` \| (`.+) \|$", page("mathematics.md"), re.MULTILINE)
    numbers = [(place, *number.split(" = ")) for place, numbers in rows for number in numbers.split("; ")]
    assert len(numbers) > 30
    for place, name, value in numbers:
        constant = getattr(import_module(f"greybox_id.{place}"), name.strip("`"))
        assert constant == literal_eval(value), f"{place}.{name}"


def test_the_glossary_says_what_words_of_the_output_mean():
    words = [row.split(" | ")[0].removeprefix("| ") for row in page("glossary.md").splitlines() if row.startswith("| ")]
    assert len(words) == len(set(words) - {"word"}) + words.count("word")
    shown = "persistence, fit %, FVU, free run, profile, innovation, NIS, absorbed, neutral value"
    shown += ", below the detection limit"
    assert set(shown.split(", ")) < set(words)
    for sentence in ("dominated by the prior", "identifiable only in combination", f"correlation beyond {TOGETHER}"):
        assert sentence in page("glossary.md")
    assert "`docs/glossary.md`" in page("../README.md")


def test_files_that_the_mathematics_name_are_there():
    prose = re.sub(r"^```.*?^```$", "", page("mathematics.md"), flags=re.MULTILINE | re.DOTALL)
    places = [PACKAGE, PACKAGE.parent / "greybox_lab"]
    files = {path.relative_to(PACKAGE.parent).as_posix() for place in places for path in place.rglob("*.py")}
    for name in re.findall(r"`([\w/]+(?:\.py|/))`", prose):
        own = (
            any((place / name).is_dir() for place in (PACKAGE, PACKAGE.parent))
            if name.endswith("/")
            else any(f"/{file}".endswith(f"/{name}") for file in files)
        )
        assert own or name == "greybox_id/", name
