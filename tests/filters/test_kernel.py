"""The compiled filters against Kalman's own equations, against filterpy, and against themselves in plain Python."""

import casadi as cs
import numpy as np
import pytest
from compiled import needs_compiler
from filter_cases import NEVER, A, B, LinearCase, assert_close, driven_space, driving, filtered
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from greybox_id.filters.kernel import CompiledFilter, SigmaPoints

pytestmark = needs_compiler

both_kinds = pytest.mark.parametrize("kind", ["ekf", "ukf"])
RICH = {
    "parameters": ("C_alpha_f", "C_alpha_r"), "disturbances": ("road_bank",), "coloured": ("a_y",),
    "effects": {"tyre_relaxation": 0.4, "longitudinal_load_transfer": 1.0},
}  # fmt: skip
"""Relaxed quantities, what walks in its logarithm, what is drawn back, and a coloured reading."""
ACTUATED = RICH | {"effects": {"steering_lag": 0.05, **RICH["effects"]}}
"""And an actuator, which has no variance at all."""


@pytest.mark.parametrize(("kind", "close"), [("ekf", 1e-12), ("ukf", 1e-10)])
@pytest.mark.parametrize("T", [None, 0.8])
@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_on_a_linear_model_it_is_kalman_s_filter(kind, close, T, missing):
    case = LinearCase(T)
    given = case.given(missing=missing)
    *expected, expected_cost = case.kalman(*given)
    cost, history = filtered(case.space, kind, *given, case.p)
    found = (history.predicted, history.predicted_P, history.filtered, history.filtered_P)
    for a, b in zip(found, expected, strict=True):
        assert_close(a, b, close)
    assert cost == pytest.approx(expected_cost, rel=close)


@pytest.mark.parametrize("T", [None, 0.8])
def test_noise_that_joins_throughout_is_that_of_white_noise_however_rows_are_cut(T):
    case = LinearCase(T, throughout=True)
    n, h, sizes = case.space.size, 0.04, case.sizes
    drift = np.zeros((n, n))  # x' = drift x + noise, whose covariance is integrated exactly (Van Loan, 1978)
    drift[:2, :2], drift[:2, 2], drift[3, 3] = A, B, -1 / sizes["memory_a_y"]
    drift[2, 2] = 0.0 if T is None else -1 / T
    white = np.diag([0.3**2, 0.1**2, 0.2**2, 2 * sizes["colour_a_y"] ** 2 / sizes["memory_a_y"]])
    both = expm(np.block([[-drift, white], [np.zeros((n, n)), drift.T]]) * h)
    exact = both[n:, n:].T @ both[:n, n:]

    def joined(segments, compiled=True):
        s = np.array([[h / segments, 0.0, 0.0]] * segments + [[0.0, 0.0, 0.0]])
        y = np.full((len(s), 2), np.nan)
        known = np.zeros((1, n)), np.zeros((1, n, n)), s, y
        return filtered(case.space, "ekf", *known, case.p, compiled=compiled)[1].predicted_P[-1]

    scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    assert np.max(np.abs(joined(1) - exact) / scale) < 2e-3
    assert np.max(np.abs(joined(2) - exact) / scale) < 5e-4
    np.testing.assert_allclose(joined(2), joined(2, compiled=False), rtol=1e-12, atol=1e-18)
    ends = LinearCase(T).step(h, 0.0)[2]  # which joins at the end alone
    assert np.max(np.abs(ends - exact) / scale) > 1e-2


@both_kinds
def test_the_likelihood_is_that_of_all_readings_together(kind):
    """Readings of a linear model are jointly normal: their covariance is written down once, without a filter."""
    case = LinearCase(0.8)
    x, P, s, y = case.given(rows=12)
    mean, root, columns = x[0], [np.linalg.cholesky(P[0])], []  # x = mean + root @ (independent normal numbers)
    rows = []
    for k, own in enumerate(s):
        L = np.hstack(root)
        rows.append((case.H @ mean + [0.0, 0.3 * own[1]], L))
        F, u, Q = case.step(own[0], own[1])
        mean, root = F @ mean + u, [F @ L, np.sqrt(Q)]
        columns.append(k)
    widest = rows[-1][1].shape[1]
    H = np.vstack([np.pad(case.H @ L, ((0, 0), (0, widest - L.shape[1]))) for _, L in rows])
    S = H @ H.T + np.kron(np.eye(len(s)), case.R)
    there = np.isfinite(y.ravel())
    e = (y.ravel() - np.concatenate([m for m, _ in rows]))[there]
    S = S[np.ix_(there, there)]
    expected = 0.5 * (e @ np.linalg.solve(S, e) + np.linalg.slogdet(S)[1])
    assert filtered(case.space, kind, x, P, s, y, case.p)[0] == pytest.approx(expected, rel=1e-10)


