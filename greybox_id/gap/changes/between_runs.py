"""What runs of one vehicle have in common, and by how much its numbers differ from run to run.

Numbers of a run are those of the vehicle, c, and for some of them a deviation d_k, normal about zero with a standard
deviation S between runs. Logarithms of S have a normal prior, in which vehicles differ and numbers of a vehicle do, and
are estimated from the marginal likelihood of the differences between runs; how uncertain they are is part of the
scatter that is expected of a further run (Gelman et al., Bayesian Data Analysis, 3rd ed., Ch. 5). All runs are
explained at once, by Gauss-Newton on their innovations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...base.errors import BadInput
from ...base.shorthands import Array, Index
from ..estimation.calibration import CAL
from ..estimation.descent import Curve, descended
from .innovations import FilterInnovations, FollowedRun, Follower, InnovationNoise


@dataclass(frozen=True)
class VaryingNumber:
    """A number of a vehicle, in a coordinate in which it is searched.

    Attributes
    ----------
    name : of the model's parameter.
    logarithmic : whether the coordinate is its logarithm.
    mean, sd : prior of the coordinate.
    step : of finite differences, in the coordinate.
    low, high : of the coordinate.
    usual : standard deviation between runs to which nothing was done; zero where runs share the number.
    change : prior standard deviation of a change.
    """

    name: str
    logarithmic: bool
    mean: float
    sd: float
    step: float
    low: float
    high: float
    usual: float = 0.0
    change: float = 0.0

    def value(self, at: float) -> float:
        """The number at a coordinate."""
        return float(np.exp(at)) if self.logarithmic else float(at)


def values_of(numbers: Sequence[VaryingNumber], x: Array) -> dict[str, float]:
    """Numbers by name, within their bounds."""
    return {
        number.name: number.value(min(max(float(at), number.low), number.high))
        for number, at in zip(numbers, x, strict=True)
    }


@dataclass(frozen=True)
class Weigher:
    """Negative log-likelihoods of rides.

    Attributes
    ----------
    follower : the filter, with sizes of noise.
    numbers : that are searched.
    noise : distribution of innovations.
    """

    follower: Follower
    numbers: tuple[VaryingNumber, ...]
    noise: InnovationNoise

    def innovations(self, ride: FollowedRun, *several: Array) -> list[FilterInnovations | None]:
        """Innovations of a ride at several coordinates, filtered side by side; None where the filter diverges."""
        return self.follower.innovations(ride, [values_of(self.numbers, x) for x in several])

    def cost(self, ride: FollowedRun, x: Array) -> float:
        """Negative log-likelihood of a ride at coordinates x; infinite where the filter diverges."""
        return self.costs(ride, [x])[0]

    def costs(self, ride: FollowedRun, several: Sequence[Array]) -> list[float]:
        """The same at several coordinates."""
        return [np.inf if one is None else self.noise.cost(one) for one in self.innovations(ride, *several)]

    def curve(self, ride: FollowedRun, x: Array, moved: Sequence[int] | None = None) -> Curve:
        """Cost of a ride at x with derivatives by the numbers at indices `moved`; None: by all."""
        n, places = len(x), range(len(x)) if moved is None else moved
        steps = {k: item.step if x[k] + item.step <= item.high else -item.step
                 for k in places for item in (self.numbers[k],)}  # fmt: skip
        here, *beside = self.innovations(ride, x, *(x + step * (np.arange(n) == k) for k, step in steps.items()))
        if here is None:
            name = ride.recording.name
            raise BadInput(f"The filter diverges on {name}: is this the right vehicle, in the right units?")
        scales = self.noise.scales(here)
        white = self.noise.white(here, scales)
        J, wider = np.zeros((*white.shape, n)), np.zeros((len(white), n))
        for (k, step), there in zip(steps.items(), beside, strict=True):
            if there is not None and np.array_equal(there.white == CAL.astray, here.white == CAL.astray):
                J[..., k] = (self.noise.white(there, scales) - white) / step
                wider[:, k] = np.sum(there.spread - here.spread, axis=1) / step
        weights = self.noise.weights(here, white)
        scores = np.einsum("b,bi,bin->bn", weights, white, J) + self.noise.temper * wider
        H = np.einsum("b,bin,bim->nm", weights, J, J, optimize=True)
        return Curve(self.noise.cost(here), np.sum(scores, axis=0), H, scores)


@dataclass(frozen=True)
class Common:
    """Numbers that runs have in common, and their scatter between runs.

    Attributes
    ----------
    numbers : of the vehicle.
    varying : indices of those that differ between runs.
    x, covariance : (n,), (n, n) of the vehicle's coordinates.
    scatter : (n,) standard deviation between runs; zero for those that do not vary.
    deviations, deviation_sds : (runs, n) of each run from the vehicle, and their standard deviations.
    weigher : by which they were estimated.
    """

    numbers: tuple[VaryingNumber, ...]
    varying: tuple[int, ...]
    x: Array
    covariance: Array
    scatter: Array
    deviations: Array
    deviation_sds: Array
    weigher: Weigher

    @property
    def of_a_run(self) -> Array:
        """(n, n) prior covariance of the coordinates of a further run to which nothing was done."""
        return np.asarray(self.covariance + np.diag(self.scatter**2))


def common(
    weigher: Weigher,
    rides: Sequence[FollowedRun],
    usual: Mapping[str, float],
    start: Common | None = None,
    settled: float = CAL.between_settled,
) -> Common:
    """Explain all rides at once.

    Parameters
    ----------
    weigher : of rides.
    rides : of one vehicle, to which nothing was done between them.
    usual : name -> usual standard deviation between runs, of numbers that may differ.
    start : earlier estimates.
    settled : log-likelihood; the search ends where a step is expected to gain less.
    """
    numbers = weigher.numbers
    n, runs = len(numbers), len(rides)
    varying = np.array([k for k, number in enumerate(numbers) if number.name in usual], dtype=int)
    m = len(varying)
    prior = np.array([usual[numbers[k].name] for k in varying])
    scatter = prior.copy()
    mean, sd = np.array([number.mean for number in numbers]), np.array([number.sd for number in numbers])
    u = middle = np.concatenate([mean, np.tile(mean[varying], runs)])  # the vehicle's, then those of each run
    if start is not None:
        u = np.concatenate([start.x, (start.x + start.deviations)[:, varying].ravel()])
        scatter = start.scatter[varying]
    among_all = np.eye(n)[varying]
    beyond_vehicle = np.hstack([np.tile(-among_all, (runs, 1)), np.eye(runs * m)])
    places = [np.arange(n) for _ in range(runs)]
    for k, at in enumerate(places):
        at[varying] = np.arange(n + k * m, n + (k + 1) * m)
    low, high = np.array([[number.low, number.high] for number in numbers]).T
    low, high = (np.concatenate([ends, np.tile(ends[varying], runs)]) for ends in (low, high))

    def precision(scatter: Array, free: Index | None = None) -> Array:
        """Prior precision of the unknowns; the vehicle's numbers at places `free` may be anything."""
        firm = np.tile(scatter**-2.0, runs)  # precisions of runs about their vehicle
        value = np.asarray((beyond_vehicle.T * firm) @ beyond_vehicle, dtype=float)
        known = 1.0 / sd**2
        if free is not None:
            known[free] *= CAL.flat
        value[:n, :n] += np.diag(known)
        return value

    for _ in range(CAL.rounds_of_scatter):
        P, before = precision(scatter), scatter
        u, last = _most_probable(weigher, rides, places, u, (middle, P), (low, high), settled=settled)
        if runs == 1:  # which shows no scatter
            break
        informed = last.H - P  # by the recordings, to second order
        pull = informed @ u - last.g + P @ (u - middle) + precision(prior, varying) @ middle
        scatter = _scatter(partial(precision, free=varying), informed, pull, beyond_vehicle, prior, scatter)
        if np.all(np.abs(scatter - before) < CAL.settled_scatter * before):
            break
    everything = np.asarray(np.linalg.inv(last.H), dtype=float)
    spread = np.sqrt(np.diag(beyond_vehicle @ everything @ beyond_vehicle.T))
    deviations, sds = (each.reshape(runs, m) @ among_all for each in (beyond_vehicle @ u, spread))
    return Common(
        numbers, tuple(varying.tolist()), u[:n], everything[:n, :n], scatter @ among_all, deviations, sds, weigher
    )  # fmt: skip


