"""Fit hybrid models by training: networks with a memory over windows, others over growing horizons.

Over growing horizons, each training starts where the previous one ended. One row ahead almost any network learns the
direction of motion; over a whole window a poor network is far from anything. Errors are in units of the readings'
spread, as published; early stopping by the held-out error ends training.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..base.errors import BadInput
from ..base.shorthands import Array
from ..datasets.recording import Recording
from ..engine.hybrid.problem import HybridProblem, WindowErrors, drawn
from ..engine.hybrid.stretches import Stretch, stretches
from ..engine.solvers.quasi_newton import Descent, descend
from ..models.hybrid_model import HybridModel
from .fit import Fit
from .how import FitOptions, Say, refused
from .pretraining import Pretraining, faster, known_physics, pretrained
from .training import (
    Trained,
    TrainedBefore,
    descent,
    manoeuvres,
    mirrored,
    read_noise,
    split,
    trained_best,
    update_hybrid,
)
from .verb import FitTask, estimated

HORIZONS = (2, 11, 21)
"""Rows predicted from one start before the full window: one, ten and twenty steps, as published."""
COUNTS = 0.1
"""Unit error of an output, as a share of its spread."""
ADAM, SHORT_STEPS, STEPS, PATIENCE = 100, 120, 400, 60
"""Steps of Adam from a random start; of L-BFGS over each short horizon and over the last; patience, see `descend`."""
_SAID = 20

Outside = Callable[[Array], float]
"""Parameter vector -> error on held-out data."""


def fit_network(
    model: HybridModel, recordings: Sequence[Recording], how: FitOptions, say: Say, known: Pretraining | None = None
) -> Trained:
    """Train a hybrid model.

    Every unbroken run is a manoeuvre; a fifth of them, drawn by the seed, are held out. A single run is held out at its
    end. Networks with a memory are trained over whole windows from the start, in units of the readings' noise.

    Parameters
    ----------
    model : nominal values of physical parameters; weights are drawn.
    recordings : training data.
    how : seed, number of starts and known noise.
    say : receives progress.
    known : a vehicle to pretrain on; its parameters become those of the model's physics, if the model has any.

    Raises
    ------
    BadInput : the recordings lack an input or all outputs, differ in sample time, or are too short.
    """
    clock = time.process_time()
    named = manoeuvres(model, recordings)
    train, held_out, names = split(named, model, how.seed)
    if known is not None and "m" in model:
        model = known_physics(model, known)
    sd = (read_noise if model.recurrent else counted)(model, [one for _, one in named], how)
    outside = WindowErrors(model, held_out, sd)
    if not model.recurrent:
        return trained_best(
            model, how, say, clock,
            lambda seed, item: trained_from(model, recordings, train, sd, outside, seed, item, known),
            WindowErrors(model, train, sd), outside, lambda p: _noise(model, held_out, p), names,
        )  # fmt: skip
    if model.symmetric:
        train = [*train, *(mirrored(model, one) for one in train)]
    problem = HybridProblem(model, train, sd)
    return trained_best(
        model, how, say, clock, lambda seed, item: descent(problem, outside, model, seed, item), problem.errors,
        outside, lambda _: sd, names,
    )  # fmt: skip


def trained_from(
    model: HybridModel,
    recordings: Sequence[Recording],
    train: Sequence[Stretch],
    sd: Array,
    held_out_of: Outside,
    seed: int,
    say: Say,
    known: Pretraining | None = None,
) -> Descent:
    """One training, from random or pretrained weights; x are the model's parameters.

    Parameters
    ----------
    held_out_of : error on held-out data over the last horizon, for early stopping.
    """
    p = drawn(model, seed)
    if known is not None and "m" not in model:
        p = pretrained(model, p, recordings, known, seed, say)
    random = known is None or "m" in model
    further = () if known is None else faster(model, recordings, known, seed)
    beyond = [one for recording in further for one in stretches(model, recording)]
    horizons = [*(rows for rows in HORIZONS if rows < model.window), model.window]
    result: Descent | None = None
    for rows in horizons:
        last = rows == model.window
        short = replace(model, window=rows, warm_up=min(model.warm_up, rows - 1) if last else 0)
        problem = HybridProblem(short, train, sd, lesson=WindowErrors(short, beyond, sd) if beyond else None)

        def report(step: int, loss: float, held_out: float, rows: int = rows) -> None:
            line = f"{model.name}, seed {seed}: {rows - 1} steps ahead, step {step}, error {np.sqrt(2.0 * loss):.3f}"
            say(f"{line}, held out {np.sqrt(held_out):.3f}", passing=step % _SAID != 0)

        def held_out_error(q: Array, hybrid_problem: HybridProblem = problem) -> float:
            return held_out_of(hybrid_problem.parameters(q))

        descent_result = descend(
            problem, held_out_error, problem.unknowns(p), problem.bounds,
            warm_up=ADAM if random and rows == horizons[0] else 0, steps=STEPS if last else SHORT_STEPS,
            patience=PATIENCE if last else SHORT_STEPS, say=report,
        )  # fmt: skip
        best = problem.parameters(descent_result.x)
        if result is not None and result.held_out[result.best] < descent_result.held_out[descent_result.best]:
            best, descent_result = (
                result.x,
                replace(descent_result, held_out=result.held_out, best=result.best, loss=result.loss),
            )
        result = replace(descent_result, x=best)
        p = best
        if descent_result.status == "interrupted":
            break
    assert result is not None
    return result


def counted(model: HybridModel, stretchs: Sequence[Stretch], how: FitOptions) -> Array:
    """Unit error of each output: as stated, else a share of its spread."""
    spread = []
    for k, name in enumerate(model.outputs):
        finite = np.concatenate([one.outputs[k][np.isfinite(one.outputs[k])] for one in stretchs])
        unit_error = COUNTS * float(np.std(finite)) if len(finite) else np.nan
        spread.append(how.noise.get(name, max(unit_error, 1e-12) if np.isfinite(unit_error) else np.nan))
    if not np.any(np.isfinite(spread)):
        raise BadInput(f"The recordings hold none of {', '.join(model.outputs)}, on which {model.name} is trained.")
    return np.array(spread)


def _noise(model: HybridModel, stretchs: Sequence[Stretch], p: Array) -> Array:
    """Root mean square error of each output over windows of held-out stretches, in its unit."""
    errors = []
    for k in range(len(model.outputs)):
        one = np.full(len(model.outputs), 1e12)  # makes the weight of all other outputs negligible
        one[k] = 1.0
        measured = WindowErrors(model, stretchs, one)
        read = sum(int(np.sum(np.isfinite(item.outputs[k]))) for item in stretchs)
        errors.append(np.sqrt(measured(p) * len(model.outputs)) if read else 0.0)
    return np.array(errors)


@estimated.register(HybridModel)
def _estimated(model: HybridModel, task: FitTask) -> Fit:
    recordings, how, say, pretraining = task.recordings, task.how, task.say, task.pretraining
    if how.solver == "ipopt":
        raise BadInput(
            f"{model.name} is trained with gradients, and training stops by the error on held-out "
            "manoeuvres; omit ‹solver›."
        )
    if task.validate is not None:
        stretches(model, task.validate)  # raises on bad data before the work, not after it
    if isinstance(pretraining, TrainedBefore):
        trained = update_hybrid(pretraining.model, recordings, how, say)
    else:
        trained = fit_network(model, recordings, how, say, pretraining)
    return Fit(
        model=trained.model,
        sd={  # no curvature is computed: the spread over several seeds shows the uncertainty
            p.name: np.full(p.shape, np.nan) for p in trained.model.parameters
        },
        stages=(trained.stage,),
        metrics={},
        seed=task.how.seed,
        data=(),
        mode="early stopping",
        how={
            "stopped_by": list(trained.held_out),
            "errors_over_windows": list(trained.errors),
            **({} if pretraining is None else {"pretrained_from": pretraining.source or pretraining.model.name}),
            **({"pretrained_beyond": pretraining.beyond} if isinstance(pretraining, Pretraining) else {}),
        },
    )


@refused.register(HybridModel)
def _refused(model: HybridModel, option: str) -> str:
    if option == "‹noise›":
        return ""
    return (
        f"{option} cannot be used with {model.name}, which is trained over windows until the error on held-out "
        "manoeuvres rises. Omit it."
    )
