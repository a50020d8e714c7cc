"""Is `greybox sample` calibrated?

    python benchmarks/posterior.py [--part sbc] [--sets 200] [--seed 0] [--json]

Simulation-based calibration of the draws of the noise alone, since the model is right here: parameters are drawn from
their priors, recordings are simulated with noise, fitted and sampled; the rank of every true value among its draws is
uniform where the posterior is right. Eight parameters of the lateral model, two drives of 8 s at 25 Hz, laplace and
mcmc.

Source: Talts et al., Validating Bayesian inference algorithms with simulation-based calibration (2018).
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from typing import Any

import numpy as np
from running import options, tell
from scipy.stats import chi2, kstest
from threadpoolctl import threadpool_limits

from greybox_id.base.errors import GreyboxError
from greybox_id.datasets.recording import Recording
from greybox_id.fitting.how import FitOptions
from greybox_id.fitting.posterior.laplace import trusted
from greybox_id.fitting.posterior.verb import SampleOptions, sample
from greybox_id.fitting.scores.metrics import simulate
from greybox_id.fitting.verb import fit
from greybox_id.models.motion_model import MotionModel
from greybox_id.models.parameter import Prior
from greybox_id.models.registry import build
from greybox_id.models.vehicle import vehicle

PRIORS = {
    "I_z": (2400.0, 480.0), "l_f": (1.3, 0.05), "l_r": (1.4, 0.05), "B_f": (10.0, 2.0), "D_f": (0.95, 0.1),
    "B_r": (11.0, 2.0), "D_r": (1.0, 0.1), "steering_offset": (0.0, 0.005),
}  # fmt: skip
"""Mean and standard deviation, SI."""
NOISE = {"v_y": 0.02, "yaw_rate": 0.005, "a_y": 0.1}
SECONDS, DT, RUNS = 8.0, 0.04, 2
BINS = 10


def calibration(sets: int, seed: int, say: Any) -> dict[str, Any]:
    """Ranks of the truth by method and parameter, uniform where the posterior is right."""
    model = _stated()
    ranks: dict[str, list[list[float]]] = {"laplace": [], "mcmc": []}
    seconds, met, tails, failed = {"laplace": 0.0, "mcmc": 0.0}, [], [], 0
    for k in range(sets):
        rng = np.random.default_rng((seed, k))
        truth = {name: _within(rng, *PRIORS[name], model[name].bounds) for name in PRIORS}
        true = model.with_parameters(*(model[name].with_value(value) for name, value in truth.items()))
        drives = [_driven(true, rng, j) for j in range(RUNS)]
        try:
            found = fit(model, drives, how=FitOptions(solver="gauss-newton"))
        except GreyboxError:
            failed += 1
            continue
        for method in ranks:
            clock = time.process_time()
            own = sample(found, drives, SampleOptions(method, 2000 if method == "laplace" else 1000, seed=k))
            seconds[method] += time.process_time() - clock
            below = [float(own.weight @ (own.noise_alone[:, own.names.index(name)] < truth[name])) for name in PRIORS]
            ranks[method].append(below)
            if method == "mcmc":
                met.append(float(own.r_hat.max()))
            else:
                tails.append([own.pareto_k, own.worst[1], own.pareto_k > trusted(len(own))])
        if k % 10 == 9:
            say(f"{k + 1} of {sets}: r_hat median {np.median(met):.3f}")
    rows = []
    for method, table in ranks.items():
        for name, u in zip(PRIORS, np.array(table).T, strict=True):
            counts = np.histogram(u, BINS, (0, 1))[0]
            square = float(np.sum((counts - len(u) / BINS) ** 2) / (len(u) / BINS))
            rows.append(
                {
                    "method": method, "parameter": name, "sets": len(u), "p_ks": float(kstest(u, "uniform").pvalue),
                    "p_histogram": float(chi2.sf(square, BINS - 1)), "counts": counts.tolist(),
                    "within_90": float(np.mean((u >= 0.05) & (u <= 0.95))),
                }
            )  # fmt: skip
    k, worth, normal = np.array(tails).T
    return {
        "rows": rows, "cpu_seconds": seconds, "r_hat": np.quantile(met, [0.5, 0.9]).tolist(), "failed": failed,
        "pareto_k": np.quantile(k, [0.5, 0.9]).tolist(), "normal": float(np.mean(normal)),
        "ess": {"laplace": np.quantile(worth, [0.1, 0.5]).tolist()},
    }  # fmt: skip


def _stated() -> MotionModel:
    """The lateral model with eight free parameters at the means of their priors."""
    model = build("lateral", None, {"steering_offset": 0.0}, vehicle("full_size_car"))
    assert isinstance(model, MotionModel)
    free = [
        replace(model[name], fixed=False, prior=Prior(sd, mean=mean), value=np.array(mean))
        for name, (mean, sd) in PRIORS.items()
    ]
    return model.with_parameters(*(replace(p, fixed=True) for p in model.parameters)).with_parameters(*free)


def _within(rng: np.random.Generator, mean: float, sd: float, bounds: tuple[float, float]) -> float:
    while True:
        value = mean + sd * rng.standard_normal()
        if bounds[0] <= value <= bounds[1]:
            return float(value)


def _driven(model: Any, rng: np.random.Generator, number: int) -> Recording:
    t = DT * np.arange(round(SECONDS / DT))
    waves = [np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.2, 0.45, 0.9)]
    steer = 0.03 * waves[0] + 0.025 * waves[1] + 0.015 * waves[2]
    own = Recording(f"drive {number}", t, {"steer": steer, "v_x": 18.0 + 2 * np.sin(0.5 * t)})
    found = simulate(model, own, {"v_y": 0.0, "yaw_rate": 0.0})
    read = {
        name: found.predicted[:, j] + NOISE[name] * rng.standard_normal(len(t)) for j, name in enumerate(model.outputs)
    }
    return own.with_signals(**read)


def main() -> None:
    """Run the benchmark."""
    given = options(__doc__, part={"choices": ["sbc"], "default": "sbc"}, sets=200, seed=0)
    with threadpool_limits(1):
        tell(calibration(given.sets, given.seed, lambda line: sys.stderr.write(f"{line}\n")), given.json)


if __name__ == "__main__":
    main()
