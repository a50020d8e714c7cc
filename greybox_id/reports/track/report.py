"""The report of a track: three sentences, tables and figures."""

from __future__ import annotations

from math import isfinite

import numpy as np
from matplotlib.axes import Axes

from ...base.numbers import alike, counted, listed, number, percent, pretty_unit, quantity, signal_words, with_sd
from ...base.signals import unit_of
from ...filters.findings import WINDOW
from ...filters.state_space import walking
from ...models.effects import EFFECTS
from ...models.model import must_be
from ...models.motion_model import MotionModel
from ...models.registry import build
from ..content import heading, recorded_in, written_down
from ..document import Document, Drawing, Pairs, Part, Points, Table, Text, VerdictBox, titled
from ..equations.motion import motion_equations
from ..figures.characteristics import forces_over_slip
from ..figures.sheet import BLUE, DOTTED, INK, MEASURED, PALE, ZERO, Sheet, band, look, symbol
from .digest import Course, Digest

MOST_NAMED = 4
"""Most estimates named in the first sentence."""
LEADS = ("How sure", "Consistent", "Checked")


def verdict(digest: Digest) -> tuple[str, str, str]:
    """Three sentences: uncertainty, consistency, comparison with measurements."""
    return _how_sure(digest), _is_it_so(digest), _against_what(digest)


def method(one: Digest) -> str:
    """The filter in words, such as "a UKF and smoother"."""
    return f"{'an' if one.filter == 'ekf' else 'a'} {one.filter.upper()}{' and smoother' if one.smoothed else ''}"


def _how_sure(one: Digest) -> str:
    walks = {name: estimate.told for name, estimate in one.estimates.items() if estimate.told is not None}
    names = [name for name in dict.fromkeys(("sideslip", *walks)) if name in one.estimates][:MOST_NAMED]
    each = [
        f"{quantity(item.sd, item.unit)} in {signal_words(name)}" for name in names for item in [one.estimates[name]]
    ]
    untold = [f"{signal_words(name)} in {percent(walk)}" for name, walk in walks.items() if walk < 1]
    return (
        f"Recording {one.data.name} has {counted(one.rows, 'row')} in {counted(one.runs, 'run')}. The median standard "
        f"deviation of the estimates of {method(one)} with the model {one.model} is {listed(each)}"
        f"{f'. The recording determines {listed(untold)} of the rows' if untold else ''}."
    )


def _is_it_so(digest: Digest) -> str:
    evaluated = {name: item for name, item in digest.consistency.items() if isfinite(item.nis)}
    if not evaluated:
        return "There are too few readings to say whether the filter's standard deviations are right."
    means = listed([f"{number(item.nis, 2)} in {signal_words(name)}" for name, item in evaluated.items()])
    inside = listed(
        [
            f"{percent(item.inside)} of the windows for {signal_words(name)}"
            for name, item in evaluated.items()
            if isfinite(item.inside)
        ]
    )
    windows = (
        f". Averaged over windows of {WINDOW:g} s, it lies within its 95 % bounds in {inside} (95 % are expected)"
        if inside
        else ""
    )
    widened = f". The bands of the estimates were widened by a factor of {number(digest.widened, 3)}"
    return (
        f"The mean squared innovation divided by its expected value (NIS; 1 if the filter is consistent) is {means}"
        f"{windows}"
        f"{_memory(digest)}{widened if digest.widened > 1 else ''}."
    )


def _memory(digest: Digest) -> str:
    """Whether innovations are correlated in time, as a clause."""
    beyond = [
        f"{number(item.correlation, 2)} in {signal_words(name)}"
        for name, item in digest.consistency.items()
        if abs(item.correlation) > item.correlation_bound
    ]
    if not beyond:
        return ". Successive innovations do not correlate"
    return (
        f". Successive innovations correlate by {listed(beyond)}, more than by chance: the model lacks an effect, "
        "or the noise is correlated"
    )


def _against_what(digest: Digest) -> str:
    if not digest.truth:
        return (
            "The recording holds no measurement of an estimated quantity that the filter did not use, so the error of "
            "the estimates is not known."
        )
    each = [
        f"{quantity(item.rmse, item.unit)} in {signal_words(name)} ({percent(item.inside)} within two sd)"
        for name, item in digest.truth.items()
    ]
    return f"Compared with measurements that the filter did not use, the RMSE of estimates is {listed(each)}."


