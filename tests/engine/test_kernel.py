"""The kernel: compiled and in CasADi's virtual machine the same numbers, right derivatives, compiled once."""

import ctypes
import errno
import hashlib
import itertools
import os
import re
import shutil
import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import casadi as cs
import numpy as np
import pytest
from compiled import needs_compiler
from numpy.lib.stride_tricks import sliding_window_view

from greybox_id.base import files
from greybox_id.engine import compiler, kernel, straight
from greybox_id.engine.compiler import CannotCompile, Compiler
from greybox_id.engine.graph import CALLS, CHEAP, KNOWN
from greybox_id.engine.kernel import Kernel
from greybox_id.engine.lane_targets import LaneTargets

BINARY = [cs.fmin, cs.fmax, cs.copysign, cs.SX.__pow__, cs.atan2, cs.hypot, cs.fmod, cs.remainder]
NAMES = {*CHEAP, *CALLS} - {"pow", *[function.__name__ for function in BINARY]}
UNARY = [getattr(cs, name) for name in sorted(NAMES)]


both_ways = pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=needs_compiler)])


@pytest.fixture(scope="module")
def libraries(tmp_path_factory):
    return tmp_path_factory.mktemp("libraries")


@pytest.fixture(autouse=True)
def _own_cache(libraries, monkeypatch):
    """The tests' own cache: one for all, so that each model is compiled once."""
    monkeypatch.setenv("GREYBOX_CACHE", str(libraries))
    monkeypatch.delenv("GREYBOX_COMPILE", raising=False)


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    folder = tmp_path / "cache"
    monkeypatch.setenv("GREYBOX_CACHE", str(folder))
    return folder


@pytest.fixture(scope="module")
def compiled_once(tmp_path_factory):
    """The cache of a process that compiled one kernel, and what this gave."""
    folder = tmp_path_factory.mktemp("once") / "cache"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GREYBOX_CACHE", str(folder))
        _, found = worked(compiled=True)
    return folder, found


@pytest.fixture
def filled_cache(compiled_once, empty_cache):
    """A cache with one library, as it was left by whoever compiled it."""
    shutil.copytree(compiled_once[0], empty_cache)
    return empty_cache


def kernels(cache):
    """Compiled libraries in a cache, and whatever else lies beside them."""
    return sorted((cache / "kernels").iterdir())


def functions(nz, ns, np_, step, output):
    arguments = [cs.SX.sym("z", nz), cs.SX.sym("s", ns), cs.SX.sym("p", np_)]
    return [cs.Function("f", arguments, [f(*arguments)]) for f in (step, output)]


def single_track():
    """v_x, v_y, yaw_rate; steer and force at a segment's start and end, duration; a limit of the steer angle."""

    def rate(z, steer, force, p):
        m, I_z, l_f, l_r, B, C, D, E, limit = cs.vertsplit(p)
        v_x, v_y, r = cs.vertsplit(z)
        delta = cs.fmax(-limit, cs.fmin(limit, steer))

        def lateral(slip):
            return D * cs.sin(C * cs.atan(B * slip - E * (B * slip - cs.atan(B * slip))))

        F_f, F_r = lateral(delta - cs.atan2(v_y + l_f * r, v_x)), lateral(-cs.atan2(v_y - l_r * r, v_x))
        return cs.vertcat(
            (force - F_f * cs.sin(delta)) / m + v_y * r,
            (F_f * cs.cos(delta) + F_r) / m - v_x * r,
            (l_f * F_f * cs.cos(delta) - l_r * F_r) / I_z,
        )

    def step(z, s, p):
        middle = z + s[4] / 2 * rate(z, s[0], s[1], p)
        return z + s[4] * rate(middle, (s[0] + s[2]) / 2, (s[1] + s[3]) / 2, p)

    def output(z, s, p):
        return cs.vertcat(z[0], z[2], rate(z, s[0], s[1], p)[1] + z[0] * z[2])

    return functions(3, 5, 9, step, output)


