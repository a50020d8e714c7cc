"""Draws from the posterior of a fit's parameters, and their predictions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from rich.console import RenderableType

from ..base.declared import understood
from ..base.errors import BadInput
from ..base.files import ensure_writable
from ..base.guard import claim, content_of
from ..base.numbers import interval, number, pretty_unit
from ..datasets.formats import needed
from ..datasets.recording import Recording
from ..fitting.fit import Fit
from ..fitting.how import Say, quiet
from ..fitting.posterior.abc_smc import Distance
from ..fitting.posterior.posterior import Method, Posterior, load_posterior
from ..fitting.posterior.predictive import banded_table, predictive_band
from ..fitting.posterior.verb import SampleOptions, must_suit_sampling
from ..fitting.posterior.verb import sample as sample_fit
from ..fitting.requested_model import must_be_recorded
from ..fitting.uncertainty.form import NOISE_ALONE
from ..reports.figures.estimates import corner
from ..reports.recordings import matched
from ..reports.text.screen import as_text, plain_table
from . import given
from .given import Columns, Recordings
from .predictions import must_be_horizon
from .profiles import trained

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WORDS = "a posterior"
"""Kind of file, for messages."""
MOST_SHOWN = 12
"""Most parameters in a corner plot unless they are named."""


@dataclass(frozen=True, repr=False)
class PosteriorResult(Posterior):
    """Draws from the posterior of a fit's parameters: result of `gb.sample`.

    Attributes of the base class (`frame`, `table`, `r_hat`, `ess`, `weight` ...) are documented at
    `greybox_id.fitting.posterior.posterior.Posterior`.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 400)
    >>> fit = gb.fit("kinematic", lap, vehicle="roboracer")
    >>> found = gb.sample(fit, method="laplace", draws=1000)
    >>> found.frame.columns.tolist()[:5]
    ['chain', 'draw', 'weight', 'log_posterior', 'l_f']
    >>> low, high = found.table.loc["yaw_lag", ["low", "high"]]
    >>> bool(low < fit.params["yaw_lag"] < high)
    True
    """

    @classmethod
    def of(cls, posterior: Posterior) -> PosteriorResult:
        """Wrap a posterior."""
        return cls(**{field.name: getattr(posterior, field.name) for field in fields(Posterior)})

    @classmethod
    def load(cls, path: str | Path) -> PosteriorResult:
        """Read a posterior written by `save` or `greybox sample`. Raises `BadInput` if the file is not one."""
        return cls.of(load_posterior(path))

    def parts(self) -> Iterator[RenderableType]:
        """The text of the posterior, part by part."""
        if not len(self):
            yield "no draws yet"
            return
        worst, least = self.worst
        met = f", R-hat at most {worst:.3f}" if np.isfinite(worst) else ""
        yield (
            f"sampled  {len(self)} draws of {self.fit.get('model')} by {self.method}, {100 * self.acceptance:.3g} % "
            f"accepted{met}, effective number of draws (ESS) at least {least:.0f}; {self.cpu_seconds:.1f} CPU s\n"
        )
        head = ("parameter", "mean", "sd", "95 % interval", "95 %, noise alone", "unit", "R-hat", "ESS")
        table = plain_table(*head)
        for name, row in self.table.iterrows():
            table.add_row(
                str(name), number(row["mean"]), number(row["sd"]), interval(row["low"], row["high"], row["sd"]),
                interval(row["low_noise_alone"], row["high_noise_alone"], row["sd_noise_alone"]),
                pretty_unit(row["unit"]), f"{row['r_hat']:.3f}" if np.isfinite(row["r_hat"]) else "–",
                f"{row['ess']:.0f}",
            )  # fmt: skip
        yield table
        yield f"\n{NOISE_ALONE}"
        for sentence in self.cautions():
            yield f"\n{sentence}"

    def summary(self) -> str:
        """The text that `greybox sample` prints."""
        return as_text(self.parts())

    def bands(
        self,
        fit: Fit,
        recording: Recording | str | Path,
        horizon: float | None = None,
        *,
        level: float = 0.95,
        columns: Columns = "canonical",
    ) -> pd.DataFrame:
        """Predictions of a recording by the draws: the mean over 200 of them, and a band for measurements.

        Parameters
        ----------
        fit : whose posterior it is.
        recording : inputs and, if measured, outputs.
        horizon : s ahead of the readings of every row; None for the free run.
        level : share of measurements expected within the band, which includes the spread of parameters and residuals.
        columns : column map for a file.

        Returns
        -------
        pandas.DataFrame
            `time` [s], `run`, and by output measurements, `_predicted`, `_predicted_low`, `_predicted_high` in SI
            units.

        Raises
        ------
        BadInput : if the posterior is of another fit, or a signal is missing.
        """
        must_be_horizon(horizon)
        given.must_be_share(level, "level")
        read = given.one_recording(recording, columns)
        must_be_recorded(fit.model, [read])
        return banded_table(fit.model, read, predictive_band(fit, self, read, horizon, level=level))

    def corner(self, names: Sequence[str] | None = None) -> Figure:
        """Corner plot: histograms of parameters on the diagonal, scatter plots of pairs below.

        Parameters
        ----------
        names : columns to show; the first twelve by default.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        BadInput : if there is no such column.
        """
        chosen = list(self.names[:MOST_SHOWN] if names is None else names)
        for name in chosen:
            if name not in self.names:
                raise BadInput(f"names: the posterior has no {name!r}; it has {', '.join(self.names)}.")
        columns = [self.names.index(name) for name in chosen]
        count = min(max(len(self), 1000), 5000)
        widened, alone = (self.chosen(count, noise_alone=noise)[:, columns] for noise in (False, True))
        result = corner(widened, alone, chosen, [self.coordinates[k].unit for k in columns])
        result.lay_out()
        return result


@understood
def sample(
    fit: Fit,
    recordings: Recordings | None = None,
    *,
    method: Method = "mcmc",
    draws: int = 2000,
    seed: int = 0,
    distance: Distance = "pooled",
    out: str | Path | None = None,
    columns: Columns = "canonical",
    progress: Callable[..., None] | None = None,
) -> PosteriorResult:
    """Draw from the posterior of a fit's free parameters.

    Parameters
    ----------
    fit : of equations of motion.
    recordings : training recordings; a fit from `gb.fit` or `gb.load` has them.
    method : "mcmc" draws from the likelihood and the priors of the fit (needs the extra `sample`); "laplace" from the
        fit's normal distribution, with weights of the same posterior; "abc-smc" without a likelihood, by distances.
    draws : number of draws; of "abc-smc", number of particles.
    seed : of random numbers.
    distance : for "abc-smc", "pooled" over all rows or "trajectories", the mean over those.
    out : a .parquet file in which intermediate results are kept; a call with the same arguments continues from it.
    columns : column map for files.
    progress : called with each line of progress.

    Returns
    -------
    Posterior
        `frame` (a row per draw), `table` (mean, sd and 95 % interval by parameter, with model error like the fit's
        intervals, and for noise alone), `noise_alone` (the draws without model error), `r_hat`, `ess`, `summary()`,
        `corner()`, `priors()`, `to_arviz()`, `save(path)`. Ctrl-C keeps the draws so far, with `complete` false.

    Raises
    ------
    BadInput : if the fit is of a network, a recording is not the one that was fitted (by hash), its parameters are not
        identifiable, or emcee is not installed.

    Examples
    --------
    >>> import greybox_id as gb
    >>> lap = gb.read(gb.datasets.shipped("racer_train"), columns="roboracer").rows(0, 400)
    >>> fit = gb.fit("kinematic", lap, vehicle="roboracer")
    >>> found = gb.sample(fit, draws=640)
    >>> len(found), bool(found.r_hat.max() < 1.1)
    (640, True)
    """
    if not isinstance(fit, Fit):
        raise BadInput(f"fit: a fit is needed, as gb.fit and gb.load return it, not {fit!r:.60}.")
    options = SampleOptions(method, draws, seed, distance)
    must_suit_sampling(fit)
    read = given.seen_by(fit, recordings, columns)
    return sampled(fit, read, options, None if out is None else posterior_target(out), progress or quiet)


def posterior_target(out: str | Path) -> Path:
    """The file for a posterior. Raises `BadInput` for another kind of file."""
    target = Path(out)
    if target.suffix != ".parquet":
        raise BadInput(
            f"{out}: a posterior is saved as a .parquet file, so that a later run can continue from it; "
            "name such a file (‹out›)."
        )
    claim(target, becomes=WORDS)
    ensure_writable(target.parent)
    return target


def sampled(
    fit: Fit, recordings: Sequence[Recording], options: SampleOptions, target: Path | None, say: Say
) -> PosteriorResult:
    """Draws, saved to a file meanwhile; an earlier run with the same arguments in that file is continued."""
    if options.method == "mcmc":
        needed("emcee", "sample", "mcmc", "what emcee samples")
    read = matched(trained(fit), recordings)
    ours = target is not None and target.is_file() and content_of(target).words == WORDS
    begun = load_posterior(target, going_on=True) if target is not None and ours else None

    def keep(posterior: Posterior) -> None:
        if target is not None:
            posterior.save(target)

    result = sample_fit(fit, read, options, begun=begun, keep=keep, say=say)
    keep(result)
    return PosteriorResult.of(result)
