"""Results of tracking: states, tyres and forces over time with standard deviations; the vehicle with tuned values; the
verdict on a track.

A filter predicts the variance of its innovations. If they are larger, or correlated, the model or its noise is wrong
and bands are too narrow; if they are much smaller, bands are too wide. Rules as in Bar-Shalom, Li & Kirubarajan,
Estimation with Applications to Tracking and Navigation, 2001, Sec. 5.4; thresholds are those at which bands are wrong
by half or more.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from ..base.numbers import number
from ..base.shorthands import Array
from ..datasets.checks.finding import Finding
from ..datasets.recording import Recording
from ..fitting.fit import NOT_USABLE, USABLE, WITH_CARE, Reason, Verdict, weighed
from ..fitting.scores.verdict import distrust, used_signals
from ..models.effect import Effect
from ..models.motion_model import MotionModel
from ..models.parameter import Stated
from ..models.vehicle import ChosenModel, TrackingPlan, Vehicle
from .findings import LOST, WINDOW, Consistency, window_rows, windowed


@dataclass(frozen=True)
class Track:
    """Estimates along a recording.

    Attributes
    ----------
    model : the model, with tracked parameters among its parameters.
    recording : the recording as filtered, with glitches of inputs bridged.
    kind : "ekf" or "ukf".
    smoothed : whether estimates use later readings, too.
    rows : (n,) rows of the recording that the estimates belong to.
    run : (n,) number of the unbroken run of each row, from 0.
    values, sds : name -> (n,) estimate and its standard deviation, in SI units.
    units : name -> SI unit.
    tracked : names of the tracked parameters.
    parameters, disturbances : names as requested, of those that walk and of those that return; inputs that were not
        recorded are among the parameters.
    noise : name -> size, as used.
    noise_from, noise_units : name -> origin of its size (stated, tuned, guessed), and its SI unit; for random walks
        per root second.
    innovations, expected : channel -> (n,) innovations, and their expected standard deviations.
    consistency : channel -> statistics of its innovations.
    widened : factor by which standard deviations were widened because innovations were larger than expected.
    log_likelihood : of all readings, up to a constant.
    sentences : remarks for the reader: glitches, gaps, what is not identifiable and where.
    told : tracked name -> share of rows in which the recording makes it clearly more precise than its prior.
    calibrated : parameter -> its value and standard deviation, if parameters were tuned along with the noise.
    seconds : processor time of the filter itself.
    """

    model: MotionModel
    recording: Recording
    kind: str
    smoothed: bool
    rows: Array
    run: Array
    values: Mapping[str, Array]
    sds: Mapping[str, Array]
    units: Mapping[str, str]
    tracked: tuple[str, ...]
    parameters: tuple[str, ...]
    disturbances: tuple[str, ...]
    noise: Mapping[str, float]
    noise_from: Mapping[str, str]
    noise_units: Mapping[str, str]
    innovations: Mapping[str, Array]
    expected: Mapping[str, Array]
    consistency: Mapping[str, Consistency]
    widened: float
    log_likelihood: float
    sentences: tuple[str, ...]
    told: Mapping[str, float]
    calibrated: Mapping[str, tuple[float, float]]
    seconds: float

    @property
    def time(self) -> Array:
        """(n,) times of the rows, s."""
        return np.asarray(self.recording.time[self.rows.astype(int)])

    def table(self, copy: bool = True) -> pd.DataFrame:
        """One row per sample: time, run, and every estimate with its standard deviation as NAME and NAME_sd.

        Parameters
        ----------
        copy : whether to copy the columns; without, a table of hours takes no memory, and must not be changed.
        """
        columns: dict[str, Array] = {"time": self.time, "run": self.run}
        for name, values in self.values.items():
            columns[name] = values
            columns[f"{name}_sd"] = self.sds[name]
        return pd.DataFrame(columns, copy=copy)


SOURCE = "tuned on the innovations of {recording}"


def tracked_vehicle(
    vehicle: Vehicle,
    track: Track,
    parameters: Sequence[str],
    disturbances: Sequence[str],
    effects: Mapping[str, Effect],
) -> Vehicle:
    """The vehicle with the calibrated parameters, their uncertainty, and the noise.

    Parameters
    ----------
    vehicle : the vehicle before.
    track : the result of tracking.
    parameters, disturbances : names that were tracked, as requested.
    effects : all effects, by name; the model's effects are stored under [model] effects.
    """
    source = SOURCE.format(recording=track.recording.name)
    before = vehicle.model.effects if vehicle.model is not None else {}
    model = track.model
    model_effects = [name for name in model.effects if name not in (*parameters, *disturbances)]
    of_effects = {name: before.get(name, Stated(float(model[name].array))) for name in model_effects}
    values = dict(vehicle.values)
    for name, (value, sd) in track.calibrated.items():
        stated = Stated(value, sd if np.isfinite(sd) and sd > 0 else None, source=source)
        (of_effects if name in effects else values)[name] = stated
    plan = TrackingPlan(tuple(parameters), tuple(disturbances), _rounded(track.noise, track))
    chosen = ChosenModel(model.name, dict(model.settings), of_effects)
    return replace(vehicle, values=values, model=chosen, tracking=plan)


def _rounded(noise: Mapping[str, float], track: Track) -> dict[str, float]:
    """The noises of the channels that were read, to three digits."""
    unread = {f"noise_{name}" for name in track.model.outputs if name not in track.consistency}
    return {name: float(f"{size:.3g}") for name, size in noise.items() if name not in unread}


NARROW, WIDE = 2.25, 0.45
"""Mean NIS (expected: 1) from which standard deviations are 1.5 times too small, and 1.5 times too large."""
INSIDE = 0.5
"""Share of windows within their 95 % bounds below which the noise is not as the filter assumes."""
TOGETHER = 0.5
"""Correlation of successive innovations above which they are not white: (1 + c) / (1 - c) is then 3."""
MOSTLY_LOST = 0.5
"""Share of windows in which a channel is lost above which the track is not usable."""
STIFFNESSES = {
    "stiffness_f": "C_alpha_f",
    "stiffness_r": "C_alpha_r",
    "C_alpha_f": "C_alpha_f",
    "C_alpha_r": "C_alpha_r",
}
"""Tracked parameter -> its cornering stiffness."""
A_MINUTE, RESTLESS = 60.0, 0.4
"""s, and the relative walk of a tuned stiffness in it above which the walk compensates a model error: in 19 of 20
virtual vehicles the larger of both walked by 0.22 or less, by 0.44 and more with wheelbases 30 % off."""


def verdict(track: Track) -> Verdict:
    """Whether a track is usable, and why."""
    checked = [
        Reason(NOT_USABLE if _throughout(item) else WITH_CARE, f"Data check: {item.sentence}")
        for item in distrust(used_signals(track.model), track.recording)
    ]
    lost = {name: _lost(track, name) for name in track.consistency}
    return of_innovations(track.consistency, lost, track.widened, [*checked, *_restless(track)])


def _restless(track: Track) -> Iterator[Reason]:
    """A reason if the walk of a stiffness was tuned so large that innovations are consistent for any vehicle."""
    sizes = {
        walking: track.noise.get(f"walk_{walking}", 0.0) * A_MINUTE**0.5
        for walking in track.tracked
        if walking in STIFFNESSES
    }
    sizes = {walking: size for walking, size in sizes.items() if track.noise_from[f"walk_{walking}"] == "tuned"}
    if sizes and (most := max(sizes.values())) > RESTLESS:
        name = STIFFNESSES[max(sizes, key=lambda walking: sizes[walking])]
        yield Reason(
            WITH_CARE,
            f"The tuned noise lets {name} change by {100 * most:.0f} % in a minute, which is more than tyres change. "
            "The model lacks an effect, or the vehicle is not the one stated, so sideslip may be far off. Check the "
            "vehicle's wheelbase and steering ratio, or first fit a model (greybox fit) and track with the fit.",
        )


def _throughout(finding: Finding) -> bool:
    """Whether a signal is wrong in all rows; if only in some, or missing there, the filter continues with others."""
    return finding.where.run is None and not finding.where.rows and finding.kind != "missing"


def of_innovations(
    channels: Mapping[str, Consistency], lost: Mapping[str, float], widened: float, more: Sequence[Reason] = ()
) -> Verdict:
    """The verdict from the innovations.

    Parameters
    ----------
    channels : reading -> statistics of its innovations.
    lost : reading -> share of windows in which they are far larger than expected.
    widened : factor by which bands were widened.
    more : further reasons, which come first.
    """
    reasons = [*more]
    reasons += [reason for name, item in channels.items() for reason in _channel(name, item, lost[name], widened)]
    if not any(item.count for item in channels.values()):
        reasons.append(Reason(NOT_USABLE, "The filter used no reading: nothing was tracked."))
    words = "The innovations are as large as the filter expects: NIS {} (expected: 1)."
    listed = ", ".join(f"{number(one.nis, 2)} of {name}" for name, one in channels.items() if np.isfinite(one.nis))
    return weighed([*reasons, Reason(USABLE, words.format(listed))], {})


def _channel(name: str, value: Consistency, share: float, widened: float) -> Iterator[Reason]:
    bands = f"bands were widened by a factor of {number(widened, 2)}" if widened > 1.0 else "bands are too narrow"
    if share > MOSTLY_LOST:
        yield Reason(
            NOT_USABLE,
            f"{name} is far from what the filter expects for {100 * share:.0f} % of the time: the filter no longer "
            "follows the vehicle. Check units and signs (greybox data check) and the vehicle's numbers.",
        )
    elif value.nis > NARROW:
        yield Reason(
            WITH_CARE,
            f"The innovations of {name} scatter {number(np.sqrt(value.nis), 2)} times as much as the filter expects "
            f"(NIS {number(value.nis, 2)}), so {bands}. State noise_{name}, or fit the vehicle first.",
        )
    elif value.nis < WIDE:
        yield Reason(
            WITH_CARE,
            f"The innovations of {name} scatter only {number(np.sqrt(value.nis), 2)} times as much as the filter "
            f"expects (NIS {number(value.nis, 2)}): the noise of {name} is overstated, and bands are too wide. State a "
            f"smaller noise_{name}, or omit it, so that it is tuned.",
        )
    elif value.inside < INSIDE:
        yield Reason(
            WITH_CARE,
            f"The NIS of {name}, averaged over windows of {WINDOW:g} s, lies within its 95 % bounds in only "
            f"{100 * value.inside:.0f} % of the windows: the noise of {name} varies.",
        )
    if value.correlation > max(TOGETHER, value.correlation_bound):
        yield Reason(
            WITH_CARE,
            f"Successive innovations of {name} correlate ({value.correlation:.2f}): the model lacks an effect, and "
            f"bands are too narrow. greybox gap looks for the cause. If the error of the reading {name} varies slowly, "
            f"name {name} in the option coloured: the filter then treats this error as coloured noise.",
        )


def _lost(track: Track, name: str) -> float:
    """Share of windows in which a channel's innovations are far larger than expected."""
    off, sd = track.innovations.get(name), track.expected.get(name)
    if off is None or sd is None:
        return 0.0
    squares = (off / sd) ** 2
    squares = squares[np.isfinite(squares)]
    windows = windowed(squares, window_rows(track.recording.sample_time))
    return float(np.mean(windows > LOST)) if len(windows) else 0.0