def driven(lanes, segments, seed=0):
    """Arguments of the single track: z0, s, p, reads."""
    random = np.random.default_rng(seed)
    s = np.empty((lanes, segments, 5))
    s[:] = random.normal(0, 0.1, s.shape)
    s[:, :, 4] = 0.02
    z0 = random.normal([3, 0, 0], 0.2, (lanes, 3))
    p = np.array([3.5, 0.05, 0.16, 0.17, 8, 1.4, 14, 0.3, 0.4]) * random.uniform(0.9, 1.1, (lanes, 1))
    return z0, s, p, random.random(segments) < 0.5


def assert_same(found, expected):
    """The same numbers, each compared with the largest of its kind: one that digits cancel in has fewer."""
    for a, b in zip(found, expected, strict=True):
        assert a.shape == b.shape
        scale = np.abs(b).max(axis=(0, 1) if b.ndim > 2 else 0, keepdims=True, initial=1e-9)
        np.testing.assert_allclose(a / scale, b / scale, rtol=1e-12, atol=1e-12)


@needs_compiler
@pytest.mark.parametrize("lanes", [1, 4, 7, 9, 12, 200])
def test_compiled_and_virtual_machine_agree(lanes):
    model, columns = single_track(), [7, 0, 3, 8]
    *given, reads = driven(lanes, 30)
    found, expected = (Kernel(*model, compiled=compiled) for compiled in (True, False))
    assert_same(found.simulate(*given, reads), expected.simulate(*given, reads))
    assert_same(found.linearise(*given, reads, columns), expected.linearise(*given, reads, columns))
    assert (found.compiled, expected.compiled) == (True, False)


def every_operation():
    """One output per operation, of the two states; the states stay what they are."""

    def output(z, s, p):
        a, b = z[0], z[1]
        logic = [a < b, a <= b, a == b, a != b, cs.logic_not(a), cs.logic_and(a, b), cs.logic_or(a, b)]
        logic += [cs.logic_and(a < b, b), cs.logic_not(a <= p[0]), cs.if_else(a < b, a, b), cs.if_else(a, b, p[0])]
        plain = [a + b, a - b, a * b, a / b, b / p[0], -a, a**2, 2 * a, 1 / a, a**2.5, p[0] ** a, cs.DM(1.5) * a]
        fixed = [cs.if_else(p[0] < 1, a, b), cs.sin(p[0]) * a, cs.if_else(a < 0, np.inf, np.nan)]
        binary = [f(a, b) for f in BINARY]
        return cs.vertcat(*plain, *logic, *fixed, *[f(a) for f in UNARY], *binary)

    return functions(2, 0, 1, lambda z, s, p: 1 * z, output)


def test_every_operation_that_is_known_is_tested():
    step, output = every_operation()
    tested = {f.instruction_id(k) for f in (step, output) for k in range(f.n_instructions())}
    rare = {cs.OP_ASSIGN, cs.OP_LIFT}  # simplified away by CasADi
    assert KNOWN - tested - rare == set()


@needs_compiler
def test_every_operation_is_casadis_also_at_infinity_nan_and_zero():
    values = [0.0, -0.0, 1.0, -1.0, 0.5, -0.3, 2.0, 7.5, -1e3, 1e6, np.inf, -np.inf, np.nan, 1e-200, 1e200]
    z0 = np.array([*itertools.product(values, values), *np.random.default_rng(0).normal(0, 2, (200, 2))])
    s, p, model = np.empty((len(z0), 1, 0)), np.array([0.7]), every_operation()
    found, expected = (Kernel(*model, compiled=compiled) for compiled in (True, False))
    (_, y), (_, y_expected) = (made.simulate(z0, s, p, [True]) for made in (found, expected))
    (*_, Y), (*_, Y_expected) = (made.linearise(z0, s, p, [True], [0]) for made in (found, expected))
    np.testing.assert_allclose(y, y_expected, rtol=1e-12, atol=0)
    np.testing.assert_allclose(Y, Y_expected, rtol=1e-12, atol=1e-15)  # 1 - tanh² cancels digits


