"""Proposals for recordings in disguise: what is decided is right, what is not is asked."""

import numpy as np
import pandas as pd
import pytest

from greybox_id.base.errors import BadInput
from greybox_id.datasets.column_map import parse_column_map
from greybox_id.datasets.joining import join_files
from greybox_id.datasets.mapping import as_toml, propose
from greybox_id.datasets.read import read
from greybox_id.datasets.repair import map_text
from greybox_id.datasets.shipped import shipped

TRUE = read(shipped("racer_train"), "roboracer")
HABITS = {
    "v_x": ("vx", "speed", "velocity_x", "Vx_mps", "vehicle speed [m/s]", "v_long", "longitudinal_velocity", "Tacho"),
    "yaw_rate": ("yawrate", "gyro_z", "psi_dot", "YawRate", "yaw_rate_rad_s", "wz", "r", "Giergeschwindigkeit"),
    "a_x": ("ax", "acc_x", "long_acc", "AccX", "a_x [m/s^2]", "beschl_laengs"),
    "a_y": ("ay", "acc_y", "lat_acc", "AccY", "lateral_acceleration"),
    "steer": ("delta", "steering_angle", "steer", "RoadWheelAngle", "delta_f [rad]", "servo_angle"),
    "x": ("x", "pos_x", "px", "pose_x"),
    "y": ("y", "pos_y", "py", "pose_y"),
    "yaw": ("yaw", "psi", "heading", "yaw_angle"),
    "time": ("t", "time", "Time [s]", "timestamp", "elapsed_time"),
}
PLAIN = {"v_x": "speed", "yaw_rate": "gyro_z", "a_x": "acc_x", "a_y": "acc_y", "steer": "steering",
         "x": "px", "y": "py", "yaw": "heading", "time": "t"}  # fmt: skip
OTHER = {"v_x": 3.6, "yaw_rate": 180 / np.pi, "a_x": 1 / 9.80665, "a_y": 1 / 9.80665, "steer": 180 / np.pi,
         "yaw": 180 / np.pi}  # fmt: skip


@pytest.fixture
def disguised(tmp_path):
    def disguised(names=PLAIN, factors=(), flipped=(), without=(), suffix=""):
        columns = {names["time"]: TRUE.time}
        for signal in ("a_y", "steer", "v_x", "x", "yaw", "yaw_rate", "y", "a_x"):
            if signal not in without:
                factor = (OTHER[signal] if signal in factors else 1.0) * (-1 if signal in flipped else 1)
                columns[names[signal]] = TRUE[signal] * factor
        columns["battery_voltage"] = 16 - 0.001 * TRUE.time
        file = tmp_path / "lap.csv"
        pd.DataFrame(columns).to_csv(file, index=False)
        return file

    return disguised


def verdict(file, proposal):
    """Signals that are decided and right, decided and wrong, and asked for."""
    found = read(file, proposal.mapping())
    right = {n for n in found.signals if np.allclose(found[n], TRUE[n], rtol=1e-6, atol=1e-9)}
    return right, set(found.signals) - right, {entry.signal for entry in proposal.open}


@pytest.mark.parametrize("seed", range(3))
def test_habits_of_naming_are_known(disguised, seed):
    rng = np.random.default_rng(seed)
    names = {signal: str(rng.choice(own)) for signal, own in HABITS.items()}
    file = disguised(names)
    right, wrong, asked = verdict(file, propose(file))
    assert (right, wrong, asked) == (set(HABITS) - {"time"}, set(), set())


@pytest.mark.parametrize(
    "factors",
    [("v_x",), ("steer",), ("a_x", "a_y"), ("v_x", "yaw_rate", "steer"), tuple(OTHER)],
)
def test_units_that_nobody_states_are_told_by_the_other_channels(disguised, factors):
    file = disguised(factors=factors)
    right, wrong, asked = verdict(file, propose(file))
    assert (right, wrong, asked) == (set(HABITS) - {"time"}, set(), set())


@pytest.mark.parametrize("flipped", ["yaw_rate", "a_y", "steer", "a_x", "yaw"])
def test_one_channel_that_counts_the_other_way_round_is_turned(disguised, flipped):
    file = disguised(flipped=(flipped,))
    right, wrong, asked = verdict(file, propose(file))
    assert (right, wrong, asked) == (set(HABITS) - {"time"}, set(), set())


