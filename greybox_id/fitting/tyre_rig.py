"""A magic formula fitted to measurements of a tyre rig: slip angle, load and side force.

F_y = F_z (D sin(C atan(B a - E (B a - atan(B a)))) + S_v), a = alpha + S_h, with PCY1, PDY1, PDY2, PEY1, PEY2, PKY1,
PKY2, PHY1 and PVY1 of version 5.2 (PKY4 = 2). Source: Pacejka, Tire and Vehicle Dynamics, 3rd ed., Sec. 4.3.2. One
formula is fitted to all rows near zero camber; friction and stiffness are then scaled for each temperature and
pressure, and the standard deviation of these factors is reported.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ..base.errors import BadInput
from ..base.shorthands import Array
from ..base.statistics import correlation_time
from ..base.units import known_unit, to_si
from ..datasets.column_map import Column, ColumnMap
from ..datasets.formats import contents
from ..datasets.raw_table import RawTable

COLUMNS: Mapping[str, tuple[str, str]] = {
    "slip": (r"sa|slip ?angle|alpha|schr(ä|ae)glaufwinkel", "rad"),
    "load": (r"f ?z|normal (force|load)|vertical (force|load)|load|radlast", "N"),
    "force": (r"f ?y|lateral force|side force|seitenkraft", "N"),
    "camber": (r"ia|inclination( angle)?|camber( angle)?|gamma|sturz", "rad"),
    "pressure": (r"p|((inflation|tyre|tire) )?pressure", "kPa"),
    "temperature": (r"tst[cio]|((tread|tyre|tire) )?temp(erature)?", "degC"),
}
"""Quantity recorded by a rig -> pattern of its column's name, and its unit here."""
DISPLAYED: Mapping[str, Callable[[Array], Array]] = {
    "kPa": lambda pascal: pascal / 1e3,
    "degC": lambda kelvin: kelvin - 273.15,
}
"""Conversions from SI to the usual units of pressures and temperatures."""
NEEDED = ("slip", "load", "force")
UPRIGHT = 0.01
"""Largest camber, rad, that counts as zero."""
MOST_SLIP = 1.2
FEWEST = 200
"""Smallest number of rows for a fit."""
SWEPT = 0.03
"""Slip angle, rad, that a sweep must exceed on both sides: without a bend of the curve, friction is unidentifiable."""
BANDS = 3
"""Number of temperature bands, with equally many rows."""
NEAR_PRESSURE = 0.08
"""Relative difference below which pressures count as equal."""
SMALLEST_BAND = 100
FREE = ("PCY1", "PDY1", "PDY2", "PEY1", "PEY2", "PKY1", "PKY2", "PHY1", "PVY1")
START = (1.4, 1.5, -0.1, -0.5, 0.0, 25.0, 1.5, 0.0, 0.0)
BOUNDS: Mapping[str, tuple[float, float]] = {
    "PCY1": (1.0, 2.2), "PDY1": (0.1, 5.0), "PDY2": (-2.0, 2.0), "PEY1": (-10.0, 1.0), "PEY2": (-5.0, 5.0),
    "PKY1": (1.0, 150.0), "PKY2": (0.3, 10.0), "PHY1": (-0.05, 0.05), "PVY1": (-0.5, 0.5),
}  # fmt: skip


@dataclass(frozen=True)
class Band:
    """Rows of one temperature and pressure.

    Attributes
    ----------
    words : temperature and pressure in words.
    rows : number of rows.
    friction, stiffness : factors on the formula of all rows.
    """

    words: str
    rows: int
    friction: float
    stiffness: float


