"""What the tests of a diagnosis share: laps of the independent simulator, small benches, a bench of given columns."""

from types import SimpleNamespace

import numpy as np
from reference_manoeuvres import manoeuvre
from reference_vehicle import FULL_SIZE_CAR, simulate, simulate_lateral

from greybox_id.datasets.recording import Recording
from greybox_id.gap.estimation.axes import Axis, Candidate
from greybox_id.gap.estimation.hypothesis import Start
from greybox_id.gap.estimation.noise import white_noise
from greybox_id.gap.estimation.search import Search
from greybox_id.models.parameter import Stated
from greybox_id.models.registry import build
from greybox_id.models.vehicle import Vehicle

NOISE = {"v_x": 0.02, "v_y": 0.02, "yaw_rate": 0.01, "a_x": 0.15, "a_y": 0.15}
NUMBERS = {name: Stated(value) for name, value in FULL_SIZE_CAR.items() if name != "v_max"}
CAR = Vehicle("car", NUMBERS, noise=NOISE)
"""Every number is exact."""


def lap(effects=None, seconds=40.0, seed=0, dropped=0.0, vehicle=None, **changes):
    """A recording of the independent simulator, with noise; `vehicle` differs from the nominal one."""
    given = manoeuvre("mixed", FULL_SIZE_CAR, seed=seed, duration=seconds, rate=50.0)
    found = simulate({**FULL_SIZE_CAR, **(vehicle or {})}, given, effects, start=(given["v_x"][0], 0.0, 0.0), fine=1e-3)
    commands = {"steer": given["steer"], "ax_cmd": given["drive"]}
    return _read(f"lap{seed}", given["time"], found, commands, seed, dropped, changes)


def lateral_lap(effects=None, seconds=40.0, seed=0):
    """The same of the lateral vehicle, whose speed is given."""
    given = manoeuvre("mixed", FULL_SIZE_CAR, seed=seed, duration=seconds, rate=50.0)
    driven = {name: given[name] for name in ("time", "steer", "v_x")}  # what drives it has no part in this model
    found = simulate_lateral(FULL_SIZE_CAR, driven, effects, fine=1e-3)
    read = _read(f"lap{seed}", given["time"], found, {"steer": given["steer"]}, seed, 0.0, {})
    return read.with_signals(v_x=given["v_x"])


def _read(name, time, found, commands, seed, dropped, changes):
    rng = np.random.default_rng(1000 + seed)
    held = rng.random(len(time)) < dropped
    last = np.maximum.accumulate(np.where(held, 0, np.arange(len(time))))
    noisy = {n: (found[n] + sd * rng.standard_normal(len(time)))[last] for n, sd in NOISE.items()}
    return Recording(name, time, {**commands, **noisy, **changes})


def nominal(name="single_track", effects=None, vehicle=CAR):
    """A model of the car."""
    return build(name, None, effects or {}, vehicle)


# ---- a bench whose simulations are known in closed form


class GivenBench:
    """Readings that follow from parameters as `respond` says, (K,) -> (N, channels); one unbroken run unless `lengths`.

    Stands in for `Bench` wherever simulations are not what is tested. Behind the K parameters is one that does nothing.
    """

    learnt = False

    def __init__(self, respond, measured, size, dt=0.02, channels=None, lengths=None, inputs=None):
        count = len(measured)
        self.respond = lambda p: respond(p[:size])
        self.size, self.measured, self.sample_time = size, np.asarray(measured, dtype=float), dt
        self.counted = np.isfinite(self.measured)
        self.channels = tuple(channels or [f"y_{c}" for c in range(self.measured.shape[1])])
        edges = np.concatenate(([0], np.cumsum(lengths or [count])))
        self.rows = [slice(int(a), int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True)]
        self.time = dt * np.arange(count)
        still = np.zeros(len(inputs or ()), dtype=bool)
        self.runs = [SimpleNamespace(time=self.time[own], sample_time=dt, held=still) for own in self.rows]
        inputs = inputs or {}
        self.inputs = np.column_stack(list(inputs.values())) if inputs else np.zeros((count, 0))
        self.model = SimpleNamespace(values=np.zeros(size + 1), inputs=tuple(inputs), outputs=self.channels, states=())
        self.loose = ()

    def simulate(self, P):
        return np.array([self.respond(p) for p in P]).reshape(-1, *self.measured.shape)

    def linearise(self, p, columns):
        step = 1e-4 * np.eye(len(p))
        J = [(self.respond(p + step[k]) - self.respond(p - step[k])) / 2e-4 for k in columns]
        shape = self.measured.shape
        return self.respond(p), np.stack(J, axis=2) if J else np.zeros((*shape, 0)), np.zeros((*shape, 0))


def linear_bench(X, truth, sd, seed=0, **settings):
    """Readings that are linear in parameters, X is (N, channels, K), with white noise."""
    noise = np.asarray(sd) * np.random.default_rng(seed).standard_normal(X.shape[:2])
    return GivenBench(lambda p: X @ p, X @ np.asarray(truth, dtype=float) + noise, X.shape[2], **settings)


def smooth_columns(count, rows=400, seed=0):
    """(rows, 2, count), smooth."""
    rng = np.random.default_rng(seed)
    raw = rng.standard_normal((rows + 9, 2, count))
    return sum(raw[k : k + rows] for k in range(10)) / np.sqrt(10)


def weighted(bench, indices, sd):
    """Derivatives by these parameters and readings, over the noise's sd."""
    J = bench.linearise(bench.model.values, list(indices))[1] / sd[:, None]
    return J.reshape(-1, len(indices)), (bench.measured / sd).ravel()


def alone(search, own, m=0.0):
    """A start at one candidate, nuisances where they are believed to be."""
    base = search.at_means()
    return Start((own,), np.atleast_1d(np.asarray(m, dtype=float)), base.theta, base.linear)


def axis(index, null=0.0, sd=np.inf, low=-np.inf, high=np.inf, scale=1.0, inverse=False, **more):
    """A plain axis of a parameter of one of these benches."""
    return Axis(f"p_{index}", "1", index, inverse, null, low, high, null, sd, scale, **more)


def candidate(index, **more):
    """A gradual effect of one parameter."""
    return Candidate(f"effect_{index}", (axis(index, **more),))


def search_on(bench, sd, nuisances=()):
    """A search with white noise, about its nuisances' beliefs."""
    own = nuisances or ((axis(bench.size, sd=1.0),) if isinstance(bench, GivenBench) else ())
    found = Search(bench, own, white_noise(np.asarray(sd, dtype=float), bench.counted, bench.rows))
    found.about(None)
    return found


def place(bench, name):
    """Of a parameter in the vectors of a bench."""
    return [parameter.name for parameter in bench.model.parameters].index(name)
