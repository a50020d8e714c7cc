"""The report of a track: three sentences, tables, pictures, and their order."""

from __future__ import annotations

from math import isfinite

import numpy as np
from matplotlib.axes import Axes

from ...base.numbers import alike, counted, listed, number, percent, pretty_unit, quantity, signal_words, with_sd
from ...base.signals import unit_of
from ...filters.findings import WINDOW
from ...filters.walking import walking
from ...models.effects import EFFECTS
from ...models.kinds import must_be
from ...models.motion_model import MotionModel
from ...models.registry import build
from ..content import recorded_in, written_down
from ..document import Document, Drawing, Pairs, Part, Points, Table, Text, VerdictBox, titled
from ..equations.motion import motion_equations
from ..figures.characteristics import forces_over_slip
from ..figures.sheet import Sheet, band
from ..figures.style import BLUE, DOTTED, INK, MEASURED, PALE, ZERO, look, symbol
from .digest import Course, Digest, Measured

MOST_NAMED = 4
"""Estimates that the first sentence names."""
LEADS = ("How sure", "Is it so", "Against what")


def verdict(found: Digest) -> tuple[str, str, str]:
    """Three sentences."""
    return _how_sure(found), _is_it_so(found), _against_what(found)


def method(found: Digest) -> str:
    """The filter in words: a UKF and smoother."""
    return f"{'an' if found.filter == 'ekf' else 'a'} {found.filter.upper()}{' and smoother' if found.smoothed else ''}"


def _how_sure(found: Digest) -> str:
    walks = {name: own.told for name, own in found.estimates.items() if own.told is not None}
    names = [name for name in dict.fromkeys(("sideslip", *walks)) if name in found.estimates][:MOST_NAMED]
    each = [
        f"{quantity(own.sd, own.unit)} in {signal_words(name)}" for name in names for own in [found.estimates[name]]
    ]
    untold = [f"{signal_words(name)} in {percent(told)}" for name, told in walks.items() if told < 1]
    return (
        f"Along {found.data.name}, {counted(found.rows, 'row')} in {counted(found.runs, 'run')}, {method(found)} on "
        f"{found.model} estimates with a standard deviation of, in the median, {listed(each)}"
        f"{f'; the recording informs {listed(untold)} of the rows' if untold else ''}."
    )


def _is_it_so(found: Digest) -> str:
    told = {name: own for name, own in found.consistency.items() if isfinite(own.nis)}
    if not told:
        return "Too few readings were taken to say whether the filter knows how wrong it is."
    means = listed([f"{number(own.nis, 2)} in {signal_words(name)}" for name, own in told.items()])
    inside = listed([f"{percent(own.inside)}" for own in told.values() if isfinite(own.inside)])
    windows = f", and {inside} of the windows of {WINDOW:g} s lie within their 95 % bounds" if inside else ""
    widened = f"; bands are wider by {number(found.widened, 3)} for it" if found.widened > 1 else ""
    return f"Squared innovations are {means} times what the filter expects{windows}{_memory(found)}{widened}."


def _memory(found: Digest) -> str:
    """Whether innovations depend on those before, as a clause."""
    beyond = [
        f"{number(own.correlation, 2)} in {signal_words(name)}"
        for name, own in found.consistency.items()
        if abs(own.correlation) > own.correlation_bound
    ]
    if not beyond:
        return "; neighbouring innovations do not correlate"
    return f"; neighbouring innovations correlate by {listed(beyond)}, more than chance: something there has a memory"


def _against_what(found: Digest) -> str:
    if not found.truth:
        return (
            "Nothing that was estimated was also measured without entering the filter: how far the estimates are off "
            "cannot be told from this recording."
        )
    each = [_error(name, own) for name, own in found.truth.items()]
    return f"Against what was measured and did not enter the filter, estimates err by an RMSE of {listed(each)}."


def _error(name: str, own: Measured) -> str:
    return f"{quantity(own.rmse, own.unit)} in {signal_words(name)} ({percent(own.inside)} within two sd)"


