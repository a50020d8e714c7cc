"""Is something at work that has no name here? Told by what named effects leave, and by magnitudes that do not stay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp

import numpy as np
from numpy.typing import NDArray

from ..estimation.calibration import CAL
from ..estimation.hypothesis import Hypothesis
from ..estimation.search import Search
from ..shorthands import Array
from .constancy import varies
from .leftover import left_gain


@dataclass(frozen=True)
class Signs:
    """What speaks for something unknown.

    Attributes
    ----------
    left : share of the gap that is left, by how much residuals exceed stated noise.
    excess : mean square of what is left over that of noise, less one.
    beyond : the same over what is no gap yet, in the channel where that is most.
    structure : share of all log-likelihood to be gained that driving still explains and no named effect does.
    spread : by which share the magnitude differs between parts of the recording.
    place : which parts, in words.
    gain : log-likelihood that the named effects gain.
    effects : how many they are.
    over : log-likelihood that driving still explains beyond what noise alone would gain.
    together : log-likelihood that the named effects gain over the sum of what each gains alone: causes that have
        nothing to do with each other add up, impostors that must undo each other do not.
    """

    left: float
    excess: float
    beyond: float
    structure: float
    spread: float
    place: str
    gain: float
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
    scatter: float = 0.0,
    alone: float = 0.0,
) -> Signs:
    """Collect what speaks for something unknown beside the best hypothesis.

    Parameters
    ----------
    search, base, best : hypotheses and what refitted them.
    before, after : mean square of errors over that of noise.
    beyond : as in `Signs`, of the best hypothesis.
    seen : signals per row.
    scatter : log-likelihood that effects of variance gain.
    alone : sum of what each effect of the best hypothesis takes off the base's cost by itself; zero if not known.
    """
    gained, expected = left_gain(search, best, seen)
    over = max(gained - expected - CAL.surely * np.sqrt(expected), 0.0)
    gain = (base.cost - best.cost) / search.trust + scatter
    rest = after - 1.0 - CAL.surely * np.sqrt(2.0 / max(search.colour.readings, 1))
    spread = 0.0
    place = ""
    known = varies(search, best, seen) if best.candidates else {}
    if best.candidates and best.names[0] in known:
        most = known[best.names[0]]
        spread, place = min(most.relative, 2.0), most.place
    left = float(np.clip(rest / max(before - 1.0, CAL.least_share), 0.0, 2.0))
    if (
        scatter > 0 and not best.candidates and rest <= 0
    ):  # a reading taken before its row's command looks like structure
        over = 0.0
    return Signs(
        left,
        float(rest),
        beyond,
        over / max(over + gain, 1e-9),
        spread,
        place,
        gain,
        len(best.candidates),
        float(over),
        (base.cost - best.cost) / alone if alone > 0 else 1.0,
    )


def beyond_what_may_be(
    e: Array, y: Array, sd: Array, good: NDArray[np.bool_], channels: Sequence[str], alone: float, rough: bool
) -> float:
    """Excess over noise, over what is no gap yet, in the channel where that is most.

    Parameters
    ----------
    e, y : (N, channels) errors and predictions.
    sd : (channels,) of noise.
    good : (N, channels) readings that count.
    channels : their names.
    alone : excess that is no gap, as a share of noise.
    rough : whether equations may be off in proportion to what they predict.
    """
    if not rough:
        count = max(int(np.sum(good)), 1)
        if count == 1:
            return 0.0
        return float((np.mean((e / sd)[good] ** 2) - 1.0 - CAL.surely * np.sqrt(2.0 / count)) / alone)
    most = 0.0
    for c, channel in enumerate(channels):
        own, share = good[:, c], CAL.of_small_signal if channel == "v_y" else CAL.of_signal
        if np.any(own):
            excess = np.mean((e[own, c] / sd[c]) ** 2) - 1.0 - CAL.surely * np.sqrt(2.0 / np.sum(own))
            most = max(most, float(excess / max(alone, (share * np.std(y[own, c]) / sd[c]) ** 2)))
    return most


def without_a_name(own: Signs, temper: float, rough: bool, told: bool = True) -> bool:
    """Whether what is left is a gap that no named effect explains.

    It is where errors exceed what they may. Rough equations are off in proportion to what they predict, but what they
    leave hardly follows how the vehicle is driven: a regression on that is a hypothesis like any other, without a
    name, and a gap where it gains what an effect must.

    Parameters
    ----------
    own : what speaks for it.
    temper : what log-likelihoods are multiplied with.
    rough : whether equations are.
    told : as in `unknown_probability`.
    """
    return told and (own.beyond > 1.0 or (rough and temper * own.over > CAL.cost_without_forces))


def unknown_probability(own: Signs, told: bool = True) -> float:
    """The probability that something unknown is at work.

    Parameters
    ----------
    own : what speaks for it.
    told : whether noise was stated: else what is left passes for noise, and cannot speak.
    """
    x = CAL.nothing_else + CAL.of_left * min(own.left, 1.0) + CAL.of_structure * own.structure
    x += CAL.of_spread * min(own.spread, CAL.widest_spread) + (CAL.untold if own.effects > CAL.most_effects else 0.0)
    x += CAL.beyond * np.log(max(own.beyond, 1.0)) + (0.0 if told else CAL.untold)
    x += CAL.beyond * np.log(max(own.together, 1.0))
    return 1 / (1 + exp(-max(min(x, 30.0), -30.0)))
