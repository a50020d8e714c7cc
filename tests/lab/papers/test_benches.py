"""Benches on others' ground: on stand-ins what is put in comes out; files that are none are sentences."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from calling import greybox, refused
from json_pages import PAGE, agree

import greybox_id as gb
from greybox_id.base.errors import BadInput
from greybox_id.fitting.how import quiet
from greybox_id.reports.document import Drawing, titled
from greybox_id.reports.figures.sheet import Sheet
from greybox_id.reports.text.document import on_screen
from greybox_lab.papers import a2rl, brakes, emps, ferrari, peers
from greybox_lab.papers.bench import PublishedBench, Row, frame, markdown
from greybox_lab.papers.equations import AHEAD, BEHIND, driven_rear, servo_axis


def test_a_page_has_every_figure_and_marks_what_is_published():
    rows = (
        Row("Yaw: RMSE", "ours", 0.5, "rad/s", 0.01, 12, 3.0),
        Row("Yaw: RMSE", "theirs", 0.7, "rad/s", published=True),
    )
    document = PublishedBench("one", "A title", "About it.", ("How.",), rows, ("Do this.",)).document()
    page = markdown(document, "greybox bench one --data DIR")
    for words in ("# A title", "greybox bench one --data DIR", "- Do this.", "## Yaw: RMSE",
                  "| ours | 0.500 ± 0.010 | 12 | 3.0 |",
                  "| theirs (published) | 0.700 | – | – |", "| :--- | ---: | ---: | ---: |"):  # fmt: skip
        assert words in page
    assert len(list(on_screen(document))) == 6
    drawn = replace(document, parts=(*document.parts, *titled("Seen", Drawing("seen", Sheet((90.0,)), "", ""))))
    assert list(on_screen(drawn))[-2:] == ["\nHow it was measured", "  How."]  # no heading of what is not shown


def laps(rows=600, seed=0):
    """A car that answers its steering target after two rows, on a path with bends; the servo is 35 ms late."""
    random = np.random.default_rng(seed)
    t = 0.05 * np.arange(rows + 40)
    steer = 0.05 * np.sin(0.4 * t) + 0.02 * np.sin(1.1 * t + seed)
    measured = np.interp(t - 0.035, t, steer)
    v = 35.0 + 5.0 * np.sin(0.1 * t)
    curvature = np.interp(t - 0.1, t, steer) / 3.2
    columns = {"ay": curvature * v**2, "ax": 0.5 * np.cos(0.1 * t),
               "az": 0.3 * np.sin(0.3 * t), "vx": v, "curv": curvature, "steer_target": steer,
               "steer_meas": measured + 1e-5 * random.standard_normal(len(t))}  # fmt: skip
    return pd.DataFrame(columns).iloc[20 : rows + 20].reset_index(drop=True)


def test_the_inverse_of_a_late_car_is_found_and_reads_no_row_far_behind():
    train, valid = laps(), laps(seed=1)
    fit = gb.fit(
        a2rl.inverse_steering(), [a2rl.turned(train, "steer_target")], options=gb.FitOptions(solver="gauss-newton")
    )
    off = a2rl.errors(fit, valid, "steer_target")
    assert len(off) == len(valid) - AHEAD + 1
    assert np.sqrt(np.nanmean(off**2)) < 0.03 * valid["steer_target"].std()
    p, age = fit.params, np.arange(-BEHIND, AHEAD)
    bell = np.exp(-0.5 * ((age - float(p["lead"])) / float(p["width"])) ** 2)
    middle, spread = np.average(age, weights=bell), np.cov(age, aweights=bell, ddof=0)
    late = middle + float(p["turn_in"]) * spread / (float(p["geometry"]) + float(p["balance"]))  # both move the path
    assert late == pytest.approx(2.0, abs=0.3)
    cut = a2rl.errors(fit, valid.iloc[100:].reset_index(drop=True), "steer_target")
    np.testing.assert_allclose(cut[BEHIND:], off[100 + BEHIND :], atol=1e-12)
    assert not np.allclose(cut[:BEHIND], off[100 : 100 + BEHIND], atol=1e-12)  # the first row stood for those before


def test_gravity_is_taken_off_the_lap_that_contains_it():
    lap = laps()
    level = a2rl.without_gravity(lap)
    np.testing.assert_allclose(level, lap)
    np.testing.assert_allclose(a2rl.without_gravity(lap.assign(az=lap["az"] + 9.81)), level)


@pytest.mark.slow
def test_a_servo_that_is_late_by_35_ms_is_found_in_both_laps():
    found = {}
    rows = a2rl.servo(laps(2000), laps(2000, seed=1), np.ones(2000, bool), found)
    for lap in ("training lap", "validation lap"):
        low, high = found[f"servo, {lap}, steering_delay"]
        assert 0.02 < low <= high < 0.045
    assert "overlap" in a2rl.servo_words(found) or "part" in a2rl.servo_words(found)
    held_out = [row for row in rows if row.unit == "mrad"]
    assert held_out[0].value < 0.5 * held_out[-1].value


def test_rows_of_the_training_lap_in_the_other_are_counted():
    train = laps()
    mixed = pd.concat([train.iloc[400:], laps(seed=1).iloc[:300]], ignore_index=True)
    assert a2rl.seen_before(train, mixed).tolist() == [True] * 200 + [False] * 300


def test_what_is_scored_as_published_is_the_mean_over_the_first_two_batches():
    off = np.concatenate([np.full(1000, 1.0), np.full(1000, -3.0), np.full(992, 50.0)])
    assert a2rl.as_published(off) == pytest.approx(2.0)


def test_an_error_that_comes_again_at_its_place_is_told_from_noise():
    place = 1.5 * np.arange(3400)  # 30 m/s, laps of 3 000 m: 2 000 rows
    angle = 2.0 * np.pi * place / 3000.0
    lap = pd.DataFrame({"vx": np.full(3400, 30.0), "curv": 0.01 * np.sin(angle) + 0.01 * np.sin(5.0 * angle + 1.0)})
    noise = 1e-3 * np.random.default_rng(0).standard_normal(3400)
    again = 2e-3 * np.sin(9.0 * angle)
    for off, low, high in ((noise, -0.2, 0.2), (again + noise, 0.6, 0.95)):
        found = a2rl.repeated(lap.iloc[:2100], off[:2100], lap.iloc[2100:], off[2100:])
        assert found["lap_length"] == pytest.approx(3000.0, abs=3.0)
        assert low < found["correlation"] < high
    assert found["rmse_less_earlier"] == pytest.approx(2**0.5, rel=0.15)
    assert "noise" in a2rl.repeated_words(found)[0]
    other = lap.iloc[2100:].assign(curv=np.random.default_rng(1).standard_normal(1300))
    assert a2rl.repeated_words(a2rl.repeated(lap.iloc[:2100], off[:2100], other, off[2100:])) == []


def test_yaw_errors_begin_where_the_angle_was_measured():
    rate = np.full(300, 2.0)
    drive = pd.DataFrame({"yawRate": rate, "yawAngle": 90.0 + 2.0 * 0.05 * np.arange(300)})
    exact = ferrari.yaw_errors(drive, rate)
    assert all(np.nanmax(np.abs(own)) < 1e-9 for own in exact.values() if np.isfinite(own).any())
    biased = ferrari.yaw_errors(drive, rate + 1.0)
    assert np.max(biased["yaw angle over 5 s"]) == pytest.approx(5.0)
    assert np.isnan(biased["yaw angle over 60 s"]).all()


def test_the_hand_wheel_counts_from_where_the_car_drives_straight():
    bends = np.where(np.arange(400) % 100 < 30, 40.0, 0.0)
    drive = pd.DataFrame({"handwheelAngle": bends - 0.7, "vxCG": 40.0, "axCG": np.where(bends > 0, -1.0, 1.0)})
    assert ferrari.straightened(drive)["handwheelAngle"].to_numpy() == pytest.approx(bends)
    slow = drive.assign(vxCG=10.0)
    assert ferrari.straightened(slow)["handwheelAngle"].to_numpy() == pytest.approx(bends - 0.7)


def test_a_car_pulls_to_the_side_its_brakes_do():
    t = 0.05 * np.arange(100)
    straight = gb.Recording(
        "brake", t, {"steer": 0 * t, "v_x": 40.0 - 5.0 * t, "a_x": np.full(100, -5.0), "yaw_rate": 0 * t}
    )
    model = driven_rear()
    assert np.max(np.abs(gb.simulate(model, straight)["yaw_rate"])) < 1e-6
    pulling = model.with_parameters(replace(model["brake_pull"], value=-0.05))
    assert np.all(gb.simulate(pulling, straight)["yaw_rate"][10:] > 1e-3)


def test_an_axle_beyond_its_peak_holds_its_force():
    turned = []
    for angle in (0.3, 0.6):
        t = 0.01 * np.arange(4)
        step = gb.Recording("step", t, {"steer": angle + 0 * t, "v_x": 20.0 + 0 * t, "a_x": 0 * t, "yaw_rate": 0 * t})
        turned.append(gb.simulate(driven_rear(), step)["yaw_rate"][2] / np.cos(angle))
    assert turned[1] == pytest.approx(turned[0], rel=0.01)


def driven(rows=900, seed=0):
    """A drive whose yaw rate is what a stand-in of a single track says, and 2 deg/s per m/s² of braking."""
    t = 0.05 * np.arange(rows)
    v, a_x = 35.0 + 5.0 * np.sin(0.1 * t + seed), 3.0 * np.cos(0.5 * t + seed)
    wheel = 20.0 * np.sin(0.4 * t + seed)
    swung = wheel * v / 40.0
    drive = pd.DataFrame({"handwheelAngle": wheel, "vxCG": v, "axCG": a_x, "yawRate": swung + 2.0 * np.minimum(a_x, 0)})
    return drive, swung


def test_the_process_learns_what_the_single_track_lacks_from_the_training_drives_alone():
    made = {name: driven(seed=k) for k, name in enumerate(("train_0", "train_1", "valid_0", "test_0"))}
    drives, swung = ({name: one[k] for name, one in made.items()} for k in (0, 1))
    other = drives["valid_0"]
    left = other["yawRate"].to_numpy() - swung["valid_0"]
    predicted, kept = ferrari.processed(drives, swung)
    off = predicted["valid_0"][0] - other["yawRate"].to_numpy()
    assert np.std(off[ferrari.FIRST :]) < 0.2 * np.std(left)
    assert kept == 2 * len(range(ferrari.FIRST, 900, ferrari.KEPT))
    again, _ = ferrari.processed(drives | {"valid_0": other.assign(yawRate=0.0)}, swung)
    np.testing.assert_array_equal(again["valid_0"][0], predicted["valid_0"][0])
    cut, _ = ferrari.processed(drives | {"valid_0": other.iloc[:500]}, swung | {"valid_0": swung["valid_0"][:500]})
    np.testing.assert_allclose(cut["valid_0"][0], predicted["valid_0"][0][:500], atol=1e-9)  # nothing ahead is read


def test_the_correction_fades_where_nothing_was_trained():
    drives, swung = ({f"train_{k}": driven(seed=k)[which] for k in (0, 1)} for which in (0, 1))
    far = drives["train_0"].assign(axCG=60.0)
    made, _ = ferrari.processed(drives | {"far": far}, swung | {"far": swung["train_0"]})
    assert np.max(np.abs(made["far"][0] - swung["train_0"])) < 1e-3


def road(grip, rows=800, seed=0):
    """A car that brakes every ten seconds harder than ice bears; locked axles bear 4 and 5 kN times grip."""
    random = np.random.default_rng(seed)
    pedal = np.where(np.arange(rows) % 200 > 140, 0.4, 0.0)
    demand = {"f": 6000.0 * pedal, "r": 5000.0 * pedal}
    most = {"f": 4000.0 * grip, "r": 5000.0 * grip}
    force = {axle: -np.minimum(own, most[axle]) for axle, own in demand.items()}
    locked = {axle: own > most[axle] for axle, own in demand.items()}
    motor = np.where(pedal == 0.0, 130.0 + 60.0 * np.sin(0.07 * np.arange(rows)), 0.0)
    acc, speed = np.zeros(rows), np.full(rows + 1, 20.0)
    for k in range(rows):
        acc[k] = (force["f"][k] + force["r"][k] + 9.0 * motor[k] - 0.5 * speed[k] ** 2) / 1250.0
        speed[k + 1] = max(speed[k] + 0.05 * acc[k], 5.0)
    speed = speed[:-1] + 0.1 * random.standard_normal(rows)
    columns = {
        "brake_pedal": pedal,
        "speed": speed,
        "acc": acc + 0.3 * random.standard_normal(rows),
        "motor_torque": motor,
    }
    for axle in "fr":
        columns[f"{axle}_rot_speed"] = np.where(locked[axle], 0.0, 2.0 * speed / brakes.RADIUS)
        for side in "lr":
            scatter = random.normal(1.0, 5e-3, rows)
            columns[f"final_brake_tw_{axle}{side}"] = 0.5 * force[axle] * brakes.RADIUS * scatter
    return pd.DataFrame(columns)


@pytest.mark.slow
def test_grip_is_known_where_axles_lock_and_nowhere_else(tmp_path):
    for name, grip in brakes.GRIP.items():
        road(grip).to_csv(tmp_path / f"{name}.csv", index=False)
    parts = [(0.25, 1), (0.5, 2), (1.0, 3)]
    pd.concat([road(grip, seed=seed).assign(grip=grip) for grip, seed in parts]).to_csv(
        tmp_path / "test.csv", index=False
    )
    told = greybox("bench", "abs", "--data", tmp_path, "--json").told
    agree(told, PAGE["bench abs"])
    known = next(row for row in told["rows"] if "where it is known" in row["task"])
    assert known["value"] < 0.1
    page = tmp_path / "abs.md"
    page.write_text("notes of my own\n", encoding="utf-8")
    assert "abs.md already exists" in refused("bench", "abs", "--data", tmp_path, "--report", page)
    page.unlink()
    for _ in range(2):  # a page of ours may be replaced
        greybox("bench", "abs", "--data", tmp_path, "--report", page)
    assert "greybox bench abs --data DIR" in page.read_text(encoding="utf-8")
    assert 0.05 < told["found"]["known_share"] < 0.8
    assert next(row for row in told["rows"] if row["unit"] == "%")["value"] > 90.0


@pytest.mark.slow
def test_the_axis_is_found_and_tools_that_are_not_installed_or_fail_are_told():
    lap = emps.made(1)
    again = peers.simulated(np.array(list(emps.TRUTH.values())), 0.0, lap["force"].to_numpy(), emps.STEP)
    assert np.sqrt(np.mean((again - lap["position"]) ** 2)) < 1e-3
    recording = gb.Recording(
        "axis", lap["time"].to_numpy(), {name: lap[name].to_numpy() for name in ("force", "position")}
    )
    fit = gb.fit(servo_axis(), [recording], options=gb.FitOptions(solver="gauss-newton"))
    assert float(fit.params["M"]) == pytest.approx(emps.TRUTH["M"], rel=5e-3)

    def broken(*_):
        raise ValueError("no")

    nothing = np.zeros(3)
    assert (
        "it is not installed"
        in emps.tried(peers.by_nnodely, "no_such_package", nothing, nothing, nothing, {"M": 1.0})[2]
    )
    assert emps.tried(broken, "numpy", nothing, nothing, nothing, {"M": 1.0})[2] == "it fails (ValueError: no)"


@pytest.mark.slow
def test_the_axis_bench_has_a_row_and_a_ratio_for_every_tool(monkeypatch):
    tools = {"scipy least_squares": (peers.by_scipy, 500, "scipy"), "none": (peers.by_nnodely, 500, "no_such_package")}
    monkeypatch.setattr(emps, "PEERS", tools)
    bench = emps.measure(None, True, quiet)
    assert {"greybox-id", "greybox-id, search only", "scipy least_squares"} <= {row.model for row in bench.rows}
    assert bench.answers[0].startswith("Compared with scipy least_squares, the fastest other tool here,")
    assert "none is left out: it is not installed" in " ".join(bench.protocol)
    assert list(bench.found["left_out"]) == ["none"]
    published = [row.value for row in bench.rows if row.published]
    assert len(published) == 10
    assert max(published) == 1690.0


@pytest.mark.slow
def test_another_tool_finds_the_axis_from_the_same_rows():
    lap = emps.made(1).iloc[:3000]
    start = np.array([80.0, 150.0, 15.0, 0.0])
    found = peers.by_scipy(*(lap[name].to_numpy() for name in ("time", "force", "position")), start)
    assert found == pytest.approx(list(emps.TRUTH.values()), rel=0.1)


def test_files_that_are_not_there_or_are_none_are_sentences(tmp_path):
    assert "not a folder" in refused("bench", "a2rl", "--data", tmp_path / "none")
    assert "greybox datasets fetch abs" in refused("bench", "abs", "--data", tmp_path)
    (tmp_path / "train_0.csv").write_text("time,vxCG\n1,2\n", encoding="utf-8")
    assert "has no column handwheelAngle" in refused("bench", "ferrari", "--data", tmp_path)
    (tmp_path / "dry.csv.gz").write_bytes(b"no gzip")
    assert "cannot be read" in refused("bench", "abs", "--data", tmp_path)
    with pytest.raises(BadInput, match="needs 200 rows"):
        frame(tmp_path, "train_0", ("time", "vxCG"), "revs_telemetry")


@pytest.mark.slow
def test_the_racers_steering_on_its_laps(real_data, tmp_path):
    page = tmp_path / "a2rl.md"
    told = greybox("bench", "a2rl", "--data", real_data / "a2rl", "--quick", "--report", page, "--json").told
    rows = [row for row in told["rows"] if row["model"] == "inverse single track"]
    assert all(row["parameters"] <= 15 and row["value"] < 1.75 for row in rows)
    assert rows[0]["value"] < 1e3 * a2rl.PUBLISHED[0][0]
    assert told["rows"][0]["task"].endswith("scored as published: RMSE")
    assert {row["task"] for row in told["rows"] if row["published"]} == {told["rows"][0]["task"]}
    assert 0.3 < told["found"]["again_at_same_place"]["correlation"] < 0.9
    assert told["found"]["rows_of_validation_in_training"] == 1001
    delays = [told["found"][f"servo, {lap}, steering_delay"] for lap in ("training lap", "validation lap")]
    assert delays[0][0] <= delays[1][1]
    assert delays[1][0] <= delays[0][1]
    assert "MS-NN-steer (published)" in page.read_text(encoding="utf-8")


@pytest.mark.slow
def test_grip_on_the_simulators_roads(real_data):
    told = greybox("bench", "abs", "--data", real_data / "abs", "--json").told
    assert next(row for row in told["rows"] if "where it is known" in row["task"])["value"] < 0.06
    assert next(row for row in told["rows"] if row["unit"] == "%")["value"] > 90.0
    assert json.dumps(told)
