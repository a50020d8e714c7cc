"""Of a track, what its report shows."""

from __future__ import annotations

from math import ceil

import numpy as np

from ...filters import Track
from ...filters.findings import WINDOW, bounds, windowed
from ...parameter import Array
from ...provenance import data_record
from ...recording import Recording
from ...statistics import correlation
from .digest import Course, Digest, Estimate, Innovations, Measured, NoiseSize, TrackMade

SHOWN = ("sideslip", "C_alpha_f", "C_alpha_r", "F_yf", "F_yr")
"""Drawn where a model has them, and what is tracked after them."""
SLIPS = ("alpha_f", "alpha_r")
"""Needed beside them for the picture of forces over slip."""
MOST_DRAWN, MOST_ROWS = 7, 3000
DIGITS = 6
LAGS, MOST_LAGS = 1.0, 50
"""Innovations are correlated over lags up to so many s, in so many rows at most."""
WITHIN = (0.05, 0.5, 0.95)
RANGE = (0.005, 0.5, 0.995)


def digest(found: Track, recording: Recording, made: TrackMade) -> Digest:
    """What a report shows of a track.

    Parameters
    ----------
    found : the track.
    recording : as read; what it measures of the estimates stands beside them, whether the filter read it or not.
    made : what the track was made with.
    """
    model = found.model
    return Digest(
        model=model.name,
        about=model.about,
        settings=dict(model.settings),
        effects={name: float(model[name].array) for name in model.effects},
        made=made,
        data=data_record(recording, "track"),
        filter=found.kind,
        smoothed=found.smoothed,
        parameters=found.parameters,
        disturbances=found.disturbances,
        rows=len(found.rows),
        runs=len(np.unique(found.run)),
        estimates={name: _estimate(found, name) for name in _shown(found)},
        truth={name: own for name in _shown(found) if (own := _truth(found, recording, name)) is not None},
        noise={n: NoiseSize(size, found.noise_units[n], found.noise_from[n]) for n, size in _used(found).items()},
        calibrated=dict(found.calibrated),
        consistency=dict(found.consistency),
        signals=_signals(found, recording),
        widened=found.widened,
        log_likelihood=found.log_likelihood,
        sentences=found.sentences,
        course=_course(found, recording),
        innovations={name: _innovations(found, name) for name in found.innovations},
    )


def _scaled(found: Track) -> dict[str, str]:
    """Tracked factors -> what they scale, which is shown in their place."""
    return {own.scaled_by: own.name for own in found.model.combinations if own.scaled_by and own.name in found.values}


def _shown(found: Track) -> list[str]:
    return [name for name in found.values if name not in _scaled(found)]


def _estimate(found: Track, name: str) -> Estimate:
    low, median, high = (float(own) for own in np.nanquantile(found.values[name], WITHIN))
    sd = float(np.nanmedian(found.sds[name]))
    told = {_scaled(found).get(own, own): share for own, share in found.told.items()}
    return Estimate(found.units[name], low, median, high, sd, told.get(name))


def measured_of(recording: Recording, name: str) -> Array | None:
    """What a recording measures of an estimate, row by row; None for nothing."""
    if name in recording:
        return recording[name]
    if name == "sideslip" and "v_x" in recording and "v_y" in recording:
        return np.asarray(np.arctan2(recording["v_y"], recording["v_x"]))
    return None


def _entered(found: Track, name: str) -> bool:
    """Whether the filter saw what was measured of an estimate."""
    seen = {*found.innovations, *found.model.inputs}
    return name in seen or (name == "sideslip" and "v_y" in seen and "sideslip" not in found.recording)