def _scatter(
    precision: Callable[[Array], Array],
    informed: Array,
    pull: Array,
    beyond_vehicle: Array,
    usual: Array,
    start: Array,
) -> Array:
    """Root mean squares of the posterior of scatters between runs: the less is known of one, the larger they are.

    A further run differs by as much. Logarithms of scatters have a normal prior with a common part of all numbers of a
    vehicle; usual scatters are its root mean squares. They are estimated from their marginal likelihood by Fisher
    scoring, with Laplace's covariance (Patterson & Thompson, Biometrika 58, 1971: of differences between runs alone;
    MacKay, Neural Computation 11, 1999).

    Parameters
    ----------
    precision : prior one of all unknowns, by scatters, if the vehicle's numbers may be anything.
    informed, pull : Hessian by recordings; posterior precision times most probable unknowns.
    beyond_vehicle : unknowns -> deviations of runs, all numbers of one after the other.
    usual, start : (numbers,) scatters.
    """
    m = len(usual)
    runs = len(beyond_vehicle) // m
    apart = CAL.scatters_apart**2 * np.eye(m) + CAL.vehicles_apart**2
    middle, firm = np.log(usual) - np.diag(apart), np.linalg.inv(apart)  # of a log-normal with this root mean square

    def curve(logarithms: Array) -> Curve:
        scatter, off = np.exp(logarithms), logarithms - middle
        P = informed + precision(scatter)
        covariance = np.asarray(np.linalg.inv(P), dtype=float)
        u = covariance @ pull
        value = 0.5 * float(np.linalg.slogdet(P)[1] - pull @ u + off @ firm @ off) + runs * float(np.sum(logarithms))
        each = np.tile(scatter, runs)
        deviations, shared = (beyond_vehicle @ u) / each, beyond_vehicle @ covariance @ beyond_vehicle.T
        shared = shared / np.outer(each, each)
        squares = (deviations**2 + np.diag(shared)).reshape(runs, m)
        determined = ((np.eye(runs * m) - shared) ** 2).reshape(runs, m, runs, m)  # shares, by recordings
        return Curve(value, np.sum(1.0 - squares, axis=0) + firm @ off, 2.0 * np.sum(determined, axis=(0, 2)) + firm)

    ends = np.full(m, np.inf)
    logarithms, last = descended(
        lambda u: curve(u).cost, curve, np.log(start), -ends, ends, CAL.amplitudes_settled, CAL.scatters_stride
    )
    return np.asarray(np.exp(logarithms + np.diag(np.linalg.inv(last.H))), dtype=float)


