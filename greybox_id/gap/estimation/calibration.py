"""Every number that a diagnosis rests on, with its origin.

Development only: cases of tier workshop (seed 811) and of the foreign families that no examination draws from (fiala,
exponential; seed 901). Numbers chosen here are tested on other families. `python -m greybox_lab.exam.calibrate` repeats
the derivations and reports how far verdicts depend on the numbers of the search.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import TypeVar

from ...models.effects.memory import LATEST

T = TypeVar("T")

DRAWN = "workshop seed 811 (24 nulls, 31 others), fiala and exponential seed 901 (8 nulls, 13 others)"
AGAIN = "workshop seed 811 (24 nulls, 31 others), fiala and exponential seed 901 (12 nulls, 20 others)"
FOREIGN = "foreign tier, fiala and exponential, seed 1301 (8 nulls, 24 singles, 40 outside the vocabulary)"
RUNS = "prototype's EM over unchanged recordings of the DART 1:10 car (free, ramps, laps), 20 pairs"
FOUR = "unchanged recordings of four vehicles: DART free (8), RoboRacer train (5), truck train (10), Ferrari first (7)"
PAIRS = "changed tier, development: DART, 18 pairs without a change, 7 of them driven alike"
CURVES = "calibrate curves: Fiala's and exponential ones are 0.019 to 0.029 off, magic formulas not at all"
SEARCHED = "calibrate search: halved and doubled at random, all at once: 2 draws, 3 cases, no verdict changed"
OUTSIDE = "clean tier, seeds 918273 (30), 5151 (33 outside the vocabulary), 6161 (20 with one outside and one inside)"
STATED = "workshop 778899 (20) and 5252 (33 outside the vocabulary), many 1571 (3), foreign 7171, development (6)"
BEFORE = "models without forces alone; 444 cases of the clean and workshop tiers, commit 5b2b202"
BEGUN = "foreign tier, fiala and exponential, seed 5501 (12 nulls), benchmarks/beginnings.py, seeds 71, 72"
DEFINED = "by definition: says what the words of an answer mean"
"""Sources of the numbers."""


def _known(value: T, how: str, data: str = "") -> T:
    """A number, with its meaning and derivation, and the cases of that; "" where it follows from another number."""
    return field(default=value, metadata={"how": how, "data": data})


@dataclass(frozen=True)
class Calibration:
    """Numbers of a diagnosis; `provenance` gives meaning and origin of each."""

    # ---- prior of model error and of noise
    form: float = _known(0.01, "median of model error over the force, 1: nulls leave 0.2 to 1.5 %", DRAWN)
    form_exact: float = _known(0.001, "the same where a file states every number as exact: a tenth of it")
    amplitude_sd: float = _known(0.7, "sd of the logarithm of sizes and correlation times of errors: a factor of two")
    floor: float = _known(0.02, "median of model error at zero force over mass, m/s^2: nulls leave .005 to .03", DRAWN)
    memory: float = _known(0.5, "median correlation time of model error, s: nulls leave 0.1 to 1.6", DRAWN)
    noise_sd: float = _known(0.03, "sd of the logarithm of stated noise: specifications hold to some per cent")
    noise_sd_estimated: float = _known(1.0, "the same where noise is estimated from second differences")
    colour: float = _known(0.3, "median of readings' slow errors over their white noise", DRAWN)
    colour_exact: float = _known(0.02, "the same where every number is exact")
    sensor_memory: float = _known(0.1, "median correlation time of readings' errors, s")
    unknown_start: float = _known(0.3, "sd of a state's start that no sensor reads, over its scale: any usual value")

    # ---- priors of parameters in addition to a file's
    indifference: float = _known(0.05, "zone about a null over the usual size: a tenth hid true effects", DRAWN)
    timing: float = _known(0.15, "of a row: zone of delays and lags; commands and readings are no nearer to stamps")
    of_wheelbase: float = _known(0.15, "usual size of lengths over the wheelbase: 0.4 m of 2.7 m")
    of_weight: float = _known(0.007, "usual size of forces over the weight: 100 N of 1 450 kg")
    of_drag: float = _known(0.5, "usual size of a change of drag over c_2: 0.2 of 0.45 N s^2/m^2")
    tolerated_sd: float = _known(
        3.0, "sds within which what is tolerated, drifts or differs is no more than chance: 0.3 % are beyond"
    )
    reach_sd: float = _known(6.0, "sds that a nuisance or a change may go: its prior holds it nearer")
    jumps_sd: float = _known(1.0, "sd of the jump that an abrupt tolerance makes at its least size: all or nothing")
    curve_off: float = _known(
        0.015,
        "rms of a magic formula with slope and peak stated, over the peak, and of any prediction by such equations",
        CURVES,
    )
    slope_off: float = _known(0.015, "sd of slope B C beyond its tolerance, relative: stated slopes are measured")
    peak_off: float = _known(0.018, "sd of the peak beyond its tolerance, relative: stated peaks are measured")
    curve_reach: float = _known(1.2, "slips that drives reach, over that of the peak: beyond it vehicles spin")
    loose: tuple[float, float, float] = _known((0.3, 0.1, 0.5), "sd of B and C, relative, and of E: published tyres")

    # ---- gains that effects need, and signs of something unnamed
    cost: float = _known(
        12.0, "log-odds against an effect that acts abruptly: one of 20 nulls gained 9.8, another 9.0, none more", DRAWN
    )
    rare: float = _known(0.002, "share of vehicles without a gap on which some effect gains its cost", DEFINED)
    cost_changed: float = _known(6.0, "log-odds against a change, 1 in 400: pairs without any gained 3 at most", PAIRS)
    cost_without_forces: float = _known(
        7.0, "log-odds against an effect of a model without unknown forces: of 40, 1 in 1 000"
    )
    second_parameter: float = _known(3.0, "log-odds against a second parameter: 20 places where it may be")
    begins: float = _known(
        20.0, "more, against one that begins or ends: one of 12 nulls gained 25 by one, causes 49 to 4 000", BEGUN
    )
    next_to_nothing: float = _known(0.02, "of its usual size: an abrupt effect that only moves readings past rows")
    form_gain_per_reading: float = _known(
        1.2e-3, "log-likelihood per reading that form errors gain undetected; without forces"
    )
    form_gain_share: float = _known(0.02, "the same of detected ones, as a share of the cost of their errors")
    negligible_form_gain: float = _known(10.0, "nats: if form errors gain far less, gains are not tempered")
    alike: float = _known(3.0, "nats, tempered, below which two explanations are not distinguished: a factor of 20")
    twins: float = _known(0.5, "nats, within which two names are one cause: exact aliases differ by 0.1 at most", AGAIN)
    varies: float = _known(
        0.12, "relative spread of a size over thirds of a drive or channels: causes have 0 to .05, others .2", DRAWN
    )
    varies_beside_unknown: float = _known(
        0.05, "the same beside something unnamed: causes, with or without it, 0 to .04, mimics .04 to .45", OUTSIDE
    )
    varies_inexact: float = _known(
        0.16,
        "the same where tolerances are stated: 30 causes 0 to .12, four mimics that were applied .2 to .4",
        STATED,
    )
    varies_width: float = _known(0.02, "width of that threshold", DRAWN)
    surely_varies: float = _known(
        1e-4, "p-value of a spread, below which it counts: a cause had 8e-4, mimics 1e-5", FOREIGN
    )
    parts: int = _known(3, "of a drive, in which a magnitude must be the same: two show no curvature")
    acts: float = _known(
        0.025, "share of an effect's action, below which it does not act on a channel: starts by a sensor have .02"
    )
    part_least: float = _known(1e-4, "share of a magnitude's information, below which a part does not inform it")
    unnamed_share: float = _known(1.8, "model error over its median where something unnamed is as likely as not", DRAWN)
    unnamed_slope: float = _known(4.0, "log-odds per logarithm of that", DRAWN)
    unnamed_noise: float = _known(1.15, "noise over its stated size, the same; nulls leave at most 1.07", DRAWN)
    unnamed_noise_slope: float = _known(30.0, "log-odds per logarithm of that", DRAWN)
    strained: float = _known(2.0, "sds of chi-square that tolerances may be off by: 1 in 40", DEFINED)
    unnamed_strain: float = _known(12.0, "strain that is as likely unnamed as not; nulls have 4.5 at most", FOREIGN)
    mimic: float = _known(4.0, "gain over the strain of tolerances beside it, below which an effect is none", FOREIGN)
    mimic_slope: float = _known(4.0, "log-odds per logarithm of that: as of something unnamed")
    most_effects: int = _known(2, "effects in an explanation: more of them are a sign of something unknown", DEFINED)
    surely: float = _known(4.0, "sds that noise alone may reach: 1 in 30 000")
    excess_exact: float = _known(0.03, "excess over noise, as a share of it, that is no gap yet, of exact equations")
    excess_inexact: float = _known(0.1, "the same of inexact ones: examinations require more to be detected")
    excess_learnt: float = _known(1.7, "the same of maps with memory: published networks err so on what trained them")
    beyond: float = _known(3.0, "log-odds of something unknown per logarithm of the excess over that; pairs reach 1.07")
    nothing_else: float = _known(-4.0, "log-odds of something unknown without any sign of it: 1 in 50", BEFORE)
    of_left: float = _known(2.5, "log-odds of it where all of a gap remains", BEFORE)
    of_structure: float = _known(15.0, "log-odds per share of all gains that driving explains, and no effect", BEFORE)
    of_spread: float = _known(12.0, "log-odds per spread of a magnitude between parts", BEFORE)
    widest_spread: float = _known(0.4, "spread beyond which a larger one is no stronger sign", BEFORE)
    of_other_signs: float = _known(1.5, "log-odds where noise is not stated, and for too many effects", BEFORE)
    of_small_signal: float = _known(
        0.05, "error of predictions of v_y over these, by inexact equations: a small difference of large quantities"
    )
    otherwise: float = _known(
        25.0, "nats that the other hold of commands must gain: 16 wrongly, beside jitter; 230 to 1 000 of 20 ms", DRAWN
    )
    far_reading: float = _known(4.5, "robust sds from neighbours' errors, beyond which a reading shows no closure")
    spike: float = _known(6.0, "robust sds of an outlier, where noise is estimated")
    too_large: float = _known(0.8, "residuals over stated noise, below which the latter is stated too large")

    # ---- meaning of words
    shows: float = _known(0.1, "excess of free runs over noise that must be detected; shares of less are chance", AGAIN)
    wander_shares: tuple[float, ...] = _known((0.03, 0.1, 0.3, 1.0), "sd over its usual size: where searches begin")
    wander_memories: tuple[float, ...] = _known((1.4, 7.0), "s, correlation time: the same, of a bend and of a lap")
    promising: float = _known(
        0.5, "share of the gain that must be reached there: up to 1.8 times an sd and 2.2 times a time lose a third"
    )
    wander_nearby: tuple[float, ...] = _known((0.5, 0.7, 1.0, 1.4, 2.0), "times such an sd: up to where the next is")
    wander_soon: tuple[float, ...] = _known((0.4, 0.65, 1.0, 1.6, 2.5), "times such a time: the same")
    knots_apart: float = _known(0.25, "distance between knots of a course, over the reach of its magnitude", DEFINED)
    most_knots: int = _known(120, "most knots of a course: then they are farther apart", SEARCHED)
    present: float = _known(0.5, "probability from which on an effect is called present", DEFINED)
    suspected: float = _known(0.25, "the same of something unnamed, from which on varying effects are tried: nulls .13")
    by_chance: float = _known(0.05, "how often an effect is named by chance that is not there, a recording", DEFINED)
    least_share: float = _known(0.02, "least share of the held-out excess that a cause closes", DEFINED)
    least_gap: float = _known(0.01, "least excess over the floor, as a share of noise, to divide shares by", DEFINED)
    no_gap: float = _known(1e-3, "mean excess, in squared noise sds, that is not shared out between regimes", DEFINED)
    lift: float = _known(1.5, "share of the gap over share of the time, from which on a regime is named", DEFINED)
    regime_share: float = _known(0.4, "and its least share of the gap", DEFINED)
    regime_time: float = _known(0.02, "and its least share of the time", DEFINED)
    least_probability: float = _known(
        0.005, "probability below which an effect counts as absent: shown as < 0.01", DEFINED
    )
    ranked: int = _known(8, "effects that are listed at most", DEFINED)
    nothing_unknown: float = _known(0.01, "of something unknown where nothing is missing; no row says zero", DEFINED)
    nameless: float = _known(0.95, "the same where a gap has no name", DEFINED)
    hidden: float = _known(0.05, "share of an effect's information that tolerances leave, if they absorb it", DEFINED)
    at_bound: float = _known(1e-3, "of its usual size: nearer to its bound an effect is at the bound", DEFINED)
    wider: float = _known(2.0, "factor on intervals where equations are inexact", DRAWN)
    form_of_size: float = _known(0.05, "sd of a size whose effect has no exact form, relative", DRAWN)
    strip_block: float = _known(1.0, "s in a block of the picture over time", DEFINED)
    strip_cells: int = _known(8, "along each side of the picture over speed and lateral acceleration", DEFINED)

    # ---- readings and blocks
    lags: tuple[float, ...] = _known((0.0, 0.12, 0.4), "s from driving signals to errors: command, lag, motion")
    settling: float = _known(LATEST[1], "s at the beginning of a run that do not count: the largest latency", DEFINED)
    least_seconds: float = _known(1.0, "s of recordings: more than twice the longest lag of those looked at")
    draws: int = _known(400, "of the bootstrap: ends of 95 % intervals scatter by a twentieth of the interval")
    fewest_channels: int = _known(2, "channels that must repeat together: one alone may be quantised")
    some_repeats: int = _known(3, "repeats that are no accident, where readings have noise")
    steady_step: float = _known(0.5, "noise sds from row to row beyond which a reading's rate is not known")
    rows_beside: int = _known(2, "rows to each side whose mean is subtracted: model errors last, jitter does not")
    fewest_jumps: int = _known(50, "least number of readings that jump with commands for which jumps are examined")
    row_gain: float = _known(3.0, "most log-likelihood that a row may gain: a single one may be an outlier")
    jitters: tuple[float, float] = _known(
        (1e-5, 0.05), "s, of which jitter is searched: from below to beyond all sample times"
    )
    odds: float = _known(0.1, "share of a gain that separate jitters of channels may add, if there is a common one")
    jump_shares: tuple[float, ...] = _known((0.0, 0.25, 0.5, 0.75, 1.0), "of jumps that a model may have absorbed")

    # ---- what changed between runs
    scatter_grip_scale: float = _known(0.05, "sd of grip between runs, relative", RUNS)
    scatter_front_stiffness: float = _known(0.16, "the same of the front stiffness", RUNS)
    scatter_rear_stiffness: float = _known(0.12, "the same of the rear stiffness", RUNS)
    scatter_steering_ratio: float = _known(0.04, "the same of the steering ratio", RUNS)
    scatter_steering_offset: float = _known(0.0055, "the same of the steering offset, rad", RUNS)
    scatter_steering_delay: float = _known(0.013, "the same of the steering delay and of its lag, s", RUNS)
    scatter_yaw_rate_scale: float = _known(0.01, "sd of a gyro's gain, relative: data sheets of MEMS gyros")
    scatter_yaw_rate_bias: float = _known(0.005, "sd of a gyro's reading at rest, rad/s: data sheets of MEMS gyros")
    scatter_accel_bias_y: float = _known(0.05, "the same of an accelerometer, m/s^2: 5 mg, data sheets of MEMS ones")
    scatter_imu_mount_yaw: float = _known(
        0.005, "sd of its direction, rad: what is screwed on stays within 0.3 degrees"
    )
    scatter_velocity_lever_arm: float = _known(
        0.005, "the same of where speed is measured, over the wheelbase: a centre of gravity moves by as much"
    )
    scatter_sensor_latency_yaw: float = _known(
        0.001, "sd of the latency, s, of a gyro, alone or with accelerometers: its period, data sheets of MEMS ones"
    )
    vehicles_apart: float = _known(
        0.9, "sd between vehicles of the logarithm of all their scatters: by marginal likelihood", FOUR
    )
    scatters_apart: float = _known(0.85, "the same between numbers of a vehicle, each over its usual one", FOUR)
    scatters_stride: float = _known(1.0, "longest step of these logarithms: scoring is of first order")
    nominal: float = _known(3.0, "sd of a vehicle's own mean where it is not stated, in scatters between runs")
    remounted: float = _known(
        0.5, "prior sd of a change of where speed is measured, over the wheelbase: any place on 1.7 wheelbases of car"
    )
    widened: float = _known(8.0, "prior sd of a change, in scatters: 80 ms of 13 ms, half the grip of 5 %")
    cost_held_out: float = _known(
        2.0, "log-likelihood that a change gains where chosen and where judged: pairs driven alike gained 0.5", PAIRS
    )
    steered_alike: float = _known(0.05, "rad, within which steering is alike: half of a tyre's slip at its peak")
    fast_alike: float = _known(0.2, "relative, within which speeds are alike: accelerations within a factor of 1.4")
    driven: float = _known(0.5, "share of seconds driven alike, from which on recordings are: most", DEFINED)
    elsewhere: float = _known(
        2.0, "factor on scatters and costs where they are not driven alike: quiet on pairs of ramps", PAIRS
    )
    least_scale: float = _known(0.8, "least noise of a recording over that of those before it: sensors do not improve")
    apart: float = _known(0.1, "s between readings that a filter takes: predictions are of motion, not noise", RUNS)
    block: float = _known(1.0, "s of innovations in a block", RUNS)
    together: float = _known(5.0, "blocks in the sums that show their correlation: slower errors are scatter")
    slow: float = _known(0.25, "of the 95th percentile of speed, below which tyres carry a sixteenth of their load")
    rates: float = _known(1.5, "sample time of the slowest recording over the fastest one's: then filters differ")
    filters: float = _known(0.1, "sd of a reading's gain between such: 0.82 to 0.98", "DART laps, 1 pair")
    block_degrees: float = _known(6.0, "degrees of freedom of the t distribution of a block")
    floor_of_weight: float = _known(0.1, "unknown forces that a filter follows, over the weight, before tuning")
    astray: float = _known(1e3, "innovation, in sds, where the filter has lost the vehicle: any large number")
    followed: float = _known(60.0, "s of a recording that are filtered at most: time is in proportion")
    tuned_on: float = _known(20.0, "s of it on which sizes of noise are tuned")
    changed_starts: tuple[float, ...] = _known(
        (-4.0, -2.2, -1.2, -0.6, 0.6, 1.2, 2.2), "sizes tried first, in widths of what may be: grip on ice is 3.5 off"
    )
    matters: float = _known(0.3, "information over the prior: numbers that later recordings inform less are held")

    # ---- extent of searches
    gradual_start: float = _known(
        0.3, "of the usual size, at which gradual effects are simulated that have second parameters", SEARCHED
    )
    places: int = _known(200, "instants at which an effect may begin or end, to first order: less than a second apart")
    least_part: float = _known(0.05, "least share of rows in which one acts, and does not: fewer inform less", DEFINED)
    part_information: float = _known(
        0.1, "least share of an effect's information on either side; nulls' grip had .01, .02, causes .26", BEGUN
    )
    refitted: int = _known(
        3, "candidates that are refitted: those expected to gain most, and their best rivals", SEARCHED
    )
    nearly: float = _known(0.5, "of the best explanation's gain, that one is expected to have to first order", SEARCHED)
    observer_rates: tuple[float, ...] = _known(
        (2.0, 4.0, 8.0, 16.0, 32.0), "rates of an observer, 1/s: the first that keeps a simulation from spinning"
    )
    freed_again: int = _known(4, "times that tolerances are linearised again for free runs", SEARCHED)
    freed_enough: float = _known(0.02, "relative reduction of a cost that justifies another time", SEARCHED)
    again: int = _known(3, "times that nuisances are linearised again", SEARCHED)
    enough: float = _known(1.0, "nats that justify another time", SEARCHED)
    far: float = _known(1e100, "limit of derivatives where a vehicle spins: sums of squares of larger ones overflow")
    trusts: tuple[float, ...] = _known((0.05, 0.25, 1.0), "readings that one counts as, prior first", SEARCHED)

    # ---- joint search
    few: int = _known(3, "effects of which every set is refitted for its share: eight sets", DEFINED)
    abrupt_sizes: tuple[float, ...] = _known(
        (0.12, 0.3, 0.7, 1.7),
        "of its usual size, where an effect is probed whose derivative vanishes at the null",
        SEARCHED,
    )
    beyond_start: float = _known(2.5, "multiple of such a size, up to which its secant is used", DEFINED)
    evidence_rounds: int = _known(12, "steps of evidence maximisation", SEARCHED)
    evidence_settled: float = _known(0.05, "change of a variance's logarithm, below which it has converged", SEARCHED)
    error_scales: tuple[float, ...] = _known(
        (8.0, 3.0, 1.0), "model error over its usual size in successive stages", DEFINED
    )
    steps_of_stage: tuple[int, ...] = _known((3, 3, 4), "steps of the search in each of them", SEARCHED)
    steps_of_stage_with_tolerances: tuple[int, ...] = _known(
        (8, 4, 4), "the same with tolerances: three left 700 nats on CommonRoad's cars", "seeds 0 and 3"
    )
    rounding: float = _known(1e-12, "of a sum of squares, below which it is rounding alone", DEFINED)
    against: float = _known(5.0, "prior log-odds against a cause, in addition to the Occam factor of its size", DRAWN)
    error_scale_sd: float = _known(
        0.4, "sd of the logarithm of the scale of model error: as of other vehicles", DEFINED
    )
    rounds_at_scale: int = _known(8, "most steps at the model error that residuals show: far from linear", SEARCHED)
    refits: int = _known(2, "joint steps after a cause is dropped", SEARCHED)
    listed: int = _known(3, "effects that are listed at least, however little speaks for them", DEFINED)
    scale_without_causes: float = _known(
        3.0, "scale of model error from which on no cause at all is tried, too", DEFINED
    )
    likely_included: float = _known(0.15, "prior sd over the usual size from which on a cause is included", SEARCHED)
    spreads_weighed: int = _known(6, "most rounds in which causes are weighed by how their magnitudes differ", SEARCHED)
    doubted: float = _known(
        4.0, "factor on its price, up to which a gradual cause's gain is simulated, not of first order", SEARCHED
    )
    acts_alike: float = _known(
        0.5, "cosine between the columns of two causes, all else refitted, from which on they act alike", DEFINED
    )
    refits_of_set: int = _known(4, "most times that a set of causes is refitted by as many steps as below", SEARCHED)
    exchange_steps: int = _known(6, "most steps with a cause in another one's place: secants halve errors")
    steps_behind: float = _known(
        3.0, "of the last of them: what further ones change at most; as they halve, they add up to one", DEFINED
    )
    dampings: tuple[float, ...] = _known(
        (0.0, *(10.0**k for k in range(7))),
        "damping precisions over those of usual sizes: the step that lowers the objective most is taken",
        SEARCHED,
    )
    leaves: float = _known(3.0, "most prior sds that a magnitude may be off during a search", DEFINED)
    exchanged: int = _known(3, "causes that are tried in the place of each", SEARCHED)
    exchange_look: float = _known(6.0, "nats to first order, up to which an exchange is refitted", SEARCHED)
    scale_change: float = _known(
        1.3, "factor by which unknown forces must exceed the scale of model error to change it", DEFINED
    )
    scale_changes: int = _known(2, "times at most that it is changed", SEARCHED)
    second_odds: float = _known(1.0, "further log-odds against each free second parameter", DEFINED)
    still: float = _known(0.05, "step over scales, below which the search has converged", SEARCHED)
    still_gain: float = _known(0.3, "nats that a step gains, below which it has: a tenth of what tells names apart")
    strides: tuple[float, ...] = _known(
        (1.0, 3.0),
        "longest joint steps, in sds or usual sizes, of each of two walks",
        "shipped racer, guesses",
    )
    walks_apart: float = _known(
        100.0,
        "nats between two walks, beyond which both are lost: up to 50 near a file, 580 to 3 200 far from one",
        "workshop 778, many 1571, rough 871 and 891, shipped racer, Indy car, CommonRoad",
    )
    switched_on: float = _known(0.05, "of its usual size, from which on an abrupt effect is simulated", SEARCHED)
    moved_on: float = _known(5.0, "nats that a step gains, after which causes are probed anew", SEARCHED)
    second_sd: float = _known(0.35, "least sd of a second parameter, relative: a factor of two", DEFINED)

    # ---- numerics
    iterations: int = _known(10, "steps of a refit", SEARCHED)
    settled: float = _known(0.05, "nats: a step that gains less is the last", SEARCHED)
    expected: float = _known(0.1, "of that, below which a step's predicted gain is too small: it is an upper bound")
    stale: float = _known(0.2, "of its size that a magnitude moves on kept derivatives: they are off by about as much")
    prediction_error: float = _known(
        0.1, "relative error of a predicted gain that renews them: they are a third off then"
    )
    hopeless: float = _known(2e-4, "added to that, per nat that is left to explain", SEARCHED)
    shortened: float = _known(0.1, "least factor that shortens a step: no parabola fits where vehicles spin", DEFINED)
    shortest: float = _known(0.003, "share of a step below which it is given up", SEARCHED)
    short: float = _known(0.1, "the same for a start from its origin", SEARCHED)
    shorter_stride: float = _known(0.3, "factor on the stride of curve shapes once it was too long", SEARCHED)
    stride: float = _known(3.0, "sds that these go in a step: curves are not linear in them", SEARCHED)
    at_once: float = _known(0.02, "of an abrupt tolerance's sd, which stands for its least size", SEARCHED)
    within_delay: float = _known(0.9, "half width of a delay's difference, over it, at most: at none readings jump")
    shift_beside: float = _known(0.3, "half width of the difference by an abrupt tolerance, in its sds", SEARCHED)
    beside: float = _known(
        1e-3, "step of the difference by a magnitude, over its scale, or by a logarithm of an amplitude", SEARCHED
    )
    shifted: float = _known(1e-4, "the same of delays, s", SEARCHED)
    on_a_row: float = _known(1e-6, "rows, how near to a row a delay is on it: rounding of time stamps")
    early: float = _known(1e-6, "s by which a reading is taken before its row's command: any small time")
    ridge: float = _known(1e-9, "of its diagonal, added to a scaled Hessian: half the digits")
    screening_steps: int = _known(
        2, "steps after which a delay of whole rows must be better than what it replaces", SEARCHED
    )
    memory_step: float = _known(1e-5, "step of the difference by a network's parameter: a third of the digits")
    segments: int = _known(2400, "most segments on which amplitudes are estimated", SEARCHED)
    curve_points: int = _known(60, "points of a curve over which its error is averaged", SEARCHED)
    colour_order: int = _known(6, "highest order of the autoregressive process of residuals, chosen by BIC", SEARCHED)
    colour_gain: float = _known(400.0, "largest variance of such a process over that of its innovations", SEARCHED)
    block_ridge: float = _known(1e-3, "added to the unit variances of a block's innovations")
    between_steps: int = _known(40, "most steps of numbers between runs: from two starts alike within 0.1 nats", RUNS)
    between_settled: float = _known(0.1, "nats: predicted gain of such a step below which they end")
    between_still: int = _known(5, "successive steps that gain less, then they end: readings past rows make plateaus")
    between_beside: float = _known(1e-2, "step of the difference by a number, over its sd")
    most_relative: float = _known(0.1, "largest relative sd in that step")
    flat: float = _known(1e-6, "factor on a prior precision that leaves next to nothing of it, and matrices regular")
    delay_step: float = _known(5e-3, "the same of delays, s: rows cut what they move")
    clocks: float = _known(0.1, "s by which clocks of commands and readings differ: 77 ms found", "DART, data check")
    amplitudes_settled: float = _known(0.01, "nats: predicted gain of a step at which the search for amplitudes ends")
    coefficient_rows: int = _known(20, "rows per coefficient of the autoregressive process", SEARCHED)
    smooth: float = _known(0.2, "s over which regimes are smoothed, so that noise does not define them", DEFINED)
    damping: float = _known(1e-3, "least nonzero damping of such steps, over the Hessian's diagonal: Nielsen's first")
    least_promise: float = _known(0.01, "of between_settled, below which a damped step is not tried: noise of costs")
    rounds_of_scatter: int = _known(4, "rounds in which scatter is estimated, numbers refitted in each")
    settled_scatter: float = _known(
        0.1, "relative change of a scatter, below which rounds end: three runs leave its logarithm an sd of .3 to .9"
    )
    most_rows: int = _known(24_000, "rows that are examined at most, four minutes at 100 Hz: time is in proportion")
    thinnest: float = _known(0.05, "s between rows that free runs are fitted to: a tenth of a vehicle's yaw motion")
    excerpt_block: float = _known(20.0, "s of the blocks of an excerpt: long compared with any motion")
    passes: int = _known(2, "through the dynamics: a stage begins with the result of the stage before")
    remembered: int = _known(8_000_000, "readings of simulations that are kept, 64 MB; results are the same")
    few_runs: int = _known(8, "runs whose starts are nuisances each; of more they are states of the filter")


CAL = Calibration()


def provenance() -> dict[str, tuple[object, str, str]]:
    """Name -> value of a number, its meaning and derivation, and the cases of that."""
    return {
        item.name: (getattr(CAL, item.name), item.metadata["how"], item.metadata["data"])
        for item in fields(Calibration)
    }