def tangle(seed, size=150):
    """A random model: each operation on two random ones before it, kept in bounds."""

    def step(z, s, p):
        random = np.random.default_rng(seed)
        values = cs.vertsplit(cs.vertcat(z, s, p))
        operations = [
            lambda a, b: cs.tanh(a + b),
            lambda a, b: a * b / (1 + cs.fabs(a)),
            lambda a, b: cs.if_else(a < b, cs.sin(a), b),
            lambda a, b: cs.fmin(a, cs.fmax(-b, b / 2)),
            lambda a, b: cs.atan2(a, 1 + b**2),
            lambda a, b: cs.exp(-cs.fabs(a)) * b,
            lambda a, b: cs.if_else(cs.logic_and(a > 0, cs.logic_not(b > a)), b, a / 3),
        ]
        for _ in range(size):
            a, b = random.choice(len(values), 2, replace=False)
            values.append(operations[random.integers(len(operations))](values[a], values[b]))
        return cs.vertcat(*[0.5 * values[-k] for k in random.choice(np.arange(1, 40), z.numel(), replace=False)])

    return functions(6, 3, 12, step, lambda z, s, p: cs.vertcat(z[1] * p[3], cs.sin(z[2]), p[5], p[2] * s[0], 1.0))


@needs_compiler
@pytest.mark.parametrize(("seed", "piece"), [(0, 1000), (1, 25), (2, 25)])
def test_random_models_whole_and_in_pieces(seed, piece, monkeypatch):
    monkeypatch.setattr(straight, "PIECE", piece)
    random, model = np.random.default_rng(seed), tangle(seed)
    given = random.normal(size=(11, 6)), random.normal(size=(11, 20, 3)), random.normal(size=(11, 12))
    reads = np.arange(20) % 3 == 0
    found, expected = (Kernel(*model, compiled=compiled) for compiled in (True, False))
    assert_same(found.simulate(*given, reads), expected.simulate(*given, reads))
    for columns in ([], [5], [11, 3, 2], np.arange(12)):
        assert_same(found.linearise(*given, reads, columns), expected.linearise(*given, reads, columns))


@needs_compiler
@pytest.mark.parametrize("zero", [np.s_[:], np.s_[3:5]])
def test_a_parameter_that_is_zero_leaves_out_its_terms_and_changes_nothing(zero):
    model, (z0, s, p, reads) = single_track(), driven(12, 30)
    p[zero, 7] = 0.0
    found, expected = (Kernel(*model, compiled=compiled) for compiled in (True, False))
    assert_same(found.simulate(z0, s, p, reads), expected.simulate(z0, s, p, reads))
    for columns in ([0, 4, 6], [7, 0, 3, 8], np.arange(9)):
        assert_same(found.linearise(z0, s, p, reads, columns), expected.linearise(z0, s, p, reads, columns))
    for source in (found._model.sources[0], found._model.sources[1]):
        tested = set(re.findall(r"any_set\(p\[(\d+)\]\)", source))
        assert tested == {"7"}  # what the others multiply holds further parameters, or no slow function


@needs_compiler
def test_terms_of_a_parameter_that_is_zero_are_left_out_but_for_its_derivative():
    calls = functions(1, 1, 2, lambda z, s, p: z + p[0] * cs.atan(z * p[1]) + p[1], lambda z, s, p: z)
    made, given = Kernel(*calls, compiled=True), ([[np.inf]], np.zeros((1, 1, 1)), [0.0, 0.0], [True])
    assert made.simulate(*given)[0][0, -1] == np.inf  # 0 atan(inf 0) is never asked for
    given[0][0][0] = 2.0
    np.testing.assert_array_equal(made.linearise(*given, [0, 1])[1], [[[1.0, 0.0, 1.0]]])
    given[2][1] = 3.0
    np.testing.assert_allclose(made.linearise(*given, [0, 1])[1], [[[1.0, np.arctan(6.0), 1.0]]], rtol=1e-15)
    np.testing.assert_array_equal(made.linearise(*given, [1])[1], [[[1.0, 1.0]]])