def change_sds(information: Array, prior: Array) -> Array:
    """(n,) standard deviation with which recordings determine the deviation of each number from its prior mean.

    Parameters
    ----------
    information : (n, n) Hessian of the recordings' negative log-likelihood.
    prior : (n, n) prior covariance of the numbers.
    """
    precise = information - information @ np.linalg.solve(information + np.linalg.inv(prior), information)
    return 1.0 / np.sqrt(np.maximum(np.diag(precise), 1e-12))


@dataclass(frozen=True)
class RunExplained:
    """A run, explained under a prior.

    Attributes
    ----------
    x : (n,) its coordinates.
    cost : negative log posterior.
    H : (n, n) its Hessian.
    information, pull : (n, n), (n,) Hessian and gradient of the rides' negative log-likelihood alone.
    """

    x: Array
    cost: float
    H: Array
    information: Array
    pull: Array


def explained(
    weigher: Weigher,
    rides: Sequence[FollowedRun],
    start: Array,
    mean: Array,
    covariance: Array,
    moved: Sequence[int] | None = None,
) -> RunExplained:
    """The most probable numbers of rides that share them, under a prior about `mean`.

    Parameters
    ----------
    start : (n,) where the search begins.
    moved : indices of the numbers that matter to these rides; the others follow by the prior.
    """
    precision, places = np.asarray(np.linalg.inv(covariance), dtype=float), [np.arange(len(mean)) for _ in rides]
    low, high = np.array([[number.low, number.high] for number in weigher.numbers]).T
    x, last = _most_probable(weigher, rides, places, start, (mean, precision), (low, high), moved)
    return RunExplained(x, last.cost, last.H, last.H - precision, last.g - precision @ (x - mean))


def _most_probable(
    weigher: Weigher,
    rides: Sequence[FollowedRun],
    places: Sequence[Index],
    start: Array,
    prior: tuple[Array, Array],
    bounds: tuple[Array, Array],
    moved: Sequence[int] | None = None,
    settled: float = CAL.between_settled,
) -> tuple[Array, Curve]:
    """The most probable unknowns, and the cost's quadratic approximation there.

    Parameters
    ----------
    places : of each ride's numbers among the unknowns.
    prior : mean and precision.
    moved, settled : as of `explained`, `common`.
    """
    mean, precision = prior

    def charge(u: Array) -> float:
        return 0.5 * float((u - mean) @ precision @ (u - mean))

    def cost(u: Array) -> float:
        return charge(u) + sum(weigher.cost(ride, u[at]) for ride, at in zip(rides, places, strict=True))

    def curve(u: Array) -> Curve:
        value, g, H = charge(u), precision @ (u - mean), precision.copy()
        for ride, at in zip(rides, places, strict=True):
            one = weigher.curve(ride, u[at], moved)
            value += one.cost
            g[at] += one.g
            H[np.ix_(at, at)] += one.H
        return Curve(value, g, H)

    return descended(cost, curve, start, *bounds, settled)