NOISES = {
    "walk": "{} walks by so much in the root of a second",
    "noise": "white noise of the readings of {}",
    "colour": "slow part of the error of {}",
    "memory": "how long {} lasts",
}
"""Kind of noise -> what its size says."""


def provenance(found: Digest) -> tuple[Table, tuple[tuple[str, str], ...]]:
    """The recording, and what reproduces the track."""
    made = found.made
    pairs = (
        ("version", f"greybox-id {made.version}"),
        ("command", made.command or "not recorded (tracked from Python)"),
        ("vehicle", made.vehicle or "none named"),
        ("filter", f"{method(found)} on {found.model}"),
        ("walks for good", listed([_walks(found, name) for name in found.parameters]) or "nothing"),
        ("comes and goes", listed(found.disturbances) or "nothing"),
        ("effects added", listed([*found.effects]) or "none"),
    )
    return recorded_in([found.data], {"track": "tracked"}), pairs


def _walks(found: Digest, name: str) -> str:
    return name if name in found.estimates else f"the input {name}, which was not recorded"


def estimates(found: Digest) -> Table:
    """A row for each estimate."""
    walks = any(own.told is not None for own in found.estimates.values())
    rows = tuple(
        (
            signal_words(name), *alike(own.low, own.median, own.high, own.sd, by=own.sd),
            pretty_unit(own.unit), *(("" if own.told is None else percent(own.told),) if walks else ()),
        )
        for name, own in found.estimates.items()
    )  # fmt: skip
    head = ("estimate", "5 %", "median", "95 %", "median sd", "unit", *(("identifiable in",) if walks else ()))
    return Table(head, rows, "lRRRRlR"[: len(head)])


def truth(found: Digest) -> Table:
    """A row for each estimate that was measured and did not enter the filter."""
    rows = tuple(
        (
            signal_words(name), number(own.rmse), number(own.bias, 2), number(own.worst, 2), number(own.size),
            pretty_unit(own.unit), percent(own.inside), f"{own.rows:,}".replace(",", "\u00a0"),
        )
        for name, own in found.truth.items()
    )  # fmt: skip
    head = ("estimate", "RMSE", "mean error", "largest", "RMS measured", "unit", "within two sd", "rows")
    return Table(head, rows, "lRRRRlRR")


def readings(found: Digest) -> Table:
    """A row for each reading: whether the filter expected it."""
    rows = tuple(
        (
            signal_words(name), f"{own.count:,}".replace(",", "\u00a0"), number(own.rms), pretty_unit(unit_of(name)),
            number(own.nis), percent(own.inside), number(own.correlation, 2), f"± {number(own.correlation_bound, 2)}",
            str(own.gated),
        )
        for name, own in found.consistency.items()
    )  # fmt: skip
    head = ("reading", "taken", "innovation RMS", "unit", "NIS", "windows within", "next to next", "chance", "gated")
    return Table(head, rows, "lRRlRRRRR")


def noises(found: Digest) -> Table:
    """A row for each noise that has a part in the estimates."""
    rows = []
    for name, own in found.noise.items():
        kind, _, of = name.partition("_")
        shares = " (a share of itself)" if kind == "walk" and own.unit in ("", "1") else ""
        unit = f"{'1' if shares else pretty_unit(own.unit)}/√s" if kind == "walk" else pretty_unit(own.unit)
        said = NOISES[kind].format(signal_words(of)) + shares
        origin = f"{own.origin} on the first {found.made.tuned_on:g} s" if own.origin == "tuned" else own.origin
        rows.append((name, said, number(own.size), unit, origin))
    return Table(("noise", "meaning", "size", "unit", "from"), tuple(rows), "lLrll")


def calibrated(found: Digest) -> Table:
    """A row for each parameter of the model that was tuned along."""
    rows = tuple((name, with_sd(value, sd)) for name, (value, sd) in found.calibrated.items())
    return Table(("parameter", "estimate ± sd, SI units"), rows, "lL")


