"""Refits: magnitudes beside what is believed."""

from dataclasses import replace

import numpy as np
import pytest
from gap_cases import (
    NOISE,
    GivenBench,
    alone,
    axis,
    candidate,
    lap,
    linear_bench,
    nominal,
    search_on,
    smooth_columns,
    weighted,
)

from greybox_id.gap.estimation import refit as module
from greybox_id.gap.estimation.axes import Candidate, candidates, shifting
from greybox_id.gap.estimation.bench import Bench
from greybox_id.gap.estimation.calibration import CAL
from greybox_id.gap.estimation.hypothesis import Start
from greybox_id.gap.estimation.refit import refit, settled, with_slopes
from greybox_id.models.effects import EFFECTS

SD = np.array([0.1, 0.4])


def test_magnitudes_are_recovered_beside_tolerances():
    X = smooth_columns(4)
    truth = [0.1, -0.05, 0.7, -1.3]
    bench = linear_bench(X, truth, SD)
    search = search_on(bench, SD, [axis(0, sd=0.2), axis(1, sd=0.1)])
    base = search.at_means()
    (found,) = refit(search, [Start((candidate(2), candidate(3)), np.zeros(2), base.theta, base.linear)])
    W, y = weighted(bench, range(4), SD)
    information = W.T @ W + np.diag([1 / 0.2**2, 1 / 0.1**2, 0, 0])
    expected = np.linalg.solve(information, W.T @ y)
    np.testing.assert_allclose(found.theta, expected[:2], atol=1e-6)
    np.testing.assert_allclose(found.m, expected[2:], atol=1e-6)
    np.testing.assert_allclose(found.m, truth[2:], atol=0.05)
    np.testing.assert_allclose(search.covariance(found), np.linalg.inv(information)[2:, 2:], rtol=1e-6)
    assert found.names == ("effect_2", "effect_3")
    assert search.vector(found)[2:4] == pytest.approx(found.m)
    assert search.charge(found) == pytest.approx(np.sum((found.theta / [0.2, 0.1]) ** 2))


def test_a_magnitude_that_acts_nonlinearly_is_recovered():
    X = smooth_columns(2)
    bench = GivenBench(lambda p: np.tanh(X[:, :, 0] * (1 + p[0])) + p[1] * X[:, :, 1], np.zeros((400, 2)), 2)
    bench.measured = bench.respond(np.array([0.8, 0.2])) + SD * np.random.default_rng(0).standard_normal((400, 2))
    search = search_on(bench, SD, [axis(1, sd=0.5)])
    (found,) = refit(search, [alone(search, candidate(0))])
    sd = float(np.sqrt(search.covariance(found)[0, 0]))
    assert abs(found.m[0] - 0.8) < 3 * sd
    assert sd < 0.1
    assert found.cost == pytest.approx(bench.measured.size / 2, rel=0.15)


def test_hypotheses_are_refitted_side_by_side_as_one_at_a_time():
    bench = linear_bench(smooth_columns(4), [0.1, 0.0, 0.7, 0.0], SD)
    search = search_on(bench, SD, [axis(0, sd=0.2)])
    starts = [alone(search, candidate(k)) for k in (1, 2, 3)]
    together = refit(search, starts)
    for found, start in zip(together, starts, strict=True):
        (again,) = refit(search, [start])
        assert found.names == again.names
        np.testing.assert_allclose([found.cost, *found.m], [again.cost, *again.m], rtol=1e-12)
    assert min(together, key=lambda own: own.cost).names == ("effect_2",)


def test_a_magnitude_stops_at_its_bound():
    bench = linear_bench(smooth_columns(1), [-0.5], SD)
    search = search_on(bench, SD)
    (found,) = refit(search, [alone(search, candidate(0, low=0.0), 0.4)])
    assert found.m[0] == pytest.approx(0.0, abs=1e-12)


def test_what_is_not_finite_is_left_out_and_a_step_there_is_shortened():
    X = smooth_columns(1)

    def respond(p):
        return X[:, :, 0] * np.exp(p[0]) if p[0] < 1.5 else np.full((400, 2), np.nan)

    bench = GivenBench(respond, respond(np.array([1.0])), 1)
    search = search_on(bench, SD)
    assert refit(search, [alone(search, candidate(0), 2.0)]) == []
    (found,) = refit(search, [alone(search, candidate(0), -0.5)])  # its first step leads to 2.98
    assert found.m[0] == pytest.approx(1.0, abs=1e-3)


