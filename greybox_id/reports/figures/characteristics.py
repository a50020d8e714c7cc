"""Figures of estimated characteristics: tyres, handling, steering, impulse responses, over the density of samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import product

import numpy as np
from matplotlib.axes import Axes

from ...base.numbers import number, quantity
from ...base.shorthands import Array
from ...base.signals import SIGNALS
from ...datasets.recording import Recording
from ...engine.trace import Trace
from ...fitting.fit import Fit, combined
from ...models.memory_model import MemoryModel
from ...models.model import Combination, Model, Namespace
from ...models.motion_model import MotionModel
from ...models.parameter import Parameter, placed
from ..recordings import MOVING, Driven, Seen, of_role, typical_speed
from ..settled import OverSlip, steady_turns
from .sheet import (
    BLUE,
    LEVELS,
    ORANGE,
    PALE,
    ZERO,
    Look,
    Sheet,
    apart,
    band,
    density,
    label,
    look,
    scale_of_counts,
    sheet_of,
    symbol,
)

WITHIN = (0.001, 0.999)
"""Quantiles of the samples that bound the map."""
CELLS = (40, 26)
TITLES = {"train": "training", "validate": "validation"}


def excitation(recordings: Sequence[Seen]) -> Sheet | None:
    """Densities of samples over v_x and a_y, a panel per role; None if speed or turning was not recorded."""
    points = {role: driven_points([one.recording for one in of_role(recordings, role)]) for role in TITLES}
    points = {role: point for role, point in points.items() if len(point)}
    if not points:
        return None
    every = np.vstack(list(points.values()))
    v_x, a_y = (apart((float(low), float(high))) for low, high in np.quantile(every, WITHIN, axis=0).T)
    sheet, counts = Sheet((120.0,), len(points)), []
    for ax, (role, point) in zip(sheet.grid[0], points.items(), strict=True):
        counts.append(density(ax, point[:, 0], point[:, 1], v_x, a_y, CELLS))
        ax.axhline(0.0, **ZERO)
        ax.set(title=TITLES[role], xlabel="v_x [m/s]", xlim=v_x, ylim=a_y)
    scale_of_counts(ax, max(counts))
    sheet.first().set_ylabel("a_y [m/s²], left positive")
    return sheet


def driven_points(recordings: Sequence[Recording]) -> Array:
    """(n, 2) speed and lateral acceleration of all samples with both; v_x times yaw rate if a_y was not recorded."""
    parts = [np.empty((0, 2))]
    for recording in recordings:
        if "v_x" not in recording:
            continue
        if "a_y" in recording:
            parts.append(np.column_stack([recording["v_x"], recording["a_y"]]))
        elif "yaw_rate" in recording:
            parts.append(np.column_stack([recording["v_x"], recording["v_x"] * recording["yaw_rate"]]))
    whole = np.vstack(parts)
    return whole[np.all(np.isfinite(whole), axis=1)]


AXLES = {"f": "front", "r": "rear"}
SLIP_POINTS = 41
REACH_BEYOND = 1.4
"""Range of the curves relative to that of the slip angles during driving."""
LEAST_SLIP = 0.02
"""Least range of the curves, slip angle in rad."""
DRIVEN = (0.005, 0.995)
"""Quantiles of the slip angles during driving that bound the thick part of the curves."""
ROOM = 2.0
"""Largest range of the axis relative to the curves' largest value: the band may be wide outside the data."""


def has_tyres(model: MotionModel) -> bool:
    """Whether a model has axles with slip angles, lateral forces and loads."""
    target = [f"{quantity}{axle}" for quantity in ("alpha_", "F_y", "F_z") for axle in AXLES]
    return set(target) <= set(model.quantities)