@both_kinds
def test_a_row_without_readings_changes_nothing(kind):
    case = LinearCase()
    x, P, s, y = case.given()
    y[10:20] = np.nan
    _, told = filtered(case.space, kind, x, P, s, y, case.p)
    np.testing.assert_array_equal(told.filtered[10:20], told.predicted[10:20])
    np.testing.assert_array_equal(told.filtered_P[10:20], told.predicted_P[10:20])
    assert np.isnan(told.off[10:20]).all()
    assert np.isnan(told.spread[10:20]).all()


def test_innovations_of_the_ukf_are_those_of_whole_rows():
    case = LinearCase()
    x, P, s, y = case.given()
    _, told = filtered(case.space, "ukf", x, P, s, y, case.p)
    for k in range(len(s)):
        S = case.H @ told.predicted_P[k] @ case.H.T + case.R
        there = np.isfinite(y[k])
        off = y[k] - case.H @ told.predicted[k] - [0.0, 0.3 * s[k, 1]]
        np.testing.assert_allclose(told.off[k, there], off[there], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(told.spread[k, there], np.diag(S)[there], rtol=1e-9)


@pytest.mark.parametrize("points", [SigmaPoints(), SigmaPoints(0.5, 2.0, 1.0)])
def test_the_ukf_is_filterpy_s(points):
    space, p = driven_space()
    x, P, s, y = driving(space, p, missing=0.0)
    n, m = space.size, y.shape[1]

    def numbers(function, *arguments):
        return np.asarray(function(*arguments)).ravel()

    step, read = (cs.Function("f", f.sx_in(), [f(*f.sx_in())[0]]) for f in (space.step, space.output))
    other = UnscentedKalmanFilter(
        n, m, 1.0, lambda x, s: numbers(read, x, s, p), lambda x, dt, s: numbers(step, x, s, p),
        MerweScaledSigmaPoints(n, points.alpha, points.beta, points.kappa),
    )  # fmt: skip
    other.x, other.P = x[0].copy(), P[0].copy()
    other.sigmas_f = other.points_fn.sigma_points(other.x, other.P)
    other.R = np.diag(numbers(cs.Function("R", space.output.sx_in(), [space.output(*space.output.sx_in())[1]]), x[0],
                              s[0], p))  # fmt: skip
    other.Q = np.diag(np.asarray(space.step(x[0], s[0], p)[1]).ravel())
    expected = []
    for k in range(len(s)):
        if k:
            other.predict(s=s[k - 1])
        other.update(y[k], s=s[k])
        expected.append((other.x.copy(), other.P.copy()))
    _, told = filtered(space, "ukf", x, P, s, y, p, points=points)
    assert_close(told.filtered, np.array([own for own, _ in expected]), 1e-10)
    assert_close(told.filtered_P, np.array([own for _, own in expected]), 1e-10)


@both_kinds
@pytest.mark.parametrize(("case", "gate"), [(RICH, 5.0), (RICH, NEVER), (ACTUATED, 5.0)])
def test_compiled_and_plain_are_the_same(kind, case, gate):
    space, p = driven_space(**case)
    given = driving(space, p, rows=50, glitches=3)
    (cost, told), (expected_cost, expected) = (
        filtered(space, kind, *given, p, gate, compiled=compiled) for compiled in (True, False)
    )
    assert cost == pytest.approx(expected_cost, rel=1e-10)
    for name in vars(expected):
        assert_close(getattr(told, name), getattr(expected, name), 1e-10)


@both_kinds
def test_what_is_kept_of_the_history_changes_no_estimate(kind):
    space, p = driven_space(**RICH)
    given = driving(space, p)
    whole = filtered(space, kind, *given, p, 5.0)
    part = filtered(space, kind, *given, p, 5.0, kept="filtered")
    nothing = filtered(space, kind, *given, p, 5.0, kept="nothing")
    assert whole[0] == part[0] == nothing[0]
    assert nothing[1] is None
    assert part[1].predicted.shape == (0, space.size)
    for name in ("filtered", "filtered_P", "off", "spread"):
        np.testing.assert_array_equal(getattr(part[1], name), getattr(whole[1], name))


@both_kinds
@pytest.mark.parametrize("lanes", [2, 11])
def test_filters_side_by_side_know_nothing_of_each_other(kind, lanes):
    space, p = driven_space()
    x, P, s, y = driving(space, p, rows=60)
    several = p * np.random.default_rng(0).uniform(0.9, 1.1, (lanes, len(p)))
    made = CompiledFilter(space, kind, SigmaPoints())
    together_x, together_P = np.repeat(x, lanes, 0), np.repeat(P, lanes, 0)
    costs, told = made.run(together_x, together_P, s, y, several, 5.0, "filtered")
    for lane, own in enumerate(several):
        alone_x, alone_P = x.copy(), P.copy()
        cost, history = made.run(alone_x, alone_P, s, y, own[None], 5.0, "filtered")
        assert costs[lane] == cost[0]
        np.testing.assert_array_equal(together_x[lane], alone_x[0])
        np.testing.assert_array_equal(together_P[lane], alone_P[0])
        if lane == 0:
            np.testing.assert_array_equal(told.filtered, history.filtered)


@both_kinds
def test_a_run_in_two_parts_ends_where_a_whole_one_does(kind):
    """The last segment is not gone through: the second part begins with it, its readings taken."""
    space, p = driven_space()
    x, P, s, y = driving(space, p, rows=80)
    made = CompiledFilter(space, kind, SigmaPoints())
    whole_x, whole_P, part_x, part_P = x.copy(), P.copy(), x.copy(), P.copy()
    made.run(whole_x, whole_P, s, y, p[None], 5.0, "nothing")
    made.run(part_x, part_P, s[:41], y[:41], p[None], 5.0, "nothing")
    later = y[40:].copy()
    later[0] = np.nan
    made.run(part_x, part_P, s[40:], later, p[None], 5.0, "nothing")
    np.testing.assert_allclose(part_x, whole_x, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(part_P, whole_P, rtol=1e-12, atol=1e-14)


@both_kinds
def test_a_glitch_moves_the_estimate_no_further_than_to_the_gate(kind):
    """A reading 50 standard deviations off weighs as one at the gate that is ten times as noisy."""
    case, gate = LinearCase(), 5.0
    x, P, s, y = case.given(missing=0.0)
    y[30, 1] = np.nan
    _, without = filtered(case.space, kind, x, P, s, y, case.p, gate)
    at = case.H[1] @ without.filtered[30] + 0.3 * s[30, 1]
    S = float(case.H[1] @ without.filtered_P[30] @ case.H[1] + case.R[1, 1])
    far = y.copy()
    far[30, 1] = at + 50 * np.sqrt(S)
    _, told = filtered(case.space, kind, x, P, s, far, case.p, gate)
    moved = told.filtered[30] - without.filtered[30]
    fully = without.filtered_P[30] @ case.H[1] / S * 50 * np.sqrt(S)
    assert np.all(np.abs(moved) < 0.5 * np.sqrt(np.diagonal(without.filtered_P[30])))
    np.testing.assert_allclose(moved, fully / 100, rtol=1e-6 if kind == "ekf" else 0.2)


@both_kinds
def test_a_filter_that_starts_far_off_finds_its_way_back(kind):
    """Its first readings all lie far beyond the gate."""
    space, p = driven_space(parameters=())
    x, P, s, y = driving(space, p, rows=400, missing=0.0)
    _, right = filtered(space, kind, x, P, s, y, p, 5.0)
    x[0, :3] += [3.0, 2.0, 0.8]
    P[0, :3, :3] = np.diag([1e-4, 1e-4, 1e-6])
    _, told = filtered(space, kind, x, P, s, y, p, 5.0)
    assert np.abs(told.off[0, 2]) > 50 * np.sqrt(told.spread[0, 2])
    sd = np.sqrt(np.diagonal(right.filtered_P[-1]))
    assert np.all(np.abs(told.filtered[-1] - right.filtered[-1]) < 0.1 * sd)


@both_kinds
@settings(max_examples=12)
@given(
    walks=st.lists(st.floats(-7, 0), min_size=5, max_size=5),
    noises=st.lists(st.floats(-5, 1), min_size=5, max_size=5),
    seed=st.integers(0, 1000),
)
def test_covariances_stay_symmetric_and_positive(kind, walks, noises, seed):
    """Over 2000 rows, at sizes of noise from a ten millionth to ten."""
    space, p = driven_space()
    begin = space.model.size
    p = p.copy()
    p[begin:] = 10.0 ** np.array([*walks, *noises])
    x, P, s, _ = driving(space, p, rows=2, missing=0.0)
    random = np.random.default_rng(seed)
    s = np.repeat(s[:1], 2000, axis=0)
    s[:, 1] = 0.03 * np.sin(0.05 * np.arange(2000))
    y = np.array([20.0, 0, 0, 0, 0]) + random.standard_normal((2000, 5)) * [0.1, 0.1, 0.05, 0.5, 0.5]
    _, told = filtered(space, kind, x, P, s, y, p, 5.0, kept="filtered")
    assert np.all(np.isfinite(told.filtered))
    P = told.filtered_P
    scale = np.sqrt(np.einsum("kii->ki", P))
    assert np.all(scale > 0)
    scaled = P / (scale[:, :, None] * scale[:, None, :])
    assert np.max(np.abs(scaled - scaled.swapaxes(1, 2))) < 1e-9
    assert np.min(np.linalg.eigvalsh(scaled)) > -1e-9


@both_kinds
def test_shapes_that_do_not_go_together_are_refused(kind):
    space, p = driven_space()
    x, P, s, y = driving(space, p, rows=5)
    made = CompiledFilter(space, kind, SigmaPoints())
    for wrong in [(x[:, :4], P, s, y, p[None]), (x, P, s[:, :3], y, p[None]), (x, P, s, y[:, :2], p[None]),
                  (x, P, s, y, p[None, :-1]), (x, P[:, :3], s, y, p[None])]:  # fmt: skip
        with pytest.raises(ValueError, match="do not match"):
            made.run(*wrong, 5.0, "nothing")
    with pytest.raises(ValueError, match="contiguous"):
        made.run(x, P, s[:, ::-1], y, p[None], 5.0, "nothing")