def test_a_step_to_where_motion_spins_is_shortened_and_not_the_last():
    X = smooth_columns(1)

    def respond(p):
        return X[:, :, 0] * (0.05 * p[0] + p[0] ** 5)

    bench = GivenBench(respond, respond(np.array([1.0])), 1)
    search = search_on(bench, SD)
    (found,) = refit(search, [alone(search, candidate(0), 0.0)])  # its first step leads to 21, 4 million off
    assert found.m[0] == pytest.approx(1.0, abs=1e-3)


def test_a_magnitude_that_is_held_needs_no_derivative():
    X = smooth_columns(1)

    def respond(p):
        return X[:, :, 0] * p[0] if p[0] <= 1.5 else np.full((400, 2), np.nan)

    bench = GivenBench(respond, respond(np.array([1.4])), 1)
    search = search_on(bench, SD)
    assert refit(search, [alone(search, candidate(0), 1.5)]) == []  # spins beside where it stands
    (found,) = refit(search, [alone(search, candidate(0, low=1.5, high=1.5), 1.5)])
    assert found.m[0] == 1.5
    assert np.isfinite(found.cost)


def test_a_poor_start_is_drawn_back_towards_where_it_came_from():
    X = smooth_columns(1)

    def respond(p):
        return np.sin(3 * X[:, :, 0] * p[0])

    bench = GivenBench(respond, np.zeros((400, 2)), 1)
    bench.measured = respond(np.array([0.3])) + SD * np.random.default_rng(0).standard_normal((400, 2))
    search = search_on(bench, SD)
    (base,) = refit(search, [search.start_of(search.at_means())])
    own, far = candidate(0), np.array([2.5])
    (found,) = refit(search, [Start((own,), far, base.theta, base.linear, (base, np.zeros(1)))])
    assert found.cost < base.cost
    assert found.m[0] == pytest.approx(0.3, abs=0.02)


def test_simulations_are_counted():
    search = search_on(linear_bench(smooth_columns(1), [0.5], SD), SD)
    before = search.simulations
    refit(search, [alone(search, candidate(0))])
    assert 4 <= search.simulations - before <= 6  # two a step: where it stands, and beside it


@pytest.mark.parametrize(
    "start",
    [
        0.03, 0.0599, 0.0601,
        0.06,
    ],
)  # fmt: skip
def test_a_delay_is_found_from_either_side_of_a_row_and_from_on_it(monkeypatch, start):
    monkeypatch.setenv("GREYBOX_COMPILE", "0")
    model = nominal(effects={"steering_delay": None})
    drive = lap({"steering_delay": 0.05}, seconds=8.0)  # read every 0.02 s
    own = candidates(model, {"steering_delay": EFFECTS["steering_delay"]}, shifting(model))
    search = search_on(Bench(model, [drive]), np.array([NOISE[name] for name in model.outputs]))
    (found,) = refit(search, [alone(search, own[0], start)])
    assert found.m[0] == pytest.approx(0.05, abs=0.002)


def test_a_delay_that_is_best_within_a_row_is_tried_beyond_it_too():
    X, dt = smooth_columns(2), 0.015
    w = X / SD[:, None]
    X[:, :, 1] -= (
        X[:, :, 0] * np.sum(w[:, :, 0] * w[:, :, 1]) / np.sum(w[:, :, 0] ** 2)
    )  # no delay does what a jump does

    def respond(p):
        rows = p[0] / dt
        return X @ np.array([rows, 0.0] if rows <= 1 else [rows - 0.18, 1.0])  # readings jump where it crosses a row

    bench = GivenBench(respond, respond(np.array([1.12 * dt])), 1, dt)
    own = axis(0, low=0.0, high=0.5, scale=0.03, shift=True)
    search = search_on(bench, SD)
    (found,) = refit(search, [alone(search, Candidate("delay", (own,), gradual=False), 0.0138)])
    assert found.m[0] == pytest.approx(1.12 * dt, abs=1e-5)
    (without,) = refit(search, [alone(search, Candidate("delay", (own,), gradual=False), 0.0138)], settle_on_rows=False)
    assert without.m[0] < dt


