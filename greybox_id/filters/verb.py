"""The verb `track`: states, tyres and forces along a recording by an EKF or UKF."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from ..base.errors import BadInput, near_or_all
from ..base.shorthands import Array, Say
from ..base.signals import unit_of, unit_of_quantity
from ..datasets.recording import Recording
from ..models.effect import Effect
from ..models.motion_model import MotionModel
from .filtering import Filtering, LaidRun, filtering, guarded, laid, smoothed
from .findings import (
    Consistency,
    consistency,
    distrusted_data,
    identifiable_rows,
    lost,
    must_be_finite,
    must_fill_a_window,
    only_over_mass,
    standing,
    too_quiet,
    unidentifiable,
    widening,
    window_rows,
)
from .how import READINGS, TrackOptions
from .kernel import History
from .state_space import SLOWEST, StateSpace, walking
from .track import Track
from .tuning import (
    NoiseLevels,
    Tuned,
    beginning,
    believed,
    model_coordinates,
    noise_coordinates,
    origins,
    padded,
    resolution_of,
    scatter_of,
    start_levels,
    tuned,
    units,
)

REPORTED = ("sideslip", "C_alpha_f", "C_alpha_r", "F_yf", "F_yr", "alpha_f", "alpha_r")
"""Estimates reported in addition to states and tracked parameters, if a model has them."""
STIFFNESSES = ("C_alpha_f", "C_alpha_r")
AT_A_TIME = 20_000
"""Rows whose estimates are linearised at once, to bound memory."""


def joined(parts: Sequence[History], segments: Sequence[int]) -> list[History]:
    """Join innovations of parts to those of runs with the given numbers of segments."""
    result, remaining = [], list(parts)
    for count in segments:
        parts_of_run = [remaining.pop(0)]
        while sum(len(part.off) for part in parts_of_run) < count:
            parts_of_run.append(remaining.pop(0))
        off, spread = (np.concatenate([getattr(part, name) for part in parts_of_run]) for name in ("off", "spread"))
        result.append(replace(parts_of_run[0], off=off, spread=spread) if len(parts_of_run) > 1 else parts_of_run[0])
    return result


STATES = ("predicted", "predicted_P", "filtered", "filtered_P", "forward")
"""Large fields of a history, released once the estimates are made."""


def track(
    model: MotionModel, recording: Recording, parameters: Sequence[str] = (), *, disturbances: Sequence[str] = (),
    effects: Mapping[str, Effect] | None = None, how: TrackOptions | None = None, uncertain: Array | None = None,
    say: Say = lambda line: None, **more: Any,
) -> Track:  # fmt: skip
    """Track a vehicle along a recording.

    Parameters
    ----------
    model : equations of motion. Free parameters with a prior are uncertain, which is included in the estimates'
        standard deviations.
    recording : in SI units. Glitches and short gaps of inputs are bridged and reported.
    parameters : names to track as random walks: parameters, scaled combinations (C_alpha_f), effects, quantities (F_yf)
        or inputs. Inputs that were not recorded are tracked without being named.
    disturbances : names to track as processes that return to their start.
    effects : effects that may be tracked by name without being in the model.
    how : filter, readings, noise.
    uncertain : (k, parameters) principal standard deviations of the model's parameters, for example from a fit; None
        takes each parameter's prior.
    say : called with one line of progress at a time.
    more : fields of `TrackOptions`, which override those of `how`.

    Returns
    -------
    Track.

    Raises
    ------
    BadInput : a name is unknown, the recording lacks an input or is too short, or the filter diverges.
    """
    how = replace(how or TrackOptions(), **more)
    recording.must_run()
    with threadpool_limits(1):  # matrices are small
        tracker = Tracker(model, recording, parameters, disturbances, effects or {}, how, uncertain)
        return tracker.track(recording, say)


class Tracker:
    """A filter for a model and the signals of a recording; it tracks this recording and similar ones.

    Parameters as in `track`.

    Attributes
    ----------
    space : the filter's state space.
    filtering : the filter.
    readings : outputs whose readings are used.
    absent : inputs that are not recorded and therefore tracked.
    parameters, disturbances : tracked names, as requested, with absent inputs.
    """

    def __init__(
        self, model: MotionModel, recording: Recording, parameters: Sequence[str], disturbances: Sequence[str],
        effects: Mapping[str, Effect], how: TrackOptions, uncertain: Array | None = None,
    ) -> None:  # fmt: skip
        self.how = how
        self._uncertain = uncertain
        named = (*parameters, *disturbances)
        self.absent = tuple(name for name in _absent(model, recording) if name not in named)
        for name in how.coloured:
            if name not in model.outputs:
                raise BadInput(f"{model.name} has no output {name} to be coloured.{near_or_all(name, model.outputs)}")
        for name in how.readings:
            if name not in model.outputs and name not in model.inputs and name not in READINGS:
                raise BadInput(f"{model.name} has no output {name} to be read.{near_or_all(name, model.outputs)}")
        self.readings = tuple(n for n in how.readings if n in model.outputs and recording.has(n))
        if not self.readings:
            raise BadInput(
                f"{recording.name} has none of {', '.join(how.readings)}, which the filter is to read; name "
                f"others with ‹readings›: {model.name} has {', '.join(model.outputs)}."
            )
        self.parameters, self.disturbances = (*parameters, *self.absent), tuple(disturbances)
        changed, tracked = walking(model, self.parameters, self.disturbances, effects)
        coloured = tuple(name for name in how.coloured if name in self.readings)
        self.space = StateSpace(changed, tracked, coloured)
        self.filtering = filtering(self.space, how.filter, how.points, how.gate)

    @cached_property
    def tuning(self) -> Filtering:
        """The filter for tuning: an EKF, even for a UKF, since all finite differences of its likelihood run at once."""
        return filtering(self.space, "ekf", self.how.points, self.how.gate, many=True)

    def track(self, recording: Recording, say: Say = lambda line: None) -> Track:
        """Estimates along a recording."""
        space, how = self.space, self.how
        inputs = tuple(n for name in space.model.inputs for n in _signals(space.model, name))
        clean, sentences = guarded(recording, inputs)
        runs = [run.filtered_alone() for run in laid(space, clean, space.model.values, self.readings)]
        must_fill_a_window([run.run for run in runs], recording.name)
        levels = start_levels(space, scatter_of(clean, self.readings), self.readings, self.stated_noise)
        p = np.concatenate([space.model.values, levels.values])
        floors = resolution_of(clean, self.readings)
        p, moves = self._tune(runs, p, levels, floors, say)
        say(f"{how.filter.upper()} over {sum(len(run.run) for run in runs)} rows")
        part_histories, filter_seconds = list[History](), list[float]()
        result = self._estimates(self._through(runs, p, part_histories, filter_seconds, recording.name), runs, p)
        histories = joined(part_histories, [len(run.segments) for run in runs])
        judged, lost_stretches = self._judged(runs, histories), lost(runs, histories, self.readings)
        innovations, expected = (
            _stacked([getattr(h, name)[run.row_segment] for run, h in zip(runs, histories, strict=True)])
            for name in ("off", "spread")
        )
        np.sqrt(expected, out=expected)
        part_histories.clear()
        del histories  # for hours of data, release it before the next step
        widened = widening([judged[name] for name in self.readings])
        identifiable, stiffness_sentences = self._identifiable(result)
        sds = result.variances
        for sd in sds.values():  # in place: for hours of data, a second copy is large
            np.sqrt(sd, out=sd)
            sd *= widened
        for j, move in enumerate(moves):
            say(f"adding the uncertainty of parameter {j + 1} of {len(moves)}")
            for rows_of_block, estimates, _ in self._along(self._through(runs, p + move), p + move):
                for k, name in enumerate(sds):
                    off = estimates[:, k] - result.values[name][rows_of_block]
                    sds[name][rows_of_block] = np.hypot(sds[name][rows_of_block], np.where(np.isfinite(off), off, 0.0))
        likelihood = -float(self.filtering.costs(runs, p[None])[0])
        rows = np.concatenate([np.asarray(run.run.rows) for run in runs])
        number: Array = np.repeat(np.arange(len(runs)), [len(run.run) for run in runs])
        del runs  # for hours of data, release them before the data checks
        mass_sentences = only_over_mass(space.model) if how.calibrate else []
        slow_sentences = standing(result.values.get("sideslip"), SLOWEST)
        sizes = dict(zip(space.noises, p[space.model.size :].tolist(), strict=True))
        doubted = [*distrusted_data(recording, {*inputs, *self.readings}), *too_quiet(sizes, floors)]
        names = self.reported
        return Track(
            model=space.model,
            recording=clean,
            kind=how.filter,
            smoothed=how.smooth,
            rows=rows,
            run=number,
            values=result.values,
            sds=sds,
            units={name: self._unit(name) for name in names},
            tracked=tuple(item.name for item in space.tracked),
            parameters=self.parameters,
            disturbances=self.disturbances,
            noise=sizes,
            noise_from=origins(space, self.stated_noise, levels.open if how.tune or how.calibrate else ()),
            noise_units=units(space),
            innovations={name: innovations[:, k] for k, name in enumerate(self.readings)},
            expected={name: expected[:, k] for k, name in enumerate(self.readings)},
            consistency=judged,
            widened=widened,
            log_likelihood=likelihood,
            sentences=(*doubted, *sentences, *mass_sentences, *stiffness_sentences, *slow_sentences, *lost_stretches),
            told=identifiable,
            calibrated=self._calibrated(p, moves) if how.calibrate else {},
            seconds=sum(filter_seconds),
        )

    @property
    def reported(self) -> tuple[str, ...]:
        """Names of the estimates: sideslip, states, tyres and forces, and what is tracked."""
        model = self.space.model
        available = {
            *model.quantities,
            *(combination.name for combination in model.combinations if combination.scaled_by),
        }
        states = self.space.trace.names
        has_slip = {"v_x", "v_y"} <= {*states, *model.inputs}
        others = [n for n in REPORTED if n in available or (n == "sideslip" and has_slip)]
        return tuple(dict.fromkeys([*others[:1], *states, *others[1:], *(item.name for item in self.space.tracked)]))

    @property
    def stated_noise(self) -> dict[str, float]:
        """Sizes of noises that are not tuned."""
        return {n: size for n, size in self.how.known.items() if n in self.space.noises} | dict(self.how.noise)

    def stated_moves(self, size: int) -> Array:
        """(k, size) stated uncertainty of the model's parameters, as moves of p."""
        return believed(self.space, size) if self._uncertain is None else padded(self.space, self._uncertain, size)

    def _tune(
        self, runs: Sequence[LaidRun], p: Array, levels: NoiseLevels, floors: Mapping[str, float], say: Say
    ) -> tuple[Array, Array]:
        """Noise, and parameters if requested, tuned on the beginning; and the uncertainty of the parameters."""
        how, space = self.how, self.space
        stated = self.stated_moves(len(p))
        parameters = model_coordinates(space.model, [t.name for t in space.tracked]) if how.calibrate else []
        noise = noise_coordinates(self.tuning, p, levels.open, floors) if how.tune or how.calibrate else []
        if not noise and not parameters:
            return p, stated
        result: Tuned = tuned(self.tuning, beginning(runs, max(how.tune, how.calibrate)), p, noise, parameters, say)
        return result.p, result.moves if parameters else stated

    def _calibrated(self, p: Array, moves: Array) -> dict[str, tuple[float, float]]:
        """The model's free parameters as tuned, with their standard deviations."""
        names = [item.name for item in self.space.tracked]
        spread = np.sqrt(np.sum(moves**2, axis=0))
        free = [
            parameter
            for parameter in self.space.model.parameters
            if not parameter.fixed and parameter.shape == () and parameter.name not in names
        ]
        places = {item.name: self.space.place(item.name) for item in free}
        return {name: (float(p[k]), float(spread[k])) for name, k in places.items()}

    def _through(
        self,
        runs: Sequence[LaidRun],
        p: Array,
        seen: list[History] | None = None,
        spent: list[float] | None = None,
        name: str = "",
    ) -> Iterator[tuple[LaidRun, Array, Array]]:
        """Runs, or parts of them, with estimates and their variances at their segments.

        `seen` collects innovations, one column per reading, `spent` the filter's seconds; with a name, a diverging
        filter raises `BadInput`.
        """
        began, columns = time.process_time(), [self.space.model.outputs.index(one) for one in self.readings]
        if self.how.smooth:
            histories = self.filtering.histories(runs, p, "both ways")
            parts = iter([(run, 0, run, history) for run, history in zip(runs, histories, strict=True)])
        else:
            parts = self.filtering.in_parts(runs, p)
        for run, first, part, history in parts:
            if spent is not None:
                spent.append(time.process_time() - began)
            if name:
                must_be_finite(history, run, first, name)
            if seen is not None:
                of_readings = {one: getattr(history, one)[:, columns] for one in ("off", "spread")}
                seen.append(replace(history, **dict.fromkeys(STATES, np.empty(0)), **of_readings))
            yield (part, *(smoothed(history) if self.how.smooth else (history.filtered, history.filtered_P)))
            began = time.process_time()

    def _estimates(
        self, parts: Iterator[tuple[LaidRun, Array, Array]], runs: Sequence[LaidRun], p: Array
    ) -> _Estimates:
        names = self.reported
        values, variances = np.empty((2, len(names), sum(len(run.row_segment) for run in runs)))
        for rows, value, variance in self._along(parts, p):
            values[:, rows] = value.T
            variances[:, rows] = np.where(np.isnan(value), np.nan, np.maximum(variance, 0.0)).T
        return _Estimates(dict(zip(names, values, strict=True)), dict(zip(names, variances, strict=True)))

    def _along(self, parts: Iterator[tuple[LaidRun, Array, Array]], p: Array) -> Iterator[tuple[slice, Array, Array]]:
        """Blocks of rows of all runs in succession: estimates and their variances, (rows, names) each."""
        count, n, done = len(self.reported), self.space.size, 0
        seen = self.space.seen(self.reported)
        for run, x, P in parts:
            for first in range(0, len(run.row_segment), AT_A_TIME):
                rows = run.row_segment[first : first + AT_A_TIME]
                result = seen(x[rows], run.segments[rows], p)
                by_x = result[:, count:].reshape(len(rows), count, n)
                yield (
                    slice(done, done + len(rows)),
                    result[:, :count],
                    np.einsum("kij,kjl,kil->ki", by_x, P[rows], by_x),
                )
                done += len(rows)

    def _judged(self, runs: Sequence[LaidRun], histories: Sequence[History]) -> dict[str, Consistency]:
        result = {}
        per_window = window_rows(runs[0].run.sample_time)
        for k, name in enumerate(self.readings):
            parts = ([getattr(h, one)[:, k] for h in histories] for one in ("off", "spread"))
            off, spread = (np.concatenate(part) if len(part) > 1 else part[0] for part in parts)
            result[name] = consistency(off, spread, per_window, self.how.gate)
        return result

    def _identifiable(self, result: _Estimates) -> tuple[dict[str, float], list[str]]:
        """For each tracked parameter, the share of rows in which it is identifiable, and sentences on stiffness."""
        shares, sentences = {}, []
        for item in self.space.tracked:
            identifiable = identifiable_rows(item, result.values[item.name], np.sqrt(result.variances[item.name]))
            shares[item.name] = float(np.mean(identifiable))
            scaled = next((c.name for c in self.space.model.combinations if c.scaled_by == item.name), item.name)
            if scaled in STIFFNESSES:
                axle = scaled[-2:]
                sentences.append(
                    unidentifiable(scaled, identifiable, result.values.get(f"alpha{axle}"), f"F_y{axle[1:]}")
                )
        return shares, [sentence for sentence in sentences if sentence]

    def _unit(self, name: str) -> str:
        model = self.space.model
        unit = next((c.unit for c in model.combinations if c.name == name), None)
        if unit is None and name in model:
            unit = model[name].unit
        state = next((s.unit for s in model.states if s.name == name), None)
        return unit or state or (unit_of(name, "") or unit_of_quantity(name))


@dataclass(frozen=True)
class _Estimates:
    values: dict[str, Array]
    variances: dict[str, Array]


def _stacked(parts: Sequence[Array]) -> Array:
    """Parts stacked by rows; a single part without a copy."""
    return np.vstack(parts) if len(parts) > 1 else parts[0]


def _absent(model: MotionModel, recording: Recording) -> list[str]:
    """Inputs that were not recorded but follow from readings: forces. Other missing inputs are errors."""
    return [
        name
        for name in model.inputs
        if name not in model.defaults
        and not any(signal in recording for signal in _signals(model, name))
        and any(signal in model.quantities for signal in _signals(model, name))
    ]


def _signals(model: MotionModel, name: str) -> tuple[str, ...]:
    return model.aliases.get(name, (name,))
