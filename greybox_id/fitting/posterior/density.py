"""The posterior density of a fit's parameters, evaluated for many points at once.

Likelihood and priors are those of the fit: residuals divided by their effective standard deviations, which account for
correlated readings, linear in the tails if the fit was robust. The nuisance parameters, initial states, are integrated
out: readings depend on them almost linearly, so that the optimal deviation of an initial state and its gain follow from
the derivatives at the fit (a Gaussian integral whose width does not depend on the parameters to that order).

`Target` is the density that is sampled: the posterior, widened to the fit's covariance, in coordinates in which valleys
are straight.

A model's errors persist, at times for a whole run, and a likelihood with independent readings is then too narrow along
some directions, by different factors. Deviations from the fit are mapped so that the second derivatives of the density
there are those of the covariance for correlated errors; curvature and priors are mapped along. No direction becomes
narrower than in the likelihood. Positive parameters except lengths, times, masses and inertias are sampled as
logarithms: valleys along which a product is constant are then straight.

Source: Ribatet, Cooley & Davison, Bayesian inference from composite likelihoods, Statistica Sinica 22 (2012), Sec. 2.3,
the curvature adjustment.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from ...base.errors import BadInput
from ...base.shorthands import Array, Mask
from ...engine.motion.lanes import Targets
from ...engine.motion.shooting import MotionProblem
from ...engine.solvers.gauss_newton import Solution
from ...models.parameter import Parameter, placed


@dataclass(frozen=True)
class DrawnNumber:
    """A scalar that is drawn.

    Attributes
    ----------
    name : name of its column: I_z, bank[3] of an array, tau@2 of the second run.
    unit : SI unit.
    parameter : name of the parameter.
    entry : index among the parameter's entries.
    run : for a run-scoped parameter, the run, from 0; None for all.
    """

    name: str
    unit: str
    parameter: str
    entry: int = 0
    run: int | None = None


class PosteriorDensity:
    """The density of a problem's free parameters around its optimum.

    Parameters
    ----------
    problem : the problem of the fit.
    solution : its optimum.

    Attributes
    ----------
    coordinates : the free scalars, in order.
    centre : (d,) their values at the optimum.
    bounds : lowest and highest values, (d,) each.
    evaluations : number of points simulated so far.
    """

    def __init__(self, problem: MotionProblem, solution: Solution) -> None:
        self.problem = problem
        self._x = solution.x
        scalars = coordinates(problem)
        self.coordinates = tuple(coordinate for coordinate, _ in scalars)
        self.places = np.array([place for _, place in scalars], dtype=np.intp)
        self.centre = solution.x[self.places].copy()
        low, high = problem.bounds
        self.bounds = low[self.places], high[self.places]
        self.evaluations = 0
        self._starts = _starts(problem, solution) if len(problem.loose) else []

    def __call__(self, points: Array) -> Array:
        """(n, d) -> (n,) log density up to a constant; -inf beyond bounds or where a simulation is not finite."""
        result = np.full(len(points), -np.inf)
        inside = np.flatnonzero(self.within(points))
        if len(inside) == 0:
            return result
        x = self.unknowns(points[inside])
        r = self._residuals(x)
        priors = np.array([0.5 * float(np.sum(self.problem.prior_residuals(item) ** 2)) for item in x])
        with np.errstate(over="ignore", invalid="ignore"):
            total = _misfit(self.problem.targets, r) + priors - self._gain_of_starts(r)
        result[inside] = np.where(np.isfinite(total), -total, -np.inf)
        return result

    def errors(self, points: Array) -> Array:
        """(n, d) -> (n, N, outputs) prediction errors, in the outputs' units, at optimal initial states; 0: no reading.

        Points beyond bounds are simulated, too.
        """
        weight = self.problem.targets.weight
        r = self._residuals(self.unknowns(points))
        for start in self._starts:
            flat = r.reshape(len(r), -1)
            flat[:, start.readings] -= (flat[:, start.readings] @ start.J) @ start.inverse @ start.J.T
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(weight > 0, r / weight, 0.0)

    def within(self, points: Array) -> Array:
        """(n, d) -> (n,) whether points lie within all bounds."""
        low, high = self.bounds
        return np.asarray(np.all((points >= low) & (points <= high), axis=1))

    def unknowns(self, points: Array) -> Array:
        """(n, d) -> (n, unknowns), with all other unknowns at the optimum."""
        x = np.tile(self._x, (len(points), 1))
        x[:, self.places] = points
        return x

    def _residuals(self, x: Array) -> Array:
        """(n, N, outputs) residuals in standard deviations; 0 without a reading."""
        self.evaluations += len(x)
        y, targets = self.problem.predicted_readings(x), self.problem.targets
        with np.errstate(over="ignore", invalid="ignore"):
            return np.where(targets.weight > 0, y - targets.reading, 0.0) * targets.weight

    def _gain_of_starts(self, r: Array) -> Array:
        """(n,) decrease of the objective by optimal initial states."""
        result = np.zeros(len(r))
        tail = self.problem.targets.robust
        if tail is not None:
            r = r * np.sqrt(np.minimum(1.0, tail / np.maximum(np.abs(r), 1e-12)))
        flat = r.reshape(len(r), -1)
        for start in self._starts:
            pull = flat[:, start.readings] @ start.J + start.pull
            result += 0.5 * np.einsum("ni,ij,nj->n", pull, start.inverse, pull)
        return result


@dataclass(frozen=True)
class _Start:
    """An interval's initial state around the optimum: indices of its readings (m,), their derivative (m, s), inverse
    Hessian (s, s), and the priors' gradient (s,).
    """

    readings: Array
    J: Array
    inverse: Array
    pull: Array


def coordinates(problem: MotionProblem) -> list[tuple[DrawnNumber, int]]:
    """The free scalars of a problem's parameters, and the index of each among the unknowns."""
    result: list[tuple[DrawnNumber, int]] = []
    for parameter, numbers in placed(problem.model.parameters):
        runs = list(enumerate(problem.parameters.index)) if parameter.scope == "run" else [(None, None)]
        for run, index in runs:
            for entry, name in enumerate(entry_names(parameter)):
                place = int((problem.parameters.index[0] if index is None else index)[numbers.start + entry])
                if problem.free[place]:
                    column = name if run is None else f"{name}@{run + 1}"
                    result.append((DrawnNumber(column, parameter.unit, parameter.name, entry, run), place))
    return result