def test_two_against_one_is_a_question_with_its_answer_beside_it(disguised):
    file = disguised(flipped=("steer",), without=("x", "y", "yaw"))
    proposal = propose(file)
    _, wrong, asked = verdict(file, proposal)
    assert (wrong, asked) == (set(), {"steer"})
    (entry,) = proposal.open
    assert entry.sign == -1
    assert "opposite signs" in " ".join(entry.reasons)
    assert '#? steer = { column = "steering", unit = "rad", sign = -1 }' in as_toml(proposal, "car")


def test_a_unit_that_nothing_tells_is_a_question(disguised):
    file = disguised(without=("x", "y", "a_x", "a_y", "yaw", "steer"))
    proposal = propose(file)
    assert {entry.signal for entry in proposal.entries if not entry.decided} == {"v_x", "yaw_rate"}
    assert not any(entry.decided for entry in proposal.entries)
    text = as_toml(proposal, "car")
    assert '#? v_x = { column = "speed", unit = "m/s" }\n#? v_x = { column = "speed", unit = "km/h" }' in text


def test_a_name_that_says_nothing_is_asked_about_by_what_it_agrees_with(disguised):
    file = disguised({**PLAIN, "steer": "ch7"}, flipped=("steer",))
    (entry,) = propose(file).open
    assert (entry.column, entry.signal, entry.sign, entry.units) == ("ch7", "steer", -1, ("rad",))


def test_signals_that_no_column_looks_like_have_a_line_to_be_completed(disguised):
    file = disguised({**PLAIN, **{name: f"ch{k}" for k, name in enumerate(PLAIN) if name != "time"}})
    proposal = propose(file)
    assert proposal.entries == ()
    text = as_toml(proposal, "car")
    for line in ("v_x = { column = %s, unit = 'm/s' }", "steer = { column = %s, unit = 'rad' }"):
        assert f"#? {line}\n".replace("'", '"') % '"..."' in text
    own = {"v_x": ("ch0", "m/s"), "yaw_rate": ("ch1", "rad/s"), "steer": ("ch4", "rad")}
    for signal, (column, unit) in own.items():
        asked = f'#? {signal} = {{ column = "...", unit = "{unit}" }}'
        text = text.replace(asked, asked.removeprefix("#? ").replace("...", column))
    found = read(file, parse_column_map(text, "car.toml"))
    assert all(np.allclose(found[signal], TRUE[signal]) for signal in own)


def test_a_motors_speed_is_counts_and_asked_for():
    proposal = propose(shipped("racer_train"))
    (entry,) = proposal.open
    assert (entry.signal, entry.column) == ("v_x", "Speed")
    assert entry.divide_by == pytest.approx(4244, rel=0.2)
    assert {e.signal: e.unit for e in proposal.entries if e.decided and e.signal in ("a_x", "yaw_rate")} == {
        "a_x": "g",
        "yaw_rate": "deg/s",
    }


def test_a_course_tells_the_unit_of_the_steering_as_a_gyro_does(tmp_path):
    """Without a gyro: a wheelbase of 2.8 m is that, and not one over it."""
    time = np.arange(3000) / 50
    steer = 0.05 * np.sin(0.7 * time) + 0.03 * np.sin(0.31 * time)
    yaw = np.cumsum(15.0 * steer / 2.8) / 50
    table = {
        "time": time,
        "speed": np.full(3000, 15.0) + 0.5 * np.sin(0.2 * time),
        "wheel_angle": np.degrees(steer),
        "east": np.cumsum(15.0 * np.cos(yaw)) / 50,
        "north": np.cumsum(15.0 * np.sin(yaw)) / 50,
    }
    for factor, unit in ((1.0, "deg"), (np.pi / 180, "rad")):
        pd.DataFrame(table | {"wheel_angle": factor * table["wheel_angle"]}).to_csv(tmp_path / "lap.csv", index=False)
        (entry,) = [entry for entry in propose(tmp_path / "lap.csv", wheelbase=2.8).entries if entry.signal == "steer"]
        assert entry.unit == unit
        assert any("gives a wheelbase of 2.8 m" in reason for reason in entry.reasons), entry.reasons


