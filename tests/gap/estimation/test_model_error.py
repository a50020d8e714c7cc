"""Model error in the likelihood: the filter whitens what it says it whitens, and finds amplitudes that are there."""

import numpy as np
import pytest
from gap_cases import NOISE, lap, nominal
from scipy.linalg import block_diag
from scipy.optimize import minimize

from greybox_id.gap.estimation import error_filter
from greybox_id.gap.estimation.bench import Bench
from greybox_id.gap.estimation.model_error import (
    Amplitudes,
    ForceSizes,
    amplitude_prior,
    estimated,
    linearised,
    model_error,
    negative_log_likelihood,
    sizes_of,
    tuned_on,
)
from greybox_id.gap.estimation.preparing import prepare_plain
from greybox_id.models.effects import EFFECTS
from greybox_id.models.vehicle import StatedModelError

SD = np.array([NOISE[name] for name in ("v_x", "v_y", "yaw_rate", "a_x", "a_y")])


@pytest.fixture(scope="module")
def bench():
    own = [lap(seconds=6.0, seed=k) for k in range(2)]
    prepared = prepare_plain(nominal(), own, EFFECTS, None)
    return Bench(prepared.everything, prepared.seen(own))


@pytest.fixture(scope="module")
def about(bench):
    bench.loose = ()
    return linearised(bench, bench.model.values, SD, ForceSizes(bench))


def amplitudes(**changes):
    own = {
        "share_y": 0.05, "share_x": 0.05, "floor_y": 0.02, "floor_x": 0.02, "memory_y": 0.3, "memory_x": 0.3,
        "noise": SD, "colour": 0.5 * SD, "memory": 0.2,
    }  # fmt: skip
    return Amplitudes(**{**own, **changes})


def covariance(about, own, rows):
    """Of the first readings, by brute force: the errors of the linearised equations as one large Gaussian vector."""
    n, nd = about.A.shape[1:2] + about.B.shape[2:]
    channels = np.arange(len(own.noise))
    nc = len(channels)
    half = np.array([own.floor_y / 2, own.floor_y / 2, own.floor_x]) * about.mass
    share = np.array([own.share_y, own.share_y, own.share_x])
    P = block_diag(np.diag(about.start), np.eye(nd), np.diag(own.colour**2))
    path, H = np.eye(n + nd + nc), []
    sources, variances = [np.linalg.cholesky(P + 1e-300 * np.eye(len(P)))], []
    read = []
    for k in range(rows):
        scale = np.hypot(half, share * about.force[k])
        for i in range(about.pointer[k], about.pointer[k + 1]):
            c = about.channel[i]
            h = np.concatenate([about.C[k, c], about.D[k, c] * scale, channels == c])
            read.append([h @ own_source for own_source in sources])
            variances.append(own.noise[c] ** 2)
        fade = np.exp(-about.length[k] / np.array([own.memory_y, own.memory_y, own.memory_x]))
        slow = np.exp(-about.length[k] / own.memory)
        F = np.zeros_like(path)
        F[:n, :n], F[:n, n : n + nd] = about.A[k], about.B[k] * scale
        F[n:, n:] = np.diag([*fade, *[slow] * nc])
        sources = [F @ each for each in sources]
        fresh = np.diag([*[0.0] * n, *np.sqrt(1 - fade**2), *(own.colour * np.sqrt(1 - slow**2))])
        sources.append(fresh)
        H.append(len(read))
    width = len(sources)
    full = np.zeros((len(read), width * (n + nd + nc)))
    for i, each in enumerate(read):
        for j, part in enumerate(each):
            full[i, j * (n + nd + nc) : (j + 1) * (n + nd + nc)] = part
    return full @ full.T + np.diag(variances)


