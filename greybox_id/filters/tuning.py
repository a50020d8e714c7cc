"""Noise from the data: the numbers under which what was read is least surprising.

A filter predicts each reading with a variance; the likelihood of all innovations together says how well noise and, if
asked, the model's own free parameters fit (prediction errors, Ljung, System Identification, 2nd ed., Sec. 7.2;
Kristensen, Madsen & Jorgensen, Automatica 40, 2004). Gradients come from filters side by side, one for each number.

The likelihood knows what was read and nothing else: a better one is not always a better sideslip.

What is uncertain of a model besides what walks in it is moved by its standard deviation, the filter is run again, and
what the estimates owe to it joins their bands. The filter itself takes the model as certain.

Where the sizes of noises start from, before they are tuned.
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
"""Of differences, in the coordinates below."""
NOISE_SD = 2.0
"""What is believed of a noise: its logarithm within so much of where it starts, one standard deviation."""
WEAK = 1.0
"""Prior of a parameter that nothing is stated of, in its logarithm or in its usual size."""
FARTHEST = 6.0
"""No noise moves further than this, in its logarithm."""
FAR_UP = 1e15
"""Cost of numbers with which the filter diverges."""
WIDE = 1e-3
"""Of differences of slopes."""
MOST_STEPS = 80
BLOCK_SECONDS = 5.0
"""Surprises within so many seconds may depend on each other."""


@dataclass(frozen=True)
class Coordinate:
    """One number of p, as it is searched: its logarithm, or itself over its scale.

    Attributes
    ----------
    place : in p.
    mean, sd : what is believed of the coordinate.
    scale : of a number that is searched itself; 0 where it is its logarithm.
    low, high : of the coordinate.
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
    """What tuning found.

    Attributes
    ----------
    p : (parameters,) all numbers.
    cost : half of minus two log-likelihoods, constants left out, before and after.
    steps : taken.
    moves : (k, parameters) principal standard deviations of the model's own parameters, as moves of p.
    """

    p: Array
    cost: tuple[float, float]
    steps: int
    moves: Array


def noise_coordinates(
    filtering: Filtering, p: Array, tunable: Sequence[str], floors: Mapping[str, float] | None = None
) -> list[Coordinate]:
    """The noises by these names, none of a reading below its floor."""
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
    """The model's free single parameters that are not tracked."""
    free = free_places(model.parameters)
    return [_coordinate(model[name], place) for name, place in free.items() if name not in tracked]