def town(tmp_path, unit="deg/s", factor=180 / np.pi):
    """A drive in town, as a logger writes it: the hand wheel in degrees, ratio 16, and units in the names."""
    time = np.arange(1500) / 50
    turn = 0.2 * np.sin(0.9 * time) + 0.1 * np.sin(2.3 * time)
    table = {
        "Time [s]": time,
        "Ground Speed [km/h]": 3.6 * (12 + np.sin(0.3 * time)),
        "Steered Angle [deg]": np.degrees(16 * 2.8 * turn / (12 + np.sin(0.3 * time))),
        f"Gyro Yaw Velocity [{unit}]": factor * turn,
        "G Force Lat [G]": (12 + np.sin(0.3 * time)) * turn / 9.80665,
    }
    pd.DataFrame(table).to_csv(tmp_path / "town.csv", index=False)
    return propose(tmp_path / "town.csv")


def test_no_wheelbase_is_45_m_long(tmp_path):
    """Below the pace that tells a car from a model of one, the length alone still tells a hand wheel."""
    proposal = town(tmp_path)
    (steer,) = [entry for entry in proposal.open if entry.signal == "steer"]
    assert "ratio times the wheelbase is about 44.8 m" in steer.reasons[-1]
    assert not any("gives a wheelbase" in reason for entry in proposal.entries for reason in entry.reasons)
    assert steer.divide_by == pytest.approx(16, rel=0.02)  # 2.8 m is near the usual length of a car


def test_lateral_acceleration_tells_a_hand_wheel_where_no_yaw_rate_is_recorded(tmp_path):
    town(tmp_path)
    frame = pd.read_csv(tmp_path / "town.csv").drop(columns="Gyro Yaw Velocity [deg/s]")
    frame.to_csv(tmp_path / "town.csv", index=False)
    (steer,) = [entry for entry in propose(tmp_path / "town.csv").open if entry.signal == "steer"]
    assert "ratio times the wheelbase is about 44.8 m" in steer.reasons[-1]


def test_a_wrong_unit_that_the_file_states_is_a_finding_though_no_map_has_a_file_yet(tmp_path):
    found = town(tmp_path, factor=1.0).findings
    assert any("yaw_rate is in rad/s but called deg/s" in finding.sentence for finding in found)


def test_a_hand_wheel_is_asked_for_its_ratio(disguised):
    names = {**PLAIN, "steer": "SWA [deg]"}
    file = disguised(names, factors=("steer",))
    frame = pd.read_csv(file)
    frame["SWA [deg]"] *= 16.0
    frame.to_csv(file, index=False)
    (entry,) = propose(file, wheelbase=0.33).open
    assert entry.signal == "steer"
    assert entry.divide_by == pytest.approx(16, rel=0.3)
    assert "ratio" in " ".join(entry.reasons)


def test_degrees_of_either_wheel_are_asked_about_where_nothing_turns(tmp_path):
    time = np.arange(300) / 50
    table = {"TIME": time, "STEERINGANGLE [deg]": 20 * np.sin(time), "SPEED [km/h]": 60 + np.sin(time)}
    pd.DataFrame(table).to_csv(tmp_path / "lap.csv", index=False)
    (entry,) = propose(tmp_path / "lap.csv").open
    assert entry.signal == "steer"
    assert "the angle of the road wheels or of the hand wheel" in entry.reasons[-1]


@pytest.mark.parametrize("layout", [(";", ","), ("\t", ".")])
def test_separators_and_decimals_are_seen(disguised, layout):
    separator, decimal = layout
    file = disguised()
    pd.read_csv(file).to_csv(file, index=False, sep=separator, decimal=decimal)
    proposal = propose(file)
    assert not verdict(file, proposal)[1]


def test_the_map_reads_as_it_was_proposed(disguised):
    file = disguised(flipped=("a_y",), factors=("v_x",))
    proposal = propose(file)
    mapping = parse_column_map(as_toml(proposal, "car"), "car.toml")
    again, before = read(file, mapping), read(file, proposal.mapping())
    assert set(again.signals) == set(before.signals)
    for name in again.signals:
        np.testing.assert_array_equal(again[name], before[name])
    assert "battery_voltage" in proposal.others


REAL = {
    "roboracer/train.csv": ("roboracer", {"v_x"}),
    "roboracer/valid.csv": ("roboracer", {"v_x"}),
    "roboracer/single_mass.csv": ("roboracer", {"v_x"}),
    "roboracer/tire_set_1.csv": ("roboracer", {"v_x"}),
    "truck/train.parquet": ("truck", {"steer"}),
    "truck/val.parquet": ("truck", {"steer"}),
    "revs_250lm/run1_first400s.csv.gz": ("revs_250lm", set()),
}