def test_innovations_are_those_of_the_covariance_by_brute_force(bench, about):
    own = amplitudes()
    filter_ = model_error(about, own, bench.counted)
    rows = 30
    count = int(filter_.about.pointer[rows])
    S = covariance(filter_.about, own, rows)
    rng = np.random.default_rng(0)
    values = rng.standard_normal((*bench.measured.shape, 2))
    white = filter_.white(values)
    order = filter_.about.row[:count], filter_.about.channel[:count]
    expected = np.linalg.solve(np.linalg.cholesky(S), values[order])
    np.testing.assert_allclose(white[order], expected, rtol=1e-6, atol=1e-8)
    assert np.all(white[~bench.counted] == 0)


def drawn(about, own, shape, seed):
    """Residuals of these amplitudes."""
    rng = np.random.default_rng(seed)
    nd = about.B.shape[2]
    half = np.array([own.floor_y / 2, own.floor_y / 2, own.floor_x]) * about.mass
    share, memory = (np.array([a, a, b]) for a, b in ((own.share_y, own.share_x), (own.memory_y, own.memory_x)))
    e = np.zeros(shape)
    for k in range(len(about.first)):
        if about.first[k]:
            z, xi = np.sqrt(about.start) * rng.standard_normal(len(about.start)), rng.standard_normal(nd)
            slow = own.colour * rng.standard_normal(len(own.colour))
        force = np.hypot(half, share * about.force[k]) * xi
        for i in range(about.pointer[k], about.pointer[k + 1]):
            c = about.channel[i]
            white = own.noise[c] * rng.standard_normal()
            e[about.row[i], c] = about.C[k, c] @ z + about.D[k, c] @ force + slow[c] + white
        z = about.A[k] @ z + about.B[k] @ force
        fade, faded = np.exp(-about.length[k] / memory), np.exp(-about.length[k] / own.memory)
        xi = fade * xi + np.sqrt(1 - fade**2) * rng.standard_normal(nd)
        slow = faded * slow + own.colour * np.sqrt(1 - faded**2) * rng.standard_normal(len(slow))
    return e


def test_residuals_of_these_amplitudes_are_white_under_them(bench, about):
    own = amplitudes()
    filter_ = model_error(about, own, bench.counted)
    white = filter_.white(drawn(filter_.about, own, bench.measured.shape, 3))[bench.counted]
    assert np.mean(white**2) == pytest.approx(1.0, abs=0.08)
    assert filter_.readings == np.count_nonzero(bench.counted)


def test_amplitudes_are_found_again(bench, about):
    own = amplitudes()
    e = drawn(about, own, bench.measured.shape, 5)
    found = estimated(about, e, bench.counted, amplitude_prior(SD, noise_stated=True, exact=False, stated={}))
    assert found.share_y == pytest.approx(own.share_y, rel=0.4)
    assert found.memory_y == pytest.approx(own.memory_y, rel=0.7)
    np.testing.assert_allclose(found.noise, SD, rtol=0.1)


@pytest.mark.parametrize("exact", [False, True], ids=["tolerances", "exact"])
def test_no_other_amplitudes_nearby_are_more_probable(bench, about, exact):
    """Where numbers are stated as exact, these errors are tens of times their usual size."""
    e = drawn(about, amplitudes(), bench.measured.shape, 7)
    prior = amplitude_prior(SD, noise_stated=True, exact=exact, stated={})
    kept = tuned_on(about, bench.counted)
    r = e[kept.row, kept.channel]

    def cost(x):
        return float(negative_log_likelihood(kept, [Amplitudes.of(x)], r)[0] + prior.cost(x))

    found = estimated(about, e, bench.counted, prior).logarithms
    bounds = [(m - 4 * sd, m + 4 * sd) for m, sd in zip(prior.median.logarithms, prior.sd, strict=True)]
    better = minimize(cost, found, method="L-BFGS-B", bounds=bounds, options={"maxiter": 100})
    assert cost(found) - better.fun < 0.05
    far = minimize(cost, prior.median.logarithms, method="L-BFGS-B", bounds=bounds, options={"maxiter": 300})
    assert cost(found) < far.fun + 0.05


