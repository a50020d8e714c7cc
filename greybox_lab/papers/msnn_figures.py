"""Figures 2 and 7 to 12 of the paper on model-structured networks, drawn of what the bench measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from greybox_id.base.numbers import number, pretty_unit
from greybox_id.base.shorthands import Array
from greybox_id.base.statistics import correlation_time
from greybox_id.datasets.recording import Recording
from greybox_id.engine.simulation import Prediction
from greybox_id.fitting.fit import Fit
from greybox_id.fitting.grid import Grid
from greybox_id.models.memory_model import MemoryModel
from greybox_id.models.model import must_be
from greybox_id.reports.figures.predictions import psd
from greybox_id.reports.figures.sheet import (
    BLUE,
    CHAIN,
    DASHED,
    DOTTED,
    INK,
    LEVELS,
    MEASURED,
    NOISE,
    ORANGE,
    PALE,
    PURPLE,
    RUST,
    ZERO,
    Look,
    Sheet,
    band,
    boxes,
    density,
    label,
    look,
    scale_of_counts,
    signal_label,
)
from greybox_id.reports.recordings import Noise

LOOKS = {
    "MS-NN-full": look(BLUE, 1.1, "MS-NN-full"),
    "G-NN": look(ORANGE, 1.0, "G-NN", dashes=DASHED),
    "MS-NN-bench": look(PURPLE, 1.0, "MS-NN-bench", dashes=CHAIN),
}
"""How the models of Figs. 8 and 10 are drawn."""
SPEED_RANGES = 3
"""Thirds of the samples by speed, in Fig. 2."""
MOVING = 0.25
"""Curvature is measured where the car is faster than this share of its top speed: it is noise below."""
SHOWN = (0.002, 0.998)
"""Quantiles of what is drawn as a density."""
WHEELBASE = 0.325
"""Of the RoboRacer, m: between the 0.32 and 0.33 m of its data sheets."""
STEADY = (0.15, 0.5)
"""A sample is quasi-steady where yaw acceleration and dv_x/dt, shares of their standard deviations, are below these."""
SMOOTH = 5
"""Samples over which rates of change are taken."""
SECONDS = 8.0
"""Length of the stretches that are drawn."""
CARS = {
    "nominal": look(INK, 1.3, "nominal"), "tire_set_1": look(RUST, 1.3, "tyres 1", dashes=DASHED),
    "tire_set_2": look(PURPLE, 1.3, "tyres 2", dashes=CHAIN),
    "single_mass": look(BLUE, 1.3, "single_mass", dashes=DOTTED),
}  # fmt: skip
"""How the cars of Fig. 11 are drawn."""
PUBLISHED = {"msnn_lat": (160, -1234.5), "msnn_long": (384, 2922.7)}
"""Parameters and AIC of the authors' stored networks on valid.csv, from their own weights."""


