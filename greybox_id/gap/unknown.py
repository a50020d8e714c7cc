"""Is something at work that has no name here? Told by what named effects leave, and by magnitudes that do not stay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp

import numpy as np
from numpy.typing import NDArray

from ..parameter import Array
from .constancy import varies
from .evidence import COST
from .hypothesis import Hypothesis
from .leftover import left_gain
from .search import Search

MOST = 2
"""Where more effects than these are needed to explain what one cause might, that cause is none of them."""
SURELY = 4.0
"""What noise alone may leave, in standard deviations of that, does not count."""
EXACTLY, ROUGHLY, LEARNT = 0.03, 0.1, 1.7
"""Excess over noise, as a share of it, that is no gap yet: of exact equations, of rough ones, of maps with memory."""
BEYOND = 3.0
"""Log-odds of something unknown beside a name per logarithm of that; and of how much more effects explain together than
each alone. Of thirty pairs of true causes none explained more than 1.07 times as much."""
UNTOLD = 1.5
"""Log-odds for it where nobody can tell what is left from noise."""
OF_THE_SIGNAL, OF_A_SMALL_ONE = 0.015, 0.05
"""Error of rough equations that is none either, over the standard deviation of what they predict; of v_y, which is the
small difference of what is large."""


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
    along : what those are parts of.
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
    along: str
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
    over = max(gained - expected - SURELY * np.sqrt(expected), 0.0)
    gain = (base.cost - best.cost) / search.trust + scatter
    rest = after - 1.0 - SURELY * np.sqrt(2.0 / max(search.colour.readings, 1))
    spread = 0.0
    along = ""
    known = varies(search, best, seen) if best.candidates else {}
    if best.candidates and best.names[0] in known:
        most = known[best.names[0]]
        spread, along = min(most.relative, 2.0), most.along
    left = float(np.clip(rest / max(before - 1.0, 0.02), 0.0, 2.0))
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
        along,
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
        return float((np.mean((e / sd)[good] ** 2) - 1.0 - SURELY * np.sqrt(2.0 / count)) / alone) if count > 1 else 0.0
    most = 0.0
    for c, channel in enumerate(channels):
        own, share = good[:, c], OF_A_SMALL_ONE if channel == "v_y" else OF_THE_SIGNAL
        if np.any(own):
            excess = np.mean((e[own, c] / sd[c]) ** 2) - 1.0 - SURELY * np.sqrt(2.0 / np.sum(own))
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
    rough, told : as in `unknown_probability`.
    """
    return told and (own.beyond > 1.0 or (rough and temper * own.over > COST))


def unknown_probability(own: Signs, rough: bool, told: bool = True) -> float:
    """The probability that something unknown is at work.

    Parameters
    ----------
    own : what speaks for it.
    rough : whether equations are.
    told : whether noise was stated: else what is left passes for noise, and cannot speak.
    """
    if rough:
        x = -4.0 + 2.5 * min(own.left, 1.0) + 15.0 * own.structure + 12.0 * min(own.spread, 0.4)
        x += 1.5 if own.effects > MOST else 0.0
        x += BEYOND * np.log(max(own.beyond, 1.0)) + (0.0 if told else UNTOLD)
    else:
        x = -5.0 + 30.0 * min(own.left, 0.3) + 25.0 * own.structure + 20.0 * min(own.spread, 0.4)
        x += 80.0 * min(max(own.excess, 0.0), 0.1) + (4.0 if own.effects > MOST else 0.0)
    x += BEYOND * np.log(max(own.together, 1.0))
    return 1 / (1 + exp(-max(min(x, 30.0), -30.0)))