@pytest.mark.slow
@pytest.mark.parametrize("file", list(REAL))
def test_on_real_recordings_nothing_decided_is_wrong(real_data, file):
    shipped_map, hard = REAL[file]
    true = read(real_data / file, shipped_map)
    proposal = propose(real_data / file)
    found = read(real_data / file, proposal.mapping())
    wrong = [n for n in found.signals if n in true and not np.allclose(found[n], true[n], equal_nan=True, rtol=1e-9)]
    assert not wrong
    assert {n for n in true.signals if n not in true.extra_units} - set(found.signals) <= hard
    assert {entry.signal for entry in proposal.open} >= hard


HEADING = {"time": "t", "v_x": "vx", "yaw_rate": "gyro_z", "steer": "delta", "yaw": "phi", "x": "px", "y": "py",
           "a_x": "acc_x", "a_y": "acc_y"}  # fmt: skip


@pytest.mark.parametrize("factors", [(), ("yaw",)])
def test_a_heading_called_phi_is_asked_about_as_yaw(disguised, factors):
    (entry,) = propose(disguised(HEADING, factors=factors)).open
    assert (entry.column, entry.signal, entry.unit) == ("phi", "yaw", "deg" if factors else "rad")
    assert "may be roll or heading" in " ".join(entry.reasons)


def test_a_roll_angle_called_phi_is_a_question_that_says_what_else_it_may_be(disguised):
    file = disguised(HEADING, without=("yaw",))
    frame = pd.read_csv(file)
    frame["phi"] = 0.03 * np.sin(frame["t"])
    frame.to_csv(file, index=False)
    (entry,) = propose(file).open
    assert (entry.column, entry.signal) == ("phi", "roll")
    assert "if it is that, write yaw instead of roll" in " ".join(entry.reasons)


def test_omega_is_asked_about_as_yaw_rate(disguised):
    proposal = propose(disguised({**PLAIN, "yaw_rate": "omega"}))
    (entry,) = proposal.open
    assert (entry.column, entry.signal, entry.unit) == ("omega", "yaw_rate", "rad/s")
    assert "the angular velocity of a wheel or a motor" in " ".join(entry.reasons)
    assert '#? yaw_rate = { column = "omega", unit = "rad/s" }' in as_toml(proposal, "car")


def test_counts_of_a_servo_about_their_centre_are_asked_for_as_steering(tmp_path):
    columns = {"t": TRUE.time, "wheel_kmh": 3.6 * TRUE["v_x"], "gz": TRUE["yaw_rate"], "ax": TRUE["a_x"]}
    file = tmp_path / "lap.csv"
    pd.DataFrame({**columns, "servo_us": 1500 + 900 * TRUE["steer"]}).to_csv(file, index=False)
    proposal = propose(file)
    asked = {entry.signal: entry for entry in proposal.open}
    assert asked["v_x"].column == "wheel_kmh"
    assert asked["steer"].column == "servo_us"
    text = as_toml(proposal, "car")
    assert '#? steer = { column = "servo_us", unit = "rad", lookup = [[' in text
    assert "#? throttle" in text  # no column looks like a drive


def drive(tmp_path, wheelbase=2.7, ratio=16.0, seconds=60.0, seed=0, **columns):
    """A car's drive as a file of the named columns, each of them a factor on a signal; and the signals in SI units."""
    time = np.arange(round(50 * seconds)) / 50
    noise = np.random.default_rng(seed).standard_normal((2, len(time)))
    v = 18 + 6 * np.sin(0.2 * time) + 0.02 * noise[0]
    steer = 0.03 * np.sin(0.7 * time) + 0.02 * np.sin(1.9 * time + 1)
    turn = v * steer / wheelbase + 0.002 * noise[1]
    yaw = np.cumsum(turn) / 50
    x, y = (np.cumsum(v * part) / 50 for part in (np.cos(yaw), np.sin(yaw)))
    si = {
        "v_x": v,
        "steer": steer,
        "hand_wheel": ratio * steer,
        "yaw_rate": turn,
        "yaw": yaw,
        "a_y": v * turn,
        "a_x": np.gradient(v, time),
        "x": x,
        "y": y,
        "compass": np.mod(90 - np.degrees(yaw), 360),
        "throttle": 0.3 + 0.2 * np.sin(time),
    }
    table = {name: factor * si[signal] for name, (signal, factor) in columns.items()}
    pd.DataFrame({"t": time} | table).to_csv(tmp_path / "lap.csv", index=False)
    proposal = propose(tmp_path / "lap.csv")
    return proposal, {entry.signal: entry for entry in proposal.entries}, si


