"""The density of many points at once is the objective of the fit, point by point; starts are integrated out."""

from dataclasses import replace

import numpy as np
import pytest
from driven import driven

from greybox_id.fitting.holding import restated
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.posterior.density import PosteriorDensity
from greybox_id.fitting.verb import fit
from greybox_id.models.parameter import Prior
from greybox_id.models.registry import build

pytestmark = pytest.mark.usefixtures("_uncompiled")


def fitted(recording, effects=None, **how):
    model = build("lateral", {"tyre": "linear"}, effects or {})
    free = ("I_z", "C_alpha_f", "C_alpha_r", *(effects or {}))
    model = model.with_parameters(
        *(replace(p, fixed=p.name not in free, prior=Prior(0.3 * abs(float(p.array)) + 0.01)) for p in model.parameters)
    )
    return fit(model, [recording], how=FitOptions(solver="gauss-newton", **how))


@pytest.fixture(scope="module")
def recording():
    return driven("lateral", runs=2, seconds=3.0)


def spread(density, count=5):
    rng = np.random.default_rng(3)
    return density.centre * (1 + 0.02 * rng.standard_normal((count, len(density.centre))))


@pytest.mark.parametrize("how", [{"start_from": "measured"}, {"start_from": "measured", "robust": 1.5},
                                 {"start_from": "measured", "horizon": 1.0}])  # fmt: skip
def test_it_is_the_fit_s_objective(recording, how):
    problem, solution = restated(fitted(recording, **how), [recording])
    density = PosteriorDensity(problem, solution)
    points = spread(density)
    found = density(points)
    for point, own in zip(points, found, strict=True):
        x = density.unknowns(point[None])[0]
        assert own == pytest.approx(-problem.objective(x, problem.simulated_nodes(x)), rel=1e-7)


@pytest.mark.parametrize("effect", ["steering_delay", "steering_lag"])
def test_delays_and_actuators_are_simulated_too(recording, effect):
    problem, solution = restated(fitted(recording, {effect: None}, start_from="measured"), [recording])
    density = PosteriorDensity(problem, solution)
    points = np.abs(spread(density, 3))
    for point, own in zip(points, density(points), strict=True):
        x = density.unknowns(point[None])[0]
        assert own == pytest.approx(-problem.objective(x, problem.simulated_nodes(x)), rel=1e-7)


def test_free_starts_are_at_their_best_at_every_point(recording):
    """Against an optimisation of the starts with the parameters held."""
    problem, solution = restated(fitted(recording), [recording])
    density = PosteriorDensity(problem, solution)
    assert len(problem.loose)
    points = spread(density, 3)
    for point, own in zip(points, density(points), strict=True):
        x = density.unknowns(point[None])[0]
        loose = np.arange(problem.parameters.size, problem.layout.size)
        for _ in range(3):
            equations = problem.normal_equations(x, problem.simulated_nodes(x))
            x[loose] -= np.linalg.solve(equations.H[np.ix_(loose, loose)], equations.g[loose])
        best = problem.objective(x, problem.simulated_nodes(x))
        rise = best - solution.objective
        assert -own - solution.objective == pytest.approx(rise, rel=0.02, abs=0.02)


def test_beyond_bounds_there_is_no_density(recording):
    problem, solution = restated(fitted(recording, start_from="measured"), [recording])
    density = PosteriorDensity(problem, solution)
    point = density.centre.copy()
    point[0] = -1.0
    assert density(point[None])[0] == -np.inf
    assert density.evaluations == 0
