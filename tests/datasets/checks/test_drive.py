"""Whether a recording holds a drive: its rows follow each other, something moves, and its own steering does it."""

import numpy as np
import pytest
from simulated import clean, wander

from greybox_id.datasets.checks import Severity, check, distrusted
from greybox_id.datasets.checks.finding import condition_without
from greybox_id.datasets.recording import Recording
from greybox_id.fitting.scores.verdict import distrust

DRIVES = {
    "car": {},
    "model car at 100 Hz": {"dt": 0.01, "speed": 1.8, "wheelbase": 0.32, "seconds": 30.0},
    "coach at 10 Hz": {"dt": 0.1, "wheelbase": 6.0, "seconds": 90.0},
}


def recorded(seed, **settings):
    """What most loggers hold: no positions, no v_y."""
    r = clean(seed, **settings)
    return Recording("drive", r.time, {name: r[name] for name in ("v_x", "steer", "yaw_rate", "a_x", "a_y")})


def only(r, kind):
    return [finding for finding in check(r) if finding.kind == kind]


def off(r, names, a, b):
    signals = {name: r[name].copy() for name in names}
    for values in signals.values():
        values[a:b] = 0.0
    return r.with_signals(**signals)


@pytest.mark.parametrize("kind", DRIVES)
@pytest.mark.parametrize(
    ("a", "b"), [(0, 40), (200, 230), (-30, None)], ids=["not yet on", "between", "before its end"]
)
def test_rows_of_a_logger_that_was_off_are_named(kind, a, b):
    r = recorded(3, **DRIVES[kind])
    (one,) = only(off(r, r.signals, a, b), "asleep")
    assert one.severity is Severity.DISTRUST
    assert one.where.rows == tuple(range(len(r))[a:b])
    assert all(name in one.sentence for name in r.signals)
    assert distrust(["yaw_rate"], off(r, r.signals, a, b))
    kept = r.where(condition_without(r, [one]))
    assert list(kept.time) == [t for row, t in enumerate(r.time) if row not in one.where.rows]


def test_one_sensor_that_comes_late_is_named_alone():
    r = recorded(4)
    (one,) = only(off(r, ["v_x"], 0, 60), "asleep")
    assert one.where.channel == "v_x"
    assert one.where.rows == tuple(range(60))


def test_standing_at_first_is_no_fault():
    r = recorded(5)
    starts = np.clip(2.0 * (r.time - 3.0), 0.0, 1.0)  # stands for 3 s without any noise, and sets off
    gone = r.with_signals(**{name: starts * (r[name] if name != "v_x" else r.time - 3.0) for name in r.signals})
    assert not only(gone, "asleep")


@pytest.mark.parametrize("kind", DRIVES)
def test_rows_out_of_order_are_named_though_time_runs_on(kind):
    r = recorded(6, **DRIVES[kind])
    order = np.random.default_rng(6).permutation(len(r))
    (one,) = only(r.with_signals(**{name: r[name][order] for name in r.signals}), "unordered")
    assert one.severity is Severity.DISTRUST
    assert "out of order" in one.sentence


@pytest.mark.parametrize("other", ["its rows shuffled", "of another drive"])
def test_steering_that_turns_nothing_is_named(other):
    r = recorded(7)
    shuffled = np.random.default_rng(7).permutation(r["steer"])
    steer = shuffled if other == "its rows shuffled" else recorded(8)["steer"]
    (one,) = only(r.with_signals(steer=steer), "unrelated")
    assert one.severity is Severity.DISTRUST
    assert "steer was recorded on another drive" in one.sentence
    assert one.where.channel == "steer, yaw_rate"


def test_steering_that_turns_nothing_is_named_in_runs_of_ten_seconds():
    r = recorded(7)
    r = Recording("runs", r.time, dict(r.signals), tuple((a, min(a + 500, len(r))) for a in range(0, len(r), 500)))
    assert not only(r, "unrelated")
    (one,) = only(r.with_signals(steer=np.random.default_rng(7).permutation(r["steer"])), "unrelated")
    assert "steer was recorded on another drive" in one.sentence


def sliding(seed, grip):
    """A car whose turning is bounded by grip, and lags behind where it slides."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 80.0, 0.02)
    v = 14.0 + 2.0 * np.sin(0.3 * time)
    steer = 0.05 * wander(rng, len(time), 0.02, 1.5)
    due = grip / v * np.tanh(v**2 * steer / 2.9 / grip)
    turn = np.zeros(len(time))
    for k in range(1, len(time)):
        lag = 0.1 + 2.5 * (abs(due[k] * v[k]) > 0.95 * grip)
        turn[k] = turn[k - 1] + (due[k] - turn[k - 1]) * 0.02 / lag
    noise = rng.standard_normal((2, len(time)))
    signals = {"v_x": v, "steer": steer, "yaw_rate": turn + 0.003 * noise[0], "a_y": v * turn + 0.05 * noise[1]}
    return Recording("sliding", time, signals)


@pytest.mark.parametrize("grip", [1.5, 3.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_car_that_slides_is_not_said_to_have_the_steering_of_another_drive(seed, grip):
    r = sliding(seed, grip)
    assert not only(r, "unrelated")
    assert not distrusted(only(r, "slides"))
    (one,) = only(r.with_signals(steer=sliding(seed + 10, grip)["steer"]), "unrelated")
    assert one.severity is Severity.DISTRUST


def test_steering_of_the_wrong_sign_is_not_said_to_be_of_another_drive():
    r = recorded(7)
    assert not only(r.with_signals(steer=-r["steer"]), "unrelated")


@pytest.mark.parametrize("rows", [3, 30])
def test_too_few_rows_are_said_and_nothing_is_called_missing(rows):
    findings = check(recorded(1).rows(100, 100 + rows))
    assert [one.kind for one in findings] == ["short"]
    assert findings[0].severity is Severity.WARNING


def test_what_does_not_turn_is_no_drive_for_a_lateral_model():
    r = recorded(1)
    rng = np.random.default_rng(2)
    straight = r.with_signals(**{n: 0.01 * rng.standard_normal(len(r)) for n in ("yaw_rate", "a_y", "steer")})
    (one,) = only(straight, "still")
    assert one.severity is Severity.WARNING
    assert "nothing turns: yaw_rate and a_y" in one.sentence


@pytest.mark.parametrize("kind", DRIVES)
@pytest.mark.parametrize("seed", range(2))
def test_a_drive_is_one(kind, seed):
    findings = check(recorded(seed, **DRIVES[kind]))
    assert not distrusted(findings)
    assert not {one.kind for one in findings} & {"short", "unordered", "still", "unrelated", "asleep"}
