"""Pretraining of a network on a known vehicle: the derivatives of its states, at many points.

Points are rows of the recordings ("data", as published), or spread over a box 1.3 times as wide ("box"), cut where the
lateral acceleration yaw_rate v_x is more than 1.3 times that of the recordings: this teaches the edges. At every point
the derivatives are computed for several draws of the vehicle's parameters; their mean is the target, and where they
differ the network is fitted less tightly.

Source: "Physics-guided approach with transfer learning in vehicle lateral dynamics", Sec. III.D.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from ..base.errors import BadInput, must_be_one_of, must_be_whole
from ..base.shorthands import Array
from ..datasets.recording import Recording
from ..engine.hybrid.problem import HybridProblem, RateErrors
from ..engine.motion.simulator import Predictor, Simulator
from ..engine.solvers.quasi_newton import descend
from ..models.hybrid_model import HybridModel
from ..models.motion_model import MotionModel
from ..models.parameter import Prior, placed
from .how import Say

Span = Literal["data", "box"]
WIDER = 1.3
AT_A_POINT = 8
"""Draws simulated at every point."""
SUBSTEPS = 4
DERIVATIVE = 1e-5
"""s over which a derivative is a difference quotient, if the network predicts derivatives, not increments."""
SETTLED = 0.05
"""Unit error of the derivatives, as a share of their spread: smaller errors are left to training on the recordings."""
HELD_OUT = 0.1
ADAM, STEPS, PATIENCE = 100, 300, 60


@dataclass(frozen=True)
class Pretraining:
    """A known vehicle for pretraining.

    Attributes
    ----------
    model : its equations of motion.
    draws : (n, parameters) vectors of its parameters.
    points : number of points at which the network learns its derivatives.
    span : region of these points.
    source : file of the vehicle, for messages.
    beyond : largest speed taught by the vehicle during training on the recordings, relative to the fastest recorded
        one; 1, as published: none, so that training may forget what pretraining taught about higher speeds.
    """

    model: MotionModel
    draws: Array
    points: int = 20_000
    span: Span = "data"
    source: str = ""
    beyond: float = 1.0

    def __post_init__(self) -> None:
        must_be_one_of(get_args(Span), self.span, "‹pretrain_range›: there is no")
        must_be_whole(self.points, "pretrain_points", 100, 1_000_000)
        if isinstance(self.beyond, bool) or not 1.0 <= self.beyond <= 3.0:
            raise BadInput(f"‹pretrain_beyond›: a number from 1 to 3 is needed, not {self.beyond!r:.40}.")


def known_physics(model: HybridModel, known: Pretraining) -> HybridModel:
    """The model with its physical parameters at the mean of the draws; their spread is the prior of the free ones.

    Raises
    ------
    BadInput : the known vehicle has none of these parameters.
    """
    mean, sd = np.mean(known.draws, axis=0), np.std(known.draws, axis=0)
    changed = []
    for parameter, place in placed(known.model.parameters):
        if parameter.shape == () and parameter.name in model and parameter.name not in model.network.shapes:
            parameter_of_model = model[parameter.name]
            low, high = (
                min(parameter_of_model.bounds[0], parameter.bounds[0]),
                max(parameter_of_model.bounds[1], parameter.bounds[1]),
            )
            value, spread = np.array(float(mean[place.start])), float(sd[place.start])
            prior = (
                Prior(spread, mean=value) if spread > 0 and not parameter_of_model.fixed else parameter_of_model.prior
            )
            changed.append(replace(parameter_of_model, value=value, bounds=(low, high), prior=prior))
    if not changed:
        raise BadInput(
            f"{known.source or known.model.name} has none of the parameters of the physics in {model.name}: "
            f"pretrain {model.name} from a fit of lateral or single_track with Pacejka's tyres."
        )
    return model.with_parameters(*changed)


def pretrained(
    model: HybridModel, start: Array, recordings: Sequence[Recording], known: Pretraining, seed: int, say: Say
) -> Array:
    """A parameter vector whose network predicts the derivatives of a known vehicle.

    Parameters
    ----------
    model : the network's model.
    start : (parameters,) start of the pretraining.
    recordings : training data, whose range determines the points.
    known : the vehicle.
    seed : seed of the points.
    say : receives progress.

    Raises
    ------
    BadInput : the recordings lack an input of the known vehicle, or it is finite nowhere.
    """
    x, u, rates, scale = taught(model, recordings, known, seed)
    count = x.shape[1]
    held_out_count = int(HELD_OUT * count)
    errors, outside = (
        RateErrors(model, x[:, rows], u[:, rows], rates[:, rows], scale[:, rows])
        for rows in (slice(held_out_count, None), slice(held_out_count))
    )
    problem = HybridProblem(model, (), np.ones(len(rates)), errors)

    def report(step: int, loss: float, held_out: float) -> None:
        del loss
        say(
            f"{model.name}: pretraining, step {step}, held-out error of the state's derivatives "
            f"{np.sqrt(held_out):.3f}",
            passing=True,
        )

    result = descend(
        problem, lambda q: outside(problem.parameters(q)), problem.unknowns(start), problem.bounds,
        warm_up=ADAM, steps=STEPS, patience=PATIENCE, say=report,
    )  # fmt: skip
    if result.status == "interrupted":
        raise KeyboardInterrupt
    off = SETTLED * np.sqrt(result.held_out[result.best])
    say(f"{model.name}: pretrained; the error of the state's derivatives is {100 * off:.1f} % of their spread")
    return problem.parameters(result.x)


def faster(model: HybridModel, recordings: Sequence[Recording], known: Pretraining, seed: int) -> tuple[Recording, ...]:
    """The recordings as the known vehicle would have driven them at higher speeds.

    Every run is scaled in speed so that its fastest speed is between the fastest recorded one and `beyond` times that,
    with steering reduced so that lateral accelerations stay similar; a run ends where its lateral acceleration is well
    above all recorded ones. Every run has its own draw of the parameters.

    Raises
    ------
    BadInput : the recordings lack an input of the known vehicle.
    """
    if known.beyond <= 1.0:
        return ()
    states = [state.name for state in model.states]
    vehicle = known.model
    if not {"v_x", "steer"} <= set(vehicle.inputs):
        raise BadInput(
            f"‹pretrain_beyond›: {known.source or vehicle.name} does not have v_x and steer as its inputs. Pretrain "
            f"from a fit of "
            "lateral, or omit it."
        )
    _must_predict(vehicle, states, vehicle.outputs, model)
    for recording in recordings:
        recording.require((*vehicle.inputs, "yaw_rate"), "pretraining at higher speeds (‹pretrain_beyond›)")
    random = np.random.default_rng((seed, 7103))
    top = max(float(np.nanmax(recording["v_x"])) for recording in recordings)
    most = WIDER * max(float(np.nanmax(np.abs(recording["v_x"] * recording["yaw_rate"]))) for recording in recordings)
    simulator, result = Simulator(vehicle), []
    for recording in recordings:
        factor = np.ones(len(recording))
        for start, stop in recording.runs:
            fastest = float(np.nanmax(recording["v_x"][start:stop], initial=model.sample_time))
            factor[start:stop] = top * random.uniform(1.0, known.beyond) / fastest
        driven = recording.with_signals(v_x=factor * recording["v_x"], steer=recording["steer"] / factor**2)
        simulated = {name: np.full(len(recording), np.nan) for name in states}
        draws = known.draws[random.integers(len(known.draws), size=min(AT_A_POINT, len(known.draws)))]
        for k, p in enumerate(draws):
            run = Predictor(simulator, driven, p).free_run()
            of_draw = run.run % len(draws) == k
            for name in states:
                simulated[name][run.rows[of_draw]] = run.predicted[of_draw, vehicle.outputs.index(name)]
        for start, stop in recording.runs:
            with np.errstate(invalid="ignore"):
                beyond = ~(np.abs(driven["v_x"][start:stop] * simulated["yaw_rate"][start:stop]) <= most)
            for name in states:
                simulated[name][start:stop][np.logical_or.accumulate(beyond)] = np.nan
        result.append(driven.with_signals(**simulated))
    return tuple(result)


def taught(
    model: HybridModel, recordings: Sequence[Recording], known: Pretraining, seed: int
) -> tuple[Array, Array, Array, Array]:
    """States, inputs and derivatives at points, (states or inputs, n), and unit errors of the derivatives."""
    vehicle = known.model
    states = [state.name for state in model.states]
    names = list(dict.fromkeys((*states, *model.inputs, *vehicle.inputs, *(s.name for s in vehicle.states))))
    names = [name for name in names if name in (*states, *model.inputs, *vehicle.inputs) or _recorded(name, recordings)]
    rows = []
    for recording in recordings:
        for name in names:
            if name not in recording and model.read(name, recording) is None:
                raise BadInput(
                    f"{recording.name} lacks {name}, which pretraining from {known.source or vehicle.name} reads. "
                    "Pretrain from a fit whose inputs are recorded."
                )
        table = np.array([recording[n] if n in recording else model.read(n, recording) for n in names])
        rows.append(table[:, np.all(np.isfinite(table), axis=0)])
    data = np.concatenate(rows, axis=1)
    for name, least in model.least.items():
        data = data[:, data[names.index(name)] >= least]
    if data.shape[1] == 0:
        raise BadInput(f"No row of {recordings[0].name} has all of {', '.join(names)}.")
    random = np.random.default_rng((seed, 4801))
    points = _chosen(data, names, known, random)
    measured = tuple(state.name for state in vehicle.states if state.name in names and state.name in vehicle.outputs)
    _must_predict(vehicle, states, measured, model)
    h = DERIVATIVE if model.integrator != "euler" else model.sample_time
    simulator = Simulator(vehicle)
    simulator.kernel.prepare()
    each = []
    draws = known.draws[random.permutation(len(known.draws))]
    for k in range(min(AT_A_POINT, len(draws))):
        p = draws[(k + np.arange(points.shape[1]) * AT_A_POINT) % len(draws)]
        each.append(_rates(simulator, names, points, measured, states, p, h))
    rates_of_draws = np.array(each)
    good = np.all(np.isfinite(rates_of_draws), axis=(0, 1))
    if not np.any(good):
        raise BadInput(
            f"{vehicle.name} is not finite at any point of the recordings at these parameters. Fit it again."
        )
    mean, spread = np.mean(rates_of_draws[:, :, good], axis=0), np.std(rates_of_draws[:, :, good], axis=0)
    unit = SETTLED * np.std(mean, axis=1, keepdims=True)
    scale = np.sqrt(np.where(unit > 0, unit, 1.0) ** 2 + spread**2)
    index = [names.index(name) for name in states], [names.index(name) for name in model.inputs]
    return points[index[0]][:, good], points[index[1]][:, good], mean, scale


def _must_predict(vehicle: MotionModel, states: Sequence[str], known: Sequence[str], model: HybridModel) -> None:
    if not set(states) <= set(known):
        raise BadInput(f"{vehicle.name} does not predict {' and '.join(states)}, which {model.name} is to learn.")


def _recorded(name: str, recordings: Sequence[Recording]) -> bool:
    return all(name in recording for recording in recordings)


def _chosen(data: Array, names: Sequence[str], known: Pretraining, random: np.random.Generator) -> Array:
    """(names, points) drawn from the data with replacement, or spread over a wider box."""
    if known.span == "data":
        return data[:, random.integers(data.shape[1], size=known.points)]
    low, high = np.min(data, axis=1, keepdims=True), np.max(data, axis=1, keepdims=True)
    middle, half = (low + high) / 2, WIDER * (high - low) / 2
    result = np.empty((len(names), 0))
    speed, turn = names.index("v_x"), names.index("yaw_rate")
    most = WIDER * np.max(np.abs(data[speed] * data[turn]))
    while result.shape[1] < known.points:
        value = middle + half * random.uniform(-1.0, 1.0, (len(names), known.points))
        value[speed] = np.maximum(value[speed], low[speed])
        result = np.concatenate([result, value[:, np.abs(value[speed] * value[turn]) <= most]], axis=1)
    return result[:, : known.points]


def _rates(
    simulator: Simulator,
    names: Sequence[str],
    points: Array,
    measured: tuple[str, ...],
    states: Sequence[str],
    p: Array,
    h: float,
) -> Array:
    """(states, n) change of the states' readings over h seconds with constant inputs, divided by h."""
    trace = simulator.trace
    model, count = trace.model, points.shape[1]
    readings = points[[names.index(name) for name in measured]].T
    inputs = points[[names.index(name) for name in model.inputs]].T
    z0, _ = simulator.start(measured, np.ascontiguousarray(readings), np.ascontiguousarray(inputs), p)
    segments = np.zeros((count, SUBSTEPS + 1, trace.segment_size))
    segments[:, :SUBSTEPS, 0] = h / SUBSTEPS
    segments[:, :, 1 : 1 + inputs.shape[1]] = inputs[:, None]
    if trace.shift_count:
        segments[:, :, -trace.shift_count :] = simulator.shifts(p[0])
    reads = np.zeros(SUBSTEPS + 1, dtype=bool)
    reads[[0, -1]] = True
    with np.errstate(all="ignore"):
        _, y = simulator.kernel.simulate(z0, segments, p, reads)
    index = [model.outputs.index(name) for name in states]
    return np.asarray(((y[:, 1] - y[:, 0]) / h)[:, index].T)