def tuned(
    filtering: Filtering, runs: Sequence[LaidRun], p: Array, noise: Sequence[Coordinate],
    coordinates: Sequence[Coordinate], say: Callable[[str], None] = lambda line: None,
) -> Tuned:  # fmt: skip
    """The most likely numbers, near what is believed of them."""
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
        moved = result.x + np.hstack([np.zeros((len(axes), len(noise))), axes])
        moves = search.placed(moved) - best
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
    """The likelihood in coordinates.

    Attributes
    ----------
    filtering, runs : what is filtered.
    p : all numbers, those that are not searched stay there.
    coordinates : of those searched.
    """

    filtering: Filtering
    runs: Sequence[LaidRun]
    p: Array
    coordinates: Sequence[Coordinate]

    @cached_property
    def mean(self) -> Array:
        """What is believed of the coordinates."""
        return np.array([c.mean for c in self.coordinates])

    @cached_property
    def sd(self) -> Array:
        """How well."""
        return np.array([c.sd for c in self.coordinates])

    def placed(self, points: Array) -> Array:
        """All numbers (L, parameters) at points (L, coordinates)."""
        result = np.tile(self.p, (len(points), 1))
        for column, c in zip(points.T, self.coordinates, strict=True):
            result[:, c.place] = c.value(column)
        return result

    def surprise(self, point: Array) -> tuple[float, Array]:
        """Half of minus two log-posteriors, constants left out, and its slope."""
        around = point + STEP * np.vstack([np.zeros(len(point)), np.eye(len(point))])
        costs = self.filtering.costs(self.runs, self.placed(around))
        off = (point - self.mean) / self.sd
        slope, cost = (costs[1:] - costs[0]) / STEP + off / self.sd, costs[0] + 0.5 * float(off @ off)
        if not (np.isfinite(cost) and np.all(np.isfinite(slope))):
            return FAR_UP, np.zeros_like(slope)
        return float(cost), slope

    def spread(self, point: Array) -> Array:
        """Covariance of the coordinates at the best point.

        The curvature says how sharply the likelihood tells them; the scores of blocks, how much they scatter, which is
        more than the curvature says where the model is not the vehicle (sandwich). Nothing is known worse than before.
        """
        ahead, behind = (
            np.array([self.surprise(point + sign * WIDE * e)[1] for e in np.eye(len(point))]) for sign in (1, -1)
        )
        H = (
            (ahead - behind) / (2 * WIDE) * self.sd * self.sd[:, None]
        )  # in units of what was believed, of which it has 1
        values, vectors = np.linalg.eigh((H + H.T) / 2)
        inverse = (vectors / np.maximum(values, 1.0)) @ vectors.T
        here = self._blocks(point)
        scores = np.array([(self._blocks(point + STEP * e) - here) / STEP for e in np.eye(len(point))])
        scores *= self.sd[:, None]
        values, vectors = np.linalg.eigh(inverse + inverse @ (scores @ scores.T) @ inverse)
        return np.asarray((vectors * np.clip(values, 0.0, 1.0)) @ vectors.T * self.sd * self.sd[:, None])

    def _blocks(self, point: Array) -> Array:
        return _block_costs(self.filtering, self.runs, self.placed(point[None])[0])