def entry_names(parameter: Parameter) -> list[str]:
    """Names of a parameter's entries: F[0,1] of an array F."""
    if parameter.shape == ():
        return [parameter.name]
    return [f"{parameter.name}[{','.join(map(str, place))}]" for place in np.ndindex(*parameter.shape)]


def _misfit(targets: Targets, r: Array) -> Array:
    """(n,) half the sum of squared residuals, linear beyond the Huber threshold."""
    if targets.robust is None:
        return np.asarray(0.5 * np.einsum("nij,nij->n", r, r))
    e, k = np.abs(r), targets.robust
    return np.asarray(np.sum(np.where(e <= k, 0.5 * e**2, k * (e - 0.5 * k)), axis=(1, 2)))


def _starts(problem: MotionProblem, solution: Solution) -> list[_Start]:
    result = []
    order, edges = solution.nodes.cut.by_owner
    outputs = problem.target.shape[1]
    pull = problem.prior_gradient(solution.x)
    for k, (_, J) in enumerate(problem.residuals(solution.x, solution.nodes)):
        readings_of_interval = np.arange(edges[k], edges[k + 1]) if order is None else order[edges[k] : edges[k + 1]]
        rows = np.unique(readings_of_interval // outputs)
        places = problem.layout.index[k][problem.model.size :]
        flat = J[:, :, problem.model.size :].reshape(-1, len(places))
        inverse = np.linalg.pinv(flat.T @ flat + problem.prior_curvature[np.ix_(places, places)], hermitian=True)
        readings = (rows[:, None] * outputs + np.arange(outputs)).ravel()
        result.append(_Start(readings, flat, inverse, pull[places]))
    return result


ADDING = ("m", "s", "kg", "kg m^2")
"""Units of parameters that enter sums, as wheelbases and delays do: valleys along sums are straight in the parameters
themselves, valleys along products of the others in their logarithms."""
RIDGE = 1e-10
"""Added to a correlation matrix, so that rounding does not make it indefinite."""


class Widening:
    """Widens draws of the likelihood to a fit's covariance, which includes the model-form error.

    Deviations from the fit are mapped linearly such that their covariance becomes that of the fit; curvature, skewness,
    weights and chains of the draws stay. No direction becomes narrower. Draws mapped beyond a bound are set to the
    bound, as intervals of a fit are clipped. The map acts on the parameters themselves: in their logarithms, a standard
    deviation as large as the estimate would produce powers of ten.

    Sources: Chandler & Bate, Inference for clustered data using the independence loglikelihood, Biometrika 94 (2007);
    Shaby, The open-faced sandwich adjustment for MCMC using estimating functions, J. Computational and Graphical
    Statistics 23 (2014).

    Parameters
    ----------
    target : the sampled density.
    beyond : (d, d) covariance of theta in the fit beyond that of the noise.
    """

    def __init__(self, target: Target, beyond: Array) -> None:
        self.density = target.density
        L = target.factor * np.where(target.logarithmic, target.density.centre, 1.0)[:, None]
        inward = np.linalg.inv(L)
        added, Q = np.linalg.eigh(inward @ beyond @ inward.T)
        self.outward = L @ (Q * np.sqrt(1.0 + np.maximum(added, 0.0))) @ Q.T @ inward

    def __call__(self, theta: Array) -> Array:
        """Map draws of theta, (n, d) -> (n, d)."""
        centre = self.density.centre
        return np.asarray(np.clip(centre + (theta - centre) @ self.outward.T, *self.density.bounds))


class Target:
    """The density in sampling coordinates, u = log(theta) or theta, as chosen by `whitening`.

    Parameters
    ----------
    density : density of theta.
    independent : (d, d) covariance of theta at the fit for independent residuals, as in the density.
    lasting : (d, d) the same for correlated residuals.

    Attributes
    ----------
    centre : (d,) the fit, in u.
    factor : (d, d) factor of the covariance around the fit.
    narrowed : (d, d) maps deviations from the fit to those at which the density is evaluated.
    """

    def __init__(self, density: PosteriorDensity, independent: Array, lasting: Array) -> None:
        self.density = density
        unit, factor, self.logarithmic = whitening(density, independent)
        size = np.where(self.logarithmic, density.centre, 1.0)
        self.centre = self.to_u(density.centre[None])[0]
        L = factor * (unit / size)[:, None]
        inward = np.linalg.inv(L)
        wider, Q = np.linalg.eigh(inward @ (lasting / np.outer(size, size)) @ inward.T)
        growth = np.sqrt(np.maximum(wider, 1.0))
        self.factor = L @ (Q * growth)
        self.narrowed = L @ (Q / growth) @ Q.T @ inward

    def to_u(self, theta: Array) -> Array:
        """Theta to u, (n, d) -> (n, d)."""
        return np.asarray(np.where(self.logarithmic, np.log(np.where(self.logarithmic, theta, 1.0)), theta))

    def to_theta(self, u: Array) -> Array:
        """u to theta, (n, d) -> (n, d)."""
        with np.errstate(over="ignore"):
            return np.asarray(np.where(self.logarithmic, np.exp(np.where(self.logarithmic, u, 0.0)), u))

    def within(self, u: Array) -> Array:
        """(n, d) -> (n,) whether points lie within the parameters' bounds."""
        return self.density.within(self.to_theta(u))

    def __call__(self, u: Array) -> Array:
        """(n, d) -> (n,) log density of u."""
        result = np.full(len(u), -np.inf)
        inside = self.within(u)
        looked_up = self.centre + (u[inside] - self.centre) @ self.narrowed.T
        result[inside] = self.density(self.to_theta(looked_up)) + np.sum(looked_up[:, self.logarithmic], axis=1)
        return np.asarray(np.where(np.isfinite(result), result, -np.inf))


def whitening(density: PosteriorDensity, covariance: Array) -> tuple[Array, Array, Mask]:
    """Standard deviations (d,), a factor of the correlations (d, d), and a mask of the logarithmic coordinates (d,).

    Raises
    ------
    BadInput : a parameter is not determined.
    """
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    open_ = [coordinate.name for coordinate, s in zip(density.coordinates, sd, strict=True) if not np.isfinite(s)]
    if open_:
        raise BadInput(
            f"{', '.join(open_)} is not determined by the recordings, nor by a prior: there is nothing to draw from. "
            "Fix it or give it a prior, and fit again."
        )
    unit = np.where(sd > 0, sd, 1.0)
    correlation = covariance / np.outer(unit, unit)
    correlation[np.diag_indices_from(correlation)] = np.where(sd > 0, 1.0 + RIDGE, RIDGE)
    values, vectors = la.eigh(correlation)
    additive = np.array([coordinate.unit in ADDING for coordinate in density.coordinates])
    logarithmic = (density.bounds[0] >= 0) & (density.centre > 0) & ~additive
    return unit, np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))), logarithmic
