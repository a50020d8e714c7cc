"""A posterior: weighted draws of a fit's parameters, how they were made, and how reliable they are.

Stored as Parquet: one row per draw, columns `chain`, `draw`, `weight`, a measure of the draw (`log_posterior`, for
abc-smc `distance`), then the parameters; common data, and the state of an interrupted run, are the schema's metadata.
Numbers and text only; nothing in such a file is executed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np
import pandas as pd

from ...base.declared import of_plain
from ...base.errors import BadInput
from ...base.files import replacing, write_atomically
from ...base.guard import protect
from ...base.json_data import checksum, plain
from ...base.numbers import between, pretty_unit
from ...base.shorthands import Array
from ...base.version import __version__
from ...models.parameter import placed
from ..fit import Fit
from ..saved_fit import Build, load
from .density import DrawnNumber, entry_names
from .laplace import trusted

FEWEST = 4
"""Smallest length of a chain that is diagnosed."""


def r_hat(chains: Array) -> float:
    """Rank-normalised split R-hat of one parameter, the larger of that of the draws and of the folded ones.

    Parameters
    ----------
    chains : (chains, draws).

    Returns
    -------
    1 if chains have converged; NaN if they are shorter than four draws or do not move.

    Notes
    -----
    ArviZ computes it: Vehtari et al., Rank-Normalization, Folding, and Localization, Bayesian Analysis 16(2), 2021.
    """
    return _diagnosed("rhat", chains)


def effective_sample_size(chains: Array) -> float:
    """Number of independent draws equivalent for a parameter's centre (bulk), from (chains, draws); NaN as `r_hat`."""
    return _diagnosed("ess", chains)


def _diagnosed(name: str, chains: Array) -> float:
    if chains.size == 0 or chains.shape[1] < FEWEST or np.ptp(chains) == 0:
        return float("nan")
    from arviz_stats.base.array import array_stats  # imported here: it takes long

    with np.errstate(invalid="ignore", divide="ignore"):  # constant chains
        return float(getattr(array_stats, name)(chains, chain_axis=0, draw_axis=1))


def weighted_quantile(values: Array, weight: Array, share: float) -> float:
    """The value below which a share of the weight lies, from (n,) values and weights, by linear interpolation."""
    if len(values) == 0:
        return float("nan")
    order = np.argsort(values, kind="stable")
    share_of_weight = weight[order] / np.sum(weight)
    return float(np.interp(share, np.cumsum(share_of_weight) - 0.5 * share_of_weight, values[order]))


Method = Literal["laplace", "mcmc", "abc-smc"]
METADATA, SOURCE, NOISE_ALONE = b"greybox-posterior", b"greybox-fit", b"greybox-noise-alone"
VERSION, WITHOUT_FORM = 3, 2
"""Version of the format; an earlier one that is read, whose draws are those of the likelihood alone."""
LEVEL = 0.95
"""Probability of the intervals `low` to `high`."""
MET, FEW = 1.05, 100.0
"""R-hat above which chains have not converged (1.01 is strict, 1.1 lax); effective sample size below which ends of
intervals are noise."""
OF_DRAWS = ("chain", "draw", "weight")