def test_information_is_the_mean_curvature_of_the_likelihood(bench, about):
    own, kept = amplitudes(), tuned_on(about, bench.counted)
    at, step = own.logarithms, 1e-3
    directions = np.eye(len(at))[[0, 4, 6, 9]]
    lanes = [Amplitudes.of(x) for x in (at, *(at + step * d for d in directions))]
    here = [Amplitudes.of(at + step * s * d) for d in directions for s in (1.0, -1.0)]
    fisher, curvature = np.zeros((5, 5)), np.zeros(4)
    for seed in range(12):
        e = drawn(kept, own, bench.measured.shape, 100 + seed)
        r = e[kept.row, kept.channel]
        nll = negative_log_likelihood(kept, lanes, r, fisher=fisher)
        each = negative_log_likelihood(kept, here, r).reshape(4, 2)
        curvature += (np.sum(each, axis=1) - 2 * nll[0]) / step**2
    np.testing.assert_allclose(np.diag(fisher)[1:] / step**2, curvature, rtol=0.25)


def test_c_and_numba_give_the_same_numbers(bench, about, monkeypatch):
    kept, values = tuned_on(about, bench.counted), np.random.default_rng(5).normal(size=(*bench.measured.shape, 13))
    lanes = [amplitudes(), *(amplitudes(memory_y=0.1 * k) for k in range(1, 11))]

    def numbers():
        fisher = np.zeros((len(lanes), len(lanes)))
        nll = negative_log_likelihood(kept, lanes, values[kept.row, kept.channel, 0].copy(), fisher=fisher)
        filter_ = model_error(about, lanes[0], bench.counted)
        return nll, fisher, filter_.gain, filter_.size, filter_.white(values)

    in_c = numbers()
    monkeypatch.setattr(error_filter, "_library", lambda: None)
    for one, other in zip(in_c, numbers(), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * np.max(np.abs(other)))


def test_a_size_counts_all_of_an_unknown_force_and_what_the_file_states_of_it(about):
    own = amplitudes(share_y=0.08, share_x=0.01)
    usual, stated = (
        amplitude_prior(SD, noise_stated=True, exact=False, stated=known).median
        for known in ({}, {"F_y": StatedModelError(share=0.08)})
    )
    (lateral, longitudinal), more = sizes_of(about, own, usual)
    modelled = np.sqrt(np.sum(np.mean(about.force[:, :2] ** 2, axis=0)))
    floor = np.sqrt(2) * own.floor_y / 2 * about.mass
    assert lateral == pytest.approx(np.hypot(0.08, floor / modelled))
    assert longitudinal > 0.01
    assert more > 2.0
    assert sizes_of(about, own, stated)[1] < 0.6 * more
    (_, _), by_floor = sizes_of(about, amplitudes(share_y=1e-4, share_x=1e-4, floor_y=20 * usual.floor_y), usual)
    assert by_floor > 2.0


def test_where_every_number_is_exact_less_model_error_is_believed():
    loose, exact = (amplitude_prior(SD, True, own, {}).median for own in (False, True))
    assert exact.share_y == pytest.approx(0.1 * loose.share_y)
    assert np.all(exact.colour < loose.colour)


def test_stated_model_error_is_believed_in_place_of_any_vehicles():
    stated = {"F_y": StatedModelError(share=0.05, correlation_time=2.0)}
    usual, own = (amplitude_prior(SD, True, False, known) for known in ({}, stated))
    assert (own.median.share_y, own.median.memory_y) == (0.05, 2.0)
    assert (own.median.share_x, own.median.floor_y) == (usual.median.share_x, usual.median.floor_y)
    narrower = own.sd < usual.sd
    assert list(np.flatnonzero(narrower)) == [0, 4]


def test_amplitudes_are_their_logarithms():
    own = amplitudes()
    again = Amplitudes.of(own.logarithms)
    assert again.share_y == pytest.approx(own.share_y)
    assert again.memory == pytest.approx(own.memory)
    np.testing.assert_allclose(again.noise, own.noise)
    np.testing.assert_allclose(again.colour, own.colour)