def test_a_hand_wheel_settles_no_unit_of_another_signal(tmp_path):
    """In km/h its angle would be that of a long car's road wheels: no reason to take metres a second for that."""
    for name, factor in (("steering_angle", 180 / np.pi), ("steering_angle", 1.0), ("SWA", 180 / np.pi), ("SWA", 1.0)):
        columns = {"v": ("v_x", 1.0), name: ("hand_wheel", factor), "yaw_rate": ("yaw_rate", 1.0)}
        _, entries, _ = drive(tmp_path, **columns)
        assert not entries["steer"].decided
        for signal, unit in (("v_x", "m/s"), ("yaw_rate", "rad/s")):
            assert not entries[signal].decided or entries[signal].unit == unit, (name, factor, signal)


@pytest.mark.parametrize("factor", [1 / 0.3, 100 / 0.35])
def test_steering_that_is_no_wheels_angle_is_asked_about(tmp_path, factor):
    """The share of full lock, or percent of it."""
    columns = {"v": ("v_x", 1.0), "steer": ("steer", factor), "yaw_rate": ("yaw_rate", 1.0), "ay": ("a_y", 1.0)}
    proposal, entries, _ = drive(tmp_path, **columns)
    assert not entries["steer"].decided
    assert {"v_x", "yaw_rate", "a_y"} <= {entry.signal for entry in proposal.entries if entry.decided}


def test_a_speed_in_miles_that_does_not_say_so_is_a_question(tmp_path):
    columns = {"speed": ("v_x", 1 / 0.44704), "yaw_rate": ("yaw_rate", 1.0), "ay": ("a_y", 1.0), "ax": ("a_x", 1.0)}
    _, entries, _ = drive(tmp_path, **columns)
    assert (entries["v_x"].unit, entries["v_x"].decided) == ("mph", False)


def test_a_compass_counts_clockwise_where_nothing_says_otherwise(tmp_path):
    """A heading alone is asked about; beside steering that contradicts it, it is the one in doubt."""
    _, entries, _ = drive(tmp_path, heading=("compass", 1.0))
    assert (entries["yaw"].sign, entries["yaw"].decided) == (-1, False)
    columns = {"speed": ("v_x", 1.0), "heading": ("compass", 1.0), "steer": ("steer", 1.0)}
    _, entries, _ = drive(tmp_path, **columns)
    assert (entries["yaw"].sign, entries["yaw"].decided, entries["steer"].sign) == (-1, False, 1)


def test_east_and_north_tell_which_way_is_left(tmp_path):
    columns = {
        "v_x": ("v_x", 1.0), "north": ("y", 1.0), "east": ("x", 1.0), "yaw": ("yaw", -1.0), "gz": ("yaw_rate", -1.0),
        "steer": ("steer", -1.0),
    }  # fmt: skip
    proposal, entries, si = drive(tmp_path, **columns)
    assert not proposal.open
    assert [entries[name].sign for name in ("yaw", "yaw_rate", "steer", "x", "y")] == [-1, -1, -1, 1, 1]
    found = read(tmp_path / "lap.csv", proposal.mapping())
    assert all(np.allclose(found[name], si[name]) for name in ("yaw_rate", "steer", "x", "y"))


@pytest.mark.parametrize(("factor", "unit", "sure"), [(1, "1", True), (100, "%", True), (1023, "1", False)])
def test_a_pedals_unit_is_seen_from_its_values(tmp_path, factor, unit, sure):
    _, entries, _ = drive(tmp_path, throttle=("throttle", factor))
    assert (entries["throttle"].unit, entries["throttle"].decided) == (unit, sure)


def test_the_speed_of_a_rim_is_asked_for_the_wheels_radius(tmp_path):
    _, entries, _ = drive(tmp_path, wheel_fl_kmh=("v_x", 3.6), speed_kmh=("v_x", 3.6))
    assert "divide_by is 3.6 times the wheel's radius" in entries["wheel_speed_fl"].reasons[-1]


