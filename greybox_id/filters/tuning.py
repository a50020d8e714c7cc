"""Tune noise, and optionally parameters, by maximising the likelihood of the readings.

A filter predicts each reading with a variance; the likelihood of all innovations measures how well noise and, if
requested, the model's free parameters fit (prediction errors, Ljung, System Identification, 2nd ed., Sec. 7.2;
Kristensen, Madsen & Jorgensen, Automatica 40, 2004). Gradients come from parallel filters, one for each parameter.

The likelihood depends on readings only: a better one does not always give a better sideslip.

For the uncertainty of parameters that are not tracked, each is moved by its standard deviation and the filter is run
again; the change of the estimates is added to their bands. The filter itself takes the model as certain.

Also: initial sizes of noises, before tuning.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import minimize

from ..base.errors import BadInput, near_or_all
from ..base.shorthands import Array
from ..base.signals import unit_of
from ..base.statistics import white_noise_sd
from ..datasets.recording import Recording
from ..models.motion_model import MotionModel
from ..models.parameter import Parameter, free_places
from .filtering import Filtering, LaidRun
from .state_space import StateSpace

STEP = 1e-5
"""Step of finite differences, in coordinates."""
NOISE_SD = 2.0
"""Prior standard deviation of the logarithm of a noise's size, around its initial size."""
WEAK = 1.0
"""Prior standard deviation of a parameter without a prior, in its logarithm or relative to its usual size."""
FARTHEST = 6.0
"""Largest change of the logarithm of a noise's size."""
FAR_UP = 1e15
"""Cost of parameters with which the filter diverges."""
WIDE = 1e-3
"""Step of finite differences of gradients."""
MOST_STEPS = 80
BLOCK_SECONDS = 5.0
"""Length of blocks of innovations; costs within a block may be correlated."""


@dataclass(frozen=True)
class Coordinate:
    """One entry of p in search coordinates: its logarithm, or its value over its scale.

    Attributes
    ----------
    place : index in p.
    mean, sd : of the coordinate's normal prior.
    scale : divisor of an entry that is not logarithmic; 0 for a logarithmic one.
    low, high : bounds of the coordinate.
    """

    place: int
    mean: float
    sd: float
    scale: float
    low: float
    high: float

    def of(self, value: float) -> float:
        """The coordinate of a value."""
        return float(value / self.scale if self.scale else np.log(value))

    def value(self, coordinate: Array) -> Array:
        """The values of coordinates."""
        return np.asarray(coordinate * self.scale if self.scale else np.exp(coordinate))


@dataclass(frozen=True)
class Tuned:
    """Result of tuning.

    Attributes
    ----------
    p : (parameters,) all entries.
    cost : negative log-likelihood up to a constant, before and after.
    steps : number of steps.
    moves : (k, parameters) principal standard deviations of the model's parameters, as moves of p.
    """

    p: Array
    cost: tuple[float, float]
    steps: int
    moves: Array


def noise_coordinates(
    filtering: Filtering, p: Array, tunable: Sequence[str], floors: Mapping[str, float] | None = None
) -> list[Coordinate]:
    """The given noises as coordinates; a reading's noise is bounded from below by its floor."""
    floors = floors or {}
    begin, names = filtering.space.model.size, filtering.space.noises
    result = []
    for name in tunable:
        place = begin + names.index(name)
        at = float(np.log(p[place]))
        least = floors.get(name.removeprefix("noise_"), 0.0) if name.startswith("noise_") else 0.0
        low = max(at - FARTHEST, min(float(np.log(least)), at)) if least > 0 else at - FARTHEST
        result.append(Coordinate(place, at, NOISE_SD, 0.0, low, at + FARTHEST))
    return result


def model_coordinates(model: MotionModel, tracked: Sequence[str]) -> list[Coordinate]:
    """The model's free scalar parameters that are not tracked, as coordinates."""
    places = free_places(model.parameters)
    return [_coordinate(model[name], place) for name, place in places.items() if name not in tracked]


