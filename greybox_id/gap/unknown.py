"""Is there an unmodelled effect? Signs are the error that named effects leave, and magnitudes that are not constant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from ..base.shorthands import Array, Mask
from ..engine.simulation import FreeRuns
from .estimation.calibration import CAL
from .estimation.constancy import acts_on, varies
from .estimation.hypothesis import Hypothesis
from .estimation.model_error import Amplitudes, Linearised, sizes_of
from .estimation.search import Search
from .gap import Unnamed


@dataclass(frozen=True)
class Signs:
    """Signs of something unknown.

    Attributes
    ----------
    left : remaining share of the gap, from residuals over stated noise.
    beyond : excess of the remaining mean square error over noise, over the excess that is no gap yet; largest over
        channels.
    structure : share of all log-likelihood to be gained that driving still explains and no named effect does.
    spread : relative difference of the magnitude between parts of the recording.
    place : which parts, in words.
    effects : their number.
    over : log-likelihood that driving still explains beyond what noise alone would gain.
    together : log-likelihood that the named effects gain over the sum of what each gains alone: gains of independent
        causes add up, those of mimics that compensate each other do not.
    """

    left: float
    beyond: float
    structure: float
    spread: float
    place: str
    effects: int
    over: float = 0.0
    together: float = 1.0


def signs(
    search: Search,
    base: Hypothesis,
    best: Hypothesis,
    before: float,
    after: float,
    beyond: float,
    seen: Mapping[str, Array],
    scatter: float,
    alone: float,
) -> Signs:
    """Collect the signs of something unknown beside the best hypothesis.

    Parameters
    ----------
    before, after : mean square of errors over that of noise, without an effect and with the best hypothesis.
    beyond : as in `Signs`, of the best hypothesis.
    scatter : log-likelihood that effects on scatter gain.
    alone : sum of the gains of each effect of the best hypothesis by itself over the base; zero if not known.
    """
    gained, expected = (float(np.sum(each)) for each in driving_gain(search, best, seen))
    over = max(gained - expected - CAL.surely * np.sqrt(expected), 0.0)
    gain = (base.cost - best.cost) / search.trust + scatter
    rest = after - 1.0 - CAL.surely * np.sqrt(2.0 / max(search.whitener.readings, 1))
    most = varies(search, best, seen).get(best.names[0]) if best.candidates else None
    spread, place = (min(most.relative, 2.0), most.place) if most is not None else (0.0, "")
    left = float(np.clip(rest / max(before - 1.0, CAL.least_share), 0.0, 2.0))
    if scatter > 0 and not best.candidates and rest <= 0:
        over = 0.0  # a reading taken before its row's command looks like structure
    structure, together = over / max(over + gain, 1e-9), (base.cost - best.cost) / alone if alone > 0 else 1.0
    return Signs(left, beyond, structure, spread, place, len(best.candidates), float(over), together)


def excess_ratio(
    e: Array, y: Array, sd: Array, good: Mask, channels: Sequence[str], alone: float, inexact: bool
) -> float:
    """Excess over noise, over the excess that is no gap yet, in the channel where that is largest.

    Parameters
    ----------
    e, y : (N, channels) errors and predictions.
    sd : (channels,) of noise.
    good : (N, channels) readings that count.
    channels : their names.
    alone : excess that is no gap, as a share of noise.
    inexact : whether equations may err in proportion to what they predict.
    """
    if not inexact:
        count = max(int(np.sum(good)), 1)
        if count == 1:
            return 0.0
        return float((np.mean((e / sd)[good] ** 2) - 1.0 - CAL.surely * np.sqrt(2.0 / count)) / alone)
    most = 0.0
    for c, channel in enumerate(channels):
        counted, share = good[:, c], CAL.of_small_signal if channel == "v_y" else CAL.curve_off
        if np.any(counted):
            excess = np.mean((e[counted, c] / sd[c]) ** 2) - 1.0 - CAL.surely * np.sqrt(2.0 / np.sum(counted))
            most = max(most, float(excess / max(alone, (share * np.std(y[counted, c]) / sd[c]) ** 2)))
    return most


def is_unnamed_gap(signs: Signs, temper: float, inexact: bool, noise_stated: bool = True) -> bool:
    """Whether the remaining error is a gap that no named effect explains.

    It is where errors exceed what is no gap yet. Inexact equations err in proportion to what they predict, but their
    errors hardly follow how the vehicle is driven: a regression on that is a hypothesis without a name, and a gap where
    it gains what an effect must.
    """
    return noise_stated and (signs.beyond > 1.0 or (inexact and temper * signs.over > CAL.cost_without_forces))


def unknown_probability(signs: Signs, noise_stated: bool = True) -> float:
    """The probability of an unmodelled effect; unless noise was stated, remaining errors pass for noise."""
    x = CAL.nothing_else + CAL.of_left * min(signs.left, 1.0) + CAL.of_structure * signs.structure
    several = CAL.of_other_signs if signs.effects > CAL.most_effects else 0.0
    x += CAL.of_spread * min(signs.spread, CAL.widest_spread) + several
    x += CAL.beyond * np.log(max(signs.beyond, 1.0)) + (0.0 if noise_stated else CAL.of_other_signs)
    x += CAL.beyond * np.log(max(signs.together, 1.0))
    return 1 / (1 + exp(-max(min(x, 30.0), -30.0)))


def driving_gain(search: Search, hypothesis: Hypothesis, seen: Mapping[str, Array]) -> tuple[Array, Array]:
    """(channels,) log-likelihood that a regression on driving signals would still gain, and that noise would give."""
    features = _features(search.bench, seen)
    r = search.whitener.white(hypothesis.e[:, :, None])[:, :, 0]
    gain, expected = np.zeros(r.shape[1]), np.zeros(r.shape[1])
    for c in range(r.shape[1]):
        use = search.whitener.usable[:, c]
        if np.count_nonzero(use) < 4 * features.shape[1]:
            continue
        X = features[use]
        G = X.T @ X + 1e-6 * len(X) * np.eye(X.shape[1])
        b = X.T @ r[use, c]
        gain[c] = 0.5 * float(b @ cho_solve(cho_factor(G), b))
        expected[c] = 0.5 * X.shape[1]
    return gain, expected


def driving_gain_where_it_acts(search: Search, best: Hypothesis, seen: Mapping[str, Array]) -> dict[str, float]:
    """Effect -> log-likelihood that driving still explains in the channels it acts on, beside all named effects.

    Zero where noise alone may gain as much. An unnamed effect is at least that large: part of it may have been
    attributed to the named one, too.
    """
    gained, expected = driving_gain(search, best, seen)
    result = {}
    for k, candidate in enumerate(best.candidates):
        here = acts_on(search, best, k)
        over, usual = float(np.sum((gained - expected)[here])), float(np.sum(expected[here]))
        result[candidate.effect] = over if over > CAL.surely * np.sqrt(usual) else 0.0
    return result


def _features(bench: FreeRuns, seen: Mapping[str, Array]) -> Array:
    """(N, K) products of driving signals, each of unit size, at a few lags."""
    count = len(bench.measured)
    unit = {name: values / max(float(np.std(values)), 1e-9) for name, values in seen.items()}
    zero = np.zeros(count)
    v, a_y, a_x, r = (unit.get(name, zero) for name in ("v_x", "a_y", "a_x", "yaw_rate"))
    steer, drive = unit.get("steer", zero), unit.get("drive", zero)
    v = v - np.mean(v)
    rate = np.concatenate([np.gradient(steer[rows]) for rows in bench.rows])
    rate = rate / max(float(np.std(rate)), 1e-9)
    time = np.linspace(-1, 1, count)
    now = [
        np.ones(count), time, v, v * v, steer, rate, a_y, a_x, r, np.abs(a_y), np.abs(a_x), a_y * np.abs(a_y),
        a_x * np.abs(a_x), a_y * a_x, a_y * v, a_x * v, steer * v, drive, drive * v, np.sign(a_y), time * a_y,
        time * a_x, a_y**3,
    ]  # fmt: skip
    columns = [column for column in now if np.any(column)]
    lagged = [item for item in (steer, a_y, a_x, drive, r) if np.any(item)]
    for lag in CAL.lags[1:]:
        rows = min(max(1, round(lag / bench.sample_time)), count)
        columns += [np.concatenate([np.zeros(rows), item[: count - rows]]) for item in lagged]
    X = np.column_stack(columns)
    return np.asarray(X / np.maximum(np.sqrt(np.mean(X**2, axis=0)), 1e-9))


def strained_shares(search: Search, best: Hypothesis) -> dict[str, float]:
    """Effect -> share of its action that strained tolerances, off by more than a standard deviation, produce as well.

    An effect that stands for another one strains tolerances that act as it does; strain of others says nothing about
    it.
    """
    off = np.concatenate([best.theta, best.linear]) - search.means
    precision = np.diag(search.prior_precision({axis.index for axis in best.axes}))
    strained = search.white[:, precision * off**2 > 1.0]
    G, columns = strained.T @ strained, search.weighed(best.J).reshape(len(search.white), -1)
    result = {}
    for candidate, at in best.parts:
        does = columns[:, at.start]
        whole, pull = float(does @ does), strained.T @ does
        result[candidate.effect] = float(pull @ np.linalg.lstsq(G, pull)[0]) / whole if whole > 0 else 1.0
    return result


def unnamed(search: Search, best: Hypothesis, result: Amplitudes, median: Amplitudes, about: Linearised) -> Unnamed:
    """Remaining model error beside the best explanation, with the strain of tolerances and the noise."""
    off = np.concatenate([best.theta, best.linear]) - search.means
    precision = search.prior_precision({axis.index for axis in best.axes})
    each = np.sqrt(np.maximum(np.diag(precision), 0.0)) * np.abs(off)
    names = [axis.name for axis in (*search.moving, *search.shifts, *search.shifts)]
    k = int(np.argmax(each[: len(names)])) if names else -1
    total = np.hypot(result.noise, result.colour) / np.hypot(median.noise, median.colour)
    return Unnamed(
        result.share_y, result.share_x, result.floor_y, result.floor_x, result.memory_y, result.memory_x,
        float(off @ precision @ off), (names[k], float(each[k])) if names else ("", 0.0),
        {c: float(v) for c, v in zip(search.bench.channels, total, strict=True)}, search.expected_charge(best),
        *sizes_of(about, result, median),
    )  # fmt: skip