def tyres(model: MotionModel, fit: Fit, recordings: Sequence[Driven]) -> Sheet | None:
    """Tyre curves of both axles with 95 % bands, over the density of slip angles; None for models without axles."""
    if not has_tyres(model):
        return None
    speed = typical_speed(recordings)
    beyond = look(BLUE, 0.7, "fit, beyond")
    sheet, top, reached = Sheet((120.0, 40.0), len(AXLES), joined=True), 0.0, 0.0
    for (above, below), (axle, where) in zip(sheet.grid.T, AXLES.items(), strict=True):
        slip = np.concatenate([one.quantities[f"alpha_{axle}"] for one in recordings])
        ends = np.quantile(slip, DRIVEN) if len(slip) else np.zeros(2)
        reach = max(REACH_BEYOND * float(np.max(np.abs(ends))), LEAST_SLIP)
        angles = np.linspace(-reach, reach, SLIP_POINTS)
        above.axhline(0.0, **ZERO)
        share, low, high = draw_tyre(above, fit, OverSlip(model, axle, speed), angles, beyond, "95 % band")
        inside = (angles >= ends[0]) & (angles <= ends[1]) if len(slip) else np.zeros(len(angles), dtype=bool)
        above.plot(angles, np.where(inside, share, np.nan), **look(BLUE, 2.0, "fit, where driven"))
        top = max(top, float(np.max(np.abs(share))))
        reached = max(reached, float(np.nanmax(np.abs([share, low, high]))))
        counts, edges = np.histogram(slip, bins=60, range=(-reach, reach), density=len(slip) > 0)
        below.stairs(counts, edges, fill=True, color=PALE)
        above.set_title(f"{where} axle")
        below.set(xlabel=f"slip angle alpha_{axle} [rad]", xlim=(-reach, reach), ylabel="density [1/rad]")
        below.set_ylim(bottom=0.0)
    end = min(ROOM * top, 1.05 * reached) or 1.0
    for above in sheet.grid[0]:
        above.set(ylabel="F_y / F_z [1]", ylim=(-end, end))
    return sheet


def draw_tyre(
    ax: Axes, fit: Fit, curve: OverSlip, angles: Array, line: Look, words: str | None = None
) -> tuple[Array, Array, Array]:
    """Draw a curve with its 95 % band, labelled with `words`, and return both."""
    share, low, high = share_with_band(fit, curve, angles)
    band(ax, angles, low, high, line["color"], words)
    ax.plot(angles, share, **line)
    return share, low, high


def share_with_band(fit: Fit, curve: OverSlip, angles: Array) -> tuple[Array, Array, Array]:
    """A curve at the estimates and its first-order 95 % band; the band is NaN if the fit has no covariance."""
    model = fit.model
    names = [p.name for p in model.parameters]
    share = curve(angles, model.values)
    if fit.covariance is None:
        nothing = np.full(len(angles), np.nan)
        return share, nothing, nothing
    intervals = []
    for angle in angles:
        at = Combination("F_y / F_z", "1", partial(_share, curve, angle, names))
        intervals.append(combined(at, model, fit.covariance, fit.dof))
    return share, np.array([one.low for one in intervals]), np.array([one.high for one in intervals])


def _share(curve: OverSlip, angle: float, names: Sequence[str], p: Namespace) -> float:
    return float(curve(np.array([angle]), np.array([getattr(p, name) for name in names]))[0])


A_Y, BEYOND = "lateral acceleration v_x · yaw rate [m/s²]", "steer − wheelbase · curvature [rad]"
TURN_POINTS = 81
SEEN, SHOWN = (0.005, 0.995), (0.01, 0.99)
"""Quantiles of the samples: the curve is thick within the first, the axes end at the second."""


def handling(model: MotionModel, recordings: Sequence[Driven]) -> Sheet | None:
    """Steady turns of the model over the density of measured samples; None for models without steering.

    The wheelbase is the estimate of the fit.
    """
    if not is_steered(model):
        return None
    steer, v_x, yaw_rate = _measured(recordings)
    speed = typical_speed(recordings)
    reach = float(np.quantile(np.abs(steer), SEEN[1])) * 1.2 if len(steer) else 0.3
    turns = turns_beyond_curvature(model, speed, reach)
    if turns is None:
        return None
    a_y, beyond = turns
    sheet, ends = Sheet((135.0,)), np.zeros(2)
    ax = sheet.first()
    if len(steer):
        L = float(model["l_f"].array + model["l_r"].array)
        measured, need = yaw_rate * v_x, steer - L * yaw_rate / v_x
        low, high = np.quantile(need, SHOWN)
        within = (*np.quantile(measured, SHOWN).tolist(),), (min(low, np.nanmin(beyond)), max(high, np.nanmax(beyond)))
        scale_of_counts(ax, density(ax, measured, need, *within))
        ends = np.quantile(measured, SEEN)
    inside, words = (a_y >= ends[0]) & (a_y <= ends[1]), f"model at {speed:.3g} m/s"
    ax.axhline(0.0, **ZERO)
    ax.plot(a_y, beyond, **look(BLUE, 0.8, "beyond" if np.any(inside) else words))
    if np.any(inside):
        ax.plot(a_y, np.where(inside, beyond, np.nan), **look(BLUE, 2.0, f"{words}, where driven"))
    ax.set(xlabel=A_Y, ylabel=BEYOND)
    return sheet


