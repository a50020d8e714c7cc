"""Does a filter know how wrong it is; sentences on what a track cannot be trusted for."""

import numpy as np
import pytest
from compiled import needs_compiler
from driven import driven
from filter_cases import LinearCase, filtered

from greybox_id.base.errors import BadInput
from greybox_id.engine.motion.schedule import MotionRun
from greybox_id.filters.filtering import LaidRun
from greybox_id.filters.findings import (
    bounds,
    consistency,
    distrusted_data,
    identifiable_rows,
    lost,
    must_be_finite,
    only_over_mass,
    too_quiet,
    unidentifiable,
    widening,
    windowed,
)
from greybox_id.filters.kernel import blank_history
from greybox_id.filters.state_space import Tracked
from greybox_id.models.registry import build


def judged(off, spread=None, size=50, gate=5.0):
    return consistency(off, np.ones(len(off)) if spread is None else spread, size, gate)


def test_white_innovations_of_the_size_expected_are_consistent():
    random = np.random.default_rng(0)
    spread = random.uniform(0.5, 4.0, 20_000)
    found = judged(np.sqrt(spread) * random.standard_normal(20_000), spread)
    assert found.count == 20_000
    assert found.nis == pytest.approx(1.0, abs=0.03)
    assert found.inside == pytest.approx(0.95, abs=0.03)
    assert found.correlation_bound == pytest.approx(1.96 / np.sqrt(20_000))
    assert abs(found.correlation) < found.correlation_bound
    assert found.gated == 0


def test_innovations_twice_as_large_have_a_nis_of_four():
    found = judged(2 * np.random.default_rng(0).standard_normal(20_000), gate=50.0)
    assert found.nis == pytest.approx(4.0, rel=0.03)
    assert found.inside < 0.01
    assert found.rms == pytest.approx(2.0, rel=0.02)
    assert widening([found]) == pytest.approx(2.0, rel=0.02)


def test_coloured_innovations_are_told_by_their_correlation():
    random = np.random.default_rng(0)
    off = np.zeros(20_000)
    for k in range(1, len(off)):
        off[k] = 0.3 * off[k - 1] + np.sqrt(1 - 0.3**2) * random.standard_normal()
    found = judged(off)
    assert found.correlation == pytest.approx(0.3, abs=0.03)
    assert found.correlation > found.correlation_bound


def test_what_lies_beyond_the_gate_is_counted_and_weighs_as_if_it_lay_there():
    off = np.random.default_rng(0).standard_normal(10_000)
    off[::1000] = 100.0
    found = judged(off)
    assert found.gated == 10
    assert found.nis == pytest.approx(1.0 + 10 * 25 / 10_000, abs=0.05)


def test_rows_without_a_reading_do_not_count():
    off = np.random.default_rng(0).standard_normal(4000)
    sparse = np.full(8000, np.nan)
    sparse[::2] = off
    assert judged(sparse) == judged(off)


@pytest.mark.parametrize("count", [0, 1])
def test_of_hardly_any_reading_nothing_is_said(count):
    found = judged(np.concatenate([np.ones(count), np.full(5, np.nan)]))
    assert found.count == count
    assert np.isnan([found.nis, found.inside, found.correlation, found.rms]).all()
    assert widening([found]) == 1.0


def test_bands_are_never_narrowed():
    assert widening([judged(0.1 * np.random.default_rng(0).standard_normal(1000))]) == 1.0


def test_windows_are_whole_and_their_bounds_hold_95_percent():
    np.testing.assert_array_equal(windowed(np.arange(7.0), 3), [1.0, 4.0])
    assert len(windowed(np.arange(2.0), 3)) == 0
    low, high = bounds(20)
    means = np.random.default_rng(0).chisquare(20, 20_000) / 20
    assert np.mean((means > low) & (means < high)) == pytest.approx(0.95, abs=0.005)