def test_thousandths_of_gravity_and_of_degrees_are_units(tmp_path):
    columns = {"v_mps": ("v_x", 1.0), "ax_mg": ("a_x", 1e3 / 9.80665), "gyro_z_mdps": ("yaw_rate", 180e3 / np.pi)}
    proposal, _, si = drive(tmp_path, **columns)
    found = read(tmp_path / "lap.csv", proposal.mapping())
    assert all(np.allclose(found[name], si[name]) for name in ("v_x", "a_x", "yaw_rate"))


def test_an_imu_that_is_turned_is_told_though_no_unit_of_the_speed_is(tmp_path):
    columns = {"v": ("v_x", 1.0), "yaw_rate": ("yaw_rate", 1.0), "ax": ("a_y", 1.0), "ay": ("a_x", -1.0)}
    proposal, _, _ = drive(tmp_path, **columns)
    assert any("IMU is turned by 90°" in finding.sentence for finding in proposal.findings)


@pytest.mark.parametrize("known", [(), ("x", "y"), ("latitude", "longitude")])
def test_which_way_is_left_rests_on_positions(tmp_path, known):
    columns = {name: (signal, 1.0) for name, signal in zip(known, ("x", "y"), strict=False)}
    turning = {"v_x": ("v_x", 1.0), "yaw_rate": ("yaw_rate", 1.0), "a_y": ("a_y", 1.0), "a_x": ("a_x", 1.0)}
    if known[:1] == ("latitude",):
        columns = {"latitude": ("y", 1 / 111_320), "longitude": ("x", 1 / 111_320)}
    proposal, _, _ = drive(tmp_path, **turning, **columns)
    assert proposal.left_assumed == (() if known else ("yaw_rate", "a_y"))


def test_files_of_two_clocks_in_units_of_their_own_are_mapped_and_joined(tmp_path):
    """What both carry, in other units, compares the clocks: 0.8 s apart, the one 0.3 % fast and in microseconds."""
    _, _, si = drive(tmp_path, t0=("v_x", 1.0))
    time, rng = np.arange(len(si["v_x"])) / 50, np.random.default_rng(3)
    turn = np.interp(time, time, si["yaw_rate"])
    table = {"uptime": time, "speed_kmh": 3.6 * si["v_x"], "steer_rad": si["steer"], "yaw_rate": turn}
    pd.DataFrame(table).to_csv(tmp_path / "can.csv", index=False)
    gyro = np.degrees(turn + 0.002 * rng.standard_normal(len(time)))
    table = {"timestamp_us": np.round(1e6 * (1.003 * time + 0.8)), "gyro_z_dps": gyro, "acc_y_g": si["a_y"] / 9.80665}
    pd.DataFrame(table).to_csv(tmp_path / "imu.csv", index=False)
    files = [tmp_path / "can.csv", tmp_path / "imu.csv"]
    proposal = propose(files)
    mapping = parse_column_map(as_toml(proposal, "two"), "two.toml")
    assert not proposal.open
    assert mapping.time.other_units == ("us",)
    assert not any("clock" in finding.sentence or "late" in finding.sentence for finding in proposal.findings)
    joined, (offset,) = join_files(files, mapping)
    assert offset.alignment.rate == pytest.approx(0.003, abs=3e-4)
    assert offset.seconds == pytest.approx(0.8, abs=0.01)
    rows = np.interp(joined.time, time, si["a_y"])
    assert np.std(joined["a_y"] - rows) < 0.05 * np.std(rows)
    again = parse_column_map(map_text(mapping), "two.toml")
    assert (again.time, again.signals) == (mapping.time, mapping.signals)


def test_units_are_as_many_as_names():
    text = '[time]\ncolumn=["t","u"]\nunit=["s","ms","us"]\n[signals.v_x]\ncolumn="v"\nunit="m/s"'
    with pytest.raises(BadInput, match="one string for each name in column"):
        parse_column_map(text, "own.toml")


def test_a_tyre_on_a_rig_is_no_vehicle(tmp_path):
    time = np.arange(300) / 100
    table = {"ET": time, "SA": 12 * np.sin(time), "FZ": -700.0, "FY": 900 * np.sin(time), "FX": 1.0, "V": 40.0}
    pd.DataFrame(table).to_csv(tmp_path / "rig.csv", index=False)
    proposal = propose(tmp_path / "rig.csv")
    assert proposal.rig
    assert not proposal.entries


