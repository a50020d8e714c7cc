"""Section on the posterior in the report of a fit: a table of the draws, a corner plot, and bands of predictions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..base.numbers import interval, number, pretty_unit, signal_words
from ..datasets.recording import Recording
from ..fitting.fit import Fit
from ..fitting.posterior.posterior import Posterior
from ..fitting.posterior.predictive import PredictiveBand, predictive_band
from ..fitting.uncertainty.form import NOISE_ALONE
from .content import stretch_words
from .document import Drawing, Part, Points, Table, Text, titled
from .figures.estimates import corner
from .figures.sheet import BLUE, DASHED, MEASURED, Sheet, band, look, signal_label
from .recordings import Driven, shown_first, typical_stretch

MOST_DRAWN = 7
"""Most parameters in a corner plot: those whose mean is furthest from the fit, relative to the fit's sd."""
DRAWS = 500
"""Number of dots per pair."""
HEIGHT = 95.0
HOW = {
    "laplace": "from the fit's normal distribution, weighted by the posterior",
    "mcmc": "from the posterior, by Markov chains",
    "abc-smc": "of parameters whose simulation comes near the recordings, without a likelihood",
}


def posterior_parts(fit: Fit, posterior: Posterior, drives: Sequence[Driven]) -> tuple[Part, ...]:
    """Parts of the report of a fit.

    Parameters
    ----------
    fit : whose posterior it is.
    posterior : its draws.
    drives : recordings of the fit.

    Raises
    ------
    BadInput : if the posterior is of another fit or has no draws.
    """
    one = shown_first(drives)
    predictive = predictive_band(fit, posterior, one.recording)
    worst, least = posterior.worst
    r_hat = f" R-hat is at most {worst:.3f}." if np.isfinite(worst) else ""
    words = (
        f"{len(posterior)} draws {HOW[posterior.method]}.{r_hat} Their effective number (ESS) is at least {least:.0f}. "
        f"{NOISE_ALONE}"
    )
    cautions = posterior.cautions()
    return titled(
        "Posterior", _table(fit, posterior), Text(words), *([Points(tuple(cautions))] if cautions else []),
        _corner(fit, posterior), _bands(fit, predictive, one),
    )  # fmt: skip


def _table(fit: Fit, posterior: Posterior) -> Table:
    body, rows = [], posterior.table
    for coordinate in posterior.coordinates:
        row = {name: float(rows[name].loc[coordinate.name]) for name in rows if name != "unit"}
        single = coordinate.run is None and fit.model[coordinate.parameter].shape == ()
        fit_sd = float(fit.sd[coordinate.parameter]) if single else np.nan
        estimate = float(fit.model[coordinate.parameter].array) if single else np.nan
        body.append((
            coordinate.name, number(row["mean"]), number(row["sd"]), interval(row["low"], row["high"], row["sd"]),
            interval(row["low_noise_alone"], row["high_noise_alone"], row["sd_noise_alone"]),
            pretty_unit(coordinate.unit), number(estimate) if single else "–", number(fit_sd) if single else "–",
            f"{row['r_hat']:.3f}" if np.isfinite(row["r_hat"]) else "–", f"{row['ess']:.0f}",
        ))  # fmt: skip
    head = ("parameter", "mean", "sd", "95 % interval", "95 %, noise alone", "unit", "fit", "fit's sd", "R-hat", "ESS")
    return Table(head, tuple(body), "lrrrrlrrrr")


def _corner(fit: Fit, posterior: Posterior) -> Drawing:
    names = list(posterior.names)
    if len(names) > MOST_DRAWN:
        shift = {
            coordinate.name: abs(
                posterior.table["mean"][coordinate.name] - float(fit.model[coordinate.parameter].array)
            )
            / float(fit.sd[coordinate.parameter])
            for coordinate in posterior.coordinates
            if coordinate.run is None
            and fit.model[coordinate.parameter].shape == ()
            and float(fit.sd[coordinate.parameter]) > 0
        }
        most_shifted = sorted(shift, key=lambda name: -shift[name])[:MOST_DRAWN] or names[:MOST_DRAWN]
        names = [name for name in names if name in most_shifted]
    columns = [posterior.names.index(name) for name in names]
    widened, alone = (
        posterior.chosen(min(len(posterior), DRAWS), noise_alone=noise)[:, columns] for noise in (False, True)
    )
    omitted = len(posterior.names) - len(names)
    more = f" The {omitted} parameters whose mean is nearest to the fit are not shown." if omitted else ""
    return Drawing(
        "corner", corner(widened, alone, names, [posterior.coordinates[k].unit for k in columns]),
        "Draws of the posterior: each parameter on the diagonal, pairs below. They show curved or long shapes, which "
        f"standard deviations do not.{more}",
        "Histograms of the parameters, and scatter plots of their pairs.",
    )  # fmt: skip


def _bands(fit: Fit, predictive: PredictiveBand, one: Driven) -> Drawing:
    coverage = predictive.coverage()
    shares = ", ".join(
        f"{100 * share:.1f} % of {signal_words(name)}"
        for name, share in zip(fit.model.outputs, coverage, strict=True)
        if np.isfinite(share)
    )
    where, seconds = stretch_words(one)
    return Drawing(
        "bands", bands(fit, predictive, one.recording, typical_stretch(one)),
        f"Free run of {predictive.draws} draws over {seconds} of {where}: the mean, and a band in which "
        f"{100 * predictive.level:g} % of the readings are expected. The band follows from the spread of the draws and "
        f"of the fit's residuals. In the whole recording, the band holds {shares}.",
        "Measured signals with the band of predictions.",
    )  # fmt: skip


def bands(fit: Fit, result: PredictiveBand, recording: Recording, stretch: tuple[int, int]) -> Sheet:
    """Every recorded output over a stretch, with the mean of the draws and the band for measurements."""
    drawn = [k for k, name in enumerate(fit.model.outputs) if name in recording]
    sheet = Sheet((HEIGHT,) * len(drawn), joined=True)
    start, stop = stretch
    inside = (result.mean.rows >= start) & (result.mean.rows < stop)
    at = recording.time[result.mean.rows[inside]]
    for ax, k in zip(sheet.grid[:, 0], drawn, strict=True):
        name = fit.model.outputs[k]
        band(ax, at, result.low[inside, k], result.high[inside, k], label=f"{100 * result.level:g} % band")
        ax.plot(recording.time[start:stop], recording[name][start:stop], **MEASURED)
        ax.plot(at, result.mean.predicted[inside, k], **look(BLUE, 1.0, "mean of draws", dashes=DASHED))
        ax.set_ylabel(signal_label(recording, name))
    sheet.grid[-1, 0].set(xlabel="time [s]", xlim=recording.time[[start, stop - 1]])
    return sheet