def tuned(
    filtering: Filtering, runs: Sequence[LaidRun], p: Array, noise: Sequence[Coordinate],
    coordinates: Sequence[Coordinate], say: Callable[[str], None] = lambda line: None,
) -> Tuned:  # fmt: skip
    """Maximise the posterior of noise and parameters."""
    search = _Search(filtering, runs, p, [*noise, *coordinates])
    before = float(filtering.costs(runs, p[None])[0])
    if not np.isfinite(before):
        raise BadInput(
            "The filter diverges before anything is tuned: check units and signs (greybox data check) and the "
            "numbers of the vehicle, or track fewer parameters."
        )
    say(f"tuning the size of {len(noise)} noises" + (f" and {len(coordinates)} parameters" if coordinates else ""))
    result = minimize(
        search.surprise, np.array([c.of(p[c.place]) for c in search.coordinates]), jac=True, method="L-BFGS-B",
        bounds=[(c.low, c.high) for c in search.coordinates], options={"maxiter": MOST_STEPS, "maxcor": 30},
    )  # fmt: skip
    best = search.placed(result.x[None])[0]
    moves = np.empty((0, len(p)))
    if coordinates:
        values, vectors = np.linalg.eigh(search.spread(result.x)[len(noise) :, len(noise) :])
        axes = (vectors * np.sqrt(np.maximum(values, 0.0))).T
        points = result.x + np.hstack([np.zeros((len(axes), len(noise))), axes])
        moves = search.placed(points) - best
    return Tuned(best, (before, float(filtering.costs(runs, best[None])[0])), int(result.nit), moves)


def _coordinate(parameter: Parameter, place: int) -> Coordinate:
    value, (low, high) = float(parameter.array), parameter.bounds
    positive = low >= 0 and value > 0
    sd = float(np.asarray(parameter.prior.sd)) if parameter.prior is not None else np.inf
    mean = (
        float(np.asarray(parameter.prior.mean))
        if parameter.prior is not None and parameter.prior.mean is not None
        else value
    )
    if positive:
        believed = sd / mean if np.isfinite(sd) else WEAK
        return Coordinate(place, float(np.log(mean)), believed, 0.0, np.log(max(low, 1e-12)), np.log(high))
    scale = sd if np.isfinite(sd) else max(abs(value), 0.01)
    return Coordinate(place, mean / scale, 1.0 if np.isfinite(sd) else WEAK, scale, low / scale, high / scale)


@dataclass(frozen=True)
class _Search:
    """The likelihood as a function of the coordinates.

    Attributes
    ----------
    filtering, runs : the filter and its data.
    p : all entries; those that are not searched stay at these values.
    coordinates : the searched entries.
    """

    filtering: Filtering
    runs: Sequence[LaidRun]
    p: Array
    coordinates: Sequence[Coordinate]

    @cached_property
    def mean(self) -> Array:
        """Prior means of the coordinates."""
        return np.array([c.mean for c in self.coordinates])

    @cached_property
    def sd(self) -> Array:
        """Prior standard deviations of the coordinates."""
        return np.array([c.sd for c in self.coordinates])

    def placed(self, points: Array) -> Array:
        """All entries of p, (L, parameters), at points (L, coordinates)."""
        result = np.tile(self.p, (len(points), 1))
        for column, c in zip(points.T, self.coordinates, strict=True):
            result[:, c.place] = c.value(column)
        return result

    def surprise(self, point: Array) -> tuple[float, Array]:
        """Negative log-posterior up to a constant, and its gradient."""
        around = point + STEP * np.vstack([np.zeros(len(point)), np.eye(len(point))])
        costs = self.filtering.costs(self.runs, self.placed(around))
        deviations = (point - self.mean) / self.sd
        slope, cost = (
            (costs[1:] - costs[0]) / STEP + deviations / self.sd,
            costs[0] + 0.5 * float(deviations @ deviations),
        )
        if not (np.isfinite(cost) and np.all(np.isfinite(slope))):
            return FAR_UP, np.zeros_like(slope)
        return float(cost), slope

    def spread(self, point: Array) -> Array:
        """Covariance of the coordinates at the optimum.

        The curvature measures the precision of the likelihood; the scatter of the scores of blocks exceeds it if the
        model is not the vehicle (sandwich). No direction has a larger variance than its prior.
        """
        ahead, behind = (
            np.array([self.surprise(point + sign * WIDE * e)[1] for e in np.eye(len(point))]) for sign in (1, -1)
        )
        H = (
            (ahead - behind) / (2 * WIDE) * self.sd * self.sd[:, None]
        )  # in units of the prior's standard deviation, in which the prior's curvature is 1
        values, vectors = np.linalg.eigh((H + H.T) / 2)
        inverse = (vectors / np.maximum(values, 1.0)) @ vectors.T
        block_costs = self._blocks(point)
        scores = np.array([(self._blocks(point + STEP * e) - block_costs) / STEP for e in np.eye(len(point))])
        scores *= self.sd[:, None]
        values, vectors = np.linalg.eigh(inverse + inverse @ (scores @ scores.T) @ inverse)
        return np.asarray((vectors * np.clip(values, 0.0, 1.0)) @ vectors.T * self.sd * self.sd[:, None])

    def _blocks(self, point: Array) -> Array:
        return _block_costs(self.filtering, self.runs, self.placed(point[None])[0])