def speed_ranges(train: Recording, fit: Fit) -> Sheet:
    """Fig. 2: curvature over steering in three ranges of speed with least-squares lines, and memberships."""
    v_x, steer, yaw_rate = (train[name] for name in ("v_x", "steer", "yaw_rate"))
    known = np.isfinite(v_x) & np.isfinite(steer) & np.isfinite(yaw_rate)
    known &= v_x > MOVING * float(np.quantile(v_x[known], 0.99))
    v_x, steer, rho = v_x[known], steer[known], yaw_rate[known] / v_x[known]
    sheet = Sheet((140.0,), 2, widths=(1.7, 1.0))
    left, right = sheet.grid[0]
    across, along = ((float(low), float(high)) for low, high in (np.quantile(item, SHOWN) for item in (steer, rho)))
    scale_of_counts(left, density(left, steer, rho, across, along))
    edges = np.quantile(v_x, np.linspace(0, 1, SPEED_RANGES + 1))
    angles = np.array(across)
    for low, high, line in zip(edges[:-1], edges[1:], LEVELS, strict=True):
        inside = (v_x >= low) & (v_x <= high)
        slope, offset = np.polyfit(steer[inside], rho[inside], 1)
        words = f"{low:.1f} to {high:.1f} m/s: slope {slope:.2f} 1/(m rad)"
        left.plot(angles, slope * angles + offset, **line | {"label": words, "linewidth": 1.6})
    left.set(xlabel=label("steer", "rad"), ylabel="curvature = yaw rate / v_x [1/m]", xlim=across, ylim=along)
    centres = np.array(fit.model.settings["steer"])
    reach = 0.25 * float(np.ptp(centres)) / max(1, len(centres) - 1)
    at = np.linspace(centres[0] - reach, centres[-1] + reach, 401)
    for k, unit in enumerate(np.eye(len(centres))):
        right.plot(at, np.interp(at, centres, unit), **LEVELS[k % len(LEVELS)] | {"linewidth": 1.2})
    right.set(xlabel=label("steer", "rad"), ylabel="membership [1]", ylim=(0.0, 1.05))
    return sheet


def criterion(grids: Mapping[str, Grid]) -> Sheet:
    """Fig. 7: AIC on the validation recording over the number of parameters."""
    sheet = Sheet((140.0,), len(grids))
    for ax, (name, grid) in zip(sheet.grid[0], grids.items(), strict=True):
        k, aic = (grid.table[column].to_numpy(dtype=float) for column in ("parameters", "aic"))
        ax.plot(k, aic, **look(PALE, 0.0, "structures", dashes="", dots=1.4))
        order = np.lexsort((aic, k))
        best = np.minimum.accumulate(aic[order])
        low = order[np.flatnonzero(np.concatenate(([True], np.diff(best) < 0)))]
        ax.plot(k[low], aic[low], **look(BLUE, 1.0, "least so far", dots=1.6))
        chosen = look(INK, 0.0, "by cross-validation on the training data", dashes="", dots=3.2)
        ax.plot([grid.chosen["parameters"]], [grid.chosen["aic"]], **chosen)
        ax.plot(
            *[[item] for item in PUBLISHED[name]], linestyle="", marker="x", color=RUST, label="the authors' weights"
        )
        ax.set(xlabel="parameters [number]", ylabel="AIC on valid.csv [1]", title=name)
    return sheet


def predicted(seen: Mapping[str, Mapping[str, Prediction]], recordings: Mapping[str, Recording], output: str) -> Sheet:
    """Figs. 8 and 10: box plots of errors of every model, and stretches of both recordings.

    Parameters
    ----------
    seen : recording -> model -> its predictions of the output.
    recordings : name -> recording, those of `seen`.
    output : a signal.
    """
    sheet = Sheet((90.0, *(95.0,) * len(recordings)))
    top, *below = sheet.grid[:, 0]
    samples, at, names = [], [], []
    for n, (name, models) in enumerate(seen.items()):
        for k, (model, item) in enumerate(models.items()):
            samples.append(item.predicted[:, 0] - item.measured[:, 0])
            at.append(n * (len(models) + 1) + k)
            names.append(f"{model}\n{name}")
    top.axhline(0.0, **ZERO)
    top.grid(visible=False, axis="x")
    boxes(top, at, samples, BLUE, 0.55)
    top.set_xticks(at, names)
    top.set_ylabel("error of " + signal_label(next(iter(recordings.values())), output))
    for ax, (name, models) in zip(below, seen.items(), strict=True):
        recording = recordings[name]
        start, stop = busiest(recording, next(iter(models.values())))
        lines = {model: (item, LOOKS[model]) for model, item in models.items()}
        stretch(ax, recording, output, start, stop, lines)
        ax.set_title(name)
    return sheet


