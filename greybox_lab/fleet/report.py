"""The report of a fleet, one HTML page: what changed, who lies apart, the population, and what is broken."""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes

from greybox_id.base.declared import understood
from greybox_id.base.errors import BadInput, near_or_all
from greybox_id.base.guard import claim
from greybox_id.base.numbers import alike, counted, number, pretty_unit
from greybox_id.base.shorthands import Array
from greybox_id.fitting.fit import Z
from greybox_id.reports.document import Document, Drawing, Pairs, Part, Points, Section, Table, Text, VerdictBox, titled
from greybox_id.reports.figures.sheet import BLUE, DASHED, INK, ORANGE, PALE, Sheet, band, label, look
from greybox_id.reports.html import write_html

from .changes import STEP
from .estimate import FleetEstimate, estimate
from .status import FleetStatus, status
from .statuses import BROKEN, NOT_TRUSTED, OK, WAITING
from .store import Store
from .unit import MADE_BY

if TYPE_CHECKING:
    import pandas as pd

FILE = "report.html"
MOST_DRAWN, MOST_ROWS, MOST_BROKEN = 12, 60, 200
"""Changes that are drawn, vehicles in a figure or table, and recordings without a result that are listed."""
PROBABLE = 0.5
PANEL, DAY = 92.0, 86400.0
"""Height of a panel, points; s of a day."""


@understood
def report(folder: str | Path, out: str | Path | None = None, *, vehicle: str | None = None) -> Path:
    """Write the report of a fleet as one HTML page.

    Parameters
    ----------
    folder : of the results; population, vehicles and drift are estimated anew.
    out : the page; `report.html` in the folder unless given.
    vehicle : the name of one, whose page is written; None for the whole fleet.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    BadInput : the folder holds no results, or there is no such vehicle.
    """
    target = claim(Path(out) if out is not None else Path(folder) / (f"report_{vehicle}.html" if vehicle else FILE))
    if target.suffix.lower() not in (".html", ".htm"):
        raise BadInput(f"{target}: a report of a fleet is an HTML page; name a file that ends in .html with ‹out›.")
    how_far, result = status(folder), estimate(folder)
    store = Store.existing(folder)
    if vehicle is not None and vehicle not in how_far.vehicles:
        raise BadInput(f"‹vehicle›: the fleet has no {vehicle!r}.{near_or_all(vehicle, how_far.vehicles)}")
    return write_html(_document(store, how_far, result, vehicle), target)


def _document(store: Store, how_far: FleetStatus, fleet_estimate: FleetEstimate, vehicle: str | None) -> Document:
    names = [vehicle] if vehicle is not None else list(how_far.vehicles)
    parts: list[Part] = [VerdictBox(tuple(_answer(how_far, fleet_estimate, names)))]
    stated = [words for words in fleet_estimate.sentences() if any(words.startswith(f"{name}: ") for name in names)]
    parts += titled("Changes and outliers", Points(tuple(stated)), *_changes(store, fleet_estimate, names))
    if vehicle is None:
        parts += titled("Population", _population(fleet_estimate), *_ranks(fleet_estimate))
    parts += titled(
        "Vehicles",
        _vehicles(fleet_estimate, names),
        *_more(fleet_estimate.vehicles[fleet_estimate.vehicles["vehicle"].isin(names)]),
    )
    parts += titled("Recordings set apart", _apart(fleet_estimate, names))
    parts += titled("Gaps", _gaps(store, names))
    parts += titled("Recordings", *_states(how_far, names), *_broken(store, names))
    parts += titled("How it was made", _made(store, fleet_estimate))
    about = f"{how_far.recordings} recordings of {counted(len(how_far.vehicles), 'vehicle')}"
    folder = store.folder.resolve().name
    title = f"Vehicle {vehicle} of the fleet {folder}" if vehicle is not None else f"Fleet {folder}"
    return Document(title, about, "a fleet", f"greybox-id {MADE_BY}", tuple(parts))