def is_steered(model: MotionModel) -> bool:
    """Whether a model has a handling diagram."""
    return "steer" in model.inputs and "yaw_rate" in model.outputs and "l_f" in model and "l_r" in model


def turns_beyond_curvature(model: MotionModel, speed: float, reach: float) -> tuple[Array, Array] | None:
    """Lateral acceleration, m/s², and steering minus wheelbase times curvature, rad, in steady turns to both sides.

    None if there are no steady turns.
    """
    angles = np.linspace(0.0, reach, TURN_POINTS)
    sides = [steady_turns(model, side * angles, speed) for side in (-1.0, 1.0)]
    if sides[0] is None or sides[1] is None:
        return None
    rate = np.concatenate([sides[0][:0:-1], sides[1]])
    L = float(model["l_f"].array + model["l_r"].array)
    return rate * speed, np.concatenate([-angles[:0:-1], angles]) - L * rate / speed


def _measured(recordings: Sequence[Driven]) -> tuple[Array, Array, Array]:
    """Steering angle, speed and yaw rate of samples that have all three and are moving."""
    target = ("steer", "v_x", "yaw_rate")
    complete = [one.recording for one in recordings if all(name in one.recording for name in target)]
    table = np.vstack([np.empty((0, 3)), *(np.column_stack([r[name] for name in target]) for r in complete)])
    table = table[np.all(np.isfinite(table), axis=1)]
    top = float(np.quantile(table[:, 1], 0.99)) if len(table) else 0.0
    table = table[table[:, 1] > MOVING * top]
    return table[:, 0], table[:, 1], table[:, 2]


BINS = 60
REACH = 0.998
"""Share of the samples within the axes, in both directions."""
KILO = 1000.0
"""Largest force, N, from which forces are drawn in kN."""


def forces_over_slip(values: Mapping[str, Array]) -> Sheet | None:
    """Estimated axle forces over slip angles, a panel per axle; None for models without these."""
    target = [f"{kind}{axle}" for kind in ("alpha_", "F_y") for axle in AXLES]
    if not all(name in values for name in target):
        return None
    sheet = Sheet((150.0,), len(AXLES))
    largest = max(float(np.nanquantile(np.abs(values[f"F_y{axle}"]), REACH)) for axle in AXLES)
    scale, unit = (1000.0, "kN") if largest >= KILO else (1.0, "N")
    for ax, (axle, where) in zip(sheet.grid[0], AXLES.items(), strict=True):
        pairs = np.column_stack([values[f"alpha_{axle}"], values[f"F_y{axle}"] / scale])
        slip, force = pairs[np.all(np.isfinite(pairs), axis=1)].T
        ends = [max(float(np.quantile(np.abs(a), REACH)), 1e-6) * 1.1 for a in (slip, force)]
        area = ((-ends[0], ends[0]), (-ends[1], ends[1]))
        density(ax, slip, force, *area, (BINS, BINS))
        ax.plot(*_medians(slip, force, ends[0]), **look(ORANGE, 1.2, "median"))
        ax.set(xlabel=f"slip angle alpha_{axle} [rad]", xlim=area[0], ylabel=f"lateral force F_y{axle} [{unit}]",
               ylim=area[1], title=f"{where} axle")  # fmt: skip
    return sheet


