"""Table II of the transfer-learning paper: the bicycle as its authors coded it, by ABC-SMC from their priors.

THIS IS NOT A BICYCLE THAT HOLDS FOR A VEHICLE, and not the one that the paper prints; it is here because the published
figures are of it. Beside Eqs. 1 to 5 of the paper: recorded signs, which are of two frames, are taken as one; v_y is
turned to the front wheel and the steering angle added once more to its slip; the front axle bears m g l_f / l; the
term v_x yaw_rate is missing; and two free lengths, a and b, place the optical sensor: l_f + a ahead of the centre of
gravity, L / 2 + b beside it. Forward Euler steps of 0.05 s.

Published are the fifteen particles of least distance of the last population, on test. What differs here: windows do
not overlap (the same rows, at a fifteenth of the price).

Source: the authors' published code (github.com/N9TT-9G0A-B7FQ-RANC), vehicle_architecture.py, TorchDOF2, and
abc_smc_train.py; Table I, where the wheelbase l stands for l_r.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np

from greybox_id.base.shorthands import Array
from greybox_id.datasets.recording import Recording
from greybox_id.engine.kernel import Kernel
from greybox_id.fitting.posterior import abc_smc
from greybox_id.fitting.posterior.abc_smc import Away, ParticlePrior, ParticleSet
from greybox_id.models.single_track import G

from .truck_grey_boxes import OUTPUTS
from .truck_models import HELD

AUTHORS = "authors' bicycle, ABC-SMC"
DT = 0.05
TRACK = 2.5
"""L, m."""
STEEPEST = 1.0
"""rad: slip angles are cut there."""
PRIORS: Mapping[str, tuple[float, float]] = {
    "I_z": (150e3, 50e3), "l": (10.0, 2.0), "l_f": (5.0, 1.0), "a": (0.5, 1.0), "b": (0.5, 1.0),
    **{f"{letter}_{axle}": belief for axle in "fr" for letter, belief in (
        ("B", (7.1, 2.0)), ("C", (3.0, 2.0)), ("D", (3.0, 2.0)), ("E", (-2.0, 1.0)))},
}  # fmt: skip
"""Mean and standard deviation, SI; not cut anywhere, as coded."""
PARTICLES, BEST = 1000, 15
FIRST_THRESHOLD, TRIALS, TOLERANCE = 1.2, 1000, 0.0199
"""Thresholds as published: the first; it moves by a twentieth after so many trials, until their acceptance is so near
its target."""
STEP, WIDTH_IN_WEIGHTS = 0.2, 0.1
"""Of the published kernel where it perturbs, and where it weighs; standard deviations of the prior."""


def _step() -> cs.Function:
    """(v_y, yaw_rate), (v_x, steer), parameters -> the state 0.05 s later."""
    z, s, p = cs.SX.sym("z", 2), cs.SX.sym("s", 2), cs.SX.sym("p", len(PRIORS))
    I_z, wheelbase, l_f, a, b, *tyres = cs.vertsplit(p)
    (read, yaw_rate), (read_x, steer), m = cs.vertsplit(z), cs.vertsplit(s), HELD["m"]
    v_y, v_x, l_r = read + (l_f + a) * yaw_rate, read_x + (TRACK / 2 + b) * yaw_rate, wheelbase - l_f
    front = v_y + l_f * yaw_rate
    turned_x = v_x * cs.cos(steer) + front * cs.sin(steer)
    turned_y = front * cs.cos(steer) - v_x * cs.sin(steer)
    slips = steer - cs.atan(turned_y / turned_x), -cs.atan((v_y - l_r * yaw_rate) / v_x)
    F_yf, F_yr = (
        m * G * length / wheelbase * _pacejka(cs.fmin(cs.fmax(slip, -STEEPEST), STEEPEST), *item)
        for slip, length, item in zip(slips, (l_f, l_r), (tyres[:4], tyres[4:]), strict=True)
    )
    F_yf = F_yf * cs.cos(steer)
    turning = (l_f * F_yf - l_r * F_yr) / I_z
    rates = cs.vertcat((F_yf + F_yr) / m - (l_f + a) * turning, turning)
    return cs.Function("step", [z, s, p], [z + DT * rates])


def _pacejka(slip: cs.SX, B: cs.SX, C: cs.SX, D: cs.SX, E: cs.SX) -> cs.SX:
    return D * cs.sin(C * cs.atan(B * slip - E * (B * slip - cs.atan(B * slip))))


class WindowDistances:
    """How far simulations are from recordings: root mean square over windows, rows and outputs, each output in units of
    its spread.

    Parameters
    ----------
    recording : with the signs that were recorded.
    steps : of a window; windows begin where the one before ends, and what is left of a trajectory is dropped.
    first_alone : of each trajectory its first window.
    """

    def __init__(self, recording: Recording, steps: int, first_alone: bool = False) -> None:
        states = np.column_stack([recording[name] for name in OUTPUTS])
        inputs = np.column_stack([recording["v_x"], recording["steer"]])
        begun = [k for a, b in recording.runs for k in range(a, a + 1 if first_alone else b - steps, steps)]
        rows = np.array(begun)[:, None] + np.arange(steps + 1)
        self._read, self._inputs = states[rows], np.ascontiguousarray(inputs[rows[:, :-1]])
        self._scale = np.std(states, axis=0)

    def __call__(self, at: Array) -> Array:
        """(n, d) -> (n,); infinite where a simulation is not finite."""
        with np.errstate(all="ignore"):
            result = np.array([np.sqrt(np.mean((self.errors(item) / self._scale) ** 2)) for item in at])
        return np.where(np.isfinite(result), result, np.inf)

    def errors(self, p: Array) -> Array:
        """(windows, steps, outputs) predicted less read."""
        z, _ = self._kernel.simulate(self._read[:, 0], self._inputs, p, np.zeros(self._inputs.shape[1], dtype=bool))
        return np.asarray(z[:, 1:] - self._read[:, 1:])

    @cached_property
    def _kernel(self) -> Kernel:
        step = _step()
        z, s, p = (cs.SX.sym(name, step.numel_in(k)) for k, name in enumerate("zsp"))
        made = Kernel(step, cs.Function("output", [z, s, p], [z]))
        made.prepare()
        return made


def authors_particles(train: Recording, horizon: float, seed: int, as_published: bool) -> dict[str, Any]:
    """Sample from windows of so many seconds.

    Parameters
    ----------
    train : with the signs that were recorded.
    horizon : s.
    seed : of everything random.
    as_published : by the published algorithm, whose weights are wrong, or by that of `sample`.

    Returns
    -------
    Plain data: `x`, the fifteen particles of least distance; `mean` and `sd` of the parameters over the last
    population; its number and `threshold`; `simulations`, of all windows; `cpu_seconds`.

    Raises
    ------
    KeyboardInterrupt : Ctrl-C.
    """
    clock, distances = time.process_time(), WindowDistances(train, round(horizon / DT))
    simulations = 0

    def counted(at: Array) -> Array:
        nonlocal simulations
        simulations += len(at)
        return distances(at)

    population = (_published if as_published else _sampled)(counted, seed)
    mean = population.weight @ population.at
    sd = np.sqrt(population.weight @ (population.at - mean) ** 2)
    return {
        "x": population.at[np.argsort(population.distance, kind="stable")[:BEST]].tolist(),
        "mean": dict(zip(PRIORS, mean.tolist(), strict=True)), "sd": dict(zip(PRIORS, sd.tolist(), strict=True)),
        "population": population.number, "threshold": population.threshold, "simulations": simulations,
        "cpu_seconds": time.process_time() - clock,
    }  # fmt: skip


def _sampled(away: Away, seed: int) -> ParticleSet:
    """By the ABC-SMC of `sample`: the same targets of acceptance, one kernel for steps and weights."""
    priors = [ParticlePrior(mean, sd, -np.inf, np.inf) for mean, sd in PRIORS.values()]
    population = abc_smc.first(away, priors, PARTICLES, seed)
    while population.number < len(abc_smc.TARGETS):
        grown = abc_smc.grow(away, abc_smc.begin(away, population, priors, seed), priors, seed, lambda _: False)
        assert isinstance(grown, ParticleSet)
        if grown is population:
            break
        population = grown
    return population


def _published(away: Away, seed: int) -> ParticleSet:
    """To the letter of abc_smc_train.py, in units of the priors: steps are of one size, whatever a population is like;
    weights divide by a density of another size that is summed over parameters, where it ought to be their product.
    """
    mean, sd = np.array(list(PRIORS.values())).T
    rng, threshold, particle_set = np.random.default_rng((seed, 1)), FIRST_THRESHOLD, None
    for number, target in enumerate(abc_smc.TARGETS):
        kept, near_by, collecting, simulated = np.empty((0, len(mean))), np.empty(0), False, 0
        while len(kept) < PARTICLES:
            u = rng.standard_normal((TRIALS, len(mean)))
            if particle_set is not None:
                u = particle_set.at[rng.choice(len(particle_set.at), TRIALS, p=particle_set.weight)] + STEP * u
            distance = away(mean + sd * u)
            near = distance < threshold
            if collecting:
                simulated += TRIALS
                kept, near_by = np.concatenate([kept, u[near]]), np.concatenate([near_by, distance[near]])
                if (
                    particle_set is not None
                    and len(kept) < abc_smc.HOPELESS * target * simulated
                    and simulated > 20 * TRIALS
                ):
                    return replace(particle_set, at=mean + sd * particle_set.at)
            elif abs(np.mean(near) - target) <= TOLERANCE:
                collecting = True
            else:
                threshold *= 0.95 if np.mean(near) > target else 1.05
        kept, near_by = kept[:PARTICLES], near_by[:PARTICLES]
        weight = np.full(PARTICLES, 1 / PARTICLES) if particle_set is None else _published_weights(kept, particle_set)
        particle_set = ParticleSet(number + 1, kept, weight, near_by, threshold, len(kept) / simulated)
    assert particle_set is not None
    return replace(particle_set, at=mean + sd * particle_set.at)


def _published_weights(at: Array, before: ParticleSet) -> Array:
    """(n,) that sum to one, of particles in units of their standard normal priors."""
    density = np.zeros(len(at))
    for item, those in zip(at.T, before.at.T, strict=True):
        density += np.exp(-0.5 * ((item[:, None] - those) / WIDTH_IN_WEIGHTS) ** 2) @ before.weight
    weight = np.exp(-0.5 * np.sum(at**2, axis=1)) / density
    return np.asarray(weight / np.sum(weight))


def authors_errors(recording: Recording, particles: Sequence[Sequence[float]]) -> Array:
    """(particles, trajectories, rows, outputs) of free runs over whole trajectories, the first row left out."""
    shortest = min(b - a for a, b in recording.runs)
    window_distances = WindowDistances(recording, shortest - 1, first_alone=True)
    return np.array([window_distances.errors(np.array(p)) for p in particles])