def _truth(found: Track, recording: Recording, name: str) -> Measured | None:
    whole = measured_of(recording, name)
    if whole is None or _entered(found, name):
        return None
    measured, values, sds = whole[found.rows.astype(int)], found.values[name], found.sds[name]
    there = np.isfinite(measured) & np.isfinite(values)
    if not np.any(there):
        return None
    off = (values - measured)[there]
    return Measured(
        unit=found.units[name],
        rows=int(np.count_nonzero(there)),
        rmse=float(np.sqrt(np.mean(off**2))),
        bias=float(np.mean(off)),
        worst=float(off[np.argmax(np.abs(off))]),
        inside=float(np.mean(np.abs(off) <= 2 * sds[there])),
        size=float(np.sqrt(np.mean(measured[there] ** 2))),
    )


def _used(found: Track) -> dict[str, float]:
    """The noises that have a part in the estimates: those of outputs that were not read have none."""
    unread = {f"noise_{name}" for name in found.model.outputs if name not in found.innovations}
    return {name: size for name, size in found.noise.items() if name not in unread}


def _signals(found: Track, recording: Recording) -> dict[str, tuple[str, str, tuple[float, ...]]]:
    """What went into the filter, and between which values it was driven."""
    model = found.model
    inputs = [own for name in model.inputs for own in (name, *model.aliases.get(name, ())) if own in recording]
    roles = dict.fromkeys(inputs, "input") | dict.fromkeys(found.innovations, "reading")
    rows = found.rows.astype(int)
    quantiles = {name: np.nanquantile(recording[name][rows], RANGE) for name in roles}
    return {
        name: (recording.unit(name), role, tuple(float(own) for own in quantiles[name])) for name, role in roles.items()
    }


def _course(found: Track, recording: Recording) -> Course:
    moving = [name for name in _shown(found) if np.nanmax(found.values[name]) > np.nanmin(found.values[name])]
    drawn = [name for name in dict.fromkeys((*SHOWN, *found.tracked)) if name in moving][:MOST_DRAWN]
    every = max(1, ceil(len(found.rows) / MOST_ROWS))
    runs = [np.flatnonzero(found.run == run) for run in np.unique(found.run)]
    kept = np.concatenate([own[::every] for own in runs])
    rows = found.rows[kept].astype(int)
    read = {name: whole[rows] for name in drawn if (whole := measured_of(recording, name)) is not None}
    return Course(
        every=every,
        time=_rounded(running_time(found)[kept]),
        run=found.run[kept].astype(float),
        values={n: _rounded(found.values[n][kept]) for n in (*drawn, *SLIPS) if n in found.values},
        sds={name: _rounded(found.sds[name][kept]) for name in drawn},
        measured={name: _rounded(own) for name, own in read.items()},
    )


def running_time(found: Track) -> Array:
    """(n,) s; runs whose clocks begin anew are laid one behind the other."""
    time = found.time.copy()
    starts = np.flatnonzero(np.diff(found.run)) + 1
    if np.all(np.diff(time)[starts - 1] > 0):
        return time
    for start in starts:
        time[start:] += time[start - 1] - time[start] + found.recording.sample_time
    return np.asarray(time)


def _innovations(found: Track, name: str) -> Innovations:
    step = found.recording.sample_time
    size = max(2, round(WINDOW / step))
    scaled = found.innovations[name] / found.expected[name]
    there = np.isfinite(scaled)
    edges = np.flatnonzero((np.diff(found.rows[there]) != 1) | (np.diff(found.run[there]) != 0)) + 1
    parts = [own for own in np.split(scaled[there], edges) if len(own) > 1]
    most = max(1, min(round(LAGS / step), MOST_LAGS))
    told = correlation([(own, own) for own in parts], most) if parts else np.full(most + 1, np.nan)
    return Innovations(
        _rounded(windowed(running_time(found)[there], size)),
        _rounded(windowed(scaled[there] ** 2, size)),
        *bounds(size),
        _rounded(np.arange(most + 1.0) * step),
        _rounded(told),
    )


def _rounded(values: Array) -> Array:
    """To so many significant digits as a picture can use."""
    return np.array([float(f"{value:.{DIGITS}g}") for value in values])
