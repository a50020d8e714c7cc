"""A diagnosis as text: doubts about the data, gap, location, causes, errors, and what remains."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import Group, RenderableType
from rich.table import Table

from ...base.numbers import counted, number, pretty_unit, quantity, rmse, short_with_sd, the_recordings, whole_percent
from ...fitting.scores.horizons import Errors
from ...gap.gap import Budget, Closure, Gap
from ..gap.words import (
    as_it_stands,
    carried_over,
    how_far,
    judged,
    left,
    levels,
    magnitude_words,
    told_apart,
    where,
    whether,
)
from .screen import WIDTH, led

PRINTED_FROM, MOST = 0.02, 6
"""Least probability of effects that are printed, unless they are applied; most effects printed."""
MOST_WORDS = 4
"""Most effects named that were not or would not be detected."""
NARROW = 110
"""Width in columns below which a terminal shows only two horizons."""
BAR = 20
"""Length in characters of a bar for the whole excess error."""
SHOWN_HORIZON = 0.5
"""Horizon, s, shown besides the free run if space is limited."""


def parts(gap: Gap, width: int = WIDTH) -> Iterator[RenderableType]:
    """The text of a diagnosis, part by part, for a width in columns."""
    for doubt in gap.doubts:
        yield led("Doubt", doubt)
    yield whether(gap)
    place = where(gap)
    if place:
        yield led("Where", "\n".join(place))
    which = _which(gap, width)
    if which is not None:
        yield led("Cause", which)
    for line in _silent(gap):
        yield led("", line)
    if gap.budget is not None:
        yield led("Budget", _budget(gap.budget))
    yield led("Errors", _how_far(gap, width))
    yield led("Remains", left(gap))
    for sentence in gap.advice:
        yield led("Next", sentence)


def _which(gap: Gap, width: int) -> Group | None:
    """Ranked effects with magnitude, probability, and those that they cannot be distinguished from."""
    shares = (
        {share.effect for share in gap.budget.shares} if gap.budget is not None else set()
    )  # each has its reason in the table
    always_shown = {*gap.applied, *shares}
    likely = [
        (k, item)
        for k, item in enumerate(gap.ranking, 1)
        if item.probability >= PRINTED_FROM or item.effect in always_shown
    ][:MOST]
    if not likely or not (gap.gap_detected or gap.applied):
        return None
    wide = width >= NARROW
    table = Table.grid(padding=(0, 2, 0, 0))
    for _ in range(4 + wide):
        table.add_column(overflow="fold")
    heads = ("", "effect", "magnitude ± sd or [95 %]", "probability", "")
    table.add_row(*heads[: 4 + wide], style="dim")
    notes: list[RenderableType] = [table]
    for k, item in likely:
        status = "applied" if item.effect in gap.applied else item.reason and f"not applied: {item.reason}"
        note = "; ".join(filter(None, (status, told_apart(gap, item))))
        cells = (str(k), item.effect, magnitude_words(item), probability(item.probability))
        table.add_row(*cells, *([note] if wide else []))
        if note and not wide:
            notes.append(f"{k}  {note}")
    rest = len(gap.ranking) - len(likely)
    if rest:
        notes.append(f"and {counted(rest, 'less likely effect')}")
    return Group(*notes)


def _budget(budget: Budget) -> Group:
    """Shares of the excess error as bars, the unexplained share last."""
    table = Table.grid(padding=(0, 2, 0, 0))
    for _ in range(3):
        table.add_column()
    place = (
        f"on {the_recordings(budget.recordings)} "
        f"({'held out' if budget.held_out else 'from which the effects were chosen'})"
    )
    for share in (*budget.shares, budget.unnamed):
        bar = "█" * round(BAR * min(max(share.share, 0.0), 1.0))
        interval = f"[{whole_percent(share.low)}, {whole_percent(share.high)}]"
        table.add_row(share.effect, f"{whole_percent(share.share)} % {interval}", bar)
    return Group(f"share of the excess error (the error beyond noise) {place}", table)


def probability(value: float) -> str:
    """A probability with two decimals, or as below 0.01 or above 0.99."""
    return "> 0.99" if value > 0.99 else "< 0.01" if value < 0.01 else f"{value:.2f}"


def _silent(gap: Gap) -> list[str]:
    """Effects below the detection limit of these recordings, and effects that parameters would absorb."""
    lines = []
    if gap.not_excited:
        named = [f"{name} up to {_printed(size)}" for name, size in list(gap.not_excited.items())[:MOST_WORDS]]
        lines.append(f"below the detection limit here, so possibly present: {_and_more(named, len(gap.not_excited))}")
    if gap.absorbed:
        named = list(gap.absorbed[:MOST_WORDS])
        names = _and_more(named, len(gap.absorbed))
        lines.append(f"absorbed by free parameters or parameters with a tolerance, so not detectable: {names}")
    return lines


def _printed(size: str) -> str:
    """A size with its unit in readable notation."""
    value, _, unit = size.partition(" ")
    return f"{value} {pretty_unit(unit)}" if value.startswith("±") and unit else size


def _and_more(named: Sequence[str], count: int) -> str:
    more = count - len(named)
    return ", ".join(named) + (f" and {more} more" if more > 0 else "")


def _how_far(gap: Gap, width: int) -> Group:
    closure, held_out = judged(gap)
    types: list[RenderableType] = [how_far(gap, closure, held_out), levels(closure)]
    if warning := as_it_stands(gap, closure):
        types.append(warning)
    types += carried_over(gap)
    if not held_out and gap.applied:
        types.append("on other recordings, the error with these effects is unknown: name held-out recordings")
    if gap.moved:
        named = [
            f"{one.name} {short_with_sd(one.stated, one.sd)} → {quantity(one.value, one.unit)}"
            for one in gap.moved[:MOST_WORDS]
        ]
        types.append(f"parameters more than one sd from their stated values: {_and_more(named, len(gap.moved))}")
    if closure.errors:
        types.append(_errors(closure, width))
    return Group(*types)


def _errors(closure: Closure, width: int) -> Table:
    """RMSE before → after (noise) per channel, over the horizons."""
    horizons = sorted({error.horizon for error in closure.errors}, key=lambda h: float("inf") if h is None else h)
    if width < NARROW and len(horizons) > 2:
        timed = [h for h in horizons if h is not None]
        near = min(timed, key=lambda h: abs(h - SHOWN_HORIZON))
        horizons = [near, horizons[-1]]
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, show_edge=False)
    table.add_column("RMSE before → after (noise)", header_style="dim")
    for horizon in horizons:
        table.add_column("free run" if horizon is None else f"{horizon:g} s", header_style="dim", no_wrap=True)
    by = {(error.channel, error.horizon): error for error in closure.errors}
    for channel in dict.fromkeys(error.channel for error in closure.errors):
        unit = next(error.unit for error in closure.errors if error.channel == channel)
        cells = [_error(by.get((channel, horizon))) for horizon in horizons]
        table.add_row(f"{channel} [{pretty_unit(unit)}]", *cells)
    return table


def _error(errors: Errors | None) -> str:
    if errors is None:
        return "–"
    return f"{rmse(errors.before)} → {rmse(errors.after)} ({number(errors.floor, 2)})"
