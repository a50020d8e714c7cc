"""Numbers that a diagnosis of equations of motion rests on, each with where it comes from.

Development only: cases of tier workshop (seed 811) and of the foreign families that no examination draws from (fiala,
exponential; seed 901). What is tuned here is proven on other families.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

_DRAWN = "workshop seed 811 (24 nulls, 31 others), fiala and exponential seed 901 (8 nulls, 13 others)"

_AGAIN = "workshop seed 811 (24 nulls, 31 others), fiala and exponential seed 901 (12 nulls, 20 others)"

_RUNS = "prototype's EM over unchanged recordings of the DART 1:10 car (free, ramps, laps), 20 pairs"


class Calibrated(NamedTuple):
    """A number and its provenance.

    Attributes
    ----------
    value : the number.
    how : what it is, its unit, and how it was derived.
    data : on which cases; "" where it follows from something else.
    """

    value: float
    how: str
    data: str = ""


PROVENANCE: Mapping[str, Calibrated] = MappingProxyType({
    "form": Calibrated(0.01, "median of model error over the force, 1: nulls leave 0.2 to 1.5 %", _DRAWN),
    "form_exact": Calibrated(0.001, "the same where a file states every number as exact: a tenth of it"),
    "form_sd": Calibrated(0.7, "sd of its logarithm: a factor of two to either side"),
    "form_sd_stated": Calibrated(0.35, "the same where a vehicle file states it: half as much is open"),
    "floor": Calibrated(0.02, "median of model error beside that, m/s^2: nulls leave 0.005 to 0.03", _DRAWN),
    "memory": Calibrated(0.5, "median correlation time of model error, s: nulls leave 0.1 to 1.6", _DRAWN),
    "memory_sd": Calibrated(0.7, "sd of its logarithm"),
    "noise_sd": Calibrated(0.03, "sd of the logarithm of stated noise: specifications hold to some per cent"),
    "noise_sd_estimated": Calibrated(1.0, "the same where noise is estimated from second differences"),
    "colour": Calibrated(0.3, "median of the slow part of readings' errors over the white one", _DRAWN),
    "colour_exact": Calibrated(0.02, "the same where every number is exact"),
    "colour_sd": Calibrated(0.7, "sd of its logarithm"),
    "sensor_memory": Calibrated(0.1, "median correlation time of readings' errors, s"),
    "indifference": Calibrated(0.05, "zone about a null over the usual size: a tenth hid true effects", _DRAWN),
    "timing": Calibrated(0.15, "of a row: zone of delays and lags; commands and readings are no nearer to stamps"),
    "of_wheelbase": Calibrated(0.15, "usual size of lengths over the wheelbase: 0.4 m of 2.7 m"),
    "of_weight": Calibrated(0.007, "usual size of forces over the weight: 100 N of 1 450 kg"),
    "of_drag": Calibrated(0.5, "usual size of a change of drag over c_2: 0.2 of 0.45 N s^2/m^2"),
    "cost": Calibrated(12.0, "log-odds against an effect: one of 20 nulls gained 9.8, another 9.0, none more", _DRAWN),
    "varies": Calibrated(0.12, "spread of a magnitude between thirds of driving: causes 0 to .05, others .2", _DRAWN),
    "varies_width": Calibrated(0.02, "width of that threshold"),
    "unnamed_share": Calibrated(1.8, "model error over its median that is as likely unnamed as not", _DRAWN),
    "unnamed_slope": Calibrated(4.0, "log-odds per logarithm of that", _DRAWN),
    "unnamed_noise": Calibrated(1.15, "noise over what is stated, the same; nulls leave at most 1.07", _DRAWN),
    "unnamed_noise_slope": Calibrated(30.0, "log-odds per logarithm of that", _DRAWN),
    "shows": Calibrated(0.1, "excess of free runs over noise that must be detected; shares of less are luck", _AGAIN),
    "twins": Calibrated(0.5, "nats apart, two names are one cause: exact aliases differ by 0.1 at most", _AGAIN),
    "overlapping": Calibrated(10.0, "windows that a row lies in at most: within a tenth of a horizon they err alike"),
    "scatter_grip_scale": Calibrated(0.05, "sd of grip between runs, relative", _RUNS),
    "scatter_front_stiffness": Calibrated(0.16, "the same of the front stiffness", _RUNS),
    "scatter_rear_stiffness": Calibrated(0.12, "the same of the rear stiffness", _RUNS),
    "scatter_steering_ratio": Calibrated(0.04, "the same of the steering ratio", _RUNS),
    "scatter_steering_offset": Calibrated(0.0055, "the same of the steering offset, rad", _RUNS),
    "scatter_steering_delay": Calibrated(0.013, "the same of the steering delay, s", _RUNS),
    "scatter_steering_lag": Calibrated(0.013, "the same of the steering lag, s", _RUNS),
    "scatter_yaw_rate_scale": Calibrated(0.01, "sd of a gyro's gain, relative: data sheets of MEMS gyros"),
    "usual_runs": Calibrated(4.0, "runs that a usual scatter counts as: as many as it was learned from a condition"),
    "nominal": Calibrated(3.0, "how far a vehicle's own mean is from what nobody stated, in scatters between runs"),
    "widened": Calibrated(8.0, "width of what a change may be, in scatters: 80 ms of 13 ms, half the grip of 5 %"),
    "cost_held_out": Calibrated(3.0, "log-likelihood that a change gains where it was not chosen: a factor of 20"),
    "least_scale": Calibrated(0.8, "least noise of a recording over that of those before it: sensors stay"),
    "apart": Calibrated(0.1, "between readings that a filter takes, s: motion, not noise", _RUNS),
    "block": Calibrated(1.0, "over which innovations are taken together, s", _RUNS),
    "together": Calibrated(5.0, "blocks in sums by which their dependence is told: what is slower, scatter holds"),
    "slow": Calibrated(0.25, "of the 95th percentile of speed, below which tyres carry a sixteenth of their load"),
    "drifts": Calibrated(3.0, "standard deviations of a trend over recordings from before that is said: 0.3 %"),
    "rates": Calibrated(1.5, "of the slowest recording's step to the fastest: from there on filters differ"),
    "filters": Calibrated(0.1, "sd of a reading's gain between such: 0.82 to 0.98", "DART laps, 1 pair"),
    "block_degrees": Calibrated(6.0, "degrees of freedom of a second's innovations"),
    "floor_of_weight": Calibrated(0.1, "unknown forces that a filter follows, over the weight, before tuning"),
})  # fmt: skip

CALIBRATION: Mapping[str, float] = MappingProxyType({name: own.value for name, own in PROVENANCE.items()})
"""The values alone."""