NOISES = {
    "walk": "random walk of {}, per square root of a second",
    "noise": "white noise of the readings of {}",
    "colour": "slow part of the error of {}",
    "memory": "correlation time of {}",
}
"""Kind of noise -> meaning of its size."""


def provenance(digest: Digest) -> tuple[Table, tuple[tuple[str, str], ...]]:
    """The recording, and pairs on the provenance of the track."""
    made = digest.made
    walks = [n if n in digest.estimates else f"the input {n}, which was not recorded" for n in digest.parameters]
    pairs = (
        ("version", f"greybox-id {made.version}"),
        ("command", made.command or "not recorded (tracked from Python)"),
        ("vehicle", made.vehicle or "none named"),
        ("filter", f"{method(digest)} on {digest.model}"),
        ("random walk", listed(walks) or "nothing"),
        ("returns to the value in the model", listed(digest.disturbances) or "nothing"),
        ("effects added", listed([*digest.effects]) or "none"),
    )
    return recorded_in([digest.data], {"track": "tracked"}), pairs


def estimates(digest: Digest) -> Table:
    """A row per estimate."""
    walks = any(estimate.told is not None for estimate in digest.estimates.values())
    rows = tuple(
        (
            signal_words(name), *alike(estimate.low, estimate.median, estimate.high, estimate.sd, by=estimate.sd),
            pretty_unit(estimate.unit), *(("" if estimate.told is None else percent(estimate.told),) if walks else ()),
        )
        for name, estimate in digest.estimates.items()
    )  # fmt: skip
    head = ("estimate", "5 %", "median", "95 %", "median sd", "unit", *(("identifiable in",) if walks else ()))
    return Table(head, rows, "lRRRRlR"[: len(head)])


def truth(digest: Digest) -> Table:
    """A row per estimate with measurements that the filter did not use."""
    rows = tuple(
        (
            signal_words(name), number(item.rmse), number(item.bias, 2), number(item.worst, 2), number(item.size),
            pretty_unit(item.unit), percent(item.inside), f"{item.rows:,}".replace(",", "\u00a0"),
        )
        for name, item in digest.truth.items()
    )  # fmt: skip
    head = ("estimate", "RMSE", "mean error", "largest", "RMS measured", "unit", "within two sd", "rows")
    return Table(head, rows, "lRRRRlRR")


def readings(digest: Digest) -> Table:
    """Consistency of the filter, a row per reading."""
    rows = tuple(
        (
            signal_words(name), f"{one.count:,}".replace(",", "\u00a0"), number(one.rms), pretty_unit(unit_of(name)),
            number(one.nis), percent(one.inside), number(one.correlation, 2), f"± {number(one.correlation_bound, 2)}",
            str(one.gated),
        )
        for name, one in digest.consistency.items()
    )  # fmt: skip
    head = (
        "reading",
        "samples used",
        "innovation RMS",
        "unit",
        "NIS",
        "windows within",
        "autocorrelation",
        "bound",
        "gated",
    )
    return Table(head, rows, "lRRlRRRRR")


def noises(digest: Digest) -> Table:
    """A row per noise that influences the estimates."""
    rows = []
    for name, item in digest.noise.items():
        kind, _, of = name.partition("_")
        shares = " (as a share of its value)" if kind == "walk" and item.unit in ("", "1") else ""
        unit = f"{'1' if shares else pretty_unit(item.unit)}/√s" if kind == "walk" else pretty_unit(item.unit)
        meaning = NOISES[kind].format(signal_words(of)) + shares
        origin = f"{item.origin} on the first {digest.made.tuned_on:g} s" if item.origin == "tuned" else item.origin
        rows.append((name, meaning, number(item.size), unit, origin))
    return Table(("noise", "meaning", "size", "unit", "from"), tuple(rows), "lLrll")


def calibrated(digest: Digest) -> Table:
    """A row per parameter of the model that was calibrated, too."""
    rows = tuple((name, with_sd(value, sd)) for name, (value, sd) in digest.calibrated.items())
    return Table(("parameter", "estimate ± sd, SI units"), rows, "lL")


def signals(digest: Digest) -> Table:
    """A row per channel that the filter used, with its range."""
    rows = tuple(
        (signal_words(name), role, *(number(end) for end in ends), pretty_unit(unit))
        for name, (unit, role, ends) in digest.signals.items()
    )
    return Table(("channel", "taken as", "0.5 %", "median", "99.5 %", "unit"), rows, "lLRRRl")


