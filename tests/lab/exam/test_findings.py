"""Answers beside diagnoses, written by hand."""

from math import inf, isnan

import pytest
from exam_candidates import diagnosis, ranked

from greybox_id.base.errors import BadInput
from greybox_lab.exam.answers import Answer
from greybox_lab.exam.findings import finding
from greybox_lab.exam.measures import confusions, measures

NULL = Answer("a", "null", "clean", {})
SINGLE = Answer(
    "b", "single", "clean", {"accel_bias_x": 0.2}, {"accel_bias_x": 0.0}, {"accel_bias_x": ("imu_mount_pitch",)},
    {"a_x": 1.0}, {"a_x": 1.0},
)  # fmt: skip
DOUBLE = Answer(
    "c", "double", "clean", {"accel_bias_x": 0.2, "imu_mount_roll": 0.1},
    {"accel_bias_x": 0.0, "imu_mount_roll": 0.0},
    {"accel_bias_x": ("imu_mount_pitch",), "imu_mount_roll": ("imu_mount_pitch",)}, {"a_x": 1.0}, {"a_x": 1.0},
)  # fmt: skip
OUTSIDE = Answer("d", "outside", "clean", {"puncture": 0.3}, {"puncture": 0.0}, {}, {"a_y": 0.25}, {"a_y": 0.2})
LIMIT = Answer(
    "e", "single", "clean", {"steering_rate_limit": 0.4}, {"steering_rate_limit": inf}, {}, {"a_y": 1.0}, {"a_y": 1.0}
)


def says(*effects, **own):
    return diagnosis(gap_detected=True, ranking=[ranked(effect) for effect in effects], **own)


def test_a_null_is_right_when_nothing_is_found():
    assert finding(NULL, diagnosis()).wrong == ""
    assert finding(NULL, says("grip_scale")).wrong == "false alarm"


def test_an_effect_that_cannot_be_told_apart_is_right_but_not_by_name():
    alike = finding(SINGLE, says("imu_mount_pitch", "accel_bias_x"))
    assert (alike.first, alike.first_strictly, alike.wrong) == (True, False, "")
    strictly = finding(SINGLE, says("accel_bias_x"))
    assert (strictly.first, strictly.first_strictly) == (True, True)


def test_a_later_choice_counts_among_three_only():
    third = finding(SINGLE, says("grip_scale", "mass_change", "accel_bias_x"))
    assert (third.first, third.among_three, third.wrong) == (False, True, "second or third")
    fourth = finding(SINGLE, says("grip_scale", "mass_change", "cog_shift", "accel_bias_x"))
    assert (fourth.among_three, fourth.wrong) == (False, "not among the first three")


def test_a_ranking_without_a_gap_names_nothing():
    quiet = finding(SINGLE, diagnosis(ranking=[ranked("accel_bias_x")]))
    assert (quiet.first, quiet.wrong, quiet.choices) == (False, "not detected", {})


def test_two_effects_need_two_names():
    assert finding(DOUBLE, says("imu_mount_roll", "cog_shift", "accel_bias_x")).among_three
    assert not finding(DOUBLE, says("imu_mount_pitch", "cog_shift", "grip_scale")).among_three
    assert finding(DOUBLE, says("imu_mount_pitch", "accel_bias_x")).among_three
    assert not finding(DOUBLE, says("accel_bias_x")).among_three


def test_outside_the_vocabulary_unknown_is_the_answer():
    assert finding(OUTSIDE, says("front_stiffness")).wrong == "not called unknown"
    assert finding(OUTSIDE, says("front_stiffness", unknown_probability=0.7)).wrong == ""


def test_magnitudes_are_measured_from_where_the_effect_is_not_there():
    said = ranked("accel_bias_x", magnitude=0.21, interval=(0.15, 0.25))
    (size,) = finding(SINGLE, diagnosis(gap_detected=True, ranking=[said])).sizes
    assert (size.error, size.covered) == (pytest.approx(0.05), True)
    gain = Answer("f", "single", "clean", {"motor_gain": 1.1}, {"motor_gain": 1.0}, {}, {"v_x": 1.0}, {"v_x": 1.0})
    said = ranked("motor_gain", magnitude=1.12, interval=(1.11, 1.13))
    (size,) = finding(gain, diagnosis(gap_detected=True, ranking=[said])).sizes
    assert (size.error, size.covered) == (pytest.approx(0.2), False)


def test_what_changed_is_measured_from_where_it_was_before():
    said = ranked("accel_bias_x", magnitude=0.51, interval=(0.45, 0.55))
    (size,) = finding(
        SINGLE, diagnosis(gap_detected=True, ranking=[said], scatter={"accel_bias_x": {"mean": 0.3}})
    ).sizes
    assert (size.error, size.covered) == (pytest.approx(0.05), True)
    gain = Answer("f", "single", "injected", {"motor_gain": 1.1}, {"motor_gain": 1.0}, {}, {"v_x": 1.0}, {"v_x": 1.0})
    said = ranked("motor_gain", magnitude=0.896, interval=(0.888, 0.904))
    (size,) = finding(gain, diagnosis(gap_detected=True, ranking=[said], scatter={"motor_gain": {"mean": 0.8}})).sizes
    assert (size.error, size.covered) == (pytest.approx(0.2), False)