def _answer(how_far: FleetStatus, fleet_estimate: FleetEstimate, names: list[str]) -> Iterator[tuple[str, str]]:
    changed = fleet_estimate.drift[fleet_estimate.drift["drifts"] & fleet_estimate.drift["vehicle"].isin(names)]
    apart = fleet_estimate.vehicles[
        fleet_estimate.vehicles["sentence"].notna() & fleet_estimate.vehicles["vehicle"].isin(names)
    ]
    tested = fleet_estimate.drift[fleet_estimate.drift["vehicle"].isin(names)]["vehicle"].nunique()
    if tested:
        yield (
            "changed",
            f"{changed['vehicle'].nunique()} of {counted(tested, 'vehicle')} with enough recordings have changed, at "
            "a false discovery rate of 5 %.",
        )
    else:
        yield "changed", "No vehicle has enough recordings to test whether it has changed."
    listed = counted(
        fleet_estimate.vehicles[fleet_estimate.vehicles["vehicle"].isin(names)]["vehicle"].nunique(), "vehicle"
    )
    yield (
        "apart",
        (f"{apart['vehicle'].nunique()} of {listed} are further from the mean than the fleet's spread explains."),
    )
    set_apart = int(fleet_estimate.apart["vehicle"].isin(names).sum())
    if set_apart:
        yield (
            "set apart",
            (
                f"{counted(set_apart, 'recording')}: the fit ended in another optimum, or the "
                "recording is of another car."
            ),
        )
    counts = [how_far.vehicles[name] for name in names]
    broken = sum(sum(count.get(state, 0) for state in BROKEN) for count in counts)
    distrusted = sum(count.get(NOT_TRUSTED, 0) for count in counts)
    waiting = sum(count.get(WAITING, 0) for count in counts)
    all_of = sum(sum(count.values()) for count in counts)
    yield (
        "recordings",
        f"{all_of}: {broken} without a result, {distrusted} not to be trusted"
        f"{f', {waiting} not done yet' if waiting else ''}.",
    )


def _population(fleet_estimate: FleetEstimate) -> Table:
    rows = []
    for item in fleet_estimate.population.to_dict("records"):
        spread = "" if math.isnan(item["spread"]) else number(item["spread"], 2)
        ends = "" if not spread else f"[{number(item['spread_low'], 2)}, {number(item['spread_high'], 2)}]"
        mean, interval = _with_ends(item["mean"], item["low"], item["high"])
        rows.append((item["name"], mean, interval, pretty_unit(item["unit"]), spread, ends, str(item["recordings"])))
    head = ("parameter", "mean", "95 % interval", "unit", "spread", "95 % interval", "recordings")
    return Table(head, tuple(rows), "lrllrlr")


def _vehicles(fleet_estimate: FleetEstimate, names: list[str]) -> Table:
    """Values today, the vehicles that lie furthest apart first."""
    table = fleet_estimate.vehicles[fleet_estimate.vehicles["vehicle"].isin(names)]
    far = table["outlier"].abs().groupby(table["vehicle"]).max().fillna(0.0).sort_values(ascending=False, kind="stable")
    rows = []
    for name in list(far.index)[:MOST_ROWS]:
        for item in table[table["vehicle"] == name].to_dict("records"):
            today, interval = _with_ends(item["value"], item["low"], item["high"])
            _, following = _with_ends(item["value"], item["next_low"], item["next_high"])
            rows.append(
                (
                    str(name), item["name"], today, interval, following, pretty_unit(item["unit"]),
                    "" if math.isnan(item["outlier"]) else f"{item['outlier']:+.1f}", str(item["recordings"]),
                )
            )  # fmt: skip
    head = ("vehicle", "parameter", "today", "95 % interval", "next recording", "unit", "sd off", "n")
    return Table(head, tuple(rows), "llrlllrr")


def _with_ends(value: float, low: float, high: float) -> tuple[str, str]:
    """A value and its 95 % interval, both to two digits of the standard deviation."""
    shown, *ends = alike(value, low, high, by=(high - low) / (2.0 * Z))
    return shown, f"[{ends[0]}, {ends[1]}]"


def _more(table: pd.DataFrame) -> Iterator[Text]:
    """What a table of vehicles leaves out."""
    left = table["vehicle"].nunique() - MOST_ROWS
    if left > 0:
        yield Text(f"{counted(left, 'further vehicle')} nearer to the mean are not shown: see the dataset vehicles.")


def _apart(fleet_estimate: FleetEstimate, names: list[str]) -> Points:
    """Which recordings do not count, and why."""
    entry = fleet_estimate.apart[fleet_estimate.apart["vehicle"].isin(names)]
    return Points(tuple(entry["sentence"].head(MOST_BROKEN)))


