"""Train hybrid models: on some manoeuvres, with early stopping by the others."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..base.errors import BadInput
from ..base.processes import apart, side_by_side
from ..base.shorthands import Array
from ..base.signals import SIGNALS
from ..datasets.recording import Recording
from ..engine.hybrid.problem import HybridProblem, SquaredErrors, WindowErrors, drawn
from ..engine.hybrid.stretches import Stretch, noise, stretches
from ..engine.solvers.quasi_newton import Descent, descend
from ..models.hybrid_model import HybridModel
from ..models.parameter import Parameter
from .how import FitOptions, Say, quiet
from .provenance import Stage

HELD_OUT = 0.2
"""Share of the manoeuvres held out for early stopping."""
PIECES = 5
"""In a continued training, one of this many pieces is held out: a fifth, as of manoeuvres, all along a run."""
WARM_UP, STEPS, PATIENCE = 60, 300, 60
_SAID = 10
"""Steps between lines of progress."""


@dataclass(frozen=True)
class Trained:
    """A trained hybrid model.

    Attributes
    ----------
    model : the model, at its estimates.
    stage : record of the training; its noise is that of the readings, which weights errors.
    held_out : names of the held-out runs.
    errors : root mean square errors over windows, in units of noise (the paper's RMSSE), training and held out.
    """

    model: HybridModel
    stage: Stage
    held_out: tuple[str, ...]
    errors: tuple[float, float]


@dataclass(frozen=True)
class TrainedBefore:
    """A trained hybrid model whose training is continued.

    Attributes
    ----------
    model : the trained model.
    source : its file, for messages.
    """

    model: HybridModel
    source: str = ""


def update_hybrid(model: HybridModel, recordings: Sequence[Recording], how: FitOptions, say: Say) -> Trained:
    """Continue the training of a hybrid model, on recordings of a vehicle with other tyres.

    The parameters by which vehicles differ (`HybridModel.carried_on`) are estimated, with priors around their values;
    weights stay fixed. When weights were free, they memorised one manoeuvre and spun in others. Every fifth piece of
    two windows is held out for early stopping; a model that fits these best as it is stays unchanged. The recordings of
    the earlier training are not needed.

    Parameters
    ----------
    model : the trained model.
    recordings : of the changed vehicle.
    how : known noise; one start.

    Raises
    ------
    BadInput : as `fit_network`; there are fewer than `PIECES` pieces, or several starts, or nothing to estimate.
    """
    if how.starts > 1:
        raise BadInput(f"A continued training of {model.name} starts at the numbers of its fit; omit ‹starts›.")
    if not model.carried_on:
        raise BadInput(f"{model.name} marks no parameter as differing between vehicles; train it anew.")
    clock = time.process_time()
    named = manoeuvres(model, recordings)
    length = 2 * model.window - model.warm_up
    pieces = [_rows(one, k, k + length) for _, one in named for k in range(0, len(one) - length + 1, length)]
    if len(pieces) < PIECES:
        raise BadInput(
            f"Continuing the training of {model.name} needs {PIECES} pieces of {length} unbroken rows; there are "
            f"{len(pieces)}. Record more."
        )
    held_out = pieces[PIECES // 2 :: PIECES]
    sd = read_noise(model, [one for _, one in named], how)
    train = [one for k, one in enumerate(pieces) if k % PIECES != PIECES // 2]
    model_freed = model.with_parameters(*(_carried_on(p, model.carried_on) for p in model.parameters))
    problem, outside = HybridProblem(model_freed, train, sd), WindowErrors(model, held_out, sd)
    return trained_best(
        model, how, say, clock, lambda seed, item: descent(problem, outside, model, seed, item, model.values),
        problem.errors, outside, lambda _: sd, (f"every fifth of {len(pieces)} pieces of {length} rows",),
    )  # fmt: skip


def _carried_on(parameter: Parameter, moving: Sequence[str]) -> Parameter:
    """The parameter free with its prior around its value, or fixed."""
    if parameter.name not in moving:
        return replace(parameter, fixed=True)
    return replace(parameter, fixed=False, prior=parameter.prior and replace(parameter.prior, mean=None))


def trained_best(
    model: HybridModel, how: FitOptions, say: Say, clock: float, train: Callable[[int, Say], Descent],
    inside: SquaredErrors, outside: SquaredErrors, noise_of: Callable[[Array], Array], held_out: tuple[str, ...],
) -> Trained:  # fmt: skip
    """The training with the lowest held-out error of several, with the record of all.

    Parameters
    ----------
    clock : processor time at the beginning.
    train : (seed, progress) -> a training, whose x are the model's parameters.
    inside, outside : errors on training and held-out data.
    noise_of : parameters -> noise of the readings.
    held_out : names of the held-out runs.
    """
    away = apart(how.starts, how.jobs)

    def report(k: int, one: Descent) -> bool:
        if away:
            error = np.sqrt(one.held_out[one.best])
            say(f"{model.name}, seed {how.seed + k}: {one.status}, held out {error:.3f}")
        return one.status != "interrupted"

    done = side_by_side(lambda k: train(how.seed + k, quiet if away else say), how.starts, how.jobs, report)
    best = min(done.results, key=lambda each: each.held_out[each.best])
    stage = Stage(
        model=model.name, closed_loop=True, status=best.status, converged=best.converged, steps=best.best,
        history=best.loss, starts=tuple(sorted(each.held_out[each.best] for each in done.results)), strengths={},
        strengths_from="early stopping", tried=(),
        noise=dict(zip(model.outputs, noise_of(best.x).tolist(), strict=True)),
        cpu_seconds=time.process_time() - clock + done.cpu_seconds, cross_validation_seconds=0.0,
    )  # fmt: skip
    errors = (float(np.sqrt(inside(best.x))), float(np.sqrt(outside(best.x))))
    return Trained(model.with_values(best.x), stage, held_out, errors)


def descent(
    problem: HybridProblem, outside: WindowErrors, model: HybridModel, seed: int, say: Say, begin: Array | None = None
) -> Descent:
    """A training from random weights, or from those of a trained model, without warm-up.

    Its x are the model's parameters.
    """

    def report(step: int, loss: float, held_out: float) -> None:
        line = f"{model.name}, seed {seed}: step {step}, held-out error {np.sqrt(2.0 * loss):.3f} times the noise "
        say(line + f"{np.sqrt(held_out):.3f}", passing=step % _SAID != 0)

    start = problem.unknowns(drawn(model, seed) if begin is None else begin)
    result = descend(
        problem, lambda q: outside(problem.parameters(q)), start, problem.bounds,
        warm_up=WARM_UP if begin is None else 0, steps=STEPS, patience=PATIENCE, say=report,
    )  # fmt: skip
    return replace(result, x=problem.parameters(result.x))


def manoeuvres(model: HybridModel, recordings: Sequence[Recording]) -> list[tuple[str, Stretch]]:
    """Unbroken runs at least as long as a window, with names."""
    return [
        (f"{recording.name}, rows {one.rows.start} to {one.rows.stop - 1}", one)
        for recording in recordings
        for one in stretches(model, recording)
        if len(one) >= model.window
    ]


def split(
    named: Sequence[tuple[str, Stretch]], model: HybridModel, seed: int
) -> tuple[list[Stretch], list[Stretch], tuple[str, ...]]:
    """Stretches for training, held-out ones for early stopping, and the names of the latter."""
    if not named:
        raise BadInput(
            f"No unbroken stretch of the recordings is as long as a window of {model.name}, {model.window} rows, with "
            f"all of {', '.join(model.inputs)} present; set window and warm_up to fewer rows."
        )
    if len(named) == 1:
        name, single = named[0]
        cut = int((1.0 - HELD_OUT) * len(single))
        if len(single) - cut < model.window:
            raise BadInput(
                f"The only unbroken stretch has {len(single)} rows; its last fifth, which says when to stop, is "
                f"shorter than a window of {model.name}, {model.window} rows. Name more recordings."
            )
        return [_rows(single, 0, cut)], [_rows(single, cut, len(single))], (f"{name}, the last fifth",)
    count = max(int(round(HELD_OUT * len(named))), 1)
    chosen = set(np.random.default_rng((seed, 613)).permutation(len(named))[:count].tolist())
    train = [one for k, (_, one) in enumerate(named) if k not in chosen]
    return train, [named[k][1] for k in sorted(chosen)], tuple(named[k][0] for k in sorted(chosen))


def _rows(whole: Stretch, start: int, stop: int) -> Stretch:
    first = whole.rows.start
    return Stretch(
        slice(first + start, first + stop), whole.sample_time,
        whole.inputs[:, start:stop], whole.outputs[:, start:stop], whole.states[:, start:stop],
    )  # fmt: skip


def mirrored(model: HybridModel, one: Stretch) -> Stretch:
    """The same drive with left and right swapped."""

    def flips(names: Sequence[str]) -> Array:
        return np.array([[-1.0 if name in SIGNALS and SIGNALS[name].mirrors else 1.0] for name in names])

    inputs, states = flips(model.inputs), flips([state.name for state in model.states])
    return replace(
        one,
        inputs=np.concatenate((inputs, inputs)) * one.inputs,
        outputs=flips(model.outputs) * one.outputs,
        states=states * one.states,
    )


def read_noise(model: HybridModel, stretchs: Sequence[Stretch], how: FitOptions) -> Array:
    """Standard deviation of each output's readings: as stated, else estimated from them."""
    sd = noise(stretchs)
    for k, name in enumerate(model.outputs):
        read = np.concatenate([one.outputs[k][np.isfinite(one.outputs[k])] for one in stretchs])
        if name in how.noise:
            sd[k] = how.noise[name]
        elif len(read):  # at least a thousandth of the spread, so that a noiseless signal does not outweigh all others
            sd[k] = np.fmax(sd[k], 1e-3 * max(float(np.std(read)), 1e-12))
    if not np.any(np.isfinite(sd)):
        raise BadInput(f"The recordings hold none of {', '.join(model.outputs)}, on which {model.name} is trained.")
    return sd
