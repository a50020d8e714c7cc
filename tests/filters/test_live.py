"""Rows as they arrive: the same estimates as along a recording."""

import io

import numpy as np
import pandas as pd
import pytest
from compiled import needs_compiler
from filter_cases import C_F, C_R, NOISES, WALKS, changed, shaken, simrod, swerving, true_simrod

from greybox_id.base.errors import BadInput
from greybox_id.datasets.column_map import column_map
from greybox_id.datasets.recording import Recording
from greybox_id.filters.how import TrackOptions
from greybox_id.filters.live import follow
from greybox_id.filters.track import verdict
from greybox_id.filters.verb import track
from greybox_id.fitting.fit import NOT_USABLE
from greybox_id.models.effects import EFFECTS

pytestmark = needs_compiler

TWO = ("C_alpha_f", "C_alpha_r")
NOISE = {"walk_v_y": 0.08, "walk_yaw_rate": 0.03, "walk_C_alpha_f": 0.03, "walk_C_alpha_r": 0.03,
         "noise_yaw_rate": 0.02, "noise_a_y": 0.6}  # fmt: skip
"""Large enough for bands not to be widened."""
RIGHT = {**WALKS, **NOISES}


def wrong():
    return simrod(C_alpha_f=0.8 * C_F, C_alpha_r=1.2 * C_R)


def lines(recording):
    """The recording as lines of CSV, to all digits."""
    table = pd.DataFrame({"time": recording.time, **recording.signals})
    return table.to_csv(index=False, float_format="%.17g")


def followed(text, kind="ekf", model=None, parameters=TWO, columns="canonical", noise=NOISE):
    out = io.StringIO()
    how = TrackOptions(kind, noise=noise)
    follow(model or wrong(), parameters, (), EFFECTS, how, column_map(columns), io.StringIO(text), out)
    return pd.read_csv(io.StringIO(out.getvalue()), keep_default_na=False, dtype={"held_back": str})


def refused(text, **more):
    with pytest.raises(BadInput) as caught:
        followed(text, **more)
    return str(caught.value)


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_row_by_row_it_is_what_a_whole_recording_gives(kind, hold, tmp_path):
    recording, _ = swerving(8.0)
    recording = Recording(recording.name, recording.time, recording.signals, hold=hold)
    path = tmp_path / "map.toml"
    names = "\n".join(f'{name} = {{ unit = "{recording.unit(name)}" }}' for name in recording.signals)
    path.write_text(f'name = "own"\nhold = "{hold}"\n[time]\ncolumn = "time"\nunit = "s"\n[signals]\n{names}\n')
    expected = track(wrong(), recording, TWO, how=TrackOptions(kind, noise=NOISE, tune=0))
    assert expected.widened == 1.0
    found = followed(lines(recording), kind, columns=path)
    assert found.columns[0] == "time"
    assert found.columns[-1] == "held_back"
    np.testing.assert_allclose(found["time"], recording.time, rtol=1e-8)
    for name in expected.values:
        scale = np.max(np.abs(expected.values[name]))  # nine digits are written
        np.testing.assert_allclose(found[name], expected.values[name], rtol=5e-9, atol=1e-9 * scale)
        np.testing.assert_allclose(found[f"{name}_sd"], expected.sds[name], rtol=5e-9, atol=1e-9 * scale)
    assert set(found["held_back"]) == {""}


def test_a_glitch_of_the_steering_is_held_back_and_said():
    recording, _ = shaken(20.0)
    steer = recording["steer"].copy()
    steer[500] += 0.2
    clean, glitch = followed(lines(recording)), followed(lines(changed(recording, steer=steer)))
    assert list(np.flatnonzero(glitch["held_back"] == "steer")) == [500]
    assert np.all(np.abs(glitch["sideslip"] - clean["sideslip"]) < 0.5 * clean["sideslip_sd"])


def test_a_true_step_is_late_by_one_row():
    recording, _ = shaken(20.0)
    steer = recording["steer"] + np.where(np.arange(len(recording)) < 500, 0.0, 0.1)
    found = followed(lines(changed(recording, steer=steer)))
    assert list(np.flatnonzero(found["held_back"] == "steer")) == [500]


def test_missing_readings_are_done_without_and_a_missing_input_keeps_its_value():
    recording, _ = shaken(4.0)
    steer, kept, a_y = recording["steer"].copy(), recording["steer"].copy(), recording["a_y"].copy()
    steer[120], kept[120], a_y[60:80] = np.nan, kept[119], np.nan
    found, expected = (followed(lines(changed(recording, steer=own, a_y=a_y))) for own in (steer, kept))
    np.testing.assert_array_equal(found["sideslip"], expected["sideslip"])
    assert np.all(np.isfinite(found["sideslip"]))


def test_behind_a_long_gap_it_starts_anew_but_knows_its_tyres():
    recording, _ = swerving(20.0)
    late = Recording("gap", np.where(np.arange(1000) < 500, recording.time, recording.time + 3.0), recording.signals)
    found = followed(lines(late))
    assert found["sideslip_sd"][500] > 3 * found["sideslip_sd"][499]
    assert found["C_alpha_f_sd"][500] < 1.1 * found["C_alpha_f_sd"][499]


