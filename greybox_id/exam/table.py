"""A score for people: measures beside their bars, confusions, and what was wrong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import inf, isfinite
from typing import Any

from rich.console import JustifyMethod
from rich.table import Table

from .measures import STRETCH

SHARES = ("false_alarms", "detection", "first", "first_strictly", "among_three", "doubles", "unknown")
PERCENT = (*SHARES, "beside", "null_names", "outside_named", "misplaced", "wrongly_unknown", "magnitude", "coverage")
"""Measures told in percent."""
MARKS = {True: "✓", False: "✗", None: ""}


def score_table(body: Mapping[str, Any]) -> Table:
    """Every measure with its interval, how many cases it rests on, and the bar."""
    table = _table(("what", "left"), ("measured", "right"), ("95 % interval", "right"), ("of", "right"),
                   ("bar", "right"), ("", "left"))  # fmt: skip
    for own in body["measures"]:
        percent = own["key"] in PERCENT
        low, high = own["interval"]
        interval = f"[{_number(low, percent, bare=True)}, {_number(high, percent, bare=True)}]"
        table.add_row(
            own["name"],
            _number(own["value"], percent) if own["of"] else "–",
            interval if _there(low) and _there(high) else "–",
            str(own["of"]),
            bar_words(own["bar"], percent) + (f", better {STRETCH:g}" if own["key"] == "cpu" and own["bar"] else ""),
            MARKS[own["passed"]],
        )
    return table


def bar_words(bar: tuple[float, float] | None, percent: bool) -> str:
    """A bar as a person writes it."""
    if bar is None:
        return ""
    low, high = (inf if own is None else float(own) for own in bar)
    unit = " %" if percent else ""
    scale = 100.0 if percent else 1.0
    if low == 0.0:
        return f"≤ {high * scale:g}{unit}"
    if high == (1.0 if percent else inf):
        return f"≥ {low * scale:g}{unit}"
    return f"{low * scale:g}–{high * scale:g}{unit}"


def confusions_table(body: Mapping[str, Any]) -> Table:
    """What was taken for what, and how good magnitudes were."""
    table = _table(("effect", "left"), ("first choices", "left"), ("magnitude off", "right"), ("covered", "right"))
    for true, choices in body["confusions"].items():
        words = ", ".join(f"{'right' if name == true else name} {count}" for name, count in choices.items())
        size = body["magnitudes"].get(true)
        off = _number(size["median_error"], True) if size else ""
        table.add_row(true, words, off, f"{size['covered']}/{size['of']}" if size else "")
    return table


def wrong_table(body: Mapping[str, Any]) -> Table:
    """Cases that were wrong."""
    table = _table(("case", "left"), ("truth", "left"), ("size", "right"), ("wrong", "left"), ("first choices", "left"))
    for own in body["findings"]:
        if not own["wrong"] and own["kind"] != "real":
            continue
        truth = ", ".join(f"{name} {value:.3g}" for name, value in own["effects"].items()) or own["kind"]
        choices = ", ".join(f"{name} {value:.2f}" for name, value in list(own["choices"].items())[:3] if _there(value))
        unknown = own["unknown_probability"]
        if _there(unknown) and unknown > 0.05:
            choices += f"{', ' if choices else ''}unknown {unknown:.2f}"
        what = own["error"] or own["wrong"] or ("gap" if own["detected"] else "no gap")
        table.add_row(own["case"], truth, f"{own['size']:.2g}", what, choices)
    return table


def tables(body: Mapping[str, Any], detail: bool) -> Iterator[Table]:
    """What is printed of a score."""
    if body["tier"] == "real":
        yield wrong_table(body)
        return
    yield score_table(body)
    if detail:
        yield confusions_table(body)
        if any(own["wrong"] for own in body["findings"]):
            yield wrong_table(body)


def _there(value: float | None) -> bool:
    return value is not None and isfinite(value)


def _number(value: float | None, percent: bool, bare: bool = False) -> str:
    if value is None or not isfinite(value):
        return "–" if value is None or value != -inf else "−∞"
    if percent:
        return f"{100 * value:.1f}{'' if bare else ' %'}"
    return f"{value:.3f}"


def _table(*titles: tuple[str, JustifyMethod]) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    for title, justify in titles:
        table.add_column(title, header_style="dim", justify=justify)
    return table