def counted(search, *starts):
    """Hypotheses, and how many simulations these took."""
    before = search.simulations
    found = refit(search, starts)
    return found, search.simulations - before


def of_two_runs(respond, measured, size):
    """A bench whose calls have no room: simulations of it are all the same work."""
    return GivenBench(respond, measured, size, lengths=[200, 200])


def test_derivatives_are_kept_while_they_foretell_what_steps_gain():
    X, noise = smooth_columns(2), SD * np.random.default_rng(0).standard_normal((400, 2))
    truth = np.array([0.19, -0.15])  # near the start, over the scale of the axes
    own = (candidate(0), candidate(1))
    straight = search_on(of_two_runs(lambda p: X @ p, X @ truth + noise, 2), SD)
    base = straight.at_means()
    (found,), count = counted(straight, Start(own, np.zeros(2), base.theta, base.linear))
    assert found.m == pytest.approx(truth, abs=0.05)
    assert count == 4  # there and beside it by either magnitude, and where that leads

    def bent(p):
        return X @ np.sinh(20 * p)

    curved = search_on(of_two_runs(bent, bent(truth) + noise, 2), SD)
    (found,), count = counted(curved, Start(own, np.array([0.1, -0.1]), base.theta, base.linear))
    assert found.m == pytest.approx(truth, abs=0.01)
    assert count > 8
    ahead = np.array([1e-6, 0.0])
    exact = (bent(found.m + ahead) - bent(found.m - ahead)) / 2e-6
    np.testing.assert_allclose(found.J[:, :, 0], exact, rtol=0.25, atol=0.01 * np.max(np.abs(exact)))


def test_a_refit_from_a_hypothesis_needs_no_derivative():
    X = smooth_columns(2)
    search = search_on(of_two_runs(lambda p: X @ p, X @ [0.19, -0.15], 2), SD)
    base = search.at_means()
    (found,), _ = counted(search, Start((candidate(0), candidate(1)), np.zeros(2), base.theta, base.linear))
    (again,), count = counted(search, search.start_of(found))
    assert count == 1
    assert again.m == pytest.approx(found.m)
    first = found.only({"effect_0"})
    (wider,), count = counted(
        search,
        Start((*first.candidates, candidate(1)), np.append(first.m, 0.0), base.theta, base.linear, None, first.J),
    )
    assert count == 3  # there, beside it by the new one, and where that leads
    assert wider.m == pytest.approx(found.m, abs=1e-6)


def test_a_refused_step_leaves_what_is_known_of_derivatives():
    X = smooth_columns(1)

    def respond(p):
        return X[:, :, 0] * (0.05 * p[0] + p[0] ** 5)

    own = Candidate("delay", (axis(0, scale=1.0, shift=True),), gradual=False)  # looked beside everywhere
    search = search_on(of_two_runs(respond, respond(np.array([1.0])), 1), SD)
    seen = []
    plain, search.residuals = search.residuals, lambda P: (seen.extend(float(p[0]) for p in P), plain(P))[1]
    refit(search, [alone(search, own, 0.4)], settle_on_rows=False)
    assert len(seen) == len(set(seen))  # nothing is asked for again that was known


def test_derivatives_are_taken_anew_where_hypotheses_ended():
    X = smooth_columns(1)

    def bent(p):
        return X[:, :, 0] * np.sinh(20 * p[0])

    search = search_on(of_two_runs(bent, bent(np.array([0.19])), 1), SD)
    (found,) = refit(search, [alone(search, candidate(0), 0.15)])
    (stale,) = with_slopes(search, [replace(found, J=0.5 * found.J)])
    np.testing.assert_allclose(stale.J[:, :, 0], 20 * X[:, :, 0] * np.cosh(20 * found.m[0]), rtol=0.02)
    assert stale.cost == found.cost


def test_new_derivatives_that_lead_astray_are_not_kept(monkeypatch):
    X = np.random.default_rng(0).standard_normal((200, 1, 1))
    search = search_on(GivenBench(lambda p: X @ p, X[:, :, 0], 1), np.array([0.1]), [axis(0, sd=1.0)])
    (first,) = refit(search, [search.start_of(search.at_means())])
    before = search.white
    monkeypatch.setattr(module, "refit", lambda *_: [replace(first, cost=first.cost + 2 * CAL.enough)])
    assert settled(search, first) is first
    assert search.white is before