@both_ways
def test_lanes_store_the_readings_that_they_take(compiled):
    made, columns = Kernel(*single_track(), compiled=compiled), [7, 0, 3]
    *given, reads = driven(300, 40)
    taken = np.random.default_rng(3).random((300, np.count_nonzero(reads))) < 0.4
    taken[:16] = True
    z, Z, y, Y = made.linearise(*given, reads, columns)
    few = made.linearise(*given, reads, columns, taken)
    for one, other in zip(few, (z, Z, y[taken], Y[taken]), strict=True):
        np.testing.assert_array_equal(one, other)


@both_ways
def test_sensitivities_are_those_of_finite_differences(compiled):
    made, columns, h = Kernel(*single_track(), compiled=compiled), [0, 4, 6, 8], 1e-6
    z0, s, p, reads = driven(3, 25)
    _, Z, _, Y = made.linearise(z0, s, p, reads, columns)
    for k in range(3 + len(columns)):
        ends, readings = [], []
        for sign in (1, -1):
            moved, parameters = z0.copy(), p.copy()
            (moved[:, k : k + 1] if k < 3 else parameters[:, columns[k - 3], None])[:] += sign * h
            z, y = made.simulate(moved, s, parameters, reads)
            ends.append(z[:, -1])
            readings.append(y)
        np.testing.assert_allclose(Z[:, :, k], (ends[0] - ends[1]) / (2 * h), rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(Y[:, :, :, k], (readings[0] - readings[1]) / (2 * h), rtol=1e-6, atol=1e-7)


@both_ways
@pytest.mark.parametrize("robust", [None, 0.7])
@pytest.mark.parametrize("lanes", [1, 8, 11])
def test_normal_equations_are_those_of_the_jacobian(lanes, robust, compiled):
    z0, s, p, reads = driven(lanes, 40)
    made, columns, random = Kernel(*single_track(), compiled=compiled), [0, 3, 8, 5], np.random.default_rng(3)
    _, _, y, Y = made.linearise(z0, s, p, reads, columns)
    weight = random.uniform(0.5, 2.0, y.shape) * (random.random(y.shape) < 0.8)
    against = LaneTargets(y + random.standard_normal(y.shape), weight, robust)
    seed, places = random.standard_normal((lanes, z0.shape[1], 6)), [5, 0, 3, 1]
    J = Y[..., : z0.shape[1]] @ seed[:, None]
    J[..., places] += Y[..., z0.shape[1] :]
    r = np.where(weight > 0, y - against.target, 0.0) * weight
    tail = np.ones_like(r) if robust is None else np.sqrt(np.minimum(1.0, robust / np.maximum(np.abs(r), 1e-300)))
    J, r = (J * (weight * tail)[..., None]).reshape(lanes, -1, 6), (r * tail).reshape(lanes, -1)
    Z, H, g = made.normal_equations(z0, s, p, reads, columns, seed, places, against)
    assert_same((H, g), (np.einsum("lrc,lrd->lcd", J, J), np.einsum("lrc,lr->lc", J, r)))
    others = random.standard_normal(y.shape)
    Z_again, nothing, g = made.normal_equations(z0, s, p, reads, columns, seed, places, against, others)
    assert_same((Z_again, g), (Z, np.einsum("lrc,lr->lc", J, others.reshape(lanes, -1))))
    assert nothing.size == 0
    assert against.misfit(y) == pytest.approx(huber(np.where(weight > 0, y - against.target, 0.0) * weight, robust))


@needs_compiler
@pytest.mark.parametrize("lanes", [16, 21, 40])
def test_two_threads_give_the_same_digits(lanes, monkeypatch):
    monkeypatch.setattr(kernel, "SHARED_FROM", 1)
    (*given, reads), made = driven(lanes, 30), Kernel(*single_track(), compiled=True)
    against = LaneTargets(*np.random.default_rng(1).random((2, lanes, int(np.sum(reads)), 3)))
    seed, found = np.tile(np.eye(3, 5), (lanes, 1, 1)), []
    for count in ("1", "2", "3"):
        monkeypatch.setenv("GREYBOX_THREADS", count)
        normal = made.normal_equations(*given, reads, [1, 4], seed, [3, 4], against)
        found.append([*made.simulate(*given, reads), *made.linearise(*given, reads, [7, 3]), *normal])
    for other in found[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(found[0], other, strict=True))


def huber(r, robust):
    size = np.abs(r)
    return (
        np.sum(r**2) / 2 if robust is None else np.sum(np.where(size <= robust, r**2 / 2, robust * (size - robust / 2)))
    )


def test_normal_equations_of_more_unknowns_than_are_added_up_at_once_are_the_same(monkeypatch):
    z0, s, p, reads = driven(3, 20)
    made, seed = Kernel(*single_track(), compiled=True), np.tile(np.eye(3, 5), (3, 1, 1))
    against = LaneTargets(np.zeros((3, int(np.sum(reads)), 3)), np.ones((3, int(np.sum(reads)), 3)))
    given = z0, s, p, reads, [1, 4], seed, [3, 4], against
    fused = made.normal_equations(*given)
    monkeypatch.setattr(kernel, "MOST_FUSED", 3)
    assert_same(fused, made.normal_equations(*given))
    with pytest.raises(ValueError, match="do not match"):
        made.normal_equations(*given[:-1], LaneTargets(against.target[:, 1:], against.weight[:, 1:]))


@both_ways
def test_lanes_know_nothing_of_each_other(compiled):
    made = Kernel(*single_track(), compiled=compiled)
    z0, s, p, reads = driven(9, 12)
    whole = made.linearise(z0, s, p, reads, [1, 2])
    for lane in range(9):
        own = slice(lane, lane + 1)
        alone = made.linearise(z0[own], s[own], p[own], reads, [1, 2])
        assert all(np.array_equal(a[own], b) for a, b in zip(whole, alone, strict=True))
    np.testing.assert_array_equal(made.simulate(z0, s, p, reads)[0][:, -1], whole[0])


@both_ways
def test_one_lane_blows_up_alone_and_an_infinite_limit_is_none(compiled):
    made = Kernel(*single_track(), compiled=compiled)
    z0, s, p, reads = driven(9, 12)
    p[:, 8] = np.inf
    fine = made.linearise(z0, s, p, reads, [0, 8])
    assert all(np.isfinite(a).all() for a in fine)
    assert not fine[1][:, :, -1].any()  # nothing depends on a limit that is not reached
    z0[4, 1] = np.nan
    broken = made.linearise(z0, s, p, reads, [0, 8])
    assert np.isnan(broken[0][4]).all()
    others = np.arange(9) != 4
    assert all(np.array_equal(a[others], b[others]) for a, b in zip(fine, broken, strict=True))


@both_ways
def test_blow_up_is_seen(compiled):
    squaring = functions(1, 1, 1, lambda z, s, p: z**2 - z, lambda z, s, p: z)
    z, y = Kernel(*squaring, compiled=compiled).simulate([[3.0], [1.5]], np.zeros((2, 12, 1)), [0.0], [True] * 12)
    assert not np.isfinite(z[0, -1]).any()
    assert not np.isfinite(y[0, -1]).any()
    assert np.isfinite(z[1]).all()


@both_ways
def test_shared_parameters_no_segments_no_readings_no_lanes(compiled):
    made = Kernel(*single_track(), compiled=compiled)
    z0, s, p, reads = driven(3, 6)
    shared, spelled = (made.simulate(z0, s, q, reads)[0] for q in (p[0], np.tile(p[0], (3, 1))))
    np.testing.assert_array_equal(shared, spelled)
    z, Z, y, Y = made.linearise(z0, s[:, :0], p, reads[:0], [3])
    np.testing.assert_array_equal(z, z0)
    np.testing.assert_array_equal(Z, np.tile(np.eye(3, 4), (3, 1, 1)))
    assert (y.shape, Y.shape) == ((3, 0, 3), (3, 0, 3, 4))
    assert made.simulate(z0[:0], s[:0], p[:0], reads)[1].shape == (0, reads.sum(), 3)


@both_ways
def test_states_are_kept_where_asked_and_numbers_may_be_shared(compiled):
    made = Kernel(*single_track(), compiled=compiled)
    z0, s, p, reads = driven(11, 12)
    shared = np.broadcast_to(s[:1], s.shape)
    z, y = made.simulate(z0, s[:1].repeat(11, axis=0), p, reads)
    keeps = np.arange(13) % 5 == 2
    kept, read = made.simulate(z0, shared, p, reads, keeps)
    np.testing.assert_array_equal(kept, z[:, keeps])
    np.testing.assert_array_equal(read, y)
    np.testing.assert_array_equal(
        made.linearise(z0, shared, p, reads, [3])[3], made.linearise(z0, shared.copy(), p, reads, [3])[3]
    )
    with pytest.raises(ValueError, match="keeps"):
        made.simulate(z0, s, p, reads, keeps[1:])


@both_ways
def test_numbers_of_lanes_may_overlap(compiled):
    made = Kernel(*single_track(), compiled=compiled)
    z0, s, p, reads = driven(11, 12)
    windows = sliding_window_view(s.reshape(-1, 5), 12, axis=0).swapaxes(1, 2)[:33:3]
    for found, expected in zip(
        made.simulate(z0, windows, p, reads), made.simulate(z0, windows.copy(), p, reads), strict=True
    ):
        np.testing.assert_array_equal(found, expected)


@needs_compiler
def test_what_fades_at_once_is_nothing():
    fading = functions(1, 1, 1, lambda z, s, p: z, lambda z, s, p: cs.exp(-s / p))
    s = np.array([0.0, 1e-3, 0.7446, 0.7455, 0.8, 1.0, np.inf, -1e-3, 0.708, np.nan])[:, None, None]
    with np.errstate(all="ignore"):
        _, y = Kernel(*fading, compiled=True).simulate(np.zeros((10, 1)), s, [1e-3], [True])
        np.testing.assert_allclose(y[:, 0, 0], np.exp(-s[:, 0, 0] / 1e-3), rtol=1e-14, atol=1e-322)


def test_shapes_that_do_not_go_together_and_doubled_columns_are_refused():
    made = Kernel(*single_track(), compiled=False)
    z0, s, p, reads = driven(3, 6)
    for wrong in [(z0[:2], s, p, reads), (z0, s[:, :, :4], p, reads), (z0, s, p[:, :8], reads), (z0, s, p, reads[:5])]:
        with pytest.raises(ValueError, match="do not match"):
            made.simulate(*wrong)
    with pytest.raises(ValueError, match="twice"):
        made.linearise(z0, s, p, reads, [1, 1])


def worked(lanes=3, compiled=None):
    made, given = Kernel(*single_track(), compiled=compiled), driven(lanes, 10)
    return made, made.simulate(*given)


@needs_compiler
def test_compiling_waits_until_it_pays_and_a_library_in_the_cache_is_used(empty_cache, monkeypatch):
    monkeypatch.setattr(kernel, "PAYS", 50)
    made, _ = worked(4)
    assert not made.compiled
    made.simulate(*driven(1, 10))
    assert made.compiled
    monkeypatch.setattr(Compiler, "compile", None)  # from here on it is an error to compile
    assert not worked(4)[0].compiled
    assert worked(5)[0].compiled
    assert worked(compiled=True)[0].compiled
    assert len(kernels(empty_cache)) == 1


@needs_compiler
def test_a_first_run_gives_the_same_digits_as_a_later_one(empty_cache, monkeypatch):
    monkeypatch.setattr(kernel, "PAYS", 50)

    def found():
        made = Kernel(*single_track())
        return [made.simulate(*driven(lanes, 10)) for lanes in (4, 1, 3)]

    cold, warm = found(), found()
    assert all(
        np.array_equal(a, b) for one, other in zip(cold, warm, strict=True) for a, b in zip(one, other, strict=True)
    )


@needs_compiler
def test_a_prepared_kernel_runs_compiled_from_the_first_call(empty_cache):
    made = Kernel(*single_track())
    made.prepare()
    made.simulate(*driven(1, 10))
    assert made.compiled


@needs_compiler
@pytest.mark.parametrize("damage", ["truncated", "empty", "one byte", "another library"])
def test_a_damaged_library_is_made_again(damage, compiled_once, filled_cache):
    (path,) = kernels(filled_cache)
    whole = path.read_bytes()
    other = bytes([whole[len(whole) // 2] ^ 1])
    path.write_bytes(
        {
            "truncated": whole[: len(whole) // 2],
            "empty": b"",
            "one byte": whole[: len(whole) // 2] + other + whole[len(whole) // 2 + 1 :],
            "another library": whole + b"x",
        }[damage]
    )
    made, found = worked(compiled=True)
    assert made.compiled
    assert_same(found, compiled_once[1])
    (path,) = kernels(filled_cache)
    assert path.stem.endswith(hashlib.sha256(path.read_bytes()).hexdigest()[:32])


@needs_compiler
@pytest.mark.parametrize("mode", [0o777, 0o775, 0o702])
def test_a_folder_that_others_can_write_to_is_not_used_and_that_is_said_once(mode, empty_cache, caplog):
    compiler._log_once.cache_clear()
    (empty_cache / "kernels").mkdir(parents=True)
    (empty_cache / "kernels").chmod(mode)
    for _ in range(2):
        assert worked(compiled=True)[0].compiled
    assert kernels(empty_cache) == []
    assert [
        own.getMessage().count("others can write to it") for own in caplog.records if own.levelname == "WARNING"
    ] == [1]


@needs_compiler
def test_a_folder_in_one_that_others_can_write_to_is_not_used(empty_cache, caplog):
    compiler._log_once.cache_clear()
    empty_cache.mkdir(parents=True, exist_ok=True)
    empty_cache.chmod(0o777)
    assert worked(compiled=True)[0].compiled
    assert kernels(empty_cache) == []
    assert ["others can write to it" in own.getMessage() for own in caplog.records] == [True]


@needs_compiler
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names here")
def test_a_pipe_in_place_of_a_library_is_passed_over(filled_cache):
    (path,) = kernels(filled_cache)
    path.unlink()
    os.mkfifo(path)
    assert worked(compiled=True)[0].compiled


@needs_compiler
@pytest.mark.parametrize("what", ["folder", "library"])
def test_what_belongs_to_another_user_is_not_executed(what, filled_cache, monkeypatch):
    (path,) = kernels(filled_cache)
    loaded = []
    real = ctypes.CDLL
    monkeypatch.setattr(
        ctypes, "CDLL", lambda name, *more, **others: loaded.append(name) or real(name, *more, **others)
    )
    if what == "folder":
        monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    else:
        content = path.read_bytes() + b"planted"
        path.unlink()
        path = path.with_name(f"{path.stem[:-32]}{hashlib.sha256(content).hexdigest()[:32]}.so")
        path.write_bytes(content)
        path.chmod(0o666)
    assert worked(compiled=True)[0].compiled
    assert loaded
    assert str(path) not in loaded


@needs_compiler
def test_a_planted_library_under_the_right_name_is_not_executed(filled_cache):
    (path,) = kernels(filled_cache)
    planted = path.with_name(f"{path.stem[:-32]}{'0' * 32}.so")
    planted.write_bytes(b"planted")
    path.unlink()
    assert worked(compiled=True)[0].compiled
    assert planted not in kernels(filled_cache)


@pytest.mark.parametrize("said", ['gcc "', "gcc 'x", "   ", "/nowhere/cc -O2"])
def test_any_word_for_the_compiler_ends_in_an_answer(said, monkeypatch, empty_cache, caplog):
    monkeypatch.setenv("CC", said)
    monkeypatch.setattr(kernel, "PAYS", 0)
    compiler._log_once.cache_clear()
    made, found = worked()
    assert_same(found, worked(compiled=False)[1])
    if not made.compiled:
        assert "about ten times slower" in caplog.text


@needs_compiler
def test_a_wait_for_the_compiler_is_explained_once(empty_cache, monkeypatch, caplog):
    monkeypatch.setattr(compiler, "NOTICED", 0.0)
    compiler._log_once.cache_clear()
    caplog.set_level("INFO", "greybox_id")
    for _ in range(2):
        assert worked(compiled=True)[0].compiled
        for path in kernels(empty_cache):
            path.unlink()
    assert caplog.text.count("Waiting for the C compiler") == 1


@needs_compiler
def test_a_full_disk_where_libraries_are_kept_ends_in_an_answer(empty_cache, monkeypatch):
    def full(self, *more, **others):
        if empty_cache in self.parents:
            raise OSError(errno.ENOSPC, "No space left on device")
        return whole(self, *more, **others)

    whole = Path.write_text
    monkeypatch.setattr(Path, "write_text", full)
    assert worked(compiled=True)[0].compiled
    assert kernels(empty_cache) == []


@needs_compiler
def test_what_a_killed_compiler_left_is_swept(empty_cache):
    folder = empty_cache / "kernels"
    folder.mkdir(mode=0o700, parents=True)
    left = folder / f".greybox-{files._machine()}-4194304-1-{'0' * 12}"
    left.mkdir()
    worked(compiled=True)
    assert not left.exists()


@needs_compiler
@pytest.mark.parametrize("said", ["0", "1"])
def test_the_environment_decides_for_those_who_do_not(said, monkeypatch):
    monkeypatch.setenv("GREYBOX_COMPILE", said)
    assert worked()[0].compiled == (said == "1")
    assert worked(compiled=True)[0].compiled
    assert not worked(compiled=False)[0].compiled


def test_without_a_compiler_it_works(monkeypatch):
    monkeypatch.setenv("CC", "/nowhere/cc")
    monkeypatch.setattr(kernel, "PAYS", 0)
    made, found = worked()
    assert not made.compiled
    assert_same(found, worked(compiled=False)[1])
    with pytest.raises(CannotCompile, match="nowhere"):
        worked(compiled=True)


@needs_compiler
def test_with_a_broken_compiler_it_works(tmp_path, empty_cache, monkeypatch):
    path = compiler.compiler().command[0]
    for name, text in {"no": "exit 1", "half": f'case "$*" in *-shared*) exit 1;; esac; exec {path} "$@"'}.items():
        broken = tmp_path / name
        broken.write_text(f"#!/bin/sh\n{text}\n")
        broken.chmod(broken.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setenv("CC", str(broken))
        monkeypatch.setattr(kernel, "PAYS", 0)
        assert not worked()[0].compiled
        with pytest.raises(CannotCompile, match="compiler"):
            worked(compiled=True)
    assert kernels(empty_cache) == []


def test_an_operation_without_c_stays_with_the_virtual_machine(monkeypatch):
    monkeypatch.setattr(kernel, "PAYS", 0)
    odd = functions(1, 1, 1, lambda z, s, p: cs.erfinv(z), lambda z, s, p: z)
    made = Kernel(*odd)
    assert made.simulate([[0.5]], np.zeros((1, 1, 1)), [0.0], [False])[0][0, 1, 0] == pytest.approx(0.4769362762)
    assert not made.compiled
    with pytest.raises(CannotCompile):
        Kernel(*odd, compiled=True).simulate([[0.5]], np.zeros((1, 1, 1)), [0.0], [False])


@needs_compiler
def test_several_may_compile_the_same_at_once(empty_cache):
    with ThreadPoolExecutor(4) as pool:
        results = [found for _, found in pool.map(lambda _: worked(compiled=True), range(4))]
    assert all(np.array_equal(a, b) for found in results for a, b in zip(found, results[0], strict=True))
    assert len(kernels(empty_cache)) == 1


@needs_compiler
@pytest.mark.skipif(os.geteuid() == 0, reason="root writes everywhere")
def test_a_cache_that_cannot_be_written_to_is_done_without(tmp_path, monkeypatch):
    tmp_path.chmod(0o500)
    monkeypatch.setenv("GREYBOX_CACHE", str(tmp_path / "cache"))
    assert worked(compiled=True)[0].compiled


@needs_compiler
def test_a_cache_that_is_no_folder_is_done_without(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("GREYBOX_CACHE", str(tmp_path / "file"))
    assert worked(compiled=True)[0].compiled