@dataclass(frozen=True, repr=False)
class Posterior:
    """Draws of the free parameters of a fit, as `gb.sample` returns them.

    Attributes
    ----------
    method : "laplace", "mcmc" or "abc-smc".
    coordinates : the drawn scalars, in the order of `values`.
    values : (draws, d) in SI units, widened to the fit's intervals, which include the model-form error; for abc-smc as
        drawn.
    noise_alone : (draws, d) the same draws from the likelihood itself, without the model-form error.
    weight : (draws,) sums to one.
    chain, draw : (draws,) chain (for mcmc a walker) of each draw, and its number in the chain.
    measure : (draws,) log_posterior of `noise_alone`, up to a constant; for abc-smc the distance.
    acceptance : share of proposals that were accepted, for abc-smc in the last population.
    evaluations : number of simulations of all recordings.
    cpu_seconds : CPU time, s.
    seed : seed of all random numbers.
    complete : whether all requested draws were made.
    fit : identification of its fit: model, parameters' values, hashes of recordings (`identity`).
    options : further options of the method.
    state : state from which an unfinished run continues.
    source : text of the fit's file, so that draws can be simulated without another file.
    pareto_k : for laplace, shape of the tail of the draws' weights; NaN if unknown.
    with_form : whether `values` include the model-form error; not for abc-smc, nor in files of earlier versions.
    """

    method: Method
    coordinates: tuple[DrawnNumber, ...]
    values: Array
    noise_alone: Array
    weight: Array
    chain: Array
    draw: Array
    measure: Array
    acceptance: float
    evaluations: int
    cpu_seconds: float
    seed: int
    complete: bool
    fit: Mapping[str, Any]
    options: Mapping[str, Any] = field(default_factory=dict)
    state: Mapping[str, Any] = field(default_factory=dict)
    source: str = field(default="", repr=False)
    pareto_k: float = float("nan")
    with_form: bool = True

    @property
    def weighted(self) -> bool:
        """Whether draws have weights; otherwise they are chains of successive draws."""
        return self.method != "mcmc"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters' columns."""
        return tuple(coordinate.name for coordinate in self.coordinates)

    def __len__(self) -> int:
        return len(self.values)

    @property
    def frame(self) -> pd.DataFrame:
        """One row per draw: `chain`, `draw`, `weight`, `log_posterior` or `distance`, then the parameters in SI."""
        of_draws = {"chain": self.chain.astype(int), "draw": self.draw.astype(int), "weight": self.weight}
        of_parameters = {name: self.values[:, k] for k, name in enumerate(self.names)}
        return pd.DataFrame({**of_draws, self.measured: self.measure, **of_parameters})

    @property
    def measured(self) -> str:
        """Name of `measure`."""
        return "distance" if self.method == "abc-smc" else "log_posterior"

    @cached_property
    def r_hat(self) -> pd.Series[float]:
        """Rank-normalised split R-hat by name: 1 if chains have converged; NaN without chains."""
        return self._by_name(lambda chains: r_hat(chains))

    @cached_property
    def ess(self) -> pd.Series[float]:
        """Effective sample size by name: of chains by autocorrelation, of weighted draws 1 / sum of squared weights."""
        if self.weighted:
            effective_size = 1.0 / float(np.sum(self.weight**2)) if len(self) else float("nan")
            return pd.Series(effective_size, index=list(self.names), dtype=float)
        return self._by_name(effective_sample_size)

    @cached_property
    def table(self) -> pd.DataFrame:
        """By name: `mean`, `sd`, `low` and `high` (95 %), `unit`, `r_hat`, `ess`; for the likelihood alone
        `sd_noise_alone`, `low_noise_alone` and `high_noise_alone`.
        """
        widened, noise = self._described(self.values), self._described(self.noise_alone)
        diagnostics = {
            "unit": [coordinate.unit for coordinate in self.coordinates],
            "r_hat": self.r_hat,
            "ess": self.ess,
        }
        of_noise = {f"{name}_noise_alone": noise[name] for name in ("sd", "low", "high")}
        return pd.DataFrame({**widened, **diagnostics, **of_noise}, index=list(self.names))

    def _described(self, values: Array) -> dict[str, Array]:
        """Mean, standard deviation and ends of intervals of each parameter."""
        mean = self.weight @ values if len(self) else np.full(len(self.names), np.nan)
        sd = np.sqrt(self.weight @ (values - mean) ** 2) if len(self) else mean
        shares = {"low": (1 - LEVEL) / 2, "high": (1 + LEVEL) / 2}
        ends = {
            k: np.array([weighted_quantile(v, self.weight, share) for v in values.T]) for k, share in shares.items()
        }
        return {"mean": mean, "sd": sd, **ends}

    @property
    def worst(self) -> tuple[float, float]:
        """The largest R-hat and the smallest effective sample size of any parameter; NaN if unknown."""
        return float(self.r_hat.max()), float(self.ess.min())

    def cautions(self) -> list[str]:
        """Sentences on limits of these draws; empty if there are none."""
        result = []
        worst, least = self.worst
        if not self.with_form:
            again = "" if self.method == "abc-smc" else " Sample again to include it."
            result.append(
                f"Unlike the intervals of the fit, these intervals do not include the error of the equations.{again}"
            )
        if not self.complete:
            on = "" if self.method == "laplace" else " and it continues"
            result.append(f"The run was interrupted: call it again with the same arguments{on}.")
        if self.pareto_k > trusted(len(self)):
            result.append(
                "The posterior differs too much from the fit's normal distribution to be corrected by importance "
                "weights (Pareto k "
                f"{self.pareto_k:.2f}): the draws are those of the normal distribution itself. Use mcmc."
            )
        if worst > MET:
            name = str(self.r_hat.idxmax())
            result.append(
                f"The chains have not converged: R-hat of {name} is {worst:.2f}. Take more draws, or thin them more."
            )
        if least < FEW:
            name = str(self.ess.idxmin())
            result.append(
                f"The draws of {name} count as only {least:.0f} independent draws (ESS), too few for an interval. "
                "Draw more."
            )
        return result

    def covariance(self) -> Array:
        """(d, d) covariance of the draws."""
        off = self.values - self.weight @ self.values
        return np.asarray((off * self.weight[:, None]).T @ off)

    def priors(self) -> dict[str, tuple[float, float]]:
        """Name -> (mean, sd) of scalar parameters, for `gb.fit(prior=...)`; correlations are lost."""
        single = [
            coordinate for coordinate in self.coordinates if coordinate.run is None and "[" not in coordinate.name
        ]
        return {
            item.name: (float(self.table["mean"][item.name]), float(self.table["sd"][item.name])) for item in single
        }

    def chosen(self, count: int, seed: int = 0, *, noise_alone: bool = False) -> Array:
        """(count, d) draws that represent all, by systematic resampling in proportion to the weights."""
        at = (np.random.default_rng((seed, 7919)).uniform() + np.arange(count)) / count
        order = np.random.default_rng((self.seed, 104729)).permutation(len(self))  # neighbours in a chain correlate
        places = np.searchsorted(np.cumsum(self.weight[order]) / np.sum(self.weight), at)
        values = self.noise_alone if noise_alone else self.values
        return np.asarray(values[order[np.minimum(places, len(self) - 1)]])

    def vectors(self, fit: Fit, draws: Array) -> Array:
        """Parameter vectors of a fit's model, (n, parameters), from draws (n, d); run-scoped ones at their mean."""
        start = {parameter.name: place.start for parameter, place in placed(fit.model.parameters)}
        result = np.tile(fit.model.values, (len(draws), 1))
        several: dict[int, list[int]] = {}
        for k, coordinate in enumerate(self.coordinates):
            several.setdefault(start[coordinate.parameter] + coordinate.entry, []).append(k)
        for at, columns in several.items():
            result[:, at] = np.mean(draws[:, columns], axis=1)
        return result

    def its_fit(self, build: Build) -> Fit:
        """The fit that it was drawn from. Raises `BadInput` if its equations are not available."""
        with TemporaryDirectory() as folder:
            return load(write_atomically(Path(folder) / "the fit of the posterior", self.source), build)

    def must_be_of(self, fit: Fit) -> None:
        """Raise `BadInput` if these are draws of another fit."""
        if dict(self.fit) != identity(fit):
            raise BadInput(
                f"The posterior was drawn from another fit ({self.fit.get('model', 'unknown')}), not from this one of "
                f"{fit.model.name}. Name the fit from which it was drawn, or sample again."
            )

    def to_arviz(self) -> dict[str, dict[str, Array]]:
        """Groups for `arviz.from_dict(**posterior.to_arviz())`: arrays of shape (chains, draws).

        Weighted draws are resampled to equal weights and make one chain. ArviZ itself is not needed.
        """
        if self.weighted:
            draws = self.chosen(len(self))
            return {"posterior": {name: draws[None, :, k] for k, name in enumerate(self.names)}}
        return {
            "posterior": {name: self._chains(self.values[:, k]) for k, name in enumerate(self.names)},
            "sample_stats": {"lp": self._chains(self.measure)},
        }

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as `greybox sample --json` prints it."""
        table = self.table
        return {
            "method": self.method,
            "model": self.fit.get("model"),
            "draws": len(self),
            "complete": self.complete,
            "acceptance": self.acceptance,
            "r_hat": self.worst[0],
            "ess": self.worst[1],
            "pareto_k": self.pareto_k,
            "evaluations": self.evaluations,
            "cpu_seconds": self.cpu_seconds,
            "seed": self.seed,
            "level": LEVEL,
            "parameters": {str(name): row for name, row in table.to_dict("index").items()},
            "cautions": self.cautions(),
        }

    def save(self, path: str | Path) -> Path:
        """Write the posterior as Parquet, atomically."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        head = plain(
            {
                "version": VERSION, "greybox_id": __version__, "method": self.method, "seed": self.seed,
                "acceptance": self.acceptance, "evaluations": self.evaluations, "cpu_seconds": self.cpu_seconds,
                "complete": self.complete, "fit": self.fit, "options": self.options, "state": self.state,
                "pareto_k": self.pareto_k, "with_form": self.with_form,
                "coordinates": [vars(coordinate) for coordinate in self.coordinates],
            }
        )  # fmt: skip
        head["checksum"] = checksum(head)
        table = pa.Table.from_pandas(self.frame, preserve_index=False)
        noise = np.ascontiguousarray(self.noise_alone, dtype="<f8").tobytes()  # its columns would pass for parameters
        metadata = {METADATA: json.dumps(head).encode(), SOURCE: self.source.encode(), NOISE_ALONE: noise}
        table = table.replace_schema_metadata({**(table.schema.metadata or {}), **metadata})
        target = Path(path)
        with replacing(target) as beside:
            pq.write_table(table, beside)
        return target

    def __repr__(self) -> str:
        first = (
            f"Posterior of {self.fit.get('model')} by {self.method}: {len(self)} draws of {len(self.names)} parameters"
        )
        lines = [
            f"  {name} = {between(row['mean'], row['low'], row['high'])} {pretty_unit(row['unit'])}"
            for name, row in self.table.head(6).iterrows()
        ]
        return "\n".join([first, *lines, *(f"  {caution}" for caution in self.cautions())])

    def _chains(self, values: Array) -> Array:
        """(chains, draws) of one column, cut to the shortest chain."""
        order = np.lexsort((self.draw, self.chain))
        lengths = np.unique(self.chain, return_counts=True)[1]
        if len(lengths) == 0:
            return np.empty((0, 0))
        edges = np.concatenate(([0], np.cumsum(lengths)))
        shortest = int(np.min(lengths))
        return np.array([values[order[edge : edge + shortest]] for edge in edges[:-1]])

    def _by_name(self, known: Any) -> pd.Series[float]:
        if self.weighted:
            return pd.Series(np.nan, index=list(self.names), dtype=float)
        return pd.Series([known(self._chains(item)) for item in self.values.T], index=list(self.names), dtype=float)


