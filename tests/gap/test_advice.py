"""What would tell more: manoeuvres for what was not driven, channels for what was not read."""

from greybox_id.gap.advice import advice
from greybox_id.models.effects import EFFECTS


def test_a_manoeuvre_is_advised_for_what_it_shows_and_nothing_else():
    (said,) = advice([], ["load_sensitivity", "brake_bias", "grip_scale"], EFFECTS)
    assert said == "To detect load_sensitivity, grip_scale: drive a slow spiral up to the limit."


def test_what_acts_on_a_channel_that_nobody_reads_shows_in_no_manoeuvre():
    weak = ["velocity_lever_arm", "imu_lever_arm"]
    driven, recorded = advice([], weak, EFFECTS, ("v_y",))
    assert driven.startswith("To detect imu_lever_arm: drive ")
    assert recorded == "To detect velocity_lever_arm: record v_y."
    assert len(advice([], weak, EFFECTS)) == 1


def test_a_search_that_ended_in_two_places_advises_a_fit_first():
    first, *others = advice([], ["grip_scale"], EFFECTS, apart=1000.0)
    assert "two searches for causes gave different results. First fit the numbers of the file" in first
    assert others == list(advice([], ["grip_scale"], EFFECTS, apart=20.0))
