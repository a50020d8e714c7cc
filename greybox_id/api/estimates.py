"""Estimates of a fit by name as pandas objects, and the recordings that it was made from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ..base.condition import span
from ..base.errors import BadInput
from ..base.numbers import counted
from ..base.shorthands import Array
from ..datasets.read import read
from ..datasets.recording import Recording
from ..export.equations import entries
from ..fitting.fit import Fit, reach
from ..fitting.holding import as_seen
from ..fitting.provenance import DataRecord
from ..models.parameter import free_places
from ..reports.recordings import matched
from . import given
from .given import Columns


@dataclass(frozen=True, repr=False)
class NamedEstimates(Fit):
    """A fit with its estimates by name.

    Attributes
    ----------
    recordings : training and validation recordings, in the order of `data`, if available.
    file : from which it was loaded; None if it was not.
    """

    recordings: tuple[Recording, ...] = field(default=(), compare=False)
    file: Path | None = field(default=None, compare=False)

    @property
    def params(self) -> pd.Series[float]:
        """Estimates by name in SI units, entries of arrays as F[0,1]; fixed parameters with their value."""
        return self._by_name({p.name: p.array for p in self.model.parameters}, "estimate")

    @property
    def stderr(self) -> pd.Series[float]:
        """Standard errors by name, corrected for correlated residuals; NaN if a parameter was fixed or has none."""
        sd = {p.name: np.nan if p.fixed else self.sd.get(p.name, np.nan) for p in self.model.parameters}
        return self._by_name(sd, "stderr")

    @property
    def cov(self) -> pd.DataFrame:
        """Covariance of the estimated scalar parameters, by name on both axes, in products of their SI units.

        Raises
        ------
        BadInput : if it was not kept, as for the weights of networks.
        """
        if self.covariance is None:
            raise BadInput(f"The fit of {self.model.name} keeps no covariance, only standard errors of its weights.")
        free = free_places(self.model.parameters)
        places = [*free.values()]
        return pd.DataFrame(self.covariance[np.ix_(places, places)], [*free], [*free])

    @property
    def corr(self) -> pd.DataFrame:
        """Correlations of the estimates, by name on both axes. Raises `BadInput` as `cov`."""
        cov = self.cov
        sd = np.sqrt(np.diag(cov))
        with np.errstate(divide="ignore", invalid="ignore"):
            return pd.DataFrame(cov.to_numpy() / np.outer(sd, sd), cov.index, cov.columns)

    def conf_int(self, level: float = 0.95) -> pd.DataFrame:
        """Confidence intervals by name, columns `lower` and `upper`, in SI units, limited to the parameters' bounds.

        Parameters
        ----------
        level : between 0 and 1. Intervals use Student's t with the degrees of freedom of the standard errors.

        Raises
        ------
        BadInput : if `level` is not a probability.
        """
        given.must_be_share(level, "level")
        lower, upper = {}, {}
        for p in self.model.parameters:
            sd = np.full(p.shape, np.nan) if p.fixed else np.asarray(self.sd.get(p.name, np.full(p.shape, np.nan)))
            half = reach(self.dof.get(p.name, np.inf), 0.5 + level / 2) * sd
            with np.errstate(invalid="ignore"):  # an absent effect with an infinite null has no interval
                lower[p.name] = np.maximum(p.array - half, p.bounds[0])
                upper[p.name] = np.minimum(p.array + half, p.bounds[1])
        return pd.DataFrame({"lower": self._by_name(lower, "lower"), "upper": self._by_name(upper, "upper")})

    def seen(
        self,
        role: str = "",
        *,
        moved: Mapping[str, Sequence[str | Path]] | None = None,
        columns: Columns | None = None,
        otherwise: str = "Hand it over.",
    ) -> tuple[Recording, ...]:
        """Recordings that it was fitted to ("train") and validated on ("validate"), read again if necessary.

        Parameters
        ----------
        role : of the recordings; all by default.
        moved : role -> new paths of its files, in their order; by default those of the fit.
        columns : column map; by default that of the fit.
        otherwise : what the error message advises if a recording is not found; ``{role}`` is replaced by its role.

        Raises
        ------
        BadInput : if a file is missing or has changed, or a recording was made in memory.
        """
        records = [item for item in self.data if role in ("", item.role)]
        new = {name: list(files) for name, files in (moved or {}).items() if files}
        if self.recordings and not new:
            pairs = zip(self.recordings, self.data, strict=True)
            return tuple(as_seen(self, recording) for recording, record in pairs if record in records)
        for name, files in new.items():
            count = sum(record.role == name for record in self.data)
            if len(files) != count:
                made = f"{self.file or 'The fit'} was made with {counted(count, 'recording')} to {name}"
                raise BadInput(f"{made}, but {len(files)} are named.")
        result = []
        for record in records:
            files = new.get(record.role, [])
            file = files.pop(0) if files else found_again(record, self.file, otherwise.format(role=record.role))
            result.append(_as_taken(read(file, columns or record.mapping), record))
        return matched(replace(self, data=tuple(records)), result)

    def _by_name(self, values: Mapping[str, Any], title: str) -> pd.Series[float]:
        result: dict[str, float] = {}
        for parameter in self.model.parameters:
            value: Array = np.broadcast_to(np.asarray(values[parameter.name], dtype=float), parameter.shape)
            result |= dict(zip((entry.name for entry in entries(parameter)), value.ravel().tolist(), strict=True))
        return pd.Series(result, name=title, dtype=float)


FOLDERS_ABOVE = 3
"""Number of folders, from the fit's own upwards, from which paths of its command may be relative."""


def found_again(record: DataRecord, fit_file: Path | None, otherwise: str = "Hand it over.") -> Path:
    """Path of a recording: as named by the fit's command, or relative to the fit's folder or a folder above.

    Parameters
    ----------
    record : of the recording in the fit.
    fit_file : the file of the fit.
    otherwise : what the error message advises if it is not found.
    """
    if not record.path:
        raise BadInput(f"The recording {record.name} was made in memory and is in no file. {otherwise}")
    above = [] if fit_file is None else fit_file.resolve().parents[:FOLDERS_ABOVE]
    around = [folder / name for folder in above for name in (record.path, Path(record.path).name)]
    for place in (Path(record.path), *around):
        if place.is_file():
            return place
    raise BadInput(f"{record.path}, which the fit was made with, is no longer there. {otherwise}")


def _as_taken(recording: Recording, record: DataRecord) -> Recording:
    """The rows of a file that a fit used."""
    recording = recording.between(*span(record.between)) if record.between else recording
    return recording.where(record.where) if record.where else recording