@needs_compiler
@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_a_filter_with_the_true_noise_is_consistent(kind):
    """A linear model, simulated by its matrices."""
    case, random = LinearCase(0.8), np.random.default_rng(1)
    rows = 6000
    s = np.column_stack([np.full(rows, 0.05), random.standard_normal(rows), np.zeros(rows)])
    x, y = np.array([0.0, 0.0, 0.05, 0.0]), np.zeros((rows, 2))
    F, _, Q = case.step(0.05, 0.0)
    for k in range(rows):
        y[k] = case.H @ x + [0.0, 0.3 * s[k, 1]] + np.sqrt(np.diag(case.R)) * random.standard_normal(2)
        x = F @ x + case.step(0.05, s[k, 1])[1] + np.sqrt(np.diag(Q)) * random.standard_normal(4)
    start = np.array([[0.0, 0.0, 0.05, 0.0]]), np.diag([0.1, 0.1, 0.1, 0.4])[None] ** 2
    _, told = filtered(case.space, kind, *start, s, y, case.p, 5.0)
    for off, spread in zip(told.off.T, told.spread.T, strict=True):
        found = judged(off, spread, 40)
        assert found.nis == pytest.approx(1.0, abs=0.06)
        assert found.inside == pytest.approx(0.95, abs=0.05)
        assert abs(found.correlation) < 1.5 * found.correlation_bound


ROWS = 1000


@pytest.fixture
def run():
    time = 10.0 + 0.02 * np.arange(ROWS)
    own = MotionRun("lap", time, np.zeros((ROWS, 1)), np.ones(1, dtype=bool), np.zeros((ROWS, 1)), range(ROWS))
    return LaidRun(own, np.zeros((ROWS, 3)), np.zeros((ROWS, 1)), np.arange(ROWS), np.arange(ROWS)[:, None])


@pytest.fixture
def history():
    found = blank_history(1, ROWS, 2, 1, "filtered")
    found.off[:] = np.random.default_rng(0).standard_normal((ROWS, 1))
    found.spread[:] = 1.0
    return found


def test_a_filter_that_diverges_is_a_sentence_that_says_when(run, history):
    must_be_finite(history, run, 0, "lap")
    history.filtered[400:] = np.nan
    with pytest.raises(BadInput, match=r"lap: the filter diverges at t = 18.00 s"):
        must_be_finite(history, run, 0, "lap")


def test_stretches_in_which_readings_are_far_off_are_said(run, history):
    assert lost([run], [history], {"yaw_rate": 0}) == []
    history.off[300:500] *= 10
    (said,) = lost([run], [history], {"yaw_rate": 0})
    assert said.startswith("yaw_rate: for 4 s, first at t = 16.0 s, readings are far from what the filter expects")


def test_a_single_glitch_is_no_stretch(run, history):
    history.off[350] = 1000.0
    assert lost([run], [history], {"yaw_rate": 0}) == []


def test_a_number_is_told_where_it_is_known_twice_as_well_as_before():
    values, sds = np.array([1.0, 1.0, 4.0]), np.array([0.11, 0.09, 0.3])
    np.testing.assert_array_equal(
        identifiable_rows(Tracked("k", "1", 1.0, 0.2, True), values, sds), [False, True, True]
    )
    np.testing.assert_array_equal(
        identifiable_rows(Tracked("k", "1", 1.0, 0.2, False), values, sds), [False, True, False]
    )


def test_where_a_stiffness_is_open_is_said_by_the_slip_angle():
    told, slip = np.arange(100) >= 40, np.linspace(0.0, 0.1, 100)
    said = unidentifiable("C_alpha_f", told, slip, "F_yf")
    assert said.startswith("C_alpha_f: not identifiable in 40 % of the rows, mostly where the slip angle")
    assert "below 2.0°" in said
    assert said.endswith("Even in these rows, the lateral force F_yf is identifiable.")
    assert unidentifiable("C_alpha_f", np.ones(100, dtype=bool), slip, "F_yf") == ""


def test_what_is_calibrated_on_motion_is_said_to_be_over_mass():
    model = build("single_track")
    (said,) = only_over_mass(model)
    assert "C_alpha_f / m, C_alpha_r / m, I_z / m" in said
    assert "m = 1450 kg was fixed" in said
    assert only_over_mass(build("kinematic")) == []


def test_noise_below_what_a_recording_resolves_is_said():
    (said,) = too_quiet({"noise_yaw_rate": 2.5e-5, "noise_a_y": 0.1}, {"yaw_rate": 1e-3, "a_y": 0.02})
    assert said.startswith("noise_yaw_rate = 2.5·10⁻⁵ rad/s is below the resolution of the recording (0.001")


def test_what_the_checks_distrust_is_said_of_signals_that_are_used():
    recording = driven("lateral", runs=1, seconds=40.0)
    wrong = recording.with_signals(a_y=recording["a_y"] / 9.81)
    said = distrusted_data(wrong, {"a_y", "yaw_rate"})
    assert any(own.startswith("Data check: a_y is") for own in said)
    assert distrusted_data(wrong, {"yaw_rate"}) == []
    assert distrusted_data(recording, {"a_y", "yaw_rate"}) == []
