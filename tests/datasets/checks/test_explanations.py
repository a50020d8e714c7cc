"""Faults that have a size: named first, with that size, and never where there is none."""

import numpy as np
import pytest
from checks import planted

from greybox_id.datasets.checks import Severity, check
from greybox_id.datasets.checks.finding import condition_without
from greybox_id.datasets.recording import Recording

LENGTH, UNDERSTEER = 2.7, 0.003


def drive(seed=0, seconds=60.0, rate=50.0, length=LENGTH):
    """A car of two linear tyres that answers its steering after a tenth of a second, with noise; no code of ours."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 1.0 / rate)

    def waves(*frequencies):
        return sum(np.sin(2 * np.pi * f * time + rng.uniform(0, 6)) for f in frequencies)

    v = 16.0 + 3.0 * waves(0.04) + 0.8 * waves(0.15)
    steer = 0.012 * waves(0.09, 0.21, 0.43)
    due = v * steer / (length + UNDERSTEER * v**2)
    turn = np.zeros(len(time))
    for k in range(1, len(time)):
        turn[k] = turn[k - 1] + (due[k - 1] - turn[k - 1]) / (0.1 * rate)
    signals = {"v_x": (v, 0.03), "yaw_rate": (turn, 0.004), "a_x": (np.gradient(v, time), 0.1), "a_y": (v * turn, 0.1)}
    noisy = {name: values + sd * rng.standard_normal(len(time)) for name, (values, sd) in signals.items()}
    return Recording("drive", time, {**noisy, "steer": steer})


def turned(r, degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return r.with_signals(a_x=c * r["a_x"] + s * r["a_y"], a_y=c * r["a_y"] - s * r["a_x"])


def stuck(r, name, begin, end):
    values, rows = r[name].copy(), (r.time > begin) & (r.time < end)
    values[rows] = values[np.argmax(rows)]
    return r.with_signals(**{name: values})


def joined(r, other):
    half = len(r) // 2
    return Recording("both", r.time, {n: np.concatenate([r[n][:half], other[n][half:]]) for n in r.signals})


def early(r, name, seconds):
    return r.with_signals(**{name: np.interp(r.time + seconds, r.time, r[name])})


def moved(r, name, scale=1.0, by=0.0):
    return r.with_signals(**{name: scale * r[name] + by})


FAULTS = {
    "yaw rate's offset": (lambda r: moved(r, "yaw_rate", by=0.15), "yaw_rate has an offset of +0.15 rad/s", 0.15),
    "a smaller one": (lambda r: moved(r, "yaw_rate", by=-0.08), "yaw_rate has an offset of −0.08", -0.08),
    "IMU at 15 degrees": (lambda r: turned(r, 15.0), "The IMU is turned by 1", 15.0),
    "IMU at -30 degrees": (lambda r: turned(r, -30.0), "to the left", -30.0),
    "IMU at 60 degrees": (lambda r: turned(r, 60.0), "The IMU is turned by", 60.0),
    "a_y's scale": (lambda r: moved(r, "a_y", scale=0.8), "a_y is 0.798 times", 0.8),
    "bank": (lambda r: moved(r, "a_y", by=1.2), "the road is banked", 1.2),
    "pitched IMU": (
        lambda r: moved(r, "a_x", by=-1.4),
        "a_x contains a constant of −1.4 m/s²: the IMU is pitched",
        -1.4,
    ),
    "steering's offset": (lambda r: moved(r, "steer", by=0.02), "steer has an offset of +20 mrad", 0.02),
    "early steering": (lambda r: early(r, "steer", 0.4), "steer is early", 0.5),
    "fast clock": (
        lambda r: r.with_signals(a_y=np.interp(0.98 * r.time, r.time, r["a_y"])),
        "The clock of a_y",
        0.0204,
    ),
    "frozen gyro": (lambda r: stuck(r, "yaw_rate", 10.0, 40.0), "yaw_rate is stuck at", 30.0),
    "another car": (lambda r: joined(r, drive(9, length=4.5)), "The second half was recorded with another car", 1.8),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_named_first_with_its_size(name):
    fault, words, size = FAULTS[name]
    first = check(fault(drive(3)))[0]
    alone = name == "a_y's scale"  # nothing else says whether a_y, yaw_rate or v_x is off
    assert first.severity is (Severity.WARNING if alone else Severity.DISTRUST)
    assert words in first.sentence
    assert first.value == pytest.approx(size, rel=0.25)


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_said_of_a_clean_drive(seed):
    assert not [finding for finding in check(drive(seed)) if finding.severity is Severity.DISTRUST]


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), [("car", 21), ("racer", 22), ("truck", 23), ("sports", 24)])
def test_of_31_faults_28_are_found_and_24_named_first(kind, seed):
    found = planted(kind, seed)
    assert found["faults"] == 31
    assert found["found"] >= 28
    assert found["right_first"] >= 24


def test_a_channel_that_got_stuck_once_is_not_held_between_updates():
    assert not any(one.kind == "held" for one in check(stuck(drive(1), "yaw_rate", 10.0, 40.0)))


@pytest.mark.parametrize("spans", [[(10.0, 40.0)], [(5.0, 15.0), (30.0, 40.0)]])
def test_rows_that_mean_nothing_are_left_out_by_the_condition_that_is_named(spans):
    spoilt = drive(1)
    for name, (start, stop) in zip(("yaw_rate", "a_y"), spans, strict=False):
        spoilt = stuck(spoilt, name, start, stop)
    kept = spoilt.where(condition_without(spoilt, check(spoilt)))
    assert not any(one.kind == "stuck" for one in check(kept))
    assert len(kept) == pytest.approx(len(spoilt) * (1 - sum(b - a for a, b in spans) / spoilt.duration), rel=0.02)
    assert condition_without(kept, check(kept)) == ""


def test_who_drives_ahead_is_never_said_to_reverse():
    r = moved(drive(1), "yaw_rate", scale=-1.0)
    r = Recording("drive", r.time, {n: r[n] for n in ("v_x", "steer", "yaw_rate")})
    assert "v_x has the wrong sign" not in check(r)[0].sentence


@pytest.mark.parametrize("scale", [0.92, 0.95, 0.96, 1.04, 1.07, 1.08])
@pytest.mark.parametrize("witness", ["both accelerometers", "positions"])
def test_a_speed_of_another_scale_is_told_by_what_else_tells_speeds(witness, scale):
    r = drive(2)
    if witness == "positions":
        yaw = np.cumsum(r["yaw_rate"]) * r.sample_time
        places = {n: np.cumsum(r["v_x"] * f(yaw)) * r.sample_time for n, f in (("x", np.cos), ("y", np.sin))}
        r = Recording("drive", r.time, {**{n: r[n] for n in ("v_x", "steer", "yaw_rate")}, **places})
    first = check(moved(r, "v_x", scale=scale))[0]
    assert first.where.channel == "v_x"
    assert first.value == pytest.approx(scale, abs=0.01)
    rolls = witness == "both accelerometers" and scale < 1.0  # as a body does that leans
    own = witness == "both accelerometers" and 1.0 < scale < 1.05  # as their own scales may be off
    assert first.severity is (Severity.WARNING if rolls or own else Severity.DISTRUST)
    assert ("the body rolls and pitches" in first.sentence) is rolls


@pytest.mark.parametrize("seed", [20, 21, 22, 23])
def test_steering_of_another_drive_of_the_same_frequencies_is_told(seed):
    r = drive(seed)
    first = check(r.with_signals(steer=drive(seed + 1)["steer"]))[0]
    assert "was recorded on another drive" in first.sentence


def test_a_contradiction_that_a_wrong_sign_explains_is_said_once():
    r = drive(1)
    turn = Recording("drive", r.time, {n: -r[n] if n == "yaw_rate" else r[n] for n in ("v_x", "steer", "yaw_rate")})
    (one,) = (finding for finding in check(turn) if finding.severity is Severity.DISTRUST)
    assert "steer has the wrong sign" in one.sentence
    assert "yaw_rate has the wrong sign" in one.sentence


STRAIGHTS = (8.0, 21.0, 33.0, 46.0)
"""s at which a command rests at zero for three seconds."""


def with_straights(seed):
    """A drive in which a driver's command is exactly zero four times."""
    r, settled = drive(seed), 0.6
    due = np.ones(len(r))
    for start in STRAIGHTS:
        due[(r.time > start) & (r.time < start + 3.0)] = 0.0
    after = np.convolve(due, np.ones(int(50 * settled)) / (50 * settled))[: len(r)]
    return r.with_signals(steer=r["steer"] * due, yaw_rate=r["yaw_rate"] * after, a_y=r["a_y"] * after)