def _medians(slip: Array, force: Array, reach: float) -> tuple[Array, Array]:
    """Median force in bins of slip with enough samples."""
    edges = np.linspace(-reach, reach, BINS // 2 + 1)
    number = np.digitize(slip, edges) - 1
    middle, median = [], []
    for k in range(len(edges) - 1):
        value = force[number == k]
        if len(value) >= 10:
            middle.append((edges[k] + edges[k + 1]) / 2)
            median.append(np.median(value))
    return np.array(middle), np.array(median)


QUANTILES = (0.1, 0.95)
"""Quantiles of the speed between which the characteristic is drawn at three speeds."""
SAME_SPEED = 0.15
"""Relative difference up to which a sample counts as recorded at a speed."""
SEEN_AT_SPEED = (0.005, 0.995)
"""Quantiles of the steering angles at a speed; the characteristic is drawn thin outside them."""
STEERING_POINTS = 161
ROUNDS = 30
"""Iterations for inputs that follow from the outputs."""


def has_steering(model: Model) -> bool:
    """Whether a model has a steering characteristic: a yaw rate from speed and steering angle."""
    return "yaw_rate" in model.outputs and {"v_x", "steer"} <= set(model.inputs)


def steering(model: MemoryModel, recordings: Sequence[Seen]) -> Sheet | None:
    """Quasi-steady state of the model over the density of measured samples; None for models without one."""
    if not has_steering(model):
        return None
    v_x, steer, yaw_rate = (
        np.concatenate([one.recording[name] for one in recordings]) for name in ("v_x", "steer", "yaw_rate")
    )
    whole = np.isfinite(v_x) & np.isfinite(steer) & np.isfinite(yaw_rate)
    top = float(np.quantile(v_x[whole], 0.99))
    moving = whole & (v_x > MOVING * top)
    v_x, steer, yaw_rate = v_x[moving], steer[moving], yaw_rate[moving]
    trace = Trace(model)
    sheet = Sheet((150.0,))
    ax = sheet.first()
    speeds, angles = [1.0], np.linspace(-0.3, 0.3, STEERING_POINTS)
    if len(v_x):
        rho = yaw_rate / v_x
        low, high = np.quantile(rho, [0.002, 0.998])
        ends = (float(steer.min()), float(steer.max())), (float(low), float(high))
        scale_of_counts(ax, density(ax, steer, rho, *ends))
        slow, fast = (float(item) for item in np.quantile(v_x, QUANTILES))
        speeds = sorted({round(float(speed), 1) for speed in np.linspace(slow, fast, 3)})
        angles = np.linspace(float(steer.min()), float(steer.max()), STEERING_POINTS)
    for speed, line in zip(speeds, LEVELS[-len(speeds) :], strict=True):
        rho = steady_yaw_rate(trace, angles, speed) / speed
        near = steer[np.abs(v_x - speed) < SAME_SPEED * speed]
        first, last = np.quantile(near, SEEN_AT_SPEED) if len(near) else (0.0, 0.0)
        inside = (angles >= first) & (angles <= last)
        ax.plot(angles, rho, **line | {"linewidth": 0.6, "linestyle": "-"})
        thick = line | {"linewidth": 1.9, "label": f"model at {speed:g} m/s"}
        ax.plot(angles, np.where(inside, rho, np.nan), **thick)
    ax.set(xlabel=label("steer", "rad"), ylabel="curvature = yaw rate / v_x [1/m]")
    return sheet


def steady_yaw_rate(trace: Trace, steer: Array, v_x: float) -> Array:
    """Yaw rate at inputs that are constant over the whole window, without longitudinal acceleration.

    Parameters
    ----------
    trace : the model's equations.
    steer : (n,) steering angles, rad.
    v_x : speed, m/s.

    Returns
    -------
    (n,) rad/s. Inputs other than v_x, steer and a_x = 0 follow from the outputs if the model defines how; the others
    are at the model's default, or zero.
    """
    model, p = trace.model, trace.model.values
    u = np.zeros((len(steer), len(model.inputs)))
    for k, name in enumerate(model.inputs):
        u[:, k] = steer if name == "steer" else v_x if name == "v_x" else model.defaults.get(name, 0.0)
    gains = trace.weights(p).reshape(len(trace.tap_signal), trace.memory).sum(axis=1)
    following = [(k, model.inputs.index(name)) for k, name in enumerate(trace.fed_back) if name != "a_x"]
    for _ in range(ROUNDS if following else 1):
        y = trace.head(trace.stage(u, p)[:, trace.tap_signal] * gains, u, p)
        if following:
            fed = trace.feedback(y, u)
            for place, column in following:
                u[:, column] = fed[:, place]
    rates: Array = y[:, model.outputs.index("yaw_rate")]
    return rates


COLUMNS = 3
MOST_PANELS = 6
"""Most responses of a parameter in panels of their own; more (a network's first layer) share one without bands."""


def responses(model: MemoryModel) -> tuple[Parameter, ...]:
    """The parameters whose last axis contains the weights of a window, oldest sample first."""
    trace = Trace(model)
    by_p = trace.weights_by_p
    lag_of = dict(zip(by_p.column.tolist(), (by_p.row % trace.memory).tolist(), strict=True))
    result = []
    for parameter, place in placed(model.parameters):
        if len(parameter.shape) == 0 or parameter.shape[-1] < 2:
            continue
        length = parameter.shape[-1]
        lags = [trace.memory - length + k % length for k in range(parameter.size)]
        if [lag_of.get(entry) for entry in range(place.start, place.stop)] == lags:
            result.append(parameter)
    return tuple(result)


def impulse_responses(model: MemoryModel, fit: Fit) -> Sheet | None:
    """Weights over age with a band of one standard deviation, a panel per response; None if the model has none."""
    shown = [
        (parameter, rows)
        for parameter in responses(model)
        for rows in ([[index] for index in _indices(parameter)] if _few(parameter) else [_indices(parameter)])
    ]
    if not shown:
        return None
    sheet, axes = sheet_of(len(shown), COLUMNS, 76.0)
    for ax, (parameter, rows) in zip(axes, shown, strict=True):
        _draw(ax, fit, model.sample_time, parameter, rows)
    return sheet


def _draw(ax: Axes, fit: Fit, step: float, parameter: Parameter, rows: list[tuple[int, ...]]) -> None:
    """One response with its band, or several as thin lines. The newest sample is one sample time before the output."""
    age = step * np.arange(float(parameter.shape[-1]), 0.0, -1.0)
    sd = np.asarray(fit.sd.get(parameter.name, np.zeros(parameter.shape)))
    shown = parameter.array
    low, high = float(np.min(shown - sd)), float(np.max(shown + sd))
    room = 0.05 * max(high - low, 1e-12)
    ax.axhline(0.0, **ZERO)
    if len(rows) == 1:
        weights, spread = shown[rows[0]], sd[rows[0]]
        band(ax, age, weights - spread, weights + spread)
        ax.plot(age, weights, **look(BLUE, dots=1.1))
        title = _title(parameter, rows[0])
    else:
        for index in rows:
            ax.plot(age, shown[index], **look(BLUE, 0.6))
        title = f"all {len(rows)}, typical sd {number(float(np.sqrt(np.mean(sd**2))), 2)}"
    ax.set(xlabel="age [s]", xlim=(age[0] + step, 0.0), ylabel=label(parameter.name, parameter.unit),
           ylim=(low - room, high + room), title=title)  # fmt: skip


def _title(parameter: Parameter, index: tuple[int, ...]) -> str:
    """Centre of the local model that a response belongs to, or its indices."""
    if index and len(parameter.axes) == len(index):
        return ", ".join(
            f"{symbol(name)} = {quantity(centres[k], SIGNALS[name].unit)}"
            for (name, centres), k in zip(parameter.axes, index, strict=True)
        )
    return f"{symbol(parameter.name)}[{', '.join(str(k + 1) for k in index)}]" if index else ""


def _indices(parameter: Parameter) -> list[tuple[int, ...]]:
    return list(product(*(range(n) for n in parameter.shape[:-1])))


def _few(parameter: Parameter) -> bool:
    return parameter.size // parameter.shape[-1] <= MOST_PANELS