def signals(found: Digest) -> Table:
    """A row for each channel that went in, with the range that was driven."""
    rows = tuple(
        (signal_words(name), role, *(number(own) for own in ends), pretty_unit(unit))
        for name, (unit, role, ends) in found.signals.items()
    )
    return Table(("channel", "taken as", "0.5 %", "median", "99.5 %", "unit"), rows, "lLRRRl")


TALL = 68.0
BORDER = look(INK, 0.5, dashes=DOTTED)
"""Where a run begins."""
SHARE = 0.995
"""The axis shows this share of the estimates; a band may open further."""
MIDDLE, LOW = 60.0, 75.0


def drawings(found: Digest) -> tuple[Drawing, ...]:
    """Estimates over time, forces over slip angle where a model has them, and the innovations over time and lags."""
    how = f"{found.filter.upper()} and smoother" if found.smoothed else found.filter.upper()
    more = " What was measured of them is drawn beside them." if found.course.measured else ""
    more += f" Of {found.course.every} rows one is drawn." if found.course.every > 1 else ""
    if found.runs > 1:
        more += " Runs begin at dotted lines; where their clocks begin anew they are laid one behind the other."
    made = [
        Drawing(
            "estimates",
            over_time(found),
            f"Estimates over time ({how}), with bands of two standard deviations.{more}",
            "Estimates over time with bands.",
        )
    ]
    slips = forces_over_slip(found.course.values)
    if slips is not None:
        made.append(
            Drawing(
                "forces_over_slip",
                slips,
                "Lateral force of each axle over its slip angle, as estimated: darker where more samples lie.",
                "Lateral force over slip angle, front and rear, as a density of samples.",
            )
        )
    made += [
        Drawing(
            "innovations",
            squares(found),
            "Normalised innovations squared (NIS), means over 2 s, and within which bounds 95 % of them lie if the "
            "filter knows how wrong it is.",
            "NIS of each reading over time with its bounds.",
        ),
        Drawing(
            "whiteness",
            whiteness(found),
            "Correlation of innovations with those a lag later. If the filter takes from the readings all that they "
            "tell, an innovation does not depend on those before; what stays outside the band is something the model "
            "lacks, or noise that has a memory of its own.",
            "Correlation of the innovations of each reading over lags, with its band.",
        ),
    ]
    return tuple(made)


def over_time(found: Digest) -> Sheet:
    """Estimates with bands of two standard deviations, one panel each."""
    course = found.course
    sheet = Sheet((TALL,) * len(course.sds), joined=True)
    for ax, name in zip(sheet.grid[:, 0], course.sds, strict=True):
        _draw(ax, course, name)
        ax.set_ylabel(f"{symbol(name)}\n[{pretty_unit(found.estimates[name].unit)}]")
    ax.set(xlabel="time [s]", xlim=(np.min(course.time), np.max(course.time)))
    return sheet


def _draw(ax: Axes, course: Course, name: str) -> None:
    """Estimates of every run; the axis shows most of them, bands may open further."""
    for run in np.unique(course.run):
        own = course.run == run
        first = run == course.run[0]
        time, values, sd = course.time[own], course.values[name][own], course.sds[name][own]
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


def squares(found: Digest) -> Sheet:
    """Normalised innovations squared over time, one panel for each reading."""
    ends = np.array([np.min(found.course.time), np.max(found.course.time)])
    sheet = Sheet((MIDDLE,) * len(found.innovations), joined=True)
    for ax, (name, own) in zip(sheet.grid[:, 0], found.innovations.items(), strict=True):
        band(ax, ends, np.full(2, own.low), np.full(2, own.high), PALE, "95 % of windows, if consistent", 0.4)
        ax.plot(own.time, own.nis, **look(BLUE, 0.6, "mean over 2 s", dots=1.2))
        ax.set(ylabel=f"NIS {symbol(name)}\n[1]", yscale="log")
    ax.set(xlabel="time [s]", xlim=ends)
    return sheet