def test_a_servos_setting_is_asked_about(tmp_path):
    """It need not be an angle, nor rest at zero."""
    columns = {"v_x": ("v_x", 1.0), "servo_position": ("steer", 1.2), "yaw_rate": ("yaw_rate", 1.0), "ay": ("a_y", 1.0)}
    _, entries, _ = drive(tmp_path, **columns)
    assert not entries["steer"].decided


@pytest.mark.parametrize(
    ("name", "signs"),
    [
        ("LWI_VZ_Lenkradwinkel", lambda negative: negative.astype(int)),
        ("steer sign", lambda negative: np.where(negative, -1, 1)),
        ("steer_dir", lambda negative: np.where(negative, "R", "L")),
    ],
)
def test_a_sign_in_a_column_of_its_own_is_found_and_read(tmp_path, name, signs):
    time, steer = TRUE.time, np.degrees(TRUE["steer"])
    magnitude = {name.replace("VZ_", "").removesuffix(" sign").removesuffix("_dir") + "_deg": np.abs(steer)}
    table = {"t": time, "vx": TRUE["v_x"], "yaw_rate": TRUE["yaw_rate"], **magnitude, name: signs(steer < 0)}
    pd.DataFrame(table).to_csv(tmp_path / "lap.csv", index=False)
    mapping = propose(tmp_path / "lap.csv").mapping("own", everything=True)
    found = read(tmp_path / "lap.csv", parse_column_map(map_text(mapping), "own.toml"))["steer"]
    assert found == pytest.approx(TRUE["steer"] * mapping.signals["steer"].scale, abs=1e-12)


def test_a_magnitude_without_its_sign_is_asked_about(tmp_path):
    turn = TRUE["yaw_rate"]
    table = {"t": TRUE.time, "vx": TRUE["v_x"], "yaw_rate": np.abs(turn), "ay": TRUE["v_x"] * turn}
    pd.DataFrame(table).to_csv(tmp_path / "lap.csv", index=False)
    (entry,) = (entry for entry in propose(tmp_path / "lap.csv").open if entry.signal == "yaw_rate")
    assert "sign_column" in entry.reasons[1]


@pytest.mark.parametrize("signed", [False, True])
def test_degrees_and_minutes_behind_one_another_are_told(tmp_path, signed):
    north = -12.5 - TRUE["y"] / 111_320
    minutes = 100 * np.trunc(np.abs(north)) + 60 * (np.abs(north) % 1)
    table = {"t": TRUE.time, "vx": TRUE["v_x"], "lat": -minutes if signed else minutes}
    table |= {} if signed else {"N/S": "S"}
    pd.DataFrame(table).to_csv(tmp_path / "lap.csv", index=False)
    proposal = propose(tmp_path / "lap.csv")
    assert [entry.decided for entry in proposal.entries if entry.signal == "latitude"] == [not signed]
    found = read(tmp_path / "lap.csv", proposal.mapping("own", everything=True))
    assert found["latitude"] == pytest.approx(north, abs=1e-9)


def test_counts_of_an_imu_are_asked_about_and_mislead_nobody(tmp_path):
    """A gyro's 131 counts make 1 deg/s, an accelerometer's 16384 make g."""
    counts = {"gz": 131 * np.degrees(TRUE["yaw_rate"]), "ay": 16384 * TRUE["a_y"] / 9.80665}
    table = {"t": TRUE.time, "vx": TRUE["v_x"], "ax": TRUE["a_x"], **{n: v.round() for n, v in counts.items()}}
    pd.DataFrame(table).to_csv(tmp_path / "lap.csv", index=False)
    entries = {entry.signal: entry for entry in propose(tmp_path / "lap.csv").entries}
    assert [entries[name].decided for name in ("yaw_rate", "a_y")] == [False, False]
    assert "divide_by" in entries["yaw_rate"].reasons[-1]
    assert entries["v_x"].unit in ("", "m/s")


def test_degrees_south_and_west_are_negative(tmp_path):
    north, east = TRUE["y"] / 111_320, TRUE["x"] / 111_320
    table = {"t": TRUE.time, "vx": TRUE["v_x"], "lat": 1.0 - north, "N/S": "S", "lon": 1.0 - east, "E/W": "W"}
    pd.DataFrame(table).to_csv(tmp_path / "lap.csv", index=False)
    found = read(tmp_path / "lap.csv", propose(tmp_path / "lap.csv").mapping("own", everything=True))
    assert found["latitude"] == pytest.approx(north - 1.0)
    assert found["longitude"] == pytest.approx(east - 1.0)