def test_limits_are_measured_against_themselves():
    said = ranked("steering_rate_limit", magnitude=0.5, interval=(0.3, inf))
    (size,) = finding(LIMIT, diagnosis(gap_detected=True, ranking=[said])).sizes
    assert (size.error, size.covered) == (pytest.approx(0.25), True)


def test_an_error_is_wrong_wherever_something_could_be():
    error = {"error": "Stopped after 60 s.", "cost": {"cpu_s": None, "wall_s": 60.0}}
    assert finding(NULL, error).detected
    assert finding(SINGLE, error).unknown
    assert not finding(OUTSIDE, error).unknown
    assert finding(SINGLE, error).wrong == "error"
    assert isnan(finding(SINGLE, error).cpu)


def test_a_diagnosis_that_lacks_something_is_refused():
    with pytest.raises(BadInput, match="does not say ranking"):
        finding(SINGLE, {"gap_detected": True, "unknown_probability": 0.0, "applied": [], "gap": {}})


def test_closing_counts_where_something_was_applied():
    applied = says("accel_bias_x", applied=["accel_bias_x"], gap={"closed": 0.97})
    assert (finding(SINGLE, applied, 0.95).claimed, finding(SINGLE, applied, 0.95).verified) == (0.97, 0.95)
    assert isnan(finding(SINGLE, says("accel_bias_x"), 0.95).claimed)


def test_measures_count_what_they_say():
    found = [
        finding(NULL, diagnosis()),
        finding(SINGLE, says("imu_mount_pitch", "accel_bias_x", applied=["accel_bias_x"], gap={"closed": 0.97}), 0.95),
        finding(LIMIT, says("grip_scale")),
        finding(DOUBLE, says("imu_mount_roll", "accel_bias_x")),
        finding(OUTSIDE, diagnosis(unknown_probability=0.9)),
    ]
    told = {measure.key: measure for measure in measures(found, "clean")}
    assert (told["false_alarms"].value, told["false_alarms"].of, told["false_alarms"].passed) == (0.0, 1, True)
    assert (told["detection"].value, told["detection"].of) == (1.0, 3)  # a small one need not be detected
    assert (told["first"].value, told["first_strictly"].value, told["among_three"].value) == (0.5, 0.0, 0.5)
    assert told["doubles"].value == 1.0
    assert (told["unknown"].value, told["wrongly_unknown"].value) == (1.0, 0.0)
    assert told["closed"].value == 0.95
    assert told["claim"].value == pytest.approx(0.02)
    assert told["magnitude"].of == 2
    assert told["calibration"].value == pytest.approx(abs(0.9 - 3 / 5))
    assert isnan(told["cpu"].value)
    assert told["cpu"].passed is None
    assert confusions(found) == {
        "accel_bias_x": {"imu_mount_pitch": 1}, "puncture": {"unknown": 1}, "steering_rate_limit": {"grip_scale": 1},
    }  # fmt: skip


def test_workshop_bars_are_wider():
    errors = [finding(NULL, says("grip_scale") if k == 0 else diagnosis()) for k in range(25)]
    assert {measure.key: measure.passed for measure in measures(errors, "clean")}["false_alarms"] is False
    assert {measure.key: measure.passed for measure in measures(errors, "workshop")}["false_alarms"] is True
    assert all(measure.key != "false_alarms" for measure in measures(errors, "rough"))


def test_names_that_are_applied_and_not_there_are_counted():
    right = finding(SINGLE, says("imu_mount_pitch", applied=["imu_mount_pitch"]))
    assert right.beside == ()
    more = finding(SINGLE, says("accel_bias_x", "yaw_inertia", applied=["accel_bias_x", "yaw_inertia"]))
    assert (more.first, more.beside) == (True, ("yaw_inertia",))
    assert finding(SINGLE, says("accel_bias_x", "yaw_inertia", applied=["accel_bias_x"])).beside == ()
    null = finding(NULL, says("grip_scale", applied=["grip_scale"]))
    found = {
        measure.key: measure for measure in measures([right, more, null, finding(OUTSIDE, says("puncture"))], "foreign")
    }
    assert (found["beside"].value, found["beside"].of, found["beside"].passed) == (0.5, 2, False)
    assert found["null_names"].value == 1.0


def test_outside_the_vocabulary_a_name_at_one_half_is_named():
    low = finding(OUTSIDE, diagnosis(gap_detected=True, ranking=[ranked("grip_scale", 0.3)]))
    high = finding(OUTSIDE, diagnosis(gap_detected=True, ranking=[ranked("grip_scale", 0.6)]))
    assert (low.beside, high.beside) == ((), ("grip_scale",))


