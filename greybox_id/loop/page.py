"""What came of the loop, as one page of HTML that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from .demo import Demo

WIDTH, HEIGHT, MARGIN = 900, 220, 50
COLOURS = ("#8a8f98", "#d98324", "#1f6fb2", "#2e8b57", "#8b3a8b")
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 960px; margin: 2em auto; padding: 0 1em; color: #222 }
table { border-collapse: collapse; margin: 1em 0; width: 100% } th { text-align: left; font-weight: 600 }
td, th { padding: .3em .6em; border-bottom: 1px solid #ddd; vertical-align: top } td.n, th.n { text-align: right }
svg { width: 100%; height: auto } svg text { font: 12px system-ui, sans-serif; fill: #444 } small { color: #666 }
"""


def page(found: Demo) -> str:
    """The page of a demo."""
    withheld = ", ".join(f"{escape(name)} {value:.4g}" for name, value in found.withheld.items())
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en"><head><meta charset="utf-8"><title>The loop</title>',
            f'<meta name="generator" content="greybox-id"><style>{STYLE}</style></head><body>',
            "<h1>The loop: drive, identify, name, learn anew, swap</h1>",
            f"<p>A 1:10 car in simulation has what its vehicle file does not state: <b>{withheld}</b>. Neither the "
            "diagnosis nor the driver is told. The car shares no code with the models that are diagnosed and learned "
            "on; it is no real car.</p>",
            "<h2>Cycles</h2>",
            _cycles(found.cycles),
            "<h2>Path error along the track</h2>",
            _lines([(f"cycle {k}", one["trace"]["s"], one["trace"]["e_y"]) for k, one in enumerate(found.cycles, 1)]),
            "<h2>Arms</h2>",
            "<p>How each drives the car at the end. base: the driver before any data. nominal: as many steps of "
            f"learning as the loop took, on the vehicle file alone. {escape(str(found.scene['arm']))}: the loop. "
            "oracle: learned with what is truly there; there is none where no model has it.</p>",
            _arms(found.arms),
            "</body></html>",
            "",
        ]
    )


def _cycles(cycles: Sequence[Mapping[str, Any]]) -> str:
    heads = (
        "cycle",
        "rows",
        "grip used",
        "path error",
        "foretold",
        "lap",
        "crashes",
        "named (probability)",
        "policy",
        "s",
    )
    rows = []
    for k, one in enumerate(cycles, 1):
        named = "<br>".join(
            f"{escape(own['effect'])} {own['magnitude']:.3g} {escape(own['unit'])} ({own['probability']:.2f})"
            + ("" if own["effect"] in one["applied"] else ", not applied")
            for own in one["named"]
        )
        swapped = "swapped" if one["swapped"] else f"kept: {escape(one['reason'])}"
        driven = (_mm(one["path_error_rms"]), _mm(one["path_error_foretold"]), _s(one["lap_time"]), one["crashes"])
        cap, seconds = f"{one['cap']:.0%}", f"{one['seconds']:.0f}"
        rows.append((k, one["rows"], cap, *driven, named or "nothing", swapped, seconds))
    return _table(heads, rows, {"named (probability)", "policy"})


def _arms(arms: Mapping[str, Mapping[str, Any]]) -> str:
    heads = ("arm", "path error at the first cap", "lap", "crashes", "at the last cap", "lap", "crashes")
    rows = [
        (escape(name), *(part for when in ("first", "last") for part in
                         (_mm(own[when]["path_error_rms"]), _s(own[when]["lap_time"]), own[when]["crashes"])))
        for name, own in arms.items()
    ]  # fmt: skip
    return _table(heads, rows, {"arm"})


def _table(heads: Sequence[str], rows: Sequence[Sequence[Any]], words: set[str]) -> str:
    def kind(head: str) -> str:
        return "" if head in words else ' class="n"'

    top = "".join(f"<th{kind(head)}>{head}</th>" for head in heads)
    body = (
        "<tr>" + "".join(f"<td{kind(head)}>{own}</td>" for head, own in zip(heads, row, strict=True)) + "</tr>"
        for row in rows
    )
    return f"<table><thead><tr>{top}</tr></thead><tbody>{''.join(body)}</tbody></table>"


def _lines(lines: Sequence[tuple[str, Sequence[float], Sequence[float]]]) -> str:
    """Lateral error over distance."""
    if not lines or not any(len(x) > 1 for _, x, _ in lines):
        return "<p>Nothing was driven.</p>"
    most = max(float(np.max(x)) for _, x, _ in lines if len(x))
    high = max(float(np.max(np.abs(y))) for _, _, y in lines if len(y)) or 1.0
    parts = [f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="lateral error along the track">']
    middle = HEIGHT / 2 - 10
    parts.append(f'<line x1="{MARGIN}" x2="{WIDTH}" y1="{middle}" y2="{middle}" stroke="#ccc"/>')
    for share in (-1, 1):
        parts.append(f'<text x="0" y="{middle - share * (middle - 15) + 4:.0f}">{1e3 * share * high:.0f} mm</text>')
    parts.append(f'<text x="{WIDTH - 60}" y="{HEIGHT - 4}">{most:.0f} m</text>')
    for k, (name, x, y) in enumerate(lines):
        points = " ".join(
            f"{MARGIN + (WIDTH - MARGIN) * a / most:.1f},{middle - (middle - 15) * b / high:.1f}"
            for a, b in zip(x, y, strict=True)
        )
        colour = COLOURS[k % len(COLOURS)]
        parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.3"/>')
        parts.append(f'<text x="{MARGIN + 90 * k}" y="{HEIGHT - 4}" style="fill: {colour}">{escape(name)}</text>')
    return "\n".join([*parts, "</svg>"])


def _mm(metres: float | None) -> str:
    return f"{1e3 * metres:.1f} mm" if metres is not None and np.isfinite(metres) else "-"


def _s(seconds: float | None) -> str:
    return f"{seconds:.2f} s" if seconds is not None and np.isfinite(seconds) else "-"
