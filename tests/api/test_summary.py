"""`summary()` is what the command prints."""

import pytest
from calling import greybox
from driven import driven, written

import greybox_id as gb


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("laps")


@pytest.fixture(scope="module")
def laps(folder):
    return [written(driven("lateral", seed=seed), folder / f"lap{seed}.csv") for seed in (0, 10)]


@pytest.fixture(scope="module")
def fitted(laps, folder):
    called = greybox("fit", "--model", "lateral", laps[0], "--vehicle", "full_size_car", "--validate", laps[1],
                     "--horizon", "2", "--fix", "m", "--out", folder)  # fmt: skip
    assert called.code in (0, 3), called.err
    return called.out, gb.load(folder / "fit.json")


def lines(text):
    return [line.rstrip() for line in text.strip().splitlines()]


def test_of_a_fit(fitted):
    printed, fit = fitted
    own = lines(fit.summary())
    assert len(own) > 20
    assert [line for line in lines(printed)[: len(own) + 1] if not line.startswith("vehicle")] == own


def test_of_a_fit_that_was_just_made_names_its_vehicle(laps):
    fit = gb.fit("kinematic", laps[0], vehicle="full_size_car", options=gb.FitOptions(solver="gauss-newton"))
    assert "vehicle  full-size car" in fit.summary()


def test_of_a_validation(fitted, laps, folder):
    _, fit = fitted
    printed = greybox("validate", folder / "fit.json", laps[1]).out.replace(str(laps[1]), "lap10")
    found = fit.validate(str(laps[1]))
    assert printed.split() == found.summary().split()  # columns are as wide as the name of the file
    assert found.verdict.usability in repr(found)


def test_of_profiles(fitted, laps, folder):
    from greybox_id.api.profiles import profiles

    _, fit = fitted
    printed = greybox("profile", folder / "fit.json", "--parameter", "I_z").out
    assert lines(printed) == lines(profiles(fit, ["I_z"], fit.seen("train")).summary())


def test_of_a_track(laps, folder):
    printed = greybox("track", laps[0], "--vehicle", "full_size_car", "--model", "lateral", "--parameters", "C_alpha_f",
                      "--readings", "yaw_rate,a_y", "--tune", "0", "--out", folder / "estimates.csv").out  # fmt: skip
    options = gb.TrackOptions(readings=("yaw_rate", "a_y"), tune=0.0, known=gb.Vehicle.load("full_size_car").noise)
    track = gb.track("lateral", laps[0], "C_alpha_f", vehicle="full_size_car", options=options)
    own = lines(track.summary())
    assert lines(printed)[: len(own)] == own


def test_of_a_gap(laps, monkeypatch):
    from made_gaps import clear

    from greybox_id.api.gap_result import GapResult

    monkeypatch.setattr("greybox_id.api.diagnosing.diagnose_gap", lambda *_, **__: clear())
    printed = greybox("gap", laps[0], "--vehicle", "full_size_car", "--model", "lateral").out
    said = [line for line in lines(printed) if not line.startswith("Doubt")]
    assert said == lines(GapResult.of(clear(), None).summary())
