"""What tracking finds: states, tyres and forces over time with standard deviations; the vehicle with what was tuned.

The verdict on a track: whether its innovations are what the filter said of them.

A filter states how far readings may lie from what it expects. Where they lie further, or hang together, the model or
its noise is wrong and bands are too narrow; where they lie much closer, bands are too wide. Rules as in Bar-Shalom, Li
& Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, Sec. 5.4; sizes are those from which bands
are wrong by half or more.
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
    """Estimates over a recording.

    Attributes
    ----------
    model : with what is tracked among its parameters.
    recording : as the filter saw it, glitches of inputs bridged.
    kind : "ekf" or "ukf".
    smoothed : whether later readings count as well.
    rows : (n,) of the recording that the estimates are of.
    run : (n,) number of the unbroken run of each row, from 0.
    values, sds : name -> (n,) estimate and its standard deviation, in SI units.
    units : name -> SI unit.
    tracked : names of what walks.
    parameters, disturbances : what walks for good, and what comes and goes, as named; inputs that were not recorded
        are among the parameters.
    noise : name -> size, as used.
    noise_from, noise_units : name -> where its size is from (stated, tuned, guessed), and its SI unit; of what walks,
        that per root second.
    innovations, expected : channel -> (n,) innovations of readings, and their standard deviations as expected.
    consistency : channel -> what these say.
    widened : by how much standard deviations were widened for innovations that scatter further than expected.
    log_likelihood : of all readings, constants left out.
    sentences : what a reader must know: glitches, gaps, what this recording does not tell and where.
    told : tracked name -> share of rows in which the recording tells more of it than was known before.
    calibrated : parameter -> its value and standard deviation, where parameters were tuned along with the noise.
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
        """(n,) s."""
        return np.asarray(self.recording.time[self.rows.astype(int)])

    def table(self, copy: bool = True) -> pd.DataFrame:
        """One row per sample: time, run, and every estimate with its standard deviation as NAME and NAME_sd.

        Parameters
        ----------
        copy : whether its columns are its own; without, a table of hours takes no memory, and must not be changed.
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
    """The vehicle with the model's numbers as calibrated, their uncertainty, and the noise.

    Parameters
    ----------
    parameters, disturbances : what was tracked, as named.
    effects : all there are, by name; those of the model stand under [model] effects.
    """
    source = SOURCE.format(recording=track.recording.name)
    before = vehicle.model.effects if vehicle.model is not None else {}
    model = track.model
    there = [name for name in model.effects if name not in (*parameters, *disturbances)]
    of_effects = {name: before.get(name, Stated(float(model[name].array))) for name in there}
    values = dict(vehicle.values)
    for name, (value, sd) in track.calibrated.items():
        stated = Stated(value, sd if np.isfinite(sd) and sd > 0 else None, source=source)
        (of_effects if name in effects else values)[name] = stated
    plan = TrackingPlan(tuple(parameters), tuple(disturbances), _rounded(track.noise, track))
    chosen = ChosenModel(model.name, dict(model.settings), of_effects)
    return replace(vehicle, values=values, model=chosen, tracking=plan)


def _rounded(noise: Mapping[str, float], track: Track) -> dict[str, float]:
    """The noises that readings told, to three digits."""
    unread = {f"noise_{name}" for name in track.model.outputs if name not in track.consistency}
    return {name: float(f"{size:.3g}") for name, size in noise.items() if name not in unread}


NARROW, WIDE = 2.25, 0.45
"""Mean NIS (1 is due) from which standard deviations are 1.5 times too small, and 1.5 times too large."""
INSIDE = 0.5
"""Share of windows within their 95 % bounds below which the noise is not what the filter takes it for."""
TOGETHER = 0.5
"""Correlation of each innovation with the next from which they are no noise: (1 + c) / (1 - c) is 3 then."""
MOSTLY_LOST = 0.5
"""Share of the windows in which a channel is lost, from which nothing is tracked."""
STIFFNESSES = {
    "stiffness_f": "C_alpha_f",
    "stiffness_r": "C_alpha_r",
    "C_alpha_f": "C_alpha_f",
    "C_alpha_r": "C_alpha_r",
}
"""What walks -> the cornering stiffness that it is."""
A_MINUTE, RESTLESS = 60.0, 0.4
"""s, and the share by which a tuned stiffness walks in it from which it makes up for what the model lacks: of 19 of 20
virtual vehicles the larger of both walked by 0.22 or less, by 0.44 and more where wheelbases were 30 % off."""


def verdict(track: Track) -> Verdict:
    """Whether a track can be used, and why."""
    checked = [
        Reason(NOT_USABLE if _throughout(item) else WITH_CARE, f"Data check: {item.sentence}")
        for item in distrust(used_signals(track.model), track.recording)
    ]
    lost = {name: _lost(track, name) for name in track.consistency}
    return of_innovations(track.consistency, lost, track.widened, [*checked, *_restless(track)])


def _restless(track: Track) -> Iterator[Reason]:
    """Stiffnesses whose walk was tuned so large that innovations are what is expected of any vehicle."""
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
    """Whether a signal is wrong in all rows; where it is in some, or missing there, the filter goes on from others."""
    return finding.where.run is None and not finding.where.rows and finding.kind != "missing"


def of_innovations(
    channels: Mapping[str, Consistency], lost: Mapping[str, float], widened: float, more: Sequence[Reason] = ()
) -> Verdict:
    """The verdict that innovations leave.

    Parameters
    ----------
    channels : reading -> what its innovations say.
    lost : reading -> share of windows in which they are far beyond what is expected.
    widened : by how much bands were widened for them.
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
    """Share of windows in which a channel's innovations are far beyond what is expected."""
    off, sd = track.innovations.get(name), track.expected.get(name)
    if off is None or sd is None:
        return 0.0
    squares = (off / sd) ** 2
    squares = squares[np.isfinite(squares)]
    windows = windowed(squares, window_rows(track.recording.sample_time))
    return float(np.mean(windows > LOST)) if len(windows) else 0.0
