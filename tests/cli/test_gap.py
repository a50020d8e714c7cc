"""`greybox gap`: files in, a diagnosis out; the diagnosis itself is made by hand here."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from calling import greybox, refused
from driven import driven, without, written
from made_gaps import CASES, clear, none, unknown
from rich.console import Console

from greybox_id.cli.gap import show
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.verb import fit
from greybox_id.models.effects import vocabulary
from greybox_id.models.registry import build, model_of
from greybox_id.models.vehicle import vehicle as read_vehicle
from greybox_id.reports.gap.saved import load_gap

pytestmark = pytest.mark.usefixtures("_uncompiled")


@pytest.fixture(scope="module")
def laps(tmp_path_factory):
    folder = tmp_path_factory.mktemp("laps")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GREYBOX_COMPILE", "0")
        return [written(driven("single_track", runs=1, seconds=4.0, seed=s), folder / f"lap{s}.csv") for s in (7, 8, 9)]


@pytest.fixture
def asked(monkeypatch):
    """Stands in for the diagnosis: it says what it is told to say, and keeps what it was asked."""

    class Asked:
        said = clear()

    def diagnose(model, recordings, effects, *, vehicle, held_out, say, **options):
        say("linearising", passing=True)
        say("ranking 3 effects")
        Asked.model, Asked.recordings, Asked.effects, Asked.vehicle = model, recordings, effects, vehicle
        Asked.held_out, Asked.options = held_out, options
        return Asked.said

    monkeypatch.setattr("greybox_id.api.diagnosing.diagnose_gap", diagnose)
    return Asked


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fitted")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GREYBOX_COMPILE", "0")
        drive = driven("lateral", runs=1, seconds=4.0)
        model = build("lateral", None, {"yaw_rate_bias": 0.01}, read_vehicle("full_size_car"))
        held = [replace(p, fixed=True) for p in model.parameters if p.name not in ("I_z", "yaw_rate_bias")]
        found = fit([model.with_parameters(*held)], [drive], how=FitOptions(horizon=1.0, solver="gauss-newton"))
        return found.save(folder / "fit.json")


def test_json_is_one_object_with_what_was_found(laps, asked):
    called = greybox("gap", laps[0], "--vehicle", "full_size_car", "--held-out", laps[1], "--json", "--seed", "3")
    assert called.code == 0, called.err
    told = called.told
    assert told["gap_detected"] is True
    assert set(told["where"]) >= {"channel", "regime", "equations", "time"}
    first = told["ranking"][0]
    assert set(first) >= {"effect", "probability", "magnitude", "unit", "interval", "indistinguishable_from"}
    assert first["magnitude"] == 0.031
    assert set(told["gap"]) >= {"before", "after", "floor", "closed", "closed_interval"}
    assert told["held_out"]["recordings"] == ["lap8"]
    assert told["applied"] == ["steering_delay"]
    assert told["seed"] == 3
    assert told["vehicle"] == "full-size car"
    assert told["command"].startswith("greybox gap ")
    assert "ranking 3 effects" in called.err
    assert asked.options == {"seed": 3, "horizons": False}
    assert asked.model.name == "single_track"
    assert [recording.name for recording in asked.recordings] == ["lap7"]
    assert [own.name for own in asked.held_out] == ["lap8"]
    assert asked.effects == vocabulary()


def test_json_is_finite_whatever_the_diagnosis_holds(laps, asked):
    asked.said = replace(none(), p_value=np.float64(0.5), where=replace(none().where, time={"from": np.float32(1.5)}))
    called = greybox("gap", laps[0], "--vehicle", "full_size_car", "--json")
    assert called.code == 0, called.err
    assert called.told["gap"]["closed"] is None
    assert called.told["p_value"] == 0.5
    assert called.told["where"]["time"] == {"from": 1.5}


def test_a_gap_is_no_failure_unless_it_is_checked_for(laps, asked):
    arguments = ("gap", laps[0], "--vehicle", "full_size_car")
    assert greybox(*arguments).code == 0
    checked = greybox(*arguments, "--check", "--json")
    assert checked.code == 1
    assert checked.told["gap_detected"]
    asked.said = none()
    assert greybox(*arguments, "--check").code == 0


def test_next_is_computed_where_an_arena_is_named(laps, asked):
    arguments = ("gap", laps[0], "--vehicle", "full_size_car", "--arena")
    assert "--arena" in refused(*arguments, "moon")
    pair = ("accel_bias_x", "imu_mount_pitch")
    ranking = [replace(clear().ranking[0], effect=own, probability=0.5, indistinguishable_from=pair) for own in pair]
    asked.said = clear(ranking=tuple(ranking))
    said = " ".join(greybox(*arguments, "disc:40").out.split())
    assert "Next accel_bias_x and imu_mount_pitch produce the same readings in every manoeuvre, so no manoeuvre" in said


def test_applied_effects_become_a_vehicle_that_simulates(laps, asked, tmp_path):
    closed = tmp_path / "car_closed.toml"
    called = greybox("gap", laps[0], "--vehicle", "full_size_car", "--apply", closed)
    assert called.code == 0, called.err
    assert f"written {closed}" in " ".join(called.out.split())
    assert float(model_of(read_vehicle(closed))["steering_delay"].array) == 0.031
    out = tmp_path / "s.csv"
    with_option = tmp_path / "o.csv"
    assert greybox("simulate", "--vehicle", closed, laps[1], "--out", out).code == 0
    same = ("--model", "single_track", "--vehicle", "full_size_car", "--with", "steering_delay=31ms")
    assert greybox("simulate", *same, laps[1], "--out", with_option).code == 0
    pd.testing.assert_frame_equal(pd.read_csv(out), pd.read_csv(with_option))


def test_a_folder_takes_the_diagnosis_its_picture_report_and_vehicle(laps, asked, tmp_path):
    asked.said = clear(strip=None)
    called = greybox("gap", laps[0], "--vehicle", "full_size_car", "--out", tmp_path / "gap", "--json")
    assert called.code == 0, called.err
    assert {file.name for file in (tmp_path / "gap").iterdir()} == {"gap.json", "gap.png", "gap.pdf", "closed.toml"}
    kept = json.loads((tmp_path / "gap" / "gap.json").read_text())
    assert kept["ranking"] == called.told["ranking"]
    assert load_gap(tmp_path / "gap" / "gap.json")[0].recordings == tuple(called.told["recordings"])
    assert called.told["written"] == [
        str(tmp_path / "gap" / name) for name in ("gap.json", "closed.toml", "gap.png", "gap.pdf")
    ]
    assert called.told["data"][0]["sha256"]
    assert model_of(read_vehicle(tmp_path / "gap" / "closed.toml")).effects == ("steering_delay",)


def test_a_failure_leaves_what_was_there_and_the_answer_is_told(laps, asked, tmp_path, monkeypatch):
    asked.said = clear(strip=None)
    report = tmp_path / "gap.pdf"
    report.write_text("%PDF-1.7 greybox-id before")
    monkeypatch.setattr("greybox_id.reports.pdf.rendered", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        greybox("gap", laps[0], "--vehicle", "full_size_car", "--report", report)
    assert report.read_text() == "%PDF-1.7 greybox-id before"
    assert [file.name for file in tmp_path.iterdir()] == ["gap.pdf"]


def test_nothing_to_apply_is_said(laps, asked, tmp_path):
    asked.said = none()
    called = greybox("gap", laps[0], "--vehicle", "full_size_car", "--apply", tmp_path / "same.toml")
    assert called.code == 0
    assert "no effect was found to apply" in called.err
    assert model_of(read_vehicle(tmp_path / "same.toml")).effects == ()


def test_a_fit_brings_its_model_and_its_numbers(laps, asked, fitted):
    called = greybox("gap", laps[0], laps[1], "--fit", fitted, "--json")
    assert called.code == 0, called.err
    assert asked.model.name == "lateral"
    assert asked.model.effects == ("yaw_rate_bias",)
    assert asked.model["m"].fixed
    assert asked.vehicle.values["I_z"].value == float(asked.model["I_z"].array)
    assert len(asked.recordings) == 2


def test_the_vehicle_s_own_model_is_taken_unless_another_is_named(laps, asked, tmp_path):
    own = tmp_path / "car.toml"
    stated = read_vehicle("full_size_car").values
    numbers = "\n".join(f"{name} = {value.value}" for name, value in stated.items())
    model = '[model]\nname = "lateral"\ntyre = "brush"\neffects = { yaw_rate_bias = 0.01 }'
    own.write_text(f"{model}\n[parameters]\n{numbers}")
    assert greybox("gap", laps[0], "--vehicle", own).code == 0
    assert (asked.model.name, asked.model.settings["tyre"]) == ("lateral", "brush")
    assert greybox("gap", laps[0], "--vehicle", own, "--model", "lateral").code == 0
    assert asked.model.effects == ("yaw_rate_bias",)
    assert greybox("gap", laps[0], "--vehicle", own, "--model", "single_track").code == 0
    assert (asked.model.name, asked.model.effects) == ("single_track", ())


def test_a_vehicle_beside_a_fit_states_its_sensors(laps, asked, fitted):
    called = greybox("gap", laps[0], "--fit", fitted, "--vehicle", "full_size_car", "--json")
    assert called.code == 0, called.err
    file, car = read_vehicle("full_size_car"), asked.vehicle
    assert car.noise == file.noise
    assert set(car.effects) == set(file.effects)
    assert car.values["I_z"].value != file.values["I_z"].value
    assert car.model.effects.keys() == {"yaw_rate_bias"}


def test_bad_input_is_a_sentence(laps, asked, fitted, tmp_path):
    lap, car = laps[0], ("--vehicle", "full_size_car")
    assert "Name the vehicle with --vehicle, or a fit with --fit" in refused("gap", lap)
    assert "a fit has its own model" in refused("gap", lap, "--fit", fitted, "--model", "lateral")
    assert "model with memory" in refused("gap", lap, *car, "--model", "msnn_lat")
    assert "no vehicle" in refused("gap", lap, "--vehicle", "nothing")
    assert "nothing.csv" in refused("gap", tmp_path / "nothing.csv", *car)
    assert "nothing.csv" in refused("gap", lap, *car, "--held-out", tmp_path / "nothing.csv")
    assert "the same data" in refused("gap", lap, *car, "--held-out", lap)
    assert ".pdf" in refused("gap", lap, *car, "--report", tmp_path / "report.docx")
    assert ".toml or .json" in refused("gap", lap, *car, "--apply", tmp_path / "car.txt")
    assert "would be overwritten" in refused("gap", lap, "--fit", fitted, "--apply", fitted)
    (tmp_path / "file").touch()
    assert "cannot be written" in refused("gap", lap, *car, "--out", tmp_path / "file" / "inside")
    drive = driven("single_track", runs=1, seconds=2.0)
    no_steer = written(without(drive, "steer"), tmp_path / "no_steer.csv")
    assert "lacks steer" in refused("gap", no_steer, *car)
    nothing_read = written(without(drive, "v_x", "v_y", "yaw_rate", "a_x", "a_y"), tmp_path / "blind.csv")
    assert "none of v_x, v_y, yaw_rate" in refused("gap", nothing_read, *car)
    assert "at least one file" in refused("gap", *car)


def test_a_vehicle_that_cannot_be_the_one_recorded_is_doubted(laps, asked, tmp_path):
    drive = driven("single_track", runs=1, seconds=4.0)
    force = drive.with_signals(drive_force=drive["ax_cmd"] * 1457.2)
    recording = written(without(force, "ax_cmd"), tmp_path / "force.csv")
    called = greybox("gap", recording, "--vehicle", "full_size_car", "--json")
    assert any("force_per_unit" in doubt for doubt in called.told["doubts"])


def printed(gap, width):
    out = Console(width=width, highlight=False, markup=False, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    show(out, gap)
    return out.export_text()


@pytest.mark.parametrize("width", [72, 100, 160])
@pytest.mark.parametrize("case", CASES)
def test_every_diagnosis_fits_every_terminal(case, width):
    text = printed(CASES[case](), width)
    assert max(map(len, text.splitlines())) <= width
    assert "…" not in text
    assert "nan" not in text.lower()


def test_a_person_reads_whether_where_which_and_how_far():
    words = " ".join(printed(clear(), 160).split())
    assert "in free run, with tolerances refitted, the error of yaw_rate is 3.1 times its noise (p < 0.001)" in words
    assert (
        "Where By equation: 78 % of the gap in steering and 15 % of the gap in M_z By driving: 78 % of the gap while "
        "the steering moves, in 22 % of the time" in words
    )
    assert "1 steering_delay 31 ± 3 ms 0.94 applied" in words
    assert "18 ms [5, 60] 0.04 cannot be distinguished from number 1 on this recording" in words
    assert "with steering_delay, the excess error falls by 84 % [76, 90] on the recording “lap8” (held out)" in words
    assert "yaw_rate [rad/s] 0.018 → 0.013 (0.012)" in words
    assert "below the detection limit here, so possibly present: mass_change up to 0.12" in words


def test_doubts_on_the_data_come_first():
    assert printed(CASES["aliased"](), 100).splitlines()[0].startswith("Doubt    lap7: a_y is 18 ms later")


def test_what_makes_things_worse_is_said():
    words = " ".join(printed(unknown(), 100).split())
    assert "increases the excess error by 12 % [−4, 30] on the recordings “lap8” and “lap9” (held out)" in words
    assert "all of the excess error is unexplained" in words


def test_without_held_out_recordings_that_is_said():
    words = " ".join(printed(CASES["aliased"](), 160).split())
    assert "on the recording “lap7”, from which the effect was chosen" in words
    assert "is unknown: name held-out recordings" in words


@pytest.mark.parametrize("rows", [3, 8, 24])
def test_a_recording_of_less_than_a_second_is_a_sentence(rows, tmp_path):
    short = written(driven("single_track", runs=1, seconds=2.0).rows(0, rows), tmp_path / "short.csv")
    assert "too short to show what a simulation lacks" in refused("gap", short, "--vehicle", "full_size_car")


@pytest.mark.slow
def test_thirty_rows_end_in_a_diagnosis_that_claims_nothing(tmp_path):
    short = written(driven("single_track", runs=1, seconds=2.0).rows(0, 30), tmp_path / "short.csv")
    called = greybox("gap", short, "--vehicle", "full_size_car", "--json")
    assert called.code == 0, called.err
    assert called.told["applied"] == []


def test_a_simulation_that_diverges_is_identifiable_in_words():
    """An error of 10^5 m/s is none: predictions that leave the range of the readings tenfold diverge."""
    found = clear()
    assert found.held_out is not None
    errors = tuple(replace(error, before=np.inf) for error in found.held_out.errors)
    screen = Console(width=160, record=True)
    with screen.capture() as shown:
        show(screen, replace(found, held_out=replace(found.held_out, errors=errors)))
    assert "diverges →" in shown.get()


@pytest.mark.slow
def test_what_changed_is_printed_and_written(laps, tmp_path, monkeypatch):
    monkeypatch.delenv("GREYBOX_COMPILE")
    after, *before = laps
    options = ["--since", *before, "--vehicle", "full_size_car", "--model", "single_track"]
    said = greybox("gap", after, *options).out
    assert "Changed" in said
    assert "Same" in said
    told = greybox("gap", after, *options, "--json").told
    assert {change["effect"] for change in told["changed"]} == set(told["applied"])
    assert {"since", "scatter", "drift", "changed", "not_changed"} <= set(told)


def test_a_fit_that_would_take_up_changes_says_what_tells_them(laps, asked, fitted):
    asked.said = replace(none(), absorbed=("grip_scale",))
    shown = greybox("gap", laps[0], "--fit", fitted, "--vehicle", "full_size_car").out
    assert "with recordings from before" in " ".join(shown.split())
    shown = greybox("gap", laps[0], "--vehicle", "full_size_car").out
    assert "from before" not in " ".join(shown.split())


def test_what_would_show_is_asked_before_a_run(tmp_path):
    lap = tmp_path / "lap.csv"
    lap.write_text("time,v_x,yaw_rate,steer\n0,5,0,0\n0.02,5,0,0\n")
    for words in (("--sensitivity",), (str(lap), "--since", str(lap), "--sensitivity")):
        called = greybox("gap", *words, "--vehicle", "full_size_car")
        assert called.code == 2
        assert "recordings from before" in called.err