def stretch(
    ax: Axes, recording: Recording, output: str, start: int, stop: int,
    lines: Mapping[str, tuple[Prediction, Look]],
) -> None:  # fmt: skip
    """Draw a stretch of a recording, measured and predicted."""
    time = recording.time
    ax.plot(time[start:stop], recording[output][start:stop], **MEASURED)
    for item, line in lines.values():
        inside = (item.rows >= start) & (item.rows < stop)
        ax.plot(time[item.rows[inside]], item.predicted[inside, 0], **line)
    ax.set(xlabel="time [s]", ylabel=signal_label(recording, output), xlim=(time[start], time[stop - 1]))


def busiest(recording: Recording, seen: Prediction) -> tuple[int, int]:
    """Rows of the stretch of some seconds, all predicted and of one run, in which the measured signal varies most."""
    length = round(SECONDS / recording.sample_time)
    best, most = seen.rows[:length], -1.0
    for number_ in np.unique(seen.run):
        value = np.flatnonzero(seen.run == number_)
        for first in range(0, max(1, len(value) - length), max(1, length // 4)):
            part = value[first : first + length]
            varies = float(np.std(seen.measured[part, 0])) * (len(part) == length)
            if varies > most:
                best, most = seen.rows[part], varies
    return int(best[0]), int(best[-1]) + 1


def densities(seen: Mapping[str, Prediction], recording: Recording, output: str, heard: Noise | None) -> Sheet:
    """Fig. 10d: power spectral densities of the measured signal and of the models' residuals."""
    sheet = Sheet((120.0,))
    ax, rate = sheet.first(), 1.0 / recording.sample_time
    first = next(iter(seen.values()))
    curves = [(MEASURED, _runs(first, first.measured[:, 0]))]
    curves += [
        (LOOKS[model] | {"label": f"residual of {model}"}, _runs(item, item.predicted[:, 0] - item.measured[:, 0]))
        for model, item in seen.items()
    ]
    if heard is not None and heard.of(output):
        curves.append((NOISE | {"label": f"noise, {heard.where}"}, heard.of(output)))
    for line, parts in curves:
        frequency, power = psd(parts, rate)
        ax.plot(frequency[1:], power[1:], **line)
    unit = pretty_unit(recording.unit(output))
    ax.set(xlabel="frequency [Hz]", ylabel=f"PSD of {output} [({unit})²/Hz]", xscale="log", yscale="log")
    ax.set_xlim(right=round(rate / 2, 6))
    return sheet


def _runs(seen: Prediction, values: Array) -> list[Array]:
    return [values[seen.run == number] for number in np.unique(seen.run)]


def responses(fit: Fit) -> Sheet:
    """Fig. 9: impulse responses of the local models of MS-NN-lat, with bands of one standard deviation."""
    F, sd = fit.model["F"], np.asarray(fit.sd["F"])
    weights = F.array.reshape(-1, F.shape[-1])
    spread = sd.reshape(weights.shape)
    step = must_be(MemoryModel, fit.model).sample_time
    age = step * np.arange(float(F.shape[-1]), 0.0, -1.0)
    centres = [item for _, item in F.axes]
    sheet = Sheet((95.0,) * F.shape[0], max(1, len(weights) // F.shape[0]))
    for n, (ax, weight, each) in enumerate(zip(sheet.grid.flat, weights, spread, strict=True)):
        place = np.unravel_index(n, F.shape[:-1])
        ax.axhline(0.0, **ZERO)
        band(ax, age, weight - each, weight + each)
        ax.plot(age, weight, **look(BLUE, dots=1.2))
        names = [
            f"{name} = {number(values[k], 2)}" for (name, _), values, k in zip(F.axes, centres, place, strict=True)
        ]
        ax.set(xlabel="age [s]", ylabel="weight [1]", xlim=(age[0] + step, 0.0),
               title=", ".join(names))  # fmt: skip
    reach = (float(np.min(weights - spread)), float(np.max(weights + spread)))
    for ax in sheet.grid.flat:
        ax.set_ylim(1.05 * reach[0], 1.05 * reach[1])
    return sheet


def handling(cars: Mapping[str, Recording]) -> Sheet:
    """Fig. 11b: steering less wheelbase times curvature over lateral acceleration, quasi-steady, with cubic fits."""
    sheet = Sheet((150.0,))
    ax = sheet.first()
    ax.axhline(0.0, **ZERO)
    for name, recording in cars.items():
        a_y, beyond = quasi_steady(recording)
        if len(a_y) < 30:
            continue
        line = CARS[name]
        ax.plot(a_y, beyond, color=line["color"], linestyle="", marker="o", markersize=1.2, markeredgewidth=0.0,
                alpha=0.35)  # fmt: skip
        low, high = (float(item) for item in np.quantile(a_y, (0.02, 0.98)))
        at = np.linspace(low, high, 61)
        powers = [np.vander(x / 5.0, 4) for x in (a_y, at)]
        result, *_ = np.linalg.lstsq(powers[0], beyond, rcond=None)
        left = beyond - powers[0] @ result
        variance = float(np.mean(left**2)) * max(1.0, correlation_time(left[:, None]))
        inverse = np.linalg.pinv(powers[0].T @ powers[0])
        sd = np.sqrt(variance * np.einsum("ij,jk,ik->i", powers[1], inverse, powers[1]))
        curve = powers[1] @ result
        band(ax, at, curve - 1.96 * sd, curve + 1.96 * sd, line["color"], opacity=0.18)
        ax.plot(at, curve, **line)
    ax.set(xlabel="lateral acceleration v_x · yaw rate [m/s²]", ylabel="steer − wheelbase · curvature [rad]")
    return sheet


def quasi_steady(recording: Recording) -> tuple[Array, Array]:
    """Lateral acceleration, m/s², and steering less wheelbase times curvature, rad, where yaw rate and speed rest."""
    rates = []
    for start, stop in recording.runs:
        v_x, steer, yaw_rate = (recording[name][start:stop] for name in ("v_x", "steer", "yaw_rate"))
        if len(v_x) <= 2 * SMOOTH:
            continue
        window = np.ones(SMOOTH) / SMOOTH
        smooth = [np.convolve(item, window, "same") for item in (v_x, steer, yaw_rate)]
        rates.append([*smooth, *(np.gradient(item) / recording.sample_time for item in (smooth[2], smooth[0]))])
    if not rates:
        return np.zeros(0), np.zeros(0)
    v_x, steer, yaw_rate, turning, speeding = (np.concatenate(item) for item in zip(*rates, strict=True))
    known = np.all(np.isfinite([v_x, steer, yaw_rate, turning, speeding]), axis=0)
    moving = known & (v_x > MOVING * float(np.quantile(v_x[known], 0.99)))
    steady = moving & (np.abs(turning) < STEADY[0] * np.std(turning[moving]))
    steady &= np.abs(speeding) < STEADY[1] * np.std(speeding[moving])
    return v_x[steady] * yaw_rate[steady], steer[steady] - WHEELBASE * yaw_rate[steady] / v_x[steady]


def adapted(rest: Recording, seen: Sequence[tuple[str, Prediction, Prediction]]) -> Sheet:
    """Fig. 12: what follows the first seconds of a changed car, by the fit as it was and as it was adapted.

    Parameters
    ----------
    rest : what follows.
    seen : (output, predictions of the fit as it was, predictions of the adapted one).
    """
    sheet = Sheet((95.0,) * len(seen))
    for ax, (output, before, after) in zip(sheet.grid[:, 0], seen, strict=True):
        start, stop = busiest(rest, before)
        lines = {
            "before": (before, look(ORANGE, 1.0, "as it was", dashes=DASHED)),
            "after": (after, look(BLUE, 1.1, "adapted to 20 s")),
        }
        stretch(ax, rest, output, start, stop, lines)
    return sheet
