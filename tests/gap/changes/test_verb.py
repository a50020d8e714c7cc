"""What changed between recordings of one car: grip that was lost is named with its size, and nothing is made up."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from gap_cases import CAR, NUMBERS, lap, nominal

from greybox_id.api.closed_vehicle import closed_vehicle
from greybox_id.base.errors import BadInput
from greybox_id.datasets.recording import Recording
from greybox_id.gap.changes.between_runs import VaryingNumber
from greybox_id.gap.changes.usual import LEVER_ARM, USUAL, acts, driven_alike, driven_elsewhere
from greybox_id.gap.changes.verb import Changed, diagnose_change, drifting, filtered_alike, visible, visible_changes
from greybox_id.gap.estimation.calibration import CAL
from greybox_id.gap.gap import Ranked
from greybox_id.models.effects import EFFECTS
from greybox_id.models.parameter import Stated
from greybox_id.models.registry import build
from greybox_id.models.vehicle import Vehicle

TOLERANT = Vehicle(
    "car",
    {**NUMBERS, "I_z": Stated(NUMBERS["I_z"].value, 200.0), "B_f": Stated(NUMBERS["B_f"].value, 0.5)},
    noise=CAR.noise,
)


def changed(effects, seconds=20.0, without=()):
    def recorded(effects, seed):
        own = lap(effects, seconds=seconds, seed=seed)
        return replace(own, signals={name: values for name, values in own.signals.items() if name not in without})

    before, after, held_out = [recorded({}, 1), recorded({}, 2)], [recorded(effects, 3)], [recorded(effects, 4)]
    return diagnose_change(nominal(vehicle=TOLERANT), after, before, EFFECTS, vehicle=TOLERANT, held_out=held_out)


def test_without_a_recording_from_before_nothing_can_have_changed():
    with pytest.raises(BadInput, match="Since when"):
        diagnose_change(nominal(), [lap(seconds=4.0)], [], EFFECTS, vehicle=CAR)


@pytest.mark.slow
def test_grip_that_was_lost_is_what_changed():
    found = changed({"grip_scale": 0.6})
    (own,) = found.changed
    assert own["effect"] == "grip_scale"
    assert own["magnitude"] == pytest.approx(0.6, abs=0.06)
    assert own["before"] == pytest.approx(1.0, abs=0.05)
    assert own["share"] > 0.5
    assert {each["effect"] for each in found.not_changed} | {*found.not_seen} == set(found.scatter) - {"grip_scale"}
    assert len(found.not_changed) > len(found.not_seen)
    assert found.to_json()["since"] == ["lap1", "lap2"]


@pytest.mark.slow
def test_grip_and_an_offset_that_changed_at_once_are_both_named():
    found = changed({"grip_scale": 0.6, "steering_offset": 0.02})
    sizes = {own["effect"]: own["magnitude"] for own in found.changed}
    assert sizes == {"grip_scale": pytest.approx(0.6, abs=0.05), "steering_offset": pytest.approx(0.02, abs=0.004)}
    assert all(own["share"] > 0.1 for own in found.changed)
    assert sum(own["share"] for own in found.changed) == pytest.approx(found.gap.held_out.closed)


@pytest.mark.slow
def test_runs_that_agree_make_a_change_of_usual_scatter_show():
    found = changed({"steering_offset": 0.008})
    (own,) = found.changed
    assert own["effect"] == "steering_offset"
    assert own["magnitude"] == pytest.approx(0.008, abs=0.002)
    assert found.gap.p_value < 1e-3


@pytest.mark.slow
def test_errors_that_no_change_explains_are_an_alarm():
    louder = [lap(seconds=20.0, seed=k) for k in (3, 4)]
    rng = np.random.default_rng(5)  # a yaw rate that wanders within seconds
    louder = [own.with_signals(yaw_rate=own["yaw_rate"] + 0.04 * np.sin(own.time * rng.uniform(2.0, 3.0)))
              for own in louder]  # fmt: skip
    before = [lap(seconds=20.0, seed=k) for k in (1, 2)]
    found = diagnose_change(nominal(vehicle=TOLERANT), louder[:1], before, EFFECTS, vehicle=TOLERANT,
                            held_out=louder[1:])  # fmt: skip
    assert found.changed == []
    assert found.gap.gap_detected
    assert found.gap.p_value < 0.5
    assert "times as far from predictions as before" in found.gap.unknown


@pytest.mark.slow
@pytest.mark.parametrize("without", [("v_y",), ()])
def test_a_gyro_that_reads_later_is_no_delay_of_the_steering(without):
    (own,) = changed({"sensor_latency_yaw": 0.08}, without=without).changed
    assert own["effect"] == "sensor_latency_yaw"
    assert own["magnitude"] - own["before"] == pytest.approx(0.08, abs=0.02)


def test_a_gyro_may_be_late_alone_whatever_else_is_read():
    late, read = EFFECTS["sensor_latency_yaw"], ("v_x", "yaw_rate")
    assert acts(late, nominal(), read)
    assert acts(late, nominal(), (*read, "v_y"))
    assert not acts(EFFECTS["sensor_latency_imu"], nominal(), read)  # whose accelerations are not read


@pytest.mark.slow
def test_where_nothing_changed_nothing_is_named():
    found = changed({})
    assert found.changed == []
    assert set(found.scatter) <= set(USUAL)
    wheelbase = NUMBERS["l_f"].value + NUMBERS["l_r"].value
    assert all(0 < sd <= 1.2 * USUAL[name] * (wheelbase if name == LEVER_ARM else 1.0)
               for name, (_, sd) in found.scatter.items())  # fmt: skip
    assert {own.effect for own in found.gap.ranking} <= set(USUAL)


@pytest.mark.slow
def test_a_delay_is_stated_with_what_clocks_differ_by():
    """Commands that are stamped late seem to act before they are given; what changed is how much later they act."""

    def stamped(effects, seed):
        own = lap(effects, seconds=20.0, seed=seed)
        early = {name: values[rows:] for name, values in own.signals.items() if name != "steer"}
        cut = own.rows(0, len(own) - rows)
        return replace(cut, signals={**cut.signals, **early})

    rows = round(0.06 / lap(seconds=4.0).sample_time)
    late = {"steering_delay": 0.12}
    before, after, held_out = [stamped({}, 1), stamped({}, 2)], [stamped(late, 3)], [stamped(late, 4)]
    found = diagnose_change(nominal(vehicle=TOLERANT), after, before, EFFECTS, vehicle=TOLERANT, held_out=held_out)
    (own,) = found.changed
    assert own["effect"] == "steering_delay"
    assert own["before"] == pytest.approx(-0.06, abs=0.02)
    assert own["magnitude"] - own["before"] == pytest.approx(0.12, abs=0.03)
    assert found.vehicle.effects["steering_delay"].value == 0.0  # a simulation is late by no less


@pytest.mark.slow
def test_one_recording_decides_by_its_halves_where_no_other_is_held_out():
    before = [lap(seconds=20.0, seed=k) for k in (1, 2)]
    after = [lap({"steering_delay": 0.12}, seconds=40.0, seed=3)]
    found = diagnose_change(nominal(vehicle=TOLERANT), after, before, EFFECTS, vehicle=TOLERANT)
    (own,) = found.changed
    assert own["effect"] == "steering_delay"
    assert own["magnitude"] == pytest.approx(0.12, abs=0.03)
    assert closed_vehicle(found.vehicle, found.gap).model.effects["steering_delay"].value == own["magnitude"]


@pytest.mark.parametrize(("offsets", "said"), [([0.0, 0.02, 0.04], True), ([0.02, 0.0, 0.021], False)])
def test_what_drifts_over_recordings_from_before_is_said(offsets, said):
    known = SimpleNamespace(
        deviations=np.array(offsets)[:, None], deviation_sds=np.full((3, 1), 0.002), varying=(0,),
        numbers=(VaryingNumber("steering_offset", False, 0.0, 0.02, 1e-4, -0.2, 0.2, USUAL["steering_offset"]),),
    )  # fmt: skip
    names = [SimpleNamespace(name=f"lap{k}") for k in (1, 2, 3)]
    found = drifting(known, {"steering_offset": "steering_offset"}, names)
    assert bool(found) is said
    assert not said or found[0].startswith("steering_offset drifts from lap1 to lap3")


def test_nothing_is_asked_of_a_vehicle_of_which_nothing_is_stated():
    with pytest.raises(BadInput, match="No vehicle is stated"):
        diagnose_change(nominal(), [lap(seconds=4.0)], [lap(seconds=4.0, seed=1)], EFFECTS, vehicle=None)


def test_recordings_at_other_rates_have_passed_other_filters():
    fast, slow = lap(seconds=4.0), lap(seconds=4.0, seed=1)
    assert filtered_alike([fast, slow])
    thinned = Recording("thin", slow.time[::3], {name: values[::3] for name, values in slow.signals.items()})
    assert not filtered_alike([fast, thinned])


def test_driven_alike_is_steered_and_as_fast_as_the_others_most_of_the_time():
    def ride(steer, v_x, seconds=4.0):
        time = np.arange(0.0, seconds, 0.05)
        signals = {"steer": np.full(len(time), steer), "v_x": np.where(np.arange(len(time)) % 2, v_x, np.nan)}
        return SimpleNamespace(recording=Recording("lap", time, signals))

    left, right = ride(0.2, 2.0), ride(-0.1, 4.0)
    assert driven_alike([ride(0.21, 2.1), right], [left, right]) == 1.0
    assert driven_alike([ride(0.21, 4.0)], [left]) == 0.0  # of another speed
    assert driven_alike([left, ride(0.5, 2.0)], [left]) == 0.5
    assert driven_alike([left], [left, right]) == 0.5  # which says little of what they have in common
    assert driven_alike([ride(0.2, 2.0, 0.5)], [left]) == 0.0  # not a second of it


def test_what_is_doubted_is_not_said_to_be_the_same():
    doubted = Ranked("grip_scale", 0.4, 1.7, "1", (1.5, 1.9), (), 12.0, "its probability is 0.40")
    gap = SimpleNamespace(ranking=(doubted,), applied=())
    sds = {"grip_scale": 0.1, "steering_offset": 0.006, "yaw_rate_bias": np.inf}
    found = Changed(gap, TOLERANT, dict.fromkeys(sds, (0.0, 0.005)), ("lap1",), sds=sds)
    assert found.not_changed == [{"effect": "steering_offset", "within": 0.012}]
    assert found.not_seen == ["yaw_rate_bias"]  # what is not told is not said to be the same, either


def test_where_it_was_driven_otherwise_that_is_said():
    def ride(v, a):
        return SimpleNamespace(
            recording=Recording("r", np.arange(200) * 0.1, {"v_x": np.full(200, v), "a_y": np.full(200, a)})
        )

    words = driven_elsewhere([ride(3.3, -5.6)], [ride(1.5, 1.8), ride(1.5, 1.8)])
    assert "a speed of 3.3 m/s and a lateral acceleration of 5.6 m/s²" in words
    assert "1.5 m/s and 1.8 m/s²" in words


def test_what_one_recording_tells_well_shows_from_a_smaller_size():
    numbers = tuple(
        VaryingNumber(name, False, 0.0, 0.1, 1e-3, -1.0, 1.0, 0.01, 0.3) for name in ("near", "far", "blind")
    )
    L = np.diag([1e6, 1e3, 1e-6])
    V = np.diag([0.01**2] * 3)
    weigher = SimpleNamespace(curve=lambda ride, x: SimpleNamespace(H=L))
    known = SimpleNamespace(weigher=weigher, of_a_run=V, x=np.zeros(3), numbers=numbers, varying=(0, 1, 2),
                            scatter=np.full(3, 0.01))  # fmt: skip
    possible = {one.name: SimpleNamespace(parameter=SimpleNamespace(name=one.name, unit="m")) for one in numbers}
    near, far, blind = visible(known, [None], possible)
    assert [own.effect for own in (near, far, blind)] == ["near", "far", "blind"]
    assert near.told == pytest.approx(1e-3, rel=0.01)
    sd = np.hypot(0.01, 1e-3)
    assert near.size == pytest.approx(
        sd * np.sqrt(2 * (CAL.cost_changed + 0.5 * np.log(1 + (0.3 / sd) ** 2))), rel=0.01
    )
    assert near.size < far.size < blind.size == np.inf


@pytest.mark.slow
def test_what_would_show_is_what_is_found_when_it_has_changed():
    before = [lap(seconds=20.0, seed=k) for k in (1, 2)]
    found = {own.effect: own for own in visible_changes(nominal(vehicle=TOLERANT), before, EFFECTS, vehicle=TOLERANT)}
    assert set(found) <= set(USUAL)
    assert 0.02 < found["grip_scale"].size < 0.4  # 0.6 is found above
    assert found["steering_delay"].size < 0.12


@pytest.mark.slow
def test_a_ratio_that_two_columns_tell_is_named_where_the_motion_would_not_tell_it():
    def recorded(ratio, seed):
        own = lap({"steering_ratio": ratio}, seconds=20.0, seed=seed)
        noise = 1e-3 * np.random.default_rng(seed).standard_normal(len(own))
        return own.with_signals(steer_measured=ratio * own["steer"] + noise)

    before, after = [recorded(1.0, 1), recorded(1.0, 2)], [recorded(1.05, 3)]
    found = diagnose_change(nominal(vehicle=TOLERANT), after, before, EFFECTS, vehicle=TOLERANT)
    (own,) = found.changed
    assert own["effect"] == "steering_ratio"
    assert own["magnitude"] / own["before"] == pytest.approx(1.05, abs=0.01)
    assert own["interval"][1] - own["interval"][0] < 0.04


@pytest.mark.slow
def test_grip_is_seen_where_brakes_lock():
    car = Vehicle(
        "car", {"m": Stated(1500.0), "friction": Stated(1.0, 0.1), "force_per_unit": Stated(3000.0, 150.0),
                "brake_gain": Stated(8.0, 0.8), "c_0": Stated(200.0, 20.0), "c_2": Stated(0.5, 0.05),
                "drive_lag": Stated(0.1, 0.03)},
        noise={"v_x": 0.1, "a_x": 0.3},
    )  # fmt: skip

    def braked(grip, seed):
        rng, time = np.random.default_rng(seed), np.arange(0.0, 90.0, 0.05)
        phase = np.floor(time / 6.0) % 2 == 0
        throttle = np.where(phase, 0.9, -rng.uniform(0.1, 0.6, 15)[(time / 6.0).astype(int)])
        v, force, read = 15.0, 0.0, []
        for u in throttle:
            force += 0.4 * (3000.0 * (u if u > 0 else 8.0 * u) - force)
            pushed = float(np.clip(force, -grip * 1500.0 * 9.81, grip * 1500.0 * 9.81)) if v > 0.5 or u > 0 else 0.0
            a = (pushed - 200.0 - 0.5 * v**2) / 1500.0
            read.append((v, a))
            v = max(v + 0.05 * a, 0.5)
        noisy = np.array(read) + rng.standard_normal((len(time), 2)) * (0.1, 0.3)
        return Recording(f"drive{seed}", time, {"v_x": noisy[:, 0], "a_x": noisy[:, 1], "throttle": throttle})

    model = build("longitudinal", vehicle=car)
    found = diagnose_change(model, [braked(0.25, 3)], [braked(1.0, 1), braked(1.0, 2)], EFFECTS, vehicle=car,
                            held_out=[braked(0.25, 4)])  # fmt: skip
    (own,) = found.changed
    assert own["effect"] == "grip_scale"
    assert own["magnitude"] / own["before"] == pytest.approx(0.25, abs=0.06)