def whiteness(found: Digest) -> Sheet:
    """Correlations of innovations with later ones, one panel for each reading."""
    sheet = Sheet((LOW,), len(found.innovations))
    for ax, (name, own) in zip(sheet.grid[0], found.innovations.items(), strict=True):
        half = np.full(2, found.consistency[name].correlation_bound)
        band(ax, own.lags[[0, -1]], -half, half, PALE, "95 % if independent", 0.4)
        ax.axhline(0.0, **ZERO)
        ax.plot(own.lags, own.correlation, **look(BLUE, 0.9, dots=1.2))
        ax.set(
            xlabel="lag [s]", xlim=(0.0, own.lags[-1]), ylabel="correlation [1]", ylim=(-0.6, 1.05), title=symbol(name)
        )
        ax.set_yticks((-0.5, 0.0, 0.5, 1.0), ("−0.5", "0", "0.5", "1"))
    return sheet


ESTIMATES = (
    "Quantiles over the rows, and the median of the standard deviations; row by row they are in the table that the "
    "track left. Identifiable in: of what walks, the share of rows in which the recording informs beyond what was "
    "known before."
)
TRUTH = (
    "Estimate less measurement, over the rows that have both. The measurement has errors of its own, which are in "
    "these numbers. If the bands are right, 95 % of the rows lie within two standard deviations."
)
READINGS = (
    "An innovation is a reading less what the filter expected of it. NIS: its square over the variance that the filter "
    "expected, 1 on average if the filter knows how wrong it is; windows within: share of means over 2 s inside their "
    "95 % bounds; next to next: correlation with the one before, and what chance makes of it; gated: so far off that "
    "they counted as noisier."
)
NOISE = (
    "What walks and how noisy readings are decides how much the filter trusts what. Tuned: the size under which the "
    "readings are least surprising, and that says nothing of the sideslip."
)
BANDS = (
    "Bands are two standard deviations: of the filter, and of what is stated of the model with a standard deviation. A "
    "model of another form than the vehicle's is not in them."
)
RANGE = "Beyond the ranges given in What went in, this track says nothing of the vehicle."
EQUATIONS = (
    "Written down from the model itself, with what walks in its place. A dot is a derivative by time, w an "
    "abbreviation; a prime marks what an effect or a walking number alters, late what a delay leaves, read what a "
    "sensor reads."
)


def track_report(found: Digest) -> Document:
    """What the report of a track says and shows."""
    made = {one.name: one for one in drawings(found)}
    recorded, pairs = provenance(found)
    parts = (
        VerdictBox(tuple(zip(LEADS, verdict(found), strict=True))),
        *titled("Provenance", recorded, Pairs(pairs)),
        *titled("What was estimated", estimates(found), Text(ESTIMATES), made["estimates"]),
        *((made["forces_over_slip"],) if "forces_over_slip" in made else ()),
        *titled("Against what was measured", truth(found), Text(TRUTH if found.truth else "")),
        *titled(
            "Does the filter know how wrong it is",
            made["innovations"], made["whiteness"], readings(found), Text(READINGS),
        ),
        *titled("How large noise is taken", noises(found), Text(NOISE)),
        *titled("Calibrated along", calibrated(found)),
        *titled("What went in", signals(found)),
        *_equations(found),
        *titled("Limits", Points((*found.sentences, BANDS, *_about_tuning(found), RANGE))),
    )  # fmt: skip
    about = f"{found.model}: {found.about}"
    return Document(f"Track of {found.data.name}", about, "a track", f"greybox-id {found.made.version}", parts)


def _about_tuning(found: Digest) -> tuple[str, ...]:
    made = found.made
    seconds = max(made.tuned_on, made.calibrated_on)
    if not seconds or not (found.calibrated or any(own.origin == "tuned" for own in found.noise.values())):
        return ()
    what = "Noise and parameters were" if found.calibrated else "Noise was"
    return (f"{what} tuned on the first {seconds:g} s: there innovations are smaller than they will be elsewhere.",)


def _equations(found: Digest) -> tuple[Part, ...]:
    model = must_be(MotionModel, build(found.model, found.settings, found.effects))
    walked, _ = walking(model, found.parameters, found.disturbances, EFFECTS)
    return titled("Equations of the model", *written_down(motion_equations(walked), EQUATIONS))