def _block_costs(filtering: Filtering, runs: Sequence[LaidRun], p: Array) -> Array:
    """Cost of each block of readings."""
    blocks = []
    for run, history in zip(runs, filtering.histories(runs, p), strict=True):
        variance = np.maximum(history.spread, history.off**2 / filtering.gate**2)
        cost = np.nansum(0.5 * (history.off**2 / variance + np.log(variance)), axis=1)
        elapsed = np.concatenate(([0.0], np.cumsum(run.segments[:-1, 0])))
        number = (elapsed // BLOCK_SECONDS).astype(int)
        blocks.append(np.bincount(number, weights=cost))
    return np.concatenate(blocks)


def beginning(runs: Sequence[LaidRun], seconds: float) -> list[LaidRun]:
    """The first seconds of several runs; at least some of the first run."""
    result: list[LaidRun] = []
    left = seconds
    for run in runs:
        if left <= 0 and result:
            break
        result.append(run.first(left))
        left -= float(run.run.time[-1] - run.run.time[0])
    return result


def believed(space: StateSpace, size: int) -> Array:
    """(k, size) one standard deviation of every free parameter with a prior, as moves of p; without tracked ones."""
    moves_of_p = []
    tracked = {item.name for item in space.tracked}
    for parameter in space.model.parameters:
        if parameter.shape != () or parameter.prior is None or parameter.fixed or parameter.name in tracked:
            continue
        sd, value, (low, high) = float(np.asarray(parameter.prior.sd)), float(parameter.array), parameter.bounds
        step = sd if value + sd <= high else -sd
        if 0 < sd < np.inf and low <= value + step <= high:
            move = np.zeros(size)
            move[space.place(parameter.name)] = step
            moves_of_p.append(move)
    return np.array(moves_of_p).reshape(len(moves_of_p), size)


def padded(space: StateSpace, uncertain: Array, size: int) -> Array:
    """Moves of the model's parameters as moves of p; zero for tracked ones."""
    result = np.zeros((len(uncertain), size))
    result[:, : uncertain.shape[1]] = uncertain
    result[:, [space.place(item.name) for item in space.tracked]] = 0.0
    return result


PER_ROOT_SECOND = 0.1
"""Default random walk in one root second: of a state relative to its scale, of a tracked parameter to its sd."""
FORCE_WALK = 1.0
"""The same for a parameter that replaces an input or a quantity of the equations: it may change within a second."""
MEMORY = 5.0
"""Default time constant of a disturbance, s."""
COLOUR_MEMORY = 1.0
LEAST_NOISE = 1e-3
"""Noise of a reading that never changes."""
STEPPED, SURE = 0.2, 0.2
"""Share of distinct values among rows below which a reading is quantised; smallest share of the scatter between
neighbouring rows that is noise."""


@dataclass(frozen=True)
class NoiseLevels:
    """Sizes of a state space's noises.

    Attributes
    ----------
    values : (noises,) in their order.
    open : names of those that are not stated and that readings inform.
    """

    values: Array
    open: tuple[str, ...]


def start_levels(
    space: StateSpace, scatter: Mapping[str, float], read: Sequence[str], stated: Mapping[str, float]
) -> NoiseLevels:
    """Initial sizes: as stated, else from the scatter of readings, else usual ones.

    Parameters
    ----------
    space : the state space.
    scatter : reading -> standard deviation of its noise in the recording (`scatter_of`).
    read : readings that are used.
    stated : name of a noise -> its size.

    Raises
    ------
    BadInput : a stated name is none of the noises, or its size is not above zero.
    """
    for name, size in stated.items():
        if name not in space.noises:
            raise BadInput(f"There is no noise {name}.{near_or_all(name, space.noises)}")
        if not 0 < size < np.inf:
            raise BadInput(f"The noise {name} = {size:g} must be a number above zero.")
    sizes = {name: stated.get(name, _usual(space, name, scatter)) for name in space.noises}
    unread = {f"noise_{name}" for name in space.model.outputs if name not in read}
    return NoiseLevels(
        np.array([sizes[name] for name in space.noises]),
        tuple(name for name in space.noises if name not in stated and name not in unread),
    )


def origins(space: StateSpace, stated: Mapping[str, float], tuned: Sequence[str]) -> dict[str, str]:
    """Noise -> origin of its size: stated, tuned or guessed."""
    return {name: "stated" if name in stated else "tuned" if name in tuned else "guessed" for name in space.noises}


def units(space: StateSpace) -> dict[str, str]:
    """Noise -> SI unit of its size; for random walks it is per root second, and relative for logarithmic ones."""
    of_states = {item.name: "1" if item.logarithmic else item.unit for item in space.tracked}
    of_states = {state.name: state.unit for state in space.model.states} | of_states
    result = {}
    for name in space.noises:
        kind, _, of = name.partition("_")
        result[name] = "s" if kind == "memory" else of_states.get(of, unit_of(of)) if kind == "walk" else unit_of(of)
    return result


def scatter_of(recording: Recording, read: Sequence[str]) -> dict[str, float]:
    """Standard deviations of readings' noise, from the deviation of each from the line between its neighbours."""
    return {name: _scatter(recording[name]) for name in read}


def resolution_of(recording: Recording, read: Sequence[str]) -> dict[str, float]:
    """Smallest plausible noise of each reading, standard deviation, from its resolution in a recording.

    A quantised reading has an error of its step over the root of twelve; and the scatter between neighbouring rows
    (`scatter_of`) is noise unless the vehicle itself moves so fast: at least a fifth of it counts as noise.
    """
    result = {}
    for name, scatter in scatter_of(recording, read).items():
        values = np.unique(recording[name][np.isfinite(recording[name])])
        steps = np.diff(values)
        steps = steps[steps > 1e-9 * max(float(np.ptp(values)), 1e-300)] if len(values) > 1 else steps
        quantised = len(values) < STEPPED * len(recording) and len(steps) > 0
        step = float(np.median(steps)) if quantised else 0.0
        result[name] = max(step / np.sqrt(12.0), SURE * scatter)
    return result


def _usual(space: StateSpace, name: str, scatter: Mapping[str, float]) -> float:
    kind, _, of = name.partition("_")
    if kind == "noise":
        return scatter.get(of, 1.0)
    if kind == "colour":
        return 0.3 * scatter.get(of, 1.0)
    tracked = next((one for one in space.tracked if one.name == of), None)
    if kind == "memory":
        return MEMORY if tracked is not None else COLOUR_MEMORY
    if tracked is None:
        return PER_ROOT_SECOND * next(state.scale for state in space.model.states if state.name == of)
    replaces = of in space.model.inputs or of in space.model.quantities
    return (FORCE_WALK if replaces and not tracked.logarithmic else PER_ROOT_SECOND) * tracked.start_sd


def _scatter(values: Array) -> float:
    values = np.where(np.isfinite(values), values, np.nan)
    result = white_noise_sd([values], held=True)
    return LEAST_NOISE if np.isnan(result) else max(result, 1e-6 * max(1.0, float(np.nanstd(values))))