def _block_costs(filtering: Filtering, runs: Sequence[LaidRun], p: Array) -> Array:
    """What each block of readings adds to the cost."""
    blocks = []
    for run, history in zip(runs, filtering.histories(runs, p), strict=True):
        taken = np.maximum(history.spread, history.off**2 / filtering.gate**2)
        cost = np.nansum(0.5 * (history.off**2 / taken + np.log(taken)), axis=1)
        elapsed = np.concatenate(([0.0], np.cumsum(run.segments[:-1, 0])))
        number = (elapsed // BLOCK_SECONDS).astype(int)
        blocks.append(np.bincount(number, weights=cost))
    return np.concatenate(blocks)


def beginning(runs: Sequence[LaidRun], seconds: float) -> list[LaidRun]:
    """The first seconds of some runs; the first run has its share at least."""
    result: list[LaidRun] = []
    left = seconds
    for run in runs:
        if left <= 0 and result:
            break
        result.append(run.first(left))
        left -= float(run.run.time[-1] - run.run.time[0])
    return result


def believed(space: StateSpace, size: int) -> Array:
    """(k, size) one standard deviation of every free parameter with a prior, as moves of p; what walks left out."""
    moves = []
    tracked = {item.name for item in space.tracked}
    for parameter in space.model.parameters:
        if parameter.shape != () or parameter.prior is None or parameter.fixed or parameter.name in tracked:
            continue
        sd, value, (low, high) = float(np.asarray(parameter.prior.sd)), float(parameter.array), parameter.bounds
        step = sd if value + sd <= high else -sd
        if 0 < sd < np.inf and low <= value + step <= high:
            move = np.zeros(size)
            move[space.place(parameter.name)] = step
            moves.append(move)
    return np.array(moves).reshape(len(moves), size)


def padded(space: StateSpace, uncertain: Array, size: int) -> Array:
    """Moves of the model's parameters as moves of p; what walks is left out."""
    result = np.zeros((len(uncertain), size))
    result[:, : uncertain.shape[1]] = uncertain
    result[:, [space.place(item.name) for item in space.tracked]] = 0.0
    return result


PER_ROOT_SECOND = 0.1
"""A state walks by this share of its scale in the root of a second, and what is tracked by this share of its sd."""
FORCE_WALK = 1.0
"""The same for what takes the place of an input or a quantity of the equations: it may change within a second."""
MEMORY = 5.0
"""How long a disturbance lasts, s."""
COLOUR_MEMORY = 1.0
LEAST_NOISE = 1e-3
"""Noise of a reading that never moves."""
STEPPED, SURE = 0.2, 0.2
"""A reading of which fewer than this share of rows differ goes in steps; share of the scatter between neighbouring rows
that is noise at least."""


@dataclass(frozen=True)
class NoiseLevels:
    """Sizes of a state space's noises.

    Attributes
    ----------
    values : (noises,) in their order.
    open : names of those that nobody stated and readings tell.
    """

    values: Array
    open: tuple[str, ...]


def start_levels(
    space: StateSpace, scatter: Mapping[str, float], read: Sequence[str], stated: Mapping[str, float]
) -> NoiseLevels:
    """Sizes to start from: as stated, else as readings scatter, else usual ones.

    Parameters
    ----------
    scatter : reading -> standard deviation of its noise, as far as a recording tells it (`scatter_of`).
    read : readings that are taken.
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
    """Noise -> where its size is from: stated, tuned or guessed."""
    return {name: "stated" if name in stated else "tuned" if name in tuned else "guessed" for name in space.noises}


def units(space: StateSpace) -> dict[str, str]:
    """Noise -> SI unit of its size; of what walks that is per root second, and none where it walks in shares."""
    known = {item.name: "1" if item.logarithmic else item.unit for item in space.tracked}
    known = {state.name: state.unit for state in space.model.states} | known
    result = {}
    for name in space.noises:
        kind, _, of = name.partition("_")
        result[name] = "s" if kind == "memory" else known.get(of, unit_of(of)) if kind == "walk" else unit_of(of)
    return result


def scatter_of(recording: Recording, read: Sequence[str]) -> dict[str, float]:
    """Standard deviations of readings' noise: how far each departs from the straight line between its neighbours."""
    return {name: _scatter(recording[name]) for name in read}


def resolution_of(recording: Recording, read: Sequence[str]) -> dict[str, float]:
    """The least noise, standard deviation, that each reading can have as a recording holds it.

    A reading is rounded to its step, which alone scatters by a step over the root of twelve; and noise that
    neighbouring rows show (`scatter_of`) is there, unless the vehicle itself moves so fast: a fifth of it is taken to
    be noise.
    """
    result = {}
    for name, scatter in scatter_of(recording, read).items():
        values = np.unique(recording[name][np.isfinite(recording[name])])
        steps = np.diff(values)
        steps = steps[steps > 1e-9 * max(float(np.ptp(values)), 1e-300)] if len(values) > 1 else steps
        coarse = len(values) < STEPPED * len(recording) and len(steps) > 0
        step = float(np.median(steps)) if coarse else 0.0
        result[name] = max(step / np.sqrt(12.0), SURE * scatter)
    return result


def _usual(space: StateSpace, name: str, scatter: Mapping[str, float]) -> float:
    kind, _, of = name.partition("_")
    if kind == "noise":
        return scatter.get(of, 1.0)
    if kind == "colour":
        return 0.3 * scatter.get(of, 1.0)
    value = next((one for one in space.tracked if one.name == of), None)
    if kind == "memory":
        return MEMORY if value is not None else COLOUR_MEMORY
    if value is None:
        return PER_ROOT_SECOND * next(state.scale for state in space.model.states if state.name == of)
    replaces = of in space.model.inputs or of in space.model.quantities
    return (FORCE_WALK if replaces and not value.logarithmic else PER_ROOT_SECOND) * value.start_sd


def _scatter(values: Array) -> float:
    values = np.where(np.isfinite(values), values, np.nan)
    result = white_noise_sd([values], held=True)
    return LEAST_NOISE if np.isnan(result) else max(result, 1e-6 * max(1.0, float(np.nanstd(values))))