def _gaps(store: Store, names: list[str]) -> Table:
    gaps = store.read("gaps").merge(store.current()[["key", "vehicle"]], on="key")
    gaps = gaps[gaps["vehicle"].isin(names) & gaps["detected"].fillna(False).astype(bool)]
    rows = []
    likely = gaps[gaps["probability"] > PROBABLE]
    for effect, item in likely.groupby("effect"):
        unit = pretty_unit(str(item["unit"].iloc[0]))
        rows.append(
            (
                str(effect),
                str(item["key"].nunique()),
                str(item["vehicle"].nunique()),
                number(item["magnitude"].median(), 3),
                unit,
            )
        )
    rows.sort(key=lambda item: -int(item[1]))
    return Table(("effect", "recordings", "vehicles", "median magnitude", "unit"), tuple(rows), "lrrrl")


def _states(how_far: FleetStatus, names: list[str]) -> Iterator[Part]:
    """Which vehicles have what is broken, the worst first."""
    states = sorted({state for name in names for state in how_far.vehicles[name]})
    not_ok = {name: sum(how_far.vehicles[name].values()) - how_far.vehicles[name].get(OK, 0) for name in names}
    worst = sorted((name for name in names if not_ok[name]), key=lambda name: (-not_ok[name], name))
    if worst:
        rows = [(name, *(str(how_far.vehicles[name].get(state, "")) for state in states)) for name in worst[:MOST_ROWS]]
        yield Table(("vehicle", *states), tuple(rows), "l" + "r" * len(states))
    if len(worst) > MOST_ROWS:
        yield Text(f"And {counted(len(worst) - MOST_ROWS, 'vehicle')} more with recordings that are not ok.")
    elif worst and len(names) > len(worst):
        yield Text(f"All recordings of the other {counted(len(names) - len(worst), 'vehicle')} are ok.")


def _broken(store: Store, names: list[str]) -> Iterator[Part]:
    rows = store.current()
    rows = rows[rows["vehicle"].isin(names) & (rows["status"] != OK)].sort_values(["status", "path"])
    if len(rows):
        listed = zip(rows["path"], rows["status"], rows["sentence"].fillna(""), strict=True)
        yield Section("Without a result, or not to be trusted", 2)
        shown = tuple((str(path), str(state), str(words)[:300]) for path, state, words in listed)[:MOST_BROKEN]
        yield Table(("recording", "status", "why"), shown, "llL")
        if len(rows) > MOST_BROKEN:
            yield Text(f"And {len(rows) - MOST_BROKEN} more, in the dataset recordings.")


def _made(store: Store, fleet_estimate: FleetEstimate) -> Pairs:
    rows = store.current()
    pairs = [
        ("results", str(store.folder)),
        ("greybox-id", ", ".join(sorted(set(rows["version"].dropna())))),
        ("joined", f"{counted(fleet_estimate.used, 'recording')}, whose fits are confirmed"),
        *([("second fits", f"{fleet_estimate.refitted}, with the fleet as prior")] if fleet_estimate.refitted else []),
        *(("omitted", f"{count}: {words}") for words, count in fleet_estimate.left_out.items()),
        ("processor", f"{rows['cpu_s'].sum() / 3600:.3g} h, {rows['cpu_s'].mean():.2f} s a recording"),
    ]
    return Pairs(tuple(pairs), ())


def _changes(store: Store, fleet_estimate: FleetEstimate, names: list[str]) -> Iterator[Part]:
    """A panel for each change that was found; for one vehicle, all its parameters."""
    rows = fleet_estimate.drift[fleet_estimate.drift["vehicle"].isin(names)]
    rows = (rows if len(names) == 1 else rows[rows["drifts"]]).sort_values("probability", ascending=False)
    recordings, parameters = store.current(), store.read("parameters")
    for row in rows.head(MOST_DRAWN).to_dict("records"):
        entry = {str(name): value for name, value in row.items()}
        figure = _change(entry, fleet_estimate, recordings, parameters)
        if figure is not None:
            yield Drawing(
                f"drift_{entry['vehicle']}_{entry['name']}",
                figure,
                f"{entry['sentence'] or entry['vehicle'] + ': ' + entry['name'] + ', no change found'}. "
                "Dots are fits of single recordings with their standard errors; recordings set apart are not drawn. "
                "The line "
                "is the vehicle's estimate; the band holds the date of a step with a probability of 95 %.",
                f"{entry['name']} of {entry['vehicle']} along its recordings.",
            )