def test_a_budget_tells_how_much_went_to_names_that_are_not_there():
    budget = [
        {"effect": "accel_bias_x", "share": 0.7, "low": 0.6, "high": 0.8},
        {"effect": "yaw_inertia", "share": 0.1, "low": 0.0, "high": 0.2},
        {"unnamed": 0.2, "low": 0.1, "high": 0.3},
    ]
    assert finding(SINGLE, says("accel_bias_x", budget=budget)).misplaced == 0.1
    assert isnan(finding(SINGLE, says("accel_bias_x")).misplaced)
    assert isnan(finding(SINGLE, says("accel_bias_x", budget=[])).misplaced)


MANY = Answer(
    "m", "many", "many", {"steering_delay": 0.03, "grip_scale": 0.9, "accel_bias_y": 0.2},
    {"steering_delay": 0.0, "grip_scale": 1.0, "accel_bias_y": 0.0}, {"steering_delay": ("steering_lag",)},
)  # fmt: skip


def test_of_many_effects_each_needs_a_name_of_its_own():
    two = finding(MANY, says("steering_lag", "steering_delay", "grip_scale", applied=["steering_lag", "grip_scale"]))
    assert (two.applied_right, two.beside, two.right, two.wrong) == (2, (), False, "2 of 3 applied")
    doubled = finding(MANY, says(applied=["steering_lag", "steering_delay", "grip_scale"]))
    assert (doubled.applied_right, doubled.right) == (2, False)
    whole = finding(MANY, says(applied=["steering_lag", "grip_scale", "imu_mount_roll"]))
    assert (whole.applied_right, whole.right, whole.wrong) == (3, True, "")
    more = finding(MANY, says(applied=["steering_lag", "grip_scale", "imu_mount_roll", "cog_shift"]))
    assert (more.applied_right, more.beside, more.right) == (3, ("cog_shift",), False)


def test_a_class_of_causes_is_right_where_a_likely_member_is_there():
    late = {"members": ["tyre_relaxation", "steering_delay"], "probability": 0.98, "applied": "tyre_relaxation",
            "each": {"tyre_relaxation": 0.6, "steering_delay": 0.38}}  # fmt: skip
    exam_finding = finding(MANY, says(applied=["tyre_relaxation"], classes=[late]))
    assert (exam_finding.applied_right, exam_finding.beside, exam_finding.classes) == (1, (), ((0.98, True),))
    hardly = late | {"each": {"tyre_relaxation": 0.97, "steering_delay": 0.01}}
    exam_finding = finding(MANY, says(applied=["tyre_relaxation"], classes=[hardly]))
    assert (exam_finding.applied_right, exam_finding.beside) == (0, ("tyre_relaxation",))


def test_what_a_vehicle_has_by_nature_is_neither_right_nor_wrong():
    rolls = Answer("r", "null", "rough", {}, nature=("roll_dynamics",))
    assert finding(rolls, says("roll_dynamics", applied=["roll_dynamics"])).beside == ()
    assert finding(rolls, says("roll_dynamics")).ranked == ()
    assert finding(rolls, says("cog_shift", applied=["cog_shift"])).beside == ("cog_shift",)


def test_what_closes_is_measured_by_what_the_truth_closes():
    half = finding(MANY, says(applied=["grip_scale"]), verified=0.45, by_truth=0.9)
    assert half.of_truth == pytest.approx(0.5)
    assert finding(MANY, says(), by_truth=0.9).of_truth == 0.0
    assert isnan(finding(MANY, says(applied=["grip_scale"]), verified=0.45).of_truth)


def test_many_effects_are_counted_one_by_one():
    found = [
        finding(MANY, says(applied=["steering_lag", "grip_scale"]), 0.8, 0.8),
        finding(MANY, says(applied=["steering_lag", "grip_scale", "accel_bias_y"]), 0.8, 0.8),
        finding(MANY, says(applied=["cog_shift"]), 0.0, 0.8),
    ]
    told = {measure.key: measure for measure in measures(found, "many")}
    assert (told["causes"].value, told["causes"].of) == (pytest.approx(5 / 9), 9)
    assert told["everything"].value == pytest.approx(1 / 3)
    assert told["extra"].value == pytest.approx(1 / 3)
    assert told["of_truth"].value == 1.0
    assert told["causes"].passed is False


def test_what_scatters_readings_counts_as_applied_where_it_is_named():
    shaky = Answer("s", "single", "clean", {"timestamp_jitter": 0.004}, {"timestamp_jitter": 0.0})
    exam_finding = finding(shaky, says("timestamp_jitter"))
    assert (exam_finding.applied, exam_finding.right) == (("timestamp_jitter",), True)
    unsure = finding(shaky, diagnosis(gap_detected=True, ranking=[ranked("timestamp_jitter", probability=0.3)]))
    assert unsure.applied == ()
    assert finding(NULL, says("timestamp_jitter")).beside == ("timestamp_jitter",)