TALL = 68.0
BORDER = look(INK, 0.5, dashes=DOTTED)
"""Line at the beginning of a run."""
SHARE = 0.995
"""Share of the estimates within the axis; bands may extend beyond it."""
MIDDLE, LOW = 60.0, 75.0


def drawings(digest: Digest) -> tuple[Drawing, ...]:
    """Estimates over time, forces over slip angle if the model has them, and innovations over time and lags."""
    how = f"{digest.filter.upper()} and smoother" if digest.smoothed else digest.filter.upper()
    more = " Measurements of the estimated quantities are drawn, too." if digest.course.measured else ""
    more += f" One of {digest.course.every} rows is drawn." if digest.course.every > 1 else ""
    if digest.runs > 1:
        more += " Runs begin at dotted lines and are drawn one after the other if their clocks start again."
    made = (
        Drawing(
            "estimates",
            over_time(digest),
            f"Estimates over time ({how}), with bands of two standard deviations.{more}",
            "Estimates over time with bands.",
        ),
        Drawing(
            "forces_over_slip",
            forces_over_slip(digest.course.values),
            "Estimated lateral force of each axle over its slip angle; darker where there are more samples.",
            "Lateral force over slip angle, front and rear, as a density of samples.",
        ),
        Drawing(
            "innovations",
            squares(digest),
            "Normalised innovations squared (NIS), means over 2 s, with the bounds that hold 95 % of them if the "
            "filter's standard deviations are right.",
            "NIS of each reading over time with its bounds.",
        ),
        Drawing(
            "whiteness",
            whiteness(digest),
            "Correlation of each innovation with the one a lag later. If the filter uses all information in the "
            "readings, an innovation does not depend on earlier ones. Correlations outside the band come from an "
            "effect that "
            "the model lacks, or from correlated noise.",
            "Correlation of the innovations of each reading over lags, with its band.",
        ),
    )
    return tuple(one for one in made if one.figure is not None)


def over_time(digest: Digest) -> Sheet:
    """Estimates with bands of two standard deviations, a panel each."""
    course = digest.course
    sheet = Sheet((TALL,) * len(course.sds), joined=True)
    for ax, name in zip(sheet.grid[:, 0], course.sds, strict=True):
        _draw(ax, course, name)
        ax.set_ylabel(f"{symbol(name)}\n[{pretty_unit(digest.estimates[name].unit)}]")
    ax.set(xlabel="time [s]", xlim=(np.min(course.time), np.max(course.time)))
    return sheet


def _draw(ax: Axes, course: Course, name: str) -> None:
    """Estimates of all runs; most lie within the axis, bands may extend beyond it."""
    for run in np.unique(course.run):
        value = course.run == run
        first = run == course.run[0]
        time, values, sd = course.time[value], course.values[name][value], course.sds[name][value]
        if not first:
            ax.axvline(float(time[0]), **BORDER)
        band(ax, time, values - 2 * sd, values + 2 * sd, label="± 2 sd" if first else None)
        ax.plot(time, values, **look(BLUE, 0.9, "estimate" if first else None))
    if name in course.measured:
        ax.plot(course.time, course.measured[name], **MEASURED | {"linewidth": 0.7})
    low, high = np.nanquantile(course.values[name], [1 - SHARE, SHARE])
    margin = 0.35 * (high - low) + 2 * float(np.nanmedian(course.sds[name]))
    if margin > 0:
        ax.set_ylim(low - margin, high + margin)


def squares(digest: Digest) -> Sheet:
    """Normalised innovations squared over time, a panel per reading."""
    ends = np.array([np.min(digest.course.time), np.max(digest.course.time)])
    sheet = Sheet((MIDDLE,) * len(digest.innovations), joined=True)
    for ax, (name, innovation) in zip(sheet.grid[:, 0], digest.innovations.items(), strict=True):
        band(
            ax,
            ends,
            np.full(2, innovation.low),
            np.full(2, innovation.high),
            PALE,
            "95 % of windows, if consistent",
            0.4,
        )
        ax.plot(innovation.time, innovation.nis, **look(BLUE, 0.6, "mean over 2 s", dots=1.2))
        ax.set(ylabel=f"NIS {symbol(name)}\n[1]", yscale="log")
    ax.set(xlabel="time [s]", xlim=ends)
    return sheet