@dataclass(frozen=True)
class TyreFit:
    """A magic formula and its goodness of fit.

    Attributes
    ----------
    numbers : KEY -> coefficient, with FNOMIN.
    sd : KEY -> standard deviation.
    rmse : N.
    explained : share of the side force's variance.
    rows, left_out : number of rows used, and of rows with another camber or missing values.
    bands : temperatures and pressures.
    friction_spread, stiffness_spread : standard deviation of the bands' factors; NaN with fewer than two.
    notes : remarks on how the file was read.
    largest_slip : rad, reached by 99 % of the rows.
    """

    numbers: Mapping[str, float]
    sd: Mapping[str, float]
    rmse: float
    explained: float
    rows: int
    left_out: int
    bands: tuple[Band, ...]
    friction_spread: float
    stiffness_spread: float
    largest_slip: float
    notes: tuple[str, ...] = field(default=())

    @property
    def usable(self) -> bool:
        """Whether the formula describes the measurements."""
        return self.explained > 0.9


def fit_tyre(files: Sequence[str | Path]) -> TyreFit:
    """Fit a magic formula to rig recordings.

    Parameters
    ----------
    files : text or other tables with slip angle, load and side force, in stated units or units recognised by size.

    Raises
    ------
    BadInput : a column is missing, rows are too few, or slip angles do not reach both sides.
    """
    parts = [_read(Path(file)) for file in files]
    data = {
        name: np.concatenate([item[name] for item, _ in parts]) for name in COLUMNS if all(name in p for p, _ in parts)
    }
    complete = np.all(np.isfinite([data[name] for name in NEEDED]), axis=0) & (
        np.abs(data["load"]) > 0.02 * np.nanmax(np.abs(data["load"]))
    )
    upright = np.abs(data["camber"]) <= UPRIGHT if "camber" in data else np.ones(len(complete), bool)
    rows = complete & upright
    if np.count_nonzero(rows) < FEWEST:
        raise BadInput(
            f"{files[0]}: {np.count_nonzero(rows)} rows at zero camber have slip, load and force; {FEWEST} are needed."
        )
    slip, load, force = (data[name][rows] for name in NEEDED)
    load = np.abs(load)
    if not (np.quantile(slip, 0.02) < -SWEPT and np.quantile(slip, 0.98) > SWEPT):
        raise BadInput(
            f"{files[0]}: slip angles must reach {SWEPT:g} rad to both sides; record a sweep of the slip angle."
        )
    near = np.abs(slip) < np.quantile(np.abs(slip), 0.3)
    force = force * np.sign(np.polyfit(slip[near], force[near], 1)[0])  # positive for positive slip, whatever the axes
    nominal = float(f"{np.median(load):.3g}")
    x, sd = _fitted(slip, load, force, nominal)
    residuals = force - _force(x, slip, load, nominal)
    bands = tuple(_bands({name: values[rows] for name, values in data.items()}, x, slip, load, force, nominal))
    friction, stiffness = (
        float(np.std(factors, ddof=1)) if len(factors) > 1 else float("nan")
        for factors in ([band.friction for band in bands], [band.stiffness for band in bands])
    )
    return TyreFit(
        numbers={"FNOMIN": nominal, **dict(zip(FREE, x.tolist(), strict=True))},
        sd=dict(zip(FREE, sd.tolist(), strict=True)),
        rmse=float(np.sqrt(np.mean(residuals**2))),
        explained=float(1 - np.var(residuals) / np.var(force)),
        rows=len(slip),
        left_out=int(len(complete) - len(slip)),
        bands=bands,
        friction_spread=friction,
        stiffness_spread=stiffness,
        largest_slip=float(np.quantile(np.abs(slip), 0.99)),
        notes=tuple(dict.fromkeys(note for _, notes in parts for note in notes)),
    )