def identity(fit: Fit) -> dict[str, Any]:
    """Identification of a fit: its model, its parameters' values, and its training recordings."""
    body = fit.as_dict()
    content = {"model": body["model"], "parameters": body["parameters"], "how": body["how"], "per_run": body["per_run"]}
    return {
        "model": fit.model.name,
        "sha256": str(checksum(plain(content))),
        "recordings": [record.sha256 for record in fit.data if record.role == "train"],
    }


def load_posterior(path: str | Path, *, going_on: bool = False) -> Posterior:
    """Read a posterior written by `Posterior.save` or `greybox sample`.

    Parameters
    ----------
    path : the file.
    going_on : whether the file will be replaced by a continued run.

    Raises
    ------
    BadInput : the file does not exist, is something else, is damaged, or was written by another version.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = Path(path)
    if not file.is_file():
        raise BadInput(f"{file} is not there; make a posterior with greybox sample.")
    if not going_on:
        protect(file)
    try:
        table = pq.read_table(file)
        metadata = table.schema.metadata or {}
        head, source = json.loads(metadata[METADATA]), metadata.get(SOURCE, b"").decode()
    except (pa.ArrowException, OSError, ValueError, KeyError, RecursionError) as error:
        raise BadInput(
            f"{file} is not a posterior of greybox-id, or is damaged; make one with greybox sample."
        ) from error
    try:
        if head["version"] not in (VERSION, WITHOUT_FORM):
            raise BadInput(f"{file} has format version {head['version']!r:.20}, not {VERSION}. Sample again.")
        if head.pop("checksum", None) != checksum(head):
            raise ValueError("its metadata do not match their checksum")
        return replace(_sound(head, table.to_pandas(), metadata.get(NOISE_ALONE)), source=source)
    except (LookupError, ArithmeticError, TypeError, ValueError, AttributeError) as error:
        raise BadInput(f"{file} is damaged: {error}. Restore it, or sample again.") from error


def _sound(head: Mapping[str, Any], frame: pd.DataFrame, noise: bytes | None) -> Posterior:
    """The posterior, if its content is reliable. Raises `TypeError` or `ValueError` otherwise."""
    drawn = of_plain(tuple[DrawnNumber, ...], head["coordinates"], "coordinates")
    names = [item.name for item in drawn]
    measured = "distance" if head["method"] == "abc-smc" else "log_posterior"
    if head["method"] not in ("laplace", "mcmc", "abc-smc") or list(frame) != [*OF_DRAWS, measured, *names]:
        raise ValueError("its columns are not those of its parameters")
    values = np.ascontiguousarray(frame[names].to_numpy(dtype=float))  # the order in memory affects sums
    earlier = head["version"] == WITHOUT_FORM
    if noise is None and not earlier:
        raise ValueError("it lacks the draws of the noise alone")
    noise_alone = values if noise is None else np.frombuffer(noise, dtype="<f8").reshape(values.shape).astype(float)
    weight = frame["weight"].to_numpy(dtype=float)
    if not (np.all(np.isfinite([values, noise_alone])) and np.all(np.isfinite(weight)) and np.all(weight >= 0)):
        raise ValueError("it has draws or weights that are not numbers")
    if len(weight) and not np.isclose(np.sum(weight), 1.0):
        raise ValueError("its weights do not sum to one")
    return Posterior(
        method=head["method"], coordinates=drawn, values=values, noise_alone=noise_alone, weight=weight,
        chain=frame["chain"].to_numpy(dtype=float), draw=frame["draw"].to_numpy(dtype=float),
        measure=frame[measured].to_numpy(dtype=float), acceptance=float(head["acceptance"]),
        evaluations=int(head["evaluations"]), cpu_seconds=float(head["cpu_seconds"]), seed=int(head["seed"]),
        complete=bool(head["complete"]), fit=head["fit"], options=head["options"], state=head["state"],
        pareto_k=float("nan") if head.get("pareto_k") is None else float(head["pareto_k"]),
        with_form=not earlier and bool(head["with_form"]),
    )  # fmt: skip


def must_name(fit: Fit, posterior: Posterior) -> None:
    """Raise `BadInput` if a posterior draws parameters that a fit's model does not have."""
    for coordinate in posterior.coordinates:
        if coordinate.parameter not in fit.model or coordinate.entry >= len(
            entry_names(fit.model[coordinate.parameter])
        ):
            raise BadInput(f"The posterior draws {coordinate.name}, which {fit.model.name} does not have.")
