"""Result of `gb.diagnose`: ranking and budget, the closed model, a figure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from html import escape
from typing import TYPE_CHECKING, Any

import pandas as pd

from ..base.errors import BadInput
from ..base.numbers import between, number, percent, pretty_unit, the_recordings
from ..base.version import __version__
from ..gap.changes.verb import Changed
from ..gap.gap import Gap
from ..models.model import Model
from ..models.vehicle import Vehicle
from ..reports.gap.saved import Made
from ..reports.gap.words import judged, tells, whether
from ..reports.text.gap import parts
from ..reports.text.screen import as_text
from .closed_vehicle import closed_vehicle

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_SHOWN = 4
"""Most effects that a diagnosis' `repr` shows."""


@dataclass(frozen=True, repr=False)
class GapResult(Gap):
    """Where the simulation deviates from the vehicle, which effects cause it, and how far they close the gap.

    `gb.diagnose` returns it. Attributes of the base class (`ranking`, `applied`, `where`, `gap`, `held_out`, `advice`
    ...) are documented at `greybox_id.gap.Gap`.

    Attributes
    ----------
    made : provenance, for its report.
    vehicle : as stated; None if none was.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 200)
    >>> gap = gb.diagnose("kinematic", lap, vehicle="roboracer", effects=["steering_delay"])
    >>> gap.to_pandas().columns.tolist()
    ['effect', 'probability', 'magnitude', 'lower', 'upper', 'unit', 'since', 'until', 'applied']
    >>> gap.closed_model.name
    'kinematic'
    """

    made: Made = field(default_factory=lambda: Made("", "", 0, __version__), compare=False)
    vehicle: Vehicle | None = field(default=None, compare=False)

    @classmethod
    def of(cls, gap: Gap, made: Made, vehicle: Vehicle | None = None) -> GapResult:
        """Wrap a diagnosis."""
        return cls(**{one.name: getattr(gap, one.name) for one in fields(Gap)}, made=made, vehicle=vehicle)

    @property
    def closed_model(self) -> Model:
        """The model with the effects that close the gap, at their magnitudes."""
        if self.closed is None:
            raise BadInput("This diagnosis was read from a file, which does not hold the closed model; diagnose again.")
        return self.closed

    @property
    def closed_vehicle(self) -> Vehicle:
        """The vehicle with the effects that close the gap, as `greybox gap --apply` writes it."""
        if self.vehicle is None:
            raise BadInput("No vehicle was stated; pass one to gb.diagnose as ‹vehicle›.")
        return closed_vehicle(self.vehicle, self)

    def to_pandas(self) -> pd.DataFrame:
        """The ranking: `effect`, `probability`, `magnitude` with its 95 % interval, `unit`, when it acts, `applied`."""
        return pd.DataFrame(
            [
                {
                    "effect": item.effect,
                    "probability": item.probability,
                    "magnitude": item.magnitude,
                    "lower": item.interval[0],
                    "upper": item.interval[1],
                    "unit": item.unit,
                    "since": item.since,
                    "until": item.until,
                    "applied": item.effect in self.applied,
                }
                for item in self.ranking
            ],
            columns=[*("effect", "probability", "magnitude", "lower", "upper", "unit", "since", "until", "applied")],
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """The budget of the gap as a waterfall of shares; the ranking by probability if there is no budget.

        Parameters
        ----------
        ax : matplotlib Axes to draw into; in a new figure by default.
        """
        from .plots import budget

        return budget(self, ax)

    def summary(self) -> str:
        """The text that `greybox gap` prints: gap, location, causes, errors, and what remains."""
        return as_text(parts(self))

    def __repr__(self) -> str:
        lines = [f"Gap of {self.model} on {', '.join(self.recordings)}", f"  {whether(self)}"]
        for item in self.ranking[:MOST_SHOWN]:
            lines.append(
                f"  {item.effect}: probability {item.probability:.2f}, {between(item.magnitude, *item.interval)}"
                f" {pretty_unit(item.unit)}{', applied' if item.effect in self.applied else ''}"
            )
        closure, held_out = judged(self)
        if tells(closure):
            lines.append(f"  closes {percent(closure.closed)} {'(held out)' if held_out else '(same recordings)'}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        head = escape(f"Gap of {self.model} on {', '.join(self.recordings)}: {whether(self)}")
        table: Any = self.to_pandas()
        return f"<p><b>{head}</b></p>{table.to_html(index=False, float_format=number)}"


@dataclass(frozen=True, repr=False)
class ChangeResult(GapResult):
    """What changed in a vehicle since earlier recordings: result of `gb.diagnose` with `since`.

    The gap is relative to the vehicle as it was before: `ranking`, `applied`, `plot()`, `closed_model` as in
    `GapResult`.

    Attributes
    ----------
    change : the changes, as `greybox_id.gap.changes.verb.Changed`.
    """

    change: Changed | None = field(default=None, compare=False)

    @classmethod
    def since_then(cls, change: Changed, made: Made, vehicle: Vehicle) -> ChangeResult:
        """Wrap a diagnosis of changes."""
        attributes = {one.name: getattr(change.gap, one.name) for one in fields(Gap)}
        return cls(**attributes, made=made, vehicle=vehicle, change=change)

    @property
    def _found(self) -> Changed:
        assert self.change is not None  # set by since_then
        return self.change

    @property
    def since(self) -> tuple[str, ...]:
        """Names of the recordings from before."""
        return self._found.since

    @property
    def scatter(self) -> Mapping[str, tuple[float, float]]:
        """Effect -> mean and standard deviation of its magnitude over the recordings from before."""
        return self._found.scatter

    @property
    def changed(self) -> pd.DataFrame:
        """One row per effect that changed, with its 95 % interval, magnitude `before`, and `gain` in nats."""
        rows = [
            {
                **{k: v for k, v in item.items() if k != "interval"},
                "lower": item["interval"][0],
                "upper": item["interval"][1],
            }
            for item in self._found.changed
        ]
        columns = ["effect", "magnitude", "lower", "upper", "unit", "before", "probability", "gain", "share"]
        return pd.DataFrame(rows, columns=columns)

    @property
    def not_changed(self) -> pd.DataFrame:
        """One row per effect that did not: `effect`, and `within`, twice its standard deviation with scatter."""
        return pd.DataFrame(self._found.not_changed, columns=["effect", "within"])

    @property
    def not_seen(self) -> tuple[str, ...]:
        """Effects whose usual change is below the detection limit of these recordings."""
        return tuple(self._found.not_seen)

    def summary(self) -> str:
        """The diagnosis as text."""
        return "\n".join([*changed_lines(self._found), super().summary()])

    def __repr__(self) -> str:
        head = f"Change of {self.model} on {', '.join(self.recordings)}"
        return "\n".join([head, *(f"  {line}" for line in changed_lines(self._found)[: MOST_SHOWN + 1])])

    def _repr_html_(self) -> str:
        head = escape(f"Change of {self.model} on {', '.join(self.recordings)}: {changed_lines(self._found)[0]}")
        table: Any = self.changed
        return f"<p><b>{head}</b></p>{table.to_html(index=False, float_format=number)}"


def changed_lines(changed: Changed) -> list[str]:
    """Changes in lines: a heading, and one line per effect."""
    before = the_recordings(changed.since)
    if not changed.changed:
        return [f"changed  nothing beyond the scatter of {before}"]
    lines = [f"changed  beyond the scatter of {before}"]
    for cause in changed.changed:
        low, high = (number(end) for end in cause["interval"])
        lines.append(
            f"{cause['effect']}: {number(cause['magnitude'])} [{low}, {high}] {pretty_unit(cause['unit'])}, before "
            f"{number(cause['before'])}"
        )
    return lines