def test_each_line_is_answered_before_the_next_is_read():
    recording, _ = shaken(1.0)
    out, told = io.StringIO(), []

    class Arriving(io.StringIO):
        def readline(self, size=-1):
            told.append(out.getvalue().count("\n"))
            return super().readline(size)

    follow(
        wrong(), TWO, (), EFFECTS, TrackOptions(noise=NOISE), column_map("canonical"), Arriving(lines(recording)), out
    )
    assert told[:5] == [0, 1, 2, 3, 4]
    assert out.getvalue().count("\n") == len(recording) + 1


HEADER = "time,steer,v_x,yaw_rate,a_y\n"
ROW = "0,0.01,14,0.1,1.0\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "Standard input is empty"),
        ("t,steer,v_x,yaw_rate,a_y\n" + ROW, 'no column "time" for time'),
        (HEADER + ROW + "0.02,zero,14,0.1,1\n", "Line 3 of standard input: 'zero' is not a number."),
        (HEADER + "0,,14,0.1,1\n", "The first row lacks steer"),
        (HEADER + ROW + ROW, "rows must come in the order of time"),
        ("time,steer,v_x\n0,0.01,14\n", "none of v_x, yaw_rate, a_y"),
        (HEADER + ROW + "0.02,0.01,14,0.1," + "1" * 131_073 + "\n", "Line 3 of standard input cannot be read"),
        (HEADER + ROW + "0.02,0.01,14,0.1," + "1" * (1 << 20) + "\n", "Line 3 of standard input has 1 MB or more"),
    ],
)
def test_bad_lines_are_sentences(text, said):
    assert said in refused(text)


@pytest.mark.parametrize("reading", [1e29, 1e155])
@pytest.mark.parametrize("column", ["steer", "v_x", "a_y"])
def test_what_is_no_reading_does_not_stay(reading, column):
    """Within a second the estimates are those without it."""
    recording, _ = shaken(3.0)
    row = len(recording) // 2
    odd = recording[column].copy()
    odd[row] = reading
    clean, found = followed(lines(recording)), followed(lines(changed(recording, **{column: odd})))
    later = slice(row + 50, None)
    assert np.all(np.abs(found["sideslip"] - clean["sideslip"])[later] < clean["sideslip_sd"][later])


@pytest.mark.parametrize("column", ["steer", "v_x", "yaw_rate"])
def test_a_first_row_that_is_no_reading_does_not_stay(column):
    recording, _ = shaken(3.0)
    odd = recording[column].copy()
    odd[0] = 1e29
    clean, found = followed(lines(recording)), followed(lines(changed(recording, **{column: odd})))
    later = slice(100, None)
    assert np.all(np.abs(found["sideslip"] - clean["sideslip"])[later] < clean["sideslip_sd"][later])


@pytest.mark.parametrize("row", [",0.01,14,0.1,1\n", "nan,0.01,14,0.1,1\n", "inf,0.01,14,0.1,1\n"])
def test_a_row_without_a_time_is_a_sentence(row):
    assert "Line 3" in refused(HEADER + ROW + row + "0.04,0.01,14,0.1,1.0\n")


@pytest.mark.parametrize("odd", ["inf", "-inf", "nan", "", "60"])
def test_what_is_no_reading_of_its_sensor_is_gated_and_the_verdict_stands(odd):
    """60 m/s^2 is hundreds of times the noise of a_y."""
    recording, _ = shaken(6.0)
    clean = lines(recording).splitlines()
    place, spoilt = clean[0].split(",").index("a_y"), list(clean)
    for number in (200, 201, 202):
        cells = clean[number].split(",")
        spoilt[number] = ",".join([*cells[:place], odd, *cells[place + 1 :]])
    out, how = io.StringIO(), TrackOptions(noise=RIGHT)
    text = io.StringIO("\n".join(spoilt) + "\n")
    judged = follow(true_simrod(), (), (), EFFECTS, how, column_map("canonical"), text, out)
    found = pd.read_csv(io.StringIO(out.getvalue()))
    assert np.all(np.isfinite(found.drop(columns="held_back")))
    assert judged.usability != NOT_USABLE, judged.reasons


def test_a_vehicle_that_the_filter_has_lost_gets_the_verdict_of_a_track():
    recording, _ = shaken(6.0)
    lost = changed(recording, yaw_rate=-recording["yaw_rate"])
    how = TrackOptions(noise=RIGHT, tune=0)
    judged = follow(
        true_simrod(), (), (), EFFECTS, how, column_map("canonical"), io.StringIO(lines(lost)), io.StringIO()
    )
    assert judged.usability == verdict(track(true_simrod(), lost, (), how=how)).usability == NOT_USABLE
    assert "the filter no longer follows the vehicle" in judged.reasons[0]


def test_noise_of_readings_must_be_stated():
    out = io.StringIO()
    with pytest.raises(BadInput, match=r"must be stated: noise_a_y\. State it with noise NAME=SIZE"):
        follow(wrong(), (), (), EFFECTS, TrackOptions(noise={"noise_yaw_rate": 0.01}), column_map("canonical"),
               io.StringIO(HEADER + ROW), out)  # fmt: skip


def test_delays_cannot_be_followed():
    late = wrong() + EFFECTS["steering_delay"]
    late = late.with_parameters(late["steering_delay"].with_value(0.05))
    assert "has delays or latencies" in refused(HEADER + ROW, model=late, noise=NOISE)
