"""Draws of the posterior of a fit's parameters, and what they predict."""

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
"""What its file is, in sentences."""
MOST_SHOWN = 12
"""Parameters that a corner plot shows unless they are named."""


@dataclass(frozen=True, repr=False)
class PosteriorResult(Posterior):
    """Draws of the posterior of a fit's parameters, as `gb.sample` returns them.

    What it is as a record (`frame`, `table`, `r_hat`, `ess`, `weight` ...) is documented at
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
        """A posterior with what it can do."""
        return cls(**{field.name: getattr(posterior, field.name) for field in fields(Posterior)})

    @classmethod
    def load(cls, path: str | Path) -> PosteriorResult:
        """Read a posterior that `save` or `greybox sample` wrote. Raises `BadInput` where the file is none."""
        return cls.of(load_posterior(path))

    def parts(self) -> Iterator[RenderableType]:
        """What it says, part by part."""
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
        """What `greybox sample` prints."""
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
        """What the draws predict of a recording: the mean over 200 of them, and a band of readings.

        Parameters
        ----------
        fit : whose posterior it is.
        recording : inputs and, where they are read, outputs.
        horizon : s ahead of the readings of every row; None for the free run.
        level : share of readings expected within the band: parameters' spread and the residuals' spread together.
        columns : column map, where a file is named.

        Returns
        -------
        pandas.DataFrame
            `time` [s], `run`, and by output readings, `_predicted`, `_predicted_low`, `_predicted_high` in SI units.

        Raises
        ------
        BadInput : the posterior is of another fit, or a signal is missing.
        """
        must_be_horizon(horizon)
        given.must_be_share(level, "level")
        value = given.one_recording(recording, columns)
        must_be_recorded(fit.model, [value])
        return banded_table(fit.model, value, predictive_band(fit, self, value, horizon, level=level))

    def corner(self, names: Sequence[str] | None = None) -> Figure:
        """Corner plot: histograms of parameters on the diagonal, every pair of them below.

        Parameters
        ----------
        names : columns to show; the first twelve unless given.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        BadInput : there is no such column.
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
    recordings : those it was fitted to; a fit that `gb.fit` or `gb.load` returned knows them.
    method : "mcmc" draws from the likelihood and the priors that the fit counted (needs the extra `sample`); "laplace"
        near the fit's normal distribution, weighted by the same; "abc-smc" by distances alone.
    draws : how many; of "abc-smc" particles.
    seed : of everything random.
    distance : of "abc-smc", "pooled" over all rows or "trajectories", the mean of each one's.
    out : a .parquet file in which the run is kept meanwhile; called again with the same arguments it goes on there.
    columns : column map, where files are named.
    progress : called with one line at a time.

    Returns
    -------
    Posterior
        `frame` (a row a draw), `table` (mean, sd and 95 % interval by parameter, with the error of the model's form as
        in the fit's intervals, and of the noise alone), `noise_alone` (the draws without that error), `r_hat`, `ess`,
        `summary()`, `corner()`, `priors()`, `to_arviz()`, `save(path)`. Ctrl-C leaves what there is, `complete` false.

    Raises
    ------
    BadInput : the fit is of a network, a recording is not the one that was fitted (hashes are compared), its parameters
        are not determined, or emcee is not installed.

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
    """Where a posterior is to be written. Raises `BadInput` for another kind of file."""
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
    """Draws, kept in a file meanwhile, and gone on with where that holds an earlier run of the same."""
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