def _read(file: Path) -> tuple[dict[str, Array], list[str]]:
    """Columns of a file by quantity, in SI units (pressure in kPa, temperature in degC), and remarks."""
    result = contents(file, ColumnMap("none", Column("time", "time", "s", "s"), {}))
    group = result.groups[0]
    cleaned_names = {
        name: re.sub(r"[\s_\-./]+", " ", re.sub(r"[\[(].*", "", name.removeprefix(group.prefix))).strip().lower()
        for name in group.names
    }
    chosen = {}
    for quantity, (pattern, _) in COLUMNS.items():
        name = next((name for name, word in cleaned_names.items() if re.fullmatch(pattern, word)), None)
        if name:
            chosen[quantity] = name
    lacking = [quantity for quantity in NEEDED if quantity not in chosen]
    if lacking:
        raise BadInput(
            f"{file}: no column name is a usual one for the {' or the '.join(lacking)} of a tyre rig (SA, FZ, FY); "
            "it has "
            f"{', '.join(group.names[:12])}. Name the columns so."
        )
    table = group.load(list(chosen.values()))
    notes, data = list(result.notes), {}
    for quantity, name in chosen.items():
        values = table.numbers(name)
        unit = _stated(table, group.units, name) or _likely(quantity, values)
        target = COLUMNS[quantity][1]
        conversion = to_si(unit, None if target in DISPLAYED else target)
        data[quantity] = DISPLAYED.get(target, np.asarray)(conversion.factor * values + conversion.offset)
        notes.append(f"{quantity} from column {name} in {unit}.")
    return data, notes


def _stated(table: RawTable, units: Mapping[str, str], name: str) -> str:
    """The unit stated in the file or in the column's name."""
    bracket = re.search(r"[\[(]\s*([^\])]*)", name)
    return units.get(name, "") or table.units.get(name, "") or (known_unit(bracket[1]) if bracket else "")


def _likely(what: str, values: Array) -> str:
    """The unit guessed from the size of the values, if a file states none."""
    size = float(np.nanquantile(np.abs(values), 0.99)) if np.isfinite(values).any() else 0.0
    if what in ("slip", "camber"):
        return "rad" if size < MOST_SLIP / 2 else "deg"
    if what in ("load", "force"):
        return "kN" if size < 50 else "N"
    if what == "pressure":
        return "bar" if size < 8 else "psi" if size < 60 else "kPa"
    return "degC"


def _curve(x: Array, slip: Array, load: Array, nominal: float) -> tuple[Array, Array, Array, Array, Array, Array]:
    """D, C, E, stiffness K, S_h and S_v for each row."""
    C, D_1, D_2, E_1, E_2, K_1, K_2, H_1, V_1 = x
    df = load / nominal - 1
    D = np.maximum(D_1 + D_2 * df, 1e-3)
    E = np.minimum(E_1 + E_2 * df, 1.0)
    K = K_1 * nominal * np.sin(2 * np.arctan(load / nominal / K_2))
    one = np.ones(len(slip))
    return D, C * one, E, K, H_1 * one, V_1 * one


def _force(x: Array, slip: Array, load: Array, nominal: float, friction: float = 1.0, stiffness: float = 1.0) -> Array:
    """F_y, N; friction and stiffness are factors like LMUY and LKY."""
    D, C, E, K, S_h, S_v = _curve(x, slip, load, nominal)
    D, K = D * friction, K * stiffness
    a = slip + S_h
    Ba = K / (C * D * load) * a
    return np.asarray(load * (D * np.sin(C * np.arctan(Ba - E * (Ba - np.arctan(Ba)))) + S_v * friction))


def _fitted(slip: Array, load: Array, force: Array, nominal: float) -> tuple[Array, Array]:
    """Coefficients and their standard deviations, corrected for the correlation of neighbouring residuals."""
    low, high = (np.array([BOUNDS[key][k] for key in FREE]) for k in (0, 1))
    scale = np.where(np.array(START) == 0, 0.1, np.abs(START))
    noise = 0.05 * float(np.quantile(np.abs(force), 0.95))
    best: Any = None

    def errors(x: Array) -> Array:
        return np.asarray((_force(x, slip, load, nominal) - force) / noise)

    for friction in (1.0, 1.6, 2.4):
        start = np.array([friction if key == "PDY1" else value for key, value in zip(FREE, START, strict=True)])
        result = least_squares(
            errors, start, bounds=(low, high), x_scale=scale, loss="soft_l1",
        )  # fmt: skip
        best = result if best is None or result.cost < best.cost else best
    residuals = _force(best.x, slip, load, nominal) - force
    correlation_rows = correlation_time(residuals[:, None])  # a sweep's hysteresis outlasts its rows
    J = best.jac * noise
    covariance = np.linalg.pinv(J.T @ J) * float(np.mean(residuals**2)) * correlation_rows
    return np.asarray(best.x), np.sqrt(np.maximum(np.diag(covariance), 0.0))


