"""What a track found in three sentences: how sure it is, whether to believe that, and what a measurement says."""

from __future__ import annotations

from math import isfinite

from ...filters.findings import WINDOW
from ..numbers import counted, listed, number, percent, quantity, signal_words
from .digest import Digest, Measured

MOST_NAMED = 4
"""Estimates that the first sentence names."""
LEADS = ("How sure", "Is it so", "Against what")


def verdict(found: Digest) -> tuple[str, str, str]:
    """Three sentences."""
    return _how_sure(found), _is_it_so(found), _against_what(found)


def method(found: Digest) -> str:
    """The filter in words: a UKF and smoother."""
    return f"{'an' if found.filter == 'ekf' else 'a'} {found.filter.upper()}{' and smoother' if found.smoothed else ''}"


def _how_sure(found: Digest) -> str:
    walks = {name: own.told for name, own in found.estimates.items() if own.told is not None}
    names = [name for name in dict.fromkeys(("sideslip", *walks)) if name in found.estimates][:MOST_NAMED]
    each = [
        f"{quantity(own.sd, own.unit)} in {signal_words(name)}" for name in names for own in [found.estimates[name]]
    ]
    untold = [f"{signal_words(name)} in {percent(told)}" for name, told in walks.items() if told < 1]
    return (
        f"Along {found.data.name}, {counted(found.rows, 'row')} in {counted(found.runs, 'run')}, {method(found)} on "
        f"{found.model} estimates with a standard deviation of, in the median, {listed(each)}"
        f"{f'; the recording tells {listed(untold)} of the rows' if untold else ''}."
    )


def _is_it_so(found: Digest) -> str:
    told = {name: own for name, own in found.consistency.items() if isfinite(own.nis)}
    if not told:
        return "Too few readings were taken to say whether the filter knows how wrong it is."
    means = listed([f"{number(own.nis, 2)} in {signal_words(name)}" for name, own in told.items()])
    inside = listed([f"{percent(own.inside)}" for own in told.values() if isfinite(own.inside)])
    windows = f", and {inside} of the windows of {WINDOW:g} s lie within their 95 % bounds" if inside else ""
    widened = f"; bands are wider by {number(found.widened, 3)} for it" if found.widened > 1 else ""
    return f"Squared innovations are {means} times what the filter expects{windows}{_memory(found)}{widened}."


def _memory(found: Digest) -> str:
    """Whether innovations depend on those before, as a clause."""
    beyond = [
        f"{number(own.correlation, 2)} in {signal_words(name)}"
        for name, own in found.consistency.items()
        if abs(own.correlation) > own.correlation_bound
    ]
    if not beyond:
        return "; neighbouring innovations do not correlate"
    return f"; neighbouring innovations correlate by {listed(beyond)}, more than chance: something there has a memory"


def _against_what(found: Digest) -> str:
    if not found.truth:
        return (
            "Nothing that was estimated was also measured without entering the filter: how far the estimates are off "
            "cannot be told from this recording."
        )
    each = [_error(name, own) for name, own in found.truth.items()]
    return f"Against what was measured and did not enter the filter, estimates err by an RMSE of {listed(each)}."


def _error(name: str, own: Measured) -> str:
    return f"{quantity(own.rmse, own.unit)} in {signal_words(name)} ({percent(own.inside)} within two sd)"