def _change(
    entry: dict[str, Any], fleet_estimate: FleetEstimate, recordings: pd.DataFrame, parameters: pd.DataFrame
) -> Sheet | None:
    mine = recordings[recordings["vehicle"] == entry["vehicle"]]
    points = parameters[parameters["name"] == entry["name"]].merge(mine[["key", "path", "odometer"]], on="key")
    points = points[np.isfinite(points["sd"]) & ~points["key"].isin(set(fleet_estimate.apart["key"]))].sort_values(
        "path", kind="stable"
    )
    if points.empty:
        return None
    over = entry["over"]
    x = points[over].to_numpy(float) if over in ("time", "odometer") else np.arange(len(points), dtype=float)
    begin = float(x.min())
    x, words = _axis(x, over, begin)
    value, sd = points["value"].to_numpy(float), points["sd"].to_numpy(float)
    today = fleet_estimate.vehicles[
        (fleet_estimate.vehicles["vehicle"] == entry["vehicle"]) & (fleet_estimate.vehicles["name"] == entry["name"])
    ]
    now = float(today["value"].iloc[0])
    ends = np.array([x.min(), x.max()])
    level = look(ORANGE, 1.4, "vehicle")
    sheet = Sheet((PANEL,))
    ax = sheet.first()
    _dots(ax, x, value, np.minimum(sd, 10 * np.median(sd)), "single fits")
    if not entry["drifts"]:
        ax.plot(ends, [now, now], **level)
    elif entry["model"] == STEP:
        at = float(_axis(np.array([entry["at"]]), over, begin)[0][0])
        before = now - entry["change"]
        ax.plot([ends[0], at, at, ends[1]], [before, before, now, now], **level)
        early, late = (float(_axis(np.array([entry[end]]), over, begin)[0][0]) for end in ("at_low", "at_high"))
        ax.axvspan(early, late, color=PALE, linewidth=0.0, zorder=0)
        ax.axvline(at, **look(INK, 0.6, dashes=DASHED))
    else:
        ax.plot(ends, [now - entry["change"], now], **level)
    ax.set(xlabel=words, ylabel=label(entry["name"], entry["unit"]), title=str(entry["vehicle"]))
    return sheet


def _dots(ax: Axes, x: Array, value: Array, sd: Array, words: str) -> None:
    """Draw values with their standard errors."""
    ax.plot(x, value, **look(BLUE, label=words, dashes="", dots=2.2))
    ax.vlines(x, value - sd, value + sd, color=BLUE, linewidth=0.7)


def _axis(x: Array, over: str, begin: float) -> tuple[Array, str]:
    """Where recordings lie along the axis, and its label; time counts in days from the day of the first."""
    if over == "time":
        day = math.floor(begin / DAY) * DAY
        return (x - day) / DAY, f"days since {datetime.fromtimestamp(day, UTC):%Y-%m-%d} [d]"
    if over == "odometer":
        return x / 1000.0, "odometer [km]"
    return x, "recording [number]"


def _ranks(fleet_estimate: FleetEstimate) -> Iterator[Part]:
    """The vehicles of every parameter side by side, lowest first, over the population's spread."""
    for item in fleet_estimate.population.to_dict("records"):
        table = fleet_estimate.vehicles[fleet_estimate.vehicles["name"] == item["name"]].sort_values("value")
        whose = "every vehicle"
        if len(table) > MOST_ROWS:
            half = MOST_ROWS // 2
            table = table.iloc[[*range(half), *range(len(table) - half, len(table))]]
            whose = f"the {half} vehicles with the lowest and the {half} with the highest value"
        if len(table) < 3 or math.isnan(item["tau"]):
            continue
        x, value = np.arange(len(table), dtype=float), table["value"].to_numpy(float)
        reach = [item["mu"] - item["tau"], item["mu"] + item["tau"]]
        low, high = (math.exp(end) if item["logarithm"] else end for end in reach)
        whiskers = (table["high"].to_numpy(float) - table["low"].to_numpy(float)) / 4.0
        edge = np.array([-0.5, len(table) - 0.5])
        sheet = Sheet((PANEL,))
        ax = sheet.first()
        band(ax, edge, np.full(2, low), np.full(2, high), PALE, "one sd of the fleet")
        ax.axhline(item["mean"], **look(INK, 0.6, dashes=DASHED))
        _dots(ax, x, value, whiskers, "vehicles")
        ax.set(xlim=(-0.6, len(table) - 0.4), ylabel=label(item["name"], item["unit"]))
        ax.set_xticks(x, [str(name) for name in table["vehicle"]], rotation=90.0)
        ax.grid(visible=False, axis="x")
        yield Drawing(
            f"vehicles_{item['name']}",
            sheet,
            f"{item['name']} of {whose}, with its standard error. Uncertain estimates are shrunk towards the mean. "
            "The band is one standard deviation of the fleet about its mean.",
            f"{item['name']} of all vehicles.",
        )