@pytest.mark.parametrize("begin", [11.5, 25.0, 37.0, 50.0])
@pytest.mark.parametrize("seed", [1, 5, 6])
def test_steering_that_stands_still_is_stuck_though_it_rests_at_zero_elsewhere(seed, begin):
    r = with_straights(seed)
    assert not any(one.kind == "stuck" for one in check(r))
    (one,) = (one for one in check(stuck(r, "steer", begin, begin + 7.0)) if one.kind == "stuck")
    assert one.where.channel == "steer"
    assert one.value == pytest.approx(7.0, abs=0.1)


def test_a_step_of_steering_is_not_stuck():
    r = drive(1)
    steer = np.where((r.time > 20.0) & (r.time < 29.0), 0.01, 0.0)
    turn = np.zeros(len(r))
    for k in range(1, len(r)):
        turn[k] = turn[k - 1] + (r["v_x"][k] * steer[k - 1] / 3.4 - turn[k - 1]) / 5
    noise = np.random.default_rng(1).standard_normal((2, len(r)))
    step = r.with_signals(steer=steer, yaw_rate=turn + 0.004 * noise[0], a_y=r["v_x"] * turn + 0.1 * noise[1])
    assert not any(one.kind == "stuck" for one in check(step))


def test_a_command_at_its_stop_is_not_stuck_where_the_vehicle_spins():
    r = with_straights(5)
    steer = np.clip(r["steer"], -0.012, 0.012)
    steer[(r.time > 25.0) & (r.time < 32.0)] = 0.012
    assert any(one.kind == "stuck" for one in check(stuck(r, "steer", 25.0, 32.0)))
    assert not any(one.kind == "stuck" for one in check(r.with_signals(steer=steer)))