def whiteness(digest: Digest) -> Sheet:
    """Autocorrelations of the innovations, a panel per reading."""
    sheet = Sheet((LOW,), len(digest.innovations))
    for ax, (name, innovation) in zip(sheet.grid[0], digest.innovations.items(), strict=True):
        half = np.full(2, digest.consistency[name].correlation_bound)
        band(ax, innovation.lags[[0, -1]], -half, half, PALE, "95 % if independent", 0.4)
        ax.axhline(0.0, **ZERO)
        ax.plot(innovation.lags, innovation.correlation, **look(BLUE, 0.9, dots=1.2))
        ax.set(
            xlabel="lag [s]",
            xlim=(0.0, innovation.lags[-1]),
            ylabel="correlation [1]",
            ylim=(-0.6, 1.05),
            title=symbol(name),
        )
        ax.set_yticks((-0.5, 0.0, 0.5, 1.0), ("−0.5", "0", "0.5", "1"))
    return sheet


ESTIMATES = (
    "Quantiles of the estimates over all rows, and the median of their standard deviations. The output table of the "
    "filter has estimates and standard deviations row by row. Identifiable in: share of the rows that determine a "
    "tracked parameter."
)
TRUTH = (
    "Estimate minus measurement, over the rows that have both. These numbers include the errors of the measurement. "
    "If the bands are right, 95 % of the rows lie within two standard deviations."
)
READINGS = (
    "An innovation is a reading minus the filter's prediction of it. NIS: the square of the innovation divided by "
    "the variance that the filter expects; its mean is 1 if that variance is right. Windows within: share of "
    "windows of 2 s in which the mean NIS lies within its 95 % bounds. Autocorrelation: correlation of an innovation "
    "with the one before; without any correlation, 95 % of the values are within the bound. Gated: number of readings "
    "so far from their prediction that they got a lower weight."
)
NOISE = (
    "If random walks are large compared with the noise of the readings, the filter follows the readings more than its "
    "model. The sizes of random walks and noise are tuned to maximise the likelihood of the readings that the filter "
    "uses. Other measurements, such as a measured sideslip, have no influence on them."
)
BANDS = (
    "Bands extend two standard deviations to each side. They come from the filter and from parameters stated with a "
    "standard deviation. They do not include errors of the equations."
)
RANGE = "Outside the ranges in the section “Signals used”, these estimates say nothing about the vehicle."
EQUATIONS = (
    "Tracked parameters are states of these equations. A dot is a time derivative; w1, w2 and so on "
    "stand for repeated terms. A prime marks a quantity that an effect or a tracked parameter alters; “late” marks a "
    "delayed quantity, and “read” the reading of a sensor."
)


def track_report(digest: Digest) -> Document:
    """The report of a track."""
    made = {one.name: one for one in drawings(digest)}
    recorded, pairs = provenance(digest)
    parts = (
        VerdictBox(tuple(zip(LEADS, verdict(digest), strict=True))),
        *titled("Provenance", recorded, Pairs(pairs)),
        *titled("What was estimated", estimates(digest), Text(ESTIMATES), made["estimates"]),
        *((made["forces_over_slip"],) if "forces_over_slip" in made else ()),
        *titled("Against what was measured", truth(digest), Text(TRUTH if digest.truth else "")),
        *titled(
            "Are the filter's standard deviations right?",
            made["innovations"], made["whiteness"], readings(digest), Text(READINGS),
        ),
        *titled("Noise levels used", noises(digest), Text(NOISE)),
        *titled("Calibrated along", calibrated(digest)),
        *titled("Signals used", signals(digest)),
        *_equations(digest),
        *titled("Limits", Points((*digest.sentences, BANDS, *_about_tuning(digest), RANGE))),
    )  # fmt: skip
    about = f"{digest.model}: {digest.about}"
    title = heading("Track", digest.made.vehicle or digest.model, [digest.data])
    return Document(title, about, "a track", f"greybox-id {digest.made.version}", parts)


def _about_tuning(digest: Digest) -> tuple[str, ...]:
    made = digest.made
    seconds = max(made.tuned_on, made.calibrated_on)
    if not seconds or not (digest.calibrated or any(item.origin == "tuned" for item in digest.noise.values())):
        return ()
    what = "Noise and parameters were" if digest.calibrated else "Noise was"
    return (f"{what} tuned on the first {seconds:g} s: innovations are smaller there than elsewhere.",)


def _equations(digest: Digest) -> tuple[Part, ...]:
    model = must_be(MotionModel, build(digest.model, digest.settings, digest.effects))
    walked, _ = walking(model, digest.parameters, digest.disturbances, EFFECTS)
    return titled("Equations of the model", *written_down(motion_equations(walked), EQUATIONS))
