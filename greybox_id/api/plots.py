"""Figures of results as matplotlib Axes, which can be restyled: `fit.plot.tyres()`, `gap.plot()`, `track.plot()`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from ..base.errors import BadInput, must_be_one_of
from ..base.numbers import number, pretty_unit
from ..base.shorthands import Array
from ..datasets.recording import Recording
from ..filters.track import Track
from ..gap.gap import Gap
from ..models.model import Model, must_be
from ..models.motion_model import MotionModel
from ..reports.figures.characteristics import (
    A_Y,
    AXLES,
    BEYOND,
    draw_tyre,
    has_tyres,
    is_steered,
    turns_beyond_curvature,
)
from ..reports.figures.sheet import BLUE, DASHED, MEASURED, ORANGE, PALE, ZERO, band, look
from ..reports.settled import OverSlip
from . import given, predictions
from .estimates import NamedEstimates
from .given import Columns

SLIPS = ("alpha_f", "alpha_r")
SLIP = 0.25
"""Largest slip angle of tyre curves, rad, if no training data are available."""
POINTS = 81
SIMULATED = look(BLUE, dashes=DASHED)


class FitPlots:
    """Figures of a fit. Each method returns matplotlib Axes, drawn into a new figure unless `ax` or `axes` is given.

    Parameters
    ----------
    fit : the fit.

    Examples
    --------
    >>> import matplotlib
    >>> matplotlib.use("Agg")
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 400)
    >>> axes = gb.fit("kinematic", lap, vehicle="roboracer").plot.measured_and_simulated(lap)
    >>> [ax.get_ylabel() for ax in axes]
    ['yaw_rate [rad/s]', 'a_y [m/s²]']
    """

    def __init__(self, fit: NamedEstimates) -> None:
        self._fit = fit

    def __call__(self, recording: Recording | str | Path | None = None, **options: Any) -> np.ndarray[Any, Any]:
        """The default figure, `measured_and_simulated`, with its parameters."""
        return self.measured_and_simulated(recording, **options)

    def __repr__(self) -> str:
        names = [name for name in dir(type(self)) if not name.startswith("_")]
        return f"Figures of {self._fit.model.name}: {', '.join(f'.{name}()' for name in names)}"

    def measured_and_simulated(
        self,
        recording: Recording | str | Path | None = None,
        *,
        horizon: float | None = None,
        axes: Any = None,
        columns: Columns = "canonical",
    ) -> np.ndarray[Any, Any]:
        """Outputs over time, measured and simulated in free run or predicted over a horizon.

        Parameters
        ----------
        recording : to compare with; by default the held-out one, or the training one if none was held out.
        horizon : of predictions, s; None for the free run.
        axes : (outputs,) matplotlib Axes to draw into.
        columns : column map for a file.

        Returns
        -------
        (outputs,) of matplotlib Axes, one per recorded output.
        """
        read = self._recording(recording, columns)
        predicted = predictions.predict(self._fit, read, horizon)
        names = [name for name in predicted.signals if name in read]
        drawn = _rows(axes, len(names), "time [s]")
        for ax, name in zip(drawn, names, strict=True):
            for k, (rows, time) in enumerate(_laid(read.time, read.runs)):
                words = "simulated" if horizon is None else f"{horizon:g} s ahead"
                for values, line in ((read[name], MEASURED), (predicted[name], SIMULATED | {"label": words})):
                    ax.plot(time, values[rows], **line if k == 0 else line | {"label": None})
            ax.set_ylabel(_label(self._fit.model, name))
        if names:
            beside = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "ncols": 2, "frameon": False}
            drawn[0].legend(**beside, borderaxespad=0.2)  # above the axes, where it covers no lines
            drawn[0].set_title(f"{self._fit.model.name} on {read.name}", loc="left")
        return drawn

    def residuals(
        self,
        recording: Recording | str | Path | None = None,
        *,
        horizon: float | None = None,
        axes: Any = None,
        columns: Columns = "canonical",
    ) -> np.ndarray[Any, Any]:
        """Measured minus simulated over time; parameters and result as in `measured_and_simulated`."""
        read = self._recording(recording, columns)
        residual = predictions.residuals(self._fit, read, horizon)
        drawn = _rows(axes, len(residual.signals), "time [s]")
        for ax, (name, values) in zip(drawn, residual.signals.items(), strict=True):
            for rows, time in _laid(read.time, read.runs):
                ax.plot(time, values[rows], **look(BLUE, 0.8))
            ax.axhline(0.0, **ZERO)
            ax.set_ylabel(_label(self._fit.model, name))
        if len(drawn):
            drawn[0].set_title(f"residuals of {self._fit.model.name} on {read.name}")
        return drawn

    def tyres(self, *, slip: float | None = None, v_x: float | None = None, ax: Axes | None = None) -> Axes:
        """Lateral force over vertical load of both axles over slip angle, with first-order 95 % bands.

        Parameters
        ----------
        slip : rad, the largest slip angle drawn; by default that of the training data, or 0.25 rad.
        v_x : speed, m/s; by default the median of the training data, or 10 m/s.
        ax : matplotlib Axes to draw into.

        Raises
        ------
        BadInput : if the model has no axles with slip angles.
        """
        model = _motion(self._fit.model)
        if not has_tyres(model):
            raise BadInput(
                f"{model.name} has no tyres: it does not compute slip angles, lateral forces and loads of the axles."
            )
        speed = v_x if v_x is not None else self._speed()
        reach = slip if slip is not None else self._slip()
        angles = np.linspace(-reach, reach, POINTS)
        ax = ax if ax is not None else plt.subplots(layout="constrained")[1]
        for colour, (axle, where) in zip((BLUE, ORANGE), AXLES.items(), strict=True):
            draw_tyre(ax, self._fit, OverSlip(model, axle, speed), angles, look(colour, 1.4, f"{where} axle"))
        ax.set(xlabel="slip angle [rad]", ylabel="F_y / F_z [–]", title=f"tyres of {model.name}")
        ax.legend()
        return ax

    def handling(self, *, v_x: float | None = None, steer: float = 0.3, ax: Axes | None = None) -> Axes:
        """Handling diagram: steering angle minus wheelbase times curvature, over lateral acceleration, in steady
        turns.

        Parameters
        ----------
        v_x : speed, m/s; by default the median of the training data, or 10 m/s.
        steer : rad, the largest road-wheel angle drawn.
        ax : matplotlib Axes to draw into.

        Raises
        ------
        BadInput : if the model has no steering, or no steady turns.
        """
        model = _motion(self._fit.model)
        speed = v_x if v_x is not None else self._speed()
        turns = turns_beyond_curvature(model, speed, abs(steer)) if is_steered(model) else None
        if turns is None:
            raise BadInput(f"{model.name} has no steady turns that could be drawn.")
        ax = ax if ax is not None else plt.subplots(layout="constrained")[1]
        ax.plot(*turns, **look(BLUE, 1.4, f"{speed:.3g} m/s"))
        ax.axhline(0.0, **ZERO)
        ax.set(xlabel=A_Y, ylabel=BEYOND, title=f"handling of {model.name}")
        ax.legend()
        return ax

    def parameters(self, *names: str, level: float = 0.95, ax: Axes | None = None) -> Axes:
        """Confidence intervals of the parameters, each divided by the magnitude of its estimate.

        Parameters
        ----------
        names : free scalar parameters; all by default.
        level : of the intervals.
        ax : matplotlib Axes to draw into.
        """
        intervals, params = self._fit.conf_int(level), self._fit.params
        free = [p.name for p in self._fit.model.parameters if p.shape == () and not p.fixed]
        for name in names:
            must_be_one_of(free, name, "names: there is no free parameter")
        chosen = list(names) or free
        ax = ax if ax is not None else plt.subplots(figsize=(6.4, 1.2 + 0.3 * len(chosen)), layout="constrained")[1]
        for k, name in enumerate(chosen):
            at, low, high = float(params[name]), float(intervals["lower"][name]), float(intervals["upper"][name])
            scale = abs(at) or 1.0
            ax.plot([low / scale, high / scale], [k, k], **look(BLUE, 2.0))
            ax.plot(at / scale, k, **look(BLUE, dots=3.0))
        units = [pretty_unit(self._fit.model[name].unit) for name in chosen]
        labels = [f"{name} = {number(params[name])} {unit}" for name, unit in zip(chosen, units, strict=True)]
        ax.set_yticks(range(len(chosen)), labels)
        ax.invert_yaxis()
        ax.set(xlabel=f"{100 * level:g} % interval over |estimate|", title=f"parameters of {self._fit.model.name}")
        return ax

    def _recording(self, recording: Recording | str | Path | None, columns: Columns) -> Recording:
        if recording is not None:
            return given.one_recording(recording, columns)
        return (self._fit.seen("validate") or self._fit.seen("train"))[0]

    def _speed(self) -> float:
        """Median speed of the training data, m/s."""
        speeds = [item["v_x"] for item in self._trained() if "v_x" in item]
        return float(np.nanmedian(np.concatenate(speeds))) if speeds else 10.0

    def _slip(self) -> float:
        """A slip angle slightly beyond those of the training data, rad."""
        model = _motion(self._fit.model)
        slipping = replace(model, outputs=(*model.outputs, *(name for name in SLIPS if name not in model.outputs)))
        result: list[Array] = []
        for item in self._trained():
            driven = predictions.simulate(slipping, item)
            result += [np.abs(driven[name]) for name in SLIPS]
        return 1.2 * float(np.nanquantile(np.concatenate(result), 0.995)) if result else SLIP

    def _trained(self) -> Sequence[Recording]:
        try:
            return self._fit.seen("train")
        except BadInput:
            return ()


def along_track(track: Track, names: Sequence[str], axes: Any) -> Axes | np.ndarray[Any, Any]:
    """Estimates of a track over time, with bands of two standard deviations."""
    for name in names:
        must_be_one_of(track.values, name, "names: this track has no estimate")
    chosen = list(names) or list(track.values)
    drawn = _rows(axes, len(chosen), "time [s]")
    edges = np.concatenate(([0], np.flatnonzero(np.diff(track.run)) + 1, [len(track.run)]))
    runs = list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
    for ax, name in zip(drawn, chosen, strict=True):
        measured = track.recording[name][track.rows.astype(int)] if name in track.recording else None
        for rows, time in _laid(track.time, runs):
            values, sd = track.values[name][rows], track.sds[name][rows]
            ax.plot(time, values, **look(BLUE))
            band(ax, time, values - 2 * sd, values + 2 * sd)
            if measured is not None:
                ax.plot(time, measured[rows], **look(PALE, dashes="", dots=0.8), zorder=0)
        unit = track.units[name]
        ax.set_ylabel(f"{name} [{pretty_unit(unit)}]")
    drawn[0].set_title(f"track of {track.recording.name}")
    if len(chosen) == 1 and axes is None:
        only: Axes = drawn[0]
        return only
    return drawn


def budget(gap: Gap, ax: Axes | None) -> Axes:
    """The shares of a gap as a waterfall; effects by probability if the diagnosis has no budget."""
    ax = ax if ax is not None else plt.subplots(layout="constrained")[1]
    shares = gap.budget
    if shares is not None:
        rows = [(share.effect, share.share) for share in (*shares.shares, shares.unnamed)]
        below = 0.0
        for k, (name, share) in enumerate(rows):
            ax.barh(k, 100 * share, left=100 * below, color=PALE if name == "unexplained" else BLUE)
            below += share
        ax.set_yticks(range(len(rows)), [name for name, _ in rows])
        ax.set_xlabel("share of the excess error [%]")
    else:
        ranked = gap.ranking
        ax.barh(range(len(ranked)), [item.probability for item in ranked],
                color=[BLUE if item.effect in gap.applied else PALE for item in ranked])  # fmt: skip
        ax.set_yticks(range(len(ranked)), [item.effect for item in ranked])
        ax.set(xlabel="probability", xlim=(0.0, 1.0))
    ax.invert_yaxis()
    ax.set_title(f"gap of {gap.model}")
    return ax


def _rows(axes: Any, count: int, below: str) -> np.ndarray[Any, Any]:
    """Axes one below the other, given or in a new figure."""
    if axes is not None:
        drawn = np.atleast_1d(np.asarray(axes, dtype=object))
        if len(drawn) != count:
            raise BadInput(f"axes: {count} are needed, {len(drawn)} are given.")
        return drawn
    drawn = plt.subplots(max(count, 1), 1, sharex=True, squeeze=False, figsize=(7.0, 1.0 + 1.8 * max(count, 1)),
                         layout="constrained")[1][:, 0]  # fmt: skip
    drawn[-1].set_xlabel(below)
    return drawn


def _laid(time: Array, runs: Sequence[tuple[int, int]]) -> list[tuple[slice, Array]]:
    """Rows and time of every run; if a clock starts again, the run follows the previous one."""
    result: list[tuple[slice, Array]] = []
    end, moved = -np.inf, 0.0
    for start, stop in runs:
        times = time[start:stop]
        if len(times) and times[0] + moved <= end:
            moved = end - float(times[0]) + (float(times[1] - times[0]) if len(times) > 1 else 0.0)
        result.append((slice(start, stop), times + moved))
        end = float(times[-1]) + moved if len(times) else end
    return result


def _label(model: Model, name: str) -> str:
    return f"{name} [{pretty_unit(model.unit(name))}]"


def _motion(model: Model) -> MotionModel:
    return must_be(MotionModel, model, f"{model.name} has no equations of motion, which this figure needs.")
