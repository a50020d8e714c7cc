"""Every number that a diagnosis rests on, with where it comes from.

Development only: cases of tier workshop (seed 811) and of the foreign families that no examination draws from (fiala,
exponential; seed 901). What is chosen here is proven on other families. `python -m greybox_lab.exam.calibrate` repeats
the derivations and says how far verdicts depend on the numbers of the search.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import TypeVar

T = TypeVar("T")

DRAWN = "workshop seed 811 (24 nulls, 31 others), fiala and exponential seed 901 (8 nulls, 13 others)"
AGAIN = "workshop seed 811 (24 nulls, 31 others), fiala and exponential seed 901 (12 nulls, 20 others)"
FOREIGN = "foreign tier, fiala and exponential, seed 1301 (8 nulls, 24 singles, 40 outside the vocabulary)"
RUNS = "prototype's EM over unchanged recordings of the DART 1:10 car (free, ramps, laps), 20 pairs"
PAIRS = "changed tier, development: DART, 18 pairs without a change, 7 of them driven alike"
CURVES = "calibrate curves: Fiala's and exponential ones are 0.019 to 0.029 off, magic formulas not at all"
SEARCHED = "calibrate search: halved and doubled at random, all at once: 2 draws, 3 cases, no verdict changed"
OUTSIDE = "clean tier, seeds 918273 (30), 5151 (33 outside the vocabulary), 6161 (20 with one outside and one inside)"
STATED = "workshop 778899 (20) and 5252 (33 outside the vocabulary), many 1571 (3), foreign 7171, development (6)"
BEFORE = "models without forces alone; 444 cases of the clean and workshop tiers, commit 5b2b202"
BEGUN = "foreign tier, fiala and exponential, seed 5501 (12 nulls), benchmarks/beginnings.py, seeds 71, 72"
DEFINED = "by definition: says what the words of an answer mean"
"""What provenances rest on."""


def _known(value: T, how: str, data: str = "") -> T:
    """A number: what it is and how it was derived, and on which cases; "" where it follows from something else."""
    return field(default=value, metadata={"how": how, "data": data})


@dataclass(frozen=True)
class Calibration:
    """Numbers of a diagnosis; `provenance` says of each what it is and where it comes from."""

    # ---- prior of model error and of noise
    form: float = _known(0.01, "median of model error over the force, 1: nulls leave 0.2 to 1.5 %", DRAWN)
    form_exact: float = _known(0.001, "the same where a file states every number as exact: a tenth of it")
    form_sd: float = _known(0.7, "sd of its logarithm: a factor of two to either side")
    form_sd_stated: float = _known(0.35, "the same where a vehicle file states it: half as much is open")
    floor: float = _known(0.02, "median of model error beside that, m/s^2: nulls leave 0.005 to 0.03", DRAWN)
    memory: float = _known(0.5, "median correlation time of model error, s: nulls leave 0.1 to 1.6", DRAWN)
    memory_sd: float = _known(0.7, "sd of its logarithm: a factor of two to either side")
    noise_sd: float = _known(0.03, "sd of the logarithm of stated noise: specifications hold to some per cent")
    noise_sd_estimated: float = _known(1.0, "the same where noise is estimated from second differences")
    colour: float = _known(0.3, "median of the slow part of readings' errors over the white one", DRAWN)
    colour_exact: float = _known(0.02, "the same where every number is exact")
    colour_sd: float = _known(0.7, "sd of its logarithm: a factor of two to either side")
    sensor_memory: float = _known(0.1, "median correlation time of readings' errors, s")
    unknown_start: float = _known(0.3, "sd of a state's start that no sensor reads, over its scale: any usual value")

    # ---- prior of parameters beside what a file states
    indifference: float = _known(0.05, "zone about a null over the usual size: a tenth hid true effects", DRAWN)
    timing: float = _known(0.15, "of a row: zone of delays and lags; commands and readings are no nearer to stamps")
    of_wheelbase: float = _known(0.15, "usual size of lengths over the wheelbase: 0.4 m of 2.7 m")
    of_weight: float = _known(0.007, "usual size of forces over the weight: 100 N of 1 450 kg")
    of_drag: float = _known(0.5, "usual size of a change of drag over c_2: 0.2 of 0.45 N s^2/m^2")
    tolerated_sd: float = _known(3.0, "sds within which an effect is its tolerance, and no gap: 0.3 % are beyond")
    reach_sd: float = _known(6.0, "sds that a nuisance or a change may go: its prior holds it nearer")
    jumps_sd: float = _known(1.0, "of what the least abrupt tolerance does, which is there wholly or not at all")
    curve_off: float = _known(0.015, "rms of a magic formula with slope and peak stated, over the peak", CURVES)
    slope_off: float = _known(0.015, "sd of slope B C beyond its tolerance, relative: stated slopes are measured")
    peak_off: float = _known(0.018, "sd of the peak beyond its tolerance, relative: stated peaks are measured")
    curve_reach: float = _known(1.2, "slips that drives reach, over that of the peak: beyond it they spin")
    loose: tuple[float, float, float] = _known((0.3, 0.1, 0.5), "sd of B and C, relative, and of E: published tyres")

    # ---- what an effect must gain, and when there is something unnamed
    cost: float = _known(
        12.0, "log-odds against an effect that acts abruptly: one of 20 nulls gained 9.8, another 9.0, none more", DRAWN
    )
    rare: float = _known(0.002, "share of vehicles without a gap that gain by any effect what it costs", DEFINED)
    cost_changed: float = _known(6.0, "log-odds against a change, 1 in 400: pairs without any gained 3 at most", PAIRS)
    cost_elsewhere: float = _known(12.0, "the same where they are not driven alike: quiet on pairs of ramps", PAIRS)
    cost_without_forces: float = _known(7.0, "the same of models that know no forces: of 40 effects, 1 in 1 000")
    second_parameter: float = _known(3.0, "log-odds against a second parameter: 20 places where it may be")
    begins: float = _known(
        20.0, "more, of one that begins or ends: one of 12 nulls gained 25 by one, causes 49 to 4 000", BEGUN
    )
    next_to_nothing: float = _known(0.02, "of its usual size: an abrupt effect that only moves readings past rows")
    rough_reading: float = _known(1.2e-3, "log-likelihood a reading that misfits gain unseen; models without forces")
    misfit_share: float = _known(0.02, "the same where they show, as a share of what they cost")
    untempered: float = _known(10.0, "gains are taken as they are where misfits gain well below so much")
    alike: float = _known(3.0, "nats, tempered, below which two explanations are not distinguished: a factor of 20")
    twins: float = _known(0.5, "nats apart, two names are one cause: exact aliases differ by 0.1 at most", AGAIN)
    varies: float = _known(
        0.12, "spread of a size between thirds of a drive, channels: causes 0 to .05, others .2", DRAWN
    )
    varies_beside_unknown: float = _known(
        0.05, "the same beside something unnamed: causes, with or without it, 0 to .04, mimics .04 to .45", OUTSIDE
    )
    varies_rough: float = _known(
        0.16,
        "the same where tolerances are stated: 30 causes 0 to .12, four mimics that were applied .2 to .4",
        STATED,
    )
    varies_width: float = _known(0.02, "width of that threshold", DRAWN)
    surely_varies: float = _known(
        1e-4, "p of a spread by chance from which it counts: a cause had 8e-4, mimics 1e-5", FOREIGN
    )
    parts: int = _known(3, "of a drive over which a magnitude must be one: two tell no curvature")
    acts: float = _known(
        0.025, "of what an effect does, below which it does not act on a channel: starts that follow a sensor do .02"
    )
    part_least: float = _known(1e-4, "of a magnitude's information, below which a part says nothing of it")
    unnamed_share: float = _known(1.8, "model error over its median that is as likely unnamed as not", DRAWN)
    unnamed_slope: float = _known(4.0, "log-odds per logarithm of that", DRAWN)
    unnamed_noise: float = _known(1.15, "noise over what is stated, the same; nulls leave at most 1.07", DRAWN)
    unnamed_noise_slope: float = _known(30.0, "log-odds per logarithm of that", DRAWN)
    strained: float = _known(2.0, "sds of chi-square that tolerances may be off by: 1 in 40", DEFINED)
    unnamed_strain: float = _known(12.0, "strain that is as likely unnamed as not; nulls have 4.5 at most", FOREIGN)
    mimic: float = _known(4.0, "gains over the strain of tolerances beside it, below which an effect is none", FOREIGN)
    mimic_slope: float = _known(4.0, "log-odds per logarithm of that: as of what is unnamed")
    most_effects: int = _known(2, "effects that explain what one cause might: more of them are none", DEFINED)
    surely: float = _known(4.0, "sds of what noise alone may leave: 1 in 30 000")
    excess_exact: float = _known(0.03, "excess over noise, as a share of it, that is no gap yet: of exact equations")
    excess_rough: float = _known(0.1, "the same of rough ones: what examinations want detected")
    excess_learnt: float = _known(1.7, "the same of maps with memory: published networks err so on what trained them")
    beyond: float = _known(3.0, "log-odds of something unknown per logarithm of what is beyond; pairs add up to 1.07")
    nothing_else: float = _known(-4.0, "log-odds of it where nothing speaks for it: 1 in 50", BEFORE)
    of_left: float = _known(2.5, "log-odds of it where all of a gap is left", BEFORE)
    of_structure: float = _known(15.0, "log-odds per share of all gains that driving explains, no effect", BEFORE)
    of_spread: float = _known(12.0, "log-odds per spread of a magnitude between parts", BEFORE)
    widest_spread: float = _known(0.4, "spread beyond which more of it says no more", BEFORE)
    untold: float = _known(1.5, "log-odds where noise is not stated, and for too many effects", BEFORE)
    of_signal: float = _known(0.015, "error of rough equations over what they predict: the same as of curves")
    of_small_signal: float = _known(0.05, "the same of v_y, which is the small difference of what is large")
    far_reading: float = _known(4.5, "robust sds from those about it, beyond which a reading tells of no closure")
    spike: float = _known(6.0, "robust sds of an outlier, where noise is estimated")
    too_large: float = _known(0.8, "of stated noise, below which residuals say that it is stated too large")

    # ---- what words mean
    shows: float = _known(0.1, "excess of free runs over noise that must be detected; shares of less are luck", AGAIN)
    wander_shares: tuple[float, ...] = _known((0.03, 0.1, 0.3, 1.0), "of its usual size: where searches of one begin")
    wander_memories: tuple[float, ...] = _known((0.7, 3.0, 12.0), "s: the same, from a bend to a lap")
    wander_nearby: tuple[float, ...] = _known((0.5, 0.7, 1.0, 1.4, 2.0), "times such a size: up to where the next is")
    wander_soon: tuple[float, ...] = _known((0.4, 0.65, 1.0, 1.6, 2.5), "times such a time: the same")
    present: float = _known(0.5, "probability from which on an effect is said to be there", DEFINED)
    by_chance: float = _known(
        0.05, "how often chance may bring any of all effects as far from none as a cause is", DEFINED
    )
    least_share: float = _known(0.02, "of the excess held out that a cause closes at least", DEFINED)
    least_gap: float = _known(0.01, "excess over the floor, as a share of noise, that shares are of at least", DEFINED)
    no_gap: float = _known(1e-3, "mean excess, in squared noise sds, that is not shared out between regimes", DEFINED)
    lift: float = _known(1.5, "times as much of the gap as of the time, from which on a regime is named", DEFINED)
    regime_share: float = _known(0.4, "and of the gap at all", DEFINED)
    regime_time: float = _known(0.02, "and of the time at least", DEFINED)
    told_probability: float = _known(
        0.005, "probability below which one is as good as none: what is shown as < 0.01", DEFINED
    )
    ranked: int = _known(8, "effects that are listed at most", DEFINED)
    nothing_unknown: float = _known(0.01, "something unknown where nothing is missing; no row says zero", DEFINED)
    nameless: float = _known(0.95, "the same where a gap has no name", DEFINED)
    hidden: float = _known(0.05, "of an effect's information that tolerances leave, below which they hide it", DEFINED)
    at_bound: float = _known(1e-3, "of its usual size: nearer to its bound an effect is at it", DEFINED)
    wider: float = _known(2.0, "times as wide are intervals where equations are rough", DRAWN)
    form_of_size: float = _known(0.05, "sd of a size whose effect has no exact form, relative", DRAWN)
    strip_block: float = _known(1.0, "s in a block of the picture over time", DEFINED)
    strip_cells: int = _known(8, "along each side of the picture over speed and lateral acceleration", DEFINED)

    # ---- readings and blocks
    residual_block: float = _known(2.0, "s over which residuals may be alike: four median correlation times")
    lags: tuple[float, ...] = _known((0.0, 0.12, 0.4), "s at which what is left is looked at: command, lag, motion")
    settling: float = _known(0.2, "s at the beginning of a run that do not count: two lags of sensors")
    least_seconds: float = _known(1.0, "s of recordings: more than twice the longest lag of those looked at")
    draws: int = _known(400, "of the bootstrap: limits of 95 % scatter by a twentieth of the interval")
    around: int = _known(5, "rows about a reading that say what it should be")
    fewest_channels: int = _known(2, "channels that must repeat together: one alone may be quantised")
    some_repeats: int = _known(3, "repeats that are no accident, where readings have noise")
    steady_step: float = _known(0.5, "noise sds from row to row beyond which a reading's rate is not known")
    rows_beside: int = _known(2, "rows to each side whose mean is taken off: misfits last, jitter does not")
    fewest_jumps: int = _known(50, "readings that jump with commands from which on they are looked at")
    row_gain: float = _known(3.0, "log-likelihood that a row may gain: a single one may be an outlier")
    jitter_least: float = _known(1e-5, "s, the least jitter that is tried: below all sample times")
    jitter_most: float = _known(0.05, "s, the greatest: beyond all sample times")
    odds: float = _known(0.1, "by how much more channels explain alone that are at odds about one time")
    jump_shares: tuple[float, ...] = _known((0.0, 0.25, 0.5, 0.75, 1.0), "of jumps that a model may have taken up")

    # ---- what changed between runs
    scatter_grip_scale: float = _known(0.05, "sd of grip between runs, relative", RUNS)
    scatter_front_stiffness: float = _known(0.16, "the same of the front stiffness", RUNS)
    scatter_rear_stiffness: float = _known(0.12, "the same of the rear stiffness", RUNS)
    scatter_steering_ratio: float = _known(0.04, "the same of the steering ratio", RUNS)
    scatter_steering_offset: float = _known(0.0055, "the same of the steering offset, rad", RUNS)
    scatter_steering_delay: float = _known(0.013, "the same of the steering delay, s", RUNS)
    scatter_steering_lag: float = _known(0.013, "the same of the steering lag, s", RUNS)
    scatter_yaw_rate_scale: float = _known(0.01, "sd of a gyro's gain, relative: data sheets of MEMS gyros")
    scatter_yaw_rate_bias: float = _known(0.005, "sd of a gyro's reading at rest, rad/s: data sheets of MEMS gyros")
    scatter_accel_bias_y: float = _known(0.05, "the same of an accelerometer, m/s^2: 5 mg, data sheets of MEMS ones")
    scatter_imu_mount_yaw: float = _known(
        0.005, "sd of its direction, rad: what is screwed on stays within 0.3 degrees"
    )
    scatter_velocity_lever_arm: float = _known(
        0.005, "the same of where speed is measured, over the wheelbase: a centre of gravity moves by as much"
    )
    scatter_sensor_latency_yaw: float = _known(0.001, "sd of a gyro's latency, s: its period, data sheets of MEMS ones")
    scatter_sensor_latency_imu: float = _known(0.001, "the same of a gyro and accelerometers in one box, s")
    usual_runs: float = _known(4.0, "runs that a usual scatter counts as: as many as it was learned from a condition")
    nominal: float = _known(3.0, "how far a vehicle's own mean is from what nobody stated, in scatters between runs")
    widened: float = _known(8.0, "width of what a change may be, in scatters: 80 ms of 13 ms, half the grip of 5 %")
    cost_held_out: float = _known(
        2.0, "log-likelihood that a change gains where chosen, and where not: pairs driven alike gained 0.5", PAIRS
    )
    steered_alike: float = _known(0.05, "rad apart, steering angles are alike: half of a tyre's slip at its peak")
    fast_alike: float = _known(0.2, "apart, relative, speeds are: lateral accelerations are within a factor of 1.4")
    driven: float = _known(0.5, "share of seconds driven alike, from which on recordings are: most", DEFINED)
    elsewhere: float = _known(2.0, "scatters, where they are not driven alike: quiet on pairs of ramps", PAIRS)
    least_scale: float = _known(0.8, "least noise of a recording over that of those before it: sensors stay")
    apart: float = _known(0.1, "between readings that a filter takes, s: motion, not noise", RUNS)
    block: float = _known(1.0, "over which innovations are taken together, s", RUNS)
    together: float = _known(5.0, "blocks in sums by which their dependence is told: what is slower, scatter holds")
    slow: float = _known(0.25, "of the 95th percentile of speed, below which tyres carry a sixteenth of their load")
    drifts: float = _known(3.0, "standard deviations of a trend over recordings from before that is said: 0.3 %")
    rates: float = _known(1.5, "of the slowest recording's step to the fastest: from there on filters differ")
    filters: float = _known(0.1, "sd of a reading's gain between such: 0.82 to 0.98", "DART laps, 1 pair")
    filtered: float = _known(0.05, "the same of what filters take that all share: half of it", PAIRS)
    block_degrees: float = _known(6.0, "degrees of freedom of a second's innovations")
    floor_of_weight: float = _known(0.1, "unknown forces that a filter follows, over the weight, before tuning")
    astray: float = _known(1e3, "sds that a reading is off where the filter has lost the vehicle: any large number")
    followed: float = _known(60.0, "s of a recording that are followed at most: time goes with them")
    tuned_on: float = _known(20.0, "s of it that sizes of noise are tuned on")
    changed_refitted: int = _known(3, "effects that are refitted: those expected to gain most")
    changed_least: float = _known(1.0, "nats that the second and third of them are expected to gain")
    changed_starts: tuple[float, ...] = _known(
        (-4.0, -2.2, -1.2, -0.6, 0.6, 1.2, 2.2), "sizes tried first, in widths of what may be: grip on ice is 3.5 off"
    )
    matters: float = _known(0.3, "information over the prior: numbers of which an after tells less stay")

    # ---- what is searched
    starts: tuple[float, ...] = _known(
        tuple(2.0**k / 16 for k in (0.0, 7 / 6, 14 / 6, 3.5, 28 / 6, 35 / 6, 7.0)),
        "of an effect's usual size: where the search for one begins whose derivative vanishes", SEARCHED,
    )  # fmt: skip
    delay_starts: tuple[float, ...] = _known((0.47, 1.9), "the same for delays: none a usual sample time", SEARCHED)
    gradual_start: float = _known(0.3, "the same of what a small magnitude does tells of a larger one", SEARCHED)
    rivals: int = _known(3, "more are refitted there", SEARCHED)
    places: int = _known(200, "instants at which an effect may begin or end, to first order: less than a second apart")
    least_part: float = _known(0.05, "of the rows that it acts in at least, and does not: of less, few tell", DEFINED)
    least_told: float = _known(
        0.1, "of what is told of an effect, before and after it begins; nulls' grip had .01, .02, causes .26", BEGUN
    )
    begun: int = _known(3, "effects that begin or end are refitted: those expected to gain most", SEARCHED)
    nearly: float = _known(0.5, "of the best pair's gain, that one is expected to have: to first order", SEARCHED)
    firm: tuple[float, ...] = _known(
        (2.0, 4.0, 8.0, 16.0, 32.0), "rates of an observer, 1/s: the first that keeps a simulation from spinning"
    )
    freed_again: int = _known(4, "times that tolerances are linearised again for free runs", SEARCHED)
    freed_enough: float = _known(0.02, "of a cost that is worth once more", SEARCHED)
    again: int = _known(3, "times that nuisances are linearised again", SEARCHED)
    enough: float = _known(1.0, "nats that are worth once more", SEARCHED)
    far: float = _known(
        1e100, "what derivatives count as at most, where a vehicle spins: of larger ones no sums of squares"
    )
    trusts: tuple[float, ...] = _known((0.05, 0.25, 1.0), "as how many readings one counts, the prior first", SEARCHED)

    # ---- everything at once
    few: int = _known(3, "effects of which every set is refitted for its share: eight sets", DEFINED)
    gradual_sizes: tuple[float, ...] = _known((0.3,), "of its usual size at which an effect is looked at", SEARCHED)
    abrupt_sizes: tuple[float, ...] = _known(
        (0.12, 0.3, 0.7, 1.7), "the same of effects whose derivative vanishes at the null", SEARCHED
    )
    beyond_start: float = _known(2.5, "times such a size, up to which its secant is used", DEFINED)
    evidence_rounds: int = _known(12, "steps of evidence maximisation", SEARCHED)
    evidence_settled: float = _known(0.05, "of a logarithm of a variance, below which it moves no more", SEARCHED)
    stages: tuple[float, ...] = _known((8.0, 3.0, 1.0), "times as rough as usual: each is a hypothesis", DEFINED)
    steps_of_stage: tuple[int, ...] = _known((3, 3, 4), "of the search in each of them", SEARCHED)
    steps_of_rough_stage: tuple[int, ...] = _known(
        (8, 4, 4), "the same beside tolerances: three left 700 nats on CommonRoad's cars", "seeds 0 and 3"
    )
    rounding: float = _known(1e-12, "of a sum of squares, below which no digit of it is left", DEFINED)
    against: float = _known(5.0, "log-odds against a cause before anything was read, beside what its size costs", DRAWN)
    rough_sd: float = _known(0.4, "sd of the logarithm of how rough forms are: as of other vehicles", DEFINED)
    rounds_as_rough: int = _known(8, "steps at most where equations are as rough as is left: far from linear", SEARCHED)
    refits: int = _known(2, "steps of everything where a cause was taken away", SEARCHED)
    listed: int = _known(3, "effects that are listed at least, however little speaks for them", DEFINED)
    much_rougher: float = _known(3.0, "times as rough as usual, from which on no name at all is tried, too", DEFINED)
    likely_there: float = _known(0.15, "of its usual size, sd from which on a cause is likely there", SEARCHED)
    spreads_weighed: int = _known(6, "times that causes are weighed by how their magnitudes differ at most", SEARCHED)
    doubted: float = _known(
        4.0, "times its price, up to which what a cause gains is looked at from two starts", SEARCHED
    )
    acts_alike: float = _known(
        0.5, "cosine between what two causes do, all else refitted, from which they act alike", DEFINED
    )
    exchange_steps: int = _known(6, "steps at most of a cause in another one's place: secants halve errors")
    dampings: tuple[float, ...] = _known(
        (0.0, *(10.0**k for k in range(7))),
        "precisions of staying where all is, over those of usual sizes: the step that lowers the objective most",
        SEARCHED,
    )
    leaves: float = _known(3.0, "standard deviations at most that a cause is off while a search is on its way", DEFINED)
    exchanged: int = _known(3, "causes that are tried in the place of each", SEARCHED)
    exchange_look: float = _known(6.0, "nats to first order, within which they are", SEARCHED)
    as_rough: float = _known(
        1.3, "times the prior of forms, from which unknown forces say that they are rougher", DEFINED
    )
    as_rough_again: int = _known(2, "times at most", SEARCHED)
    second_odds: float = _known(1.0, "more, of each free second parameter", DEFINED)
    still: float = _known(0.05, "of its scale, below which nothing moves any more", SEARCHED)
    strides: tuple[float, ...] = _known(
        (1.0, 3.0),
        "sds, or usual sizes, that a step of everything goes, in each of two walks",
        "shipped racer, guesses",
    )
    walks_apart: float = _known(
        100.0,
        "nats by which two walks differ that are lost: up to 50 near a file, 580 to 3 200 far from one",
        "workshop 778, many 1571, rough 871 and 891, shipped racer, Indy car, CommonRoad",
    )
    alike_in_both: float = _known(3.0, "sds of their difference that sizes are apart at most in both walks", DEFINED)
    switched_on: float = _known(0.05, "of its usual size, from which on an abrupt effect is simulated", SEARCHED)
    moved_on: float = _known(0.2, "of its scale that anything moves, from which on all is looked at anew", SEARCHED)
    second_sd: float = _known(0.35, "least sd of a second parameter, relative: a factor of two", DEFINED)

    # ---- how numbers are found
    iterations: int = _known(10, "steps of a refit", SEARCHED)
    settled: float = _known(0.05, "nats: a step that gains less is the last", SEARCHED)
    expected: float = _known(0.1, "of that, below which a step is not taken: it is the most that is ever expected")
    fitted: float = _known(1e-4, "of an objective, that a step of a closed model's fit is expected to gain: as fits do")
    worn: float = _known(0.2, "of its size that a magnitude moves on kept derivatives: they are off by about as much")
    as_foretold: float = _known(0.1, "off what was foretold, relative, a gain renews them: they are a third off then")
    hopeless: float = _known(2e-4, "added to that, of what is left to explain", SEARCHED)
    shortened: float = _known(0.1, "of its length a step keeps: no parabola leads to where motion spins", DEFINED)
    shortest: float = _known(0.003, "share of a step below which it leads nowhere", SEARCHED)
    short: float = _known(0.1, "the same for a start seen from its origin", SEARCHED)
    shy: float = _known(0.3, "of its stride that what shapes curves goes, once that was too far", SEARCHED)
    stride: float = _known(3.0, "sds that it goes in a step: curves are not linear in it", SEARCHED)
    at_once: float = _known(0.02, "of an abrupt tolerance that stands for the least there can be of it", SEARCHED)
    within_delay: float = _known(0.9, "of a delay, to either side, its derivative is of: at none readings jump")
    shift_beside: float = _known(0.3, "of an abrupt tolerance, how far beside its derivative is taken", SEARCHED)
    beside: float = _known(1e-3, "of its scale, how far beside a magnitude's derivative is taken", SEARCHED)
    shifted: float = _known(1e-4, "the same of delays, s", SEARCHED)
    on_a_row: float = _known(1e-6, "rows, how near to a row a delay is on it: rounding of time stamps")
    early: float = _known(1e-6, "s by which a reading is taken before its row's command: any small time")
    ridge: float = _known(1e-9, "of its diagonal, added to a scaled Hessian: half the digits")
    glance: int = _known(2, "steps after which a delay of whole rows must be better than what it replaces", SEARCHED)
    amplitude_step: float = _known(1e-3, "of a logarithm, for derivatives by amplitudes", SEARCHED)
    memory_step: float = _known(1e-5, "of a parameter of a network, for its derivative: a third of the digits")
    segments: int = _known(2400, "that amplitudes are estimated on", SEARCHED)
    curve_points: int = _known(60, "of a curve that its error is averaged over", SEARCHED)
    colour_order: int = _known(6, "highest order of residuals' colour, chosen by BIC", SEARCHED)
    colour_gain: float = _known(400.0, "that whitening may amplify a frequency by", SEARCHED)
    block_ridge: float = _known(1e-3, "of a unit variance, added to that of a block's innovations")
    between_steps: int = _known(40, "steps of numbers between runs: from two starts alike within 0.1 nats", RUNS)
    between_settled: float = _known(0.1, "nats: where steps between runs are expected to gain less they end")
    between_still: int = _known(5, "steps that gain less, one after the other: readings past rows make plateaus")
    between_beside: float = _known(1e-2, "of the width of a number, how far beside its derivative is taken")
    most_relative: float = _known(0.1, "of a number, of which that width is at most")
    delay_step: float = _known(5e-3, "the same of delays, s: rows cut what they move")
    clocks: float = _known(0.1, "s that clocks of commands and readings differ by: 77 ms found", "DART, data check")
    amplitude_steps: int = _known(8, "of the search for amplitudes", SEARCHED)
    coefficient_rows: int = _known(20, "rows that a coefficient of residuals' colour needs", SEARCHED)
    smooth: float = _known(0.2, "s that regimes are smoothed over: noise tells none", DEFINED)
    damping: float = _known(1e-3, "least of such steps but none, over the Hessian's diagonal: Nielsen's first")
    least_promise: float = _known(0.01, "of between_settled, below which a damped step is not tried: noise of costs")
    rounds_of_scatter: int = _known(4, "times that scatter is learned, numbers found anew for each")
    settled_scatter: float = _known(0.03, "of a scatter, below which a change of it asks for no more")
    most_rows: int = _known(24_000, "rows that are examined, four minutes at 100 Hz: time goes with them")
    thinnest: float = _known(0.05, "s between rows that free runs are fitted to: a tenth of a vehicle's yaw motion")
    excerpt_block: float = _known(20.0, "s of the blocks that they are in: long beside any motion")
    passes: int = _known(2, "through the dynamics: a stage begins with what the stage before left")
    lanes: int = _known(8, "simulations at once: two registers of four; results are the same")
    remembered: int = _known(8_000_000, "readings of simulations that are kept, 64 MB; results are the same")
    few_runs: int = _known(8, "runs whose starts are nuisances each; of more they are states of the filter")


CAL = Calibration()


def provenance() -> dict[str, tuple[object, str, str]]:
    """Of every number its value, what it is and how it was derived, and on which cases."""
    return {
        item.name: (getattr(CAL, item.name), item.metadata["how"], item.metadata["data"])
        for item in fields(Calibration)
    }