def _bands(data: Mapping[str, Array], x: Array, slip: Array, load: Array, force: Array, nominal: float) -> list[Band]:
    """Friction and stiffness factors of each temperature and pressure."""
    labels = [np.zeros(len(slip), int), np.zeros(len(slip), int)]
    names: list[list[str]] = [[""], [""]]
    if "pressure" in data and np.isfinite(data["pressure"]).all():
        labels[0], names[0] = _pressures(data["pressure"])
    if "temperature" in data and np.isfinite(data["temperature"]).all() and np.ptp(data["temperature"]) > 1:
        edges = np.quantile(data["temperature"], np.linspace(0, 1, BANDS + 1))
        labels[1] = np.clip(np.searchsorted(edges[1:-1], data["temperature"], side="right"), 0, BANDS - 1)
        names[1] = [f"{a:.0f} to {b:.0f} °C" for a, b in zip(edges, edges[1:], strict=False)]
    if len(names[0]) * len(names[1]) < 2:
        return []
    bands = []
    for i, j in np.ndindex(len(names[0]), len(names[1])):
        rows = (labels[0] == i) & (labels[1] == j)
        if np.count_nonzero(rows) < SMALLEST_BAND or np.quantile(np.abs(slip[rows]), 0.9) < SWEPT:
            continue

        def errors(factors: Array, rows: NDArray[np.bool_] = rows) -> Array:
            return _force(x, slip[rows], load[rows], nominal, *factors) - force[rows]

        result = least_squares(errors, np.ones(2), bounds=([0.2, 0.2], [3.0, 3.0]), loss="soft_l1",
                              f_scale=0.05 * float(np.quantile(np.abs(force), 0.95)))  # fmt: skip
        words = ", ".join(filter(None, (names[0][i], names[1][j])))
        bands.append(Band(words, int(np.count_nonzero(rows)), *map(float, result.x)))
    return bands


def _pressures(values: Array) -> tuple[NDArray[np.int64], list[str]]:
    """Set pressures, separated by gaps: number of each row's, and their names."""
    order = np.sort(values)
    edges = order[1:][np.diff(order) > NEAR_PRESSURE * order[:-1]]
    labels = np.searchsorted(edges, values, side="right")
    return labels, [f"{np.median(values[labels == k]):.0f} kPa" for k in range(len(edges) + 1)]


SECTIONS: Mapping[str, tuple[tuple[str, str], ...]] = {
    "MDI_HEADER": (("FILE_TYPE", "'tir'"), ("FILE_VERSION", "3.0"), ("FILE_FORMAT", "'ASCII'")),
    "UNITS": (
        ("LENGTH", "'meter'"),
        ("FORCE", "'newton'"),
        ("ANGLE", "'radians'"),
        ("MASS", "'kg'"),
        ("TIME", "'second'"),
    ),
    "MODEL": (("PROPERTY_FILE_FORMAT", "'PAC2002'"), ("FITTYP", "52"), ("USE_MODE", "2")),
}


def tyre_text(fit: TyreFit, source: str) -> str:
    """A tyre property file of the formula; comments give the factors of temperatures and pressures."""
    well = f"RMSE {fit.rmse:.1f} N, {100 * fit.explained:.1f} % explained"
    lines = [f"$ Magic formula of {source}: {fit.rows} rows, {well}"]
    lines += [f"$ {one.words}: friction x {one.friction:.3f}, stiffness x {one.stiffness:.3f}" for one in fit.bands]
    for section, keys in SECTIONS.items():
        lines += [f"[{section}]", *(f"{key} = {value}" for key, value in keys)]
    lines += ["[VERTICAL]", f"FNOMIN = {fit.numbers['FNOMIN']:g}", "[LATERAL_COEFFICIENTS]"]
    lines += [f"{key} = {fit.numbers[key]:.8g}" for key in FREE]
    return "\n".join([*lines, "PKY4 = 2"]) + "\n"
